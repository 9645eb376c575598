"""Formulas of contact laws by their places in WebAssembly's table of functions; what holds numbers is as in Python."""

from __future__ import annotations

from typing import Any, NamedTuple

import compiled

from phasemap._kernels import forces


class Law(NamedTuple):
    """Places of formulas; 0 for those that kernels know."""

    contact_force: int
    contact_slope: int
    longrange_force: int
    longrange_slope: int
    damping: int
    damping_slope: int
    attracts: int = 1
    lossy: int = 0
    memory: int = 0
    arms: int = 1


class Oscillator(NamedTuple):
    """A lever over one material."""

    law: Law
    p: Any
    lever: Any


def law_of(*formulas):
    """The law that has these formulas."""
    known = (
        forces.hertzian, forces.hertzian_slope, forces.inverse_square, forces.inverse_square_slope, forces.power_law,
        forces.power_law_slope,
    )  # fmt: skip
    return Law(*(0 if one is own else compiled.place_of(one) for one, own in zip(formulas, known)))


def parameters(row):
    """A parameter row as numbers."""
    return tuple(row.tolist())
