"""`phasemap.check`: every claim of an image on itself, judged."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError
from phasemap._shared.notices import unquestioned
from phasemap._shared.threads import Progress
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.imaging.imperfections import drifted
from phasemap.scenes.scene import Scene
from phasemap.solvers.solver import FromFar, Orbit, by_name
from phasemap.validation.again import after, image_again, sample, solve_again
from phasemap.validation.agreement import compare, repeat
from phasemap.validation.claims import Claims, claims_of, scene_of
from phasemap.validation.invariants import invariants, layout
from phasemap.validation.lines import scan_again
from phasemap.validation.picture import FAILS, HOLDS, Check, Claim, Picture, pixels_in_words

Pixels = NDArray[np.intp]
Found = tuple[list[Claim], "xr.Dataset", str]

PIXELS = 64
PER_LINE = 32  # pixels that a line in time counts for
IN_TIME = "by the equation of motion in time"
SCAN = (
    "Some lines were scanned again, those named above. Other lines only by what must hold in every pixel: a changed "
    "phase may pass there."
)
UNSEEN = (
    "Whether contact law, materials and microscope describe a real sample: pixels are solved again with the same ones. "
    "Their maps are those of the {surface}."
)
"""Claims, the pixels that were compared, and which were judged how."""


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

    Every pixel is asked for what must hold whatever the sample: layout, status, setpoint, height, balances of energy
    and virial, branch, motion, stated errors. Then every pixel is solved again as it was made, which must give the
    same, and pixels that differ and a random sample by the equation of motion in time, engaged from far, which shares
    no solver with the image and does not know what it says: status, motion, branch, phase, height, mean deflection,
    indentation, dissipation and virial are compared, within the errors that the image states. A pixel in which time
    comes to no rest is not judged. An image by "march" is slow to make again: there every pixel is solved by periodic
    orbits, and the sample as it was made. Pixels of `Raster` begin in time on the branch on which the image leaves the
    pixel before. Of a `Feedback` whole lines are scanned again; other lines are only asked for what must hold in
    every pixel.

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
        How many are in the sample; a line in time counts for 32.
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
    '3 of 19 claims FAIL. Do not trust this file.'
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
        everywhere.append(_same(claims, scene))
    surface = surface.compute()
    if (surface.shape, surface.pixel_size) != (claims.shape, claims.pixel_size):
        size = f"{surface.shape} pixels of {surface.pixel_size} m"
        raise InputError("surface", size, f"{claims.shape} pixels of {claims.pixel_size} m, as in the image")
    surface, picture = drifted(surface, claims.realism.drift), Picture(image, claims)
    everywhere += [claim for claim in invariants(picture, surface) if claim.pixels]
    unseen = UNSEEN.format(surface="scene in the file" if given is None else "surface given")
    if claims.control.in_time:
        lines = max(pixels // PER_LINE, 1)
        return Check((*everywhere, scan_again(picture, surface, lines, seed, threads, progress)), None, SCAN, unseen)
    drawn = sample(picture, pixels, seed)
    acts = claims.microscope.interaction
    only_in_time = surface.relaxes or acts.withdrawal != "linear" or acts.law.in_time
    # What remembers or is wet, or marched under two drives, has no orbits that stand for its march.
    two_drives = claims.microscope.drive.second is not None
    solve = _by_orbits if claims.solver == "march" and not (only_in_time or two_drives) else _as_made
    found, sampled, judged = solve(picture, surface, drawn, threads, progress)
    return Check((*everywhere, *found), sampled, judged, unseen)


def _as_made(
    picture: Picture, surface: Surface, drawn: Pixels, threads: int | None, progress: Progress | None
) -> Found:
    """Solve all pixels as they were made; those drawn, and as many of those that differ, in time."""
    pixels = int(np.prod(picture.shape))
    total = pixels + len(drawn)
    made = image_again(picture, surface, threads, after(progress, 0, total))
    claim, differ = repeat(made)
    judges = np.union1d(drawn, np.random.default_rng(0).permutation(differ)[: len(drawn)])
    again = solve_again(picture, surface, judges, FromFar(), threads, after(progress, pixels, total))
    found, sampled = compare(again, IN_TIME)
    found_again = f"{len(differ) or 'none'} {'differs' if len(differ) < 2 else 'differ'}"
    judged = (
        f"Every pixel was solved again as it was made ({made.materials} different materials): {found_again}. "
        f"{pixels_in_words(len(judges))}, some of every kind and those that differ, also {IN_TIME}. An error of the "
        "solver itself would show only there."
    )
    return [claim, *found], sampled, judged


def _by_orbits(
    picture: Picture, surface: Surface, drawn: Pixels, threads: int | None, progress: Progress | None
) -> Found:
    """Solve all pixels by periodic orbits, which are cheap beside the image's march; those drawn as they were made."""
    pixels = np.arange(int(np.prod(picture.shape)))
    total = len(pixels) + len(drawn)
    made = solve_again(picture, surface, drawn, by_name("march"), threads, after(progress, 0, total))
    orbits = solve_again(picture, surface, pixels, Orbit(complete=True), threads, after(progress, len(drawn), total))
    found, sampled = compare(orbits, "by periodic orbits")
    as_made = f"{pixels_in_words(len(drawn))}, some of every kind, also as the image was made."
    judged = f"Every pixel was solved again by periodic orbits ({orbits.materials} different materials). {as_made}"
    return [repeat(made)[0], *found], sampled, judged


def _same(claims: Claims, scene: Scene) -> Claim:
    """The scene that the image carries is that of its configuration."""
    options = {name: scene.options[name] for name in ("setpoint", "solver", "control", "accuracy", "realism")}
    both = {name: (getattr(claims, name), value) for name, value in options.items()}
    both["microscope"] = claims.microscope, scene.microscope
    differ = [name for name, (one, other) in both.items() if one != other]
    found = f"{' and '.join(differ)} differ" if differ else f"{scene.config['surface']['kind']} surface made again"
    return Claim("its scene is that of its configuration", FAILS if differ else HOLDS, 0, found)
