"""A scene from a measured image: the microscope by the file, and the surface by the image.

Nothing is made up: what the file does not say must be given, and is asked for by name. Only the materials, of which no
image knows the moduli, are placeholders that are said to be so.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import check_choice, number, whole
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.files import check_target, replacing
from phasemap._shared.notices import tell
from phasemap._shared.pixels import coordinate_step
from phasemap._shared.units import say
from phasemap.experiment.presets import preset_of
from phasemap.experiment.surface import Surface
from phasemap.io.measured import APART, level_height, one_scan, segment_height, segment_phase, separation_of
from phasemap.io.metadata import is_simulated, recorded_microscope, recorded_sign, settings_of_image
from phasemap.io.netcdf import save
from phasemap.io.read import read_image
from phasemap.scenes.objects import microscope_of, written_microscope
from phasemap.scenes.placeholders import placeholder_with, placeholders, starts_of_contrast, with_own_damping
from phasemap.scenes.scene import Scene, load_scene, scene_from_tables
from phasemap.scenes.tables import Table, construct, toml_of, with_override

WAYS = ("phase", "height")
NEEDED = {
    "scan.setpoint": "0.7",
    "cantilever.stiffness": "40",
    "cantilever.resonance_frequency": "300e3",
    "cantilever.quality_factor": "400",
    "tip.radius": "10e-9",
    "drive.free_amplitude": "20e-9",
}
"""Keys that a scene cannot do without, with an example of each."""
RECORDED = {
    "scan.setpoint": "setpoint",
    "cantilever.stiffness": "stiffness",
    "cantilever.resonance_frequency": "resonance_frequency",
    "cantilever.quality_factor": "quality_factor",
    "tip.radius": "tip_radius",
    "drive.frequency": "drive_frequency",
}
"""Keys of a scene, and the attributes of an image that say them."""
EDIT = "Change it in the scene that is written."
MATCHED = "start that gives the measured contrast, not a measurement: edit"
UNITS_OF = {"height": "m", "phase": "degree"}


class NotRecorded(PhasemapError):
    """Error for a file that does not say all that a scene needs."""

    def __init__(self, sentence: str, keys: Iterable[str]) -> None:
        super().__init__(sentence)
        self.keys = tuple(keys)  # of a scene


@asked_as()
def scene_from(
    image: xr.Dataset | str | os.PathLike[str],
    path: str | os.PathLike[str],
    phases: int | None = None,
    overrides: Iterable[str] = (),
    *,
    direction: str | None = None,
    by: str = "phase",
    overwrite: bool = False,
) -> Scene:
    """Write the scene that a measured image shows, to be edited and simulated.

    Parameters
    ----------
    image : xarray.Dataset or path-like
        As `phasemap.read_image` gives it, or the file.
    path : path-like
        The scene to write, .toml; its maps of labels, topography and recorded phase go into ``NAME_maps.nc`` beside it.
    phases : int, optional
        How many materials there are, 1 to 4; 1 needs no phase. By default two, or one where the image shows one only,
        which the scene says then.
    overrides : iterable of str
        ``"table.key=value"``, as in `phasemap.load_scene`: what the file does not say, or says otherwise.
    direction : str, optional
        "trace" or "retrace"; None takes the first that was recorded.
    by : {"phase", "height"}
        What tells the materials apart; where phase is mostly crosstalk of slopes, or the contrast vanishes, height is
        better. Labels count from the lowest.
    overwrite : bool
        Whether existing files may be replaced.

    Returns
    -------
    Scene
        What was written, loaded again.

    Raises
    ------
    PhasemapError
        If neither the file nor `overrides` say what a scene needs; all that is missing is named.

    Notes
    -----
    Topography is the height less its tilt and row offsets, level on the material that covers most. Labels count the
    materials from the lowest phase, positive where repulsive, or height; rows are aligned before thresholding
    (`phasemap.io.measured`). The materials are placeholders, presets of unequal stiffness, unless `overrides` say
    ``materials.material_0.modulus=...``; modulus and damping of all but the stiffest are moved to where they give the
    contrast of the phase, if some do (not under laws that are marched in time). The contact is DMT unless a simulated
    image says its law. Where the file has no resonance frequency, the lever is taken as driven at resonance. A free
    amplitude recorded off resonance is brought to resonance.

    Examples
    --------
    >>> scene_from("nowhere.nid", "scene.toml")
    Traceback (most recent call last):
    ...
    phasemap.FileError: cannot read nowhere.nid: there is no such file.
    """
    if phases is not None:
        whole("phases", phases, 1, 4)
    check_choice("by", by, WAYS)
    path = Path(path)
    if path.suffix.lower() != ".toml":
        raise InputError("the suffix of the scene", path.suffix, ".toml")
    maps_path = path.with_name(f"{path.stem}_maps.nc")
    for target in (path, maps_path):
        check_target(target, overwrite)
    scan = _scan_of(image, phases, by, direction)
    tables, notes = _microscope(settings_of_image(scan), list(overrides))
    labels, homogeneous = _labels(scan, phases, by)
    phases = int(labels.max()) + 1 if phases is None else phases
    tell([homogeneous] if homogeneous else [])
    maps = _maps(scan, labels, by)
    shares = _shares(maps["labels"].values, scan)
    names, given = [f"material_{label}" for label in range(phases)], tables["materials"]
    pixel_size = [coordinate_step(scan, dim) for dim in ("y", "x")]
    surface = {
        "kind": "labels",
        "labels": {"file": maps_path.name, "variable": "labels"},
        "topography": {"file": maps_path.name, "variable": "topography"},
        "pixel_size": pixel_size,
        "materials": names,
    }
    for key in surface:
        if key in tables["surface"]:
            raise InputError(f"[surface] {key}", tables["surface"][key], "nothing, for it is the image's", EDIT)
    tables["surface"] |= surface
    for key in given:
        check_choice("material", key, names)  # another would be in no pixel
    notes |= {
        "surface.pixel_size": "m, (dy, dx)",
        "surface.materials": f"from the lowest {by} to the highest{', repulsive positive' if by == 'phase' else ''}",
        "surface.topography": "m, recorded height without tilt and row offsets",
    }
    presets = placeholders(phases)
    tables["materials"] = given | {
        name: placeholder_with(preset, given.get(name, {})) for name, preset in zip(names, presets, strict=True)
    }
    notes |= {f"materials.{name}": share for name, share in zip(names, shares, strict=True)}
    scene = scene_from_tables(tables, path.parent, Surface(1e9, pixel_size=1e-9, shape=(2, 2)))  # refuses bad values
    _check_film(scene)
    for name in names:
        tables["materials"][name] = with_own_damping(tables["materials"][name], given.get(name, {}), scene.microscope)
    made = {
        f"materials.{name}.{key}": f"placeholder, {preset}: edit"
        for name, preset in zip(names, presets, strict=True)
        for key in tables["materials"][name]
    }
    interaction = scene.microscope.interaction
    in_time = interaction.law.in_time or interaction.withdrawal != "linear"  # where trying many starts takes hours
    if by == "phase" and phases > 1 and not given and not in_time:
        levels = [np.median(maps["phase"].values[maps["labels"].values == label]) for label in range(phases)]
        for label, start in starts_of_contrast(tables["materials"], names, np.array(levels), scene).items():
            tables["materials"][label] |= start
            made |= dict.fromkeys((f"materials.{label}.{key}" for key in start), MATCHED)
    save(maps, maps_path, overwrite)
    with replacing(path, overwrite) as temporary:
        temporary.write_text(toml_of(tables, made | notes, _heading(scan, path, homogeneous)), encoding="utf-8")
    return load_scene(path)


def _scan_of(
    image: xr.Dataset | str | os.PathLike[str], phases: int | None, by: str, direction: str | None
) -> xr.Dataset:
    """Scan of the image in one direction, with the channels that tell its materials apart."""
    if isinstance(image, str | os.PathLike):
        name, image = Path(image).name, read_image(image)
        image.attrs |= {"source": name} if is_simulated(image) else {}  # which phasemap is there
    if not hasattr(image, "data_vars"):
        raise InputError("the image", type(image).__name__, "an xarray.Dataset or a file")
    try:
        scan = one_scan(image, UNITS_OF if phases != 1 and by == "phase" else ["height"], direction)
    except FileError as error:
        cure = "Tell materials apart by the height (--by height, in Python by='height'), or take one (--phases 1)."
        raise FileError(f"{error} {cure}") if "height" in image else error from None
    for name, units in UNITS_OF.items():
        if name in scan and scan[name].attrs.get("units", units) != units:
            raise InputError(f"units of {name} of the image", scan[name].attrs["units"], units)
    return scan


def _microscope(attrs: Mapping[str, Any], overrides: list[str]) -> tuple[Table, dict[str, str]]:
    """The tables of the microscope and where their values come from; refused where one is missing."""
    tables: Table = {name: {} for name in ("scan", "surface", "materials", "cantilever", "tip", "drive", "interaction")}
    notes = {}
    for override in overrides:
        tables = with_override(tables, override)
        notes[override.partition("=")[0].strip()] = "given"
    _fill_stated(tables, notes, attrs)
    _fill_derived(tables, notes, attrs)
    _check_complete(tables, attrs)
    return tables, notes


def _fill_stated(tables: Table, notes: dict[str, str], attrs: Mapping[str, Any]) -> None:
    """Set what the image states, as measured or simulated, what a preset of the lever does, and what is nominal."""
    named = tables["cantilever"].pop("preset", None)
    usual = {} if named is None else construct("[cantilever]", {}, partial(preset_of, "levers", named)).values
    of_preset = {f"cantilever.{name}": value for name, value in usual.items()}, f"of the preset {named}"
    nominal = str(attrs.get("nominal", "")).split()
    recorded = {key: float(attrs[name]) for key, name in RECORDED.items() if name in attrs}
    scope, law = recorded_microscope(attrs) or (None, "")
    written = {} if scope is None else written_microscope(scope)
    if written and usual:  # a lever that was simulated is one that was chosen, as the preset is, and not measured
        _fill(tables, notes, *of_preset)
        del written["cantilever"]
    if written and "frequency" not in written["drive"]:  # it is that of the lever, whatever that is
        del recorded["drive.frequency"]
    measured = {key: value for key, value in recorded.items() if RECORDED[key] not in nominal}
    _fill(tables, notes, measured, "as recorded")
    if law or not written:
        written["interaction"] = {}
        note = f"assumed, for {law} is not one of phasemap's laws" if law else "assumed"
        _fill(tables, notes, {"interaction.contact": "dmt"}, note)
    for part, table in written.items():
        tables.setdefault(part, {})
        _fill(tables, notes, {f"{part}.{name}": value for name, value in table.items()}, "as recorded")
    _fill(tables, notes, *of_preset)
    lever = tables["cantilever"]
    tell(
        f"The {name.replace('_', ' ')} is as recorded, {lever[name]:g}, and not of the preset {named}: give "
        f"cantilever.{name}={value:g} if it is to be."
        for name, value in usual.items()
        if lever[name] != value and notes[f"cantilever.{name}"] == "as recorded"
    )
    _fill(tables, notes, recorded, "nominal, of levers of this type")


def _fill_derived(tables: Table, notes: dict[str, str], attrs: Mapping[str, Any]) -> None:
    """Set what follows from the rest: resonance, free amplitude at resonance, and a setpoint that is said in metres."""
    lever, drive = tables["cantilever"], tables["drive"]
    if "resonance_frequency" not in lever and "frequency" in drive:
        lever["resonance_frequency"] = drive["frequency"]
        notes["cantilever.resonance_frequency"] = "assumed to be the drive frequency, for the file does not say"
    loss = _off_resonance(tables)
    if "free_amplitude" not in drive and "free_amplitude" in attrs and loss:
        drive["free_amplitude"] = float(attrs["free_amplitude"]) * loss
        notes["drive.free_amplitude"] = "as recorded" + (", brought to resonance" if loss > 1.001 else "")
    if "setpoint" not in tables["scan"] and "setpoint_amplitude" in attrs and "free_amplitude" in drive and loss:
        free = number("drive.free_amplitude", drive["free_amplitude"], "m", above=0)
        tables["scan"]["setpoint"] = float(attrs["setpoint_amplitude"]) * loss / free
        notes["scan.setpoint"] = "recorded amplitude over free amplitude"


def _check_complete(tables: Table, attrs: Mapping[str, Any]) -> None:
    """Refuse a microscope of which something is missing, with what to give."""
    missing = [key for key in NEEDED if key.partition(".")[2] not in tables[key.partition(".")[0]]]
    if "setpoint_amplitude" in attrs and "drive.free_amplitude" in missing and "scan.setpoint" in missing:
        missing.remove("scan.setpoint")  # follows from the free amplitude
    if missing:
        example = " ".join(f"{key}={NEEDED[key]}" for key in missing)
        raise NotRecorded(
            f"{attrs.get('source', 'the image')} does not say {', '.join(missing)}: give what is missing, "
            f"such as {example}.",
            missing,
        )


def _check_film(scene: Scene) -> None:
    """Refuse a law of films without a film, which no image says the thickness of."""
    materials = scene.config["materials"]
    if scene.microscope.interaction.law.takes_film and all(one["thickness"] is None for one in materials.values()):
        key = f"materials.{next(iter(materials))}.thickness"
        allowed = "a thickness in m of one material at least, where the contact is that of a film"
        raise InputError(key, None, allowed, f"Give it, such as {key}=20nm.")


def _fill(tables: Table, notes: dict[str, str], values: Mapping[str, Any], note: str) -> None:
    """Set the keys that have no value yet, and note where theirs comes from."""
    for key, value in values.items():
        table, _, name = key.partition(".")
        if name not in tables[table]:
            tables[table][name], notes[key] = value, note


def _off_resonance(tables: Table) -> float | None:
    """Amplitude of the free tip at resonance over what is seen at the drive frequency; None where that is not known."""
    parts = {
        "cantilever": {"stiffness": 1.0, **tables["cantilever"]},
        "tip": {"radius": 1e-8},
        "drive": {"excitation": "direct", **tables["drive"], "free_amplitude": 1e-8},
        "detector": tables.get("detector", {}),
    }
    try:
        scope = microscope_of(parts)
    except InputError:
        return None  # what is wrong is said when the scene is checked
    return scope.drive.free_amplitude / scope.driven_amplitude


def _labels(scan: xr.Dataset, phases: int | None, by: str) -> tuple[np.ndarray, str]:
    """Labels of the materials, and a sentence where there is one only that was not asked for."""
    values = recorded_sign(scan.attrs if by == "phase" else {}) * scan["height" if phases == 1 else by].values
    uniform = np.zeros(values.shape, int)
    if phases == 1:
        return uniform, ""
    if phases is None and not np.ptp(values):
        return uniform, f"The {by} is the same everywhere: there is one material."
    labels = segment_phase(values, phases or 2) if by == "phase" else segment_height(values, phases or 2)
    levelled = values if by == "phase" else level_height(values, labels == np.bincount(labels.ravel()).argmax())
    distance, ratio = separation_of(levelled, labels)
    if ratio >= APART:
        return labels, ""
    reason = (
        f"The {by} shows one population (parts of it are {say(distance, UNITS_OF[by], 2)} apart, {ratio:.2g} times the "
        f"spread within them; materials are distinguished from {APART:g} times on)"
    )
    if phases is not None:
        other = "height" if by == "phase" else "phase"
        raise InputError("phases", phases, "fewer for this image", f"{reason}. Try by={other!r} (--by {other}) too.")
    return uniform, f"{reason}: there is one material."


def _maps(scan: xr.Dataset, labels: np.ndarray, by: str) -> xr.Dataset:
    """Labels of the materials, and the topography."""
    topography = level_height(scan["height"].values, labels == np.bincount(labels.ravel()).argmax())
    maps = {
        "labels": (labels.astype(np.int32), {"long_name": f"material, from the lowest {by}"}),
        "topography": (topography, {"long_name": "levelled recorded height", "units": "m"}),
    }
    if "phase" in scan:
        about = {"long_name": "recorded phase, its zero arbitrary, repulsive positive", "units": "degree"}
        maps["phase"] = (recorded_sign(scan.attrs) * scan["phase"].values, about)
    return xr.Dataset(
        {name: (("y", "x"), *one) for name, one in maps.items()},
        {dim: scan[dim] for dim in ("y", "x")},
        {key: scan.attrs[key] for key in ("source", "source_sha256") if key in scan.attrs},
    )


def _shares(labels: np.ndarray, scan: xr.Dataset) -> list[str]:
    """Sentences on the share of the image that each material covers, and its recorded phase."""
    told = []
    for label in range(int(labels.max()) + 1):
        part = labels == label
        share = f"{100 * part.mean():.3g} % of the image"
        if "phase" in scan and part.any():
            share += f", median of the recorded phase {np.median(scan['phase'].values[part]):.3g} degrees"
        told.append(share)
    return told


def _heading(scan: xr.Dataset, path: Path, homogeneous: str) -> list[str]:
    """Lines at the head of the scene: its source, how to run it, and warnings about the file."""
    source = f"{scan.attrs.get('source', 'a measured image')} {scan.attrs.get('direction', '')}".rstrip()
    return [
        f"The surface and the microscope of {source}, by phasemap scene.",
        "",
        f"  phasemap run {shlex.quote(path.name)} -o {shlex.quote(path.stem + '.nc')}",
        "",
        "The materials are PLACEHOLDERS unless given: an image does not say what it is of. EDIT [materials.*]: first "
        "modulus and adhesion, which decide where the tip is repulsive, then damping, until the simulated contrast is "
        "the measured one. The zero of a measured phase is arbitrary; phasemap series fits several files at once.",
        *([homogeneous] if homogeneous else []),
        *str(scan.attrs.get("warnings", "")).splitlines(),
        "Every length is in m, every other quantity in SI units.",
    ]
