"""Findings of a series, in sentences, the most reliable first."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr

from phasemap._shared.arrays import Array
from phasemap.inference.determined import COMBINED, OPEN, UNLIKELY, chance, say_regions, say_what_helps
from phasemap.inference.images.stack import FREE, SHARED
from phasemap.inference.series.likelihood import SeriesProblem
from phasemap.inference.series.settings import ANYWHERE, HELD

CLEAR = 2.0  # standard errors above which a contrast has a sign
DOUBTFUL = 0.02  # chance of a chi2 as large for as many data, below which the fit is not said to be within errors
SURE = 0.9  # chance above which a branch, or a sign, is said without a doubt
NOTHING = "Find regions another way (by, labels), or give a smaller phase_error if slopes and tip leave less than that."
"""Advice where there is no contrast."""
EITHER = "on either branch"
NARROWED = 0.5  # width of an interval over that of the prior, below which data say something


def write_report(ds: xr.Dataset, problem: SeriesProblem, covariance: Array) -> None:
    """Write the verdict and the advice."""
    if not any(agreement(ds)[0]):
        ds.attrs |= {"verdict": _of_nothing(ds), "advice": NOTHING}
        return
    poor = is_poor(ds, problem)
    sentences = [*_of_order(ds, problem), _of_magnitude(ds, problem, poor), *regimes(ds), *turns(ds)]
    sentences += [_of_sign(ds, problem), *_of_tunes(ds, problem)]
    if not poor:
        names = [int(one) for one in ds["region"].values]
        sentences += say_regions(names, ds["determination"].values, covariance, problem.unknown)
        sentences.append(_of_amplitude(ds, problem))
    ds.attrs["verdict"] = "\n".join(filter(None, sentences))
    ds.attrs["advice"] = "\n".join(_advice(ds, problem, poor))


def is_poor(ds: xr.Dataset, problem: SeriesProblem) -> bool:
    """True if nothing within the prior describes the contrasts."""
    return bool(chance(float(ds["misfit"]), max(_contrasts(problem), 1)) < UNLIKELY)


def agreement(ds: xr.Dataset) -> tuple[list[bool], list[bool], list[bool]]:
    """Say of every file whether some contrast is clear, whether their signs, and the regions' order, are the fit's."""
    clear, signs, order = [], [], []
    for i in range(ds.sizes["file"]):
        measured, fitted = (ds[name].values[:, i] for name in ("measured_contrast", "fitted_contrast"))
        error = ds["contrast_error"].values[:, i]
        pairs = [(a, b) for a in range(len(measured)) for b in range(a) if np.isfinite(measured[a] - measured[b])]
        sure = [(a, b) for a, b in pairs if abs(measured[a] - measured[b]) > CLEAR * max(error[a], error[b])]
        clear.append(bool(sure))
        to_first = [a for a, b in sure if b == 0]
        signs.append(all(measured[a] * fitted[a] > 0 for a in to_first))
        order.append(all((measured[a] - measured[b]) * (fitted[a] - fitted[b]) > 0 for a, b in sure))
    return clear, signs, order


def regimes(ds: xr.Dataset) -> list[str]:
    """Sentences on the branch of every region, one each."""
    sentences = []
    for region in ds["region"].values:
        chances = ds["repulsive"].sel(region=region).values
        words = [_branch(one) for one in chances]
        if len(set(words)) == 1:
            sentences.append(f"Region {region} is {words[0]} in all files.")
            continue
        files = ds["file"].values
        parts = {word: [str(f) for f, one in zip(files, words, strict=True) if one == word] for word in words}
        listed = "; ".join(f"{word} in {', '.join(those)}" for word, those in parts.items())
        sentences.append(f"Region {region} is {listed}.")
    return sentences


def turns(ds: xr.Dataset) -> list[str]:
    """Sentences on contrasts that change sign, with the reason."""
    sentences = []
    measured, error = ds["measured_contrast"].values, ds["contrast_error"].values
    chances = ds["repulsive"].values
    for region in range(1, ds.sizes["region"]):
        clear = np.flatnonzero(np.abs(measured[region]) > CLEAR * error[region])
        for first, second in pairwise(clear):
            if measured[region, first] * measured[region, second] < 0:
                between = f"between {ds['file'].values[first]} and {ds['file'].values[second]}"
                why = _why(chances[:, first], chances[:, second], region)
                sentences.append(f"The contrast of region {region} turns {between}: {why}.")
        for curve in range(ds.sizes["curve"]):
            at = _crossings(ds["level"].values, ds["curve_contrast"].values[curve, region])
            if at:
                places = ", ".join(f"{one:.2f}" for one in at)
                many = f" at the free amplitude of {_files_of(ds, curve)}" if ds.sizes["curve"] > 1 else ""
                sentences.append(
                    f"The likeliest simulation turns the contrast of region {region} at setpoint {places}{many}."
                )
    return sentences


def _contrasts(problem: SeriesProblem) -> int:
    """Number of contrasts: data less the zeros that they have to give."""
    seen = np.isfinite(problem.errors)
    settings = problem.settings
    measured = seen.any(axis=0)
    if settings.zero == SHARED:
        return int(seen.sum()) - len(set(settings.tunes[measured]))
    return int(seen.sum()) - int((measured & ((settings.zero == FREE) | (settings.zero_errors >= ANYWHERE))).sum())


def _of_order(ds: xr.Dataset, problem: SeriesProblem) -> list[str]:
    """Sentences on the sign of the contrast, and the order of regions, in how many files they are reproduced."""
    clear, signs, order = agreement(ds)
    count = sum(clear)
    right = [sum(one and two for one, two in zip(clear, each, strict=True)) for each in (signs, order)]
    where = "the only file in which it is clear" if count == 1 else f"the {count} files in which it is clear"
    share = {count: "", 0: "not "}.get(right[0])
    sentence = f"The sign of the contrast is {share}reproduced in {where}"
    if share is None:
        sentence = f"The sign of the contrast is reproduced in {right[0]} of {where}"
    if ds.sizes["region"] > 2:
        sentence += f", the order of the regions in {right[1]}"
    measured, error = ds["measured_contrast"].values, ds["contrast_error"].values
    ways = set(np.sign(measured[np.abs(measured) > CLEAR * error]))
    if problem.settings.sign is None and len(ways) == 1:
        sentence += ", but the sign of the phase was free to make it so"
    faint = [str(name) for name, one in zip(ds["file"].values, clear, strict=True) if not one]
    return [sentence + ".", f"The contrast does not exceed its error in {', '.join(faint)}." if faint else ""]


def _of_nothing(ds: xr.Dataset) -> str:
    """Sentence on files without a clear contrast."""
    measured = np.abs(ds["measured_contrast"].values[1:])
    if not np.isfinite(measured).any():
        return "No file has two regions: there is nothing to explain."
    most, error = float(np.nanmax(measured)), float(np.nanmin(ds["contrast_error"].values[1:]))
    return (
        f"No file has a contrast of more than {CLEAR:g} standard errors: the largest is {most:.2g}°, the least error "
        f"{error:.2g}°. There is nothing to explain."
    )


def _of_magnitude(ds: xr.Dataset, problem: SeriesProblem, poor: bool) -> str:
    """Sentence on chi2: whether contrasts are reproduced within errors, and whether that proves anything."""
    data, unknown = _contrasts(problem), len(problem.names) - 1  # the discrepancy explains nothing
    what = "contrasts" if problem.settings.zero == FREE else "phases"
    if poor:
        return (
            f"The magnitude is not: chi2 is {float(ds['misfit']):.3g} for {data} {what}, whose errors would have to be "
            f"{float(ds['discrepancy']):.2g} times as large ({float(ds['discrepancy_low']):.2g} to "
            f"{float(ds['discrepancy_high']):.2g}). Lever, tip, settings, regions or the contact law are not those of "
            "the sample, or the errors are too small."
        )
    if data <= unknown:
        return (
            f"The magnitude is fitted, but that proves little: there are {unknown} unknowns for {data} {what}, "
            "and the prior decides what these leave open."
        )
    chi2 = float(ds["misfit"])
    if chance(chi2, data) < DOUBTFUL:
        return (
            f"The magnitude is hardly reproduced: chi2 is {chi2:.3g} for {data} {what} and {unknown} unknowns, which "
            f"errors as stated give once in {1 / chance(chi2, data):.2g} series."
        )
    return f"The magnitude is reproduced within its errors: {data} {what} for {unknown} unknowns."


def _of_tunes(ds: xr.Dataset, problem: SeriesProblem) -> list[str]:
    """Sentences on tunes that contradict the others."""
    tunes, sentences = problem.settings.tunes, []
    for tune in range(problem.settings.tune_count if problem.settings.tune_count > 1 else 0):
        mine = tunes == tune
        chi2, count = float(ds["file_misfit"].values[mine].sum()), int(np.isfinite(problem.errors[:, mine]).sum())
        if chance(chi2, max(count, 1)) < UNLIKELY:
            names = ", ".join(ds["file"].values[mine])
            sentences.append(
                f"The tune of {names} contradicts the others: chi2 is {chi2:.3g} for its {count} phases, with one "
                "sample and one lever in all. Explain it alone, or look for another tip."
            )
    return sentences


def _of_sign(ds: xr.Dataset, problem: SeriesProblem) -> str:
    """Sentence on the sign of the recorded phase, where it was free."""
    if problem.settings.sign is not None:
        return ""
    chance = float(ds["sign_chance"])
    if max(chance, 1 - chance) < SURE:
        return (
            f"The files do not tell which way the instrument counts phase (chance of positive where repulsive: "
            f"{100 * chance:.0f} %): regimes and materials are of both ways together."
        )
    which = "positive" if chance > 0.5 else "negative"
    return f"Phase is counted {which} where the tip is repulsive (chance {100 * max(chance, 1 - chance):.0f} %)."


def _of_amplitude(ds: xr.Dataset, problem: SeriesProblem) -> str:
    """Sentence on the free amplitude, where it was free."""
    if problem.settings.amplitude == HELD:
        return ""
    low, middle, high = (1e9 * float(ds[f"free_amplitude{word}"][0]) for word in ("_low", "", "_high"))
    prior = 2 * 1.96 * np.log(problem.settings.factor)
    sentence = f"The free amplitude of {ds['file'].values[0]} is {middle:.3g} nm ({low:.3g} to {high:.3g})"
    return sentence + (", which is what was supposed." if np.log(high / low) > NARROWED * prior else ".")


def _advice(ds: xr.Dataset, problem: SeriesProblem, poor: bool) -> list[str]:
    """Sentences on what would determine more, the most urgent first."""
    sentences, settings, free = [], problem.settings, problem.settings.zero == FREE
    if settings.sign is None:
        sentences.append("Say which way the instrument counts phase (sign).")
    if settings.amplitude != HELD:
        sentences.append("Calibrate the amplitude (free_amplitudes, in m).")
    if settings.setpoint != HELD:
        sentences.append("Record the free amplitude in the units of the setpoint (setpoints).")
    helps = say_what_helps(free, free)
    sentences += helps if np.isin(ds["determination"].values, (COMBINED, OPEN)).any() else helps[:-1]
    if poor:
        sentences.insert(0, "Look at the regions first, then at lever and tip radius: the fit takes them as they are.")
    return sentences


def _branch(chance: float) -> str:
    """Branch in a word, by the chance of the repulsive one."""
    if chance > SURE:
        return "repulsive"
    return "attractive" if chance < 1 - SURE else EITHER


def _why(before: Array, after: Array, region: int) -> str:
    """Reason why a contrast changes sign between two files."""
    moved, rest = [], []
    for r in (region, 0):
        first, last = _branch(before[r]), _branch(after[r])
        if EITHER in (first, last):
            rest.append(f"the branch of region {r} is not certain")
        elif first != last:
            moved.append(f"region {r} goes from {first} to {last}")
        else:
            rest.append(f"region {r} stays {last}")
    if moved:
        return " while ".join([" and ".join(moved), *rest])
    if "not certain" in "".join(rest):
        return "which region changes its branch is not certain"
    if _branch(after[region]) == _branch(after[0]):
        return f"both stay {_branch(after[0])}, and what they dissipate outweighs the other on either side"
    return "neither region changes its branch"


def _crossings(levels: Array, contrast: Array) -> list[float]:
    """Setpoints at which a contrast changes sign, by passing 0 or by a jump."""
    known = np.flatnonzero(np.isfinite(contrast) & (np.abs(contrast) > 1e-9))
    pairs = [(a, b) for a, b in pairwise(known) if b == a + 1 and contrast[a] * contrast[b] < 0]
    return [float(levels[a] - contrast[a] * (levels[b] - levels[a]) / (contrast[b] - contrast[a])) for a, b in pairs]


def _files_of(ds: xr.Dataset, curve: int) -> str:
    """Files that were taken at the free amplitude of a curve, in words."""
    files = ds["file"].values[ds["curve_of"].values == curve]
    return str(files[0]) if len(files) == 1 else f"{files[0]} to {files[-1]}"
