"""Compiles what most tests need, beside the first of them: `python tests/warm_up.py FILE`.

It is one process, for two would type many functions twice. What is compiled here, all test processes load. No kernel
may be compiled twice for arguments that differ in nothing but how they were written. What was computed meanwhile goes
into the file, bit by bit: tests/_kernels/test_first_results.py asks whether a process that loads finds the same.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bits import bits

from phasemap._kernels.compilation.entries import compiled_more_than_once
from phasemap.cli.kinds_of_work import KINDS

if __name__ == "__main__":
    found = {kind: bits(work()) for kind, work in KINDS.items()}
    if several := compiled_more_than_once():
        sys.exit(f"kernels that are compiled more than once: {several}")
    Path(sys.argv[1]).write_text(json.dumps(found))
