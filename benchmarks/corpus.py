"""The fixed corpus that `compare` solves with two versions of the package, as plain numbers.

Every case is drawn from a seed that never changes, or named; nothing here depends on the kernels that are compared.
"""

from __future__ import annotations

import json
import pathlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks import box
from benchmarks.accuracy.regimes import REGIMES, Batch, Image, Ranges, Regime
from benchmarks.accuracy.regimes import draw as draw_regime
from benchmarks.hard_cases import CASES
from phasemap.experiment.interaction import MaugisDugdale, Neck
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope

Task = dict[str, Any]

DATA = pathlib.Path(__file__).parents[1] / "tests" / "data"
SEED = 20260501
MATERIALS, PER_MICROSCOPE = 2400, 40  # of each regime, and under each of its microscopes
FEWER = {"bistable": 800}  # of which each draw asks for all orbits of a material, 30 ms
BOX_MATERIALS, BOX_MICROSCOPES = 5000, 150
CURVES = {"distance": 60, "setpoint": 20, "frequency": 20}


@dataclass(frozen=True)
class Block:
    """Tasks whose answers and times stand in one line of the table."""

    name: str
    tasks: list[Task]

    def __len__(self) -> int:
        return sum(_pixels(task) for task in self.tasks)


def _pixels(task: Task) -> int:
    """How many pixels a task solves; a curve counts as one."""
    return int(np.broadcast(*task["maps"].values()).size) if task["kind"] == "image" else 1


def corpus(share: float = 1.0) -> Iterator[Block]:
    """Draw the corpus.

    `share`: of each block, for a short comparison; 1 is the whole corpus.
    """
    for regime in REGIMES:
        yield Block(regime.name, regime_tasks(regime, share))
    yield Block("whole box", box_tasks(share))
    yield Block("named hard cases", _some(hard_tasks(), share))
    yield Block("irregular JKR", _some(irregular_tasks(), share))
    yield Block("laws, base drive, memory", _some(list(law_tasks()), max(share, 0.5)))
    yield Block("curves and folds", list(curve_tasks(share)))
    yield Block("every orbit", _some(list(orbit_tasks()), share))
    yield Block("images and scans", list(scan_tasks(16 if share < 1 else 128)))


def _some(tasks: Sequence[Task], share: float) -> list[Task]:
    """An evenly spread share of tasks, at least one."""
    wanted = max(1, round(share * len(tasks)))
    return [tasks[i] for i in np.linspace(0, len(tasks) - 1, wanted).round().astype(int)]


# Objects as plain numbers


def plain_microscope(scope: Microscope) -> Task:
    """Describe a microscope by plain numbers."""
    lever, tip, drive, law = scope.cantilever, scope.tip, scope.drive, scope.interaction
    contact: Any = law.contact
    if isinstance(contact, Neck | MaugisDugdale):
        contact = (type(contact).__name__, contact.length if isinstance(contact, Neck) else contact.range)
    return {
        "cantilever": (lever.stiffness, lever.resonance_frequency, lever.quality_factor),
        "tip": (tip.radius, tip.modulus, tip.poisson_ratio),
        "drive": {"free_amplitude": drive.free_amplitude, "frequency": drive.frequency, "excitation": drive.excitation},
        "interaction": {
            "contact": contact,
            "decay_length": law.decay_length,
            "damping_exponent": law.damping_exponent,
            "withdrawal": law.withdrawal,
        },
    }


def _maps(materials: np.ndarray) -> Task:
    return dict(zip(("modulus", "adhesion", "damping", "poisson_ratio"), materials.T, strict=True))


def _image(batch: Batch, **more: Any) -> Task:
    return {
        "kind": "image",
        "scope": plain_microscope(batch.scope),
        "maps": _maps(batch.materials),
        "setpoint": batch.setpoint,
        **more,
    }


def _one(material: Material) -> Task:
    return {name: getattr(material, name) for name in ("modulus", "adhesion", "damping", "poisson_ratio")}


# Blocks


