"""Runs the measurements: ``python -m benchmarks`` is ``phasemap bench``."""

import sys

from phasemap.cli import main

sys.exit(main(["bench", *sys.argv[1:]]))
