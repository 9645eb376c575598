"""The whole of a curve: the piece from far, pieces apart from it, and those on which a tip lands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap.experiment.excitation import sees_tip, tip_amplitudes
from phasemap.experiment.microscope import Microscope
from phasemap.solvers.continuation.pieces import Curves

if TYPE_CHECKING:
    from phasemap._kernels.continuation.path import Path

APART = 6  # amplitudes at which pieces apart from the curve from far are sought
FAINT = 1e-5  # of the free amplitude, where a curve is left
BESIDE, SETTLED = 1e-5, 1e-6  # of the free amplitude: how far past an end a tip is let go, and how it settles
DEEP = 300.0  # free amplitudes by which the lever may be pressed down


def held_curves(path: Path, amplitudes: np.ndarray, samples: int) -> Curves:
    """The distance curve from far, with rows where the detector sees these amplitudes."""
    from phasemap._kernels.continuation.path import ENTRY_A, ENTRY_SEEN
    from phasemap._kernels.lever import free_amplitude

    free, plain = float(free_amplitude(path.lever)), sees_tip(path.lever)
    least = max(float(tip_amplitudes(path.lever, amplitudes[0])[0]), FAINT * free)  # of z
    curves = Curves(path, ENTRY_A if plain else ENTRY_SEEN, amplitudes, (-DEEP * free, np.inf, 0.98 * least), samples)
    curves.from_far(0.0)
    # A start is not a value wanted: beside the lowest one.
    for amplitude in np.linspace(1.0037 * least, max(0.98 * free, 1.01 * least), APART):
        curves.seek(float(amplitude))
    mend(curves, free)
    return curves


def complete(curves: Curves, scope: Microscope, lowest: float) -> None:
    """Add to the curve from far the pieces apart from it, for tip offsets from `lowest` [m] on."""
    # A tip that taps at z0 has an amplitude of about z0, or more; contact may bring the lever nearer to resonance.
    free = scope.driven_amplitude
    highest = 0.98 * max(free, scope.drive.free_amplitude)
    for amplitude in np.linspace(np.clip(lowest, 0.05 * free, 0.9 * highest), highest, APART):
        curves.seek(float(amplitude))
    mend(curves, free)


def mend(curves: Curves, free: float) -> None:
    """Find the pieces that lie beyond ends: a law with a neck, or a force that jumps, divides its curve."""
    from phasemap._kernels.continuation.path import ENTRY_M

    if any(piece.rows[i, col.KIND] == col.END for piece in curves.pieces for i in (0, -1)):
        swept = curves.index == ENTRY_M
        curves.after_ends(col.PARAMETER if swept else col.TIP_OFFSET, BESIDE * (1.0 if swept else free), SETTLED * free)
