"""Findings of a comparison, in words: the same on the page and on the command line."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from phasemap._shared.units import say

WORTH_SAYING = 0.1  # share of the residual's variance
NOTABLE = 1.0  # degree, between the means of two images
MOSTLY = 0.5  # share of the measured variance
SIMILAR = 0.7, 1.4  # ratios between which contrasts are called the same


def names_of(ds: xr.Dataset) -> tuple[str, str]:
    """Names of the two images. `ds`: what `phasemap.compare` returned."""
    return ds.attrs["measured_name"], ds.attrs["simulated_name"]


def turned(ds: xr.Dataset) -> str:
    """Say that the sign of the phase was turned, and why; nothing if it was not."""
    if float(ds["sign"]) > 0:
        return ""
    first, second = names_of(ds)
    as_it_was = -float(ds["correlation"])
    how = ds.attrs.get("sign_from", "fitted")
    if how == "fitted":
        return (
            f"The sign of the {first} phase was TURNED, for that fits better: as recorded, its correlation with the "
            f"{second} one is {as_it_was:.2f}."
        )
    why = "as its file records" if how == "recorded" else "as given"
    return f"The {first} phase is counted the other way round, {why}."


def lines_of(ds: xr.Dataset) -> list[tuple[str, str]]:
    """Lines on a comparison: the subject, and a sentence on it."""
    first, second = names_of(ds)
    value = {name: float(ds[name]) for name in ds.data_vars if ds[name].ndim == 0}
    left_out, failed = int((ds["label"] < 0).sum()), int(value["failed_lines"])
    lines_left_out = f", of them {failed} {'lines' if failed > 1 else 'line'} unlike the neighbours" if failed else ""
    how = ds.attrs.get("sign_from", "fitted")
    counts = "the same sign" if value["sign"] > 0 else f"the other sign ({how})"
    lines = [
        ("differ in", differences_of(ds)),
        ("phases", _alike(value["correlation"], value["ssim"]) + ("" if value["sign"] > 0 else ", SIGN TURNED")),
        ("residual", f"{value['rmse']:.3g}° rms; histograms {value['wasserstein']:.3g}° apart (Wasserstein)"),
        ("zero, sign", f"zero of the {first} phase: {value['offset']:.2f}°; {counts}"),
        ("registration", _shift(ds)),
        ("left out", f"{left_out} of {ds['label'].size} pixels{lines_left_out}"),
    ]
    if ds.sizes["region"] > 1:
        share = 100 * value["region_share_of_variance"]
        for region in range(1, ds.sizes["region"]):
            pixels, (a, b) = 100 * float(ds["region_share"][region]), ds["region_contrast"][:2, region].values
            sentence = f"{a:+.3g}° against region 0, {second} {b:+.3g}°; {pixels:.0f} % of the pixels"
            lines.append((f"region {region}", sentence))
        lines.append(("regions", f"account for {share:.0f} % of the {first} variance"))
    for cause in ds["cause"].values[: 2 if math.isfinite(ds["crosstalk"][0, 1]) else 1]:
        shares = [100 * float(share) for share in ds["crosstalk"].sel(cause=cause)]
        each = ", ".join(
            f"{share:.0f} % of the {name}"
            for name, share in zip((first, second, "residual"), shares, strict=True)
            if math.isfinite(share)
        )
        lines.append((str(cause), f"explains {each} variance" if each else "explains nothing"))
    return lines


def differences_of(ds: xr.Dataset) -> str:
    """Name what differs between the images: regime, sign, zero, contrast, resolution."""
    first, second = names_of(ds)
    held = ds.attrs.get("offset_from", "fitted") != "fitted"
    differences = ["regime"] if held and _regimes(ds) else []
    if float(ds["sign"]) < 0 and ds.attrs.get("sign_from", "fitted") == "fitted":
        differences.append("sign of the phase")
    if held and apart(ds):
        differences.append(f"zero, by {apart(ds):+.3g}°")
    for region in range(1, ds.sizes["region"]):
        a, b = (float(one) for one in ds["region_contrast"][:2, region])
        if not SIMILAR[0] * abs(a) < b * math.copysign(1.0, a) < SIMILAR[1] * abs(a) and max(abs(a), abs(b)) > NOTABLE:
            differences.append(f"contrast of region {region}, {first} {a:+.3g}° and {second} {b:+.3g}°")
    fine = [_detail(ds[name].values) for name in ("measured", "simulated")]
    if not 0.5 < fine[1] / fine[0] < 2.0:
        differences.append(f"resolution, details of {fine[0]:.2g} and {fine[1]:.2g} pixels")
    same = "neither regime, sign, zero, contrast nor resolution" if held else "neither sign, contrast nor resolution"
    return "; ".join(differences) or same


def _detail(values: np.ndarray) -> float:
    """Size of the details of a map: pixels along a row over which its correlation, but for noise, falls to 0.8."""
    known = np.isfinite(values)
    means = np.nansum(values, axis=1, keepdims=True) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    apart = np.nan_to_num(values - means)
    power = np.square(np.abs(np.fft.rfft(apart, 2 * apart.shape[1], axis=1))).sum(axis=0)
    alike = np.fft.irfft(power)[1 : apart.shape[1] // 2]  # at no distance noise is alike too
    below = np.flatnonzero(alike < 0.8 * alike[0]) if alike[0] > 0 else np.array([])
    return float(1 + below[0]) if len(below) else float(apart.shape[1])


def verdict_of(ds: xr.Dataset) -> str:
    """Say in one to six sentences how much of the first image the second explains, and what is in the rest."""
    first, second = names_of(ds)
    explained = float(ds["explained"])
    if not math.isfinite(explained):
        return f"The {first} phase does not vary: there is nothing to explain."
    sentences = [f"The {second} image explains {100 * explained:.0f} % of the variance of the {first} phase."]
    if explained <= 0:
        sentences = [
            f"The {second} image explains nothing of the {first} phase: the difference varies more than the phase."
        ]
    if ds.sizes["region"] == 2 and float(ds["region_contrast"][0, 1]):
        a, b = ds["region_contrast"][:2, 1].values
        sentences.append(f"It has {100 * b / a:.0f} % of the contrast between the regions.")
    if ds.attrs.get("offset_from", "fitted") != "fitted":
        sentences += [_apart(ds), _regimes(ds)]
    slope = float(ds["crosstalk"].sel(map="measured", cause="slope"))
    if slope > MOSTLY:
        sentences.append(f"Slope alone explains {100 * slope:.0f} %: the {first} phase is mostly crosstalk.")
    causes = ds["crosstalk"].sel(map="residual")
    both = float(causes.sel(cause="both"))
    what, share = (
        ("Slope and amplitude error explain", both) if math.isfinite(both) else ("Slope explains", float(causes[0]))
    )
    if share > WORTH_SAYING:
        sentences.append(f"{what} {100 * share:.0f} % of what is left.")
    return " ".join(filter(None, [turned(ds), *sentences]))


def apart(ds: xr.Dataset) -> float:
    """Mean difference of the phases, if it is most of what is left; else 0 [degree]."""
    mean, spread = float(ds["residual"].mean()), float(ds["residual"].std())
    return mean if abs(mean) > max(spread, NOTABLE) else 0.0


def _apart(ds: xr.Dataset) -> str:
    """Sentence that the images are apart as a whole, where their zeros are held; else empty."""
    first, second = names_of(ds)
    mean, how = apart(ds), ds.attrs["offset_from"]
    return f"With the zero that is {how}, the {first} phase is {mean:+.3g}° from the {second} one on average." * bool(
        mean
    )


def _regimes(ds: xr.Dataset) -> str:
    """Say that most of one image is attractive where the other is repulsive, where the zeros are held."""
    first, second = names_of(ds)
    known = ds["residual"].notnull()
    below = [float((ds[name] < 0).where(known).mean()) for name in ("measured", "simulated")]
    if abs(below[0] - below[1]) <= MOSTLY:
        return ""
    first_regime, second_regime = (
        f"{'attractive' if share > MOSTLY else 'repulsive'} in {100 * max(share, 1 - share):.0f} % of the pixels"
        for share in below
    )
    return (
        f"The {first} phase is {first_regime}, the {second} one {second_regime}: bring the simulation into the same "
        "regime first, by setpoint, free amplitude or adhesion."
    )


def _alike(correlation: float, ssim: float) -> str:
    """Correlation and structural similarity, or why there are none."""
    text = f"correlation {correlation:.3f}" if math.isfinite(correlation) else "no correlation, for one does not vary"
    return text + (f", SSIM {ssim:.3f}" if math.isfinite(ssim) else ", no SSIM")


def _shift(ds: xr.Dataset) -> str:
    """Result of the registration, in words."""
    reason = ds.attrs["registration"]
    if not int(ds["registered"]):
        return f"not shifted: {reason}"
    parts = [
        f"{say(abs(float(ds[name])), 'm', 3)} {words[float(ds[name]) < 0]}"
        for name, words in (("shift_x", ("right", "left")), ("shift_y", ("down", "up")))
        if float(ds[name])
    ]
    return f"shifted {' and '.join(parts)}: {reason}"
