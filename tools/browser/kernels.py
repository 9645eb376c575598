"""Compile kernels to WebAssembly, from the sources that numba compiles in Python.

    python tools/browser/kernels.py FOLDER

writes ``kernels.wasm``, and ``kernels.json`` with what each entry takes and returns and the formulas of contact laws.
The LLVM code of each entry is taken before it is optimised, for what is optimised has offsets of another processor; it
gets the layout of WebAssembly, and is linked by ``wasm-ld`` (Debian's package lld). Entries, and the types that they
are compiled for, are found by solving one case of each kind.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

os.environ["NUMBA_OPT"] = "0"  # also numba's own functions, which are linked in

import llvmlite.binding as llvm
import numpy as np
from numba import typeof
from numba.core import types

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels import law
from phasemap._kernels.compilation import entries as compilation
from phasemap._kernels.compilation import linked_code
from phasemap._kernels.compilation.disk_cache import DiskCache
from phasemap._kernels.orbits.time import march
from phasemap.experiment.interaction.contact import LAWS
from phasemap.experiment.interaction.longrange import Biased
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.problem import work_of_material
from phasemap.solvers.solver import by_name

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+simd128,+bulk-memory,+nontrapping-fptoint,+sign-ext"
LINKERS = ("wasm-ld", "wasm-ld-19", "wasm-ld-16", "wasm-ld-14")
STACK = 1 << 20  # bytes; records of kernels lie there, of at most 128 kB each
NAMES = {types.float64: "float64", types.int64: "int64", types.boolean: "bool", types.none: "none"}
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


def linker() -> str | None:
    """Path of the linker of WebAssembly; None without one."""
    return next(filter(None, map(shutil.which, LINKERS)), None)


def take_modules() -> list[str]:
    """LLVM code of every entry, shared function and formula, as it is before it is optimised."""
    taken: list[str] = []

    def finalize(self: Any) -> None:
        linked_code._link(self, self._final_module, "private")
        taken.append(str(self._final_module))
        self._optimize_final_module()
        self._finalize_final_module()

    linked_code.EntryCode.finalize = finalize  # type: ignore[method-assign]
    DiskCache.load_overload = lambda self, sig, context: context.refresh()  # type: ignore[method-assign]
    DiskCache.save_overload = lambda self, sig, data: None  # type: ignore[method-assign]
    solve_one_of_each_kind()
    formulas()
    return taken + [code._library.get_llvm_str() for code in (*law._COMPILED.values(), *march._KEPT)]


def solve_one_of_each_kind() -> None:
    """Orbits, both branches and a curve are solved; what only some materials need is compiled without being run."""
    from phasemap._kernels.columns import WIDE, ErrorLimits, SolvedRows
    from phasemap._kernels.continuation.piece import exact_orbits_at
    from phasemap._kernels.engagement.in_time import free_state, move_to_amplitude, move_to_tip_offset
    from phasemap._kernels.engagement.seen import SLOPES
    from phasemap._kernels.excitation import likely_amplitude
    from phasemap._kernels.neck import loop_energies
    from phasemap._kernels.orbits.averaged.orbits import ratio_far_from_surface
    from phasemap._kernels.orbits.collocation.system import new_orbit
    from phasemap._kernels.orbits.time.landing import land_free, land_on
    from phasemap._kernels.quadrature import TABLES
    from phasemap._kernels.rows import exact, fast, marched
    from phasemap._kernels.rows.answers import Answers
    from phasemap._kernels.scanning.quasi_static import reach_rows
    from phasemap.solvers.continuation.path import Question, fixed_path

    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    material = pm.Material(modulus=2e9, adhesion=0.1)
    work = work_of_material(material, scope, 0.8 * scope.driven_amplitude)
    stable_branches(work, by_name("auto"), pm.Accuracy())
    pm.sweep_distance(material, scope, np.linspace(20e-9, 4e-9, 5), samples=4)
    given, pixels = (work.law, work.rows, work.lever), work.pixels
    answers = Answers(np.zeros((1, col.COLUMNS)), np.zeros(1, np.int8), np.zeros(1, np.int8))
    solved = SolvedRows(np.zeros((1, WIDE)), np.zeros(1, bool), np.zeros((1, 0)))
    oscillator, numbers, limits = work.oscillator(0), np.zeros(4), ErrorLimits(0.0, 0.0)
    path, orbit = fixed_path(Question(material, scope)), new_orbit(work.lever, TABLES)
    for entry, *examples in (
        (fast.averaging_rows, pixels, answers),
        (fast.averaged_near_rows, pixels, answers),
        (exact_orbits_at, path, np.zeros((1, 6)), numbers, 0, 1.0, orbit, answers.rows),
        (exact.seen_rows, pixels, TABLES, limits, answers, np.zeros((1, SLOPES))),
        (exact.exact_rows, pixels, TABLES, answers),
        (fast.seen_side_rows, pixels, 1, limits, answers, np.zeros((1, SLOPES))),
        (exact.exact_side_rows, pixels, TABLES, 1, answers, np.zeros((1, SLOPES))),
        (exact.replace_by_exact_rows, pixels, TABLES, answers.rows, np.zeros(1, bool)),
        (exact.force_rows, pixels, TABLES, 0, solved, 0),
        (marched.march_rows, pixels, 1.0, 1, answers.rows, answers.status),
        (marched.remembering_rows, pixels, 1.0, 1, answers.rows, answers.status),
        (marched.relaxing_rows, pixels, limits, answers),
        (ratio_far_from_surface, oscillator, 1.0),
        (free_state, work.law, numbers, 1.0),
        (reach_rows, *given, 1.0, 1, answers.rows, numbers),
        (land_free, oscillator, numbers, 1.0, 1, numbers),
        (land_on, oscillator, 1.0, numbers, np.zeros((1, 2)), 1.0, 1),
        (move_to_tip_offset, oscillator, 1.0, 1.0, 1, numbers, numbers),
        (move_to_amplitude, oscillator, 1.0, 1.0, 1, numbers, numbers),
        (loop_energies, work.law, work.rows),
        (likely_amplitude, work.lever, 1.0, 1),
    ):
        entry.compile(tuple(map(typeof, examples)))


def formulas() -> dict[str, str]:
    """Names in the code of formulas of contact laws and of the march that remembers, by their names in Python."""
    found, given = {}, []
    for one in LAWS.values():
        given += [one.force, one.slope, one.attraction.force, one.attraction.slope, one.damping, one.damping_slope]
    for formula in [*given, Biased.force, Biased.slope]:
        if not formula.__module__.startswith("phasemap._kernels"):
            address = law.address_of(formula)
            code = next(code for code in law._COMPILED.values() if code.address == address)
            found[f"{formula.__module__}.{formula.__qualname__}"] = code._wrapper_name
    march.address_of_relaxing()
    found[f"{march.__name__}.{march.address_of_relaxing.__name__}"] = march._KEPT[0]._wrapper_name
    return found


def kind_of(one: types.Type) -> Any:
    """A type as JSON has it."""
    if isinstance(one, types.Array):
        return {"array": str(one.dtype), "dimensions": one.ndim}
    if isinstance(one, types.BaseNamedTuple):
        name = f"{one.instance_class.__module__}.{one.instance_class.__qualname__}"
        return {"class": name, "fields": list(map(kind_of, one.types))}
    if isinstance(one, types.BaseTuple):
        return {"items": [kind_of(part) for part in one.types]}
    return {"record": one.words} if hasattr(one, "words") else NAMES[types.unliteral(one)]


def entries() -> dict[str, dict[str, Any]]:
    """Of each function that Python called: its name in the code, its arguments and its answer."""
    return {
        f"{one.__module__.removeprefix('phasemap._kernels.')}.{one.__name__}": {
            "symbol": result.fndesc.llvm_func_name,
            "arguments": [kind_of(argument) for argument in result.signature.args],
            "answer": kind_of(result.signature.return_type),
        }
        for one in compilation._all_kernels()
        for result in one.overloads.values()
    }


def object_file(modules: list[str], symbols: set[str]) -> bytes:
    """All modules as one object file, from which these symbols are seen."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(opt=3, reloc="static", features=FEATURES)
    whole = llvm.parse_assembly("")
    for text in modules:
        text = re.sub(r"^target datalayout.*$", f'target datalayout = "{machine.target_data}"', text, flags=re.M)
        text = re.sub(r"^target triple.*$", f'target triple = "{TRIPLE}"', text, flags=re.M)
        text = re.sub(r'"target-(cpu|features)"="[^"]*"', "", text)
        text = re.sub("^define private ", "define linkonce_odr ", text, flags=re.M)  # shared functions, once for all
        text = re.sub(rf"^declare i8 @{re.escape(COUNT)}.*$", COUNTED, text, flags=re.M)
        whole.link_in(llvm.parse_assembly(text.replace(f"@{COUNT}", "@count_down")))
    for one in [*whole.functions, *whole.global_variables]:
        if not one.is_declaration:
            one.linkage, one.visibility = "external" if one.name in symbols else "internal", "default"
    whole.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = True
    passes = llvm.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(whole, passes)
    return bytes(machine.emit_object(whole))


def build(folder: Path) -> None:
    """Write kernels.wasm and kernels.json."""
    found = linker()
    if found is None:
        sys.exit("There is no linker of WebAssembly: install wasm-ld, which Debian has in its package lld.")
    modules = take_modules()
    named, table = formulas(), entries()
    symbols = {one["symbol"] for one in table.values()} | set(named.values())
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / "kernels.o"
    place.write_bytes(object_file(modules, symbols))
    options = ["--no-entry", "--allow-undefined", "--export-table", "--growable-table", "--stack-first"]
    shown = [f"--export={name}" for name in ("__heap_base", *sorted(symbols))]
    made = ["-z", f"stack-size={STACK}", place, "-o", folder / "kernels.wasm"]
    subprocess.run([found, *options, *shown, *map(str, made)], check=True)
    place.unlink()
    (folder / "kernels.json").write_text(json.dumps({"entries": table, "formulas": named}))


if __name__ == "__main__":
    build(Path(sys.argv[1]))
