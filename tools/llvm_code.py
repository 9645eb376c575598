"""LLVM code of the kernels as it is before it is optimised, for processors and places that are not those here.

`take_modules` collects that of everything that is compiled while some work is done; `entries` and `formulas` say what
is called in it and how. For what is optimised has offsets of one processor.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from typing import Any, NamedTuple

os.environ["NUMBA_OPT"] = "0"  # also numba's own functions, which are linked in

import numpy as np
from llvm_types import kind_of
from numba import typeof

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.compilation import by_address, linked_code
from phasemap._kernels.compilation import entries as compilation
from phasemap._kernels.compilation.disk_cache import DiskCache
from phasemap._kernels.orbits.time import march
from phasemap.experiment.interaction import ContactLaw
from phasemap.experiment.interaction.longrange import LongRange
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.problem import work_of_material
from phasemap.solvers.solver import by_name

FORMULAS = ("force", "slope", "damping", "damping_slope", "withdrawn")
# numba counts references by an instruction that x86 alone has.
COUNT = "llvm.x86.atomic.sub.cc.i64"
COUNTED = """define internal i8 @count_down(ptr %place, i64 %by, i32 %_) {
  %old = load i64, ptr %place
  %new = sub i64 %old, %by
  store i64 %new, ptr %place
  %none = icmp eq i64 %new, 0
  %answer = zext i1 %none to i8
  ret i8 %answer
}"""


class Module(NamedTuple):
    """The code of one entry, shared function or formula."""

    text: str
    vectors: bool = False  # whether statements that follow one another may be put into vector instructions

    def for_target(self, triple: str, layout: str) -> str:
        """The text with what says for which processor it is."""
        text = re.sub(r"^target datalayout.*$", f'target datalayout = "{layout}"', self.text, flags=re.M)
        text = re.sub(r"^target triple.*$", f'target triple = "{triple}"', text, flags=re.M)
        text = re.sub(r'"target-(cpu|features)"="[^"]*"', "", text)
        text = re.sub(rf"^declare i8 @{re.escape(COUNT)}.*$", COUNTED, text, flags=re.M)
        return text.replace(f"@{COUNT}", "@count_down")


def take_modules(work: Callable[[], None]) -> list[Module]:
    """Code of every entry, shared function and formula that this work needs, and of all formulas."""
    taken: list[Module] = []

    def finalize(self: Any) -> None:
        linked_code._link(self, self._final_module, "private")
        taken.append(Module(str(self._final_module), isinstance(self, linked_code.VectorCode)))
        self._optimize_final_module()
        self._finalize_final_module()

    linked_code.EntryCode.finalize = finalize  # type: ignore[method-assign]
    DiskCache.load_overload = lambda self, sig, context: context.refresh()  # type: ignore[method-assign]
    DiskCache.save_overload = lambda self, sig, data: None  # type: ignore[method-assign]
    work()
    formulas()
    return taken + [Module(code._library.get_llvm_str()) for code in by_address.KEPT.values()]


def solve_one_of_each_kind() -> None:
    """Orbits, both branches and a curve are solved; what only some materials need is compiled without being run."""
    from phasemap._kernels.columns import WIDE, SolvedRows
    from phasemap._kernels.continuation.piece import collocation_orbits_at
    from phasemap._kernels.engagement.in_time import free_state, move_to_amplitude, move_to_tip_offset
    from phasemap._kernels.excitation import likely_amplitude
    from phasemap._kernels.neck_energy import loop_energies
    from phasemap._kernels.orbits.averaged.orbits import ratio_far_from_surface
    from phasemap._kernels.orbits.collocation.system import new_orbit
    from phasemap._kernels.orbits.time import march
    from phasemap._kernels.orbits.time.many_periods import land_free
    from phasemap._kernels.quadrature import TABLES
    from phasemap._kernels.rows import by_collocation, by_response, marched
    from phasemap._kernels.rows.answers import Answers
    from phasemap._kernels.scanning.quasi_static import reach_rows
    from phasemap.solvers.continuation.path import Question, path_of

    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    material = pm.Material(modulus=2e9, adhesion=0.1)
    work = work_of_material(material, scope, 0.8 * scope.driven_amplitude)
    march.address_of_relaxing()
    stable_branches(work, by_name("auto"), pm.Accuracy())
    pm.sweep_distance(material, scope, np.linspace(20e-9, 4e-9, 5), samples=4)
    given, pixels = (work.law, work.rows, work.lever), work.pixels
    answers = Answers(np.zeros((1, col.COLUMNS)), np.zeros(1, np.int8), np.zeros(1, np.int8))
    solved = SolvedRows(np.zeros((1, WIDE)), np.zeros(1, bool), np.zeros((1, 0)))
    oscillator, numbers = work.oscillator(0), np.zeros(4)
    path, orbit = path_of(Question(material, scope)), new_orbit(work.lever, TABLES)
    compile_for(
        (by_response.averaging_rows, pixels, answers),
        (by_response.averaged_near_rows, pixels, answers),
        (collocation_orbits_at, path, np.zeros((1, 6)), numbers, 0, orbit, answers.rows),
        (by_collocation.collocation_rows, pixels, TABLES, answers),
        (by_collocation.collocation_side_rows, pixels, TABLES, 1, answers),
        (by_collocation.force_rows, pixels, TABLES, 0, solved, 0),
        (marched.march_rows, pixels, 1.0, 1, answers.rows, answers.status),
        (marched.remembering_rows, pixels, 1.0, 1, answers.rows, answers.status),
        (ratio_far_from_surface, oscillator, 1.0),
        (free_state, work.law, numbers, 1.0),
        (reach_rows, *given, 1.0, 1, answers.rows, numbers),
        (land_free, oscillator, numbers, 1.0, 1, numbers),
        (move_to_tip_offset, oscillator, 1.0, 1.0, 1, numbers, numbers),
        (move_to_amplitude, oscillator, 1.0, 1.0, 1, numbers, numbers),
        (loop_energies, work.law, work.rows),
        (likely_amplitude, work.lever, 1.0, 1),
    )


def compile_for(*calls: tuple[Any, ...]) -> None:
    """Compile kernels, without running them, for examples of their arguments."""
    for entry, *examples in calls:
        entry.compile(tuple(map(typeof, examples)))


def formulas() -> dict[str, str]:
    """Names in the code of formulas of laws, and of the march that remembers if it was asked for."""
    found = {}
    for law in subclasses(ContactLaw) | subclasses(LongRange):
        for formula in filter(None, map(vars(law).get, FORMULAS)):
            if isinstance(formula, staticmethod) and not formula.__func__.__module__.startswith("phasemap._kernels"):
                code = by_address.compiled_formula(formula.__func__)
                found[f"{formula.__module__}.{formula.__qualname__}"] = code._wrapper_name
    if march.address_of_relaxing.cache_info().currsize:
        address = march.address_of_relaxing()
        code = next(one for one in by_address.KEPT.values() if one.address == address)
        found[f"{march.__name__}.{march.address_of_relaxing.__name__}"] = code._wrapper_name
    return found


def subclasses(base: type) -> set[type]:
    """The classes of phasemap's own that are made from one."""
    own = {one for one in base.__subclasses__() if one.__module__.startswith("phasemap.experiment.")}
    return own.union(*map(subclasses, own))


def entries() -> dict[str, list[dict[str, Any]]]:
    """Of each function that Python called its name in the code, its arguments and its answer, for each kind of them."""
    found: dict[str, list[dict[str, Any]]] = {}
    for one in compilation._all_kernels():
        name = f"{one.__module__.removeprefix('phasemap._kernels.')}.{one.__name__}"
        for result in one.overloads.values():
            of_call = {"symbol": result.fndesc.llvm_func_name, "arguments": list(map(kind_of, result.signature.args))}
            found.setdefault(name, []).append({**of_call, "answer": kind_of(result.signature.return_type)})
    return found
