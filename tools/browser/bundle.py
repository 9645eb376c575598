"""The Python of the page: the package without what it never asks, and its kernels as calls into WebAssembly.

`modules` gives the sources by their paths; docstrings and comments stay behind. Of a module of kernels there is what
the rest of the package imports: numbers, named tuples, functions that Python runs as they are, and entries.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

import phasemap
from phasemap._kernels.compilation import entries as compilation

PACKAGE = Path(phasemap.__file__).parent
HERE = Path(__file__).parent / "python"
FOLDERS = ("_shared", "experiment", "explorer", "imaging", "io", "plot", "results", "scenes", "solvers", "sweeps")
KERNELS = "phasemap._kernels"
VERBATIM = ("columns", "forces")
OWN = ("law", "compilation", "orbits.time.march")  # modules of kernels that are written anew in the folder python
IMPORTS = f"""from __future__ import annotations
import math
from typing import Any, NamedTuple
import numpy as np
from {KERNELS} import columns as col
import compiled
"""


def modules() -> dict[str, str]:
    """Sources by their paths."""
    found = {f"phasemap/{name}": bare((PACKAGE / name).read_text()) for name in ("__init__.py", "__init__.pyi")}
    for folder in FOLDERS:
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            found[f"phasemap/{path.relative_to(PACKAGE)}"] = bare(path.read_text())
    found |= {
        f"phasemap/{name}": (PACKAGE / name).read_text()
        for name in ("explorer/page/knobs.json", "experiment/presets.toml", "experiment/spectra.toml")
    }
    found |= {str(path.relative_to(HERE)): bare(path.read_text()) for path in HERE.rglob("*.py")}
    return found | kernels(imported(found))


def bare(source: str) -> str:
    """A source without docstrings, comments and what is for type checkers only."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            body = node.body
            if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
                del body[0]
            node.body = body or [ast.Pass()]
    return ast.unparse(tree)


def imported(sources: dict[str, str]) -> set[tuple[str, str]]:
    """What modules of the package import of kernels: (module, name)."""
    found = set()
    for source in sources.values():
        for node in ast.walk(ast.parse(source)) if KERNELS in source else ():
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{KERNELS}."):
                within = vars(importlib.import_module(node.module or ""))
                found |= {
                    (node.module or "", one.name) for one in node.names if not isinstance(within[one.name], ModuleType)
                }
    return found


def kernels(wanted: set[tuple[str, str]]) -> dict[str, str]:
    """Sources of the modules of kernels, with what is wanted of them and what that needs."""
    parts: dict[str, dict[str, str]] = {}
    waiting = sorted(wanted)
    while waiting:
        module, name = waiting.pop()
        short = module.removeprefix(f"{KERNELS}.")
        if short in VERBATIM or short in OWN or name in parts.setdefault(module, {}):
            continue
        parts[module][name] = ""  # against circles
        text, needs = written(importlib.import_module(module), name)
        parts[module].pop(name)
        parts[module][name] = text
        waiting += needs
        for other, needed in needs:  # in the order in which they are needed
            if other == module and needed in parts[module]:
                parts[module] = {needed: parts[module].pop(needed), **parts[module]}
    found = {
        f"{name.replace('.', '/')}/__init__.py": ""
        for name in {".".join(one.split(".")[:n]) for one in parts for n in range(2, len(one.split(".")))}
    }
    for short in VERBATIM:
        found[f"{KERNELS.replace('.', '/')}/{short.replace('.', '/')}.py"] = bare(
            (PACKAGE / "_kernels" / f"{short.replace('.', '/')}.py").read_text()
        )
    for module, names in parts.items():
        needs = {
            (other, name)
            for one in names
            for other, name in written(importlib.import_module(module), one)[1]
            if other != module
        }
        lines = [f"from {other} import {name}" for other, name in sorted(needs)]
        order = sorted(names, key=lambda one: "def " in names[one] or "class " in names[one])
        found[f"{module.replace('.', '/')}.py"] = IMPORTS + "\n".join([*lines, *(names[one] for one in order)])
    return found


def written(module: ModuleType, name: str) -> tuple[str, list[tuple[str, str]]]:
    """A name of a module of kernels as the page has it, and what it needs of such modules."""
    value = getattr(module, name)
    if isinstance(value, compilation._Light):
        source = textwrap.dedent(inspect.getsource(value.py_func))
        return bare(source[source.index("def ") :]), needs_of(value.py_func, module)
    if isinstance(value, compilation._Entry):
        short = f"{module.__name__.removeprefix(f'{KERNELS}.')}.{name}"
        return f"{name} = compiled.entry({short!r})", []
    if hasattr(value, "record_words"):
        return f"{name} = lambda: compiled.Record({value.record_words})", []
    if isinstance(value, type):
        source = re.sub(r"^class .*?:\n", lambda line: line[0], inspect.getsource(value))
        return bare(source), []
    if isinstance(value, FunctionType) and value.__qualname__.startswith("rows_of."):
        held = inspect.getclosurevars(value).nonlocals
        first = {one: place for one, (_, place, _) in held["made"].record_fields.items()}
        return f"{name} = compiled.rows_of({held['field']!r}, {first!r})", []
    if isinstance(value, FunctionType):
        return bare(textwrap.dedent(inspect.getsource(value))), needs_of(value, module)
    if isinstance(value, np.ndarray):
        if value.size > 1000:
            return f"{name} = compiled.table({value.shape!r})", []
        return f"{name} = np.array({value.tolist()!r})", []
    return f"{name} = {value!r}", []


def needs_of(function: Any, module: ModuleType) -> list[tuple[str, str]]:
    """What a function needs of modules of kernels."""
    found = []
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if name in ("col", "np", "math", "Any") or value is None:
            continue
        home = getattr(getattr(value, "py_func", value), "__module__", None) or module.__name__
        own = name if hasattr(importlib.import_module(home), name) else None
        if own and home.startswith(f"{KERNELS}."):
            found.append((home, own))
        elif isinstance(value, (int, float, str, tuple)):
            found.append((module.__name__, name))
    return found
