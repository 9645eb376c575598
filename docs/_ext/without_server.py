"""The explorer as static pages, in the folder ``try`` of the site; where it cannot be built, a page that says so.

Where the tools are there and it cannot be built, the build of the site fails.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

TOOLS = Path(__file__).parents[2] / "tools" / "browser" / "build.py"
NEEDED = ("wasm-ld", "npm", "node")  # a linker of WebAssembly; what fetches Python for browsers, and runs it
WITHOUT = "This copy of the site has no explorer, for {}. Run phasemap explore."


def build(app: Any, failed: Exception | None) -> None:
    """Build them when all other pages are there."""
    if failed or app.builder.format != "html":
        return
    folder = Path(app.outdir, "try")
    missing = " and ".join(name for name in NEEDED if shutil.which(name) is None)
    if not missing and subprocess.run([sys.executable, TOOLS, folder]).returncode == 0:
        return
    if not missing:
        app.statuscode = 1  # of sphinx-build
    why = f"{missing} was missing" if missing else "it could not be built"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "index.html").write_text(f"<!doctype html><title>phasemap</title><p>{WITHOUT.format(why)}</p>\n")


def setup(app: Any) -> dict[str, bool]:
    """Say when it is built."""
    app.connect("build-finished", build)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
