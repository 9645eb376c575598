"""The command ``phasemap series``: several measured files of one sample, explained together."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError
from phasemap.cli.arguments import add_files, add_options, check_files, conclude, whole
from phasemap.cli.console import in_two_columns
from phasemap.cli.words import labels_in, one_each

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.microscope import Microscope

SETS = {
    "cantilever": ("stiffness", "resonance_frequency", "quality_factor"),
    "tip": ("radius",),
    "drive": ("frequency", "excitation"),
}
SAID = {"stiffness": "stiffness", "quality_factor": "quality factor", "radius": "tip radius"}
EXAMPLES = """Files are what an instrument wrote (pip install "afm-phasemap[read]") or netCDF, of one sample and
one lever, at several setpoints or amplitudes, of the same place or of others, in any order. What they do not say is
unknown: free amplitude, setpoint, zero and sign of the phase. A LIST has commas: a number a file in the order given,
or one for all; shared is one unknown for all files, free an unknown in each. key=value sets a part of the microscope
that files do not say, such as tip.radius=20nm.

examples:
  phasemap series at50.ibw at65.ibw at80.ibw --plot page.png
  phasemap series a.001 b.001 c.001 --by height --sign -1 --plot page.png tip.radius=20nm
  phasemap series a.nid b.nid --free-amplitudes 40nm,80nm --labels a_maps.nc,b_maps.nc -o series.nc
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s FILE FILE [FILE ...] [--plot PAGE.png] [options] [key=value ...]"
    parser.set_defaults(overrides=[])
    about = "two or more measured images; key=value sets a part of the microscope"
    parser.add_argument("files", metavar="FILE", nargs="+", help=about)
    parser.add_argument("--regions", type=whole, default=2, metavar="N", help="number of regions to find; default: 2")
    about = "channel that distinguishes regions; default: phase, or height where it shows the same far more sharply"
    parser.add_argument("--by", choices=("phase", "height"), help=about)
    about = "netCDF files with maps of regions, as phasemap scene writes them"
    parser.add_argument("--labels", metavar="LIST", help=about)
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
    """Explain, write what is asked for, and say what was found."""
    from phasemap.inference.series.recorded import read_files
    from phasemap.inference.series.series import series as explain
    from phasemap.scenes.scene import load_setup

    check_files(arguments)
    words = [word for word in arguments.files if "=" in word] + arguments.overrides
    paths = [Path(word) for word in arguments.files if "=" not in word]
    images = read_files(paths)
    scope, told = microscope_of(images, words, arguments.scene and load_setup(arguments.scene, []).microscope)
    options: dict[str, Any] = {
        name: one_each(name, getattr(arguments, name), unit, len(paths), "a file", ("shared", "free"))
        for name, unit in (("setpoints", "1"), ("free_amplitudes", "m"), ("phase_zero", "degree"))
    }
    found = explain(
        images, scope,
        regions=arguments.regions, by=arguments.by, labels=_labels(arguments.labels, len(paths)), sign=arguments.sign,
        phase_error=arguments.phase_error, direction=arguments.direction, seed=arguments.seed, **options,
    )  # fmt: skip
    found.attrs["notes"] = "\n".join([*told, found.attrs["notes"]])
    conclude(arguments, found, "series", summary(found))


def summary(found: xr.Dataset) -> list[str]:
    """What `phasemap.series` found, a line a file and a line a sentence."""
    from phasemap.results.titles import of_file

    said = []
    for i, name in enumerate(found["file"].values):
        level, size = (of_file(found, name, i, scale) for name, scale in (("setpoint", 1.0), ("free_amplitude", 1e9)))
        parts = [
            f"{float(found['measured_contrast'][r, i]):+.1f} ± {float(found['contrast_error'][r, i]):.1f}° "
            f"(simulated {float(found['fitted_contrast'][r, i]):+.1f}°)"
            for r in range(1, found.sizes["region"])
        ]
        said.append(("file", f"{name}: setpoint {level}, free amplitude {size} nm, contrast {'; '.join(parts)}"))
    for word, label in (("notes", "note"), ("verdict", "verdict"), ("advice", "advice")):
        said += [(label, line) for line in found.attrs[word].splitlines()]
    return in_two_columns(said)


def microscope_of(
    images: list[xr.Dataset], words: list[str], scope: Microscope | None = None
) -> tuple[Microscope, list[str]]:
    """The microscope of files, or of a scene, with the numbers that the user says, and what is assumed of others."""
    from phasemap.inference.series.settings import scope_of

    names = [word.partition("=")[0].strip().rpartition(".")[2] for word in words]
    scope, told = scope_of(images, scope, names)
    for word in words:
        key, _, text = word.partition("=")
        part, _, name = key.strip().partition(".")
        if name not in SETS.get(part, ()):
            listed = ", ".join(f"{one}.{own}" for one, names in SETS.items() for own in names)
            hint = "It is for --free-amplitudes." if name == "free_amplitude" else ""
            raise InputError("a key of the microscope", key, listed, hint)
        try:
            value: Any = float(text)
        except ValueError:
            value = text.strip()
        scope = replace(scope, **{part: replace(getattr(scope, part), **{name: value})})
    return scope, [one for one in told if not any(SAID.get(name, "-") in one for name in names)]


def _labels(text: str | None, count: int) -> Any:
    """Maps of regions."""
    if text is None:
        return None
    maps = [labels_in(part) for part in text.split(",")]
    if len(maps) not in (1, count):
        raise InputError("--labels", text, f"one file, or {count}")
    return maps * (count // len(maps))
