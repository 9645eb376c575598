"""Compile the kernels into a wheel, which is then for one platform and every Python, and asks for numba no more.

    python tools/wheel/ahead.py WHEEL FOLDER [--kinds KIND ...] [--target TRIPLE PLATFORM] [--linker COMMAND]

writes a wheel into FOLDER, from one that `python -m build` made and that is installed here. KIND: the kinds of work of
``phasemap.cli.kinds_of_work`` whose kernels it brings; all of them unless said. TRIPLE and PLATFORM: another platform
than this one, as LLVM and as the names of wheels have it. COMMAND: the C compiler that links, cc unless said. Needs the
package wheel.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import re
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

sys.path.append(str(Path(__file__).parents[1]))

import llvm_code  # before numba
import llvmlite.binding as llvm
import numpy as np
from numba.core.llvm_bindings import create_pass_builder

import phasemap
from phasemap._kernels.columns import SolvedRows
from phasemap._kernels.compilation import entries, library
from phasemap._kernels.law import contact_force, longrange_force, withdrawn_force
from phasemap._kernels.quadrature import TABLES
from phasemap._kernels.rows.by_collocation import adhesion_rows
from phasemap._kernels.rows.derivatives import Setpoints, averaged_phases
from phasemap._kernels.rows.marched import second_drive_rows
from phasemap._kernels.scanning.periods import begin_periods, new_periods
from phasemap.cli.kinds_of_work import KINDS, LIQUID, MATERIAL, SCOPE, TWO
from phasemap.solvers.problem import work_of_material

# Processors of ten years and less first, and what those need by numpy's names; then all.
LEVELS = {
    "x86_64": [("x86-64-v3", ["AVX2", "FMA3"]), ("x86-64", [])],
    "aarch64": [("generic", [])],
    "arm64": [("apple-m1", [])],
}
OWN_LAW = "one's own law"  # whose formulas no wheel can bring
ON_DEMAND = ("numba", "llvmlite")  # what a wheel with compiled kernels needs for such a law only, its extra `law`
# Memory as numba asks for it: a header of six words, which begins with a count of references, before what it is for.
MEMORY = """
declare ptr @malloc(i64)
declare void @free(ptr)
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %by = zext i32 %align to i64
  %with_header = add i64 %size, 64
  %whole = add i64 %with_header, %by
  %header = call ptr @malloc(i64 %whole)
  %at = ptrtoint ptr %header to i64
  %after = add i64 %at, 64
  %less = sub i64 %by, 1
  %up = add i64 %after, %less
  %mask = sub i64 0, %by
  %place = and i64 %up, %mask
  store i64 1, ptr %header
  %data = getelementptr i64, ptr %header, i64 3
  store i64 %place, ptr %data
  ret ptr %header
}
define void @NRT_Free(ptr %place) {
  call void @free(ptr %place)
  ret void
}
define void @NRT_MemInfo_call_dtor(ptr %header) {
  call void @free(ptr %header)
  ret void
}
"""
RELEASE = "NRT_MemInfo_call_dtor"
# Formulas that fail would tell Python so; none of those that are brought can.
OF_PYTHON = re.compile(r'^declare [^@]*@"?((?:Py|numba_)\w+)"?\(|^@(PyExc_\w+) = external', re.M)


def called_by_python() -> Iterable[entries._Entry]:
    """Kernels that the rest of the package calls, and those that kernels call which Python runs as they are."""
    for place in map(Path, phasemap.__path__):
        for source in place.rglob("*.py"):
            if "_kernels" in source.parts:
                continue
            for one in imported(ast.parse(source.read_text())):
                if isinstance(one, entries._Light):
                    within = inspect.getclosurevars(one.py_func).globals.values()
                    yield from (other for other in within if type(other) is entries._Entry)
                elif isinstance(one, entries._Entry):
                    yield one


def imported(tree: ast.Module) -> Iterable[Any]:
    """What a source imports of kernels, wherever that stands, and what it takes out of modules of them."""
    modules = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("phasemap._kernels"):
            for name in node.names:
                home = import_module(str(node.module))
                submodule = f"{node.module}.{name.name}"
                one = getattr(home, name.name) if hasattr(home, name.name) else import_module(submodule)
                modules[name.asname or name.name] = one
                yield one
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            yield getattr(modules[node.value.id], node.attr, None)


def work(kinds: list[str]) -> None:
    """Have everything compiled that these kinds of work need, or all that Python calls."""
    for kind in kinds or [one for one in KINDS if one != OWN_LAW]:
        KINDS[kind]()
    if kinds:
        return
    llvm_code.solve_one_of_each_kind()
    phasemap.invert([phasemap.simulate(TWO, LIQUID, one) for one in (0.8, 0.6)], LIQUID, phase_zero=0.0)
    phasemap.check(phasemap.simulate(TWO, SCOPE, 0.8, "auto", phasemap.Raster()), TWO)
    one = work_of_material(MATERIAL, SCOPE, 1e-8)
    law, table, row, codes = one.law, np.zeros((1, 1)), np.zeros(1), np.zeros(1, np.int8)
    llvm_code.compile_for(
        *((force, law, 0.0, row) for force in (contact_force, longrange_force, withdrawn_force)),
        (adhesion_rows, one.pixels, TABLES, table, SolvedRows(table, np.zeros(1, np.bool_), table)),
        (second_drive_rows, one.pixels, 1.0, 1, table, codes),
        (averaged_phases, law, table, Setpoints(table, row, codes, row), True, row),
        (begin_periods, row, 0.0, 0.0, 0.0, new_periods(1.0)),
    )
    missing = {f"{one.__module__}.{one.__name__}" for one in called_by_python() if not one.overloads}
    if missing:
        sys.exit(f"no work above calls {', '.join(sorted(missing))}")


def object_file(module: llvm_code.Module, triple: str, processor: str, called: set[str], shared: set[str]) -> bytes:
    """The code of a module for a processor, optimised as numba does it; what is `shared` is seen from other modules."""
    machine = llvm.Target.from_triple(triple).create_target_machine(cpu=processor, opt=3, reloc="pic")
    code = llvm.parse_assembly(module.for_target(triple, str(machine.target_data)))
    for one in [*code.functions, *code.global_variables]:
        if one.name in shared:
            one.visibility = "hidden"
        elif not one.is_declaration and one.linkage != llvm.Linkage.private:
            one.linkage, one.visibility = ("external" if one.name in called else "internal"), "default"
    code.verify()
    for level in (0, 3):  # of what is inlined before it is optimised, more references can be left out
        fast = level == 3
        passes = create_pass_builder(machine, opt=level, loop_vectorize=fast, slp_vectorize=fast and module.vectors)
        manager = passes.getModulePassManager()
        if not fast:
            manager.add_loop_rotate_pass()
            manager.add_instruction_combine_pass()
            manager.add_jump_threading_pass()
        manager.add_refprune_pass()
        manager.run(code, passes)
    return bytes(machine.emit_object(code))


def link(objects: list[Path], to: Path, triple: str, linker: list[str]) -> None:
    """Make a shared library of objects, which needs nothing but the C library of its system."""
    more: list[str | Path] = ["-static-libgcc"]
    if "apple" in triple:
        more = ["-Wl,-undefined,dynamic_lookup"]
    elif "linux" in triple:
        # Functions are named without versions, for those of this system may be newer than the ones where it will run.
        none, (empty, own) = objects[0].parent / "none.c", (objects[0].parent / "libm.so.6", ["-shared", "-nostdlib"])
        none.touch()
        subprocess.run([*linker, *own, "-Wl,-soname,libm.so.6", none, "-o", empty], check=True)
        more = ["-nostdlib", "-Wl,--no-as-needed,--unresolved-symbols=ignore-all,--gc-sections", empty]
    subprocess.run([*linker, "-shared", "-s", "-o", to, *objects, *more], check=True)


def never_called(modules: list[llvm_code.Module]) -> str:
    """What the code names of Python and does not need."""
    found = {names for one in modules for names in OF_PYTHON.findall(one.text)}
    values = (f"@{name} = global ptr null" for _, name in found if name)
    functions = (f"define void @{name}() {{\n  call void @abort()\n  unreachable\n}}" for name, _ in found if name)
    return "\n".join(["declare void @abort()", *functions, *values])


def defined(text: str) -> set[str]:
    """Names that a module has for others."""
    functions = re.findall(r'^define (?!private|internal|linkonce|weak)[^@]*@"?([^"(]+)"?\(', text, flags=re.M)
    return {*functions, *re.findall(r"^@(\w+) = global", text, flags=re.M)}


def needed(text: str) -> set[str]:
    """Names that a module asks others for."""
    functions = re.findall(r'^declare [^@]*@"?([^"(]+)"?\(', text, flags=re.M)
    return {*functions, *re.findall(r"^@(\w+) = external", text, flags=re.M)}


class Kernels(NamedTuple):
    """Code of kernels, how those are called that Python calls, and symbols of formulas by their names."""

    modules: list[llvm_code.Module]
    entries: dict[str, list[dict[str, Any]]]
    formulas: dict[str, str]


def collect(kinds: list[str]) -> Kernels:
    """The kernels that work of these kinds needs, or all."""
    modules = llvm_code.take_modules(lambda: work(kinds))
    modules.append(llvm_code.Module('target datalayout = ""\ntarget triple = ""\n' + MEMORY + never_called(modules)))
    return Kernels(modules, llvm_code.entries(), llvm_code.formulas())


def compile_into(ahead: Path, kernels: Kernels, triple: str, linker: list[str]) -> None:
    """Write libraries for all levels of a platform's processors, and the index, into a new folder."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    modules, table, named = kernels
    called = {one["symbol"] for versions in table.values() for one in versions} | set(named.values()) | {RELEASE}
    shared = (
        set.union(*(defined(one.text) for one in modules)) & set.union(*(needed(one.text) for one in modules)) - called
    )
    ahead.mkdir()
    levels = []
    for processor, needs in LEVELS[triple.partition("-")[0]]:
        file = f"kernels-{processor}" + (".dll" if "windows" in triple else ".so")
        with tempfile.TemporaryDirectory() as folder:
            objects = [Path(folder, f"{i}.o") for i in range(len(modules))]
            for path, one in zip(objects, modules, strict=True):
                path.write_bytes(object_file(one, triple, processor, called, shared))
            link(objects, ahead / file, triple, linker)
        levels.append({"file": file, "needs": needs})
        print(f"{file}: {len(table)} kernels, {(ahead / file).stat().st_size / 1e6:.1f} MB", flush=True)
    (ahead / library.INDEX).write_text(json.dumps({"levels": levels, "entries": table, "formulas": named}))


