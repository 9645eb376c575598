"""Files of a series as they are read: by distinct names, with gaps in the settings of one filled from the others."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.errors import InputError, Word
from phasemap._shared.notices import tell, untold
from phasemap._shared.units import listed as listed_words
from phasemap.io.metadata import settings_of_image
from phasemap.io.read import read_image

OF_TUNE = {"drive_frequency": 2e-4, "drive_voltage": 0.02, "phase_zero": 5.0, "lock_in_phase": 1.0, "day": 0.5}
"""Largest difference between files of one tune: relative, or in degrees and days."""
RELATIVE = ("drive_frequency", "drive_voltage")
LINEAR = 1.2  # factor within which free amplitudes follow the voltage of the drive
PAIRS = (("setpoint_voltage", "free_amplitude_voltage"), ("setpoint_amplitude", "free_amplitude"))
FREE_AMPLITUDES = ("free_amplitude", "free_amplitude_voltage")


def read_files(files: Sequence[Any]) -> list[xr.Dataset]:
    """Images by their names, their attribute "title"; doubts of the readers are told with the file's name."""
    paths = [Path(one) if isinstance(one, str | os.PathLike) else None for one in files]
    often = Counter(path.name for path in paths if path)
    images, doubts = [], dict[str, list[str]]()
    for i, (path, file) in enumerate(zip(paths, files, strict=True)):
        if path is None:
            if not hasattr(file, "data_vars"):
                raise InputError("a file", type(file).__name__, "a path, or an image as phasemap.read_image gives it")
            images.append(file.assign_attrs(title=str(file.attrs.get("title") or f"image {i}")))
            continue
        with untold():
            image = read_image(path)
        name = path.name if often[path.name] == 1 else f"{path.resolve().parent.name}/{path.name}"
        images.append(image.assign_attrs(title=name))
        for line in str(image.attrs.get("warnings", "")).splitlines():
            doubts.setdefault(line, []).append(name)
    _check_different(images)
    tell(line if len(names) == len(images) else f"{', '.join(names)}: {line}" for line, names in doubts.items())
    return images


def _check_different(images: Sequence[xr.Dataset]) -> None:
    """Refuse one image twice, which would count as two measurements."""
    phases = [(one.attrs["title"], one["phase"].values) for one in images if "phase" in one]
    for (name, phase), (other, again) in combinations(phases, 2):
        if np.array_equal(phase, again, equal_nan=True):
            hint = "These two hold the same phase image; leave one out."
            both = f"{name} twice" if name == other else f"{name} and {other}"
            raise InputError("files", Word(both), "different ones", hint)


def recorded_of(
    images: Sequence[xr.Dataset], names: Sequence[str], told: list[str]
) -> tuple[list[dict[str, Any]], NDArray[np.intp]]:
    """Settings that each file, or else its tune, states, and the tune of each, shape (m,); doubts are told."""
    known: list[dict[str, Any]] = [settings_of_image(one) for one in images]
    tunes, stated = _tunes_of(known, OF_TUNE)
    if len(stated) > 1:
        listed = "; ".join(", ".join(names[i] for i in np.flatnonzero(tunes == k).tolist()) for k in range(len(stated)))
        apart = [name for name in OF_TUNE if any(_differ(name, one, other) for one, other in combinations(stated, 2))]
        by = f", told apart by {listed_words([name.replace('_', ' ') for name in apart])}" if apart else ""
        told.append(
            f"The files are of {len(stated)} tunes ({listed}){by}: an unknown sensitivity, setpoint or shared zero is "
            "the same within a tune only."
        )
    lever, _ = _tunes_of(known, [name for name in OF_TUNE if name != "drive_voltage"])
    for k in range(1 + int(lever.max())):  # amplitudes follow the drive, if nothing else changes
        alike = np.flatnonzero(lever == k).tolist()
        _complete([known[i] for i in alike], [names[i] for i in alike], told)
    return known, tunes


