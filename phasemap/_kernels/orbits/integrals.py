"""Integrals over the nodes of an orbit: what attraction does, what contacts store, slope and harmonics of the force."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import (
    ADHESION_LOSS,
    ADHESION_VIRIAL,
    DRAG,
    GRADIENT,
    IN_LOOP,
    LOSS_HARMONICS,
    LOSSES,
    NOT_DRIVEN,
    SIDEBANDS,
    STORAGE,
    WAVES,
)
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import (
    Law,
    Oscillator,
    contact_force,
    contact_slope,
    damping,
    has_hysteresis,
    longrange_force,
    longrange_slope,
)
from phasemap._kernels.lever_modes import detected_compliance, dynamic_stiffness_of_mode, mode_of, modes_of
from phasemap._kernels.neck_energy import loop_energy
from phasemap._kernels.orbits.orbit_nodes import MOST_NODES, OrbitNodes

SLOPE_HARMONICS = 20  # harmonics of the force's slope that count
# Of the highest harmonic that a sum takes: rad from node to node, where the force is above this share of its largest
WIDEST, SMALL_FORCE = 2.5, 1e-2


@kernel
def _jump_slope(law: Law, p: np.ndarray, nodes: OrbitNodes) -> float:
    """Integral of dF/dd over theta across jumps of the force [N/m]: each jump over |dd/dtheta| there [m]."""
    made = contact_force(law, 0.0, p) - longrange_force(law, 0.0, p)
    broken = contact_force(law, p[col.RELEASE], p) - longrange_force(law, p[col.RELEASE], p)
    return made * nodes.begins + broken * nodes.ends


@kernel(fastmath=ANY_ORDER)
def _fill_load_harmonics(nodes: OrbitNodes, count: int, load: np.ndarray, first: int, out: np.ndarray) -> None:
    """Fill in the harmonics `first` ... of a load at the nodes: its sums with cos(n theta) and -sin(n theta).

    By x_{n+1} = 2 cos(theta) x_n - x_{n-1}, which both obey: four harmonics in a pass over the nodes, between which
    nothing is stored. `load` (shape (5, MOST_NODES)): first that of each node, the rest is workspace. `out` (shape (2,
    any)): filled.
    """
    cosine, sine, even, odd, even_last, odd_last = nodes.cos, nodes.sin, load[1], load[2], load[3], load[4]
    for j in range(count):
        even[j], odd[j] = load[0, j] * cosine[j], load[0, j] * sine[j]
        even_last[j], odd_last[j] = load[0, j], 0.0
    for n in range(1, first + out.shape[1], 4):
        re_0, im_0, re_1, im_1, re_2, im_2, re_3, im_3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(count):
            turn, c_0, s_0 = 2.0 * cosine[j], even[j], odd[j]
            c_1, s_1 = turn * c_0 - even_last[j], turn * s_0 - odd_last[j]
            c_2, s_2 = turn * c_1 - c_0, turn * s_1 - s_0
            c_3, s_3 = turn * c_2 - c_1, turn * s_2 - s_1
            re_0, im_0, re_1, im_1 = re_0 + c_0, im_0 - s_0, re_1 + c_1, im_1 - s_1
            re_2, im_2, re_3, im_3 = re_2 + c_2, im_2 - s_2, re_3 + c_3, im_3 - s_3
            even_last[j], odd_last[j] = c_3, s_3
            even[j], odd[j] = turn * c_3 - c_2, turn * s_3 - s_2
        four = ((re_0, im_0), (re_1, im_1), (re_2, im_2), (re_3, im_3))
        for k in range(4):
            i = n + k - first
            if 0 <= i < out.shape[1]:
                out[0, i], out[1, i] = four[k]


@kernel
def _sideband_compliances(lever: np.ndarray, slope: float, out: np.ndarray) -> None:
    """Fill in the compliance at the sidebands omega2 + n omega and omega2 - n omega, n from 0 on [m/N].

    `slope`: stiffness that the surface adds to the second mode, whose drive follows it, or 0 [N/m].
    `out` (complex, shape (2, 1 + SLOPE_HARMONICS)): of all modes but the second, and of that one.
    """
    second = mode_of(lever, 1)
    driven = math.sqrt(max(second.square + second.share * slope / lever[col.STIFFNESS], 0.0))
    out[:] = 0.0
    for n in range(-SLOPE_HARMONICS, SLOPE_HARMONICS + 1):
        w = driven + n * lever[col.OMEGA]
        for i in range(modes_of(lever)):
            if i == 1 and n == 0:
                continue  # what is looked for
            mode = mode_of(lever, i)
            compliance = mode.share / lever[col.STIFFNESS] / complex(mode.square - w * w, 2.0 * mode.rate * w)
            out[1 if i == 1 else 0, abs(n)] += compliance


@kernel
def _sidebands(yields: np.ndarray, slopes: np.ndarray, row: np.ndarray) -> None:
    """Fill in the stiffness [N/m] that the second mode feels less than the mean slope, as modes yield at sidebands.

    Where the second mode moves, the slope of the force, which has harmonics K_n, makes forces at the sidebands of its
    frequency. The response of the modes there acts back: theory, Eq. (errors-5).
    """
    mean = row[GRADIENT]
    row[SIDEBANDS], row[SIDEBANDS + 1] = 0.0, 0.0
    if mean == 0.0:
        return
    others = mean * mean * yields[0, 0]
    for n in range(SLOPE_HARMONICS):
        others += (slopes[0, n] ** 2 + slopes[1, n] ** 2) * yields[0, n + 1]
    share = 1.0 / (1.0 + others / mean)
    felt = mean * share
    for n in range(SLOPE_HARMONICS):
        power, compliance = slopes[0, n] ** 2 + slopes[1, n] ** 2, yields[1, n + 1]
        felt -= share * share * power * compliance / (1.0 + mean * share * compliance)
    row[SIDEBANDS], row[SIDEBANDS + 1] = mean - felt.real, -felt.imag


@kernel
def _slope_load(law: Law, p: np.ndarray, nodes: OrbitNodes, count: int, load: np.ndarray) -> tuple[float, float]:
    """Integrals over theta of the force's slope [N/m] and of 2 alpha_s [1]; each node's share of the former over 2 pi.

    Jumps of the force are left out.
    """
    gradient, drag = 0.0, 0.0
    for j in range(count):
        d, weight = nodes.depth[j], nodes.weight[j]
        if nodes.touches[j] == 0.0:
            slope = longrange_slope(law, min(d, 0.0), p)
        else:
            d = d if p[col.RELEASE] < 0.0 else max(d, 0.0)
            slope = contact_slope(law, d, p)
            if d > 0.0:
                drag += 2.0 * weight * damping(law, d, p)
        gradient += weight * slope
        load[0, j] = weight * slope / (2.0 * math.pi)
    return gradient, drag


@kernel
def _force_load(oscillator: Oscillator, nodes: OrbitNodes, count: int, load: np.ndarray) -> None:
    """Fill in each node's share of twice the mean of the force over the stiffness [m]."""
    law, p, lever = oscillator
    inverse_k = 1.0 / lever[col.STIFFNESS]
    for j in range(count):
        d = nodes.depth[j]
        if nodes.touches[j] == 0.0:
            g = inverse_k * longrange_force(law, min(d, 0.0), p)
        else:
            d = d if p[col.RELEASE] < 0.0 else max(d, 0.0)
            g = inverse_k * contact_force(law, d, p)
            if d > 0.0:
                g += 2.0 * damping(law, d, p) * lever[col.OMEGA] * nodes.rate[j]
        load[0, j] = nodes.weight[j] * g / math.pi