def platform_tag() -> str:
    """The platform here, as names of wheels have it."""
    tag = re.sub("[-.]", "_", sysconfig.get_platform())
    return tag.replace("linux", "manylinux_2_17", 1)  # whose C library has all functions that are called


def without_compiler(metadata: str) -> str:
    """The metadata of the wheel, which needs numba for a law of one's own only."""
    of_compiler = "|".join(ON_DEMAND)
    return re.sub(rf"^Requires-Dist: (?:{of_compiler})\b[^;\n]*\n", "", metadata, flags=re.M)


def main() -> None:
    """Unpack, compile, and pack."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kinds", nargs="+", default=[], choices=KINDS, metavar="KIND")
    here = llvm.get_default_triple(), platform_tag()
    parser.add_argument("--target", nargs=2, default=here, metavar=("TRIPLE", "PLATFORM"))
    parser.add_argument("--linker", default="cc", metavar="COMMAND")
    given = parser.parse_args()
    triple, tag = given.target
    with tempfile.TemporaryDirectory() as place:
        tool = [sys.executable, "-m", "wheel"]
        subprocess.run([*tool, "unpack", "--dest", place, given.wheel], check=True, stdout=subprocess.DEVNULL)
        (unpacked,) = Path(place).iterdir()
        installed = Path(phasemap.__path__[0]).parent
        for source in (unpacked / "phasemap").rglob("*.py"):
            if source.read_bytes() != (installed / source.relative_to(unpacked)).read_bytes():
                sys.exit(f"{source.name} is not what is installed here: install {given.wheel} first")
        compile_into(unpacked / "phasemap/_kernels/ahead", collect(given.kinds), triple, given.linker.split())
        (about,) = unpacked.glob("*.dist-info/WHEEL")
        (metadata,) = unpacked.glob("*.dist-info/METADATA")
        metadata.write_text(without_compiler(metadata.read_text()))
        kept = [line for line in about.read_text().splitlines() if line and not line.startswith(("Root-Is", "Tag"))]
        about.write_text("\n".join([*kept, "Root-Is-Purelib: false", f"Tag: py3-none-{tag}"]) + "\n")
        given.folder.mkdir(parents=True, exist_ok=True)
        subprocess.run([*tool, "pack", "--dest-dir", given.folder, unpacked], check=True)


if __name__ == "__main__":
    main()
