"""The commands ``phasemap sweep``, of one material of a scene, and ``phasemap contrast``, of two."""

from __future__ import annotations

import argparse
import json
import math
import re
import time
from typing import TYPE_CHECKING, Any

from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError, PhasemapError
from phasemap._shared.units import readable
from phasemap.cli.arguments import (
    SURFACE_UNUSED,
    add_colours,
    add_files,
    add_options,
    add_scene,
    check_files,
    colours_of,
    conclude,
    number_in,
    number_or_range,
    whole_number,
)
from phasemap.cli.console import progress_bar, remarks

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from phasemap.experiment.material import Material
    from phasemap.experiment.microscope import Microscope
    from phasemap.scenes.scene import SceneSetup

BEYOND = 5e-9  # farther than the free amplitude, where an approach begins [m]
SETPOINTS = (0.98, 0.1)
HALF_WIDTHS = 10.0  # on either side of the resonance
SPREAD = math.sqrt(10.0)  # of a parameter, on either side of the scene's value
SWEEP_EXAMPLES = """AXIS, and what START and STOP are if they are not given (SI units):
  distance   tip offset, approach and retract; from 5 nm beyond the free amplitude to 0
  setpoint   with the feedback on; from 0.98 to 0.1
  frequency  of the drive, feedback off; 10 half widths on either side of the resonance; the tip
             stays where the feedback held the setpoint, or at --tip-offset
  NAME       one of modulus, adhesion, damping, viscosity, poisson_ratio, thickness, relaxed_modulus,
             relaxation_time, liquid_film, contact_angle, stiffness, quality_factor, radius, free_amplitude,
             decay_length, bias, with the setpoint (or --tip-offset) held; half a decade on either side of
             what the scene says

examples:
  phasemap sweep samples/particles.toml distance --material matrix --plot curve.png
  phasemap sweep samples/blend.toml setpoint --material ldpe -o setpoints.nc drive.free_amplitude=20e-9
  phasemap sweep samples/blend.toml frequency 298e3 302e3 -n 400 --material ps --tip-offset 35e-9
  phasemap sweep samples/blend.toml modulus 0.1e9 10e9 --log --material ps --setpoint 0.6
  phasemap sweep samples/step.toml distance 45e-9 -5e-9 --material stiff --samples 256 -o curve.nc
"""


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser._negative_number_matcher = re.compile(r"^-\.?\d")  # argparse's own has neither 1e-9 nor 5nm
    parser.usage = "%(prog)s SCENE.toml AXIS [START STOP] [options] [key=value ...]"
    add_scene(parser, SURFACE_UNUSED, overrides=False)
    parser.add_argument("axis", metavar="AXIS", help="distance, setpoint, frequency or a parameter; see below")
    parser.add_argument(
        "overrides", metavar="START STOP key=value", nargs="*", default=[],
        help="first and last value, in SI units or with a unit, such as 60nm 0nm, or START:STOP:N; keys of the scene "
        "to set, such as tip.radius=20nm",
    )  # fmt: skip
    parser.add_argument(
        "-n", "--points", type=whole_number, default=200, metavar="N", help="number of values; default: 200"
    )
    parser.add_argument("--log", action="store_true", help="space the values logarithmically")
    parser.add_argument("--material", metavar="NAME", help="material of the scene; not needed if it has only one")
    held = parser.add_mutually_exclusive_group()
    about = "setpoint, amplitude over free amplitude; default: the scene's"
    held.add_argument("--setpoint", type=number_in("--setpoint", "1"), metavar="S", help=about)
    about = "hold the tip at this rest position, in m or such as 35nm"
    held.add_argument("--tip-offset", type=number_in("--tip-offset", "m"), metavar="Z", help=about)
    about = "also keep N points of deflection and force over a period"
    parser.add_argument("--samples", type=int, default=0, metavar="N", help=about)
    add_files(parser)
    add_options(parser, "quiet", "strict-units")


def sweep(arguments: argparse.Namespace) -> None:
    """Sweep a material of a scene, write the files asked for, and print a summary."""
    from phasemap.scenes.scene import load_setup
    from phasemap.solvers.continuation.path import UNITS

    started = time.perf_counter()
    check_choice("AXIS", arguments.axis, dict.fromkeys(("distance", "setpoint", "frequency", *UNITS)))
    ends, points, overrides = _split_words(arguments.overrides, arguments.axis, arguments.points)
    swept = f"AXIS, which is {arguments.axis}" if arguments.axis in ("distance", "setpoint") else ""
    held = (
        "--setpoint" if arguments.setpoint is not None else "--tip-offset" if arguments.tip_offset is not None else ""
    )
    setup = load_setup(arguments.scene, overrides, swept or held)
    name, material = _material(setup, arguments.material)
    values = _axis_values(arguments, ends, points, material, setup.microscope)
    check_files(arguments)
    ds = _sweep_along_axis(arguments, values, material, setup)
    ds.attrs["title"] = f"{name} of {arguments.scene.name}"
    conclude(arguments, ds, "curve", said_of_sweep(ds), started)


