"""The command ``phasemap contrast``: two materials of a scene, over setpoint, free amplitude and drive frequency."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError, PhasemapError
from phasemap.cli.arguments import SURFACE_UNUSED, add_files, add_options, add_scene, check_files, conclude
from phasemap.cli.colours import add_colours, colours_of
from phasemap.cli.console import progress_bar, remarks
from phasemap.cli.words import numbers_in

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.scenes.scene import Setup

SETPOINTS = "0.3:0.95:40"
VALUES = {"--setpoints": "1", "--free-amplitudes": "m", "--frequencies": "Hz"}
EXAMPLE = {"--setpoints": SETPOINTS, "--free-amplitudes": "10nm:60nm:26", "--frequencies": "299kHz:301kHz:21"}
AXES = {"frequency": "frequencies", "free_amplitude": "free amplitudes", "setpoint": "setpoints"}
EXAMPLES = """Values are START:STOP:N in SI units or with a unit (10nm:60nm:26), N values between, or one number.

examples:
  phasemap contrast samples/blend.toml --materials ps,ldpe --plot contrast.png
  phasemap contrast samples/blend.toml --materials ps,ldpe --free-amplitudes 10e-9:60e-9:26 -o map.nc --plot map.png
  phasemap contrast samples/particles.toml --setpoints 0.5:0.9:30 --frequencies 299e3:301e3:21 --plot map.png
  phasemap contrast samples/blend.toml --free-amplitudes 15e-9 --plot gentle.png materials.ldpe.damping=0.01
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s SCENE.toml [--materials FIRST,SECOND] [options] [key=value ...]"
    add_scene(parser, SURFACE_UNUSED)
    about = "two materials of the scene; not needed if it has only two"
    parser.add_argument("--materials", metavar="FIRST,SECOND", help=about)
    parser.add_argument("--setpoints", default=SETPOINTS, metavar="VALUES", help=f"setpoints; default: {SETPOINTS}")
    parser.add_argument("--free-amplitudes", metavar="VALUES", help="at resonance [m]; default: the scene's")
    parser.add_argument("--frequencies", metavar="VALUES", help="drive frequencies [Hz]; default: the scene's")
    parser.add_argument("--solver", default="auto", metavar="NAME", help="auto (default), averaging, orbit or march")
    add_files(parser)
    add_colours(parser, "the map's contrast", "-60")
    add_options(parser, "quiet", "threads", "strict-units")


def contrast(arguments: argparse.Namespace) -> None:
    """Map the contrast, write what is asked for, and say what was found."""
    from phasemap.scenes.scene import load_setup
    from phasemap.sweeps.contrasts.contrast_map import contrast as map_contrast

    started = time.perf_counter()
    setup = load_setup(arguments.scene, arguments.overrides)
    names = _names(setup, arguments.materials)
    options: dict[str, Any] = {
        "setpoints": _values("--setpoints", arguments.setpoints),
        "free_amplitudes": _values("--free-amplitudes", arguments.free_amplitudes),
        "frequencies": _values("--frequencies", arguments.frequencies),
        "solver": arguments.solver, "names": names, "threads": arguments.threads,
    }  # fmt: skip
    check_files(arguments)
    first, second = (setup.materials[name] for name in names)
    with progress_bar(" points", arguments.quiet) as progress:
        found = map_contrast(first, second, setup.microscope, **options, progress=progress)
    found.attrs["title"] = f"{names[1]} minus {names[0]} of {arguments.scene.name}"
    conclude(arguments, found, "contrast", summary(found), started, **colours_of(arguments))


def _names(setup: Setup, text: str | None) -> tuple[str, str]:
    """The two materials asked for, or the only two."""
    from phasemap.scenes.tables import check_choice

    known = list(setup.materials)
    if len(known) < 2:
        raise PhasemapError("the scene has fewer than two [materials], and a contrast needs two.")
    if text is None and len(known) > 2:
        raise PhasemapError(f"the scene has several materials: choose two with --materials: {', '.join(known)}.")
    names = known if text is None else [name.strip() for name in text.split(",")]
    for name in names:
        check_choice("--materials", name, known)
    if len(names) != 2 or names[0] == names[1]:
        raise InputError("--materials", text, "two different names with a comma between them")
    return names[0], names[1]


def _values(option: str, text: str | None) -> Any:
    """A number, or the values of START:STOP:N."""
    import numpy as np

    if text is None:
        return None
    allowed = f"START:STOP:N with N of at least 2, such as {EXAMPLE[option]}, or one number"
    found = numbers_in(option, text, VALUES[option], allowed)
    return found[0] if len(found) == 1 else np.linspace(found[0], found[1], int(found[2]))


def summary(found: xr.Dataset) -> list[str]:
    """Say what a map of contrast found, in lines of a word and what it is."""
    import numpy as np

    from phasemap.results.words import describe_flags

    names = [str(name) for name in found["material"].values]
    lines = [f"contrast    {names[1]} minus {names[0]}"]
    sizes = [f"{found.sizes[dim]} {AXES[str(dim)]}" for dim in found["contrast"].dims]
    lines.append(f"mapped      {' x '.join(sizes)}")
    for word, name, unit, size in (("phase", "contrast", "degrees", 1.0), ("height", "height_contrast", "nm", 1e-9)):
        values = found[name].values[np.isfinite(found[name].values)] / size
        ends = f"{values.min():.4g} to {values.max():.4g} {unit}" if values.size else "none found"
        lines.append(f"{word:<12}{ends}")
    for name in names:
        lines.append(f"{'regimes':<12}{name}: {describe_flags(found['regime'].sel(material=name))}")
    zeros, jumps = found["inversion_setpoint"].values, found["jump_setpoint"].values[found["jump_inverts"].values == 1]
    for what, places in (("zero", zeros), ("jump", jumps)):
        if len(places):
            at = f"{places.min():.4g}" + (f" to {places.max():.4g}" if len(places) > 1 else "")
            lines.append(f"inverts     by a {what} at setpoint {at}")
    if not len(zeros) and not len(jumps):
        lines.append("inverts     nowhere")
    return [*lines, *remarks(found, "points"), f"recommended {found.attrs['recommendation']}"]
