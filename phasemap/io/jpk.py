"""What JPK files hold beside the images, in tags of their TIFF directories that Gwyddion passes over.

A channel has slots, calibrations one on top of the other: counts, volts, metres. A slot takes 48 tags, among them its
name, the name of the slot that it is based on, its unit, and the factor by which it multiplies counts.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from phasemap.io.gwyddion import extra

TIFF = (b"II*\0", b"MM\0*")
CHANNEL, SLOTS = 0x8050, 0x8080  # tags of a channel: its name, how many slots it has
FIRST, LENGTH = 0x8090, 48  # tags of a slot: where the first one's begin, and how many there are
NAME, BASE, UNIT, SCALING, FACTOR, OFFSET = 0x00, 0x02, 0x12, 0x13, 0x14, 0x15  # from where a slot begins
MOST = 32  # slots; files have two to four
SETPOINT_SLOT = re.compile(rb"setpoint-feedback-settings\.setpoint-slot : (\w+)")


def amplitude_sensitivity(path: Path) -> float | None:
    """The sensitivity [m/V] by which a JPK file makes metres of the amplitude in the volts of its setpoint.

    Returns None where the file has no amplitude in metres, or one that is not based on the setpoint's slot.
    """
    if not path.is_file():
        return None
    said = SETPOINT_SLOT.search(path.read_bytes())
    for tags in _directories(path):
        if tags.get(CHANNEL) != "amplitude":
            continue
        for slot in (slots := _slots(tags)).values():
            base = slots.get(slot["base"])
            if slot["unit"] != "m" or base is None or base["unit"] != "V":
                continue
            if said is None or said[1].decode("ascii") == slot["base"]:
                return float(abs(slot["factor"] / base["factor"]))
    return None


def is_quantitative_imaging(path: Path) -> bool:
    """Whether a file is an image made of force curves, one in each pixel (JPK's QI)."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(4) in TIFF and b"quantitative-imaging-settings" in file.read()


def _slots(tags: dict[int, Any]) -> dict[str, dict[str, Any]]:
    """The slots of a channel that are proportional to its counts, by their names."""
    found = {}
    slots = tags.get(SLOTS)
    if not isinstance(slots, int):
        return {}
    for at in range(FIRST, FIRST + LENGTH * min(slots, MOST), LENGTH):
        factor, offset = tags.get(at + FACTOR), tags.get(at + OFFSET)
        if tags.get(at + SCALING) == "LinearScaling" and isinstance(factor, float) and factor and offset == 0:
            found[str(tags.get(at + NAME))] = {
                "base": tags.get(at + BASE), "unit": tags.get(at + UNIT), "factor": factor,
            }  # fmt: skip
    return found


def _directories(path: Path) -> Iterator[dict[int, Any]]:
    """The tags of each directory; none of a damaged file."""
    tifffile = extra("tifffile", "reading measured files", "read")
    try:
        with _silent("tifffile"), tifffile.TiffFile(path) as file:
            pages = [[(tag.code, tag.value) for tag in page.tags] for page in file.pages]
    except Exception:  # as of whatever is met in a damaged file, of which Gwyddion has read the image
        return
    for page in pages:  # what is not one text or one number is another program's, or damaged
        yield {code: value for code, value in page if isinstance(value, (str, int, float))}


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Keep a library from writing what it finds odd in a file."""
    logger = logging.getLogger(name)
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before
