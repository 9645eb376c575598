"""What came of a check: claims one by one, and the verdict."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np
import xarray as xr

from phasemap.validation.checking.picture import Picture

HOLDS, FAILS, OPEN = "holds", "FAILS", "not judged"
SHOWN = 3  # of the pixels that fail
WIDTH = 62  # of what was found, in letters
PAGE = 100  # of what stands below the table
LAYOUT = "{:<46}  {:<10}  {:>9}  "


@dataclass(frozen=True)
class Claim:
    """One thing that an image says of itself."""

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
    """What `phasemap.check` found.

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
        """Whether no claim fails."""
        return all(claim.result != FAILS for claim in self.claims)

    @property
    def verdict(self) -> str:
        """One sentence."""
        failed = [claim for claim in self.claims if claim.result == FAILS]
        if failed:
            return f"{len(failed)} of {len(self.claims)} claims FAIL. Do not trust this file."
        left = sum(claim.result == OPEN for claim in self.claims)
        said = f"{len(self.claims) - left} claims hold, none fails"
        return said + (f"; {left} could not be judged." if left else ".")

    def __repr__(self) -> str:
        """The verdict."""
        return f"Check({self.verdict})"

    def __str__(self) -> str:
        """The table of claims, what was judged, and the verdict."""
        lines = [LAYOUT.format("claim", "result", "pixels") + "what was found"]
        for claim in self.claims:
            found = textwrap.wrap(claim.found, WIDTH) or [""]
            about = textwrap.wrap(claim.about, 46)
            for i in range(max(len(found), len(about))):
                first = (claim.result, claim.pixels or "") if i == 0 else ("", "")
                said = LAYOUT.format(about[i] if i < len(about) else "", *first)
                lines.append((said + (found[i] if i < len(found) else "")).rstrip())
        below = {"judged": self.judged, "unseen": self.unseen, "verdict": self.verdict}
        for word, text in below.items():
            if text:
                lines += ["", textwrap.fill(f"{word:<7}  {text}", PAGE, subsequent_indent=" " * 9)]
        return "\n".join(lines)


def judged(about: str, picture: Picture, bad: np.ndarray, by: np.ndarray, looked_at: np.ndarray, found: str) -> Claim:
    """The claim that no pixel is bad; not judged where there is none to look at.

    `bad`, `looked_at` (shape (directions, ny, nx)).
    `by`: how bad each is, of that shape; the worst are named. `found`: what there is to say where it holds.
    """
    pixels, bad = int(np.count_nonzero(looked_at)), bad & looked_at
    count = int(np.count_nonzero(bad))
    if not pixels:
        return Claim(about, OPEN, 0, "there is no such pixel")
    if not count:
        return Claim(about, HOLDS, pixels, found)
    at = np.flatnonzero(bad)
    how = np.nan_to_num(by.reshape(-1)[at].astype(np.float64), nan=np.inf)
    some = at[np.argsort(-how, kind="stable")[:SHOWN]]
    worst = tuple((int(d), int(y), int(x)) for d, y, x in zip(*np.unravel_index(some, bad.shape), strict=True))
    return Claim(about, FAILS, pixels, f"in {pixels_in_words(count)}, at worst at {picture.places(worst)}", worst)


def pixels_in_words(count: int) -> str:
    """A number of pixels."""
    return "1 pixel" if count == 1 else f"{count} pixels"
