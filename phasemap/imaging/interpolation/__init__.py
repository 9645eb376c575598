"""Interpolation over materials, for images in which almost every pixel is a different one.

A few thousand exact orbits span the materials of an image. Orbits are smooth functions of stiffness, adhesion and
damping except at two borders (`borders`, looked for along `lines`), so that in cells between these (`cells`) Chebyshev
interpolants converge fast. What an interpolant is worth is measured with exact orbits at materials of the image itself.
"""

from phasemap.imaging.interpolation.atlas import Atlas
from phasemap.imaging.interpolation.builder import build
from phasemap.imaging.interpolation.exact_orbits import ExactOrbits

__all__ = ["Atlas", "ExactOrbits", "build"]
