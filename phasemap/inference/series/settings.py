"""Settings that the files of a series state, and which of them stay unknown."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap._shared.checks import is_sign
from phasemap._shared.errors import InputError, Word
from phasemap._shared.notices import question
from phasemap._shared.units import say
from phasemap.experiment.microscope import AMPLITUDE, Cantilever, Drive, Microscope, Tip
from phasemap.experiment.presets import levers
from phasemap.inference.images.stack import FREE, SHARED, of_each_image
from phasemap.inference.series.recorded import recorded_of
from phasemap.io.metadata import is_simulated, recorded_microscope, settings_of_image

HELD = "held"  # beside the words of `stack`
RADIUS = 10e-9  # of a tip of which nothing is said [m]
GUESS, GUESS_FACTOR = 30e-9, 2.0  # a free amplitude of which nothing is said [m]: its median, and standard deviation
CALIBRATED = 1.05  # the same factor of one that is said
OWN = 1.5  # the same of amplitudes that differ from file to file, about what they have in common
HIGHEST = (0.4, 0.97)  # between which the highest setpoint of a series is, where no file says what it is of
LOWEST = 0.05  # setpoint used in practice
STEP = 0.06  # of setpoints that are interpolated
ANYWHERE = 180.0 / math.sqrt(3.0)  # standard deviation of a zero that may be anywhere on the circle [degree]
SAME = 0.02  # by which free amplitudes are the same, and setpoints
SAME_LEVER = 1.1  # factor within which files say the same of a lever
OF_THE_LEVER = ("resonance_frequency", "stiffness")  # by which levers are told apart; Q changes with distance and air
FAR = 2.0  # factor between resonances, above which a typical lever says nothing of another
AWAY = 0.2  # half widths of the resonance beside which a drive is said to be
NEAR_ZERO = 5.0  # by which the phase of the free lever drifts from what was recorded of it [degree]
SAME_DRIVE = 0.02  # by which drive frequencies of one series may differ


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of m files."""

    names: tuple[str, ...]
    # shape (m,); Setpoints; where they are not known, what is recorded of the setpoint over what is of the free
    # amplitude
    ratios: Array
    relative: Array  # shape (m,); free amplitudes over their common scale
    # scale, factor: of the free amplitude at the drive frequency [m]: median and standard deviation as a factor
    scale: float
    factor: float
    # amplitude, setpoint, zero: "held", "shared" or "free"
    amplitude: str
    setpoint: str
    zero: str
    # whether `ratios` are amplitudes [m] over `relative`, of which free amplitudes follow from setpoints
    metres: bool
    # zeros, zero_errors: shape (m,) [degree]
    zeros: Array
    zero_errors: Array
    sign: int | None  # of the recorded phase; none where it is not known
    tunes: NDArray[np.intp]  # shape (m,); within one, scale, highest setpoint and shared zero are the same
    told: tuple[str, ...] = ()  # sentences on where all this comes from

    def __len__(self) -> int:
        return len(self.names)

    @property
    def tune_count(self) -> int:
        """Number of tunes."""
        return 1 + int(self.tunes.max())

    @property
    def alike(self) -> NDArray[np.bool_]:
        """True for pairs of files with the same free amplitude, whatever it is, shape (m, m)."""
        same: NDArray[np.bool_] = np.abs(np.log(self.relative[:, np.newaxis] / self.relative)) < SAME
        same &= (self.tunes[:, np.newaxis] == self.tunes) | (self.amplitude == HELD)
        return same

    @property
    def repeats(self) -> NDArray[np.bool_]:
        """True for pairs of files with the same free amplitude and setpoint, shape (m, m)."""
        close: NDArray[np.bool_] = np.abs(np.log(self.ratios[:, np.newaxis] / self.ratios)) < SAME
        close &= self.alike & (self.tunes[:, np.newaxis] == self.tunes)
        return close

    @property
    def above(self) -> Array:
        """1 where a file (row) has a larger setpoint than another (column) at the same free amplitude, shape (m, m)."""
        return (self.alike & (self.ratios[:, np.newaxis] > self.ratios)).astype(float)

    def at(self, scale: Array, by_file: Array, share: Array) -> tuple[Array, Array]:
        """Free amplitudes [m] and setpoints, shape (n, m), at standard normal numbers and a share of what is allowed.

        `scale`, `share` (shape (n, tunes)); `by_file` (shape (n, m)).
        """
        factor = self.factor ** scale[:, self.tunes]
        amplitudes = self.relative * self.scale * factor * OWN**by_file
        if self.setpoint == HELD:
            return amplitudes, np.broadcast_to(self.ratios, amplitudes.shape)
        highest = HIGHEST[0] + (HIGHEST[1] - HIGHEST[0]) * share[:, self.tunes]
        most = np.array([self.ratios[self.tunes == k].max() for k in self.tunes])
        ratios = highest * self.ratios / most
        if self.metres:
            amplitudes = self.relative * self.ratios / ratios * factor
        return amplitudes, ratios

    def ranges(self, reach: float) -> tuple[tuple[float, float], Array]:
        """Least and largest free amplitude [m], and setpoints between which others are interpolated.

        `reach`: of scale and own amplitude [standard deviations]. Ends are wider by a little, for what rounding adds.
        """
        ends = np.repeat([[-reach], [reach]], len(self), axis=1)
        corners = [self.at(ends, ends * (self.amplitude == FREE), np.full_like(ends, share)) for share in (0.0, 1.0)]
        sizes, levels = (np.concatenate([corner[k] for corner in corners]) for k in (0, 1))
        nodes = np.unique(levels)
        if self.setpoint != HELD or len(nodes) == 1:
            least, most = max(float(levels.min()), LOWEST) - 0.002, min(float(levels.max()) + 0.002, 0.995)
            nodes = np.linspace(least, most, max(2, 1 + int(np.ceil((most - least) / STEP))))
        return (float(sizes.min()) * 0.999, float(sizes.max()) * 1.001), nodes

    def ordered(self) -> tuple[Settings, NDArray[np.intp]]:
        """Settings sorted from the gentlest tapping to the hardest, and the number that each file had before."""
        highest = 1.0 if self.setpoint == HELD else 1.05 * self.ratios.max()
        drop = self.relative * (1 - self.ratios / highest)
        order = np.lexsort((-self.ratios, drop.round(9)))
        arrays = {name: getattr(self, name)[order] for name in ("ratios", "relative", "zeros", "zero_errors", "tunes")}
        return replace(self, names=tuple(self.names[i] for i in order), **arrays), order


