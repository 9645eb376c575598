"""A page that lies beside the file of an ensemble: what is in it, how it was made, and what it is good for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.units import UDUNITS, WRITTEN, say
from phasemap.scenes.keys import unit_of
from phasemap.scenes.samples import Choice, Law, Range, laws_of
from phasemap.scenes.scene import Scene

Table = Mapping[str, Any]

LONGEST = 60  # letters of a value that are shown
NOT_CHOSEN = (
    "Not chosen: `licence` under `[ensemble]` in the scene names one. phasemap claims nothing of what it computes; the "
    "images are of whoever made them, and maps that the scene reads from files of whoever made these."
)


def card_beside(path: Path) -> Path:
    """Where the card of a file lies."""
    return path.with_name(f"{path.name}.card.md")


def data_card(path: Path, ds: xr.Dataset, tables: Table, samples: Sequence[Table], first: Scene) -> str:
    """Describe the images of an ensemble in Markdown: its scene, [ensemble] included, and the varied values."""
    ensemble = tables["ensemble"]
    (ny, nx), (dy, dx) = first.surface.shape, first.surface.pixel_size
    source = f"`{ensemble['table']}`" if "table" in ensemble else f"drawn with the seed {ensemble.get('seed', 0)}"
    lines = [
        f"# {path.name}", "",
        f"{len(samples)} synthetic phase images of tapping-mode AFM with the truth behind each: {nx} x {ny} pixels, "
        f"{nx * dx * 1e9:.4g} x {ny * dy * 1e9:.4g} nm, made by phasemap {ds.attrs['phasemap_version']}. What differs "
        f"between them is {source}. The same scene, seed and version give the same numbers; the scene is JSON in the "
        "attribute `scene`.", "",
        "## What is in it", "",
        "Row 0 is the top of the image; pixels without a solution are NaN, and `status` says why.", "",
        "| variable | over | unit | what |", "|---|---|---|---|", *_variables(ds), "",
        "## What differs", "", "| key | from | drawn |", "|---|---|---|", *_varied(ensemble, samples), "",
        "## What is the same in all", "", *_fixed(tables, samples[0]), "",
        "## Known limits", "", *(f"* {one}" for one in _limits(ds, samples[0], first)), "",
        "## Licence", "", str(ensemble.get("licence", NOT_CHOSEN)),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _variables(ds: xr.Dataset) -> Iterator[str]:
    """A row for each variable and each coordinate that is no axis."""
    for name, one in ds.variables.items():
        if name in ds.dims:
            continue
        what = str(one.attrs.get("long_name", ""))
        if one.attrs.get("flag_meanings"):
            codes = (int(code) for code in _list_of(one.attrs.get("flag_values", one.attrs.get("flag_masks"))))
            meanings = str(one.attrs["flag_meanings"]).split()
            what += ": " + ", ".join(f"{code} {word}" for code, word in zip(codes, meanings, strict=False))
        unit = WRITTEN.get(one.attrs.get("units", ""), one.attrs.get("units", ""))
        yield f"| `{name}` | {', '.join(map(str, one.dims))} | {unit} | {what} |"


def _list_of(values: Any) -> list[Any]:
    """Codes of flags; a single one comes back from a file as a number."""
    return list(np.atleast_1d(values))


def _varied(ensemble: Table, samples: Sequence[Table]) -> Iterator[str]:
    """A row for each key that is varied: what it was drawn from, and which values came out."""
    laws: dict[str, Law] = dict(laws_of(ensemble["vary"])) if "vary" in ensemble else {}
    for key in samples[0]:
        values = [sample[key] for sample in samples]
        numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
        drawn = _interval(key, min(values), max(values)) if numbers else f"{len(set(map(str, values)))} values"
        yield f"| `{key}` | {_said(key, laws.get(key))} | {drawn} |"


def _said(key: str, law: Law | None) -> str:
    """What a key is drawn from."""
    if isinstance(law, Range):
        how = "whole numbers" if law.whole else "logarithm uniform" if law.scale == "log" else "uniform"
        return f"{_interval(key, law.low, law.high)}, {how}"
    if isinstance(law, Choice):
        return _short(", ".join(map(str, law.options)))
    return "the table"


def _interval(key: str, low: float, high: float) -> str:
    units = UDUNITS.get(unit_of(key), unit_of(key)) or "1"
    if units == "1" or not all(map(math.isfinite, (low, high))):
        return f"{low:.6g} to {high:.6g}"
    return f"{say(low, units)} to {say(high, units)}"


def _fixed(tables: Table, varied: Table, prefix: str = "") -> Iterator[str]:
    """A line for each key of the scene that no sample has of its own."""
    for name, value in tables.items():
        key = f"{prefix}{name}"
        if key in varied or (not prefix and name in ("ensemble", "output")):
            continue
        if isinstance(value, Mapping):
            yield from _fixed(value, varied, f"{key}.")
        else:
            yield f"    {key} = {_short(repr(value))}"


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 2]} …"


def _limits(ds: xr.Dataset, varied: Table, first: Scene) -> Iterator[str]:
    """What must not be taken for more than it is."""
    failed, pixels = int(ds["failed"].sum()), ds["status"].size
    yield f"Simulated, not measured. {failed} of {pixels} pixels have no solution."
    if "irregular" in ds and (irregular := int(ds["irregular"].sum())):
        yield f"{irregular} pixels show the mean of motion that is not periodic (`motion`)."
    control, realism = first.options["control"], first.options["realism"]
    if not control.in_time:
        yield "The feedback is perfect and at rest at every pixel: no lag, no amplitude error, no noise in time."
    elif realism.temperature is None and realism.detector_noise is None:
        yield "Scanned in time, without noise of lever or detector."
    if realism != type(realism)() and "realism.seed" not in varied:
        yield "The noise is the same in all images: `realism.seed` is not varied."
    if any(key.startswith("surface.") for key in varied):
        yield "No part is set aside for tests: samples with the same surface belong into one part."
    else:
        yield "All images are of the same surface: nothing learnt from them is known to hold on another."
    yield "Lever, tip and contact law are exact, and there is no tilt, bow or creep; see the page on limits."
