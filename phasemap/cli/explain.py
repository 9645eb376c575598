"""The commands ``phasemap fit``, for a measured curve, and ``series``, for measured images of one sample."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError
from phasemap._shared.notices import untold
from phasemap.cli.arguments import (
    add_files,
    add_options,
    check_files,
    conclude,
    known_in,
    labels_in,
    one_each,
    whole_number,
)
from phasemap.cli.console import in_two_columns
from phasemap.experiment.material import Material

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.microscope import Microscope
    from phasemap.inference.curves.result import Fit

FIT_EXAMPLES = """FILE is a curve of amplitude and phase against distance: columns of text, with a line of names and
units above them or with --columns, a curve of JPK (.jpk-force) or NanoScope (.spm, .001), Asylum Research's .ibw (pip
install "afm-phasemap[read]"), or a distance sweep of phasemap. What it does not say of lever and tip is given as
key=value, or assumed and said. Tip radius, sensitivity of the amplitude, zero of the phase and how far beside its
resonance the lever is driven are fitted within what is known of them, and their errors are in those of the material.
One law takes half a minute, all of them more than ten minutes.

examples:
  phasemap plot curve.txt
  phasemap fit curve.txt --plot fit.png cantilever.stiffness=44 cantilever.resonance_frequency=344.6e3 tip.radius=7nm
  phasemap fit curve.ibw --law dmt,jkr,neck --sample mica -o fit.nc --plot fit.png
  phasemap fit three.txt.gz --columns "z approach [m],-,amplitude approach [V],lag approach [degree]" --number 2
"""


def add_fit(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s FILE [--law LIST] [options] [key=value ...]"
    parser.add_argument("file", metavar="FILE", type=Path, help="the measured curve")
    about = "set a part of the microscope, such as tip.radius=7nm"
    parser.add_argument("overrides", metavar="key=value", nargs="*", default=[], help=about)
    add_columns(parser)
    about = "contact laws to compare, with commas, such as 'jkr,lossy dmt', or all; default: as simulated, else dmt"
    parser.add_argument("--law", metavar="LIST", help=about)
    about = "preset of the material that the sample should be, to start from"
    parser.add_argument("--sample", metavar="PRESET", help=about)
    parser.add_argument("--starts", type=whole_number, default=3, metavar="N", help="most starting points; default: 3")
    add_files(parser, plot="picture of data, fit and residuals (.png, .pdf, .svg)")
    add_options(parser, "quiet", "strict-units")


def add_columns(parser: argparse.ArgumentParser) -> None:
    """Declare the options that name the columns of a text."""
    about = "names of the columns, with units: 'z approach [m],-,amplitude approach [V]'"
    parser.add_argument("--columns", metavar="LIST", help=about)
    parser.add_argument("--number", type=int, default=0, metavar="N", help="which curve of the file; default: 0")


def columns_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """The options of `phasemap.read_curve`."""
    given = arguments.columns and [None if one.strip() == "-" else one for one in arguments.columns.split(",")]
    return {"columns": given, "number": arguments.number}


def fit(arguments: argparse.Namespace) -> None:
    """Fit a curve, write the files asked for, and print the findings."""
    from phasemap.inference.curves.fit import fit_distance
    from phasemap.inference.determined import PRIOR
    from phasemap.io.curves import read_curve

    check_files(arguments)
    with untold():  # it is printed below
        curve = read_curve(arguments.file, **columns_of(arguments))
    scope, told = microscope_of_files([curve.assign_attrs(title=curve.attrs["source"])], arguments.overrides)
    given = arguments.law
    laws = given if given in (None, "all") else [one.strip() for one in given.split(",")]
    start = PRIOR if arguments.sample is None else Material.preset(arguments.sample)
    fitted = fit_distance(curve, scope=scope, start=start, laws=laws, starts=arguments.starts)
    notes = [line for line in str(curve.attrs["warnings"]).splitlines() if not line.startswith("Not recorded")]
    summary = in_two_columns([("note", line) for line in notes + told] + said_of_fit(fitted, curve.attrs), 14)
    conclude(arguments, fitted.to_dataset(), "fit", summary, width=14)


def said_of_fit(fitted: Fit, attrs: dict[str, Any]) -> list[tuple[str, str]]:
    """Findings of a fit to a curve of these attributes, in lines, the likeliest law first."""
    from phasemap.inference.curves.result import with_error

    lines = [
        (name.replace("_", " "), with_error(value, fitted.errors[name], fitted.units[name]))
        for name, value in fitted.values.items()
    ]
    recorded = 1e9 * attrs.get("amplitude_sensitivity", 0.0)
    if recorded and "sensitivity" in fitted.values:
        value, error = (recorded * numbers["sensitivity"] for numbers in (fitted.values, fitted.errors))
        lines = [line for line in lines if line[0] != "sensitivity"]
        lines.append(("sensitivity", f"{with_error(value, error, '1')} nm/V"))
    for fit in (fitted, *fitted.rivals) if fitted.rivals else ():
        chi2, apart = fit.chi2 / fit.degrees, fit.evidence - fitted.evidence
        lines.append(("law", f"{fit.law}: chi2 {chi2:.3g} a datum, evidence {apart:+.1f}"))
    return [*lines, ("verdict", fitted.status)]


SETS = {
    "cantilever": ("stiffness", "resonance_frequency", "quality_factor"),
    "tip": ("radius",),
    "drive": ("frequency", "excitation"),
}
SAID = {"stiffness": "stiffness", "quality_factor": "quality factor", "radius": "tip radius"}
SERIES_EXAMPLES = """Files are what an instrument wrote (pip install "afm-phasemap[read]") or netCDF, of one sample and
one lever, at several setpoints or amplitudes, of the same place or of others, in any order. What they do not say is
unknown: free amplitude, setpoint, zero and sign of the phase. A LIST has commas: a number a file in the order given,
or one for all; shared is one unknown for all files, free an unknown in each. key=value sets a part of the microscope
that files do not say, such as tip.radius=20nm.

