"""Settings of a scan by the metadata of vendors, in canonical names and SI units.

A value that a vendor fills in before it is measured is not taken over; a sentence says so.

JPK's files hold more beside the images, in tags of their TIFF directories that Gwyddion passes over. A channel has
slots, calibrations one on top of the other: counts, volts, metres. A slot takes 48 tags, among them its name, the name
of the slot that it is based on, its unit, and the factor by which it multiplies counts.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from phasemap._shared.errors import FileError
from phasemap._shared.units import say
from phasemap.io.gwyddion import extra
from phasemap.io.metadata import CANONICAL, ScanData, day_of, quantity

MODE_KEYS = ("Op. mode", "ImagingMode", "MicroscopeList")  # Nanosurf, Asylum Research, Bruker
TAPPING_MODES = ("phase contrast", "dynamic force", "dynamic afm", "ac mode", "tapping", "tapping mode")
OTHER_MODE_KEYS = ("Feedback Mode", "Image mode", "Feedback settings::Input channel")  # JPK, Park, WSxM ...
OTHER_MODES = (  # ... of whose words only these are known
    "contact", "contact mode", "c-afm", "lfm", "fmm", "pfm", "fm-afm", "stm", "i-afm", "normal force", "current",
    "qi", "quantitative imaging", "force mapping", "force volume", "force distance",
    "peakforce tapping", "peak force tapping", "scanasyst",
)  # fmt: skip
NO_SENSITIVITY = "and the file has no sensitivity to convert it to metres"
ASYLUM_NUMBERS = {"0": "Contact", "1": "AC Mode"}  # as older software wrote them
PRACTICE = {
    "drive_frequency": (1e3, 1e7), "resonance_frequency": (1e3, 1e7), "stiffness": (1e-3, 1e3),
    "quality_factor": (0.5, 1e6), "free_amplitude": (5e-11, 1e-6), "setpoint_amplitude": (5e-11, 1e-6),
    "setpoint": (0.01, 1.0), "line_rate": (1e-3, 1e4), "amplitude_sensitivity": (1e-10, 1e-5),
}  # fmt: skip
"""Ranges in practice; numbers beyond are in another unit than the file says."""
SAME_LEVER = 0.05  # a resonance farther from the drive frequency than this part is a catalogue's
_ASYLUM_DEFAULTS = {"SpringConstant": 1.0, "ThermalQ": 20.0, "ThermalFrequency": 75e3, "AmpInvOLS": 1.09e-7}


def scan_data(path: Path, metadata: Mapping[str, str]) -> ScanData:
    """Settings of a scan, in canonical names, by the metadata of a file; `path` is for what Gwyddion leaves out."""
    scan = ScanData()
    for mark, vendor in _VENDORS.items():
        if mark in metadata:
            vendor(scan, metadata, path)
            break
    scan.set_known(day=day_of(metadata.get("Date")))
    scan.set_known(**{name: quantity(metadata.get(name)) for name in CANONICAL})  # of a file that phasemap wrote
    scan.warnings += metadata.get("warnings", "").splitlines()
    scan.nominal += metadata.get("nominal", "").split()
    _doubt(scan)
    known = scan.values
    if "setpoint" not in known and {"setpoint_amplitude", "free_amplitude"} <= set(known):
        ratio = known["setpoint_amplitude"] / known["free_amplitude"]
        scan.set_known(setpoint=ratio if ratio <= PRACTICE["setpoint"][1] else None)
    return scan


def _doubt(scan: ScanData) -> None:
    """Take out numbers outside all practice, and say so: they are of another unit, or of nothing."""
    for name, (low, high) in PRACTICE.items():
        value = scan.values.get(name)
        if value is None or low <= value <= high:
            continue
        del scan.values[name]
        unit = CANONICAL[name]
        what = name.replace("_", " ")
        scan.warnings.append(
            f"The file says {what} {say(value, unit, 3)}, which is outside the usual range ({say(low, unit, 3)} to "
            f"{say(high, unit, 3)}): it is ignored."
        )


def operating_mode(path: Path, metadata: Mapping[str, str]) -> str:
    """The operating mode as the instrument wrote it, which is refused if it is not tapping."""
    mode = next((metadata[key].strip() for key in MODE_KEYS if metadata.get(key, "").strip()), "")
    mode = ASYLUM_NUMBERS.get(mode, mode)
    other = next((metadata[key].strip() for key in OTHER_MODE_KEYS if metadata.get(key, "").strip()), "")
    if not mode and not other and is_quantitative_imaging(path):
        other = "quantitative imaging"
    wrong = mode if mode and mode.lower() not in TAPPING_MODES else other if other.lower() in OTHER_MODES else ""
    if wrong:
        raise FileError(
            f"cannot use {path}: it was recorded in the mode {wrong!r}, whose phase is not a tapping phase."
        )
    return mode or other or metadata.get("operating_mode", "not recorded")


def _nanosurf(scan: ScanData, metadata: Mapping[str, str], path: Path) -> None:
    """Nanosurf .nid; the lever's properties are in its header, in a part that Gwyddion passes over."""

    def value(*keys: str) -> float | None:
        return next((quantity(metadata[key]) for key in keys if key in metadata), None)

    time = value("Time/Line")  # of a line in one direction
    scan.set_known(
        drive_frequency=value("Vibration freq."), free_amplitude_voltage=value("Vibration ampl."),
        lock_in_phase=value("Ref. phase"), line_rate=1 / (2 * time) if time else None,
        proportional_gain=value("P-Gain"), integral_gain=value("I-Gain"),
    )  # fmt: skip
    setpoint = metadata.get("Setpoint", metadata.get("Set point", "")).strip()  # in contact mode it is in volts
    if setpoint.endswith("%"):
        scan.set_known(setpoint=quantity(setpoint))
    inputs = _section(
        path, rb"\[DataSet\\Calibration\\Scanhead\](.*?)\n\[", rb"=\d+,(TipSignalDC1?),Deflection,[mV],([^,]+),"
    )
    if "free_amplitude_voltage" in scan.values:
        volts = scan.values["free_amplitude_voltage"]
        warning = f"The free amplitude is {volts:g} V, {NO_SENSITIVITY}"
        if len(inputs) == 2:
            nanometres = inputs["TipSignalDC"] / inputs["TipSignalDC1"] * 1e9
            warning += f"; with that of the deflection, {nanometres:.4g} nm/V, it would be {volts * nanometres:.4g} nm"
        scan.warnings.append(warning + ".")
    lever = _section(path, rb"\[DataSet\\Calibration\\Cantilever\](.*?)\n\[", rb"(Prop[014])=D\[([^\]]+)\]")
    if len(lever) == 3:
        scan.set_known(stiffness=lever["Prop0"], quality_factor=lever["Prop4"])
        if _near(lever["Prop1"], scan.values.get("drive_frequency")):
            scan.set_known(resonance_frequency=lever["Prop1"])
        else:
            scan.nominal = ["stiffness", "quality_factor"]
            kind = metadata.get("Cantilever type", "this type")
            scan.warnings.append(
                f"The stiffness {lever['Prop0']:g} N/m and the quality factor {lever['Prop4']:g} are nominal values of "
                f"levers of type {kind}, whose {lever['Prop1'] / 1e3:g} kHz is not the resonance of this one."
            )


