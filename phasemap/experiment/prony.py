"""A solid that relaxes with several times: a generalised Maxwell solid, its moduli a Prony series."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasemap._shared.arrays import Array, as_array
from phasemap._shared.checks import check_choice, number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import Number, Shown, known_as

DENSITIES = (0.5, 1.0, 1.5, 2.0, 3.0)  # arms a decade that are tried for a power law
MARGIN = 1.0  # decades by which the times of a table's fit go beyond its band


@known_as(E="moduli", tau="times", E_inf="equilibrium")
@dataclass(frozen=True, repr=False)
class Prony(Shown):
    """Young's modulus that relaxes as E(t) = equilibrium + sum of moduli exp(-t / times): theory, Eq. (memory-12).

    Parameters
    ----------
    moduli : sequence of float
        Young's moduli of the arms [Pa], >= 0. `from_shear` takes shear moduli.
    times : sequence of float
        Their relaxation times [s], > 0.
    equilibrium : float
        Young's modulus that is left in the end [Pa], > 0; with a `dwell` shorter than some arm it may be 0.
    dwell : float, optional
        For how long the tip taps on one place [s]: arms that are slower keep their modulus. By default none does, and
        the orbit is that on a surface that has come to rest under the tip.

    Raises
    ------
    InputError
        If a number is out of range, or nothing is left that carries the tip in the end.

    Examples
    --------
    >>> rubber = Prony([500e6, 400e6], [20e-9, "1 us"], "100 MPa")
    >>> rubber.instantaneous
    1000000000.0
    """

    moduli: tuple[float, ...]
    times: tuple[float, ...]
    equilibrium: Number[float] = Number("Pa", 0.0, minimum=0)
    dwell: Number[float | None] = Number("s", None, above=0)
    residual: float | None = field(default=None, compare=False)
    """Largest error of the complex modulus that it was fitted to, over its size [1]; None where it was not."""

    def __post_init__(self) -> None:
        for name, unit in (("moduli", "Pa"), ("times", "s")):
            given = getattr(self, name)
            if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) or not len(given):
                raise InputError(name, given, "a list with a number for each arm")
            bounds = {"minimum": 0.0} if name == "moduli" else {"above": 0.0}
            object.__setattr__(self, name, tuple(number(name, one, unit, **bounds) for one in given))
        if len(self.moduli) != len(self.times):
            allowed = f"one for each of the {len(self.moduli)} moduli"
            raise InputError("times", Word(f"{len(self.times)} numbers"), allowed)
        if not self.lasting > 0:
            hint = "Such a solid flows: give dwell, for how long the tip taps on one place."
            raise InputError("equilibrium", self.equilibrium, "a modulus above 0 Pa that is left in the end", hint)

    @classmethod
    def from_shear(
        cls, moduli: Sequence[float], times: Sequence[float], equilibrium: float = 0.0, dwell: float | None = None
    ) -> Prony:
        """Spectrum from shear moduli of an incompressible solid, E = 3 G.

        Examples
        --------
        >>> Prony.from_shear([1e6], [1e-6], 1e5).instantaneous
        3300000.0
        """
        return cls([3 * one for one in moduli], times, 3 * equilibrium, dwell)  # type: ignore[arg-type]

    @classmethod
    def power_law(
        cls, modulus: float, time: float, exponent: float, band: tuple[float, float], error: float = 0.01
    ) -> Prony:
        """Arms for E(t) = modulus (t / time)**-exponent, as polymers near their glass transition and cells relax.

        Parameters
        ----------
        modulus, time : float
            E [Pa] at a time t [s].
        exponent : float
            n [1], between 0 and 1.
        band : (float, float)
            Frequencies [Hz] between which the complex modulus is to be right.
        error : float
            Largest error there, over its size [1].

        Examples
        --------
        >>> cell = Prony.power_law(1e4, 1e-3, 0.2, (1e3, 1e6))
        >>> cell.residual < 0.01, len(cell.times)
        (True, 10)
        """
        number("exponent", exponent, "1", above=0, below=1)
        number("error", error, "1", above=1e-4, below=1)
        low, high = _band(band)
        frequencies = np.geomspace(low, high, 200)
        wanted = modulus * math.gamma(1 - exponent) * (2j * np.pi * frequencies * time) ** exponent
        for density in DENSITIES:
            for margin in np.arange(0.5, 6.0, 0.25):
                count = math.ceil(density * (math.log10(high / low) + 2 * margin)) + 1
                edges = np.log10(2 * np.pi * low) - margin, np.log10(2 * np.pi * high) + margin
                rates = np.logspace(*edges, count)
                step = math.log(rates[1] / rates[0])
                weights = modulus * time**exponent / math.gamma(exponent) * rates**exponent * step
                slower = modulus * time**exponent / math.gamma(exponent) * (rates[0] * math.exp(-step / 2)) ** exponent
                spectrum = cls(weights, 1 / rates, slower / exponent)  # type: ignore[arg-type]
                off = float(np.max(np.abs(spectrum.complex_modulus(frequencies) / wanted - 1)))
                if off <= error:
                    return cls(spectrum.moduli, spectrum.times, spectrum.equilibrium, residual=off)
        raise InputError("error", error, "one that arms over this band can meet")

    @classmethod
    def from_table(
        cls,
        frequency: ArrayLike,
        storage: ArrayLike,
        loss: ArrayLike,
        *,
        density: float = 1.0,
        dwell: float | None = None,
    ) -> Prony:
        """Arms that fit a table of storage and loss modulus, by least squares without negative moduli.

        Parameters
        ----------
        frequency, storage, loss : array_like, shape (n,)
            [Hz], [Pa], [Pa]: as rheology and dynamic mechanical analysis give them.
        density : float
            Arms a decade, over the band and one decade to each side.
        dwell : float, optional
            As for `Prony`.

        Returns
        -------
        Prony
            Its `residual` is the largest error of the complex modulus over its size. What it is beyond the band is a
            guess.

        Examples
        --------
        >>> f, rubber = np.geomspace(1e3, 1e6, 30), Prony([3e8], [1e-6], 1e8)
        >>> both = rubber.complex_modulus(f)
        >>> Prony.from_table(f, both.real, both.imag, density=1.5).residual < 0.1
        True
        """
        from scipy.optimize import nnls

        columns = [np.asarray(one, dtype=np.float64) for one in (frequency, storage, loss)]
        for name, column in zip(("frequency", "storage", "loss"), columns, strict=True):
            if column.ndim != 1 or column.shape != columns[0].shape or len(column) < 2:
                raise InputError(f"shape of {name}", column.shape, "columns of one length, two rows or more")
            if not (np.isfinite(column) & (column > 0 if name != "loss" else column >= 0)).all():
                raise InputError(name, float(column.min()), "finite numbers above 0")
        number("density", density, "1", above=0, maximum=10)
        f, wanted = columns[0], columns[1] + 1j * columns[2]
        ends = np.log10(1 / (2 * np.pi * f.max())) - MARGIN, np.log10(1 / (2 * np.pi * f.min())) + MARGIN
        times = np.logspace(*ends, math.ceil(density * (ends[1] - ends[0])) + 1)
        parts = np.column_stack([np.ones(len(f)), arms_at(f, times)]) / np.abs(wanted)[:, None]
        goal = wanted / np.abs(wanted)
        weights, _ = nnls(np.concatenate([parts.real, parts.imag]), np.concatenate([goal.real, goal.imag]))
        off = float(np.max(np.abs(parts @ weights - goal)))
        kept = weights[1:] > 0
        return cls(weights[1:][kept], times[kept], weights[0], dwell, off)

    @classmethod
    def preset(cls, name: str, dwell: float | None = None) -> Prony:
        """A spectrum of the literature: "PIB" (polyisobutylene) or "epoxy"; `spectra.toml` has the sources."""
        tables = _tables()
        check_choice("preset of a spectrum", name, list(tables))
        table = tables[name]
        return cls.from_shear(table["shear_moduli"], table["times"], table["equilibrium"], dwell or table["dwell"])

    def scaled(self, factor: float) -> Prony:
        """The spectrum with all moduli multiplied by a factor."""
        return replace(self, moduli=tuple(factor * one for one in self.moduli), equilibrium=factor * self.equilibrium)

    @property
    def instantaneous(self) -> float:
        """Young's modulus of a sudden touch [Pa]."""
        return self.equilibrium + sum(self.moduli)

    @property
    def lasting(self) -> float:
        """Young's modulus [Pa] left after `dwell`, with the moduli of slower arms."""
        held = [
            E for E, time in zip(self.moduli, self.times, strict=True) if self.dwell is not None and time > self.dwell
        ]
        return self.equilibrium + sum(held)

    def complex_modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Storage modulus + i loss modulus [Pa] at frequencies [Hz]."""
        arms = np.array(self.moduli) * arms_at(np.asarray(frequency, dtype=np.float64), np.array(self.times))
        return self.equilibrium + arms.sum(axis=-1)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the spectrum, as JSON has them."""
        return {name: getattr(self, name) for name in ("moduli", "times", "equilibrium", "dwell")}

    @property
    def key(self) -> float:
        """A whole number by which maps name it, the same in every process; asked for once, it is found by that."""
        digest = float(int(hashlib.sha256(json.dumps(self.arguments).encode()).hexdigest()[:13], 16))
        _KNOWN[digest] = self
        return digest


