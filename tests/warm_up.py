"""Compiles what most tests need, before any of them: `python tests/warm_up.py at_rest` and `... in_time`.

What is compiled here, all test processes load. No kernel may be compiled twice for arguments that differ in nothing but
how they were written.
"""

from __future__ import annotations

import sys

import numpy as np

import phasemap as pm
from phasemap._kernels.compilation import compiled_more_than_once

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
TWO = pm.Surface(modulus=2e9, adhesion=np.repeat([[0.02, 0.1]], 2, axis=0), damping=0.01, pixel_size=2e-9)


def at_rest() -> None:
    """Images of tips at rest, interpolated ones too, and every orbit."""
    for control in (pm.Engage(), pm.Raster()):
        for solver in ("auto", "averaging", "orbit"):
            pm.simulate(TWO, SCOPE, 0.8, solver, control)
    many = np.linspace(1e9, 3e9, 10_000).reshape(100, 100)
    pm.simulate(pm.Surface(many, adhesion=0.02, pixel_size=2e-9), SCOPE, 0.8)
    pm.orbits(pm.Material(2e9, 0.1), SCOPE, setpoint=0.8)


def in_time() -> None:
    """The march, and scans by both engines."""
    pm.simulate(TWO, SCOPE, 0.8, "march")
    for solver in ("averaging", "march"):
        pm.simulate(TWO, SCOPE, 0.8, solver, pm.Feedback(line_rate=50.0))


if __name__ == "__main__":
    {"at_rest": at_rest, "in_time": in_time}[sys.argv[1]]()
    if several := compiled_more_than_once():
        sys.exit(f"kernels that are compiled more than once: {several}")