@kernel
def _fill_waves(lever: np.ndarray, waves: np.ndarray, row: np.ndarray) -> None:
    """Fill in the harmonics of the detector's signal: the lever's response to those of the force."""
    for n in range(col.HARMONICS):
        seen = -detected_compliance(lever, (n + 2) * lever[col.OMEGA]) * complex(waves[0, n], waves[1, n])
        row[WAVES + 2 * n], row[WAVES + 2 * n + 1] = seen.real, seen.imag


@kernel
def _resolved_harmonics(nodes: OrbitNodes, count: int, load: np.ndarray) -> int:
    """Number of harmonics that nodes resolve, by the largest weight of a node at which the force is not small."""
    most, widest = 0.0, 0.0
    for j in range(count):
        most = max(most, abs(load[0, j]) / nodes.weight[j])
    for j in range(count):
        if abs(load[0, j]) / nodes.weight[j] >= SMALL_FORCE * most:
            widest = max(widest, nodes.weight[j])
    return int(WIDEST / widest) if widest > 0.0 else 1


@kernel
def _fill_losses(lever: np.ndarray, waves: np.ndarray, resolved: int, row: np.ndarray) -> None:
    """Fill in the energy [J] that the damping of each mode takes in a period: theory, Eq. (lever-8).

    `waves`: cosine and sine parts of the harmonics n = 2, 3, ... of the force over stiffness [m], of which those up to
    n = `resolved` count. The first harmonic is exact by the equation of motion; by nodes it would be off by 0.1 %.
    """
    omega, kappa = lever[col.OMEGA], complex(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS])
    tip = -1j * row[col.AMPLITUDE] * complex(math.cos(row[col.PHASE]), math.sin(row[col.PHASE]))
    force = complex(lever[col.TURN_COS], lever[col.TURN_SIN]) * (lever[col.DRIVE] - kappa * tip)
    for i in range(modes_of(lever)):
        mode, pulled = mode_of(lever, i), lever[col.MODE + i * col.MODE_NUMBERS + col.PULLED]
        total = abs((pulled - mode.share * force) / dynamic_stiffness_of_mode(lever, i)) ** 2
        for n in range(2, min(resolved, waves.shape[1] + 1) + 1):
            w = n * omega
            below = (mode.square - w * w) ** 2 + (2.0 * mode.rate * w) ** 2
            total += (n * mode.share) ** 2 * (waves[0, n - 2] ** 2 + waves[1, n - 2] ** 2) / below
        row[LOSSES + i] = 2.0 * math.pi * omega * mode.rate * lever[col.STIFFNESS] / mode.share * total


