"""Compiles what most tests need, before any of them: `python tests/warm_up.py 0 FILE` and `... 1 FILE`, side by side.

What is compiled here, all test processes load. No kernel may be compiled twice for arguments that differ in nothing but
how they were written. What was computed meanwhile goes into the file, bit by bit: tests/_kernels/test_compilation.py
asks whether a process that loads finds the same.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bits import bits

import phasemap as pm
from phasemap._kernels.compilation import compiled_more_than_once
from phasemap.validation.kinds_of_work import ALL, KINDS, MATERIAL, SCOPE


def _stiff_in_liquid() -> None:
    """Newton's method on the response."""
    pm.solve_pixel(pm.Material(1e10), pm.Microscope(pm.Cantilever(1.0, 300e3, 3.0), SCOPE.tip, SCOPE.drive), 0.8)


def _far_below_resonance() -> None:
    """Engaging in time, and collocation beside the orbit on which it ends."""
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, pm.Drive(16e-9, frequency=270e3))
    pm.solve_pixel(MATERIAL, scope, 0.8, "orbit")


FURTHER = ((_stiff_in_liquid,), (_far_below_resonance,))
"""What tests of both processes need and no kind of work does."""

if __name__ == "__main__":
    part = int(sys.argv[1])
    found = {kind: bits(KINDS[kind]()) for kind in ALL[part]}
    for work in FURTHER[part]:
        work()
    if several := compiled_more_than_once():
        sys.exit(f"kernels that are compiled more than once: {several}")
    Path(sys.argv[2]).write_text(json.dumps(found))
