"""Compile the kernels into a wheel, which is then for this version of Python and this platform.

    python tools/wheel/ahead.py WHEEL FOLDER [KIND ...]

writes a wheel into FOLDER, from one that `python -m build` made. KIND: the kinds of work of
``phasemap.cli.kinds_of_work`` whose kernels it brings; without any, all of them but a law of one's own. It needs what
phasemap needs, in the versions that users will have, and the package wheel. Where versions are others, or the processor
has less than `NEEDS`, that wheel compiles as any other does.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

PROCESSORS = {"x86_64": "x86-64-v3", "amd64": "x86-64-v3"}  # of ten years and less; all others have what numba needs
NEEDS = {"x86-64-v3": ["avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"]}
LINUX = "manylinux_2_17"  # nothing is linked: of the C library, functions of <math.h> are called by their names
COMPILE = """
import json, sys
from numba.core.registry import cpu_target
from phasemap._kernels.compilation.disk_cache import versions
from phasemap.cli.kinds_of_work import ALL, in_processes
wanted = sys.argv[1:]
groups = [[kind for kind in group if kind in wanted or not wanted and kind != "one's own law"] for group in ALL]
in_processes([group for group in groups if group])
print(json.dumps([cpu_target.target_context.codegen().magic_tuple(), versions()]))
"""


def platform_tag() -> str:
    """The platform, as names of wheels have it."""
    tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    return tag.replace("linux", LINUX, 1) if tag.startswith("linux") else tag


def compile_into(unpacked: Path, kinds: list[str]) -> None:
    """Compile kernels of an unpacked wheel, and put what comes of it beside their sources."""
    processor = PROCESSORS.get(platform.machine().lower(), "generic")
    with tempfile.TemporaryDirectory() as cache:
        target = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache}
        command = [sys.executable, "-c", COMPILE, *kinds]
        environment = {**os.environ, **target, "PYTHONPATH": str(unpacked), "PYTHONDONTWRITEBYTECODE": "1"}
        said = subprocess.run(
            command, check=True, env=environment, cwd=unpacked, stdout=subprocess.PIPE, text=True
        ).stdout  # from there, for the folder that one is in comes first
        magic, versions = json.loads(said)
        ahead = unpacked / "phasemap" / "_kernels" / "ahead"
        shutil.copytree(Path(cache, "phasemap"), ahead)
    files = list(ahead.iterdir())
    (ahead / "target.json").write_text(json.dumps({"magic": magic, "needs": NEEDS.get(processor, [])}))
    print(
        f"{len(files)} files, {sum(file.stat().st_size for file in files) / 1e6:.1f} MB, for {versions} on {processor}"
    )


def main(wheel: str, folder: str, *kinds: str) -> None:
    """Unpack, compile, and pack."""
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    with tempfile.TemporaryDirectory() as place:
        tool = [sys.executable, "-m", "wheel"]
        subprocess.run([*tool, "unpack", "--dest", place, wheel], check=True, stdout=subprocess.DEVNULL)
        (unpacked,) = Path(place).iterdir()
        compile_into(unpacked, list(kinds))
        (about,) = unpacked.glob("*.dist-info/WHEEL")
        kept = [line for line in about.read_text().splitlines() if line and not line.startswith(("Root-Is", "Tag"))]
        kept += ["Root-Is-Purelib: false", f"Tag: {python}-{python}-{platform_tag()}"]
        about.write_text("\n".join(kept) + "\n")
        Path(folder).mkdir(parents=True, exist_ok=True)
        subprocess.run([*tool, "pack", "--dest-dir", folder, unpacked], check=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
