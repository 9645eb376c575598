"""Channels of a microscope's file, through Gwyddion's 170 file modules.

The packages ``gwyddionpy`` and ``gwyddionpy-converter`` come with ``pip install "afm-phasemap[read]"``; nothing else of
phasemap knows them. A .gwy file is converted, too: the reader of Python believes every length in it, and never ends
where some are wrong; Gwyddion checks them.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from phasemap._shared.errors import FileError, PhasemapError
from phasemap._shared.memory import check_fits

PICTURES = (b"\x89PNG", b"\xff\xd8\xff", b"GIF8")  # of which a small file may unpack to gigabytes
HEAD = 1 << 18  # bytes of a file that say what it is
OTHER_KINDS = {
    b"PK\x03\x04": "an archive, as JPK keeps curves (read_curve), not an image",
    b"%PDF": "a PDF document, not an image",
    b"\x89HDF": "an HDF5 file of a kind that Gwyddion does not read", b"\x1f\x8b": "compressed: unpack it first",
    b"BM": "a picture, which has no units", b"\x93NUMPY": "an array of NumPy, which has no units",
}  # fmt: skip
"""Kinds of files that hold no image, by the bytes that they begin with."""
COLOURS = {"Red", "Green", "Blue", "Alpha", "Gray"}  # channels of a picture, as Gwyddion names them
NATIVE = b"GWYP"  # how a .gwy file begins
COPIES = 4  # of a .gwy file in memory while it is read
MASKED = "masked pixels have no value"
"""Said by the metadata of a .gwy file whose masks hide pixels, rather than mark some that the user chose."""

_NUMBERS = re.compile(rb"[\x00-\x08\x0e-\x1f]")  # bytes that no text has
_NUMBERED = re.compile(r"\s*\(\d+\)$")  # as Gwyddion tells equal names apart
_DIRECTION = re.compile(
    r"[\s_]*[\[(]?(retrace|trace|backward|forward|left to right|right to left)[\])]?", re.IGNORECASE
)
_DIRECTIONS = {"trace": "trace", "forward": "trace", "retrace": "retrace", "backward": "retrace",
               "left to right": "trace", "right to left": "retrace"}  # fmt: skip
_DIRECTION_KEYS = ("Line Direction", "Line direction", "General Info::X scanning direction")  # Bruker, Park, WSxM
_SAID = (r"cannot load '.*': (.+)", r"file \((.+?)\)\. Possible")  # within what the reader says of a file
_NO_REASON = re.compile(r"unknown error|No module can load|Data deserialization failed|[A-Za-z_.]*Error\b")


@dataclass(frozen=True)
class Channel:
    """An image of a file."""

    name: str  # as the file has it, such as ``"PhaseRetrace"``
    data: np.ndarray  # shape (rows, columns); in `unit`, row 0 at the top; NaN where there is no value
    # unit, lateral_unit: SI units
    unit: str
    lateral_unit: str
    size: tuple[float, float]  # height and width of the whole image, in `lateral_unit`
    metadata: Mapping[str, str]  # the vendor's own

    @property
    def direction(self) -> str:
        """Return "trace" or "retrace", or "" where the file does not say."""
        stated = next((self.metadata[key] for key in _DIRECTION_KEYS if self.metadata.get(key)), "")
        match = _DIRECTION.search(stated) or _DIRECTION.search(self.name)
        return _DIRECTIONS[match[1].lower()] if match else ""

    @property
    def base(self) -> str:
        """The name without its direction: ``"Phase"``."""
        return _DIRECTION.sub("", _NUMBERED.sub("", self.name)).strip()


def load_channels(path: Path) -> list[Channel]:
    """Read every image of a file, without those of a second pass over the line (interleave)."""
    if os.path.isdir(path):
        raise FileError(f"cannot read {path}: it is a folder.")
    if not os.path.isfile(path):  # nor is a name that is no name
        raise FileError(f"cannot read {path}: there is no such file.")
    if not path.stat().st_size:
        raise FileError(f"cannot read {path}: it is empty.")
    reader = extra("gwyddionpy", "reading measured files", "read")
    with path.open("rb") as file:
        head = file.read(8)
    if head.startswith(PICTURES):
        raise FileError(f"cannot use {path}: it is a picture, which has no units.")
    native = head.startswith(NATIVE)
    try:
        with tempfile.TemporaryDirectory() as folder:
            converted = Path(folder, "converted.gwy")
            reader.run_converter(path, converted)
            check_fits(f"{path}, read,", COPIES * converted.stat().st_size, "Take a smaller part of the image.")
            raw = list(reader.parse_gwy(converted).channels.values())
            masks = _masks(converted, native)
            with np.errstate(all="ignore"):  # of bytes that are not numbers
                data = [np.where(mask, np.nan, one.data) * _volts(one) for one, mask in zip(raw, masks, strict=True)]
    except reader.ConverterNotFoundError as error:
        raise PhasemapError(
            'reading measured files needs the package "gwyddionpy-converter": run pip install "afm-phasemap[read]".'
        ) from error
    except PhasemapError:
        raise
    except Exception as error:  # the readers pass on what they meet where a file is damaged
        raise FileError(f"cannot read {path}: {_other_kind(path) or _reason(str(error))}.") from error
    channels = []
    for channel, values in zip(raw, data, strict=True):
        if channel.meta.get("Scan Line") != "Interleave":
            metadata = {key: _repaired(value) for key, value in channel.meta.items()}
            units, sides = (channel.si_unit_z, channel.si_unit_xy), (channel.yreal, channel.xreal)
            channels.append(Channel(channel.name, values, *units, sides, metadata))
    if channels and {one.name for one in channels} <= COLOURS:
        raise FileError(f"cannot use {path}: it is a picture, which has no units.")
    if not channels:
        raise FileError(f"cannot use {path}: {_other_kind(path) or 'it holds no image'}.")
    return channels


def merged(channels: Iterable[Channel]) -> dict[str, str]:
    """Metadata of all channels; the first that has a key says it."""
    every: dict[str, str] = {}
    for channel in reversed(list(channels)):
        every.update(channel.metadata)
    return every


def extra(module: str, purpose: str, name: str) -> Any:
    """Import an optional package, or say that ``purpose`` needs it and the extra that brings it along."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise PhasemapError(f'{purpose} needs {package!r}: run pip install "afm-phasemap[{name}]".') from error