def _tunes_of(known: list[dict[str, Any]], names: Collection[str]) -> tuple[NDArray[np.intp], list[dict[str, float]]]:
    """Number of the tune of each file, counted in their order, and the settings of each tune.

    A file that leaves something unsaid is of the only tune that it does not contradict, else of one of its own.
    """
    stated = [{name: float(one[name]) for name in names if one.get(name) is not None} for one in known]
    tunes, number = list[dict[str, float]](), np.zeros(len(known), np.intp)
    for i in sorted(range(len(stated)), key=lambda i: -len(stated[i])):
        alike = [k for k, one in enumerate(tunes) if not any(_differ(name, one, stated[i]) for name in names)]
        alike = [k for k in alike if tunes[k].keys() == stated[i].keys()][:1] or alike
        number[i] = alike[0] if len(alike) == 1 else len(tunes)
        tunes += [stated[i]] * (len(alike) != 1)
    _, first, number = np.unique(number, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return np.argsort(order)[number], [tunes[k] for k in order]


def _differ(name: str, first: Mapping[str, float], second: Mapping[str, float]) -> bool:
    """True if two tunes, or a tune and a file, contradict each other."""
    if name not in first or name not in second:
        return False
    apart = first[name] / second[name] - 1 if name in RELATIVE else first[name] - second[name]
    return bool(abs(apart if name in RELATIVE or name == "day" else within_half_a_turn(apart)) > OF_TUNE[name])


def _complete(known: list[dict[str, Any]], names: Sequence[str], told: list[str]) -> None:
    """Fill setpoint and free amplitude of files from others of one tune, and forget contradictory ones."""
    for name, settings in zip(names, known, strict=True):
        most = max(_ratios(settings), default=0.0)
        if most >= 1:
            told.append(f"{name}: the setpoint would be {most:.3g} of the recorded free amplitude, which is not used.")
            _forget(settings)
    filled, sentences = [dict(settings) for settings in known], list[str]()
    for quantity in FREE_AMPLITUDES:
        _fill(filled, names, quantity, sentences)
    contradicted = any(max(_ratios(settings), default=0.0) >= 1 for settings in filled)
    if contradicted:
        sentences = ["Recorded setpoints, free amplitudes and drive contradict each other: no free amplitude is used."]
    told += sentences
    for settings, more in zip(known, filled, strict=True):
        if contradicted:
            _forget(settings)
        else:
            settings.update(more)
        if "setpoint" not in settings and (ratios := _ratios(settings)):
            settings["setpoint"] = ratios[0]


def _ratios(settings: dict[str, Any]) -> list[float]:
    """The setpoint by everything that the file says of it."""
    ratios = [float(settings["setpoint"])] if "setpoint" in settings else []
    pairs = [(top, bottom) for top, bottom in PAIRS if top in settings and settings.get(bottom)]
    return ratios + [float(settings[top]) / float(settings[bottom]) for top, bottom in pairs]


def _forget(settings: dict[str, Any]) -> None:
    """Drop free amplitudes and setpoint from what a file says."""
    for name in (*FREE_AMPLITUDES, "setpoint"):
        settings.pop(name, None)


def _fill(known: list[dict[str, Any]], names: Sequence[str], quantity: str, told: list[str]) -> None:
    """Give files a free amplitude that do not say it, by the drive, or that of the others where those are alike."""
    stated = [float(one.get(quantity) or 0.0) > 0 for one in known]
    if all(stated) or not any(stated):
        return
    driven = all(float(one.get("drive_voltage") or 0.0) > 0 for one in known)
    drive = np.array([float(one["drive_voltage"]) if driven else 1.0 for one in known])
    gains = np.array([float(one[quantity]) / v for one, v, yes in zip(known, drive, stated, strict=True) if yes])
    if gains.max() > LINEAR * gains.min():
        return
    for settings, volts, yes in zip(known, drive, stated, strict=True):
        if not yes:
            settings[quantity] = float(np.median(gains) * volts)
    missing = ", ".join(name for name, yes in zip(names, stated, strict=True) if not yes)
    how = "it follows from the others by the voltage of the drive" if driven else "it is taken to be that of the others"
    sentence = f"The free amplitude of {missing} is not recorded: {how}."
    if sentence not in told:
        told.append(sentence)
