"""The command line: ``phasemap run``, ``plot``, ``sweep``, ``contrast``, ``compare``, ``scene``, ``export`` and more.

Everything heavy is imported by the command that needs it, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from phasemap._shared.errors import PhasemapError
from phasemap._shared.interrupts import INTERRUPTED, ending_at_once, interrupted_once, still_busy
from phasemap._shared.plausible import once, strict_units
from phasemap._shared.quantities import is_number
from phasemap.cli import check, compare, contrast, explore, invert, sweep, warm
from phasemap.cli import measured as cli_measured
from phasemap.cli import presets as cli_presets
from phasemap.cli import run as cli_run
from phasemap.cli import series as cli_series
from phasemap.cli.console import plain_warnings

if TYPE_CHECKING:
    pass

__all__ = ["main"]

LONGEST = 2000  # characters of a complaint
EXAMPLES = """examples:
  phasemap run samples/blend.toml -o blend.nc
  phasemap run samples/blend.toml -o soft.nc scan.setpoint=0.6 drive.free_amplitude=20e-9
  phasemap plot blend.nc
  phasemap explore samples/blend.toml
  phasemap sweep samples/particles.toml distance --material matrix --plot curve.png
  phasemap contrast samples/blend.toml --materials ps,ldpe --free-amplitudes 10e-9:60e-9:26 --plot map.png
  phasemap compare measured.nid blend.nc --plot page.png
  phasemap invert samples/blend.toml at50.nc at80.nc --regions 2 --plot materials.png
  phasemap series at50.ibw at65.ibw at80.ibw --plot page.png
  phasemap scene MoS2.nid -o mos2.toml tip.radius=10e-9 drive.free_amplitude=40e-9
  phasemap export blend.nc blend.gwy
  phasemap check blend.nc
  phasemap presets PS
  phasemap validate samples/particles.toml
  phasemap bench --quick
"""
PLOT_EXAMPLES = """examples:
  phasemap plot blend.nc
  phasemap plot blend.nc -o blend.pdf
  phasemap plot rubber.nc --mark-irregular
  phasemap plot ensemble.nc --sample 3
  phasemap plot curve.nc --quantities amplitude,phase,dissipation
  phasemap plot curve.nc --trace 12e-9 -o trace.png
"""
RUN_EXAMPLES = """examples:
  phasemap run samples/blend.toml -o blend.nc
  phasemap run samples/blend.toml -o blend.nc --overwrite materials.ldpe.modulus=0.3e9
  phasemap run samples/step.toml -o step.nc scan.solver=march --threads 1
  phasemap run samples/ensemble.toml -o ensemble.nc ensemble.count=1000 --workers 4

A scene with a table [ensemble] is simulated in all its variants. After an interrupt the same command goes on.
"""
BENCH_EXAMPLES = """examples:
  phasemap bench --quick
  phasemap bench --output bench.nc --plot bench.png
  phasemap bench --seed 7 --pixels 80 --no-peers
  phasemap bench --hard
  phasemap bench --box --materials 1000 --microscopes 100
  phasemap bench --scan
  phasemap bench --blocks
  phasemap bench --compile

