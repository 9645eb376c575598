"""Kinds of work, each as small as it can be, which compile the kernels ahead, and say what that costs."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import phasemap as pm
from phasemap._shared import processes

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
LIQUID = replace(SCOPE, cantilever=pm.Cantilever(1.0, 300e3, 3.0))
BELOW = replace(SCOPE, drive=pm.Drive(16e-9, frequency=270e3))
TWO_MODES = replace(SCOPE.cantilever, modes=2)
BIMODAL = replace(SCOPE, cantilever=TWO_MODES, drive=pm.Drive(16e-9, second=pm.Mode(free_amplitude=0.1e-9)))
MATERIAL, OTHER = pm.Material(2e9, 0.05, 0.01), pm.Material(1e9, 0.02, 0.02)
TWO = pm.Surface(2e9, adhesion=np.repeat([[0.02, 0.1]], 2, axis=0), damping=0.01, pixel_size=2e-9)
MANY = pm.Surface(np.linspace(1e9, 3e9, 10_000).reshape(100, 100), adhesion=0.02, pixel_size=2e-9)
FAST = pm.Feedback(line_rate=100.0)  # a line takes as many periods as its time has
RELAXING = pm.Surface(2e9, relaxed_modulus=1e9, relaxation_time=30e-9, pixel_size=2e-9, shape=(1, 1))


class _Own(pm.ContactLaw):
    """A law that nobody compiled before."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        """Force [N] without a slope of its own, so that the quotient for that is compiled too."""
        return float(0.3 * p[0] * d * d)


def _image(*more: Any) -> Any:
    """Image of two materials."""
    return pm.simulate(TWO, SCOPE, 0.8, *more)


def _distances(scope: pm.Microscope = SCOPE) -> Any:
    """Distance sweep of one material."""
    return pm.sweep_distance(MATERIAL, scope, np.linspace(30e-9, 5e-9, 20))


def _under(contact: str | pm.ContactLaw, bias: float = 0.0) -> pm.Microscope:
    """The microscope with another contact law."""
    return replace(SCOPE, interaction=pm.Interaction(contact, bias=bias))


def _pixel(contact: str | pm.ContactLaw, bias: float = 0.0) -> Any:
    """One pixel under another contact law."""
    return pm.solve_pixel(MATERIAL, _under(contact, bias), 0.8)


KINDS: dict[str, Callable[[], object]] = {
    "image": _image,
    "continuous maps": lambda: pm.simulate(MANY, SCOPE, 0.8),
    "distance sweep": _distances,
    "frequency sweep": lambda: pm.sweep_frequency(MATERIAL, SCOPE, np.linspace(295e3, 305e3, 20), tip_offset=10e-9),
    "contrast": lambda: pm.contrast(MATERIAL, OTHER, SCOPE, np.linspace(0.4, 0.9, 3)),
    "raster": lambda: _image("auto", pm.Raster()),
    "feedback, slow flow": lambda: _image("auto", FAST),
    "feedback, full equation": lambda: _image("march", FAST),
    "orbit": lambda: _image("orbit"),
    "averaging": lambda: pm.simulate(TWO, SCOPE, 0.6, "averaging"),
    "averaging in doubt": lambda: _image("averaging"),  # exact orbits say on which branch
    "every orbit": lambda: pm.orbits(MATERIAL, SCOPE, setpoint=0.8),
    "march": lambda: _image("march"),
    "check": lambda: pm.check(_image(), TWO),
    "invert": lambda: pm.invert([pm.simulate(TWO, SCOPE, one) for one in (0.8, 0.6)], SCOPE, phase_zero=0.0),
    "liquid": lambda: pm.solve_pixel(pm.Material(1e10), LIQUID, 0.8),
    # Where an exact orbit beside the one found in time is asked for.
    "off resonance": lambda: pm.solve_pixel(MATERIAL, BELOW, 0.8, "orbit"),
    "second mode": lambda: pm.simulate(TWO, BIMODAL, 0.8, variables=["mode2_phase", "modal_dissipation_2"]),
    "relaxation": lambda: pm.simulate(RELAXING, SCOPE, 0.8),
    "JKR pixel": lambda: _pixel("jkr"),
    "JKR sweep": lambda: _distances(_under("jkr")),
    "Maugis pixel": lambda: _pixel("maugis"),
    "punch": lambda: _pixel("punch"),
    "neck": lambda: _pixel(pm.interaction.Neck(1e-9)),
    "bias": lambda: _pixel("dmt", 1.0),
    "one's own law": lambda: _pixel(_Own()),
}
_IN_TIME = ("march", "feedback, full equation", "feedback, slow flow", "check", "raster", "off resonance", "relaxation")
USUAL = (("image", "continuous maps", "orbit", "distance sweep", "contrast"), ("feedback, slow flow", "raster"))
"""Kinds that `phasemap warm` compiles, in processes side by side.

Kinds that share kernels stand together, and last what needs most of those that the other process compiles meanwhile.
"""
_STICKY = ("JKR pixel", "JKR sweep", "Maugis pixel")
ALL = ((*(kind for kind in KINDS if kind not in _IN_TIME + _STICKY), *_STICKY), _IN_TIME)


@dataclass(frozen=True)
class Cost:
    """Cost of the first use of a kind of work, in a process that had done those before it."""

    kind: str
    seconds: float  # of the processor
    functions: int  # kernels that were compiled
    size: int  # of what was kept on disk [bytes]

    def __str__(self) -> str:
        return f"{self.kind:24s} {self.seconds:8.1f} s {self.functions:5d} functions {self.size / 1e6:6.2f} MB"

    @classmethod
    def of_all(cls, costs: Sequence[Cost]) -> Cost:
        """The sum."""
        seconds, functions = sum(one.seconds for one in costs), sum(one.functions for one in costs)
        return cls("all of them", seconds, functions, sum(one.size for one in costs))


def try_out(kinds: Iterable[str]) -> list[Cost]:
    """Do work of these kinds in this process, and print the cost of each on stderr as soon as it is done."""
    from phasemap._kernels.compilation.disk_cache import written
    from phasemap._kernels.compilation.entries import compiled

    os.environ["PHASEMAP_QUIET"] = "1"  # which kernels know
    costs = []
    for kind in kinds:
        started, functions, size = time.process_time(), compiled(), written()
        KINDS[kind]()
        costs.append(Cost(kind, time.process_time() - started, compiled() - functions, written() - size))
        print(costs[-1], file=sys.stderr, flush=True)
    return costs


def in_processes(groups: Sequence[Sequence[str]]) -> list[Cost]:
    """Do work of these kinds, each group in a process of its own."""
    return [cost for costs in processes.in_processes(try_out, groups, max(2, len(groups))) for cost in costs]
