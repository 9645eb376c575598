r"""Curves of NanoScope: a header of lines that begin with a backslash, and channels of integers behind it.

Each ``\*Ciao force image list`` is a channel: where its numbers are, how many on the way there and back
(``Samps/line``), and a value parameter ``Z scale: V [soft scale] (hard scale) hard value``. A number times the hard
scale is in volts, or in degrees; the soft scale names a parameter that makes a length of volts (NanoScope 8.10 user
guide, "CIAO parameter objects"). Both ways have the same distances, in equal steps of the ``Ramp size``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap.io.curve_columns import DIRECTIONS, NAMES, Parts, quantity_of
from phasemap.io.metadata import ScanData, quantity
from phasemap.io.vendors import scan_data

MARK = b"\\*Force file list"
END = b"\\*File list end"
CHANNEL = "Ciao force image list"
WIDE = 0x09200000  # version from which every number has 32 bits, whatever "Bytes/pixel" says
VALUE = re.compile(r"V\s*(?:\[(?P<soft>[^\]]*)\])?\s*(?:\((?P<hard>[^)]*)\))?\s*(?P<value>.*)")
SCALE = re.compile(r"(?P<number>[-+0-9.eE]+)\s*(?P<unit>[^/\s]+)\s*/\s*LSB")
SELECT = re.compile(r'S\s*\[(?P<inside>[^\]]*)\]\s*"(?P<outside>[^"]*)"')
Fields = dict[str, str]


class Value(NamedTuple):
    """A value parameter."""

    soft: str  # name of the parameter that makes a soft value of it, or nothing
    scale: float  # of a stored number, to `unit`
    unit: str
    value: str  # hard value with its unit


def is_nanoscope(path: Path) -> bool:
    """Whether a file is a curve of NanoScope."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MARK)) == MARK


def of_nanoscope(path: Path, number: int) -> tuple[Parts, ScanData]:
    """The channels of curve `number` of a file, and what its header says."""
    content = path.read_bytes()
    head, end, _ = content.partition(END)
    if not end:
        raise FileError(f"cannot read {path}: its header has no end: it is cut short.")
    every, channels = _sections(head.decode("latin-1"))
    if not channels:
        raise FileError(f"cannot use {path}: its header lists no channel of a curve.")
    known: Fields = {}
    for fields in reversed(every):
        known |= fields
    try:
        parts = _parts(path, content, known, channels, number)
    except PhasemapError:
        raise
    except (KeyError, ValueError, StopIteration, OverflowError) as error:
        raise FileError(f"cannot read {path}: its header is damaged ({error}).") from error
    return parts, _said(path, known)


def _sections(head: str) -> tuple[list[Fields], list[Fields]]:
    """The parameters of every section, without their group number, and those of the channels alone."""
    every: list[Fields] = []
    channels: list[Fields] = []
    for line in head.splitlines():
        line = line.removeprefix("\\")
        if line.startswith("*"):
            every.append({})
            if line.removeprefix("*").strip() == CHANNEL:
                channels.append(every[-1])
        elif every and ":" in line:
            key, value = re.sub(r"^@(?:\d+:)?", "", line).split(":", 1)
            every[-1].setdefault(key.strip(), value.strip())
    return every, channels


def _parts(path: Path, content: bytes, known: Fields, channels: list[Fields], number: int) -> Parts:
    """Distance and channels of both ways, without the points that the instrument did not fill."""
    found: dict[str, tuple[NDArray[np.float64], str]] = {}
    empty: Any = False
    for fields in channels:
        kind = quantity_of(SELECT.sub(r"\g<outside>", fields.get("Image Data", "")))
        raw, ways = _numbers(path, content, known, fields, number)
        if kind is not None and kind not in found:
            found[kind] = _scaled(_value(fields["Z scale"]), kind, known, raw)
        empty = empty | (raw == np.iinfo(raw.dtype).min)
    if "distance" not in found:
        ramp = next(value for key, value in fields.items() if key.startswith("Ramp size"))
        length, unit = _scaled(_value(ramp)._replace(scale=quantity(_value(ramp).value) or 0.0), "distance", known, 1.0)
        steps = np.concatenate([np.arange(count) for count in ways])
        found["distance"] = length * steps / max(ways), unit
    parts: Parts = {}
    for way, first, count in zip(DIRECTIONS, (0, ways[0]), ways, strict=True):
        there = slice(first, first + count)
        for kind, (values, unit) in found.items():
            parts[kind, way] = values[there][~empty[there]], unit
    return parts


def _numbers(
    path: Path, content: bytes, known: Fields, fields: Fields, number: int
) -> tuple[NDArray[np.signedinteger[Any]], list[int]]:
    """The stored numbers of a channel of one curve, the way there and that back, and how many each has."""
    ways = [int(one) for one in fields["Samps/line"].split()]
    ways = ways if len(ways) == len(DIRECTIONS) else ways[:1] * len(DIRECTIONS)
    length, each = int(fields["Data length"]), sum(ways)
    wide = int(known.get("Version", "0"), 16) >= WIDE and length % (4 * each) == 0
    size = 4 if wide else int(fields.get("Bytes/pixel", "2"))
    if number >= length // (size * each):
        raise InputError("number", number, f"0 to {length // (size * each) - 1}, the curves of {path.name}")
    first = int(fields["Data offset"]) + number * size * each
    stored = content[first : first + size * each]
    if len(stored) < size * each:
        raise FileError(f"cannot read {path}: it is cut short.")
    return np.frombuffer(stored, f"<i{size}"), ways


def _value(text: str) -> Value:
    """A value parameter; its hard scale is that of one stored number."""
    found = VALUE.match(text)
    scale = SCALE.search(found["hard"] or "") if found else None
    soft = (found["soft"] or "") if found else ""
    value = found["value"] if found else ""
    return Value(soft, float(scale["number"]) if scale else 1.0, scale["unit"] if scale else value.split()[-1], value)


def _scaled(value: Value, kind: str, known: Fields, raw: Any) -> tuple[Any, str]:
    """Stored numbers in the unit of their quantity: by the soft scale where that makes a length, or else as volts."""
    units = {**NAMES[kind][1], "º": (1.0, "degree")} if kind == "phase" else NAMES[kind][1]
    hard = value.scale * np.asarray(raw, float)
    number, _, unit = known.get(value.soft, "").removeprefix("V").strip().partition(" ")
    over, _, under = unit.strip().partition("/")
    if under == value.unit and over in units:
        return float(number) * units[over][0] * hard, units[over][1]
    if value.unit in units:
        return units[value.unit][0] * hard, units[value.unit][1]
    raise ValueError(f"{kind} is in {value.unit} and there is no {value.soft or 'sensitivity'}")


def _said(path: Path, known: Fields) -> ScanData:
    """What the header says of drive, lever and sensitivity."""
    plain = {key: _value(text).value if text.startswith("V") else SELECT.sub(r"\g<outside>", text)
             for key, text in known.items()}  # fmt: skip
    plain = {"MicroscopeList": "", **plain, "TMSetAmplitude": ""}  # of NanoScope; no image, which holds a setpoint
    scan = scan_data(path, plain)
    stiffness = quantity(plain.get("Spring Constant", plain.get("Spring constant")))
    if stiffness:
        scan.take(stiffness=stiffness)
        scan.nominal.append("stiffness")
        scan.warnings.append(f"The stiffness {stiffness:g} N/m is what was typed into NanoScope, or its default.")
    return scan
