"""The command ``phasemap presets``: usual materials and levers, and where their numbers come from."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phasemap.experiment.presets import Preset

WIDTH = 110  # of a line
EXAMPLES = """A scene takes them as preset = "PS" in [materials.NAME] or preset = "PPP-NCHR" in [cantilever], and other
keys beside them; Python as pm.Material.preset("PS") and pm.Cantilever.preset("PPP-NCHR").

examples:
  phasemap presets
  phasemap presets PS
  phasemap presets PPP-NCHR
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="preset to show with its ranges and sources")


def presets(arguments: argparse.Namespace) -> None:
    """List all presets, or show one."""
    from phasemap._shared.checks import check_choice
    from phasemap.experiment.material import Material
    from phasemap.experiment.microscope import Cantilever
    from phasemap.experiment.presets import levers, materials

    kinds = ((materials(), Material), (levers(), Cantilever))
    if arguments.name is None:
        print("\n".join([*_table("materials", *kinds[0]), "", *_table("levers", *kinds[1]), "", NOTE]))
        return
    known = {key.lower(): (one, cls) for every, cls in kinds for one in every.values() for key in (one.title, one.name)}
    found = known.get(arguments.name.lower())
    if found is None:
        check_choice("NAME", arguments.name, [name for every, _ in kinds for name in every])
    else:
        print("\n".join(_shown(*found)))


NOTE = (
    "~ marks an estimate. `phasemap presets NAME` says where each number comes from, and its range. Those of levers\n"
    "are mostly from memory, and in air; pm.Cantilever.preset(NAME).in_liquid() is a rectangular one in water, as is\n"
    "liquid = {} beside the preset in a scene."
)


def _table(kind: str, every: Mapping[str, Preset], cls: type) -> Iterator[str]:
    """A line for each preset."""
    columns = list(next(iter(every.values())).numbers)
    rows = [[kind, *(name.replace("_", " ") for name in columns), ""]]
    rows += [
        [name, *(_said(cls, column, one) for column in columns), one.title] for name, one in every.items()
    ]  # fmt: skip
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


def _said(cls: type, name: str, preset: Preset) -> str:
    """A number of a preset with its unit, and whether it is an estimate, or why it has none."""
    if name not in preset.numbers:
        return "relaxes" if name == "viscosity" else "V-shaped"
    quoted = preset.numbers[name]
    return ("~" if quoted.is_estimate else "") + _in_unit(cls, name, quoted.value)


def _in_unit(cls: type, name: str, value: float) -> str:
    from phasemap._shared.fields import number_of
    from phasemap._shared.units import UDUNITS, say

    unit = number_of(cls, name).unit
    return say(value, UDUNITS.get(unit, unit))


def _shown(preset: Preset, cls: type) -> Iterator[str]:
    """A preset with everything that is known of it."""
    yield f"{preset.name}: {preset.title}"
    for name, quoted in preset.numbers.items():
        value, low, high = (_in_unit(cls, name, number) for number in (quoted.value, quoted.low, quoted.high))
        yield f"  {name.replace('_', ' '):<20}{value}, in the range {low} to {high}"
        yield from textwrap.wrap(quoted.source, WIDTH, initial_indent=" " * 22, subsequent_indent=" " * 22)
