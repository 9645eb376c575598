"""Columns of a result row that hold integrals over its orbit: they follow those of a full row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import FULL, HARMONICS, MOST_MODES

ADHESION_VIRIAL = FULL  # -<F_att A cos> [J], F_att the force less that of the same contact without adhesion or bias
ADHESION_LOSS = FULL + 1  # what F_att takes in a cycle [J]: the energy of necks
STORAGE = FULL + 2  # <F' (dd/dtheta)^2> [J], F' the slope of the same contact without adhesion or bias
GRADIENT = FULL + 3  # <dF/dd> [N/m]
DRAG = FULL + 4  # <2 alpha_s> [1]
SIDEBANDS = FULL + 5  # what the second mode finds softer, for all yield at sidebands: real, imaginary [N/m]
WAVES = FULL + 7  # harmonics 2 ... 6 as the detector sees them, Re(Z_n exp(i n theta)): Z_n, real, imaginary [m]
LOSSES = WAVES + 2 * HARMONICS  # what the damping of each mode takes in a period [J]
WIDE = LOSSES + MOST_MODES
NOT_DRIVEN, AT_REST, IN_LOOP = 0, 1, 2  # second mode: not driven, at its free resonance, or where a loop finds it
LOSS_HARMONICS = 80  # of the force, by which modes lose energy: the rest is below 1e-4 of what all modes lose


class SolvedRows(NamedTuple):
    """Wide rows of the tip, whose integrals are to be filled in."""

    rows: np.ndarray  # shape (n, WIDE)
    averaged: np.ndarray  # bool, shape (n,); whether a row has the harmonic orbit only
    kept: np.ndarray  # rows with nodes of the orbits where COUNT is above 0, shape (n, KEEPING) or (1, 0)
