"""Which pixels are solved again: some of every kind, not only of the commonest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phasemap.validation.checking.picture import Picture


def sample(picture: Picture, pixels: int, seed: int) -> NDArray[np.intp]:
    """Draw so many pixels, as many of each kind as there is room for, and then any; flat, in order, each once."""
    kind, random = kinds(picture), np.random.default_rng(seed)
    if kind.size <= pixels:
        return np.arange(kind.size)
    shuffled = random.permutation(kind.size)
    order = np.argsort(kind[shuffled], kind="stable")
    sizes = np.unique(kind, return_counts=True)[1]
    rank = np.empty(kind.size, np.intp)  # of a pixel among those of its kind
    rank[order] = np.concatenate([np.arange(size) for size in sizes])
    turns = np.argsort(np.minimum(rank, pixels), kind="stable")  # the first of each kind, the second of each ...
    return np.sort(shuffled[turns[:pixels]])


def kinds(picture: Picture) -> NDArray[np.int64]:
    """Number of the kind of each pixel, flat: by status, solver, branch, motion, and whether a neighbour differs."""
    code = np.zeros(picture.shape, np.int64)
    for name in ("status", "solver", "branch", "motion"):
        if name in picture:
            code = 64 * code + picture.raw(name).astype(np.int64) + 1
    beside = np.zeros(picture.shape, bool)
    for axis in (1, 2):
        ahead = np.diff(code, axis=axis) != 0
        pad = [(0, 0)] * 3
        for pad[axis] in ((1, 0), (0, 1)):
            beside |= np.pad(ahead, pad)
    return np.asarray(2 * code + beside).reshape(-1)
