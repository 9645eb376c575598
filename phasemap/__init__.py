"""Synthetic phase images for tapping-mode atomic force microscopy.

Names are imported when they are first used, so that ``import phasemap`` costs nothing; ``__init__.pyi`` lists them.
"""

from __future__ import annotations

import importlib
from typing import Any

with open(f"{__path__[0]}/__init__.pyi", encoding="utf-8") as _stub:
    _words = (line.split() for line in _stub if line.startswith("from "))  # from MODULE import NAME as NAME
    _MODULES = {name: module for _, module, _, name, *_ in _words}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("afm-phasemap")
    if name not in _MODULES:
        raise AttributeError(f"module 'phasemap' has no attribute {name!r}")
    module = importlib.import_module(_MODULES[name])
    return vars(module).get(name) or importlib.import_module(f"{_MODULES[name]}.{name}")


def __dir__() -> list[str]:
    return __all__
