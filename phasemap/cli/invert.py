"""The command ``phasemap invert``: from images at several settings back to modulus, adhesion and damping."""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError, PhasemapError, Word
from phasemap.cli.arguments import (
    SURFACE_UNUSED,
    add_files,
    add_options,
    add_scene,
    check_files,
    conclude,
    known_in,
    labels_in,
    one_each,
)
from phasemap.cli.console import in_two_columns, progress_bar

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from phasemap.experiment.material import Material
    from phasemap.experiment.microscope import Microscope
    from phasemap.scenes.scene import SceneSetup

ZEROS = ("phase_zero", "phase_zero_error", "height_zero", "height_zero_error")
SHOWN = {"modulus": ("GPa", 1e-9), "adhesion": ("J/m²", 1.0), "damping": ("", 1.0)}
UNITS = {"free": "m", "phase": "degree", "height": "m"}  # of what options are about, by their first word
EXAMPLES = """Images are netCDF, or what an instrument wrote (pip install "afm-phasemap[read]"): registered images
of one place at several setpoints or, better, several free amplitudes too. The scene says lever, tip, drive and laws; an
image may record its own setpoint and free amplitude. A LIST has commas: a number an image, or one for all.

By regions, the zeros of phase and height are found with the materials. By pixel they have to be known: recorded with
the image, given with --phase-zero, or found by regions first, with --zeros-from.

examples:
  phasemap invert blend.toml at50.nc at65.nc at80.nc -o maps.nc --plot maps.png
  phasemap invert blend.toml at50.nid at80.nid --setpoints 0.5,0.8 --zeros-from 2 -o maps.nc
  phasemap invert blend.toml at50.nc at80.nc --regions 2 --phase-zero shared --plot regions.png
  phasemap invert flake.toml a.nid b.nid c.nid --setpoints 0.5,0.6,0.8 --regions flake_maps.nc --known 0=substrate
  phasemap invert flake.toml a.nid b.nid --setpoints 0.5,0.8 --free-amplitudes 40e-9,80e-9 --phase-zero 62.5 --sign -1
  phasemap plot maps.nc
"""


