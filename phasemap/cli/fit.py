"""The command ``phasemap fit``: a material and a contact law from a measured curve."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap.cli.arguments import add_files, add_options, check_files, conclude, whole
from phasemap.cli.console import in_two_columns
from phasemap.cli.series import microscope_of

if TYPE_CHECKING:
    from phasemap.inference.curves.result import Fit

EXAMPLES = """FILE is a curve of amplitude and phase against distance: columns of text, with a line of names and
units above them or with --columns, a curve of JPK (.jpk-force) or NanoScope (.spm, .001), Asylum Research's .ibw (pip
install "afm-phasemap[read]"), or a distance sweep of phasemap. What it does not say of lever and tip is given as
key=value, or assumed and said. Tip radius, sensitivity of the amplitude and zero of the phase are fitted within what is
known of them, and their errors are in those of the material. One law takes half a minute, all of them some ten minutes.

examples:
  phasemap plot curve.txt
  phasemap fit curve.txt --plot fit.png cantilever.stiffness=44 cantilever.resonance_frequency=344.6e3 tip.radius=7nm
  phasemap fit curve.ibw --law dmt,jkr,neck --sample mica -o fit.nc --plot fit.png
  phasemap fit three.txt.gz --columns "z approach [m],-,amplitude approach [V],lag approach [degree]" --number 2
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s FILE [--law LIST] [options] [key=value ...]"
    parser.add_argument("file", metavar="FILE", type=Path, help="the measured curve")
    about = "set a part of the microscope, such as tip.radius=7nm"
    parser.add_argument("overrides", metavar="key=value", nargs="*", help=about)
    add_columns(parser)
    about = "contact laws to compare, with commas, or all; default: dmt"
    parser.add_argument("--law", metavar="LIST", default="dmt", help=about)
    about = "preset of the material that the sample should be, to start from"
    parser.add_argument("--sample", metavar="PRESET", help=about)
    parser.add_argument("--starts", type=whole, default=3, metavar="N", help="most starting points; default: 3")
    add_files(parser, plot="picture of data, fit and residuals (.png, .pdf, .svg)")
    add_options(parser, "quiet", "strict-units")


def add_columns(parser: argparse.ArgumentParser) -> None:
    """Declare what tells the columns of a text."""
    about = "names of the columns, with units: 'z approach [m],-,amplitude approach [V]'"
    parser.add_argument("--columns", metavar="LIST", help=about)
    parser.add_argument("--number", type=int, default=0, metavar="N", help="which curve of the file; default: 0")


def columns_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """The options of `phasemap.read_curve`."""
    given = arguments.columns and [None if one.strip() == "-" else one for one in arguments.columns.split(",")]
    return {"columns": given, "number": arguments.number}


def fit(arguments: argparse.Namespace) -> None:
    """Fit, write what is asked for, and say what was found."""
    from phasemap._shared.notices import untold
    from phasemap.experiment.material import Material
    from phasemap.inference.curves.fit import fit_distance
    from phasemap.inference.verdict import PRIOR
    from phasemap.io.curves import read_curve

    check_files(arguments)
    with untold():  # it is printed below
        curve = read_curve(arguments.file, **columns_of(arguments))
    scope, told = microscope_of([curve.assign_attrs(title=curve.attrs["source"])], arguments.overrides)
    laws = arguments.law if arguments.law == "all" else [one.strip() for one in arguments.law.split(",")]
    start = PRIOR if arguments.sample is None else Material.preset(arguments.sample)
    found = fit_distance(curve, scope=scope, start=start, laws=laws, starts=arguments.starts)
    notes = [line for line in str(curve.attrs["warnings"]).splitlines() if not line.startswith("Not recorded")]
    said = in_two_columns([("note", line) for line in notes + told] + summary(found, curve.attrs), 14)
    conclude(arguments, found.to_dataset(), "fit", said, width=14)


def summary(found: Fit, attrs: dict[str, Any]) -> list[tuple[str, str]]:
    """Say what a fit to a curve of these attributes found, the likeliest law first."""
    from phasemap.inference.curves.result import shown

    said = [
        (name.replace("_", " "), shown(value, found.errors[name], found.units[name]))
        for name, value in found.values.items()
    ]
    recorded = 1e9 * attrs.get("amplitude_sensitivity", 0.0)
    if recorded and "sensitivity" in found.values:
        value, error = (recorded * one["sensitivity"] for one in (found.values, found.errors))
        said = [one for one in said if one[0] != "sensitivity"]
        said.append(("sensitivity", f"{shown(value, error, '1')} nm/V"))
    for one in (found, *found.rivals) if found.rivals else ():
        chi2, apart = one.chi2 / one.degrees, one.evidence - found.evidence
        said.append(("law", f"{one.scope.interaction.law.name}: chi2 {chi2:.3g} a datum, evidence {apart:+.1f}"))
    return [*said, ("verdict", found.status)]
