"""Scenes that atheris makes up, guided by the branches of the parser and of phasemap that they reach.

atheris (libFuzzer for Python) has wheels for few versions of CPython; ``pip install atheris`` where there is one. It is
run in a process of its own, for it ends the one in which it runs.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

GUIDES = [
    "tomllib", "phasemap.scenes.scene", "phasemap.scenes.surface", "phasemap.scenes.ensemble",
    "phasemap.scenes.samples", "phasemap.scenes.objects", "phasemap.scenes.surface",
    "phasemap.experiment.surface", "phasemap.experiment.surface_maps", "phasemap.experiment.labels",
    "phasemap.experiment.generate.arguments",
    "phasemap.experiment.generate.discs", "phasemap.experiment.generate.regular", "phasemap.experiment.generate.waves",
    "phasemap._shared.checks", "phasemap._shared.errors",
]  # fmt: skip
"""Modules whose branches count; numba could not compile those that it reads."""
ROOTS = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]


def fuzz(seconds: float, seed: int, save: Path) -> int:
    """Run for some seconds, say how many scenes were tried, and return how many failed."""
    if find_spec("atheris") is None:
        print("coverage: atheris is not installed")
        return 0
    save.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        _corpus(Path(folder, "corpus"))
        flags = [f"-max_total_time={seconds:g}", f"-seed={seed}", "-max_len=4096", "-timeout=20", "-rss_limit_mb=3000"]
        command = [sys.executable, __file__, "corpus", f"-artifact_prefix={save.resolve()}/", *flags]
        paths = os.pathsep.join([*ROOTS, *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {**os.environ, "PYTHONPATH": paths, "PHASEMAP_MEMORY": "64e6"}
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace")
    (save / "coverage.log").write_text(done.stderr + done.stdout, encoding="utf-8")
    tried = re.findall(r"^#(\d+)\s", done.stderr, re.MULTILINE)
    covered = re.findall(r"cov: (\d+)", done.stderr)
    scenes, branches = (found[-1] if found else "0" for found in (tried, covered))
    print(f"coverage: {scenes} scenes, {branches} branches, exit code {done.returncode}")
    return int(done.returncode != 0)


def _corpus(folder: Path) -> None:
    from fuzz import world
    from fuzz.writing import written

    folder.mkdir()
    for number, tables in enumerate(world.scenes()):
        (folder / f"{number}.toml").write_text(written(tables), encoding="utf-8")


def _main() -> None:
    """Be guided until the time is over."""
    import atheris

    with atheris.instrument_imports(include=GUIDES):
        for module in GUIDES:
            import_module(module)
    from fuzz import world
    from fuzz.targets import take_scene

    from phasemap._shared.errors import PhasemapError

    world.build(Path.cwd())
    take_scene((world.SAMPLES / "step.toml").read_bytes(), [])

    def one(data: bytes) -> None:
        try:
            take_scene(data, [])
        except PhasemapError:
            return

    atheris.Setup(sys.argv, one)
    atheris.Fuzz()


if __name__ == "__main__":
    _main()