def scope_of(
    images: Sequence[xr.Dataset], scope: Microscope | None, given: Collection[str] = ()
) -> tuple[Microscope, list[str]]:
    """The microscope, of the files, what is `given` in place of theirs, and what has to be assumed, which is told."""
    known: list[dict[str, Any]] = [settings_of_image(one) for one in images]
    names = [str(one.attrs.get("title") or f"image {i}") for i, one in enumerate(images)]
    frequencies = [float(one["drive_frequency"]) for one in known if "drive_frequency" in one]
    if frequencies and max(frequencies) > (1 + SAME_DRIVE) * min(frequencies):
        listed = ", ".join(f"{name}: {float(one['drive_frequency']) / 1e3:.4g} kHz"
                           for name, one in zip(names, known, strict=True) if "drive_frequency" in one)  # fmt: skip
        raise InputError(
            "the drive frequency", Word(listed), "the same in all files", "A series is of one sample and one lever."
        )
    return (scope, []) if scope is not None else _scope_of_files(images, known, names, given)


def _scope_of_files(
    images: Sequence[xr.Dataset], known: list[dict[str, Any]], names: list[str], given: Collection[str]
) -> tuple[Microscope, list[str]]:
    """The microscope of files, and sentences on it, as of `scope_of`; `known`: what each file says."""
    stated, told = _lever_properties(known, names, given)
    frequencies = [float(one["drive_frequency"]) for one in known if "drive_frequency" in one]
    resonance = stated.get("resonance_frequency", frequencies[0] if frequencies else 300e3)
    frequency = next((float(one["drive_frequency"]) for one in known if "drive_frequency" in one and
                      one.get("resonance_frequency") == resonance), None)  # fmt: skip
    nearest = min(levers().values(), key=lambda one: abs(math.log(one.values["resonance_frequency"] / resonance)))
    typical = nearest.values["resonance_frequency"]
    far = f", though that has {say(typical, 'Hz', 3)} and not {say(resonance, 'Hz', 3)}: say what yours has"
    far = far if abs(math.log(typical / resonance)) > math.log(FAR) else ""
    values: dict[str, Any] = {"resonance_frequency": resonance}
    for name, unit in (("stiffness", " N/m"), ("quality_factor", "")):
        values[name] = float(stated.get(name, nearest.values[name]))
        if name not in stated:
            what = name.replace("_", " ")
            told.append(
                f"The {what} is not in the files: {values[name]:g}{unit} is assumed, as of {nearest.name}{far}."
            )
    if "tip_radius" not in stated:
        told.append(f"The tip radius is not in the files: {RADIUS * 1e9:g} nm is assumed.")
    if "resonance_frequency" not in stated:
        told.append("The lever is taken to be driven at its resonance, which the files do not say.")
    elif frequency is not None and abs(away := 2 * values["quality_factor"] * (frequency / resonance - 1)) > AWAY:
        told.append(
            f"The lever is driven at {frequency / 1e3:.5g} kHz, {abs(away):.2g} half widths "
            f"{'above' if away > 0 else 'below'} its resonance at {resonance / 1e3:.5g} kHz, as the files say."
        )
    recorded = {of: found for of, one in zip(names, images, strict=True) if (found := recorded_microscope(one.attrs))}
    laws = {of: law or found.interaction.law.name for of, (found, law) in recorded.items()}
    if len(set(laws.values())) > 1:
        listed = ", ".join(f"{law} in {of}" for of, law in laws.items())
        told.append(f"The contact law differs: {listed}; the first is taken.")
    scope, lost = next(iter(recorded.values()), (Microscope(Cantilever(**values), Tip(RADIUS), Drive(GUESS)), ""))
    if lost:
        told.append(f"The contact law {lost} of {next(iter(laws))} is not one of phasemap's: dmt is assumed.")
    lever, tip = replace(scope.cantilever, **values), replace(scope.tip, radius=stated.get("tip_radius", RADIUS))
    drive = replace(scope.drive, free_amplitude=GUESS, frequency=frequency, second=None)
    return replace(scope, cantilever=lever, tip=tip, drive=drive), told


