"""Parts of sentences that many messages have: counts with their share, sizes of images, lists with "and"."""

from __future__ import annotations

from collections.abc import Sequence

from phasemap._shared.units import readable


def counted(count: int, total: int, what: str) -> str:
    """Say how many of how many."""
    return f"{count} of {total} {what} ({100 * count / total:.3g} %)"


def image_size(shape: tuple[int, int], pixel_size: tuple[float, float]) -> str:
    """Say how large an image is, width first."""
    (ny, nx), (dy, dx) = shape, pixel_size
    unit = readable(max(nx * dx, ny * dy), "m")
    return f"{nx} x {ny} pixels, {nx * dx / unit.size:.4g} x {unit.say(ny * dy)}"


def listed(names: Sequence[str]) -> str:
    """List names as one speaks."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
