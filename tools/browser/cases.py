"""Cases that Python solves as it is installed, and as the page has it: ``answers`` is called in both."""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap.explorer import routes
from phasemap.explorer.setting import Setting
from phasemap.explorer.subject import Subject
from phasemap.solvers.problem import make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

COUNT = 5000  # materials
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
LOW, HIGH = (0.1e9, 0.02, 0.001, 0.3), (10e9, 0.1, 0.02, 0.3)  # modulus, adhesion, damping, Poisson's ratio
LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
RELAXES = ("damping", 0.0), ("relaxed_modulus", 0.1e9), ("relaxation_time", 1e-6)
WATER = ("environment", "water"), ("length", 125e-6), ("width", 30e-6), ("modes", 2)
MESSAGES = (
    ("picture", "step", {}), ("picture", "bistable", {"exact": True}), ("picture", "copolymer", {}),
    ("picture", "step", {"changes": {"interaction.contact": "maugis"}}),
    ("picture", "step", {"changes": {"interaction.contact": "capillary"}}),
    ("picture", "step", {"changes": {"drive.excitation": "base", "cantilever.modes": 2}}),
    ("picture", "step", {"changes": {"drive.second.free_amplitude": 2e-10, "cantilever.modes": 2}}),
    ("picture", "step", {"changes": {"interaction.bias": 2.0, "cantilever.quality_factor": 5.0}}),
    ("picture", "step", {"changes": {"interaction.withdrawal": "ting"}}),
    ("picture", "step", {"changes": {f"materials.{i}.{key}": value for i in (0, 1) for key, value in RELAXES}}),
    ("picture", "step", {"changes": {"materials.0.relaxation": "PIB", "materials.0.damping": 0.0}}),
    ("picture", "step", {"changes": {f"cantilever.{key}": value for key, value in WATER}}),
    ("curves", "bistable", {}), ("save/scene", "blend", {"changes": {"tip.radius": 2e-8}}),
)  # fmt: skip


def answers(subject: Any) -> dict[str, Any]:
    """Every answer as JSON has it. `subject`: gives the sample of a name."""
    return {
        "solved": solved(),
        "curves": {law: curve(law) for law in ("dmt", "jkr")},
        "pages": [answered(route, subject(name), message) for route, name, message in MESSAGES],
    }


def solved() -> list[list[float]]:
    """Status, tip offset [m] and phase [degree] of materials that fill the box from LOW to HIGH evenly."""
    scope = pm.Microscope(LEVER, TIP, pm.Drive(30e-9))
    shares = [[(1 + i) * GOLDEN ** (1 + j) % 1.0 for j in range(5)] for i in range(COUNT)]
    rows = [[a * (b / a) ** x for a, b, x in zip(LOW, HIGH, share, strict=False)] for share in shares]
    setpoints = np.array([0.4 + 0.5 * share[4] for share in shares])
    work = make_work(np.array(rows), False, scope, setpoints * scope.driven_amplitude)
    found, status, _ = run(by_name("auto"), work, pm.Accuracy(), threads=1)
    columns = status, found[:, col.TIP_OFFSET], np.degrees(found[:, col.PHASE])
    return [column.tolist() for column in columns]


def curve(law: str) -> dict[str, list[float]]:
    """The whole curve of a bistable material, and what approach and retract see of it."""
    scope = pm.Microscope(LEVER, TIP, pm.Drive(16e-9), pm.Interaction(law))
    ds = pm.sweep_distance(pm.Material(2e9, 0.1, damping=0.003), scope, np.linspace(20e-9, 4e-9, 17), samples=64)
    names = "curve_phase", "curve_amplitude", "curve_piece", "phase", "trace_force", "jump_from_phase"
    return {name: ds[name].values.reshape(-1).tolist() for name in names}


def answered(route: str, subject: Subject, message: dict[str, Any]) -> str:
    """The bytes that the page gets."""
    return base64.b64encode(routes.answers()[route](Setting.of(subject, message))[1]).decode()


def said(subject: Any) -> str:
    """All answers in one line."""
    return json.dumps(answers(subject))
