"""Imperfections of a real image: noise, drift, offsets of lines, a change of the tip, and quantisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from phasemap._shared.checks import check_choice, number, whole
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, Shown, known_as, values_in_words
from phasemap._shared.notices import question
from phasemap._shared.units import say
from phasemap.experiment.control import Control
from phasemap.experiment.microscope import RADIUS

TYPICAL: dict[str, Any] = {
    "temperature": 295.0, "detector_noise": 100e-15, "line_offset": 30e-12, "drift": (4e-9, 3e-9, 0.5e-9),
}  # fmt: skip
TYPICAL_SCAN = {"line_rate": 2.0, "bandwidth": 1e3}  # of a `Feedback` [Hz]
STILL = (0.0, 0.0, 0.0)
IN_TIME = ("temperature", "detector_noise")  # what acts in time only
DIGITISED = ("height", "phase", "amplitude", "amplitude_error")  # channels that an instrument records


@known_as()
@dataclass(frozen=True, repr=False)
class TipChange(Shown):
    """A tip that breaks, or wears off, in the middle of the image.

    Parameters
    ----------
    line : int
        The first row that the changed tip scans, at least 1.
    radius : float
        Its radius [m], > 0; all else about the tip stays.

    Notes
    -----
    A surface's `damping` (alpha1) holds for both tips as it is; give `viscosity` where the same material is meant. The
    relief is not dilated anew: `Surface.dilated` knows one tip.
    """

    line: int
    radius: Number[float] = Number("m", said="tip_change radius", above=0, usual=RADIUS)

    def __post_init__(self) -> None:
        whole("tip_change line", self.line, 1)

    def __str__(self) -> str:
        return f"to radius {say(self.radius, 'm')} from line {self.line} on"


@known_as()
@dataclass(frozen=True, repr=False)
class Realism(Shown):
    """Imperfections that a real microscope adds to an image; all of them are off unless asked for.

    Parameters
    ----------
    temperature : float, optional
        Of the lever [K], > 0, whose thermal motion then adds noise; with `Feedback` only.
    detector_noise : float, optional
        Of the deflection, one-sided amplitude spectral density, white [m/sqrt(Hz)], > 0; with `Feedback` only.
    line_offset : float
        Standard deviation [m] of a normally distributed offset of the height, one for each line and direction.
    phase_offset : float
        The same for the phase [degree].
    drift : (float, float, float)
        Of the sample under the tip during the whole image, along x, y and z [m]: row r of ny shows what lies
        (x, y) r / ny further right and down than its coordinates say, and z r / ny higher.
    tip_change : TipChange, optional
        Another radius of the tip from one line on.
    bits : int, optional
        Height, phase, amplitude and amplitude_error take ``2**bits`` values at equal steps over the range of each in
        this image, 1 to 32 bits.
    seed : int
        Of everything random, >= 0. Of several setpoints each image has the next one.

    Notes
    -----
    Drift comes first, for it changes what lies under the tip; topography is interpolated linearly, materials are those
    of the nearest pixel, and the outermost pixels go on beyond the edge. Trace and retrace share the drift of their
    line. Then the image is taken; `Engage` and `Raster` take the lines before and after a change of the tip as images
    of their own, so that ``Raster(engage="image")`` engages anew there. Offsets of lines come after, quantisation last.
    """

    temperature: Number[float | None] = Number("K", None, above=0, usual=(0.01, 3e3))
    detector_noise: Number[float | None] = Number("m/sqrt(Hz)", None, above=0, usual=(1e-17, 1e-10))
    line_offset: Number[float] = Number("m", 0.0, minimum=0, usual=(1e-13, 1e-6))
    phase_offset: Number[float] = Number("degree", 0.0, minimum=0, usual=(1e-6, 180.0))
    drift: tuple[float, float, float] = STILL
    tip_change: TipChange | None = None
    bits: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "drift", _drift(self.drift))
        if self.bits is not None:
            whole("bits", self.bits, 1, 32)
        whole("seed", self.seed, 0)

    @classmethod
    def typical(cls, **changes: Any) -> Realism:
        """Imperfections of an instrument in an ordinary room.

        The lever's own noise at room temperature, a detector of 100 fm/sqrt(Hz), lines offset by 30 pm, and a drift of
        a few nanometres. Noise acts in time: with `Feedback`, for which `TYPICAL_SCAN` is an ordinary one. In a scene,
        ``realism = "typical"`` asks for both, and for edges as wide as the tip sees them.

        Parameters
        ----------
        **changes : float, str or quantity
            Arguments that are to be other ones, such as ``seed``.

        Examples
        --------
        >>> Realism.typical(seed=3).detector_noise
        1e-13
        """
        return cls(**{**TYPICAL, **changes})

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Realism:
        """`typical`, by the name that it has in a scene."""
        check_choice("preset", name, ("typical",))
        return cls.typical(**changes)

    def __str__(self) -> str:
        """Imperfections that are on, with units; empty where none is."""
        along = ", ".join(say(one, "m") for one in self.drift)
        on = [values_in_words(replace(self, drift=STILL, seed=0)), f"drift {along}" if self.drift != STILL else ""]
        return ", ".join([*filter(None, on), f"seed {self.seed}"]) if any(on) else ""


def _drift(value: object) -> tuple[float, float, float]:
    """Drift as three lengths [m]."""
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence) or len(value) != 3:
        raise InputError("drift", value, "three lengths in m, (x, y, z)")
    x, y, z = (number(f"drift {axis}", length, "m") for axis, length in zip("xyz", value, strict=True))
    for axis, length in zip("xyz", (x, y, z), strict=True):
        question(f"drift {axis}", length, "m", (1e-15, 1e-4))
    return x, y, z


def check_realism(realism: Realism, control: Control, lines: int) -> Realism:
    """Return `realism` if it goes with the control and the number of lines."""
    if not control.in_time:
        for name in IN_TIME:
            value = getattr(realism, name)
            if value is not None:
                hint = "Noise acts in time: take a feedback, control.kind=feedback or in Python control=pm.Feedback()."
                raise InputError(name, value, "None", hint)
    if realism.tip_change is not None and realism.tip_change.line >= lines:
        raise InputError("tip_change line", realism.tip_change.line, f"a row from 1 to {lines - 1} of this image")
    return realism
