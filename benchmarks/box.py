"""What becomes of materials drawn at random under microscopes drawn at random, and how long each takes.

Run as `phasemap bench --box`. Nothing is compared with anything here: what counts is that no material takes long, and
how many end without an answer, and why.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy.regimes import POISSON_RATIO, RESONANCE, Batch
from benchmarks.tables import markdown
from phasemap._kernels import columns as col
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.results.status import Status
from phasemap.solvers.run import run
from phasemap.solvers.solver import March, Orbit, by_name

Array = np.ndarray
Range = tuple[float, float]

MATERIALS, MICROSCOPES = 10_000, 300
LAWS = {"dmt": 0.5, "hertz": 0.25, "jkr": 0.2, "maugis": 0.05}
"""Contact laws, and their shares of the microscopes."""
ORDINARY: dict[str, Range] = {
    "stiffness": (1.0, 60.0), "quality_factor": (50.0, 600.0), "free_amplitude": (1e-8, 8e-8), "radius": (2e-9, 3e-8),
    "decay_length": (2e-10, 5e-10), "frequency_ratio": (1.0, 1.0), "setpoint": (0.4, 0.95),
}  # fmt: skip
WILD: dict[str, Range] = {
    "stiffness": (0.05, 80.0), "quality_factor": (2.0, 2000.0), "free_amplitude": (5e-10, 1.5e-7),
    "radius": (1e-9, 6e-8), "decay_length": (1e-10, 1e-9), "frequency_ratio": (0.9, 1.1), "setpoint": (0.1, 0.97),
}  # fmt: skip
"""Microscopes, of which every second one is wild [N/m, 1, m, m, m, 1, 1]."""
MODULUS, MOST_ADHESION, DAMPING = (1e6, 2e11), 0.3, (1e-4, 0.3)
"""Materials [Pa, J/m2, 1]."""
EVENLY = ("frequency_ratio", "setpoint")  # the others over decades


@dataclass(frozen=True, eq=False)
class Solved:
    """What became of the materials of a batch."""

    batch: Batch
    seconds: Array  # processor time of each material
    status: Array
    irregular: Array  # bool; whether the motion that holds the setpoint is not periodic

    @property
    def law(self) -> str:
        """Name of the contact law."""
        return self.batch.scope.interaction.law.name


def draw(materials: int, microscopes: int, seed: int) -> Iterator[Batch]:
    """Draw materials under microscopes, about as many under each.

    Examples
    --------
    >>> [len(batch) for batch in draw(7, 3, 0)]
    [2, 2, 3]
    """
    rng = np.random.default_rng(seed)
    ends = np.linspace(0, materials, microscopes + 1).astype(int)
    for number in range(microscopes):
        scope, setpoint = _microscope(rng, WILD if number % 2 else ORDINARY)
        some = _materials(rng, ends[number + 1] - ends[number])
        yield Batch(scope, some, setpoint)


def _microscope(rng: np.random.Generator, ranges: dict[str, Range]) -> tuple[Microscope, float]:
    """A microscope, a fifth of them without attraction before contact and two thirds at resonance, and a setpoint."""
    contact = str(rng.choice(list(LAWS), p=list(LAWS.values())))
    v = {}
    for name, (low, high) in ranges.items():
        share = rng.random()
        v[name] = low + share * (high - low) if name in EVENLY else low * (high / low) ** share
    ratio = v["frequency_ratio"] if rng.random() < 1 / 3 else 1.0
    distant = rng.random() < 0.8 or contact == "maugis"
    scope = Microscope(
        Cantilever(v["stiffness"], RESONANCE, v["quality_factor"]),
        Tip(v["radius"]),
        Drive(v["free_amplitude"], ratio * RESONANCE),
        Interaction(contact, v["decay_length"] if distant else None),
    )
    return scope, v["setpoint"]


def _materials(rng: np.random.Generator, count: int) -> Array:
    """Materials; a tenth of them without adhesion, and a tenth without damping."""
    modulus, damping = (low * (high / low) ** rng.random(count) for low, high in (MODULUS, DAMPING))
    adhesion = MOST_ADHESION * rng.random(count)
    adhesion[rng.random(count) < 0.1] = 0.0
    damping[rng.random(count) < 0.1] = 0.0
    return np.stack([modulus, adhesion, damping, np.full(count, POISSON_RATIO)], axis=1)


def solve(batch: Batch, solver: str = "auto") -> Solved:
    """Solve each material of a batch by itself, after what that needs was compiled."""
    method, accuracy = by_name(solver), Accuracy()
    seconds, status = np.zeros(len(batch)), np.zeros(len(batch), np.int8)
    irregular = np.zeros(len(batch), np.bool_)
    for i in range(len(batch)):
        one = Batch(batch.scope, batch.materials[i : i + 1], batch.setpoint).work()
        started = time.process_time()
        rows, codes, _ = run(method, one, accuracy, threads=1)
        seconds[i], status[i] = time.process_time() - started, codes[0]
        irregular[i] = col.is_mean(rows[0])
    return Solved(batch, seconds, status, irregular)


def _compile(batch: Batch) -> None:
    """Compile what materials under this microscope may need: with adhesion and without, in time and not."""
    materials = np.array([[2e9, 0.0, 0.01, POISSON_RATIO], [2e9, 0.01, 0.01, POISSON_RATIO]])
    for solver in (by_name("auto"), Orbit(complete=True), March()):
        run(solver, Batch(batch.scope, materials, batch.setpoint).work(), Accuracy(), threads=1)


def table(
    say: Callable[[str], None], materials: int | None = None, microscopes: int | None = None, seed: int = 1
) -> str:
    """Draw materials and microscopes, solve all, and say how long that took and what became of them.

    Returns a Markdown table with a line a contact law, and the slowest material.
    """
    materials = materials or MATERIALS
    microscopes = microscopes or min(MICROSCOPES, materials)
    found: list[Solved] = []
    known: set[str] = set()
    for number, batch in enumerate(draw(materials, microscopes, seed), start=1):
        say(f"box: {number} of {microscopes} microscopes")
        if (law := batch.scope.interaction.law.name) not in known:
            known.add(law)
            _compile(batch)
        found.append(solve(batch))
    heads = ("contact", "microscopes", "materials", "mean [ms]", "slowest [ms]", "irregular", "status")
    lines = [_line(law, [one for one in found if one.law == law]) for law in LAWS if law in known]
    return f"{markdown(heads, [*lines, _line('all', found)])}\n\n{_slowest(found)}"


def _line(name: str, found: list[Solved]) -> list[str]:
    seconds, status, irregular = (
        np.concatenate([getattr(one, of) for one in found]) for of in ("seconds", "status", "irregular")
    )
    codes, counts = np.unique(status, return_counts=True)
    order = np.argsort(-counts)
    shares = ", ".join(f"{Status.of(codes[i]).name} {100 * counts[i] / len(status):.2f} %" for i in order)
    return [
        name, str(len(found)), str(len(status)), f"{1e3 * seconds.mean():.3g}", f"{1e3 * seconds.max():.3g}",
        f"{100 * irregular.mean():.2f} %", shares,
    ]  # fmt: skip


def _slowest(found: list[Solved]) -> str:
    one = max(found, key=lambda solved: solved.seconds.max(initial=0.0))
    i = int(one.seconds.argmax())
    return f"Slowest, {1e3 * one.seconds[i]:.3g} ms, {Status.of(one.status[i]).name}: {describe(one.batch, i)}"


def describe(batch: Batch, index: int) -> str:
    """A material, its microscope and the setpoint, as Python makes them."""
    modulus, adhesion, damping, poisson_ratio = map(float, batch.materials[index])
    scope = batch.scope
    interaction = scope.interaction
    return (
        f"Material({modulus!r}, {adhesion!r}, {damping!r}, poisson_ratio={poisson_ratio!r}) under "
        f"Microscope(Cantilever({scope.cantilever.stiffness!r}, {RESONANCE!r}, {scope.cantilever.quality_factor!r}), "
        f"Tip({scope.tip.radius!r}), Drive({scope.drive.free_amplitude!r}, {scope.drive.frequency!r}), "
        f"Interaction({interaction.contact!r}, {interaction.decay_length!r})) at setpoint {batch.setpoint!r}"
    )
