"""Whole curves: all pieces of the curve of tip offsets, of amplitudes that are held, or of a swept parameter."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.continuation.point import ENTRY_A, ENTRY_M, ENTRY_SEEN, ENTRY_Z0
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.orbits.collocation.path import HELD_AMPLITUDE, HELD_OFFSET, Path, fixed_path, held_value
from phasemap.experiment.lever import sees_tip, tip_amplitudes
from phasemap.solvers.continuation.curves import Curves

BEYOND = 1.01  # m at which a swept curve is left, just outside the values wanted
STARTS = (-1.003, 0.0071, 1.003)  # m at which all orbits are sought, to begin a swept curve from
APART = 6  # amplitudes at which pieces apart from the curve from far are sought
FAINT = 1e-5  # of the free amplitude, where a curve is left
HARDLY_MOVING = 0.03  # of the amplitude at which orbits are sought, or the free one: a curve may come back from less
FINE = 1  # level of refinement of these
AROUND = (1.000001, 0.97, 1.03, 0.88, 1.12)  # shares of it, at which averaged orbits lead to small pieces
THROWN_LIFT = 0.08  # of it: a strong pull throws the tip out of its harmonic orbit, whose contact is too deep to start
DEEP = 300.0  # free amplitudes by which the lever may be pressed down


def held_curves(path: Path, amplitudes: np.ndarray, samples: int, left: float = 0.98, level: int = 0) -> Curves:
    """The distance curve from far, down to a share `left` of the least of the amplitudes seen, at which it has rows."""
    free, plain = float(free_amplitude(path.lever)), sees_tip(path.lever)
    least = max(float(tip_amplitudes(path.lever, amplitudes[0])[0]), FAINT * free)  # of z
    box = (-DEEP * free, np.inf, left * least)
    curves = Curves(path, ENTRY_A if plain else ENTRY_SEEN, amplitudes, box, samples, level)
    curves.from_far(0.0)
    # A start is not a value wanted: beside the lowest one.
    for amplitude in np.linspace(1.0037 * least, max(0.98 * free, 1.01 * least), APART):
        curves.follow_from_averaged(float(amplitude))
    curves.follow_past_ends()
    return curves


def distance_curves(path: Path, wanted: np.ndarray, samples: int = 0, beyond: float = 0.0) -> Curves:
    """The whole distance curve, with rows at these rising tip offsets [m]; it may be followed further by `beyond`."""
    low, high = float(wanted[0]), float(wanted[-1])
    box = (low - beyond, np.inf, FAINT * float(free_amplitude(path.lever)))
    curves = Curves(path, ENTRY_Z0, wanted, box, samples)
    curves.from_far(high + (beyond or 1e-3 * abs(high) + 1e-10))
    add_pieces_apart(curves, low)
    return curves


def swept_curves(path: Path, wanted: np.ndarray, samples: int = 0) -> Curves:
    """The curve of a swept parameter, with rows at these m."""
    curves = Curves(path, ENTRY_M, np.sort(np.concatenate([wanted, STARTS])), (-BEYOND, BEYOND, 0.0), samples)
    for m in STARTS:
        _follow_all_orbits_at(curves, m)
    if path.kind == HELD_OFFSET:
        curves.follow_past_ends()
    curves.keep_wanted(wanted)
    return curves


def _follow_all_orbits_at(curves: Curves, m: float) -> None:
    """Follow the curve from every orbit at m that is not known yet."""
    oscillator, of_amplitude = curves.oscillator_at(m), curves.path.kind == HELD_AMPLITUDE
    value, path = held_value(curves.path, m), fixed_path(oscillator)
    known = curves_to_amplitude(path, value) if of_amplitude else curves_to_offset(path, value, False)
    for orbit in (orbit for piece in known.pieces for orbit in piece.orbits):
        curves.from_orbit(orbit, m)
    if not of_amplitude:
        # Where nothing acts, or no curve leads there, the lever still swings freely.
        free = np.zeros(col.COLUMNS)
        free[col.TIP_OFFSET], free[col.AMPLITUDE] = value, free_amplitude(oscillator.lever)
        curves.from_row(free, m)


def add_pieces_apart(curves: Curves, lowest: float) -> None:
    """Add to the curve from far the pieces apart from it, for tip offsets from `lowest` [m] on."""
    # A tip that taps at z0 has an amplitude of about z0, or more; contact may bring the lever nearer to resonance.
    free, most = _free_amplitudes(curves.path)
    for amplitude in np.linspace(np.clip(lowest, 0.05 * free, 0.9 * 0.98 * most), 0.98 * most, APART):
        curves.follow_from_averaged(float(amplitude))
    curves.follow_past_ends()


def curves_to_amplitude(path: Path, amplitude: float) -> Curves:
    """Curves with all orbits that the detector sees with this amplitude [m]."""
    curves = held_curves(path, np.array([amplitude]), 0, HARDLY_MOVING, FINE)
    for share in AROUND:
        curves.follow_from_averaged(share * amplitude)
    curves.follow_from_averaged(AROUND[0] * amplitude, THROWN_LIFT * amplitude)
    return curves


def curves_to_offset(path: Path, tip_offset: float, apart: bool = True) -> Curves:
    """Curves with all orbits at this tip offset [m].

    `apart`: whether pieces apart from the curve from far are looked for, and orbits that hardly move.
    """
    free, most = _free_amplitudes(path)
    box = (tip_offset - most, np.inf, (FAINT if apart else HARDLY_MOVING) * free)
    curves = Curves(path, ENTRY_Z0, np.array([tip_offset]), box, 0)
    curves.from_far(tip_offset + 1e-3 * abs(tip_offset) + 1e-10)
    if apart:
        add_pieces_apart(curves, tip_offset)
    return curves


def _free_amplitudes(path: Path) -> tuple[float, float]:
    """Amplitude [m] of the free lever at the drive frequency, and the larger of that and the one at resonance."""
    free = float(free_amplitude(path.lever))
    return free, max(free, 0.5 * float(path.lever[col.DRIVE] / path.lever[col.ALPHA0]))
