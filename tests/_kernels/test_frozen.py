"""Two formulas are the same only if all that is compiled of them is; what cannot be known of one is never shared."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.extending import overload

from phasemap._kernels import law
from phasemap._kernels.compilation import by_address, disk_cache
from phasemap._kernels.compilation.frozen import frozen

HELPERS = """
import math
import numba
K = {attribute}
L = 3.0

@numba.njit(fastmath={fastmath})
def jitted(x):
    return x * {jitted} + L

def plain(x, by={default}):
    return x * by
"""
FORMULA = """
def make(k, table, pair, f):
    def force(d, p):
        within = lambda x: x * {within}
        def nested(x):
            return within(x) + {nested}
        return k * nested(d) + helpers.K + helpers.jitted(d) + helpers.plain(d) + plain(d) + table[1] + pair[1] * f(d)
    return force
"""
WRITTEN = ("attribute", "jitted", "default", "within", "nested")
HELD = ("k", "entry", "second")
LITERALS = (1, 2, True, 1.0, 0.0, -0.0, 2.5)
SCALARS = (np.int64(1), np.int64(2), np.int32(1), np.float64(1.0), np.float32(1.0), np.float32(2.5))
DRAWN = st.fixed_dictionaries(
    dict.fromkeys(WRITTEN, st.sampled_from(LITERALS))
    | dict.fromkeys(HELD, st.sampled_from(LITERALS + SCALARS))
    | {"fastmath": st.sampled_from([False, True, {"nsz", "contract"}])}
)


def made(of: dict[str, Any]) -> tuple[Any, Any]:
    """A formula, and the module of its helpers, as a process has them that finds these sources."""
    helpers = ModuleType("helpers")
    exec(HELPERS.format(**of), vars(helpers))
    scope: dict[str, Any] = {"helpers": helpers, "plain": vars(helpers)["plain"], "__name__": "laws"}
    exec(FORMULA.format(**of), scope)
    return scope["make"](of["k"], np.array([1.0, of["entry"]], np.float64), (1.0, of["second"]), math.sqrt), helpers


def told_apart(of: dict[str, Any]) -> dict[str, Any]:
    """What is said in a formula: 1, True and 1.0 are three, but in an array."""
    return {name: repr(float(one) if name == "entry" else (type(one), one)) for name, one in of.items()}


@settings(deadline=None)
@given(DRAWN, DRAWN, st.sets(st.sampled_from([*WRITTEN, *HELD, "fastmath"]), max_size=2))
def test_formulas_have_one_digest_only_if_they_are_the_same(
    one: dict[str, Any], other: dict[str, Any], changed: set[str]
) -> None:
    other = {name: other[name] if name in changed else value for name, value in one.items()}
    first, second = frozen(made(one)[0]), frozen(made(other)[0])
    assert first.lasts and second.lasts
    assert (first.digest == second.digest) == (told_apart(one) == told_apart(other))


ONE: dict[str, Any] = {**dict.fromkeys((*WRITTEN, *HELD), 2.0), "fastmath": False}


def cell(formula: Any, name: str) -> Any:
    return formula.__closure__[formula.__code__.co_freevars.index(name)]


CHANGES: dict[str, Callable[[Any, Any], Any]] = {
    "attribute of a module": lambda formula, helpers: setattr(helpers, "K", 5.0),
    "what a jitted helper uses": lambda formula, helpers: setattr(helpers, "L", 5.0),
    "a jitted helper": lambda formula, helpers: setattr(helpers, "jitted", numba.njit(lambda x: 5.0 * x)),
    "a helper of a module": lambda formula, helpers: setattr(helpers, "plain", lambda x: 5.0 * x),
    "default": lambda formula, helpers: setattr(helpers.plain, "__defaults__", (5.0,)),
    "code": lambda formula, helpers: setattr(helpers.plain, "__code__", (lambda x, by: x).__code__),
    "closure": lambda formula, helpers: setattr(cell(formula, "k"), "cell_contents", 5.0),
    "function of a library": lambda formula, helpers: setattr(cell(formula, "f"), "cell_contents", math.sin),
    "array": lambda formula, helpers: cell(formula, "table").cell_contents.fill(5.0),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_changes_afterwards_makes_another_formula(change: str) -> None:
    formula, helpers = made(ONE)
    before = frozen(formula)
    assert frozen(formula).digest == before.digest
    CHANGES[change](formula, helpers)
    assert frozen(formula).digest != before.digest


def test_a_copy_sees_nothing_of_what_changes_afterwards() -> None:
    formula, helpers = made(ONE)
    copy, expected = frozen(formula).function, formula(1.0, None)
    for change in CHANGES.values():
        if change is not CHANGES["a helper of a module"]:
            change(formula, helpers)
    assert copy(1.0, None) == expected != formula(1.0, None)


def test_functions_may_call_each_other_and_be_given_in_tuples() -> None:
    source = """
