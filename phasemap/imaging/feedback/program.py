"""What passes under the tip along one line, as segments between the corners of the surface."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.scanning import line as of

Array = np.ndarray


def program_of(materials: Array, ground: Array, dwell: float, overscan: float) -> Array:
    """Segments of trace and retrace, with the half turns before and after and the turn between.

    The ground is linear between the centres of pixels, and goes on level beyond the outermost; the material is that of
    the pixel. A turn at constant acceleration that runs on by a part o of the line takes as long as 4 o of the line.

    `materials` (shape (nx,)): numbers of the pixels' materials; -1 for none.
    `ground` (shape (nx,)): topography [m].
    `dwell`: time over a pixel [tau].
    `overscan`: o [1].
    Returns an array of shape (n, PROGRAM): pixel i of the trace has the number i, of the retrace nx + i.

    Examples
    --------
    >>> program_of(np.array([0, 1]), np.array([0.0, 4.0]), 2.0, 0.0)[:, [of.GROUND, of.SLOPE, of.PIXEL]].tolist()[:4]
    [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2.0, 2.0, 1.0], [4.0, 0.0, 1.0]]
    """
    nx, edges = len(ground), _edges(ground)
    there = np.zeros((2 * nx, of.PROGRAM))
    there[:, of.SPAN] = 0.5 * dwell
    there[:, of.MATERIAL] = np.repeat(materials, 2)
    there[::2, of.GROUND], there[1::2, of.GROUND] = edges[:-1], ground
    there[::2, of.SLOPE], there[1::2, of.SLOPE] = ground - edges[:-1], edges[1:] - ground
    there[:, of.SLOPE] /= 0.5 * dwell
    there[:, of.PIXEL] = np.repeat(np.arange(nx), 2)
    back = there[::-1].copy()
    back[:, of.GROUND] += back[:, of.SLOPE] * back[:, of.SPAN]
    back[:, of.SLOPE] *= -1
    back[:, of.PIXEL] += nx
    parts = [there, back]
    if overscan > 0:
        half = 2 * overscan * nx * dwell
        left, right = ([[half, materials[i], ground[i], 0.0, -1.0]] for i in (0, -1))
        parts = [np.array(left), there, np.array(2 * right), back, np.array(left)]
    return np.concatenate(parts)


def mean_ground(ground: Array) -> Array:
    """Height [m] over which the tip passes in each pixel, on average.

    Examples
    --------
    >>> mean_ground(np.array([0.0, 8.0, 8.0])).tolist()
    [1.0, 7.0, 8.0]
    """
    edges = _edges(ground)
    return np.asarray(0.25 * edges[:-1] + 0.5 * ground + 0.25 * edges[1:])


def _edges(ground: Array) -> Array:
    """Height at the pixels' edges."""
    return np.concatenate([ground[:1], 0.5 * (ground[1:] + ground[:-1]), ground[-1:]])
