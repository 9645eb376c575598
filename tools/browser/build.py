"""Make the explorer as static pages, which need no server but one of files.

    python tools/browser/build.py FOLDER

needs ``wasm-ld`` (Debian's package lld) for the kernels, and npm for Pyodide, which is Python for browsers. What was
compiled is kept in the cache of the user as long as no source of it changes.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import bundle
import numpy as np

from phasemap._kernels.quadrature import TABLES
from phasemap.explorer.offered import SAMPLES, Offered, folder_of_samples
from phasemap.explorer.routes import sample, start
from phasemap.explorer.subject import Subject

HERE = Path(__file__).parent
PAGE = bundle.PACKAGE / "explorer" / "page"
PYODIDE = "pyodide@314.0.7"
RUNTIME = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")


def build(folder: Path) -> None:
    """Write the pages."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in compiled().iterdir():
        shutil.copy(path, folder)
    (folder / "tables.bin").write_bytes(np.ascontiguousarray(TABLES).tobytes())
    for path in [*PAGE.iterdir(), HERE / "engine.mjs", HERE / "kernels.mjs", *HERE.glob("site/*")]:
        shutil.copy(path, folder)
    pack(folder / "python.zip", bundle.modules())
    offered = Offered()
    (folder / "start.json").write_bytes(start(offered)[1])
    for name in SAMPLES:
        (folder / f"{name}.sample").write_bytes(sample(offered, name)[1])
        pack(folder / f"{name}.zip", files_of(offered[name]))
    runtime(folder / "pyodide")


def compiled() -> Path:
    """The folder of the compiled kernels, which are made if there are none of these sources."""
    code = [
        *(bundle.PACKAGE / "_kernels").rglob("*.py"),
        *(bundle.PACKAGE / "experiment").rglob("*.py"),
        HERE / "kernels.py",
    ]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(code))).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "phasemap")
    folder = cache / f"webassembly-{digest}"
    if not (folder / "kernels.json").exists():  # which is written last
        for old in cache.glob("webassembly-*"):
            shutil.rmtree(old)
        subprocess.run([sys.executable, HERE / "kernels.py", folder], check=True)
    return folder


def pack(path: Path, content: dict[str, str | bytes] | dict[str, str]) -> None:
    """Write an archive of files by their names."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as files:
        for name, one in content.items():
            files.writestr(name, one)


def files_of(subject: Subject) -> dict[str, str | bytes]:
    """A sample: what it is, which material is where, its relief in single precision, and the scene."""
    labels, relief = subject.sample
    scene = (folder_of_samples() / f"{subject.name}.toml").read_text()
    parts: dict[str, str | bytes] = {"json": json.dumps(described(subject)), "toml": scene}
    parts["labels"] = labels.astype(np.uint8).tobytes()
    if relief is not None:
        parts["relief"] = relief.astype(np.float32).tobytes()
    return {f"samples/{subject.name}.{kind}": content for kind, content in parts.items()}


def described(subject: Subject) -> dict[str, Any]:
    """A subject as the page's Python makes it again."""
    labels, relief = subject.sample
    assert subject.scene is not None
    config = {key: table for key, table in subject.scene.config.items() if key not in ("files", "output")}
    python = {"scope": subject.scope, "materials": dict(subject.materials), "options": dict(subject.options)}
    return {
        "python": {name: repr(one) for name, one in python.items()},
        "pixel_size": subject.pixel_size,
        "shape": labels.shape,
        "relief": relief is not None,
        "config": config,
    }


def runtime(folder: Path) -> None:
    """Fetch Pyodide, which is Python for browsers, from npm."""
    if all((folder / name).exists() for name in RUNTIME):
        return
    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as there:
        made = subprocess.run(
            ["npm", "pack", "--silent", PYODIDE], cwd=there, check=True, capture_output=True, text=True
        )
        with tarfile.open(Path(there, made.stdout.strip())) as package:
            for name in RUNTIME:
                content = package.extractfile(f"package/{name}")
                assert content is not None
                (folder / name).write_bytes(content.read())


if __name__ == "__main__":
    build(Path(sys.argv[1]))
