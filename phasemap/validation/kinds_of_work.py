"""Every kind of work once, as small as it can be: what compiles the kernels ahead, and says what that costs.

Run as ``python -m phasemap.validation.kinds_of_work KIND...``; prints a line of JSON for each.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.interaction import ContactLaw, Interaction, Neck
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Mode, Tip
from phasemap.experiment.surface import Surface

SCOPE = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(16e-9))
MATERIAL, OTHER = Material(2e9, 0.05, 0.01), Material(1e9, 0.02, 0.02)
TWO = Surface(2e9, adhesion=np.repeat([[0.02, 0.1]], 2, axis=0), damping=0.01, pixel_size=2e-9)


class _Own(ContactLaw):
    """A law that nobody compiled before."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return float(0.3 * p[0] * d * d)


def _image(solver: str = "auto", control: Control | None = None) -> object:
    from phasemap.imaging.simulation import simulate

    return simulate(TWO, SCOPE, 0.8, solver, control or Engage())


def _interpolated() -> object:
    from phasemap.imaging.simulation import simulate

    many = np.linspace(1e9, 3e9, 10_000).reshape(100, 100)
    return simulate(Surface(many, adhesion=0.02, pixel_size=2e-9), SCOPE, 0.8)


def _distance(interaction: Interaction | None = None) -> object:
    from phasemap.sweeps.sweep import sweep_distance

    scope = SCOPE if interaction is None else Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, interaction)
    return sweep_distance(MATERIAL, scope, np.linspace(30e-9, 5e-9, 20))


def _frequency() -> object:
    from phasemap.sweeps.sweep import sweep_frequency

    return sweep_frequency(MATERIAL, SCOPE, np.linspace(295e3, 305e3, 20), tip_offset=10e-9)


def _contrast() -> object:
    from phasemap.sweeps.contrasts.contrast_map import contrast

    return contrast(MATERIAL, OTHER, SCOPE, np.linspace(0.4, 0.9, 3))


def _orbits() -> object:
    from phasemap.sweeps.orbits import orbits

    return orbits(MATERIAL, SCOPE, setpoint=0.8)


def _check() -> object:
    from phasemap.imaging.simulation import simulate
    from phasemap.validation.checking.check import check

    return check(simulate(TWO, SCOPE, 0.8), TWO)


def _invert() -> object:
    from phasemap.imaging.simulation import simulate
    from phasemap.inference.images.images import invert

    return invert([simulate(TWO, SCOPE, one) for one in (0.8, 0.6)], SCOPE, phase_zero=0.0)


def _pixel(contact: str | ContactLaw, bias: float = 0.0) -> object:
    from phasemap.solvers.pixel import solve_pixel

    return solve_pixel(
        MATERIAL, Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, Interaction(contact, bias=bias)), 0.8
    )


def _liquid() -> object:
    from phasemap.solvers.pixel import solve_pixel

    return solve_pixel(Material(1e10), Microscope(Cantilever(1.0, 300e3, 3.0), SCOPE.tip, SCOPE.drive), 0.8)


def _off_resonance() -> object:
    from phasemap.solvers.pixel import solve_pixel

    below = Drive(16e-9, frequency=270e3)  # where an exact orbit beside the one found in time is asked for
    return solve_pixel(MATERIAL, Microscope(SCOPE.cantilever, SCOPE.tip, below), 0.8, "orbit")


def _second_mode() -> object:
    from phasemap.imaging.simulation import simulate

    second = Mode(1600.0, frequency=1.88e6, quality_factor=600.0, free_amplitude=0.1e-9)
    scope = Microscope(SCOPE.cantilever, SCOPE.tip, Drive(16e-9, second=second))
    return simulate(TWO, scope, 0.8, variables=["mode2_phase", "amplitude_2"])


def _relaxation() -> object:
    from phasemap.imaging.simulation import simulate

    relaxing = Surface(2e9, relaxed_modulus=1e9, relaxation_time=30e-9, pixel_size=2e-9, shape=(1, 1))
    return simulate(relaxing, SCOPE, 0.8)


