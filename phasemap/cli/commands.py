"""The command line: ``phasemap run``, ``plot``, ``sweep``, ``contrast``, ``compare``, ``scene``, ``export`` and more.

Everything heavy is imported by the command that needs it, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from phasemap._shared.checks import check_choice
from phasemap._shared.errors import ExistsError, InputError, InputErrors, PhasemapError, on_one_line
from phasemap._shared.files import reason_of
from phasemap._shared.interrupts import ending_at_once, interrupted_once, still_busy, stopped
from phasemap._shared.notices import once, strict_units
from phasemap._shared.quantities import is_number
from phasemap.cli import compare, explain, explore, images, invert, presets, run, sweeps, warm
from phasemap.cli.console import plain_warnings

Command = Callable[[argparse.Namespace], int | None]

LONGEST = 2000  # characters of a complaint

COMMANDS: tuple[tuple[str, Command, Callable[[argparse.ArgumentParser], None], str, str], ...] = (
    ("run", run.run, run.add_arguments, run.EXAMPLES, "simulate the image of a scene and write it as netCDF"),
    ("plot", images.plot, images.add_plot, images.PLOT_EXAMPLES,
     "draw an image (height and phase), a sweep, a contrast map, a comparison, a series or an inversion"),
    ("explore", explore.explore, explore.add_arguments, explore.EXAMPLES,
     "open a page in the browser with a slider for every parameter"),
    ("warm", warm.warm, warm.add_warm, warm.WARM_EXAMPLES,
     "compile the numerical code in advance, so that no later command has to wait for it"),
    ("sweep", sweeps.sweep, sweeps.add_sweep, sweeps.SWEEP_EXAMPLES,
     "sweep distance, setpoint, frequency or a parameter on one material"),
    ("contrast", sweeps.contrast, sweeps.add_contrast, sweeps.CONTRAST_EXAMPLES,
     "map the phase contrast between two materials and recommend a setpoint"),
    ("compare", compare.compare, compare.add_compare, compare.COMPARE_EXAMPLES,
     "compare a measured image with a simulated one, and say how much of it the simulation explains"),
    ("invert", invert.invert, invert.add_arguments, invert.EXAMPLES,
     "find modulus, adhesion and damping from images at several setpoints or amplitudes"),
    ("series", explain.series, explain.add_series, explain.SERIES_EXAMPLES,
     "explain the contrast in several measured files of one sample"),
    ("fit", explain.fit, explain.add_fit, explain.FIT_EXAMPLES,
     "fit a material and a contact law to a measured curve of amplitude and phase against distance"),
    ("scene", images.scene, images.add_scene, images.SCENE_EXAMPLES,
     "make a scene file from a measured image: topography, materials and microscope"),
    ("export", images.export, images.add_export, images.EXPORT_EXAMPLES,
     "write an image for Gwyddion, as .gwy or .gsf"),
    ("check", compare.check, compare.add_check, compare.CHECK_EXAMPLES,
     "verify a simulated image: test what it states, and solve its pixels again"),
    ("presets", presets.presets, presets.add_arguments, presets.EXAMPLES,
     "list the presets of materials and levers, or show one with its sources"),
    ("validate", run.validate, run.add_validate, "examples:\n  phasemap validate samples/particles.toml",
     "check a scene file and print what would be simulated"),
    ("bench", warm.bench, warm.add_bench, "examples:\n  phasemap bench --quick",
     "measure time and error of every solver and of general-purpose integrators (in a clone of the repository)"),
)  # fmt: skip
"""Name, what it does, what declares its arguments, examples, and what it is, of every command."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, by default with the arguments of the process.

    Returns the exit code: 0, 1 if what `check` looks at fails, 2 for input that cannot be used, 130 after an interrupt,
    143 after SIGTERM.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # where a terminal, or what a file is written in, lacks a letter
    words = sys.argv[1:] if argv is None else argv
    with ending_at_once():
        parser = make_parser()
        try:
            if words and not words[0].startswith("-"):
                check_choice("the command", words[0], [name for name, *_ in COMMANDS])
        except InputError as error:
            parser.exit(_complain(str(error)))
        arguments, rest = parser.parse_known_args(words)
    if "rest" in arguments:
        arguments.rest, rest = rest, []
    if strange := [word for word in rest if not _belongs(word, arguments)]:
        arguments.parser.error(f"unknown argument {strange[0]!r}")
    if "overrides" in arguments:
        arguments.overrides += rest
    asking = strict_units() if getattr(arguments, "strict_units", False) else once()
    with interrupted_once(), plain_warnings(), asking:
        code = _run_command(arguments)
        if still_busy():
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    return code


def _run_command(arguments: argparse.Namespace) -> int:
    """Run the command, print the error that it raises, and return the exit code."""
    if getattr(arguments, "quiet", False):
        os.environ["PHASEMAP_QUIET"] = "1"  # which kernels know
    try:
        return arguments.command(arguments) or 0
    except ExistsError as error:
        sentence = str(error).replace("overwrite=True", "--overwrite")
        if not _replaced(sentence):
            return _complain(sentence)
        arguments.overwrite = True
        return _run_command(arguments)
    except InputErrors as several:
        return max(_complain(str(error)) for error in several.errors)
    except (PhasemapError, ImportError) as error:  # of a numba of another version
        return _complain(str(error))
    except OSError as error:
        return _complain(reason_of(error) + (f": {error.filename}" if error.filename else "") + ".")
    except MemoryError:
        return _complain("not enough memory; simulate fewer pixels.")
    except KeyboardInterrupt as interrupt:
        return stopped(str(interrupt))


def _replaced(sentence: str) -> bool:
    """Ask on a terminal whether a file may be replaced; elsewhere it may not."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    print(f"phasemap: {on_one_line(sentence, LONGEST)} Replace it now? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _belongs(word: str, arguments: argparse.Namespace) -> bool:
    """True if a word that stands behind an option belongs to the words before it."""
    if "axis" in arguments:
        return not word.startswith("-") or is_number(word)
    return "overrides" in arguments and "=" in word and not word.startswith("-")


class _Parser(argparse.ArgumentParser):
    """Complains in one sentence."""

    def error(self, message: str) -> NoReturn:
        """Print one sentence instead of the usage, and exit."""
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


def make_parser() -> argparse.ArgumentParser:
    """Parser of all commands and their arguments."""
    lines = [(f"  phasemap {name}", examples.splitlines()) for name, _, _, examples, _ in COMMANDS]
    firsts = (next(line for line in known if line.startswith(command)) for command, known in lines)
    parser = _Parser(
        prog="phasemap",
        description="Simulate tapping-mode AFM height and phase images of heterogeneous surfaces.",
        epilog="\n".join(["examples:", *firsts]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    for name, do, add_arguments, examples, about in COMMANDS:
        command = commands.add_parser(
            name, help=about, description=about, epilog=examples, formatter_class=argparse.RawDescriptionHelpFormatter,
            add_help=do is not warm.bench,  # which is asked for by the words that it takes
        )  # fmt: skip
        command.set_defaults(command=do, parser=command)
        add_arguments(command)
    return parser


def _complain(sentence: str) -> int:
    """Print a sentence on stderr and return the exit code that goes with it."""
    print(f"phasemap: {on_one_line(sentence, LONGEST)}", file=sys.stderr)  # names of files may have any letter
    return 2
