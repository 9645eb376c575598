"""Make the explorer as static pages, which need no server but one of files.

    python tools/browser/build.py FOLDER

needs ``wasm-ld`` (Debian's package lld) for the kernels, npm for Pyodide, which is Python for browsers, and node, in
which the page answers beforehand what it begins with. What was compiled is kept in the cache of the user as long as no
source of it changes, and so is Pyodide.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bundle
import cases
import numpy as np

from phasemap._kernels.quadrature import TABLES
from phasemap.explorer.offered import SAMPLES, Offered, folder_of_samples
from phasemap.explorer.routes import sample, start
from phasemap.explorer.subject import Subject

HERE = Path(__file__).parent
PAGE = bundle.PACKAGE / "explorer" / "page"
PYODIDE = "pyodide@314.0.7"
RUNTIME = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "phasemap")
BEGINS = ("picture", "curves")  # what the page asks of a sample that is chosen
Question = tuple[str, str, str | None]  # route, message, and the file of an answer that is kept


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
    shutil.copytree(runtime(), folder / "pyodide", dirs_exist_ok=True)
    kept = list(begun(offered))
    used = answered(folder, [*kept, *others(offered)])
    for archive in (folder / "python.zip", folder / "pyodide" / "python_stdlib.zip"):
        thin(archive, used)
    (folder / "prepared.json").write_text(json.dumps({f"{route} {message}": file for route, message, file in kept}))


def begun(offered: Offered) -> Iterator[Question]:
    """What is answered beforehand: pictures and curves of every sample, the first one's map of the contrast."""
    for name in SAMPLES:
        for route in (*BEGINS, *["contrast"] * (name == offered.first)):
            yield route, message(offered[name]), f"{name}-{route}.answer"


def others(offered: Offered) -> Iterator[Question]:
    """Every choice of the page, what is compared, and what is wrong: what answers import is found by asking."""
    for route, name, more in cases.MESSAGES:
        yield route, message(offered[name], more.get("changes")), None
    for knob in json.loads((PAGE / "knobs.json").read_text()):
        for value in [*knob.get("choices", ()), knob.get("usual")]:
            one = message(
                offered["step"], {knob["key"].replace("*", "0"): int(value) if str(value).isdigit() else value}
            )
            for route in (*BEGINS, "save/scene", "save/python"):
                yield route, one, None
    for wrong in ({"scan.setpoint": 3}, {"scan.setpiont": 0.5}, {"tip.radius": "2 nN"}, {"cantilever.modes": "x"}):
        yield "picture", message(offered["step"], wrong), None


def message(subject: Subject, changes: dict[str, Any] | None = None) -> str:
    """What the page asks, to the letter (`message` in state.js)."""
    names = list(subject.materials)
    asked = {"sample": subject.name, "changes": changes or {}, "names": names, "pair": [0, min(1, len(names) - 1)]}
    return json.dumps(asked | {"exact": False, "lag": False}, separators=(",", ":"), ensure_ascii=False)


def answered(folder: Path, questions: list[Question]) -> dict[str, str | None]:
    """Have the page's engine answer, in node; returns the code of the modules that it imported, by their paths."""
    node = ["node", HERE / "prepare.mjs", folder.resolve()]
    said = subprocess.run(node, input=json.dumps(questions), check=True, stdout=subprocess.PIPE, text=True).stdout
    files: dict[str, str | None] = json.loads(said.splitlines()[-1])
    return {re.sub(r"^/page/|^.*\.zip/", "", name): code for name, code in files.items()}


def thin(archive: Path, used: dict[str, str | None]) -> None:
    """Leave modules that are not used out of an archive; those that are used are there compiled."""
    with zipfile.ZipFile(archive) as whole:
        content = {name: whole.read(name) for name in whole.namelist()}
    kept = {name: one for name, one in content.items() if not name.endswith((".py", "/"))}
    code = {f"{name}c": base64.b64decode(one) for name in content if (one := used.get(name))}
    pack(archive, kept | code)


def compiled() -> Path:
    """The folder of the compiled kernels, which are made if there are none of these sources."""
    code = [
        *(bundle.PACKAGE / "_kernels").rglob("*.py"),
        *(bundle.PACKAGE / "experiment" / "interaction").rglob("*.py"),  # formulas
        *HERE.parent.glob("*.py"),
        HERE / "kernels.py",
    ]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(code))).hexdigest()[:16]
    folder = CACHE / f"webassembly-{digest}"
    if not (folder / "kernels.json").exists():  # which is written last
        for old in CACHE.glob("webassembly-*"):
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


def runtime() -> Path:
    """The folder of Pyodide, which is Python for browsers; it is fetched from npm if it is not there."""
    folder = CACHE / PYODIDE
    if all((folder / name).exists() for name in RUNTIME):
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as there:
        made = subprocess.run(
            ["npm", "pack", "--silent", PYODIDE], cwd=there, check=True, capture_output=True, text=True
        )
        with tarfile.open(Path(there, made.stdout.strip())) as package:
            for name in RUNTIME:
                content = package.extractfile(f"package/{name}")
                assert content is not None
                (folder / name).write_bytes(content.read())
    return folder


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    build(parser.parse_args().folder)
