"""`phasemap.check`: every claim of an image on itself, judged."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError
from phasemap._shared.plausible import unquestioned
from phasemap.imaging.imperfections import drifted
from phasemap.validation.checking.again import other_solver, solve_again
from phasemap.validation.checking.claims import Claims, claims_of, scene_of
from phasemap.validation.checking.compare import compare
from phasemap.validation.checking.invariants import invariants
from phasemap.validation.checking.layout import layout
from phasemap.validation.checking.lines import scan_again
from phasemap.validation.checking.picture import Picture
from phasemap.validation.checking.repeat import repeat
from phasemap.validation.checking.result import FAILS, HOLDS, Check, Claim
from phasemap.validation.checking.sample import sample

if TYPE_CHECKING:
    import xarray as xr

    from phasemap._shared.threads import Progress
    from phasemap.experiment.microscope import Microscope
    from phasemap.experiment.surface import Surface
    from phasemap.scenes.scene import Scene

PIXELS = 64
PER_LINE = 32  # pixels that a line in time counts for

BY = {"march": "by the equation of motion in time", "orbit": "by periodic orbits"}


@unquestioned()  # who made the image was told already
@np.errstate(all="ignore")  # a file may hold any numbers
def check(
    image: xr.Dataset,
    surface: Surface | None = None,
    scope: Microscope | None = None,
    *,
    folders: Iterable[str | os.PathLike[str]] = (".",),
    pixels: int = PIXELS,
    seed: int = 0,
    solver: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Check:
    """Find out whether what an image says of itself holds.

    Every pixel is asked for what must hold whatever the sample: layout, status, setpoint, height, balances of energy
    and virial, branch, motion, stated errors. Then a random sample of the pixels is solved again: by the solver that
    made the image, which must find the same, and by one that shares nothing with it and does not know what the image
    says. Status, motion, branch, phase, height, mean deflection, indentation, dissipation and virial are compared,
    within the errors that the image states. A pixel on which that solver comes to no rest is not judged. Pixels of
    `Raster` begin on the branch on which the image leaves the pixel before. Of a `Feedback` whole lines are scanned
    again, by the same engine and by the other one.

    Parameters
    ----------
    image : xarray.Dataset
        What `phasemap.simulate` returned, or a file of it.
    surface : Surface, optional
        The surface of which it was taken, before drift; made again from the image's scene by default.
    scope : Microscope, optional
        Needed where the contact law is a user's own, which no file has.
    folders : iterable of path-like
        Where files that the image's scene names may be.
    pixels : int
        How many to solve again; a line in time counts for 32.
    seed : int
        Of the sample.
    solver : {"march", "orbit"}, optional
        That solves them again: by default the equation of motion in time, engaged from far; for an image made by that,
        periodic orbits.
    threads, progress
        As in `phasemap.simulate`; progress is in pixels, or in lines of a feedback.

    Returns
    -------
    Check
        With the claims one by one, `holds`, `verdict`, and the pixels that were solved again.

    Raises
    ------
    InputError
        If the image does not say how it was made, or the surface has other pixels.
    FileError
        If a file that the image's scene names is not there, or has changed.
    PhasemapError
        If the image carries no scene, and no surface is given.

    Examples
    --------
    >>> import phasemap as pm
    >>> surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    >>> image = pm.simulate(surface, scope, setpoint=0.7)
    >>> pm.check(image, surface).holds
    True
    >>> image.phase[0, 0] += 1.0
    >>> pm.check(image, surface).verdict
    '3 of 20 claims FAIL. Do not trust this file.'
    """
    claims = claims_of(image, scope)
    whole("pixels", pixels, 1)
    whole("seed", seed, 0)
    again_by = None if claims.control.in_time else other_solver(claims.solver, solver)
    if again_by is None and solver is not None:
        raise InputError("solver", solver, "none, for lines in time are scanned again by both engines")
    first = layout(image, claims)
    if first.result != HOLDS:
        return Check((first,))
    everywhere = [first]
    if surface is None:
        scene = scene_of(image, folders, claims.shape)
        surface = scene.surface
        everywhere.append(_same(claims, scene))
    surface = surface.compute()
    if (surface.shape, surface.pixel_size) != (claims.shape, claims.pixel_size):
        given = f"{surface.shape} pixels of {surface.pixel_size} m"
        raise InputError("surface", given, f"{claims.shape} pixels of {claims.pixel_size} m, as in the image")
    surface, picture = drifted(surface, claims.realism.drift), Picture(image, claims)
    everywhere += invariants(picture, surface)
    if again_by is None:
        lines = max(pixels // PER_LINE, 1)
        return Check((*everywhere, *scan_again(picture, surface, lines, seed, threads, progress)))
    drawn = sample(picture, pixels, seed)
    again = solve_again(picture, surface, drawn, again_by, threads, progress)
    found, sampled = compare(picture, surface, again, BY[again_by.name])
    return Check((*everywhere, repeat(picture, surface, drawn, threads), *found), sampled)


def _same(claims: Claims, scene: Scene) -> Claim:
    """The scene that the image carries is that of its configuration."""
    options = {name: scene.options[name] for name in ("setpoint", "solver", "control", "accuracy", "realism")}
    both = {name: (getattr(claims, name), value) for name, value in options.items()}
    both["microscope"] = claims.microscope, scene.microscope
    differ = [name for name, (one, other) in both.items() if one != other]
    found = f"{' and '.join(differ)} differ" if differ else f"{scene.config['surface']['kind']} surface made again"
    return Claim("its scene is that of its configuration", FAILS if differ else HOLDS, 0, found)
