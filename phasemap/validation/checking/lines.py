"""Lines of an image in time, scanned again: by the same engine, and by the other one."""

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
from phasemap.validation.checking.picture import Picture
from phasemap.validation.checking.result import HOLDS, OPEN, Claim, judged

Rows = NDArray[np.intp]
Values = dict[str, Any]
"""Of each variable an array of shape (directions, lines, nx)."""

SAME = {"degree": 1e-3, "m": 1e-12}  # another machine rounds otherwise
USUAL = {
    "phase": 0.1,
    "amplitude": 0.005,
}  # [degree, free amplitudes] between the engines, on a surface with one branch
SHARE = 0.95  # of the pixels, that are so near
ENGINES = {col.AVERAGING: ("averaging", "slow flow"), col.MARCH: ("march", "equation of motion")}
ABOUT = "some lines scanned with the other engine"


def scan_again(
    picture: Picture, surface: Surface, count: int, seed: int, threads: int | None, progress: Progress | None
) -> list[Claim]:
    """Judge a few whole lines of a `Feedback`, there and back, of the surface as it passed under the tip.

    `count`: how many lines: the first ones where the tip was engaged once, or else some with most changes of
        branch, and any others.
    """
    claims = picture.claims
    job = Job(
        surface, Place(0, 0, surface.shape), claims.microscope, claims.amplitude, claims.control,
        by_name(claims.solver), claims.accuracy, claims.realism, SCAN_VARIABLES, workers_of(threads),
    )  # fmt: skip
    known = survey(surface, simulator_of(job.control).most(job))
    rows = _rows(picture, min(count, surface.shape[0]), seed)
    stretches = plan_image(job, known)
    plan = stretches[0].plan
    other, name = ENGINES[col.MARCH if plan.engine == col.AVERAGING else col.AVERAGING]
    again = _scanned(job, stretches, rows)
    if progress is not None:
        progress(len(rows), 2 * len(rows))
    said = f"lines {', '.join(map(str, rows))} by the {ENGINES[plan.engine][1]}"
    found = [_reproduced(picture, again, rows, said)]
    if claims.realism.temperature is not None or claims.realism.detector_noise is not None:
        return [*found, Claim(ABOUT, OPEN, 0, "with noise, another engine draws other random numbers")]
    job = replace(job, solver=by_name(other), control=plan.control)  # with gains
    again = _scanned(job, plan_image(job, known), rows)
    if progress is not None:
        progress(2 * len(rows), 2 * len(rows))
    return [*found, _between_engines(picture, again, rows, name)]


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


def _between_engines(picture: Picture, again: Values, rows: Rows, engine: str) -> Claim:
    """How far the other engine is, where both are on one branch for three pixels in a row."""
    units = {"phase": 1.0, "amplitude": picture.claims.microscope.driven_amplitude}
    names = [name for name in USUAL if name in picture]
    if not names or "branch" not in picture:
        return Claim(ABOUT, OPEN, 0, "the file has no phase, or no branch")
    same = picture.raw("branch")[:, rows] == again["branch"]
    same &= picture.good[:, rows] & (again["status"] == col.GOOD)
    steady = same.copy()
    steady[:, :, 1:] &= same[:, :, :-1]
    steady[:, :, :-1] &= same[:, :, 1:]
    pixels, compared = steady.size, int(np.count_nonzero(steady))
    if not compared:
        return Claim(ABOUT, OPEN, pixels, f"the {engine} is on no pixel on the same branch")
    apart = {name: np.abs(picture[name][:, rows] - again[name])[steady] / units[name] for name in names}
    near = {name: float(np.quantile(apart[name], SHARE)) for name in names}
    scale = {"phase": (1.0, "degree"), "amplitude": (100.0, "% of the free amplitude")}
    said = " and ".join(f"{near[name] * scale[name][0]:.2g} {scale[name][1]}" for name in names)
    found = f"the {engine} is within {said} in 95 %"
    if compared < pixels:
        found += f" of the pixels on one branch; {pixels - compared} others beside a change of branch"
    if all(near[name] <= USUAL[name] for name in names):
        return Claim(ABOUT, HOLDS, compared, found)
    return Claim(ABOUT, OPEN, compared, f"{found}: more than the usual 0.1 degree and 0.5 %, and no error is stated")
