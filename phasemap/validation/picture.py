"""Image before offsets of lines and quantisation, and the verdict on its claims."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.realism import DIGITISED
from phasemap.imaging.imperfections import finish
from phasemap.results.variables import FLAGS, FLOATS
from phasemap.validation.claims import Claims

# Three standard errors of a mean over a hundred times that the lock-in remembers, in standard deviations behind it.
MEAN = 0.3

HOLDS, FAILS, OPEN = "holds", "FAILS", "not judged"
SHOWN = 3  # of the pixels that fail
WIDTH = 62  # of what was found, in letters
PAGE = 100  # of what stands below the table
LAYOUT = "{:<46}  {:<10}  {:>9}  "


@dataclass(frozen=True, eq=False)
class Picture:
    """The variables of an image, each of shape (directions, ny, nx) also where there is one direction only."""

    image: xr.Dataset  # of the dims and shape that `claims` has
    claims: Claims

    @property
    def shape(self) -> tuple[int, int, int]:
        """Directions, rows and columns."""
        return (max(len(self.claims.control.directions), 1), *self.claims.shape)

    def __contains__(self, name: str) -> bool:
        return name in self.image.data_vars

    def has(self, *names: str) -> bool:
        """True if the image has all of these variables."""
        return all(name in self for name in names)

    def raw(self, name: str) -> NDArray[Any]:
        """The values in the file."""
        return self.image[name].values.reshape(self.shape)

    def __getitem__(self, name: str) -> Array:
        """The values less the random offsets of lines, which the seed gives again."""
        values = self.raw(name)
        return np.asarray(values - self._offsets[name] if name in self._offsets else values)

    @cached_property
    def _offsets(self) -> dict[str, Array]:
        """Offsets of lines, by name of the variable."""
        realism = replace(self.claims.realism, bits=None)
        flat = {name: xr.zeros_like(self.image[name]) for name in ("height", "phase") if name in self}
        added = finish(xr.Dataset(flat), realism)
        return {name: added[name].values.reshape(self.shape) for name in flat if "comment" in added[name].attrs}

    def coarse(self, name: str) -> float:
        """Half the step of the quantisation, in the variable's unit; 0 without one, or without the variable."""
        bits = self.claims.realism.bits
        if bits is None or name not in DIGITISED or name not in self:
            return 0.0
        values = self.raw(name)
        known = values[np.isfinite(values.astype(np.float64))].astype(np.float64)
        return 0.5 * float(np.ptp(known)) / (2**bits - 1) if known.size else 0.0

    @cached_property
    def good(self) -> NDArray[np.bool_]:
        """True where the status is good."""
        return np.asarray(self.raw("status") == col.GOOD)

    @cached_property
    def solved(self) -> NDArray[np.bool_]:
        """True where there should be numbers: good pixels, and those of a scanner at the end of its range."""
        kept = [col.GOOD, col.OUT_OF_RANGE] if self.claims.control.in_time else [col.GOOD]
        return np.isin(self.raw("status"), kept)

    @cached_property
    def irregular(self) -> NDArray[np.bool_]:
        """True where the motion is said to be irregular."""
        return np.asarray(self.raw("motion") == 1) if "motion" in self else np.zeros(self.shape, bool)

    @cached_property
    def averaged(self) -> NDArray[np.bool_]:
        """True where phase and amplitude are means: where motion is irregular, or spread by no more than it may be."""
        return self.irregular | (self.spread("phase") > 0) | (self.spread("amplitude") > 0)

    def spread(self, name: str) -> Array:
        """Standard deviation behind the lock-in that the image states [degree or m], 0 where it states none."""
        stated = f"{name}_spread"
        return np.asarray(np.nan_to_num(self.raw(stated))) if stated in self else np.zeros(self.shape)

    def floats(self) -> list[str]:
        """Names of the float variables, in the order of the image."""
        return [str(name) for name in self.image.data_vars if name in FLOATS and name not in FLAGS]

    def places(self, places: Sequence[tuple[int, int, int]]) -> str:
        """Text with the places of pixels."""
        names = self.claims.control.directions
        return "; ".join(f"row {y}, column {x}" + (f" ({names[d]})" if names else "") for d, y, x in places)