class LoadWorkspace(NamedTuple):
    """Workspace for a load at the nodes and its harmonics."""

    load: np.ndarray  # shape (5, MOST_NODES)
    slopes: np.ndarray  # shape (2, SLOPE_HARMONICS)
    yields: np.ndarray  # complex, shape (2, 1 + SLOPE_HARMONICS)
    waves: np.ndarray  # shape (2, harmonics)


@kernel
def new_load_workspace(harmonics: int) -> LoadWorkspace:
    """A workspace for so many harmonics of the force."""
    yields = np.zeros((2, 1 + SLOPE_HARMONICS), np.complex128)
    return LoadWorkspace(np.zeros((5, MOST_NODES)), np.zeros((2, SLOPE_HARMONICS)), yields, np.zeros((2, harmonics)))


@kernel
def fill_force_integrals(
    oscillator: Oscillator, nodes: OrbitNodes, second: int, workspace: LoadWorkspace, row: np.ndarray
) -> None:
    """Fill the row of an orbit with the mean slope and damping of the force, and with what follows from its harmonics.

    The columns of the sidebands are filled where the `second` mode is driven, AT_REST or IN_LOOP. The number of
    harmonics the workspace has room for says what else is filled: with none nothing, with col.HARMONICS the harmonics
    that the detector sees (WAVES), with LOSS_HARMONICS the losses in each mode (LOSSES) too.
    """
    law, p, lever = oscillator
    count, (load, slopes, yields, waves) = nodes.count, workspace
    gradient, drag = _slope_load(law, p, nodes, count, load)
    gradient += _jump_slope(law, p, nodes)
    row[GRADIENT], row[DRAG] = gradient / (2.0 * math.pi), drag / (2.0 * math.pi)
    if second != NOT_DRIVEN:
        _sideband_compliances(lever, row[GRADIENT] if second == IN_LOOP else 0.0, yields)
        _fill_load_harmonics(nodes, count, load, 1, slopes)
        _sidebands(yields, slopes, row)
    if waves.shape[1] >= col.HARMONICS:
        _force_load(oscillator, nodes, count, load)
        _fill_load_harmonics(nodes, count, load, 2, waves)
        _fill_waves(lever, waves, row)
    if waves.shape[1] >= LOSS_HARMONICS:
        _fill_losses(lever, waves, _resolved_harmonics(nodes, count, load), row)


@kernel
def fill_adhesion_integrals(oscillator: Oscillator, without: np.ndarray, nodes: OrbitNodes, row: np.ndarray) -> None:
    """Fill in ADHESION_VIRIAL, ADHESION_LOSS and STORAGE of a row from the nodes of its orbit.

    `without`: parameters of the same contact without adhesion and bias.
    """
    law, p, _ = oscillator
    virial, storage = 0.0, 0.0
    for j in range(nodes.count):
        d, weight = nodes.depth[j], nodes.weight[j]
        if d > 0.0:
            storage += weight * contact_slope(law, d, without) * nodes.rate[j] ** 2
        if nodes.touches[j] == 0.0:
            f = longrange_force(law, min(d, 0.0), p)
        else:
            f = contact_force(law, d, p)
            if d > 0.0:
                f -= contact_force(law, d, without)
        virial -= weight * f * nodes.cos[j]
    row[ADHESION_VIRIAL] = row[col.AMPLITUDE] * virial / (2.0 * math.pi)
    row[ADHESION_LOSS] = loop_energy(law, p) if nodes.ends > 0.0 and has_hysteresis(p) else 0.0
    row[STORAGE] = storage / (2.0 * math.pi)
