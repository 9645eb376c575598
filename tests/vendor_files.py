"""Small files as microscopes write them, for formats of which no package ships an example.

Tags and their types are those of real files: a JPK image of the AFMReader project, NanoScope images of 5.12 to 9.1, and
for Park what Gwyddion's module reads.
"""

from __future__ import annotations

import struct
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

Tag = tuple[int, int, int, Any, bool]

JPK_SETTINGS = """adjust-reference-amplitude-feedback-settings.reference-amplitude : 2.0
setpoint-feedback-settings.relative-setpoint : 0.8
setpoint-feedback-settings.setpoint-slot : voltsamplitude
sine-generator-feedback-settings.frequency : 88400.0
"""


def nanoscope_file(path: Path, sensitivity: str) -> np.ndarray:
    """A NanoScope file of a height and an amplitude error; returns the counts of both, top row first."""
    counts = np.arange(-12, 12, dtype="<i2").reshape(4, 6) * 500
    channels = {"Height": "V [Sens. Zsens] (0.001 V/LSB) 65.536 V"}
    channels["AmplitudeError"] = "V [Sens. Amplitude Error] (0.06103516 mV/LSB) 3999.939 mV"
    lines = ["\\*File list", "\\Version: 0x07200000", "\\Date: 01:02:03 PM Mon Jan 01 2010", "\\Data length: 8192"]
    lines += ["\\*Scanner list", "\\@Sens. Zsens: V 20.00000 nm/V", "\\*Ciao scan list", "\\Microscope mode: Tapping"]
    lines += ['\\@MicroscopeList: S [Tapping] "Tapping"', f"\\@Sens. Amplitude Error: V {sensitivity}"]
    for n, (name, scale) in enumerate(channels.items()):
        lines += ["\\*Ciao image list", f"\\Data offset: {8192 + 48 * n}", "\\Data length: 48", "\\Bytes/pixel: 2"]
        lines += ["\\Samps/line: 6", "\\Number of lines: 4", "\\Valid data len X: 6", "\\Valid data len Y: 4"]
        lines += ["\\Aspect ratio: 1:1", "\\Scan size: 600 400 nm", "\\Line direction: Trace", "\\Scan line: Main"]
        lines += [f'\\@2:Image Data: S [{name}] "{name}"', f"\\@2:Z scale: {scale}"]
    header = "\r\n".join([*lines, "\\*File list end", ""]).encode("latin-1") + b"\x1a"
    path.write_bytes(header.ljust(8192, b"\0") + counts[::-1].tobytes() * len(channels))  # the bottom row first
    return counts.astype(float)


def jpk_file(path: Path) -> dict[tuple[str, str], np.ndarray]:
    """A JPK image of 6 x 4 pixels; returns height, amplitude [m] and phase [degree] by direction, top row first."""
    rng, returned = np.random.default_rng(3), {}
    head = [
        _text(0x8000, "6.0.41"), _text(0x8001, "2.0"), _text(0x8030, "ac-direct-drive"), _text(0x803E, JPK_SETTINGS),
        _real(0x8031, -0.1), _real(0x8032, -3450), _real(0x8033, 1.6), _real(0x8042, 6e-7), _real(0x8043, 8e-7),
        _whole(0x8046, 6), _whole(0x8047, 4), _real(0x8049, 2.0), _text(0x8050, "thumbnail"),
    ]  # fmt: skip
    options: dict[str, Any] = {"metadata": None, "software": False}
    with import_module("tifffile").TiffWriter(path, byteorder=">") as file:
        file.write(np.zeros((8, 8), np.uint8), extratags=head, **options)
        for retrace in (1, 0):  # as JPK orders them
            for name, title, unit, factor in (
                ("height", "Height", "m", -1e-15),
                ("phase", "Lock-In Phase", "deg", 1e-7),
            ):
                counts = rng.integers(-(10**7), 10**7, (4, 6)).astype(np.int32)
                returned[name, "retrace" if retrace else "trace"] = counts[::-1] * factor  # the bottom row first
                tags = [_text(0x8050, name), (0x8051, 8, 1, retrace, True), _text(0x8052, title), _whole(0x8080, 2)]
                tags += [
                    _text(0x8081, "last"),
                    _text(0x8090, "raw"),
                    _text(0x80A3, "NullScaling"),
                    _text(0x80C0, "last"),
                ]
                tags += [_text(0x80D2, unit), _text(0x80D3, "LinearScaling"), _real(0x80D4, factor), _real(0x80D5, 0.0)]
                file.write(counts, extratags=tags, **options)
            counts = rng.integers(10**7, 10**8, (4, 6)).astype(np.int32)
            returned["amplitude", "retrace" if retrace else "trace"] = counts[::-1] * 1.5e-16
            tags = [_text(0x8050, "amplitude"), (0x8051, 8, 1, retrace, True), _text(0x8052, "Lock-In Amplitude")]
            tags += [_whole(0x8080, 3), _text(0x8081, "distanceamplitude"), *_slot(0, "raw")]
            tags += [*_slot(1, "voltsamplitude", "raw", "V", 1e-8)]
            tags += [*_slot(2, "distanceamplitude", "voltsamplitude", "m", 1.5e-16)]  # 15 nm/V
            file.write(counts, extratags=tags, **options)
    return returned