examples:
  phasemap series at50.ibw at65.ibw at80.ibw --plot page.png
  phasemap series a.001 b.001 c.001 --by height --sign -1 --plot page.png tip.radius=20nm
  phasemap series a.nid b.nid --free-amplitudes 40nm,80nm --labels a_maps.nc,b_maps.nc -o series.nc
"""


def add_series(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s FILE FILE [FILE ...] [--plot PAGE.png] [options] [key=value ...]"
    parser.set_defaults(overrides=[])
    about = "two or more measured images; key=value sets a part of the microscope"
    parser.add_argument("files", metavar="FILE", nargs="+", help=about)
    parser.add_argument("--regions", type=whole_number, metavar="N", help="number of regions to find; default: 2")
    about = "channel that distinguishes regions; default: phase, or height where it shows the same far more sharply"
    parser.add_argument("--by", choices=("phase", "height"), help=about)
    about = "netCDF files with maps of regions, as phasemap scene writes them"
    parser.add_argument("--labels", metavar="LIST", help=about)
    about = "region whose material is known, a preset or one of the scene's, such as 0=mica"
    parser.add_argument("--known", metavar="LABEL=NAME", help=about)
    about = "material as first guess, a preset or one of the scene's; default: 1 GPa, 0.05 J/m2, damping 0.01"
    parser.add_argument("--prior", metavar="NAME", help=about)
    parser.add_argument("--setpoints", metavar="LIST", help="setpoints of the files; default: as recorded")
    about = "free amplitudes at the drive frequency [m], or shared or free; default: as recorded"
    parser.add_argument("--free-amplitudes", metavar="LIST", help=about)
    parser.add_argument("--phase-zero", metavar="LIST", help="phase of the free lever, or shared or free")
    about = "standard error of a region's median phase; default: 1"
    parser.add_argument("--phase-error", type=float, default=1.0, metavar="DEGREES", help=about)
    about = "sign of the recorded phase where the tip is repulsive; default: both are tried"
    parser.add_argument("--sign", type=int, choices=(1, -1), help=about)
    parser.add_argument("--scene", metavar="SCENE.toml", type=Path, help="scene file that describes the microscope")
    parser.add_argument("--direction", metavar="NAME", help="trace or retrace; default: the first in the file")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random draws; default: 0")
    add_files(parser, plot="page to draw (.png, .pdf, .svg)")
    add_options(parser, "quiet", "strict-units")


def series(arguments: argparse.Namespace) -> None:
    """Explain a series, write the files asked for, and print the findings."""
    from phasemap.inference.series.recorded import read_files
    from phasemap.inference.series.series import series as explain
    from phasemap.scenes.scene import load_setup

    check_files(arguments)
    if arguments.regions is not None and arguments.labels is not None:
        raise InputError("--regions", arguments.regions, "nothing beside --labels, which are the regions")
    words = [word for word in arguments.files if "=" in word] + arguments.overrides
    paths = [Path(word) for word in arguments.files if "=" not in word]
    images = read_files(paths)
    setup = None if arguments.scene is None else load_setup(arguments.scene, [])
    scope, told = microscope_of_files(images, words, None if setup is None else setup.microscope)
    named = {} if setup is None else setup.materials

    def material_of(name: str) -> Material:
        return named[name] if name in named else Material.preset(name)

    known = known_in(arguments.known, material_of)
    options: dict[str, Any] = {} if arguments.prior is None else {"prior": material_of(arguments.prior)}
    options |= {
        name: one_each(name, getattr(arguments, name), unit, len(paths), "a file", ("shared", "free"))
        for name, unit in (("setpoints", "1"), ("free_amplitudes", "m"), ("phase_zero", "degree"))
    }
    explained = explain(
        images, scope,
        regions=arguments.regions or 2, by=arguments.by, labels=_labels(arguments.labels, len(paths)), known=known,
        sign=arguments.sign, phase_error=arguments.phase_error, direction=arguments.direction, seed=arguments.seed,
        **options,
    )  # fmt: skip
    explained.attrs["notes"] = "\n".join([*told, explained.attrs["notes"]])
    conclude(arguments, explained, "series", said_of_series(explained))


def said_of_series(ds: xr.Dataset) -> list[str]:
    """Findings of `phasemap.series`, a line a file and a line a sentence."""
    from phasemap.results.descriptions import of_file

    lines = []
    for i, name in enumerate(ds["file"].values):
        level, size = (of_file(ds, name, i, scale) for name, scale in (("setpoint", 1.0), ("free_amplitude", 1e9)))
        parts = [
            f"{float(ds['measured_contrast'][r, i]):+.1f} ± {float(ds['contrast_error'][r, i]):.1f}° "
            f"(simulated {float(ds['fitted_contrast'][r, i]):+.1f}°)"
            for r in range(1, ds.sizes["region"])
        ]
        lines.append(("file", f"{name}: setpoint {level}, free amplitude {size} nm, contrast {'; '.join(parts)}"))
    for word, label in (("notes", "note"), ("verdict", "verdict"), ("advice", "advice")):
        lines += [(label, line) for line in ds.attrs[word].splitlines()]
    return in_two_columns(lines)


def microscope_of_files(
    images: list[xr.Dataset], words: list[str], scope: Microscope | None = None
) -> tuple[Microscope, list[str]]:
    """Microscope of files or of a scene, with the numbers that the user gives, and sentences on assumed ones."""
    from phasemap.inference.series.settings import scope_of
    from phasemap.scenes.tables import value_of

    names = [word.partition("=")[0].strip().rpartition(".")[2] for word in words]
    scope, told = scope_of(images, scope, names)
    for word in words:
        key, _, text = word.partition("=")
        part, _, name = key.strip().partition(".")
        if name not in SETS.get(part, ()):
            listed = ", ".join(f"{one}.{own}" for one, names in SETS.items() for own in names)
            hint = "It is for --free-amplitudes." if name == "free_amplitude" else ""
            raise InputError("a key of the microscope", key, listed, hint)
        scope = replace(scope, **{part: replace(getattr(scope, part), **{name: value_of(text)})})
    return scope, [one for one in told if not any(SAID.get(name, "-") in one for name in names)]


def _labels(text: str | None, count: int) -> Any:
    """Maps of regions."""
    if text is None:
        return None
    maps = [labels_in(part) for part in text.split(",")]
    if len(maps) not in (1, count):
        raise InputError("--labels", text, f"one file, or {count}")
    return maps * (count // len(maps))
