"""Kernels called by their addresses, as those of a wheel are, take and return what they do when numba calls them."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit, typeof
from numba.core.runtime import _nrt_python

sys.path.append(str(Path(__file__).parents[2] / "tools"))
from llvm_types import kind_of

import phasemap as pm
from phasemap._kernels.compilation.library import Called
from phasemap._kernels.records import column, record

RELEASE = _nrt_python.c_helpers["MemInfo_release"]


class Code(dict[str, Any]):
    """What a shared library is, of functions that were compiled here."""

    NRT_MemInfo_call_dtor = ctypes.CFUNCTYPE(None, ctypes.c_int64)(RELEASE)


class Pair(NamedTuple):
    """A table and a number."""

    table: np.ndarray
    factor: float


@record
class Sum:
    """A record."""

    total: float
    count: int
    parts: np.ndarray = column(3)


def by_address(function: Any, *examples: Any) -> Called:
    """A function of numba as one of a library."""
    compiled = njit(function)
    compiled.compile(tuple(map(typeof, examples)))
    (result,) = compiled.overloads.values()
    symbol = result.fndesc.llvm_func_name
    place = result.library.get_pointer_to_function(symbol)
    arguments, answer = map(kind_of, result.signature.args), kind_of(result.signature.return_type)
    code = Code({symbol: ctypes.CFUNCTYPE(ctypes.c_int)(place)})
    about = {"symbol": symbol, "arguments": list(arguments), "answer": answer}
    return Called(function, code, [about])  # type: ignore[arg-type]


def scaled(pair: Pair, i: int, negative: bool, one: Sum, z: complex) -> tuple[float, Pair, np.ndarray, bool, complex]:
    """Numbers, an array that was given and one that is made, and a record that is changed."""
    for j in range(pair.table.shape[1]):
        pair.table[i, j] *= -pair.factor if negative else pair.factor
        one.parts[j] = pair.table[i, j]
    one.total, one.count = one.parts.sum(), one.count + 1
    return one.total, Pair(pair.table, 2 * pair.factor), pair.table[i] + 1, not negative, z * 1j


@pytest.fixture(scope="module")
def scale() -> Called:
    """`scaled`, compiled."""
    return by_address(scaled, Pair(np.zeros((1, 1)), 1.0), 0, True, Sum(), 1j)


def test_numbers_arrays_tuples_and_records_come_back(scale: Called) -> None:
    pair, one = Pair(np.arange(6.0).reshape(2, 3), 3.0), Sum()
    total, again, made, positive, turned = scale(pair, 1, True, one, 3 - 2j)
    assert (total, again.factor, positive, turned) == (-36.0, 6.0, False, 2 + 3j)
    assert again.table is pair.table and isinstance(again, Pair)
    np.testing.assert_array_equal(pair.table, [[0, 1, 2], [-9, -12, -15]])
    np.testing.assert_array_equal(made, [-8, -11, -14])
    assert (one.total, one.count) == (-36.0, 1)  # type: ignore[attr-defined]


def test_an_array_with_gaps_is_changed_as_one_without(scale: Called) -> None:
    table = np.arange(12.0).reshape(2, 6)
    scale(Pair(table[:, ::2], 2.0), 0, False, Sum(), 0j)
    np.testing.assert_array_equal(table, [[0, 1, 4, 3, 8, 5], [6, 7, 8, 9, 10, 11]])


def test_an_array_of_another_kind_is_refused(scale: Called) -> None:
    with pytest.raises(TypeError, match="an array of float64 with 2 dimensions"):
        scale(Pair(np.zeros((2, 3), np.float32), 1.0), 0, False, Sum(), 0j)
    with pytest.raises(TypeError, match="an array of float64 with 2 dimensions"):
        scale(Pair(np.zeros(3), 1.0), 0, False, Sum(), 0j)


def test_a_function_that_fails_says_so() -> None:
    fails = by_address(lambda x: 1 // x, 1)
    assert fails(1) == 1
    with pytest.raises(RuntimeError, match="fails with code"):
        fails(0)


def test_random_numbers_are_those_of_numpys_generator() -> None:
    def draw(rng: np.random.Generator) -> float:
        return rng.standard_normal() + rng.random()

    rng, same = np.random.default_rng(1), np.random.default_rng(1)
    drawn = by_address(draw, rng)
    assert [drawn(rng) for _ in range(3)] == [draw(same) for _ in range(3)]


class Own(pm.ContactLaw):
    """A law that no wheel brings."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return float(0.3 * p[0] * d * d)


def test_where_there_is_no_numba_a_law_of_ones_own_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "phasemap._kernels.compilation.by_address", None)
    drive, own = pm.Drive(16e-9), pm.Interaction(Own())
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), drive, own)
    with pytest.raises(ValueError, match=r"takes numba, which is not installed: pip install 'afm-phasemap\[law\]'"):
        pm.solve_pixel(pm.Material(2e9, 0.05), scope, 0.8)
