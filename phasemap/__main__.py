"""``python -m phasemap`` is the command ``phasemap``."""

import sys

from phasemap.cli import main

if __name__ == "__main__":
    sys.exit(main())