def _asylum(scan: ScanData, metadata: Mapping[str, str], path: Path) -> None:
    """Asylum Research .ibw; Gwyddion passes over the note's keys that begin with "Amplitude"."""

    def value(key: str) -> float | None:
        number = quantity(metadata.get(key))
        default = _ASYLUM_DEFAULTS.get(key)
        if number is not None and default is not None and math.isclose(number, default, rel_tol=1e-6):
            scan.warnings.append(f"{key} = {number:g} is the vendor's default, not a calibration, and is ignored.")
            return None
        return number

    frequency, free = value("DriveFrequency"), value("FreeAirAmplitude")
    note = _section(path, rb"(.*)", rb"[\r\n](AmplitudeSetpointVolts|PhaseOffset): *([^\r\n]+)")
    volts = note.get("AmplitudeSetpointVolts")
    sensitivity = value("AmpInvOLS")
    scan.set_known(
        drive_frequency=frequency,
        line_rate=value("ScanRate"),
        proportional_gain=value("ProportionalGain"),
        integral_gain=value("IntegralGain"),
        phase_zero=value("FreeAirPhase"),
        lock_in_phase=note.get("PhaseOffset"),
        phase_sign=-1.0,  # lag: above 90 degrees attractive, below repulsive (Asylum Research, AC mode manual)
        drive_voltage=value("DriveAmplitude"),
        free_amplitude_voltage=free,
        setpoint_voltage=volts,
        setpoint=volts / free if volts and free else None,
        stiffness=value("SpringConstant"),
        amplitude_sensitivity=sensitivity,
    )
    if sensitivity:
        _take_metres(scan, free, volts, sensitivity)
    elif "AmpInvOLS" in metadata:
        scan.warnings.append("Recorded amplitudes in metres are based on that default sensitivity AmpInvOLS.")
    thermal = value("ThermalFrequency"), value("ThermalQ")
    for resonance, quality in (thermal, (value("TuneFreqResult"), value("TuneQResult"))):
        if resonance and quality and _near(resonance, frequency):
            scan.set_known(resonance_frequency=resonance, quality_factor=quality)
            break
    sides = value("SlowScanSize"), value("FastScanSize")
    if sides[0] and sides[1]:  # Gwyddion's is a pixel longer: the wave's step is the size over N - 1
        scan.size = (sides[0], sides[1])


