"""Where cases come from: named regimes, each a rule by which microscopes and materials are drawn at random.

Nothing can be tuned to a case that is not known before the seed is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from benchmarks.accuracy.bistable import end_of_attraction, is_bistable
from benchmarks.accuracy.equation import Case, Equation
from phasemap.experiment import generate
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.experiment.surface import Surface
from phasemap.solvers.problem import Work, make_work

Array = np.ndarray
Range = tuple[float, float]

RESONANCE = 300e3  # [Hz]; only ratios to it matter
POISSON_RATIO = 0.35
SIMILAR = 2  # stiffnesses and dampings in a batch of `Border`
BESIDE = (1e-3, 3e-2)  # distance of its pixels from the border, over its adhesion, which theory knows to a percent
MOST_DRAWS = 50  # times as many candidates as cases are asked for, after which a regime is given up


@dataclass(frozen=True, eq=False)
class Batch:
    """Distinct materials under one microscope, as an image gives them."""

    scope: Microscope
    materials: Array  # shape (n, 4); Modulus [Pa], adhesion [J/m2], damping [1], Poisson's ratio [1]
    setpoint: float

    def __len__(self) -> int:
        return len(self.materials)

    def work(self) -> Work:
        """What solvers take."""
        amplitudes = np.full(len(self), self.setpoint * self.scope.driven_amplitude)
        return make_work(self.materials, False, self.scope, amplitudes)

    def case(self, index: int) -> Case:
        """One pixel as the reference and the peers take it."""
        lever, interaction = self.scope.cantilever, self.scope.interaction
        modulus, adhesion, damping, poisson_ratio = map(float, self.materials[index])
        return Case(
            stiffness=lever.stiffness,
            quality_factor=lever.quality_factor,
            free_amplitude=self.scope.drive.free_amplitude,
            radius=self.scope.tip.radius,
            modulus=modulus,
            adhesion=adhesion,
            damping=damping,
            poisson_ratio=poisson_ratio,
            setpoint=self.setpoint,
            decay_length=interaction.decay_length,
            frequency_ratio=self.scope.frequency_ratio,
            damping_exponent=interaction.damping_exponent,
            contact=interaction.law.name,
        )


class Regime(Protocol):
    """What a regime offers."""

    @property
    def name(self) -> str:
        """Heading of its panel and of its column."""
        ...

    def draw(self, pixels: int, rng: np.random.Generator) -> Batch:
        """Draw a microscope, and this many materials under it."""
        ...


@dataclass(frozen=True)
class Ranges:
    """Ranges from which a case is drawn: logarithmic for what spans decades, uniform for radius, setpoint, d0."""

    name: str
    # stiffness, quality_factor, free_amplitude, radius: of the microscope [N/m, 1, m, m]
    stiffness: Range
    quality_factor: Range
    free_amplitude: Range
    radius: Range
    # modulus, adhesion, damping: of the material [Pa, J/m2, 1]; one material in five has no adhesion, one in five
    # no damping
    modulus: Range
    adhesion: Range
    damping: Range
    # decay_length, setpoint: [m, 1]
    decay_length: Range = (0.15e-9, 0.5e-9)
    setpoint: Range = (0.4, 0.95)
    # Drive over resonance frequency, of which a microscope takes one; the free amplitude is that at the drive
    ratios: tuple[float, ...] = (1.0,)
    # Whether only materials are kept on which there are an attractive and a repulsive orbit at the setpoint
    bistable: bool = False

    def draw(self, pixels: int, rng: np.random.Generator) -> Batch:
        """See `Regime`."""
        for _ in range(MOST_DRAWS):
            batch = self._draw(16 if self.bistable else pixels, rng)
            if not self.bistable:
                return batch
            kept: list[Array] = []
            for _ in range(MOST_DRAWS):
                both = [is_bistable(Equation.of(batch.case(i))) for i in range(len(batch))]
                kept += list(batch.materials[both])
                if len(kept) >= pixels:
                    return Batch(batch.scope, np.array(kept[:pixels]), batch.setpoint)
                if sum(both) < len(both) / 3:  # a microscope under which few materials are bistable
                    break
                batch = Batch(batch.scope, self._materials(16, rng), batch.setpoint)
        raise RuntimeError(f"no cases in the regime {self.name!r}")  # the ranges above are such that there are many

    def _draw(self, pixels: int, rng: np.random.Generator) -> Batch:
        stiffness, quality = _between(rng, self.stiffness), _between(rng, self.quality_factor)
        tip, amplitude = Tip(rng.uniform(*self.radius)), _between(rng, self.free_amplitude)
        interaction = Interaction(decay_length=rng.uniform(*self.decay_length))
        drive = Drive(amplitude)
        if self.ratios != (1.0,):
            ratio = float(rng.choice(self.ratios))
            drive = Drive(amplitude * quality * math.hypot(1 - ratio**2, ratio / quality), ratio * RESONANCE)
        scope = Microscope(Cantilever(stiffness, RESONANCE, quality), tip, drive, interaction)
        return Batch(scope, self._materials(pixels, rng), rng.uniform(*self.setpoint))

    def _materials(self, count: int, rng: np.random.Generator) -> Array:
        return np.column_stack(
            [
                _spread(rng, self.modulus, count),
                _spread(rng, self.adhesion, count) * (rng.random(count) > 0.2),
                _spread(rng, self.damping, count) * (rng.random(count) > 0.2),
                np.full(count, POISSON_RATIO),
            ]
        )


@dataclass(frozen=True)
class Image:
    """Pixels of an image: a polymer blend with diffuse interfaces, the modulus of each part varying by a tenth."""

    name: str
    scope: Microscope
    # first, second: the parts
    first: Material
    second: Material
    setpoint: float = 0.7

    def draw(self, pixels: int, rng: np.random.Generator) -> Batch:
        """See `Regime`."""
        distinct = self.surface(rng).unique()[0]
        return Batch(self.scope, distinct[rng.choice(len(distinct), pixels, replace=False)], self.setpoint)

    def surface(self, rng: np.random.Generator) -> Surface:
        """A whole image, 128 x 128 pixels of 4 nm."""
        from scipy.ndimage import gaussian_filter

        shape, pitch, seed = (128, 128), 4e-9, int(rng.integers(2**31))
        labels = generate.blend(shape, pitch, spacing=160e-9, fraction=0.45, seed=seed)
        part = np.clip(gaussian_filter(labels.astype(float), 2.0, mode="wrap"), 0, 1)
        uneven = generate.roughness(shape, pitch, rms=0.1, correlation_length=60e-9, seed=seed)

        def mixed(a: float, b: float) -> Array:
            return np.asarray(a ** (1 - part) * b**part)

        return Surface(
            modulus=mixed(self.first.modulus, self.second.modulus) * np.exp(uneven),
            adhesion=mixed(self.first.adhesion, self.second.adhesion),
            damping=mixed(self.first.damping or 0.0, self.second.damping or 0.0),
            poisson_ratio=(1 - part) * self.first.poisson_ratio + part * self.second.poisson_ratio,
            pixel_size=pitch,
        )


@dataclass(frozen=True)
class Border:
    """Pixels beside the end of the attractive branch, some on either side of it: where an image changes its branch.

    Parameters
    ----------
    ranges : Ranges
        From which microscopes, stiffness and damping are drawn; the adhesion follows.
    """

    ranges: Ranges

    @property
    def name(self) -> str:
        """See `Regime`."""
        return self.ranges.name

    def draw(self, pixels: int, rng: np.random.Generator) -> Batch:
        """See `Regime`."""
        for _ in range(MOST_DRAWS):
            batch = self.ranges.draw(SIMILAR, rng)
            ends = [end_of_attraction(batch.case(i)) for i in range(SIMILAR)]
            known = [i for i in range(SIMILAR) if ends[i] is not None]
            if not known:
                continue
            chosen = np.array(known)[np.arange(pixels) % len(known)]
            beside = np.where(rng.random(pixels) < 0.5, -1, 1) * _spread(rng, BESIDE, pixels)
            materials = batch.materials[chosen]
            materials[:, 1] = np.array(ends, np.float64)[chosen] * (1 + beside)
            return Batch(batch.scope, materials, batch.setpoint)
        raise RuntimeError(f"no cases in the regime {self.name!r}")  # the ranges above are such that there are many


REGIMES: tuple[Regime, ...] = (
    Ranges("air, hard sample", (20, 50), (200, 850), (1e-8, 1e-7), (5e-9, 2e-8), (2e9, 3e11), (0.02, 0.5), (1e-4, 0.1)),
    Ranges("air, soft sample", (5, 50), (150, 600), (2e-8, 1e-7), (8e-9, 30e-9), (1e7, 1e9), (0.005, 0.1), (3e-3, 0.2)),
    Ranges("soft lever", (1, 4), (60, 200), (15e-9, 60e-9), (8e-9, 20e-9), (5e7, 3e9), (0.01, 0.1), (1e-3, 0.1)),
    Ranges("low-Q liquid", (0.3, 2), (2, 8), (5e-9, 15e-9), (10e-9, 40e-9), (1e7, 3e8), (1e-4, 5e-3), (1e-3, 0.2)),
    Ranges("high-Q vacuum", (25, 50), (5e3, 5e4), (6e-9, 5e-8), (1e-8, 3e-8), (3e8, 2e10), (5e-3, 0.1), (1e-3, 0.05)),
    Ranges(
        "bistable", (20, 50), (200, 600), (1e-8, 4e-8), (8e-9, 25e-9), (1e9, 5e10), (0.02, 0.3), (5e-4, 0.02),
        setpoint=(0.5, 0.9), bistable=True,
    ),
    Ranges(
        "beside resonance", (20, 50), (150, 600), (1e-8, 6e-8), (5e-9, 2e-8), (3e8, 2e10), (0.01, 0.1), (1e-3, 0.05),
        ratios=(0.9, 0.999, 1.001, 1.1),
    ),
    Image(  # that of samples/blend.toml
        "mixed image",
        Microscope(Cantilever(40.0, RESONANCE, 400.0), Tip(10e-9), Drive(40e-9), Interaction(decay_length=0.3e-9)),
        Material(3.0e9, adhesion=0.07, damping=0.004, poisson_ratio=0.35),
        Material(0.2e9, adhesion=0.06, damping=0.03, poisson_ratio=0.45),
    ),
    Border(
        Ranges(
            "beside a border", (20, 50), (200, 600), (1e-8, 3e-8), (8e-9, 25e-9), (5e8, 2e10), (0.02, 0.3),
            (1e-3, 0.02), setpoint=(0.62, 0.9),
        )
    ),
)  # fmt: skip


def draw(regime: Regime, batches: int, pixels: int, rng: np.random.Generator) -> tuple[Batch, ...]:
    """Draw microscopes of a regime, and materials under each.

    `batches`: how many microscopes (for `Image`: images).

    Examples
    --------
    >>> [len(batch) for batch in draw(REGIMES[0], 2, 5, np.random.default_rng(0))]
    [5, 5]
    """
    return tuple(regime.draw(pixels, rng) for _ in range(batches))


def _spread(rng: np.random.Generator, limits: Range, count: int) -> Array:
    """Draw numbers whose logarithms are uniform."""
    return np.exp(rng.uniform(np.log(limits[0]), np.log(limits[1]), count))


def _between(rng: np.random.Generator, limits: Range) -> float:
    return float(_spread(rng, limits, 1)[0])