def batches(regime: Regime, share: float, seed: int = SEED) -> tuple[Batch, ...]:
    """Draw microscopes of a regime, and materials under each."""
    count = round(share * FEWER.get(regime.name, MATERIALS))
    under_each = min(PER_MICROSCOPE, max(4, count // 6))
    few = 1 if isinstance(regime, Image) else max(1, count // under_each)
    return draw_regime(regime, few, count // few, np.random.default_rng(seed))


def regime_tasks(regime: Regime, share: float) -> list[Task]:
    """Materials of a regime, every second microscope also with exact orbits asked for by name."""
    drawn = batches(regime, share)
    return [_image(batch) for batch in drawn] + [_image(batch, solver="orbit") for batch in drawn[1::2]]


def box_tasks(share: float) -> list[Task]:
    """Materials drawn at random under microscopes drawn at random, in a wide box."""
    drawn = box.draw(round(share * BOX_MATERIALS), max(4, round(share * BOX_MICROSCOPES)), SEED)
    return [_image(batch) for batch in drawn]


def hard_tasks() -> list[Task]:
    """The named hard cases."""
    return [
        {
            "kind": "image",
            "scope": plain_microscope(case.scope),
            "maps": {name: [value] for name, value in _one(case.material).items()},
            "setpoint": case.setpoint,
        }
        for case in CASES
    ]


def irregular_tasks() -> list[Task]:
    """Sticky soft samples on which the motion is not periodic."""
    tasks = []
    for case in json.loads((DATA / "irregular.json").read_text()):
        scope = {
            "cantilever": (case["stiffness"], case["resonance_frequency"], case["quality_factor"]),
            "tip": (case["tip_radius"],),
            "drive": {"free_amplitude": case["free_amplitude"]},
            "interaction": {"contact": case["contact"], "decay_length": case["decay_length"]},
        }
        names = ("modulus", "adhesion", "damping", "poisson_ratio")
        maps = {name: [case[name]] for name in names}
        held = [one["setpoint"] for one in case["setpoints"]]
        tasks += [{"kind": "image", "scope": scope, "maps": maps, "setpoint": setpoint} for setpoint in held]
    return tasks


AIR: Task = {
    "cantilever": (40.0, 300e3, 400.0), "tip": (10e-9,), "drive": {"free_amplitude": 30e-9},
    "interaction": {"decay_length": 0.3e-9},
}  # fmt: skip
LIQUID: Task = AIR | {"cantilever": (0.5, 30e3, 3.0), "drive": {"free_amplitude": 10e-9}}
TWO_MODES: Task = AIR | {
    "cantilever": (*AIR["cantilever"], 1.0, 2), "drive": AIR["drive"] | {"second": {"free_amplitude": 0.2e-9}},
}  # fmt: skip


def law_tasks() -> Iterator[Task]:
    """Forty materials under each further law, drive and option."""
    rng = np.random.default_rng(SEED)
    maps = {
        "modulus": np.exp(rng.uniform(np.log(5e7), np.log(5e9), 40)),
        "adhesion": rng.uniform(0.0, 0.1, 40),
        "damping": np.exp(rng.uniform(np.log(1e-3), np.log(0.1), 40)),
    }
    relaxing = {"modulus": maps["modulus"], "adhesion": maps["adhesion"], "relaxed_modulus": 0.5 * maps["modulus"]}
    plain = {"kind": "image", "scope": AIR, "maps": maps, "setpoint": 0.7}
    laws: tuple[Any, ...] = ("hertz", "jkr", "maugis", ("Neck", 1e-9), ("MaugisDugdale", 0.4e-9))
    for contact in laws:
        yield plain | {"scope": AIR | {"interaction": {"contact": contact, "decay_length": 0.3e-9}}}
    yield plain | {"scope": AIR | {"interaction": {"withdrawal": "ting"}}}
    yield plain | {"maps": relaxing | {"relaxation_time": np.full(40, 1e-7)}}
    for scope, frequency in ((AIR, None), (AIR, 299e3), (LIQUID, None)):
        drive = scope["drive"] | {"excitation": "base", "frequency": frequency}
        adhesion = maps["adhesion"] if scope is AIR else np.full(40, 1e-3)
        mass = {"cantilever": (*scope["cantilever"], 1.0)}  # a participation of 1
        yield plain | {"scope": scope | mass | {"drive": drive}, "maps": maps | {"adhesion": adhesion}}
    yield plain | {"scope": TWO_MODES, "variables": ["mode2_frequency_shift"]}
    for solver in ("averaging", "march"):
        yield plain | {"solver": solver}


def curve_tasks(share: float) -> Iterator[Task]:
    """Curves of materials of three regimes and of JKR contacts, with folds and jumps."""
    for number, (sweep, count) in enumerate(CURVES.items()):
        wanted = max(3, round(share * count))
        for index in range(wanted):
            regime = REGIMES[(0, 1, 7, 2)[index % 4]]
            (batch,) = batches_of_one(regime, SEED + 1000 * number + index)
            lever, free = batch.scope.cantilever, batch.scope.drive.free_amplitude
            options: Task = {}
            if sweep == "distance":
                axis = np.linspace(1.3, 0.3, 41) * free
            elif sweep == "setpoint":
                axis = np.linspace(0.95, 0.35, 25)
            else:
                axis = lever.resonance_frequency * (1 + np.linspace(-3, 3, 41) / lever.quality_factor)
                options = {"tip_offset": 0.75 * free}
            scope = plain_microscope(batch.scope)
            if sweep == "distance" and index % 10 == 9:
                scope["interaction"]["contact"] = "jkr"
            material = {name: float(values[0]) for name, values in _maps(batch.materials).items()}
            yield {
                "kind": "curve", "sweep": sweep, "scope": scope, "material": material, "axis": axis, "options": options
            }  # fmt: skip


def batches_of_one(regime: Regime, seed: int) -> tuple[Batch, ...]:
    """One material under one microscope of a regime."""
    assert isinstance(regime, Ranges | Image)
    return draw_regime(regime, 1, 1, np.random.default_rng(seed))


def orbit_tasks() -> Iterator[Task]:
    """Materials of which every orbit at a setpoint is asked for."""
    for index in range(120):
        (batch,) = batches_of_one(REGIMES[(0, 1, 2, 3)[index % 4]], SEED + index)
        material = {name: float(values[0]) for name, values in _maps(batch.materials).items()}
        yield {
            "kind": "orbits", "scope": plain_microscope(batch.scope), "material": material, "setpoint": batch.setpoint
        }  # fmt: skip


def scan_tasks(side: int) -> Iterator[Task]:
    """Images with neighbours: interpolated maps, a raster over a bistable sample, lines scanned in time."""
    (blend,) = (regime for regime in REGIMES if isinstance(regime, Image))
    surface = blend.surface(np.random.default_rng(SEED))
    maps = {
        name: np.array(getattr(surface, name))[:side, :side]
        for name in ("modulus", "adhesion", "damping", "poisson_ratio")
    }
    mixed = {"kind": "image", "scope": plain_microscope(blend.scope), "maps": maps, "setpoint": blend.setpoint}
    yield mixed
    yield mixed | {"scope": LIQUID, "setpoint": 0.8, "maps": maps | {"adhesion": 0.02 * maps["adhesion"]}}
    bistable = AIR | {"drive": {"free_amplitude": 20e-9}}
    sticky = maps | {"adhesion": 1.5 * maps["adhesion"]}
    yield mixed | {"scope": bistable, "maps": sticky, "setpoint": 0.8}
    yield mixed | {"scope": bistable, "maps": _lines(sticky, 8), "setpoint": 0.8, "control": ("Raster", {})}
    usual = AIR | {"drive": {"free_amplitude": 40e-9}}
    stripes = np.where(np.arange(48) // 12 % 2, 1.0, 3.0)
    line = {"modulus": 1e9 * stripes, "adhesion": 0.05 + 0 * stripes, "damping": 0.005 * 4 / (1 + stripes)}
    line["topography"] = 1e-9 * np.sin(4 * np.pi * np.arange(48) / 48)
    for solver in ("averaging", "march"):
        yield {
            "kind": "image", "scope": usual, "maps": line, "setpoint": 0.7, "solver": solver,
            "control": ("Feedback", {"line_rate": 10.0}),
        }  # fmt: skip


def _lines(maps: Task, count: int) -> Task:
    """The first lines of maps."""
    return {name: values[:count] for name, values in maps.items()}
