"""`phasemap.check`: every claim of an image on itself, judged."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import Progress
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.imaging.imperfections import drifted
from phasemap.scenes.scene import Scene
from phasemap.solvers.solver import FromFar, Orbit, Solver
from phasemap.validation.again import after, image_again, sample, solve_again
from phasemap.validation.agreement import compare, repeat
from phasemap.validation.claims import Claims, claims_of, scene_of
from phasemap.validation.invariants import invariants, layout
from phasemap.validation.picture import FAILS, HOLDS, Check, Claim, Picture, pixels_in_words

PIXELS = 64
UNSEEN = (
    "Whether contact law, materials and microscope describe a real sample: pixels are solved again with the same ones. "
    "Their maps are those of the {surface}."
)


@unquestioned()  # who made the image was told already
@np.errstate(all="ignore")  # a file may hold any numbers
@asked_as()
def check(
    image: xr.Dataset,
    surface: Surface | None = None,
    scope: Microscope | None = None,
    *,
    folders: Iterable[str | os.PathLike[str]] = (".",),
    pixels: int = PIXELS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Check:
    """Find out whether what an image says of itself holds.

    Layout, status and height must be as they are defined. Then every pixel is solved again as it was made, which must
    give the same, and pixels that differ and a random sample by the equation of motion in time, engaged from far, which
    shares no solver with the image and does not know what it says: status, motion, branch, phase, height, mean
    deflection, indentation, dissipation and virial are compared, within the errors that the image states. A pixel in
    which time comes to no rest is not judged. Of an image by "march" the sample is solved by periodic orbits. Pixels of
    `Raster` begin in time on the branch on which the image leaves the pixel before. A `Feedback` is scanned again, and
    nothing else.

    Not seen is what all ways to solve a pixel share: contact law, parameters, and the surface. It takes as long as the
    image, and some 20 ms a pixel of the sample.

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
        How many are in the sample.
    seed : int
        Of the sample.
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
    '2 of 13 claims FAIL. Do not trust this file.'
    """
    claims = claims_of(image, scope)
    whole("pixels", pixels, 1)
    whole("seed", seed, 0)
    first = layout(image, claims)
    if first.result != HOLDS:
        return Check((first,))
    everywhere, given = [first], surface
    if surface is None:
        scene = scene_of(image, folders, claims.shape)
        surface = scene.surface
        everywhere.append(_scene_is_configuration(claims, scene))
    surface = surface.compute()
    if (surface.shape, surface.pixel_size) != (claims.shape, claims.pixel_size):
        size = f"{surface.shape} pixels of {surface.pixel_size} m"
        raise InputError("surface", size, f"{claims.shape} pixels of {claims.pixel_size} m, as in the image")
    surface, picture = drifted(surface, claims.realism.drift), Picture(image, claims)
    everywhere += [claim for claim in invariants(picture, surface) if claim.pixels]
    unseen = UNSEEN.format(surface="scene in the file" if given is None else "surface given")
    if claims.control.in_time:
        repeated, _ = repeat(image_again(picture, surface, threads, progress))
        return Check((*everywhere, repeated), None, "Every line was scanned again as it was made.", unseen)
    drawn, every = sample(picture, pixels, seed), int(np.prod(picture.shape))
    total = every + len(drawn)
    made = image_again(picture, surface, threads, after(progress, 0, total))
    repeated, differ = repeat(made)
    judges = np.union1d(drawn, differ[: len(drawn)])
    other, by = _independent_solver(claims, surface)
    again = solve_again(picture, surface, judges, other, threads, after(progress, every, total))
    compared, sampled = compare(again, by)
    differs = f"{len(differ) or 'none'} {'differs' if len(differ) < 2 else 'differ'}"
    judged = (
        f"Every pixel was solved again as it was made ({made.materials} different materials): {differs}. "
        f"{pixels_in_words(len(judges))}, some of every kind and those that differ most, also {by}. An error of the "
        "solver itself would show only there."
    )
    return Check((*everywhere, repeated, *compared), sampled, judged, unseen)


def _independent_solver(claims: Claims, surface: Surface) -> tuple[Solver, str]:
    """Solver that shares nothing with that of the image, in words too: time, or periodic orbits for an image by time.

    What remembers or is wet, or is marched under two drives, has no orbits that stand for its march.
    """
    acts = claims.microscope.interaction
    only_in_time = surface.relaxes or acts.withdrawal != "linear" or acts.law.in_time
    if claims.solver == "march" and not only_in_time and claims.microscope.drive.second is None:
        return Orbit(complete=True), "by periodic orbits"
    return FromFar(), "by the equation of motion in time"


def _scene_is_configuration(claims: Claims, scene: Scene) -> Claim:
    """Claim that the scene that the image carries is that of its configuration."""
    options = {name: scene.options[name] for name in ("setpoint", "solver", "control", "accuracy", "realism")}
    both = {name: (getattr(claims, name), value) for name, value in options.items()}
    both["microscope"] = claims.microscope, scene.microscope
    differ = [name for name, (one, other) in both.items() if one != other]
    found = f"{' and '.join(differ)} differ" if differ else f"{scene.config['surface']['kind']} surface made again"
    return Claim("its scene is that of its configuration", FAILS if differ else HOLDS, 0, found)