def _lever_properties(
    known: list[dict[str, Any]], names: list[str], given: Collection[str]
) -> tuple[dict[str, float], list[str]]:
    """Properties of lever and tip, each from the first file that says it, and a sentence where they differ."""
    stated, told = dict[str, float](), []
    units = {"resonance_frequency": "Hz", "stiffness": "N/m", "quality_factor": "1", "tip_radius": "m"}
    for name, unit in units.items():
        values = {of: float(one[name]) for of, one in zip(names, known, strict=True) if name in one}
        if not values:
            continue
        stated[name] = next(iter(values.values()))
        if max(values.values()) > SAME_LEVER * min(values.values()):
            listed = ", ".join(f"{say(value, unit, 4)} in {of}" for of, value in values.items())
            if name in OF_THE_LEVER and name not in given:
                how = f"say its {name} (cantilever.{name}=..., scope)"
                hint = f"A series is of one sample and one lever; if it is one, {how}."
                raise InputError(f"{name} of the files", Word(listed), "that of one lever", hint)
            told.append(f"The {name.replace('_', ' ')} differs: {listed}; the first is taken.")
    return stated, told


def settings_of(images: Sequence[xr.Dataset], names: Sequence[str], given: dict[str, Any]) -> Settings:
    """Settings from files and from the arguments `setpoints`, `free_amplitudes`, `phase_zero` and `sign`."""
    count, told = len(images), list[str]()
    known, tunes = recorded_of(images, names, told)
    amplitude, scale, factor, relative = _amplitudes(known, given["free_amplitudes"], told)
    setpoint, metres, ratios = _setpoints(known, relative, amplitude, scale, given["setpoints"], told)
    if metres:
        factor = CALIBRATED
    zero, zeros, errors = _zeros(known, given["phase_zero"], given["phase_zero_error"], told)
    sign = given["sign"]
    if sign is None and len({one.get("phase_sign") for one in known}) == 1 and known[0].get("phase_sign") in (1, -1):
        sign = int(known[0]["phase_sign"])
        if not all(is_simulated(one) for one in images):
            told.append(f"Phase is counted with sign {sign}, as this vendor documents.")
    if sign is not None and not is_sign(sign):
        raise InputError("sign", sign, "1, -1 or None")
    if sign is None:
        told.append("The sign of the recorded phase is not known: both signs are tried.")
    if all(float(one.max()) < (1 + SAME) * float(one.min()) for one in (relative, ratios)):
        told.append("All files have the same setpoint and free amplitude: they add no more than a lower noise.")
    return Settings(
        tuple(names), ratios, relative, scale, factor, amplitude, setpoint, zero, metres,
        np.broadcast_to(zeros, (count,)).astype(float), np.broadcast_to(errors, (count,)).astype(float), sign,
        tunes, tuple(told),
    )  # fmt: skip


def _all_of(known: list[dict[str, Any]], name: str) -> Array | None:
    """A value of every file that is above 0, None where one does not say it."""
    values = np.array([float(one.get(name) or 0.0) for one in known])
    return values if (values > 0).all() else None


