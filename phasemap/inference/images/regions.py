"""Regions of an image as if each were one pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import as_array
from phasemap._shared.errors import InputError
from phasemap.inference.images.stack import Stack

SPREAD = 1.4826  # standard deviation over the median absolute deviation of normal numbers
MEDIAN = 1.2533  # standard error of a median over that of a mean


def labels_of(labels: object, shape: tuple[int, ...]) -> NDArray[Any]:
    """Check a map of labels."""
    given = as_array("labels", labels, f"whole numbers of shape {shape}")
    if given.shape != shape or given.dtype.kind not in "iub":
        raise InputError("labels", f"{given.dtype} of shape {given.shape}", f"whole numbers of shape {shape}")
    return given


def regions_of(labels: object, shape: tuple[int, ...]) -> tuple[list[int], NDArray[np.intp]]:
    """Names of the regions, and of each pixel its number among them, -1 where it has none."""
    given = labels_of(labels, shape)
    names, numbers = np.unique(given, return_inverse=True)
    skipped = int((names < 0).sum())
    if skipped == len(names):
        raise InputError("labels", "all below 0", "one region at least")
    return names[skipped:].tolist(), np.maximum(numbers.reshape(-1) - skipped, -1)


def medians(stack: Stack, numbers: NDArray[np.intp], count: int) -> tuple[Stack, NDArray[np.int64]]:
    """Medians of the regions with their standard errors, and how many pixels they have."""
    values = np.zeros((count, *stack.values.shape[1:]))
    errors = np.full(values.shape, np.inf)
    for i in range(count):
        inside = numbers == i
        for j, k in np.ndindex(values.shape[1:]):
            some = stack.values[inside, j, k][np.isfinite(stack.errors[inside, j, k])]
            if len(some):
                values[i, j, k] = np.median(some)
                spread = SPREAD * np.median(np.abs(some - values[i, j, k]))
                floor = stack.errors[inside, j, k].min()
                errors[i, j, k] = np.hypot(MEDIAN * spread / np.sqrt(len(some)), floor)
    whole = Stack(values, errors, stack.scopes, stack.setpoints)
    return whole, np.bincount(numbers[numbers >= 0], minlength=count)
