"""The explorer as static pages, in the folder ``try`` of the site; where its tools are missing, a page that says so."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

TOOLS = Path(__file__).parents[2] / "tools" / "browser" / "build.py"
NEEDED = ("wasm-ld", "npm")  # a linker of WebAssembly; what fetches Python for browsers
SENTENCE = "This copy of the site was built without {} and so has no explorer. Run phasemap explore."


def build(app: Any, failed: Exception | None) -> None:
    """Build them when all other pages are there."""
    if failed or app.builder.format != "html":
        return
    folder = Path(app.outdir, "try")
    missing = [name for name in NEEDED if shutil.which(name) is None]
    if missing:
        folder.mkdir(exist_ok=True)
        (folder / "index.html").write_text(
            f"<!doctype html><title>phasemap</title><p>{SENTENCE.format(' and '.join(missing))}</p>"
        )
        return
    subprocess.run([sys.executable, TOOLS, folder], check=True)


def setup(app: Any) -> dict[str, bool]:
    """Say when it is built."""
    app.connect("build-finished", build)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