def _is_word(name: str, given: Any, unit: str) -> bool:
    """True if "shared" or "free" is given instead of numbers."""
    if isinstance(given, str) and given not in (SHARED, FREE):
        raise InputError(name, given, f"'shared', 'free' or numbers [{unit}]")
    return isinstance(given, str)


def _amplitudes(known: list[dict[str, Any]], given: Any, told: list[str]) -> tuple[str, float, float, Array]:
    """Kind of the free amplitudes, scale [m], its factor, and free amplitudes over it."""
    word = _is_word("free_amplitudes", given, "m")
    metres, volts, drive = (
        _all_of(known, name) for name in ("free_amplitude", "free_amplitude_voltage", "drive_voltage")
    )
    if given is not None and not word:
        metres = of_each_image("free_amplitudes", given, "m", len(known), above=0)
        for amplitude in metres.tolist():
            question("free_amplitudes", amplitude, "m", AMPLITUDE)
    elif not word and metres is not None:
        told.append("Free amplitudes as recorded, and a calibration within 5 %.")
    if not word and metres is not None:
        scale = float(np.exp(np.log(metres).mean()))
        return HELD, scale, CALIBRATED, metres / scale
    relative, words = np.ones(len(known)), "assumed to be the same in all files"
    for recorded, how in ((drive, "of the drive"), (volts, "recorded in volts"), (metres, "recorded in metres")):
        if recorded is not None:
            relative, words = recorded / np.exp(np.log(recorded).mean()), f"with one unknown sensitivity, {how}"
    if given == FREE:
        relative, words = np.ones(len(known)), "unknown in each file"
    told.append(f"Free amplitudes: {words}; {GUESS * 1e9:g} nm within a factor of {GUESS_FACTOR:g} as a first guess.")
    return (FREE if given == FREE else SHARED), GUESS, GUESS_FACTOR, relative


def _setpoints(
    known: list[dict[str, Any]], relative: Array, amplitude: str, scale: float, given: Any, told: list[str]
) -> tuple[str, bool, Array]:
    """Kind of the setpoints, whether they are in metres, and setpoints or recorded ones over the free amplitude."""
    if given is not None:
        ratios = of_each_image("setpoints", given, "1", len(known), above=0)
        if ratios.max() >= 1:
            raise InputError("setpoints", given, "numbers below 1, of the free amplitude")
        return HELD, False, ratios
    recorded = _all_of(known, "setpoint")
    if recorded is not None and recorded.max() < 1:
        return HELD, False, recorded
    metres, volts = _all_of(known, "setpoint_amplitude"), _all_of(known, "setpoint_voltage")
    if metres is not None and amplitude == HELD and (metres / (relative * scale)).max() < 1:
        return HELD, False, metres / (relative * scale)
    values = metres if metres is not None else volts
    if values is None:
        words = (
            ("setpoint", "1", " of the free amplitude"),
            ("setpoint_amplitude", "m", ""),
            ("setpoint_voltage", "V", ""),
        )
        listed = "; ".join(
            f"{one.get('title', 'a file')}: "
            + next((say(float(one[name]), unit, 3) + more for name, unit, more in words if name in one), "nothing")
            for one in known
        )
        allowed = "ratios to the free amplitude in all files, or voltages in all"
        raise InputError("what files say of the setpoint", Word(listed), allowed, "Give the ratios (setpoints).")
    told.append(
        "Setpoints are recorded without the free amplitude: the highest is assumed to be between "
        f"{HIGHEST[0]:g} and {HIGHEST[1]:g} of it."
    )
    return SHARED, metres is not None and amplitude == SHARED, values / relative


def _zeros(known: list[dict[str, Any]], given: Any, error: Any, told: list[str]) -> tuple[str, Any, Any]:
    """Kind of the zeros of the phase, their values and errors [degree]."""
    count = len(known)
    if _is_word("phase_zero", given, "degree"):
        return given, np.zeros(count), error
    if given is not None:
        return HELD, of_each_image("phase_zero", given, "degree", count), error
    recorded = [one.get("phase_zero") for one in known]
    if all(one is None for one in recorded):
        told.append("The phase of the free lever is not recorded: the zero of the phase is unknown in each file.")
        return FREE, np.zeros(count), error
    errors = np.array([
        ANYWHERE if zero is None else 0.0 if "configuration" in one else NEAR_ZERO
        for zero, one in zip(recorded, known, strict=True)
    ])  # fmt: skip
    where = "" if None not in recorded else " where it is; in the other files it is unknown"
    if errors.any():
        told.append(f"The zero of the phase is as recorded, within {NEAR_ZERO:g} degrees{where}.")
    return HELD, np.array([float(one or 0.0) for one in recorded]), np.hypot(errors, error)