def _nanoscope(scan: ScanData, metadata: Mapping[str, str], path: Path) -> None:
    """Bruker, Veeco and Digital Instruments NanoScope; "2:" is the main scan, "3:" the interleave."""

    def value(*keys: str) -> float | None:
        return next((quantity(metadata[k]) for key in keys for k in (f"2:{key}", key) if k in metadata), None)

    volts = value("TMSetAmplitude")
    calibrated = "/V" in metadata.get("Sens. AmplSens", "")
    sensitivity = value("Sens. AmplSens") if calibrated else None
    scan.set_known(
        drive_frequency=value("CantFrequency", "Drive frequency", "Drive Frequency"),
        line_rate=value("Scan Rate", "Scan rate"),
        proportional_gain=value("TMFbPgain", "Proportional gain", "Proportional Gain"),  # the latter of version 4 and 5
        integral_gain=value("TMFbIgain", "Integral gain", "Integral Gain"),
        drive_voltage=value("CantDrive", "Drive amplitude", "Drive Amplitude"),
        lock_in_phase=value("CantPhase"),
        setpoint_voltage=volts,
        amplitude_sensitivity=sensitivity,
        setpoint_amplitude=volts * sensitivity if volts and sensitivity else None,
    )
    if volts:
        scan.warnings.append(
            f"The setpoint is {volts:g} V of a free amplitude that NanoScope files do not record"
            + ("." if sensitivity else f", {NO_SENSITIVITY}.")
        )


def _jpk(scan: ScanData, metadata: Mapping[str, str], path: Path) -> None:
    """JPK; of the settings of the oscillation, which are text in the file, Gwyddion passes over most."""
    entry = rb"feedback-settings\.(reference-amplitude|relative-setpoint|frequency) : ([^\r\n]+)"
    settings = _section(path, rb"(.*)", entry)
    free, volts = settings.get("reference-amplitude"), quantity(metadata.get("Feedback Setpoint"))
    sensitivity = amplitude_sensitivity(path)
    scan.set_known(
        drive_frequency=settings.get("frequency", quantity(metadata.get("Feedback Frequency"))),
        line_rate=quantity(metadata.get("Scan Rate")), proportional_gain=quantity(metadata.get("Feedback PGain")),
        integral_gain=quantity(metadata.get("Feedback IGain")), setpoint_voltage=volts,
        setpoint=settings.get("relative-setpoint"), free_amplitude_voltage=free, amplitude_sensitivity=sensitivity,
    )  # fmt: skip
    if sensitivity:
        _take_metres(scan, free, volts, sensitivity)
    elif free:
        scan.warnings.append(f"The free amplitude is {free:.4g} V, {NO_SENSITIVITY}.")


def _park(scan: ScanData, metadata: Mapping[str, str], path: Path) -> None:
    """Park Systems, as Gwyddion's module names things."""
    scan.set_known(line_rate=quantity(metadata.get("Scan rate")))
    setpoint = metadata.get("Set point", "").split()
    name = {"m": "setpoint_amplitude", "V": "setpoint_voltage"}.get(setpoint[-1][-1] if setpoint else "")
    if name:
        scan.set_known(**{name: quantity(metadata["Set point"])})


