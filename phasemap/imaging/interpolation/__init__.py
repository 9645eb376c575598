"""Interpolation over materials, for images in which almost every pixel is a different one.

A few thousand exact orbits span the materials of an image (`exact_orbits`). Orbits are smooth functions of stiffness,
adhesion and damping except at two borders (`borders`, the first of them a fold: `folds`), so that in cells between
these (`cells`) Chebyshev interpolants converge fast; all of them are an `atlas`. What an interpolant is worth is
measured with exact orbits at materials of the image itself.
"""
