"""Compile kernels to WebAssembly, from the sources that numba compiles in Python.

    python tools/browser/kernels.py FOLDER

writes ``kernels.wasm``, and ``kernels.json`` with what each entry takes and returns and the formulas of contact laws.
The LLVM code of each entry is taken before it is optimised, for what is optimised has offsets of another processor; it
gets the layout of WebAssembly, and is linked by ``wasm-ld`` (Debian's package lld). Entries, and the types that they
are compiled for, are found by solving one case of each kind.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

import llvm_code  # before numba
import llvmlite.binding as llvm

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+simd128,+bulk-memory,+nontrapping-fptoint,+sign-ext"
LINKERS = ("wasm-ld", "wasm-ld-19", "wasm-ld-16", "wasm-ld-14")
STACK = 1 << 20  # bytes; records of kernels lie there, of at most 128 kB each


def linker() -> str | None:
    """Path of the linker of WebAssembly; None without one."""
    return next(filter(None, map(shutil.which, LINKERS)), None)


def object_file(modules: list[llvm_code.Module], symbols: set[str]) -> bytes:
    """All modules as one object file, from which these symbols are seen."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(opt=3, reloc="static", features=FEATURES)
    whole = llvm.parse_assembly("")
    for one in modules:
        text = one.for_target(TRIPLE, str(machine.target_data))
        text = re.sub("^define private ", "define linkonce_odr ", text, flags=re.M)  # shared functions, once for all
        whole.link_in(llvm.parse_assembly(text))
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
    modules = llvm_code.take_modules(llvm_code.solve_one_of_each_kind)
    named, table = llvm_code.formulas(), {name: one for name, (*_, one) in llvm_code.entries().items()}
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