@cache
def _tables() -> dict[str, Any]:
    """Presets of spectra by their names."""
    return tomllib.loads(files("phasemap.experiment").joinpath("spectra.toml").read_text(encoding="utf-8"))


def spectrum_name(spectrum: Prony) -> str:
    """Name of the preset that a spectrum is, for a choice of them."""
    return next((name for name in _tables() if Prony.preset(name) == spectrum), "as given")


def arms_at(frequency: Array, times: Array) -> NDArray[np.complex128]:
    """Complex modulus of arms at frequencies [Hz], over their moduli, shape (*frequency.shape, arms)."""
    turn = 2j * np.pi * frequency[..., None] * times
    return np.asarray(turn / (1 + turn))


def prony_of(given: Mapping[str, Any]) -> Prony:
    """A spectrum from its arguments as a scene has them: Young's moduli, or `shear_moduli` in their place."""
    if "preset" in given and set(given) <= {"preset", "dwell"}:
        dwell = given.get("dwell")
        return Prony.preset(given["preset"], None if dwell is None else number("dwell", dwell, "s", above=0))
    known = {"moduli", "shear_moduli", "times", "equilibrium", "dwell", "residual"}
    if unknown := sorted(set(given) - known):
        allowed = "moduli or shear_moduli, times, equilibrium and dwell, or preset and dwell"
        raise InputError("relaxation", unknown[0], allowed)
    if ("moduli" in given) == ("shear_moduli" in given) or "times" not in given:
        raise InputError("relaxation", Word(", ".join(given) or "empty"), "moduli or shear_moduli, and times")
    if "moduli" in given:
        return Prony(**given)
    scale = {"moduli": given["shear_moduli"], **{key: one for key, one in given.items() if key != "shear_moduli"}}
    return Prony.from_shear(**scale)


