r"""Curves in the files of JPK and NanoScope.

JPK's are an archive with a header and a file of numbers for each channel of each segment. Headers are Java properties.
A key that ends in ``.*`` stands for the properties of a section that segments share, in
``shared-data/header.properties``: ``channel.height.lcd-info.*=0`` for all that begin with ``lcd-info.0.``. Numbers are
integers of an encoder, whose scaling makes volts of them; conversions, each based on another, make metres of volts and
newtons of metres (JPK, "The JPK data file format"; afmformats reads the same keys).

NanoScope's have a header of lines that begin with a backslash, and channels of integers behind it. Each ``\*Ciao force
image list`` is a channel: where its numbers are, how many on the way there and back (``Samps/line``), and a value
parameter ``Z scale: V [soft scale] (hard scale) hard value``. A number times the hard scale is in volts, or in degrees;
the soft scale names a parameter that makes a length of volts (NanoScope 8.10 user guide, "CIAO parameter objects").
Both ways have the same distances, in equal steps of the ``Ramp size``.
"""

from __future__ import annotations

import re
import zipfile
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap.io.curve_columns import DIRECTIONS, NAMES, Parts, quantity_of
from phasemap.io.metadata import ScanData, quantity
from phasemap.io.vendors import scan_data

ARCHIVES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data")
WAYS = {"extend": "approach", "retract": "retract"}  # by the style of a segment; a pause is neither
ENCODERS = {
    "signedshort": ">i2", "unsignedshort": ">u2", "signedinteger": ">i4", "unsignedinteger": ">u4", "signedlong": ">i8",
}  # fmt: skip
PLAIN = {"short": ">i2", "short-data": ">i2", "float": ">f4", "float-data": ">f4", "double-data": ">f8"}
HEIGHTS = ("measuredHeight", "capacitiveSensorHeight", "strainGaugeHeight", "height", "head-height")
"""Channels of the distance: sensors, which measure it, before what was asked of the piezo."""
Properties = dict[str, str]


class Slot(NamedTuple):
    """Calibration of a channel: factor and offset to the slot that it is based on."""

    name: str
    factor: float
    offset: float
    unit: str


def of_archive(path: Path, number: int) -> tuple[Parts, ScanData]:
    """Channels of curve `number` of an archive, and lever and sensitivity by its headers."""
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(path, archive, number)
    except PhasemapError:
        raise
    except (zipfile.BadZipFile, KeyError, ValueError, OSError, EOFError) as error:
        raise FileError(f"cannot read {path}: it is damaged, or no archive of JPK ({error}).") from error


def _read(path: Path, archive: zipfile.ZipFile, number: int) -> tuple[Parts, ScanData]:
    """Channels of curve `number`, each once per direction, and what headers say of the lever."""
    headers = [name for name in archive.namelist() if name.endswith("segment-header.properties")]
    curves = sorted({_curve_of(name) for name in headers}, key=lambda folder: [int(one) for one in _digits(folder)])
    if not curves:
        raise FileError(f"cannot use {path}: the archive holds no segment of a curve.")
    if number >= len(curves):
        raise InputError("number", number, f"0 to {len(curves) - 1}, the curves of {path.name}")
    shared = _properties(archive, "shared-data/header.properties")
    parts: Parts = {}
    scan = ScanData()
    segments = sorted(
        (name for name in headers if _curve_of(name) == curves[number]), key=lambda name: _digits(name)[-1]
    )
    for header in segments:
        properties = _resolved(_properties(archive, header), shared)
        style = next((properties[key] for key in properties if key.endswith("settings.style")), "")
        if style not in WAYS:
            continue
        channels = properties.get("channels.list", "").split()
        channels.sort(key=lambda name: HEIGHTS.index(name) if name in HEIGHTS else len(HEIGHTS))
        for name in channels:
            kind = "distance" if name in HEIGHTS else quantity_of(name)
            if kind is not None and (kind, WAYS[style]) not in parts:
                parts[kind, WAYS[style]] = _channel(archive, header, properties, name, kind, scan)
        drives = (quantity(value) for key, value in properties.items() if key.endswith("feedback-settings.frequency"))
        scan.set_known(drive_frequency=next(drives, None))
    return parts, scan


def _curve_of(header: str) -> str:
    """The folder of the curve that a segment belongs to: empty, or of a map "index/7/"."""
    return header.partition("segments/")[0]


def _digits(name: str) -> list[str]:
    """Numbers of the folders in a name, padded so that they sort as numbers."""
    return [one.zfill(9) for one in re.findall(r"(?<=/)\d+(?=/)", f"/{name}")]


def _properties(archive: zipfile.ZipFile, name: str) -> Properties:
    """The properties of a header; none where there is no such file."""
    if name not in archive.namelist():
        return {}
    lines = archive.read(name).decode("latin-1").splitlines()
    pairs = (line.split("=", 1) for line in lines if "=" in line and not line.startswith(("#", "!")))
    return {key.strip(): value.strip() for key, value in pairs}


def _resolved(properties: Properties, shared: Properties) -> Properties:
    """The properties of a segment with those that it shares, where a link to them stands."""
    resolved = dict(properties)
    for key, number in properties.items():
        if key.endswith(".*"):
            holder, _, section = key.removesuffix(".*").rpartition(".")
            start = f"{section}.{number}."
            more = {one.removeprefix(start): value for one, value in shared.items() if one.startswith(start)}
            resolved |= {f"{holder}.{one}" if holder else one: value for one, value in more.items()}
    return resolved


