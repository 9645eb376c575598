"""What passes under the tip along one line, as segments between the corners of the surface."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.scanning.line import Program

Array = np.ndarray


def program_of(materials: Array, ground: Array, dwell: float, overscan: float) -> Program:
    """Segments of trace and retrace, with the half turns before and after and the turn between.

    The ground is linear between the centres of pixels, and goes on level beyond the outermost; the material is that of
    the pixel, -1 for none. A turn at constant acceleration that runs on by a part o of the line takes as long as 4 o of
    the line.

    `dwell`: time over a pixel [tau].
    `overscan`: o [1].
    Returns segments: pixel i of the trace has the number i, of the retrace nx + i.
    """
    nx, edges, half = len(ground), _edges(ground), 0.5 * dwell
    starts = np.stack([edges[:-1], ground], axis=1).ravel()
    rises = np.stack([ground - edges[:-1], edges[1:] - ground], axis=1).ravel()
    pixels = np.repeat(np.arange(nx), 2)
    there = Program(np.full(2 * nx, half), np.repeat(materials, 2), starts, rises / half, pixels)
    ends = starts + there.slope * half
    back = Program(there.span, there.material[::-1], ends[::-1], -there.slope[::-1], pixels[::-1] + nx)
    parts = [there, back]
    if overscan > 0:
        left, right = (_level(2 * overscan * nx * dwell, materials[i], ground[i]) for i in (0, -1))
        parts = [left, there, right, right, back, left]
    return Program(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _level(span: float, material: int, height: float) -> Program:
    """Level ground beyond the outermost pixel."""
    return Program(*(np.array([value]) for value in (span, material, height, 0.0, -1)))


def mean_ground(ground: Array) -> Array:
    """Height [m] over which the tip passes in each pixel, on average."""
    edges = _edges(ground)
    return np.asarray(0.25 * edges[:-1] + 0.5 * ground + 0.25 * edges[1:])


def _edges(ground: Array) -> Array:
    """Height at the pixels' edges."""
    return np.concatenate([ground[:1], 0.5 * (ground[1:] + ground[:-1]), ground[-1:]])
