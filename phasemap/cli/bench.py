"""The command ``phasemap bench``: measurements of the package, which are in the repository and not in the wheel."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from phasemap._shared.errors import PhasemapError

REPOSITORY = Path(__file__).parents[2]
"""Folder that phasemap is imported from: a clone of the repository, or where packages are installed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take every word that follows the command; `benchmarks.command` declares what they may be."""
    parser.set_defaults(rest=[])


def bench(arguments: argparse.Namespace) -> None:
    """Measure what the words ask for."""
    if not (REPOSITORY / "benchmarks" / "command.py").exists():
        raise PhasemapError(
            "bench is not part of the installed package: clone the repository, or unpack the source archive, and run "
            "'pip install -e .' there."
        )
    sys.path.insert(0, str(REPOSITORY))  # before a folder of the same name in the current one
    command = importlib.import_module("benchmarks.command")
    command.add_arguments(arguments.parser)
    command.bench(arguments.parser.parse_args(arguments.rest))