def _slot(number: int, name: str, base: str = "", unit: str = "", factor: float = 0.0) -> list[Tag]:
    """The tags of a calibration of a JPK channel."""
    at = 0x8090 + 48 * number
    scaling = [_text(at + 0x13, "NullScaling")]
    if unit:
        scaling = [_text(at + 0x12, unit), _text(at + 0x13, "LinearScaling"), _real(at + 0x14, factor)]
        scaling += [_text(at + 2, base), _real(at + 0x15, 0.0)]
    return [_text(at, name), *scaling]


def ibw_file(path: Path) -> np.ndarray:
    """An Asylum Research image of 6 x 4 pixels; returns heights [m] and phases [degree], top row first."""
    rng = np.random.default_rng(7)
    data = np.stack([1e-9 * rng.normal(size=(4, 6)), 40 + rng.normal(size=(4, 6))]).astype("<f4")
    note = [
        "ImagingMode: AC Mode",
        "DriveFrequency: 74243",
        "FreeAirAmplitude: 0.8",
        "AmplitudeSetpointVolts: 0.6",
        "AmpInvOLS: 5e-08",
        "ScanRate: 1",
        "SpringConstant: 2.5",
        "FastScanSize: 6e-07",
        "SlowScanSize: 4e-07",
        "",
    ]
    _write_wave(path, data[:, ::-1], ["", "HeightTrace", "PhaseTrace"], note)  # the bottom row first
    return data.astype(float)


