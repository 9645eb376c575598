"""Arrays that kernels read, from materials and microscope. Units, None and names stop here."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.rows.answers import Pixels
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.notices import question
from phasemap.experiment.arms import most_arms
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import film_of, liquid_of, properties, relaxation_of, rows_of
from phasemap.experiment.microscope import Microscope

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Work:
    """Distinct pixels, ready for a solver."""

    law: Law  # the formulas of the interaction
    rows: Array  # shape (n, 16); their parameters, one row a pixel
    lever: Array  # see `phasemap.experiment.lever.lever_of`
    amplitudes: Array  # shape (n,); setpoint amplitude of each pixel [m], as the detector sees it
    ting: bool = False  # whether damped contacts let go as after Ting; else only those that relax remember

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def pixels(self) -> Pixels:
        """Pixels as kernels want them."""
        return Pixels(self.law, self.rows, self.lever, self.amplitudes)

    def oscillator(self, i: int) -> Oscillator:
        """The lever over one of the pixels."""
        return Oscillator(self.law, tuple(self.rows[i].tolist()), self.lever)

    def part(self, chosen: Array | slice, amplitudes: Array | None = None) -> Work:
        """Work of some of the pixels, at their setpoint amplitudes or at other ones."""
        wanted = self.amplitudes[chosen] if amplitudes is None else amplitudes
        return replace(self, rows=np.ascontiguousarray(self.rows[chosen]), amplitudes=wanted)

    @property
    def remembers(self) -> Array:
        """Which contacts remember; shape (n,)."""
        relaxes, damped = self.rows[:, col.RELAXATION] > 0, self.rows[:, col.DAMPING] > 0
        found: Array = bool(self.law.memory) & (relaxes | (self.ting & damped))
        return found

    @property
    def loses(self) -> Array:
        """Which contacts lose energy of their own or draw necks of liquid; shape (n,)."""
        lossy = bool(self.law.lossy) & ((self.rows[:, col.WITHDRAWN] > 0) | (self.rows[:, col.LOSS] > 0))
        found: Array = lossy | (self.rows[:, col.FORMING] < 0)
        return found

    def static(self) -> tuple[Array, Work]:
        """Places of the contacts that neither remember nor lose, and work of these alone, whose law is static."""
        places = np.flatnonzero(~(self.remembers | self.loses))
        return places, replace(self.part(places), law=self.law._replace(memory=0, lossy=0))

    @property
    def in_time(self) -> bool:
        """True if contacts remember, lose energy of their own, or draw necks of liquid: only the march knows these."""
        return bool(self.law.memory or self.law.lossy) or bool((self.rows[:, col.FORMING] < 0).any())

    def refused(self) -> Array:
        """Status codes (int8): GOOD where there is something to solve, or what a mark of `Interaction.columns` says."""
        creates = np.isneginf(self.rows[:, col.RELEASE])
        solvable = np.isfinite(self.rows).all(axis=1)
        return np.where(solvable, col.GOOD, np.where(creates, col.CREATES_ENERGY, col.INVALID)).astype(np.int8)


LEAST_USUAL = 1e-3  # setpoint used in practice; an amplitude in metres is far below


def check_setpoint(setpoint: object) -> float:
    """Return the setpoint as a float."""
    try:
        ratio = number("setpoint", setpoint, "1", above=0, below=1)
    except InputError:
        allowed = "a number above 0 and below 1 (the amplitude over the free amplitude at the drive frequency)"
        raise InputError("setpoint", setpoint, allowed) from None
    question("setpoint, a share of the free amplitude,", ratio, "1", (LEAST_USUAL, 1.0))
    return ratio


def work_of(
    stiffness: Array, adhesion: Array, damping: Array, scope: Microscope, amplitude: float | Array,
    film: Array | None = None, relaxation: Array | None = None, liquid: Array | None = None, *, marched: bool = False,
) -> Work:  # fmt: skip
    """Work from the results of `properties`, `film_of`, `relaxation_of` and `liquid_of`, at setpoint amplitudes [m]."""
    rows = scope.interaction.columns(stiffness, adhesion, damping, scope.tip.radius, film, liquid)
    if scope.interaction.law.lossy:  # a damping coefficient [N s/m] is alpha_s = c omega_c / (2 k)
        rows[:, col.LOSS] *= np.pi * scope.cantilever.resonance_frequency / scope.cantilever.stiffness
    amplitudes = np.array(np.broadcast_to(amplitude, (len(rows),)), dtype=np.float64)
    remembers = scope.interaction.remembering(rows, relaxation)
    if remembers or scope.interaction.law.in_time:
        check_marched(marched, scope, remembers)
    law = scope.interaction.token(remembers)
    if relaxation is not None:
        law = law._replace(arms=most_arms(relaxation))
    return Work(law, rows, lever_of(scope), amplitudes, scope.interaction.withdrawal == "ting")


def longest_memory(laws: Iterable[Law]) -> Law:
    """The law, of laws that are alike but for what they remember, that remembers most."""
    return max(laws, key=lambda law: (law.memory, law.arms))


def check_marched(marched: bool, scope: Microscope, remembers: bool = False) -> None:
    """Refuse what goes beyond the march in time, the only one that knows a memory."""
    if not marched:
        hint = "Ask simulate, solve_pixel, contrast or a sweep, with solver 'march' or 'auto'."
        if scope.interaction.law.in_time and not remembers:
            raise InputError(
                "contact", scope.interaction.law.name, "a dry law without losses, for what is not marched in time", hint
            )
        allowed = "materials without a relaxation time, and withdrawal 'linear', for what is not marched in time"
        raise InputError("surface", Word("one that remembers"), allowed, hint)
    if scope.drive.second is not None:
        allowed = "None where a surface remembers or is wet: its mode feels a static law only"
        raise InputError("second", Word("given"), allowed)


def make_work(
    materials: Array, viscous: bool, scope: Microscope, amplitudes: float | Array, *, marched: bool = False
) -> Work:
    """Turn materials, with setpoint amplitudes [m], into work; `marched` as for `work_of`."""
    given = *properties(materials, viscous, scope), scope, amplitudes, film_of(materials)
    return work_of(*given, relaxation_of(materials, scope), liquid_of(materials), marched=marched)


def work_of_material(material: Material, scope: Microscope, amplitude: float, *, marched: bool = False) -> Work:
    """Work of one material, at a setpoint amplitude [m]."""
    row, viscous = rows_of([material])
    stiffness, adhesion, _ = properties(row, viscous, scope)
    scope.interaction.check(float(stiffness[0]), float(adhesion[0]), scope.tip.radius, film_of(row), liquid_of(row))
    return make_work(row, viscous, scope, amplitude, marched=marched)


def forces_of(materials: Array, viscous: bool, scope: Microscope) -> tuple[float, float]:
    """Largest adhesion between tip and surface, and pull of the lever at its free amplitude [N]."""
    stiffness, adhesion, _ = properties(materials, viscous, scope)
    with np.errstate(all="ignore"):  # what a law cannot have has a status of its own
        pull = scope.interaction.law.pull(stiffness, adhesion, scope.tip.radius)
    return float(pull.max()), scope.cantilever.stiffness * scope.driven_amplitude
