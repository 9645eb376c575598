"""The command ``phasemap presets``: usual materials and levers, and where their numbers come from."""

from __future__ import annotations

import argparse
import itertools
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING

from phasemap._shared.fields import number_of
from phasemap._shared.units import UDUNITS, say
from phasemap.experiment.cantilever import Cantilever
from phasemap.experiment.material import Material
from phasemap.experiment.presets import levers, materials, preset_of

if TYPE_CHECKING:
    from phasemap.experiment.presets import Preset

WIDTH = 110  # of a line
HEADS = {"poisson_ratio": "Poisson ratio", "resonance_frequency": "resonance", "quality_factor": "Q"}
EXAMPLES = """A scene takes them as preset = "PS" in [materials.NAME] or preset = "PPP-NCHR" in [cantilever], and other
keys beside them; Python as pm.Material.preset("PS") and pm.Cantilever.preset("PPP-NCHR").

examples:
  phasemap presets
  phasemap presets PS
  phasemap presets OMCL-AC160TS
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="preset to show with its ranges and sources")


def presets(arguments: argparse.Namespace) -> None:
    """List all presets, or show one."""
    print("\n".join(_shown(preset_of("", arguments.name, "NAME")) if arguments.name else _listed()))


def tables() -> Iterator[tuple[str, list[list[str]]]]:
    """Tables of presets: each kind, with a row of heads and a row for each preset."""
    for kind, every in itertools.groupby([*materials().values(), *levers().values()], lambda one: one.kind):
        ones = list(every)
        columns = list(ones[0].numbers)
        heads = ["name", "", *(HEADS.get(name, name) for name in columns)]
        rows = ([one.name, _description(one), *(_number_in_words(column, one) for column in columns)] for one in ones)
        yield kind, [heads, *rows]


def _listed() -> Iterator[str]:
    """Lines that list all presets by their kinds."""
    for kind, rows in tables():
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        yield kind
        for row in rows:
            yield "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        yield ""
    yield NOTE


def _description(preset: Preset) -> str:
    """Title of a preset in a table; of a lever the maker alone, for its title repeats the name."""
    return preset.title.removesuffix(f" {preset.name}") if "levers" in preset.kind else preset.title


NOTE = """\
~ marks an estimate. `phasemap presets NAME` says where each number comes from, its range, and other names.
Numbers of levers are mostly from memory, and in air; pm.Cantilever.preset(NAME).in_liquid() is a rectangular
one in water, as is liquid = {} beside the preset in a scene."""


def _number_in_words(name: str, preset: Preset) -> str:
    """Number of a preset with its unit, and whether it is an estimate, or why it has none."""
    if name not in preset.numbers:
        return "relaxes" if name == "viscosity" else "V-shaped"
    quoted = preset.numbers[name]
    return ("~" if quoted.is_estimate else "") + _in_unit(name, quoted.value)


def _in_unit(name: str, value: float) -> str:
    """A number of a preset in text, with its unit and prefix."""
    unit = number_of(Material if name in Material.__annotations__ else Cantilever, name).unit
    return say(value, UDUNITS.get(unit, unit))


def _shown(preset: Preset) -> Iterator[str]:
    """Text with everything that is known of a preset."""
    yield f"{preset.name}: {preset.title} ({preset.kind})"
    if preset.also:
        yield f"  {'also called':<20}{', '.join(preset.also)}"
    for source, numbers in itertools.groupby(preset.numbers.items(), lambda one: one[1].source):
        for name, quoted in numbers:
            value, low, high = (_in_unit(name, number) for number in (quoted.value, quoted.low, quoted.high))
            yield f"  {name.replace('_', ' '):<20}{value}, in the range {low} to {high}"
        yield from textwrap.wrap(source, WIDTH, initial_indent=" " * 22, subsequent_indent=" " * 22)