KINDS: dict[str, Callable[[], object]] = {
    "image": _image,
    "continuous maps": _interpolated,
    "distance sweep": _distance,
    "frequency sweep": _frequency,
    "contrast": _contrast,
    "raster": lambda: _image(control=Raster()),
    "feedback, slow flow": lambda: _image(control=Feedback()),
    "feedback, full equation": lambda: _image("march", Feedback()),
    "orbit": lambda: _image("orbit"),
    "averaging": lambda: _image("averaging"),
    "every orbit": _orbits,
    "march": lambda: _image("march"),
    "check": _check,
    "invert": _invert,
    "liquid": _liquid,
    "off resonance": _off_resonance,
    "second mode": _second_mode,
    "relaxation": _relaxation,
    "JKR pixel": lambda: _pixel("jkr"),
    "JKR sweep": lambda: _distance(Interaction("jkr")),
    "Maugis pixel": lambda: _pixel("maugis"),
    "spring": lambda: _pixel("spring"),
    "neck": lambda: _pixel(Neck(1e-9)),
    "bias": lambda: _pixel("dmt", 1.0),
    "one's own law": lambda: _pixel(_Own()),
}
_IN_TIME = (
    "march", "feedback, full equation", "feedback, slow flow", "check", "raster", "off resonance", "relaxation",
)  # fmt: skip
USUAL = (("image", "continuous maps", "orbit", "distance sweep", "contrast"), ("feedback, slow flow", "raster"))
"""What `phasemap warm` compiles, in processes side by side.

Kinds that share kernels stand together, and last what needs most of those that the other process compiles meanwhile.
"""
_STICKY = ("JKR pixel", "JKR sweep", "Maugis pixel")
ALL = (
    (*(kind for kind in KINDS if kind not in _IN_TIME + _STICKY), *_STICKY),
    _IN_TIME,
)


@dataclass(frozen=True)
class Cost:
    """What the first use of a kind of work took in a process that had done those before it."""

    kind: str
    seconds: float  # of the processor
    functions: int  # kernels that were compiled
    size: int  # of what was kept on disk [bytes]

    def __str__(self) -> str:
        """In a line."""
        return f"{self.kind:24s} {self.seconds:8.1f} s {self.functions:5d} functions {self.size / 1e6:6.2f} MB"

    @classmethod
    def of_all(cls, costs: Sequence[Cost]) -> Cost:
        """The sum."""
        seconds, functions = sum(one.seconds for one in costs), sum(one.functions for one in costs)
        return cls("all of them", seconds, functions, sum(one.size for one in costs))


def try_out(kinds: Iterable[str]) -> Iterator[Cost]:
    """Do work of these kinds in this process."""
    from phasemap._kernels.compilation import compiled
    from phasemap._kernels.disk_cache import written

    for kind in kinds:
        started, functions, size = time.process_time(), compiled(), written()
        KINDS[kind]()
        yield Cost(kind, time.process_time() - started, compiled() - functions, written() - size)


def in_processes(groups: Iterable[Iterable[str]], told: Callable[[Cost], None], cache: str | None = None) -> None:
    """Do work of these kinds, each group in a process of its own, with compiled code kept in a folder of that name.

    Raises subprocess.CalledProcessError if one fails.
    """
    import threading

    def follow(process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                told(Cost(**json.loads(line)))

    command = [sys.executable, "-m", "phasemap.validation.kinds_of_work"]
    quiet = {**os.environ, "PHASEMAP_QUIET": "1", **({} if cache is None else {"NUMBA_CACHE_DIR": cache})}
    processes = [subprocess.Popen([*command, *group], env=quiet, stdout=subprocess.PIPE, text=True) for group in groups]
    threads = [threading.Thread(target=follow, args=(process,)) for process in processes]
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    except BaseException:
        for process in processes:
            process.kill()
        raise
    for process in processes:
        if process.wait():
            raise subprocess.CalledProcessError(process.returncode, command)


def in_an_empty_cache(kinds: Iterable[str], told: Callable[[Cost], None]) -> None:
    """Do work of these kinds, one after the other, in a process that finds nothing on disk."""
    with tempfile.TemporaryDirectory(prefix="phasemap-bench-") as folder:
        in_processes([kinds], told, folder)


if __name__ == "__main__":
    for cost in try_out(sys.argv[1:]):
        print(json.dumps(asdict(cost)), flush=True)