def ibw_curve(path: Path, z: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> None:
    """An Asylum Research curve, approach and withdrawal one after the other [m, m, degree]."""
    note = ["ImagingMode: AC Mode", "DriveFrequency: 74243", "AmpInvOLS: 5e-08", "SpringConstant: 2.5", ""]
    _write_wave(path, np.stack([z, amplitude, phase]).astype("<f4"), ["", "ZSnsr", "Amp", "Phase"], note)


def _write_wave(path: Path, data: np.ndarray, names: list[str], lines: list[str]) -> None:
    """A wave whose last dimension has names, in Igor Pro's version 5: WaveMetrics' technical note 3."""
    labels, note = b"".join(name.encode().ljust(32, b"\0") for name in names), "\r".join(lines).encode()
    sides = (*data.shape[::-1], 0)[:4] if data.ndim == 3 else (*data.shape[::-1], 0, 0)
    wave = struct.pack(
        "<4xIIiHH6xh32sii4i4d4d4s16s", 0, 0, data.size, 2, 0, 1, b"image", 0, 0, *sides,
        1e-7, 1e-7, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, b"m", b"m\0\0\0m\0\0\0".ljust(16, b"\0"),
    ).ljust(320, b"\0")  # fmt: skip
    of_labels = [0, 0, 0, 0]
    of_labels[data.ndim - 1] = len(labels)
    sizes = (320 + data.nbytes, 0, len(note), 0, 0, 0, 0, 0, *of_labels, 0, 0, 0)
    head = struct.pack("<hh15i", 5, 0, *sizes)
    total = sum(struct.unpack(f"<{(len(head) + 320) // 2}h", head + wave))
    head = struct.pack("<hH15i", 5, -total & 0xFFFF, *sizes)
    path.write_bytes(head + wave + data.tobytes() + note + labels)


def jpk_curves(path: Path, curves: list[list[np.ndarray]], folder: str = "") -> None:
    """JPK's archive of curves: height [m], amplitude [V, of 50 nm/V] and phase [degree], the way there and that back.

    Of several, each is in `folder` with its number. The numbers are those of afmformats' examples of format 2.0.
    """
    scales = {
        "height": ("2.5E-5", 50.0, "V", "nominal", -1e-6), "lockInAmplitude": ("1.0E-5", 0.0, "V", "distance", 5e-8),
        "lockInPhase": ("0.01", 0.0, "deg", "base", 1.0),
    }  # fmt: skip
    shared, own = [], ["force-segment-header.settings.feedback-settings.frequency=300000.0"]
    for i, (name, (multiplier, offset, unit, slot, factor)) in enumerate(scales.items()):
        info, sets = f"lcd-info.{i}", f"lcd-info.{i}.conversion-set.conversion"
        own += [f"channel.{name}.lcd-info.*={i}", f"channel.{name}.data.file.name=channels/{name}.dat"]
        shared += [
            f"{info}.encoder.type=signedinteger", f"{info}.encoder.scaling.offset={offset}",
            f"{info}.encoder.scaling.multiplier={multiplier}", f"{info}.encoder.scaling.unit.unit={unit}",
            f"{sets}s.base=base", f"{sets}s.default={slot}", f"{sets}.{slot}.base-calibration-slot=base",
            f"{sets}.{slot}.defined={str(slot != 'base').lower()}", f"{sets}.{slot}.scaling.unit.unit=m",
            f"{sets}.{slot}.scaling.offset=0.0", f"{sets}.{slot}.scaling.multiplier={factor}",
        ]  # fmt: skip
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("shared-data/header.properties", "\n".join(shared))
        for number, (z, amplitude, phase) in enumerate(curves):
            stored = [(z / -1e-6 - 50.0) / 2.5e-5, amplitude / 1e-5, phase / 1e-2]
            half = len(z) // 2
            for segment, (style, here) in enumerate(
                {"extend": slice(0, half), "pause": slice(0, 9), "retract": slice(half, None)}.items()
            ):
                place = f"{folder.format(number)}segments/{segment}/"
                said = [*own, f"channels.list={' '.join(scales)}", f"force-segment-header.settings.style={style}"]
                archive.writestr(f"{place}segment-header.properties", "\n".join(said))
                for name, values in zip(scales, stored, strict=True):
                    archive.writestr(f"{place}channels/{name}.dat", np.round(values[here]).astype(">i4").tobytes())


def nanoscope_curve(path: Path, ramp: float, amplitude: np.ndarray, phase: np.ndarray, version: str) -> None:
    """A NanoScope curve over `ramp` [m]: amplitude [V, of 50 nm/V] and phase [degree], the way there and that back."""
    half, kind = len(amplitude) // 2, "<i4" if int(version, 16) >= 0x09200000 else "<i2"
    channels = [(amplitude / 1e-4, "Amplitude", "V [Sens. AmplSens] (0.0001 V/LSB) 3.2768 V"),
                (phase / 0.01, "Phase", "V [Sens. Phase] (0.01 \xba/LSB) 360 \xba"),
                (0 * phase, "Amplitude Error", "V [] (0.0001 V/LSB) 3.2768 V")]  # fmt: skip
    size, lines = np.dtype(kind).itemsize * 2 * half, [r"\*Force file list", rf"\Version: {version}"]
    lines += [r"\*Scanner list", r"\@Sens. Zsens: V 10.0 nm/V", r"\*Ciao scan list", r"\@Sens. AmplSens: V 50.00 nm/V"]
    lines += [r"\@2:CantFrequency: V (0.0149 Hz/LSB) 300000 Hz", r"\@2:TMSetAmplitude: V 0.4 V", r"\*Ciao force list"]
    for i, (_, name, scale) in enumerate(channels):
        lines += [
            r"\*Ciao force image list", rf"\Data offset: {4096 + i * size}", rf"\Data length: {size}",
            r"\Bytes/pixel: 2", rf"\Samps/line: {half} {half}", r"\Spring Constant: 42",
            rf'\@4:Image Data: S [{name.replace(" ", "")}] "{name}"', rf"\@4:Z scale: {scale}",
            rf"\@4:Ramp size: V [Sens. Zsens] (0.006713867 V/LSB) {ramp / 10e-9} V",
        ]  # fmt: skip
    head = "\r\n".join([*lines, r"\*File list end", "\x1a"]).encode("latin-1").ljust(4096, b"\0")
    path.write_bytes(head + b"".join(np.round(values).astype(kind).tobytes() for values, _, _ in channels))


def park_file(path: Path, name: str, mode: str, forward: bool = True) -> np.ndarray:
    """A Park Systems channel of 6 x 4 pixels; returns what it holds [degree], top row first."""
    counts = np.random.default_rng(5).integers(-3000, 3000, (4, 6)).astype("<i2")
    header = struct.pack(
        "<i64s16sdiiIIdidiiidddddd16sdddd",
        0, _wide(name, 32), _wide(mode, 8), 0.0, 0, 0, 6, 4, 0.0, 0, 0.0, forward, 1, 0, 0.6, 0.8, 0.0, 0.0, 0.5, 12.5,
        _wide("nm", 8), 0.0, 0.0, 0.01, 1.0,
    )  # fmt: skip
    header += struct.pack("<d16siiii", 0.0, _wide("deg", 8), -3000, 3000, 0, 0)
    tags: list[Tag] = [
        (50432, 4, 1, 0x0E031301, True), (50433, 4, 1, 0x01000001, True),
        (50434, 1, counts.nbytes, counts[::-1].tobytes(), True),  # the bottom row first
        (50435, 1, 580, header.ljust(580, b"\0"), True),
    ]  # fmt: skip
    import_module("tifffile").imwrite(path, np.zeros((4, 6), np.uint8), byteorder="<", extratags=tags, metadata=None)
    return 0.01 * counts


def _text(code: int, text: str) -> Tag:
    return code, 2, 0, text, True


def _real(code: int, number: float) -> Tag:
    return code, 12, 1, float(number), True


def _whole(code: int, number: int) -> Tag:
    return code, 9, 1, number, True


def _wide(text: str, letters: int) -> bytes:
    return text.encode("utf-16-le").ljust(2 * letters, b"\0")
