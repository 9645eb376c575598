"""What the attraction between tip and surface does along orbits that are solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap.experiment.excitation import of_tip
from phasemap.experiment.microscope import Microscope
from phasemap.solvers.problem import Work

Array = NDArray[np.float64]


def bare_rows(stiffness: Array, scope: Microscope) -> Array:
    """Parameter rows of the same contacts without adhesion, damping and bias, shape (n, 12).

    Parameters
    ----------
    stiffness : ndarray, shape (n,)
        K [Pa].
    scope : Microscope
    """
    none = np.zeros_like(stiffness)
    return replace(scope.interaction, bias=0.0).columns(stiffness, none, none, scope.tip.radius)


def with_adhesion(rows: Array, work: Work, bare: Array) -> Array:
    """Result rows widened by the virial and the loss of the attraction [J].

    The attraction is the force less that of the same contact without adhesion and bias. The orbit is taken as harmonic
    about its deepest point: in air the virial is good to 1 %, in a liquid to some 10 %.

    Parameters
    ----------
    rows : ndarray, shape (..., n, COLUMNS)
        As the detector sees them.
    work : Work
        Of the n materials.
    bare : ndarray, shape (n, 12)
        See `bare_rows`.

    Returns
    -------
    ndarray, shape (..., n, WIDE)
        NaN where there is no periodic orbit.
    """
    from phasemap._kernels.rows.adhesion import WIDE, adhesion_rows

    wide = np.full((*rows.shape[:-1], WIDE), np.nan)
    wide[..., : rows.shape[-1]] = rows
    wide[..., col.AMPLITUDE], _ = of_tip(work.lever, rows[..., col.AMPLITUDE], rows[..., col.PHASE])
    for some in wide.reshape(-1, *wide.shape[-2:]):
        adhesion_rows(work.law, work.rows, bare, some)
    wide[..., col.AMPLITUDE] = rows[..., col.AMPLITUDE]
    return wide