def even(n):
    return factor if n < 1 else odd(n - 1)
def odd(n):
    return 0.0 if n < 1 else even(n - 1)
def force(d, p):
    return both[1](d) + even(d)
both = (odd, even)
"""

    def digest(factor: float) -> str:
        scope: dict[str, Any] = {"factor": factor, "__name__": "laws"}
        exec(source, scope)
        return frozen(scope["force"]).digest

    assert digest(1.0) == digest(1.0) != digest(2.0)


class Mode(enum.IntEnum):
    soft = 1


@numba.njit("float64(float64)")
def compiled_by_now(x: float) -> float:
    return 2.0 * x


@numba.njit(locals={"y": numba.float32})
def with_a_type_of_its_own(x: float) -> float:
    y = x / 3.0
    return 2.0 * y


@pytest.mark.parametrize("held", [Mode, compiled_by_now, with_a_type_of_its_own])
def test_what_numba_takes_as_it_is_stays_the_same_in_its_process_only(held: Any) -> None:
    first, second = (frozen(lambda d, p: held) for _ in range(2))
    assert first.digest and first.digest == second.digest and not first.lasts


@pytest.mark.parametrize(
    "held", [[1.0], {"a": 1.0}, SimpleNamespace(a=1.0), Mode.soft, np.array([(1.0,)], [("a", "f8")]), object()]
)
def test_what_is_not_known_is_shared_with_nothing(held: Any) -> None:
    assert frozen(lambda d, p: held)[1:] == ("", False)


def test_a_function_of_a_library_that_somebody_else_compiles_is_known_in_its_process_only() -> None:
    assert frozen(lambda d, p: math.ulp(d)).lasts

    @overload(math.ulp)
    def ulp(x: Any) -> Any:
        return lambda x: 1.0

    assert not frozen(lambda d, p: math.ulp(d)).lasts


def test_a_function_for_which_numba_has_other_code_is_compiled_by_that() -> None:
    twice, of_type = (lambda x: 2.0 * x), (lambda x: lambda x: 3.0 * x)
    overload(twice)(of_type)
    assert value(lambda d, p: twice(d)) == 6.0
    assert frozen(lambda d, p: twice(d))[1:] == ("", False)


def test_what_is_no_plain_function_is_named() -> None:
    with pytest.raises(TypeError, match="a plain function is needed, not partial"):
        frozen(partial(lambda k, d, p: k * d, 2.0))


def value(formula: Any) -> float:
    """Of the compiled formula, at d = 2 m."""
    return law._called_by_python(law.address_of(formula), 2.0, np.arange(1.0, 13.0))


def test_compiled_formulas_have_their_own_numbers_here_and_from_disk(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_cache, "folder", lambda: tmp_path)
    drawn = [ONE | {name: 3} for name in ("attribute", "jitted", "default", "nested")]
    for of in (ONE, *drawn, ONE):  # each is compiled, or found in this process
        formula, _ = made(of)
        assert value(formula) == pytest.approx(formula(2.0, None), rel=1e-15)
    formula, helpers = made(ONE)
    expected = formula(2.0, None) + 10.0
    helpers.K += 5.0
    helpers.L += 5.0
    assert value(formula) == pytest.approx(expected, rel=1e-15)
    monkeypatch.setattr(by_address, "KEPT", found := {})
    assert value(formula) == pytest.approx(expected, rel=1e-15)
    assert [code.cache_hits for code in found.values()] == [1]
    formula, _ = made(ONE)
    assert value(formula) == pytest.approx(formula(2.0, None), rel=1e-15)


def test_what_is_known_in_one_process_only_is_not_kept(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_cache, "folder", lambda: tmp_path)
    large = np.arange(200_000.0)
    assert value(lambda d, p: compiled_by_now(d)) == 4.0
    assert value(lambda d, p: large[-1]) == 199_999.0
    large[-1] = 1.0
    assert value(lambda d, p: large[-1]) == 1.0
    kept = len(by_address.KEPT)
    mode = Mode.soft
    for _ in range(2):
        assert value(lambda d, p: 3.0 if mode > 0 else d) == 3.0
    assert len(by_address.KEPT) == kept + 2 and not list(tmp_path.iterdir())
