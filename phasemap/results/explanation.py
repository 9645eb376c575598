"""Sentences on what a setting shows: which regime each material is in, and why the contrast has the sign that it has.

The setpoint fixes the amplitude, and with it what air takes. So |phase| follows from the energy lost in contact alone
(theory, Eq. (energy-2)), and only the sign of the phase tells what the conservative force does: the contrast of two
materials whose phases have one sign is the difference of their losses, however different their moduli are; where the
signs differ, it is what two lossless materials would show there, +- arccos(E_air / (pi k u0 A)), less for the losses.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from phasemap._shared.units import ELECTRONVOLT
from phasemap.experiment.lever import energy_supplied, lost_in_air, of_tip

LEAST = 0.5  # degrees of contrast that stand out of the noise of a phase image
SHARE = 0.2  # of the contrast that the losses may leave open
DEGREES = "°"


class Convention(NamedTuple):
    """Convention of the phase: the two sides, their border, how far from it, and sine and cosine of the phase."""

    name: str
    positive: str
    negative: str
    border: str
    size: str
    sine: str
    cosine: str
    sign: int


PHASE = Convention("phase", "positive", "negative", "0", "their size", "sin(phase)", "cos(phase)", 1)
LAG = Convention("lag", "below 90°", "above 90°", "90°", "their distance from 90°", "cos(lag)", "sin(lag)", -1)


class PointMotion(NamedTuple):
    """Motion of the tip on one material at the working point."""

    name: str
    regime: str  # "attractive", "repulsive" or "none"
    bistable: bool  # whether the controller can hold the setpoint in the other regime too
    motion: str  # "periodic", "irregular" or "none"
    solver: str
    advice: str  # what is wrong and what helps; empty where nothing is
    phase: float  # [degree]; NaN without a solution, as all that follows
    tip_phase: float  # of the tip's position [degree]: the same, unless the detector sees the deflection
    # lost, air, most: energy [J per cycle] lost in contact and in air, and the most that the drive can give, pi k
    # u0 A
    lost: float
    air: float
    most: float
    virial: float  # [J]
    # indentation, tip_offset, height: [m]; the height is that of a flat surface at 0
    indentation: float
    tip_offset: float
    height: float
    second: str = ""  # what a driven second mode shows, in words

    @classmethod
    def of(cls, lever: np.ndarray, amplitude: float, phase: float, **known: Any) -> PointMotion:
        """Motion of which the detector sees this amplitude [m] and phase [degree], and what else is `known` of it."""
        tip_amplitude, tip_phase = of_tip(lever, amplitude, math.radians(phase))
        return cls(
            phase=phase, tip_phase=math.degrees(float(tip_phase)), air=float(lost_in_air(lever, tip_amplitude)),
            most=float(energy_supplied(lever, tip_amplitude, np.zeros(()))), height=known["tip_offset"] - amplitude,
            **known,
        )  # fmt: skip

    @property
    def stiffens(self) -> bool:
        """True if the phase is positive."""
        return self.tip_phase > 0

    @property
    def sine(self) -> float:
        """sin(phase)."""
        return math.sin(math.radians(self.tip_phase))

    @property
    def lossless(self) -> float:
        """The phase [degree] that a material without loss would have on the same side."""
        return self._balanced(self.air)

    @property
    def explained(self) -> float:
        """The phase [degree] that the losses give, if higher harmonics lose nothing."""
        return self._balanced(self.air + self.lost)

    def _balanced(self, energy: float) -> float:
        """The phase [degree] at which the drive gives this energy [J per cycle]."""
        return math.copysign(math.degrees(math.acos(max(-1.0, min(1.0, energy / self.most)))), self.tip_phase)


def lines_of(first: PointMotion, second: PointMotion, counted: Convention = PHASE) -> list[str]:
    """Say why the second material is brighter or darker in the phase image than the first, most important first.

    `first`, `second`: twice the same where there is one material only.
    """
    unsolved = [one for one in dict.fromkeys((first, second)) if math.isnan(one.phase)]
    if unsolved:
        compared = "" if first.name == second.name else ", so that the two cannot be compared"
        return [f"{one.name} has no orbit here{compared}. {one.advice}" for one in unsolved]
    if first.name == second.name:
        sentences = [_alone(first, counted)]
    elif first.stiffens != second.stiffens:
        sentences = _explain_two_signs(first, second, counted)
    else:
        sentences = _explain_one_sign(first, second, counted)
    return sentences + [line for one in dict.fromkeys((first, second)) for line in _warnings(one)]


def _explain_one_sign(first: PointMotion, second: PointMotion, counted: Convention) -> list[str]:
    """Sentences for two phases of the same sign."""
    contrast, explained = second.phase - first.phase, second.explained - first.explained
    energies = f"{_shown(second.lost)} against {_shown(first.lost)} eV per cycle in contact"
    if abs(explained - contrast) > max(LEAST, SHARE * abs(contrast)):
        return [
            f"{_compared(first, second, counted)}.",
            f"The losses ({energies}) would make it {_signed(counted.sign * explained, '.2g')}{DEGREES}: the rest is "
            "that higher harmonics lose energy in air too, which tells on so soft or damped a lever.",
        ]
    sign = counted.positive if first.stiffens else counted.negative
    law = (
        f"Both {counted.name}s are {sign}, and at one amplitude {counted.size} then follows from the energy lost alone"
    )
    if abs(contrast) < LEAST:
        return [
            f"{second.name} and {first.name} look alike ({abs(contrast):.2g}{DEGREES}), because their losses differ by "
            f"little: {_shown(second.lost)} against {_shown(first.lost)} eV per cycle in contact, of "
            f"{_shown(first.most)} that the drive can give.",
            f"{law}: stiffness and adhesion act only through it.",
        ]
    more = "more" if second.lost > first.lost else "less"
    towards = "darker" if first.stiffens == (counted is PHASE) else "brighter"
    return [
        f"{_compared(first, second, counted)}, because it loses {more} energy: {energies}.",
        f"{law}: loss pulls the {counted.name} towards {counted.border}, which is {towards} here.",
    ]


def _explain_two_signs(first: PointMotion, second: PointMotion, counted: Convention) -> list[str]:
    """Sentences for a positive and a negative phase."""
    lossless, contrast = second.lossless - first.lossless, second.phase - first.phase
    positive, negative = (first, second) if first.stiffens else (second, first)
    if positive.regime == negative.regime:
        why = "the conservative force and the drive off resonance pull to opposite sides"
    else:
        why = f"{positive.name} is {positive.regime} and {negative.name} {negative.regime}"
    sines = " and ".join(f"{_signed(one.sine, '.2f')} on {one.name}" for one in (positive, negative))
    return [
        f"{_compared(first, second, counted)}, because {why}.",
        f"The conservative force turns the sign of {counted.sine}: {sines}. Without any loss in contact the contrast "
        f"would be {_signed(counted.sign * lossless, '.3g')}{DEGREES}; the losses ({_shown(second.lost)} and "
        f"{_shown(first.lost)} eV per cycle) change it by "
        f"{_signed(counted.sign * (contrast - lossless), '.2g')}{DEGREES}.",
    ]


def _alone(motion: PointMotion, counted: Convention) -> str:
    """Sentences on the phase of a single material."""
    phase = motion.phase if counted is PHASE else 90 - motion.phase
    return (
        f"{motion.name} has the {counted.name} {phase:.3g}{DEGREES}: {counted.cosine} is the energy lost, "
        f"{_shown(motion.lost)} eV per cycle in contact and {_shown(motion.air)} in air, over the "
        f"{_shown(motion.most)} that the drive can give."
    )


def _compared(first: PointMotion, second: PointMotion, counted: Convention) -> str:
    """Say how the second material looks beside the first."""
    contrast = counted.sign * (second.phase - first.phase)
    word = "brighter" if contrast > 0 else "darker"
    return f"{second.name} is {abs(contrast):.3g}{DEGREES} {word} than {first.name}"


def _warnings(motion: PointMotion) -> list[str]:
    """Further sentences on a material: warnings."""
    sentences = []
    if motion.bistable:
        other = "repulsive" if motion.regime == "attractive" else "attractive"
        sentences.append(
            f"{motion.name} is bistable: the controller can hold this setpoint in the {other} regime too, so that a "
            "scan may jump there."
        )
    if motion.motion == "irregular":
        sentences.append(f"The motion on {motion.name} is not periodic: amplitude and phase are means.")
    if motion.second:
        sentences.append(f"On {motion.name} {motion.second}.")
    return sentences


def _shown(energy: float) -> str:
    """An energy in eV."""
    return shown_number(energy / ELECTRONVOLT)


def shown_number(value: float) -> str:
    """A number to three digits, never as a power of ten where it is large."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _signed(value: float, digits: str) -> str:
    """A number with its sign, as it is printed."""
    return f"{value:+{digits}}".replace("-", "−")