def _wsxm(scan: ScanData, metadata: Mapping[str, str], path: Path) -> None:
    """WSxM, whose files hold a channel each."""
    dynamic, feedback = "Dynamic settings::", "Feedback settings::"
    scan.set_known(
        resonance_frequency=quantity(metadata.get(f"{dynamic}Resonance frequency")),
        quality_factor=quantity(metadata.get(f"{dynamic}Quality factor (Q)")),
        line_rate=quantity(metadata.get("Control::X-Frequency")),
        proportional_gain=quantity(metadata.get(f"{feedback}Proportional")),
        integral_gain=quantity(metadata.get(f"{feedback}Integral")),
        stiffness=quantity(metadata.get("General Info::Force constant")),
    )
    if "stiffness" in scan.values:
        scan.nominal = ["stiffness"]
        scan.warnings.append(f"The stiffness {scan.values['stiffness']:g} N/m is what was typed into WSxM.")


_VENDORS: dict[str, Callable[[ScanData, Mapping[str, str], Path], None]] = {
    "Op. mode": _nanosurf,
    "ImagingMode": _asylum,
    "MicroscopeList": _nanoscope,
    "Feedback Mode": _jpk,
    "Image mode": _park,
    "General Info::Head type": _wsxm,
}
"""Readers, by a key that only this vendor's files have."""


def _take_metres(scan: ScanData, free: float | None, volts: float | None, sensitivity: float) -> None:
    """Free amplitude and setpoint in metres, of those in volts, where they are known."""
    known = {"free_amplitude": free, "setpoint_amplitude": volts}
    scan.set_known(**{name: one * sensitivity for name, one in known.items() if one})


def _near(resonance: float, frequency: float | None) -> bool:
    """True if a lever with this resonance may have been driven at this frequency."""
    return bool(frequency) and abs(resonance / (frequency or math.nan) - 1) < SAME_LEVER


def _section(path: Path, section: bytes, entry: bytes) -> dict[str, float]:
    """Numbers by their keys, from the text in a file that has a section and entries of this form."""
    if not path.is_file():
        return {}
    match = re.search(section, path.read_bytes(), re.DOTALL)
    pairs = re.findall(entry, match[1]) if match else []
    numbers = {key.decode("ascii"): quantity(text.decode("latin-1")) for key, text in pairs}
    return {key: number for key, number in numbers.items() if number is not None}


TIFF = (b"II*\0", b"MM\0*")
CHANNEL, SLOTS = 0x8050, 0x8080  # tags of a channel: its name, how many slots it has
FIRST, LENGTH = 0x8090, 48  # tags of a slot: where the first one's begin, and how many there are
NAME, BASE, UNIT, SCALING, FACTOR, OFFSET = 0x00, 0x02, 0x12, 0x13, 0x14, 0x15  # from where a slot begins
MOST = 32  # slots; files have two to four
SETPOINT_SLOT = re.compile(rb"setpoint-feedback-settings\.setpoint-slot : (\w+)")


def amplitude_sensitivity(path: Path) -> float | None:
    """The sensitivity [m/V], if any, by which a JPK file makes metres of the amplitude in its setpoint's volts."""
    if not path.is_file():
        return None
    named = SETPOINT_SLOT.search(path.read_bytes())
    for tags in _directories(path):
        if tags.get(CHANNEL) != "amplitude":
            continue
        for slot in (slots := _slots(tags)).values():
            base = slots.get(slot["base"])
            if slot["unit"] != "m" or base is None or base["unit"] != "V":
                continue
            if named is None or named[1].decode("ascii") == slot["base"]:
                return float(abs(slot["factor"] / base["factor"]))
    return None


def is_quantitative_imaging(path: Path) -> bool:
    """True if a file is an image made of force curves, one in each pixel (JPK's QI)."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(4) in TIFF and b"quantitative-imaging-settings" in file.read()


def _slots(tags: dict[int, Any]) -> dict[str, dict[str, Any]]:
    """The slots of a channel that are proportional to its counts, by their names."""
    by_name = {}
    slots = tags.get(SLOTS)
    if not isinstance(slots, int):
        return {}
    for at in range(FIRST, FIRST + LENGTH * min(slots, MOST), LENGTH):
        factor, offset = tags.get(at + FACTOR), tags.get(at + OFFSET)
        if tags.get(at + SCALING) == "LinearScaling" and isinstance(factor, float) and factor and offset == 0:
            by_name[str(tags.get(at + NAME))] = {
                "base": tags.get(at + BASE), "unit": tags.get(at + UNIT), "factor": factor,
            }  # fmt: skip
    return by_name


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
