"""The whole of a curve: the piece from far, pieces apart from it, and those on which a tip lands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap.experiment.lever import sees_tip, tip_amplitudes
from phasemap.solvers.continuation.pieces import Curves

if TYPE_CHECKING:
    from phasemap._kernels.orbits.collocation.path import Path

APART = 6  # amplitudes at which pieces apart from the curve from far are sought
FAINT = 1e-5  # of the free amplitude, where a curve is left
HARDLY_MOVING = 0.03  # of the amplitude at which orbits are sought, or the free one: a curve may come back from less
FINE = 1  # level of refinement of these
AROUND = (1.000001, 0.97, 1.03, 0.88, 1.12)  # shares of it, at which averaged orbits lead to small pieces
THROWN_LIFT = 0.08  # of it: a strong pull throws the tip out of its harmonic orbit, whose contact is too deep to start
BESIDE, SETTLED = 1e-5, 1e-6  # of the free amplitude: how far past an end a tip is let go, and how it settles
DEEP = 300.0  # free amplitudes by which the lever may be pressed down


def held_curves(path: Path, amplitudes: np.ndarray, samples: int, left: float = 0.98, level: int = 0) -> Curves:
    """The distance curve from far, with rows where the detector sees these amplitudes.

    `left`: share of the least amplitude at which a curve is left.
    `level`: of refinement, of the rows.
    """
    from phasemap._kernels.continuation.path import ENTRY_A, ENTRY_SEEN
    from phasemap._kernels.lever import free_amplitude

    free, plain = float(free_amplitude(path.lever)), sees_tip(path.lever)
    least = max(float(tip_amplitudes(path.lever, amplitudes[0])[0]), FAINT * free)  # of z
    box = (-DEEP * free, np.inf, left * least)
    curves = Curves(path, ENTRY_A if plain else ENTRY_SEEN, amplitudes, box, samples, level)
    curves.from_far(0.0)
    # A start is not a value wanted: beside the lowest one.
    for amplitude in np.linspace(1.0037 * least, max(0.98 * free, 1.01 * least), APART):
        curves.seek(float(amplitude))
    mend(curves, free)
    return curves


def complete(curves: Curves, lowest: float) -> None:
    """Add to the curve from far the pieces apart from it, for tip offsets from `lowest` [m] on."""
    # A tip that taps at z0 has an amplitude of about z0, or more; contact may bring the lever nearer to resonance.
    free, most = _free_amplitudes(curves.path)
    for amplitude in np.linspace(np.clip(lowest, 0.05 * free, 0.9 * 0.98 * most), 0.98 * most, APART):
        curves.seek(float(amplitude))
    mend(curves, free)


def orbits_of_amplitude(path: Path, amplitude: float) -> tuple[np.ndarray, bool]:
    """Rows of every orbit that the detector sees with this amplitude [m], and whether all curves were followed."""
    curves = held_curves(path, np.array([amplitude]), 0, HARDLY_MOVING, FINE)
    for share in AROUND:
        curves.seek(share * amplitude)
    curves.seek(AROUND[0] * amplitude, THROWN_LIFT * amplitude)
    return _wanted(curves)


def orbits_of_offset(path: Path, tip_offset: float, apart: bool = True) -> tuple[np.ndarray, bool]:
    """Rows of every orbit at this tip offset [m], and whether all curves were followed.

    `apart`: whether pieces apart from the curve from far are looked for, and orbits that hardly move.
    """
    from phasemap._kernels.continuation.path import ENTRY_Z0

    free, most = _free_amplitudes(path)
    curves = Curves(
        path,
        ENTRY_Z0,
        np.array([tip_offset]),
        (tip_offset - most, np.inf, (FAINT if apart else HARDLY_MOVING) * free),
        0,
    )
    curves.from_far(tip_offset + 1e-3 * abs(tip_offset) + 1e-10)
    if apart:
        complete(curves, tip_offset)
    return _wanted(curves)


def _free_amplitudes(path: Path) -> tuple[float, float]:
    """Amplitude [m] of the free lever at the drive frequency, and the larger of that and the one at resonance."""
    from phasemap._kernels.lever import free_amplitude

    free = float(free_amplitude(path.lever))
    return free, max(free, 0.5 * float(path.lever[col.DRIVE] / path.lever[col.ALPHA0]))


def _wanted(curves: Curves) -> tuple[np.ndarray, bool]:
    """Rows at the values wanted, and whether every curve was followed to its end."""
    from phasemap._kernels.continuation.piece import PIECE_FULL

    rows = np.concatenate([piece.rows for piece in curves.pieces] or [np.zeros((0, col.FULL))])
    return rows[rows[:, col.KIND] == col.WANTED], all(piece.ended != PIECE_FULL for piece in curves.pieces)


def mend(curves: Curves, free: float) -> None:
    """Find the pieces that lie beyond ends: a law with a neck, or a force that jumps, divides its curve."""
    from phasemap._kernels.continuation.path import ENTRY_M

    if any(piece.rows[i, col.KIND] == col.END for piece in curves.pieces for i in (0, -1)):
        swept = curves.index == ENTRY_M
        curves.after_ends(col.PARAMETER if swept else col.TIP_OFFSET, BESIDE * (1.0 if swept else free), SETTLED * free)
