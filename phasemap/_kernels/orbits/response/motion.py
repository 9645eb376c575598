"""The lever's response to the force at the nodes of an orbit: one pass, and what the nodes may miss in it."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import OMEGA
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.lever_modes import LeverMode, mode_of, modes_of
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    HIGHEST,
    IN,
    OUT,
    UPTO,
    N,
    Nodes,
    count_of,
    fill_mode,
    first_of,
    first_of_element,
    force_acts_on,
    parts_of,
    periods_before,
    response_to_first_harmonic,
)

# of the fourth power of what the highest polynomials find, that nodes miss of the force on a mode
UNRESOLVED_SHARE = 0.1


@kernel(fastmath=ANY_ORDER)
def fill_response(nodes: Nodes, lever: np.ndarray, mean: float, push: float, drag: float) -> None:
    """Replace deflection w and rate w' at the nodes by the lever's response to the force g.

    w = -G g, with Green's function G of all modes, less its mean and first harmonic: theory, Eqs. (response-4) to
    (response-6). `round_`, E times the integral of g exp(-lambda theta), is what all periods before add to the running
    integrals.
    """
    nodes.missed = 0.0
    for i in range(modes_of(lever)):
        mode = mode_of(lever, i)
        fill_mode(nodes, mode)
        all_re, all_im = _sum_up(nodes)
        e_re, e_im = periods_before(mode.decay, mode.turn)
        round_ = e_re * all_re - e_im * all_im, e_re * all_im + e_im * all_re
        h = response_to_first_harmonic(lever[OMEGA], mode, push, drag)
        share = mode.share / (lever[OMEGA] * lever[OMEGA] * mode.turn)
        _add_motion(nodes, mode, share, round_, (mean * mode.share / mode.square, h[0], h[1]), i == 0)
        if i > 0:
            nodes.missed += share * _unresolved(nodes, math.hypot(e_re, e_im))


@kernel(fastmath=ANY_ORDER, inline=True)
def _integrate_force(g: np.ndarray, to: np.ndarray) -> None:
    """Fill in the integrals of g from an element's start to its nodes; eight nodes at once, which stay in registers."""
    for j in range(N):
        to[j] = 0.0
    for k in range(0, N, 8):
        g0, g1, g2, g3, g4, g5, g6, g7 = g[k], g[k + 1], g[k + 2], g[k + 3], g[k + 4], g[k + 5], g[k + 6], g[k + 7]
        for j in range(N):
            to[j] += (
                UPTO[k, j] * g0 + UPTO[k + 1, j] * g1 + UPTO[k + 2, j] * g2 + UPTO[k + 3, j] * g3
                + UPTO[k + 4, j] * g4 + UPTO[k + 5, j] * g5 + UPTO[k + 6, j] * g6 + UPTO[k + 7, j] * g7
            )  # fmt: skip


@kernel(fastmath=ANY_ORDER)
def _integrate_kicks(nodes: Nodes, first: int) -> tuple[float, float]:
    """Integrals of g exp(-lambda theta) from an element's start to its nodes; returns those over all of it."""
    re, im = nodes.re[first : first + N], nodes.im[first : first + N]
    _integrate_force(re, nodes.sum_re[first : first + N])
    _integrate_force(im, nodes.sum_im[first : first + N])
    total_re, total_im = 0.0, 0.0
    for k in range(N):
        total_re += GAUSS_WEIGHTS[k] * re[k]
        total_im += GAUSS_WEIGHTS[k] * im[k]
    return total_re, total_im