def _split_words(words: list[str], axis: str, points: int) -> tuple[tuple[float, float] | None, int, list[str]]:
    """START and STOP if given, number of values, and overrides of the scene, from words of the command line."""
    overrides = [word for word in words if "=" in word]
    ends = [word for word in words if "=" not in word]
    if len(ends) == 1 and ":" in ends[0]:
        start, stop, count = _numbers("START:STOP:N", ends[0], axis)
        return (start, stop), int(count), overrides
    if len(ends) not in (0, 2):
        raise InputError("START STOP", " ".join(ends), "both of them or none, or START:STOP:N")
    given = [_numbers("START or STOP", word, axis)[0] for word in ends]
    return (given[0], given[1]) if given else None, points, overrides


def _numbers(name: str, text: str, axis: str) -> tuple[float, ...]:
    """Numbers in a word in the unit of an axis: one, or START, STOP and N."""
    from phasemap.solvers.continuation.path import UNITS

    return number_or_range(name, text, {"distance": "m", "setpoint": "1"}.get(axis) or UNITS[axis])


def _material(setup: SceneSetup, name: str | None) -> tuple[str, Material]:
    """The material asked for, or the only one."""
    names = list(setup.materials)
    if not names:
        raise PhasemapError("the scene has no [materials]: give one, such as materials.mine.modulus=1e9.")
    if name is None:
        if len(names) > 1:
            raise PhasemapError(f"the scene has several materials: choose one with --material: {', '.join(names)}.")
        name = names[0]
    check_choice("--material", name, names)
    return name, setup.materials[name]


def _axis_values(
    arguments: argparse.Namespace, ends: tuple[float, float] | None, points: int, material: Material, scope: Microscope
) -> np.ndarray:
    """Values of the swept axis."""
    import numpy as np

    if points < 2:
        raise InputError("--points", points, "a whole number of at least 2")
    start, stop = ends or _usual_ends(arguments.axis, material, scope)
    by_itself = ends is None and arguments.axis not in ("distance", "setpoint", "frequency")
    logarithmic = arguments.log or (by_itself and min(start, stop) > 0)
    if start == stop or not math.isfinite(start) or not math.isfinite(stop):
        raise InputError("START STOP", f"{start:g} {stop:g}", "two different finite numbers")
    if logarithmic and min(start, stop) <= 0:
        raise InputError("START STOP", f"{start:g} {stop:g}", "two numbers above 0, for --log")
    return (np.geomspace if logarithmic else np.linspace)(start, stop, points)


def _usual_ends(axis: str, material: Material, scope: Microscope) -> tuple[float, float]:
    """START and STOP where they are not given."""
    if axis == "distance":
        return scope.driven_amplitude + BEYOND, 0.0
    if axis == "setpoint":
        return SETPOINTS
    if axis == "frequency":
        resonance, reach = scope.cantilever.resonance_frequency, HALF_WIDTHS * scope.cantilever.damping_ratio
        return resonance * max(1 - reach, 0.1), resonance * (1 + reach)
    owners = (material, scope.cantilever, scope.tip, scope.drive, scope.interaction)
    value = next((getattr(owner, axis) for owner in owners if hasattr(owner, axis)), None)
    if not value or axis == "poisson_ratio":
        raise PhasemapError(f"START and STOP are missing: the scene's {axis} suggests no range.")
    return value / SPREAD, value * SPREAD


