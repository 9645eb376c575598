"""Surfaces that people image, made from a few numbers and a seed.

A generator returns labels (uint8, for `Surface.from_labels`) or a field (float64, a map or a topography). Lengths are
in m, the same arguments give the same bytes, and the random patterns are periodic: they tile without a seam. Patterns
without chance are in `regular`, random ones of one wavelength or one spectrum in `waves`, discs in a matrix in `discs`;
what all of them ask of their arguments is in `arguments`.
"""

from __future__ import annotations

from phasemap.experiment.generate.discs import particles
from phasemap.experiment.generate.regular import checkerboard, gradient, step, stripes
from phasemap.experiment.generate.waves import blend, lamellae, roughness

__all__ = ["blend", "checkerboard", "gradient", "lamellae", "particles", "roughness", "step", "stripes"]