@dataclass(frozen=True)
class Claim:
    """Claim of an image on itself, and whether it holds."""

    about: str  # the claim, in words
    # "holds" or "FAILS" or "not judged"; "not judged" where nothing was claimed that could be contradicted, or
    # what could contradict it comes to no result
    result: str
    pixels: int  # in how many pixels it was looked at
    found: str = ""  # what was found, in words
    # Direction, row and column of the pixels that contradict it most, none where it holds
    worst: tuple[tuple[int, int, int], ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Check:
    """Verdict of `phasemap.check`, with its claims.

    Attributes
    ----------
    claims : tuple of Claim
    sample : xarray.Dataset or None
        The pixels that were solved again, dim "pixel": direction, row, column; phase, height and more as in the image,
        but for offsets of lines, and as found again; the difference that was allowed. None for an image in time.
    judged : str
        Which pixels were judged, and how.
    unseen : str
        What no claim can see.
    """

    claims: tuple[Claim, ...]
    sample: xr.Dataset | None = None
    judged: str = ""
    unseen: str = ""

    @property
    def holds(self) -> bool:
        """True if no claim fails."""
        return all(claim.result != FAILS for claim in self.claims)

    @property
    def verdict(self) -> str:
        """Sentence on how many claims hold."""
        failed = [claim for claim in self.claims if claim.result == FAILS]
        if failed:
            return f"{len(failed)} of {len(self.claims)} claims FAIL. Do not trust this file."
        left = sum(claim.result == OPEN for claim in self.claims)
        sentence = f"{len(self.claims) - left} claims hold, none fails"
        return sentence + (f"; {left} could not be judged." if left else ".")

    def __repr__(self) -> str:
        return f"Check({self.verdict})"

    def __str__(self) -> str:
        """Table of the claims and their results, and the verdict."""
        lines = [LAYOUT.format("claim", "result", "pixels") + "what was found"]
        for claim in self.claims:
            texts = textwrap.wrap(claim.found, WIDTH) or [""]
            about = textwrap.wrap(claim.about, 46)
            for i in range(max(len(texts), len(about))):
                first = (claim.result, claim.pixels or "") if i == 0 else ("", "")
                columns = LAYOUT.format(about[i] if i < len(about) else "", *first)
                lines.append((columns + (texts[i] if i < len(texts) else "")).rstrip())
        below = {"judged": self.judged, "unseen": self.unseen, "verdict": self.verdict}
        for word, text in below.items():
            if text:
                lines += ["", textwrap.fill(f"{word:<7}  {text}", PAGE, subsequent_indent=" " * 9)]
        return "\n".join(lines)


def judged(about: str, picture: Picture, bad: np.ndarray, by: np.ndarray, looked_at: np.ndarray, text: str) -> Claim:
    """The claim that no pixel is bad, shape (directions, ny, nx); not judged where there is none to look at.

    `by`: how bad each is; the worst are named. `text`: what there is to say where it holds.
    """
    pixels, bad = int(np.count_nonzero(looked_at)), bad & looked_at
    count = int(np.count_nonzero(bad))
    if not pixels:
        return Claim(about, OPEN, 0, "there is no such pixel")
    if not count:
        return Claim(about, HOLDS, pixels, text)
    at = np.flatnonzero(bad)
    how = np.nan_to_num(by.reshape(-1)[at].astype(np.float64), nan=np.inf)
    worst_places = at[np.argsort(-how, kind="stable")[:SHOWN]]
    worst = tuple((int(d), int(y), int(x)) for d, y, x in zip(*np.unravel_index(worst_places, bad.shape), strict=True))
    return Claim(about, FAILS, pixels, f"in {pixels_in_words(count)}, at worst at {picture.places(worst)}", worst)


def pixels_in_words(count: int) -> str:
    """A number of pixels."""
    return "1 pixel" if count == 1 else f"{count} pixels"