def _sweep_along_axis(
    arguments: argparse.Namespace, values: np.ndarray, material: Material, setup: SceneSetup
) -> xr.Dataset:
    """Sweep the material along the axis that the command names: distance, setpoint, frequency or a parameter."""
    from phasemap.sweeps import sweep as by

    scope, axis, samples = setup.microscope, arguments.axis, arguments.samples
    if axis in ("distance", "setpoint"):
        for option, value in (("--setpoint", arguments.setpoint), ("--tip-offset", arguments.tip_offset)):
            if value is not None:
                raise PhasemapError(f"{option} does not go with {axis}, which is what is swept.")
        do = by.sweep_distance if axis == "distance" else by.sweep_setpoint
        return do(material, scope, values, samples=samples)
    height = arguments.tip_offset
    setpoint = arguments.setpoint if arguments.setpoint is not None else setup.setpoint
    if height is None and setpoint is None:
        raise PhasemapError("the scene has no setpoint: give --setpoint or --tip-offset.")
    if axis == "frequency":
        if height is None:
            height = _offset_after_engaging(material, scope, setpoint)
        return by.sweep_frequency(material, scope, values, tip_offset=height, samples=samples)
    held: dict[str, Any] = {"setpoint": setpoint} if height is None else {"tip_offset": height}
    return by.sweep_parameter(material, scope, axis, values, **held, samples=samples)


def _offset_after_engaging(material: Material, scope: Microscope, setpoint: float | None) -> float:
    """Tip offset [m] at which a feedback stops that engages from far."""
    from phasemap.solvers.problem import check_setpoint
    from phasemap.sweeps.sweep import sweep_setpoint

    lowest = check_setpoint(setpoint)
    down = sweep_setpoint(material, scope, [(1 + lowest) / 2, lowest]).sel(direction="down")
    height = float(down["tip_offset"].values[-1])
    if not math.isfinite(height):
        raise PhasemapError(f"the tip cannot be engaged to the setpoint {setpoint:g}: give --tip-offset.")
    return height


def said_of_sweep(ds: xr.Dataset) -> list[str]:
    """Findings of a sweep, as lines of a word and a sentence: folds, jumps, and missing orbits."""
    import numpy as np

    from phasemap.results.descriptions import titles

    axis = str(ds["status"].dims[1])
    values, about = ds[axis].values, ds[axis].attrs
    unit = readable(float(np.abs(values).max()), about["units"])
    digits = 2 + math.ceil(math.log10(np.abs(values).max() / np.ptp(values)) + 2)
    held = json.loads(ds.attrs["configuration"])
    still = {axis, *(["tip_offset"] if "tip_offset" in held else [])}
    still |= {"amplitude"} if "setpoint" in (axis, *held) else set()  # the feedback holds it, through jumps too
    shown = [name for name in ("amplitude", "tip_offset", "phase") if name not in still]
    heads = ("title", "material", "microscope")[-len(titles(ds)) :]
    lines = [f"{word:<12}{line}" for word, line in zip(heads, titles(ds), strict=True)]
    ends = f"{unit.say(values[0], digits)} to {unit.say(values[-1], digits)}"
    directions = [str(word) for word in ds["direction"].values]
    lines.append(f"swept       {about['long_name']} {ends}, {len(values)} values, {' and '.join(directions)}")

    def say(name: str, prefixes: list[str], i: int) -> str:
        numbers = [float(ds[prefix + name].values[i]) for prefix in prefixes]
        unit = readable(float(np.nanmax(np.abs(numbers), initial=0.0)), ds[prefixes[0] + name].attrs["units"])
        words = dict.fromkeys(f"{number / unit.size:.4g}" for number in numbers)  # once, if it stays the same
        return f"{name.replace('_', ' ')} {' to '.join(words)} {unit.text}"

    for i, x in enumerate(ds[f"fold_{axis}"].values):
        lines.append(f"fold        at {unit.say(x, digits)}: {', '.join(say(name, ['fold_'], i) for name in shown)}")
    for i, x in enumerate(ds[f"jump_{axis}"].values):
        lands = bool(np.isfinite(ds["jump_to_phase"].values[i]))
        ends = ", ".join(say(name, ["jump_from_", "jump_to_"] if lands else ["jump_from_"], i) for name in shown)
        ends += "" if lands else ", to no steady motion"
        word = directions[int(ds["jump_direction"].values[i])]
        lines.append(f"jump        {word} at {unit.say(x, digits)}: {ends}")
    return [*lines, *remarks(ds, "points")]


MAPPED = "0.3:0.95:40"
VALUES = {"--setpoints": "1", "--free-amplitudes": "m", "--frequencies": "Hz"}
EXAMPLE = {"--setpoints": MAPPED, "--free-amplitudes": "10nm:60nm:26", "--frequencies": "299kHz:301kHz:21"}
NAMED = {"frequency": "frequencies", "free_amplitude": "free amplitudes", "setpoint": "setpoints"}
CONTRAST_EXAMPLES = """\
Values are START:STOP:N in SI units or with a unit (10nm:60nm:26), N values between; a free amplitude or a frequency may
be one number.

examples:
  phasemap contrast samples/blend.toml --materials ps,ldpe --plot contrast.png
  phasemap contrast samples/blend.toml --materials ps,ldpe --free-amplitudes 10e-9:60e-9:26 -o map.nc --plot map.png
  phasemap contrast samples/particles.toml --setpoints 0.5:0.9:30 --frequencies 299e3:301e3:21 --plot map.png
  phasemap contrast samples/blend.toml --free-amplitudes 15e-9 --plot gentle.png materials.ldpe.damping=0.01
"""