@kernel(fastmath=ANY_ORDER)
def _sum_up(nodes: Nodes) -> tuple[float, float]:
    """Fill in running integrals over the angle of the force, weighted by a mode's free decay; returns those of all.

    The integrand is g exp(-lambda theta), with the force over stiffness g and the lambda that `fill_mode` filled in.
    The elements are in the order of time IN, before contact, the parts of the contact, and OUT, after it. IN is laid
    out backwards, from the contact on; without a force outside contact, IN and OUT add nothing.
    """
    for j in range(count_of(nodes)):
        share = nodes.g[j] * nodes.weight[j] * nodes.growth[j]
        nodes.re[j], nodes.im[j] = share * nodes.turn_cos[j], -share * nodes.turn_sin[j]
    in_re, in_im, out_re, out_im = 0.0, 0.0, 0.0, 0.0
    if nodes.outside == 1:
        in_re, in_im = _integrate_kicks(nodes, IN)
        out_re, out_im = _integrate_kicks(nodes, OUT)
    at_re, at_im = in_re, in_im
    for part in range(parts_of(nodes) if nodes.touches == 1 else 0):
        first = first_of(part)
        part_re, part_im = _integrate_kicks(nodes, first)
        for j in range(first, first + N):
            nodes.sum_re[j] += at_re
            nodes.sum_im[j] += at_im
        at_re, at_im = at_re + part_re, at_im + part_im
    for j in range(N):
        # The element before contact was integrated backwards.
        nodes.sum_re[j], nodes.sum_im[j] = in_re - nodes.sum_re[j], in_im - nodes.sum_im[j]
        nodes.sum_re[OUT + j] += at_re
        nodes.sum_im[OUT + j] += at_im
    nodes.sum_re[ENTRY], nodes.sum_im[ENTRY] = in_re, in_im
    nodes.sum_re[EXIT], nodes.sum_im[EXIT] = at_re, at_im
    return at_re + out_re, at_im + out_im


@kernel(fastmath=ANY_ORDER)
def _add_motion(
    nodes: Nodes, mode: LeverMode, share: float, round_: tuple[float, float], harmonic: tuple[float, float, float],
    anew: bool,
) -> None:  # fmt: skip
    """Add to w and w' the motion of a mode, less its mean and its first harmonic; or let it replace them."""
    a, nu, (round_re, round_im), (mean, h_re, h_im) = mode.decay, mode.turn, round_, harmonic
    for j in range(count_of(nodes)):
        m_re, m_im = round_re + nodes.sum_re[j], round_im + nodes.sum_im[j]
        shrink = share / nodes.growth[j]
        t_re, t_im = shrink * nodes.turn_cos[j], shrink * nodes.turn_sin[j]
        g_im = t_re * m_im + t_im * m_re
        g_re = t_re * m_re - t_im * m_im
        c, s = nodes.cos[j], nodes.sin[j]
        w, u = (0.0, 0.0) if anew else (nodes.w[j], nodes.u[j])
        nodes.w[j] = w - g_im + mean + h_re * c - h_im * s
        nodes.u[j] = u - (a * g_im + nu * g_re) - h_re * s - h_im * c


@kernel(fastmath=ANY_ORDER)
def _unresolved(nodes: Nodes, again: float) -> float:
    """Integral of the force g exp(-i nu theta) that the nodes may miss, from what their highest polynomials find in it.

    Where a share x of it is found there, some x^4/20 or x^4/30 is missed, for a mode turns by many radians in an
    element. Running integrals miss more of it in between, which the force at the nodes averages out. What is missed
    after contact (element 2) comes back a period later, as the share `again` of what it is at angle 0.
    """
    rest = 0.0
    for element in range(2 + parts_of(nodes)):
        if not force_acts_on(nodes, element):
            continue
        first = first_of_element(element)
        re, im, re_before, im_before, size = 0.0, 0.0, 0.0, 0.0, 1e-300
        for j in range(N):
            shrink = 1.0 / nodes.growth[first + j]
            share_re, share_im = shrink * nodes.re[first + j], shrink * nodes.im[first + j]
            re_before += HIGHEST[0, j] * share_re
            im_before += HIGHEST[0, j] * share_im
            re += HIGHEST[1, j] * share_re
            im += HIGHEST[1, j] * share_im
            size += GAUSS_WEIGHTS[j] * (abs(share_re) + abs(share_im))
        highest = abs(re) + abs(im) + abs(re_before) + abs(im_before)
        weight = again * nodes.growth[OUT + N - 1] / nodes.growth[ENTRY] if element == 2 else 1.0
        rest += UNRESOLVED_SHARE * weight * highest * (highest / size) ** 3
    return rest