def _channel(
    archive: zipfile.ZipFile, header: str, properties: Properties, name: str, kind: str, scan: ScanData
) -> tuple[NDArray[np.float64], str]:
    """The values of a channel and their unit, by the calibration it has by default, if that is of its quantity."""
    channel = {key.removeprefix(f"channel.{name}."): value for key, value in properties.items()
               if key.startswith(f"channel.{name}.")}  # fmt: skip
    folder = header.rpartition("/")[0]
    stored = channel.get("data.file.name", f"channels/{name}.dat")
    encoder = next((f"{place}encoder" for place in ("data.", "") if f"{place}encoder.type" in channel), None)
    form = PLAIN[channel.get("data.type", channel.get("type", ""))] if encoder is None else ENCODERS[
        channel[f"{encoder}.type"]
    ]  # fmt: skip
    values = np.frombuffer(archive.read(f"{folder}/{stored}"), form).astype(float)
    slots = _slots(channel, encoder)
    _say_lever(slots, kind, scan)
    units = NAMES[kind][1]
    used = next((i for i in reversed(range(len(slots))) if slots[i].unit in units), None)
    if used is None:
        raise FileError(
            f"cannot use {archive.filename}: the channel {name} is in {slots[-1].unit or 'no unit'}, not in one of "
            f"{', '.join(units)}."
        )
    for slot in slots[: used + 1]:
        values = slot.factor * values + slot.offset
    factor, unit = units[slots[used].unit]
    return factor * values, unit


def _slots(channel: Properties, encoder: str | None) -> list[Slot]:
    """Calibrations from the stored numbers up to the default one, in the order in which they are applied."""
    scaling = f"{encoder}.scaling"
    base = Slot("base", 1.0, 0.0, channel.get("unit.unit", "")) if encoder is None else _slot(channel, "base", scaling)
    sets = "conversion-set.conversion"
    name, chain = channel.get(f"{sets}s.default", ""), []
    while name != channel.get(f"{sets}s.base", "") and channel.get(f"{sets}.{name}.defined") == "true":
        chain.append(_slot(channel, name, f"{sets}.{name}.scaling"))
        name = channel.get(f"{sets}.{name}.base-calibration-slot", "")
        if len(chain) > len(channel):
            raise ValueError("its calibrations are based on each other")
    return [base, *reversed(chain)]


def _slot(channel: Properties, name: str, scaling: str) -> Slot:
    """Calibration of a channel at one level of its chain."""
    unit = channel.get(f"{scaling}.unit.unit", channel.get(f"{scaling}.unit", ""))
    return Slot(name, float(channel[f"{scaling}.multiplier"]), float(channel[f"{scaling}.offset"]), unit)


def _say_lever(slots: list[Slot], kind: str, scan: ScanData) -> None:
    """Sensitivity of the amplitude, and stiffness: the factors that make metres of volts, and newtons of metres."""
    for before, slot in pairwise(slots):
        if kind == "amplitude" and (before.unit, slot.unit) == ("V", "m"):
            scan.set_known(amplitude_sensitivity=abs(slot.factor))
        if kind == "deflection" and (before.unit, slot.unit) == ("m", "N"):
            scan.set_known(stiffness=abs(slot.factor))


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
    """True if a file is a curve of NanoScope."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MARK)) == MARK


def of_nanoscope(path: Path, number: int) -> tuple[Parts, ScanData]:
    """Channels of curve `number` of a file, and settings by its header."""
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
    return parts, _scan_data_of_header(path, known)


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
    by_kind: dict[str, tuple[NDArray[np.float64], str]] = {}
    empty: Any = False
    for fields in channels:
        kind = quantity_of(SELECT.sub(r"\g<outside>", fields.get("Image Data", "")))
        raw, ways = _numbers(path, content, known, fields, number)
        if kind is not None and kind not in by_kind:
            by_kind[kind] = _scaled(_value(fields["Z scale"]), kind, known, raw)
        empty = empty | (raw == np.iinfo(raw.dtype).min)
    if "distance" not in by_kind:
        ramp = next(value for key, value in fields.items() if key.startswith("Ramp size"))
        length, unit = _scaled(_value(ramp)._replace(scale=quantity(_value(ramp).value) or 0.0), "distance", known, 1.0)
        steps = np.concatenate([np.arange(count) for count in ways])
        by_kind["distance"] = length * steps / max(ways), unit
    parts: Parts = {}
    for way, first, count in zip(DIRECTIONS, (0, ways[0]), ways, strict=True):
        rows = slice(first, first + count)
        for kind, (values, unit) in by_kind.items():
            parts[kind, way] = values[rows][~empty[rows]], unit
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
    match = VALUE.match(text)
    scale = SCALE.search(match["hard"] or "") if match else None
    soft = (match["soft"] or "") if match else ""
    value = match["value"] if match else ""
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


def _scan_data_of_header(path: Path, known: Fields) -> ScanData:
    """Drive, lever and sensitivity by the header of a NanoScope curve."""
    plain = {key: _value(text).value if text.startswith("V") else SELECT.sub(r"\g<outside>", text)
             for key, text in known.items()}  # fmt: skip
    plain = {"MicroscopeList": "", **plain, "TMSetAmplitude": ""}  # of NanoScope; no image, which holds a setpoint
    scan = scan_data(path, plain)
    stiffness = quantity(plain.get("Spring Constant", plain.get("Spring constant")))
    if stiffness:
        scan.set_known(stiffness=stiffness)
        scan.nominal.append("stiffness")
        scan.warnings.append(f"The stiffness {stiffness:g} N/m is what was typed into NanoScope, or its default.")
    return scan