Peers (numbalsoda, heyoka, scipy) are measured where they are installed: pip install "afm-phasemap[bench]".
A full run takes some four minutes, and times mean something only if nothing else runs on the machine.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; None takes those of the process.

    Returns
    -------
    int
        Exit code: 0, 1 if what `check` looks at fails, 2 for input that cannot be used, 130 after an interrupt.
    """
    with ending_at_once():
        parser = _parser()
        arguments, rest = parser.parse_known_args(argv)
    strange = [word for word in rest if not _belongs(word, arguments)]
    if strange:
        parser.error(f"unknown argument {strange[0]!r}")
    if "overrides" in arguments:
        arguments.overrides += rest
    asking = strict_units() if getattr(arguments, "strict_units", False) else once()
    with interrupted_once(), plain_warnings(), asking:
        code = _called(arguments)
        if still_busy():
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    return code


def _called(arguments: argparse.Namespace) -> int:
    """Call the command, and say what it raises; the exit code."""
    if getattr(arguments, "quiet", False):
        os.environ["PHASEMAP_QUIET"] = "1"  # which kernels know
    try:
        return arguments.command(arguments) or 0
    except PhasemapError as error:
        return _complain(str(error))
    except OSError as error:
        return _complain(f"{error.strerror or error}" + (f": {error.filename}" if error.filename else "") + ".")
    except MemoryError:
        return _complain("not enough memory; simulate fewer pixels.")
    except KeyboardInterrupt as stopped:
        print(f"phasemap: interrupted; {str(stopped) or 'nothing was written'}.", file=sys.stderr)
        return INTERRUPTED


def _belongs(word: str, arguments: argparse.Namespace) -> bool:
    """Whether a word that stands behind an option belongs to the words before it."""
    if "axis" in arguments:
        return not word.startswith("-") or is_number(word)
    return "overrides" in arguments and "=" in word and not word.startswith("-")


class _Parser(argparse.ArgumentParser):
    """Complains in one sentence."""

    def error(self, message: str) -> NoReturn:
        self.exit(_complain(f"{message}; see {self.prog} --help."))


class _Version(argparse.Action):
    """Prints the version, which is looked up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *args: object) -> NoReturn:
        from importlib.metadata import PackageNotFoundError, version

        try:
            print("phasemap", version("afm-phasemap"))
        except PackageNotFoundError:
            print("phasemap, not installed as a package")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    """All commands and their arguments."""
    parser = _Parser(
        prog="phasemap",
        description="Simulate tapping-mode AFM height and phase images of heterogeneous surfaces.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, do: Callable[[argparse.Namespace], int | None], about: str, epilog: str = "") -> _Parser:
        sub: _Parser = commands.add_parser(
            name, help=about, description=about, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        sub.set_defaults(command=do)
        return sub

    run = command("run", cli_run.run, "simulate the image of a scene and write it as netCDF", RUN_EXAMPLES)
    cli_run.add_scene(run)
    run.add_argument("-o", "--output", metavar="OUT.nc", type=Path, help="file to write; default: [output] file")
    run.add_argument("--overwrite", action="store_true", help="replace the output if it exists")
    run.add_argument("--quiet", action="store_true", help="no progress and no summary")
    run.add_argument("--threads", type=_positive, metavar="N", help="how many threads; default: all cores")
    run.add_argument("--workers", type=_positive, metavar="N", help="processes for an ensemble; default: all cores")
    run.add_argument("--strict", action="store_true", help="stop at the first pixel without a solution")

    plot = command(
        "plot",
        _plot,
        "draw height and phase of an image side by side, or curves, a contrast, a comparison or an inversion",
        PLOT_EXAMPLES,
    )
    plot.add_argument(
        "file",
        metavar="FILE.nc",
        type=Path,
        help="what `phasemap run`, `sweep`, `contrast`, `compare` or `invert` wrote",
    )
    plot.add_argument(
        "-o", "--output", metavar="OUT.png", type=Path, help="picture to write (.png, .pdf, .svg); default: FILE.png"
    )
    what = plot.add_mutually_exclusive_group()
    what.add_argument(
        "--quantities", metavar="A,B", help="of a sweep or an image, such as phase,dissipation; a panel each"
    )
    what.add_argument("--sample", metavar="N", type=int, help="of an ensemble: which image, from 0")
    what.add_argument("--trace", metavar="AT", help="of a sweep with --samples: one period at this value")
    plot.add_argument(
        "--mark-irregular", action="store_true", help="of an image: dots where amplitude and phase are means (motion)"
    )
    plot.add_argument("--overwrite", action="store_true", help="replace the picture if it exists")

    about = "open a page with a slider for every knob, and see at once what it does"
    explore.add_arguments(command("explore", explore.explore, about, explore.EXAMPLES))
    about = "compile ahead what is otherwise compiled when it is first used"
    warm.add_arguments(command("warm", warm.warm, about, warm.EXAMPLES))

    sweep.add_arguments(
        command(
            "sweep",
            sweep.sweep,
            "sweep distance, setpoint, frequency or a parameter over one material",
            sweep.EXAMPLES,
        ),
        _positive,
    )

    contrast.add_arguments(
        command(
            "contrast",
            contrast.contrast,
            "map the phase contrast between two materials, and say where to work",
            contrast.EXAMPLES,
        ),
        _positive,
    )

    compare.add_arguments(
        command(
            "compare",
            compare.compare,
            "lay a simulated image on a measured one, and say how much of it the simulation explains",
            compare.EXAMPLES,
        ),
        _positive,
    )

    invert.add_arguments(
        command(
            "invert",
            invert.invert,
            "find modulus, adhesion and damping from images at several setpoints or amplitudes",
            invert.EXAMPLES,
        ),
        _positive,
    )

    about = "explain the contrast in several measured files of one sample"
    cli_series.add_arguments(command("series", cli_series.series, about, cli_series.EXAMPLES), _positive)

    about = "make a scene of a measured image: topography, materials and microscope"
    cli_measured.add_scene(command("scene", cli_measured.scene, about, cli_measured.SCENE_EXAMPLES), _positive)
    about = "write an image for Gwyddion, as .gwy or .gsf"
    cli_measured.add_export(command("export", cli_measured.export, about, cli_measured.EXPORT_EXAMPLES))

    about = "solve a sample of an image's pixels again, and say whether what it says of itself holds"
    check.add_arguments(command("check", check.check, about, check.EXAMPLES), _positive)

    about = "list usual materials and levers, or one of them with its sources"
    cli_presets.add_arguments(command("presets", cli_presets.presets, about, cli_presets.EXAMPLES))

    validate = command("validate", cli_run.validate, "check a scene and say what would be simulated")
    cli_run.add_scene(validate)

    for name in ("run", "sweep", "contrast", "invert", "scene", "validate"):
        commands.choices[name].add_argument(
            "--strict-units", action="store_true", help="numbers outside all practice are errors, not warnings"
        )

    bench = command("bench", _bench, "measure time against error of every solver, and of general tools", BENCH_EXAMPLES)
    bench.add_argument("--quick", action="store_true", help="few cases, in under a minute")
    instead = bench.add_mutually_exclusive_group()
    instead.add_argument(
        "--hard", action="store_true", help="solve the hard cases instead, and say what became of each"
    )
    about = "solve materials drawn at random instead, and say what became of them and how long they took"
    instead.add_argument("--box", action="store_true", help=about)
    instead.add_argument("--scan", action="store_true", help="compare the two engines of a scan in time instead")
    instead.add_argument("--blocks", action="store_true", help="measure simulation block by block with Dask instead")
    instead.add_argument(
        "--compile", action="store_true", help="say what the first use of each kind of work takes instead"
    )
    bench.add_argument("--pixels", type=_positive, metavar="N", help="cases a regime that are compared; default: 40")
    bench.add_argument("--materials", type=_positive, metavar="N", help="with --box, in all; default: 10000")
    bench.add_argument("--microscopes", type=_positive, metavar="N", help="with --box; default: 300")
    bench.add_argument("--seed", type=int, default=1, help="of the cases drawn; default: 1")
    bench.add_argument("--no-peers", action="store_true", help="measure the solvers of phasemap only")
    bench.add_argument("-o", "--output", metavar="OUT.nc", type=Path, help="write everything measured as netCDF")
    bench.add_argument("--plot", metavar="OUT.png", type=Path, help="draw work-precision diagrams (.png, .pdf, .svg)")
    bench.add_argument("--overwrite", action="store_true", help="replace files that exist")
    return parser


def _positive(text: str) -> int:
    """A whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(text)


def _plot(arguments: argparse.Namespace) -> None:
    """Draw an image or a sweep into a file."""
    from phasemap.io.netcdf import check_target, load, load_sample
    from phasemap.plot import curve, plot, trace
    from phasemap.plot.sweep import is_sweep

    if arguments.file.suffix == ".toml":
        image = arguments.file.with_suffix(".nc").name
        raise PhasemapError(
            f"{arguments.file} is a scene: phasemap run {arguments.file} -o {image}, then plot {image}."
        )
    output = arguments.output or arguments.file.with_suffix(".png")
    check_target(output, arguments.overwrite)
    ds = load(arguments.file) if arguments.sample is None else load_sample(arguments.file, arguments.sample)
    with _as_written_by_phasemap(arguments.file):
        if arguments.trace is not None:
            trace(ds, arguments.trace, output, arguments.overwrite)
        elif arguments.quantities is not None and is_sweep(ds):
            curve(ds, output, [name.strip() for name in arguments.quantities.split(",")], arguments.overwrite)
        else:
            wanted = arguments.quantities and [name.strip() for name in arguments.quantities.split(",")]
            plot(ds, output, arguments.overwrite, variables=wanted, mark_irregular=arguments.mark_irregular)
    print(f"written to  {output}")


@contextmanager
def _as_written_by_phasemap(path: Path) -> Iterator[None]:
    """Say of a file, which may come from anywhere, that it is not what it should be."""
    try:
        yield
    except PhasemapError:
        raise
    except (AttributeError, IndexError, KeyError, RecursionError, TypeError, ValueError) as error:
        what = f"{type(error).__name__}: {error}".rstrip(".")
        raise PhasemapError(f"cannot draw {path}: it is not as phasemap writes it ({what}).") from error


def _complain(sentence: str) -> int:
    """Print a sentence on stderr and return the exit code that goes with it."""
    line = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in sentence)  # names may have any
    if len(line) > LONGEST:
        line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
    print(f"phasemap: {line}", file=sys.stderr)
    return 2


def _bench(arguments: argparse.Namespace) -> None:
    """Measure every solver, or what there are tables of their own for."""
    if arguments.hard or arguments.box or arguments.scan or arguments.blocks or arguments.compile:
        _bench_of_its_own(arguments)
        return
    for name in ("materials", "microscopes"):
        if getattr(arguments, name) is not None:
            raise PhasemapError(f"--{name} goes with --box only.")
    from phasemap.io.netcdf import check_target, save
    from phasemap.validation.bench import PIXELS, QUICK_PIXELS, bench
    from phasemap.validation.bench.picture import check_format, draw
    from phasemap.validation.bench.report import listing, table

    for path in (arguments.output, arguments.plot):
        if path is not None:
            check_target(path, arguments.overwrite)
    if arguments.plot is not None:
        check_format(arguments.plot)
    pixels = arguments.pixels or (QUICK_PIXELS if arguments.quick else PIXELS)
    with _saying() as say:
        measured = bench(pixels, arguments.seed, not arguments.no_peers, arguments.quick, say)
    print(table(measured))
    if failed := listing(measured):
        print(f"\n{failed}")
    if arguments.output is not None:
        save(measured, arguments.output, arguments.overwrite)
        print(f"\nwritten to  {arguments.output}")
    if arguments.plot is not None:
        draw(measured, arguments.plot, arguments.overwrite)
        print(f"\nwritten to  {arguments.plot}")


def _bench_of_its_own(arguments: argparse.Namespace) -> None:
    """Solve the hard cases or those of a box, compare the engines of a scan in time, or measure block by block."""
    kind = next(name for name in ("hard", "box", "scan", "blocks", "compile") if getattr(arguments, name))
    for name in ("output", "plot", "pixels", *(() if kind == "box" else ("materials", "microscopes"))):
        if getattr(arguments, name) is not None:
            raise PhasemapError(f"--{name} does not go with --{kind}, which prints a table of its own cases.")
    with _saying() as say:
        if kind == "hard":
            from phasemap.validation.bench.hard import hard

            said = hard(progress=say)
        elif kind == "box":
            from phasemap.validation.bench.box import MATERIALS, MICROSCOPES, box

            count = arguments.materials or MATERIALS
            said = box(count, arguments.microscopes or min(MICROSCOPES, count), arguments.seed, say)
        elif kind == "scan":
            from phasemap.validation.bench.scan import scan

            said = scan(progress=say)
        elif kind == "compile":
            from phasemap.validation.bench.compiling import table

            said = table(say)
        else:
            from phasemap.validation.bench.blocks import blocks

            said = blocks(progress=say)
    print(said)


@contextmanager
def _saying() -> Iterator[Callable[[str], None]]:
    """Say on stderr what is being done: on one line that changes or, where that is no terminal, on a line each."""
    terminal, last = sys.stderr.isatty(), ""

    def say(text: str) -> None:
        nonlocal last
        what = text.partition(":")[0]  # what follows counts
        if terminal:
            print(f"\r\x1b[K{text} ...", end="", file=sys.stderr, flush=True)
        elif what != last:
            print(f"{what} ...", file=sys.stderr, flush=True)
        last = what

    try:
        yield say
    finally:
        if terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