def add_contrast(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = "%(prog)s SCENE.toml [--materials FIRST,SECOND] [options] [key=value ...]"
    add_scene(parser, SURFACE_UNUSED)
    about = "two materials of the scene; not needed if it has only two"
    parser.add_argument("--materials", metavar="FIRST,SECOND", help=about)
    parser.add_argument("--setpoints", default=MAPPED, metavar="VALUES", help=f"setpoints; default: {MAPPED}")
    parser.add_argument("--free-amplitudes", metavar="VALUES", help="at resonance [m]; default: the scene's")
    parser.add_argument("--frequencies", metavar="VALUES", help="drive frequencies [Hz]; default: the scene's")
    parser.add_argument("--solver", default="auto", metavar="NAME", help="auto (default), averaging, orbit or march")
    add_files(parser)
    add_colours(parser, "the map's contrast", "-60")
    add_options(parser, "quiet", "threads", "strict-units")


def contrast(arguments: argparse.Namespace) -> None:
    """Map the contrast, write the files asked for, and print the findings."""
    from phasemap.scenes.scene import load_setup
    from phasemap.sweeps.contrasts.contrast_map import contrast as map_contrast

    started = time.perf_counter()
    setup = load_setup(arguments.scene, arguments.overrides, "--setpoints")
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
        ds = map_contrast(first, second, setup.microscope, **options, progress=progress)
    ds.attrs["title"] = f"{names[1]} minus {names[0]} of {arguments.scene.name}"
    conclude(arguments, ds, "contrast", said_of_contrast(ds), started, **colours_of(arguments))


def _names(setup: SceneSetup, text: str | None) -> tuple[str, str]:
    """The two materials asked for, or the only two."""
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
    allowed = f"START:STOP:N with N of at least 2, such as {EXAMPLE[option]}"
    allowed += "" if option == "--setpoints" else ", or one number"
    numbers = number_or_range(option, text, VALUES[option], allowed)
    if len(numbers) == 1 and option == "--setpoints":
        raise InputError(option, text, allowed)
    return numbers[0] if len(numbers) == 1 else np.linspace(numbers[0], numbers[1], int(numbers[2]))


def said_of_contrast(ds: xr.Dataset) -> list[str]:
    """Findings of a map of contrast, as lines of a word and a sentence."""
    import numpy as np

    from phasemap.results.descriptions import describe_flags
    from phasemap.sweeps.contrasts.pair import SEEN

    names = [str(name) for name in ds["material"].values]
    lines = [f"contrast    {names[1]} minus {names[0]}"]
    sizes = [f"{ds.sizes[dim]} {NAMED[str(dim)]}" for dim in ds["contrast"].dims]
    lines.append(f"mapped      {' x '.join(sizes)}")
    for word, name, unit, size in (("phase", "contrast", "degrees", 1.0), ("height", "height_contrast", "nm", 1e-9)):
        values = ds[name].values[np.isfinite(ds[name].values)] / size
        ends = f"{values.min():.4g} to {values.max():.4g} {unit}" if values.size else "none found"
        lines.append(f"{word:<12}{ends}")
    for name in names:
        lines.append(f"{'regimes':<12}{name}: {describe_flags(ds['regime'].sel(material=name))}")
    zeros, jumps = ds["inversion_setpoint"].values, ds["jump_setpoint"].values[ds["jump_inverts"].values == 1]
    for what, places in (("zero", zeros), ("jump", jumps)):
        if len(places):
            at = f"{places.min():.4g}" + (f" to {places.max():.4g}" if len(places) > 1 else "")
            lines.append(f"inverts     by a {what} at setpoint {at}")
    if not len(zeros) and not len(jumps):
        both = bool((ds["contrast"] < 0).any() and (ds["contrast"] > 0).any())  # below that it counts as none
        lines.append("inverts     nowhere" + f" by more than {SEEN:g} degrees" * both)
    reason = [f"reason      {ds.attrs['reason']}"] if ds.attrs["reason"] else []
    return [*lines, *remarks(ds, "points"), f"recommended {ds.attrs['recommendation']}", *reason]