_KNOWN: dict[float, Prony] = {}
"""Spectra in the maps of this process, by their keys."""


def spectrum_of(key: float) -> Prony:
    """The spectrum that maps name so."""
    return _KNOWN[float(key)]


def keys_of(relaxation: Any) -> Any:
    """Spectra as maps have them: a `Prony`, an array of them or of their keys, or None."""
    if relaxation is None:
        return None
    if isinstance(relaxation, Prony):
        return relaxation.key
    given = as_array("relaxation", relaxation, "a Prony, or a 2-D map of them")
    if given.dtype == object:
        if not all(isinstance(one, Prony) for one in given.flat):
            raise InputError("relaxation", Word("given"), "a Prony, or a 2-D map of them")
        return np.array([one.key for one in given.flat]).reshape(given.shape)
    if given.dtype.kind not in "fiu" or not all(one in _KNOWN or math.isinf(one) for one in np.unique(given)):
        raise InputError("relaxation", Word("given as numbers"), "a Prony, or a 2-D map of them")
    return given


def _band(band: tuple[float, float]) -> tuple[float, float]:
    """Frequencies [Hz] in order, checked."""
    if not isinstance(band, Sequence) or isinstance(band, str) or len(band) != 2:
        raise InputError("band", band, "two frequencies, such as (1e3, 1e6)")
    low, high = (number("band", one, "Hz", above=0) for one in band)
    if not low < high:
        raise InputError("band", band, "two frequencies, the lower one first")
    return low, high