OPTIONS = (
    ("--setpoints", "LIST", "setpoints of the images; default: as recorded"),
    ("--free-amplitudes", "LIST", "free amplitudes at resonance [m]; default: as recorded, else the scene's"),
    ("--regions", "N or LABELS.nc",
     "fit one material per region: N regions found by the first phase, 0 the largest, or those of a map"),
    ("--zeros-from", "N or LABELS.nc", "fit every pixel, with the zeros that a fit by such regions finds first"),
    ("--known", "LABEL=NAME", "region whose material is known, one of the scene's, such as 0=ps"),
    ("--phase-zero", "LIST", "zero of the recorded phase [degree]; by regions also shared or free"),
    ("--phase-zero-error", "LIST", "standard error of that zero [degree]; default: 0"),
    ("--phase-error", "LIST", "standard error [degree]; default: 0.4 of a pixel, 0.1 of a region's median"),
    ("--height-error", "LIST", "standard error [m]; default: 0.1e-9 of a pixel, 0.05e-9 of a region's median"),
    ("--height-zero-error", "LIST",
     "standard error of the height offset between images [m]; by pixel, heights count only if it is given"),
    ("--prior", "NAME", "material of the scene as first guess; default: 1 GPa, 0.05 J/m2, damping 0.01"),
    ("--direction", "NAME", "trace or retrace; default: the first in the file"),
)  # fmt: skip
"""Options that take a word: name, what it stands for, and what it is."""
NEEDED = (
    "Give the scene that says lever, tip, drive and law, then images of one place at two settings or more: "
    "phasemap invert SCENE.toml IMAGE IMAGE."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s SCENE.toml IMAGE [IMAGE ...] [--regions N] [options] [key=value ...]"
    parser.set_defaults(overrides=[])
    add_scene(parser, SURFACE_UNUSED, overrides=False)
    about = "an image; key=value sets a key of the scene, such as tip.radius=20e-9"
    parser.add_argument("images", metavar="IMAGE", nargs="*", default=[], help=about)
    for option, metavar, about in OPTIONS:
        parser.add_argument(option, metavar=metavar, help=about)
    about = "the true surface is flat: heights of regions differ by indentation only"
    parser.add_argument("--flat", action="store_true", help=about)
    about = "sign of the recorded phase, -1 where lag counts positive; default: as recorded, else 1"
    parser.add_argument("--sign", choices=("1", "-1"), help=about)
    about = "factor within which the first guess is right; default: 10"
    parser.add_argument("--prior-factor", type=float, default=10.0, metavar="F", help=about)
    add_files(parser)
    add_options(parser, "quiet", "threads", "strict-units")


@dataclass(frozen=True)
class _Given:
    """Images, and how each was taken."""

    images: list[xr.Dataset]
    scopes: list[Microscope]
    setpoints: list[float]


def invert(arguments: argparse.Namespace) -> None:
    """Invert images, write the files asked for, and print the findings."""
    from phasemap.scenes.scene import load_setup

    started = time.perf_counter()
    if arguments.scene.suffix.lower() != ".toml":
        raise InputError("the scene", str(arguments.scene), "a scene file (.toml)", NEEDED)
    overrides = [word for word in arguments.images if "=" in word] + arguments.overrides
    setup = load_setup(arguments.scene, overrides, "--setpoints")
    check_files(arguments)
    given = _load([Path(word) for word in arguments.images if "=" not in word], setup, arguments, overrides)
    options: dict[str, Any] = {"setpoints": given.setpoints, "prior_factor": arguments.prior_factor}
    for name in ("phase_zero", "phase_zero_error", "phase_error", "height_error", "height_zero_error"):
        if (values := _numbers_of(name, arguments, len(given.images))) is not None:
            options[name] = values
    if arguments.prior is not None:
        options["prior"] = _material(setup, "--prior", arguments.prior)
    ds, notes = _invert(given, setup, options, arguments)
    lines = in_two_columns(_said_images(given) + [("note", note) for note in notes] + summary(ds))
    conclude(arguments, ds, "inversion", lines, started)


def _load(paths: list[Path], setup: SceneSetup, arguments: argparse.Namespace, overrides: list[str]) -> _Given:
    """The images, their setpoints and their microscopes."""
    from phasemap.io.measured import one_scan
    from phasemap.io.read import read_image

    if not paths:
        raise PhasemapError(f"there is no image behind the scene. {NEEDED}")
    images = [one_scan(read_image(path), ["phase"], arguments.direction) for path in paths]
    if arguments.sign is not None:
        images = [image.assign_attrs(phase_sign=int(arguments.sign)) for image in images]
    scope = setup.microscope
    loss = scope.drive.free_amplitude / scope.driven_amplitude
    setpoints, amplitudes = (
        _numbers_of(name, arguments, len(images)) or [None] * len(images) for name in ("setpoints", "free_amplitudes")
    )
    fixed = any(word.partition("=")[0].strip() == "drive.free_amplitude" for word in overrides)
    if fixed and amplitudes[0] is not None:
        raise InputError("drive.free_amplitude", Word("given"), "nothing beside --free-amplitudes")
    scopes = []
    for i, (path, image) in enumerate(zip(paths, images, strict=True)):
        if amplitudes[i] is None:
            recorded = "free_amplitude" in image.attrs and not fixed
            amplitudes[i] = float(image.attrs["free_amplitude"]) * loss if recorded else scope.drive.free_amplitude
        if setpoints[i] is None and "setpoint" in image.attrs:
            setpoints[i] = float(image.attrs["setpoint"])
        elif setpoints[i] is None and "setpoint_amplitude" in image.attrs:
            setpoints[i] = float(image.attrs["setpoint_amplitude"]) * loss / amplitudes[i]
        if setpoints[i] is None:
            raise PhasemapError(f"{path} does not say its setpoint: give --setpoints, one number an image.")
        scopes.append(replace(scope, drive=replace(scope.drive, free_amplitude=amplitudes[i])))
    return _Given(images, scopes, setpoints)


def _invert(
    given: _Given, setup: SceneSetup, options: dict[str, Any], arguments: argparse.Namespace
) -> tuple[xr.Dataset, list[str]]:
    """Dataset of regions or maps, and notes on it."""
    if arguments.regions is not None:
        if arguments.zeros_from is not None:
            raise InputError("--zeros-from", arguments.zeros_from, "nothing beside --regions: it is for maps by pixel")
        return _by_regions(arguments.regions, given, setup, options, arguments), []
    if arguments.zeros_from is None:
        for name in ("known", "flat"):
            if getattr(arguments, name):
                raise PhasemapError(f"--{name} is for --regions and --zeros-from.")
        return _by_pixel(given, options, arguments)
    of_medians = {name: value for name, value in options.items() if name not in ("phase_error", "height_error")}
    first = _by_regions(arguments.zeros_from, given, setup, of_medians, arguments)
    zeros = {name: first[name].values.tolist() for name in ZEROS if name in first}
    found, notes = _by_pixel(given, options | zeros, arguments)
    return found, [f"The zero of the phase, by regions, is {_said_zeros(first)}.", *notes]


def _by_pixel(given: _Given, options: dict[str, Any], arguments: argparse.Namespace) -> tuple[xr.Dataset, list[str]]:
    """Dataset of maps, and notes on it."""
    from phasemap.inference.images.invert import invert as invert_pixels

    if isinstance(options.get("phase_zero"), str) or (
        "phase_zero" not in options and not all("phase_zero" in image.attrs for image in given.images)
    ):
        raise PhasemapError(
            "by pixel the zero of the phase has to be known: give --phase-zero in degrees, "
            "or find it by regions first, with --zeros-from 2."
        )
    images, notes = given.images, []
    measured = any("configuration" not in image.attrs for image in images)
    if measured and "height_zero_error" not in options and all("height" in image for image in images):
        images = [image.drop_vars("height") for image in images]
        notes.append("Heights are not used: how those of different images compare is not known (--height-zero-error).")
    options["threads"] = arguments.threads
    with progress_bar(" pixels", arguments.quiet) as progress:
        return invert_pixels(images, given.scopes, **options, progress=progress), notes


def _by_regions(
    text: str, given: _Given, setup: SceneSetup, options: dict[str, Any], arguments: argparse.Namespace
) -> xr.Dataset:
    """Fit of one material to each region."""
    from phasemap.inference.images.regions import fit_regions

    labels = _labels(text, given.images[0])
    known = known_in(arguments.known, lambda name: _material(setup, "--known", name))
    level = 0.0 if arguments.flat else math.inf
    return fit_regions(given.images, labels, given.scopes, known=known, topography_error=level, **options)


def _labels(text: str, image: xr.Dataset) -> np.ndarray:
    """Regions of a file, or populations of the phase."""
    import numpy as np

    from phasemap.io.measured import largest_first, segment_phase
    from phasemap.io.metadata import recorded_sign

    if not text.isdecimal():
        return labels_in(text)
    if text == "0":
        raise InputError("--regions", text, "a whole number of at least 1, or a netCDF file with a map of labels")
    phase = recorded_sign(image.attrs) * image["phase"].values
    labels = np.zeros(phase.shape, np.int64) if text == "1" else segment_phase(phase, int(text)).astype(np.int64)
    return largest_first([labels], 0)[0]


def _material(setup: SceneSetup, option: str, name: str) -> Material:
    """The material of the scene with this name; of others an error that names the option."""
    check_choice(option, name, setup.materials)
    return setup.materials[name]


def _numbers_of(name: str, arguments: argparse.Namespace, count: int) -> Any:
    """Numbers of an argument, one an image, or a word."""
    words = ("shared", "free") if name == "phase_zero" else ()
    return one_each(name, getattr(arguments, name), UNITS.get(name.partition("_")[0], "1"), count, "an image", words)


def _said_images(given: _Given) -> list[tuple[str, str]]:
    """A line on each image: what it shows, at which setpoint and free amplitude."""
    lines = []
    for image, scope, setpoint in zip(given.images, given.scopes, given.setpoints, strict=True):
        heights = "phase and height" if "height" in image else "phase"
        amplitude = f"{scope.drive.free_amplitude * 1e9:.4g} nm"
        lines.append(("image", f"{heights} at setpoint {setpoint:.4g}, free amplitude {amplitude}"))
    return lines


def summary(ds: xr.Dataset) -> list[tuple[str, str]]:
    """Findings of an inversion or a fit by regions, as lines of a word and a sentence, the verdict last."""
    lines = _said_regions(ds) if "region" in ds.dims else _said_maps(ds)
    return [*lines, *_sentences(ds, "verdict"), *_sentences(ds, "advice")]


def _said_maps(ds: xr.Dataset) -> list[tuple[str, str]]:
    """The middle of each map, where it is determined."""
    import numpy as np

    lines = []
    for i, (name, (unit, factor)) in enumerate(SHOWN.items()):
        determined = ds["flag"].values >> i & 1 == 0
        sure = ds[name].values[determined]
        if not sure.size:
            lines.append((name, "not determined"))
            continue
        low, middle, high = factor * np.percentile(sure, (5, 50, 95))
        error = 100 * np.median(ds[f"{name}_error"].values[determined])
        value = f"{middle:.3g} {unit}".rstrip()
        lines.append((name, f"{value} (5 to 95 %: {low:.3g} to {high:.3g}), error {error:.2g} %"))
        if name == "damping" and "viscosity" in ds:
            viscosity = np.median(ds["viscosity"].values[determined])
            lines.append(("", f"which is a viscosity of {viscosity:.3g} Pa s"))
    return lines


def _said_regions(ds: xr.Dataset) -> list[tuple[str, str]]:
    """Materials, with the factor of one standard error, and the zeros of the phase."""
    import numpy as np

    lines = []
    words = ds["determination"].attrs["flag_meanings"].split()
    for i, label in enumerate(ds["region"].values):
        parts = []
        for name, (unit, factor) in SHOWN.items():
            value, error = factor * float(ds[name][i]), float(ds[f"{name}_error"][i])
            word = words[int(ds["determination"].sel(property=name)[i])]
            off = {"given": " (given)", "determined": f" ×/÷ {np.exp(error):.2f}"}.get(word, " (not determined)")
            if name == "damping" and "viscosity" in ds:
                off += f", which is a viscosity of {float(ds['viscosity'][i]):.3g} Pa s"
            parts.append(f"{name} {value:.3g} {unit}".rstrip() + off)
        lines.append((f"region {label}", ", ".join(parts)))
    return [*lines, ("phase zero", _said_zeros(ds))]


def _said_zeros(found: xr.Dataset) -> str:
    """The zeros of the phase, those that are equal once."""
    zeros = zip(found["phase_zero"].values, found["phase_zero_error"].values, strict=True)
    return ", ".join(dict.fromkeys(f"{round(zero, 2) + 0:.2f} ± {error:.2f}" for zero, error in zeros)) + " degrees"


def _sentences(ds: xr.Dataset, name: str) -> list[tuple[str, str]]:
    """Lines of an attribute of the findings, each with the attribute's name."""
    return [(name, line) for line in str(ds.attrs.get(name, "")).splitlines()]