def _other_kind(path: Path) -> str:
    """Sentence on the kind of a file that holds no image; empty where it is not known."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    for mark, what in OTHER_KINDS.items():
        if head.startswith(mark):
            return f"it is {what}"
    if re.match(rb"\s*<(!doctype )?html", head, re.IGNORECASE):
        return "it is a web page, as a download leaves it that failed"
    if b"*Force file list" in head:
        return "it is a force curve of NanoScope, not an image (read_curve)"
    if path.suffix.lower() == ".nid" and re.search(rb"Dim0Name=Frequency", head):
        return "it is a resonance curve, not an image"
    if path.suffix.lower() == ".ibw" and len(head) > 148 and head[:2] == b"\x05\0":
        points = [int.from_bytes(head[at : at + 4], "little") for at in (132, 136)]
        if points[0] and not points[1]:
            return f"it is a curve of {points[0]} points, not an image"
    is_text = head.strip() and not head.startswith(NATIVE) and not _NUMBERS.search(head)
    return "it is text, with no image in it" if is_text else ""


def _reason(error: str) -> str:
    """Reason why a file cannot be read, in words for its user."""
    reason = next((found[1].rstrip(".") for found in (re.search(form, error) for form in _SAID) if found), "")
    if not reason or _NO_REASON.match(reason):
        return "it is damaged, cut short, or of no format that Gwyddion reads"
    return reason


def _volts(channel: Any) -> float:
    """Factor to volts for a NanoScope channel that Gwyddion, without a sensitivity, leaves in millivolts."""
    sensitivity = channel.meta.get("Sens. " + re.sub(r"(?<=[a-z])(?=[A-Z])", " ", channel.name), "")
    scale = channel.meta.get("2:Z scale", "")
    return 1e-3 if channel.si_unit_z == "V" and scale.endswith("mV") and "/" not in sensitivity else 1.0


def _masks(path: Path, native: bool) -> list[np.ndarray | bool]:
    """Hidden pixels of each channel; pixels under a mask that a user drew in Gwyddion are not hidden."""
    container = import_module("gwyfile").load(str(path))
    numbers = sorted(int(key.split("/")[1]) for key in container if re.fullmatch(r"/\d+/data", key))
    hiding = [not native or MASKED in container.get(f"/{n}/meta", {}).values() for n in numbers]
    masks = [container.get(f"/{n}/mask") if hides else None for n, hides in zip(numbers, hiding, strict=True)]
    return [mask is not None and np.asarray(mask.data) > 0 for mask in masks]


def _repaired(text: str) -> str:
    """Undo UTF-8 that was taken for latin-1: ``"3.97Âµm"``."""
    try:
        return text.encode("latin-1").decode("utf-8")
    except UnicodeError:
        return text
