"""Lines of an image in time, scanned again by the engine that made them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.threads import Progress, workers_of
from phasemap.experiment.control import LINES, Feedback
from phasemap.experiment.surface import Surface
from phasemap.imaging.canvas import Canvas
from phasemap.imaging.job import Job, Stretch, fill_part, plan_image, simulator_of
from phasemap.imaging.materials import Place, survey
from phasemap.results.variables import FLAGS, FLOATS, SCAN_VARIABLES
from phasemap.solvers.solver import by_name
from phasemap.validation.picture import Claim, Picture, judged

Rows = NDArray[np.intp]
Values = dict[str, Any]

"""Of each variable an array of shape (directions, lines, nx)."""
SAME = {"degree": 1e-3, "m": 1e-12}  # another machine rounds otherwise
ENGINES = {col.AVERAGING: "slow flow", col.MARCH: "equation of motion"}


def scan_again(
    picture: Picture, surface: Surface, count: int, seed: int, threads: int | None, progress: Progress | None
) -> Claim:
    """Judge some whole lines of a `Feedback`, there and back, of the surface as it passed under the tip.

    They are the first ones where the tip was engaged once, or else some with most changes of branch, and any others.
    """
    claims = picture.claims
    job = Job(
        surface, Place(0, 0, surface.shape), claims.microscope, claims.amplitude, claims.control,
        by_name(claims.solver), claims.accuracy, claims.realism, SCAN_VARIABLES, workers_of(threads),
    )  # fmt: skip
    known = survey(surface, simulator_of(job.control).most(job))
    rows = _rows(picture, min(count, surface.shape[0]), seed)
    stretches = plan_image(job, known)
    again = _scanned(job, stretches, rows)
    if progress is not None:
        progress(len(rows), len(rows))
    said = f"lines {', '.join(map(str, rows))} by the {ENGINES[stretches[0].plan.engine]}"
    return _reproduced(picture, again, rows, said)


def _rows(picture: Picture, count: int, seed: int) -> Rows:
    """Numbers of the lines."""
    control, ny = picture.claims.control, picture.shape[1]
    assert isinstance(control, Feedback)
    if control.engage == "image":
        return np.arange(count)
    random = np.random.default_rng(seed).permutation(ny)
    if "branch" not in picture:
        return np.sort(random[:count])
    changes = np.count_nonzero(np.diff(picture.raw("branch").astype(np.int8), axis=2), axis=(0, 2))
    most = random[np.argsort(-changes[random], kind="stable")][: count // 2]
    others = [row for row in random if row not in most]
    return np.sort(np.concatenate([most, others[: count - len(most)]]).astype(np.intp))


def _scanned(job: Job, stretches: list[Stretch], rows: Rows) -> Values:
    """Variables of these lines; those that the tip passes one after the other are one part."""
    assert isinstance(job.control, Feedback)
    parts = [rows] if job.control.engage == "image" else [rows[i : i + 1] for i in range(len(rows))]
    scanned = []
    for part in parts:
        surface = job.surface.rows(slice(int(part[0]), int(part[-1]) + 1))
        canvas = Canvas(surface, job.names, LINES)
        fill_part(replace(job, surface=surface, place=job.place._replace(row=int(part[0]))), stretches, canvas)
        scanned.append(canvas.arrays())
    return {name: np.concatenate([one[name] for one in scanned], axis=1) for name in job.names}


def _reproduced(picture: Picture, again: Values, rows: Rows, said: str) -> Claim:
    """The same engine gives the same numbers, noise and all."""
    looked_at, bad = np.zeros(picture.shape, bool), np.zeros(picture.shape, bool)
    by = np.zeros(picture.shape)
    looked_at[:, rows] = True
    for name in map(str, picture.image.data_vars):
        claimed, found = picture[name][:, rows], again[name]
        if name in FLAGS:
            bad[:, rows] |= claimed != found
            continue
        allowed = SAME[FLOATS[name].units] + 2 * picture.coarse(name)
        apart = np.abs(claimed - found)
        bad[:, rows] |= ~((apart <= allowed) | (np.isnan(claimed) & np.isnan(found)))
        by[:, rows] = np.fmax(by[:, rows], apart / allowed)
    return judged("some lines scanned again give the same", picture, bad, by, looked_at, said)
