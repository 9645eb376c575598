"""Compiles what most tests need, before any of them: `python tests/warm_up.py 0` and `... 1`, side by side.

What is compiled here, all test processes load. No kernel may be compiled twice for arguments that differ in nothing but
how they were written.
"""

from __future__ import annotations

import sys

from phasemap._kernels.compilation import compiled_more_than_once
from phasemap.validation.kinds_of_work import ALL, try_out

if __name__ == "__main__":
    for _ in try_out(ALL[int(sys.argv[1])]):
        pass
    if several := compiled_more_than_once():
        sys.exit(f"kernels that are compiled more than once: {several}")
