"""`phasemap.simulate`: from a surface and a microscope to an image."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError, SolveError, Word
from phasemap._shared.notices import tell
from phasemap._shared.quantities import Scalar
from phasemap._shared.threads import Progress, bounds_of, found_in, workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Control, Engage, Raster
from phasemap.experiment.described import describe
from phasemap.experiment.interaction import check_memory
from phasemap.experiment.interaction.contact import LAWS
from phasemap.experiment.material_rows import MORE, PLAIN
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.realism import Realism, check_realism
from phasemap.experiment.surface import Surface
from phasemap.imaging.canvas import Canvas, check_image
from phasemap.imaging.checkpoint import Checkpoint
from phasemap.imaging.dask import check_lazy, simulate_lazily
from phasemap.imaging.imperfections import changes, drifted, finish
from phasemap.imaging.job import Job, fill_kept, fill_part, plan_image, simulator_of
from phasemap.imaging.materials import Window, survey
from phasemap.results.channels import inputs_of, split, with_channels
from phasemap.results.descriptions import FORCES, describe_failures, describe_validity
from phasemap.results.quantities import needs_of
from phasemap.results.status import Status
from phasemap.results.variables import IN_TIME, OF_ADHESION, OF_FORCES, provenance
from phasemap.solvers.problem import Work, check_marched, check_setpoint, forces_of, make_work
from phasemap.solvers.solver import by_name, check_integrals, check_marches

MANY = 1 << 20  # pixels among which a thread looks for the largest


@asked_as()
def simulate(
    surface: Surface,
    scope: Microscope,
    setpoint: Scalar | Sequence[Scalar],
    solver: str = "auto",
    control: Control | None = None,
    accuracy: Accuracy | None = None,
    *,
    realism: Realism | None = None,
    variables: str | Iterable[str] | None = None,
    strict: bool = False,
    progress: Progress | None = None,
    threads: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Simulate the image that the microscope takes of a surface.

    Parameters
    ----------
    surface : Surface
        Material maps and topography, shape (ny, nx).
    scope : Microscope
    setpoint : float or sequence of float
        Amplitude of the first harmonic over the free amplitude at the drive frequency, between 0 and 1. Several of them
        give an image each, along a leading dim "setpoint".
    solver : {"auto", "averaging", "orbit", "march"}
        "averaging" is first order and fastest, "orbit" exact, "march" integrates the equation of motion in time (slow),
        "auto" takes the cheapest that meets `accuracy` and says per pixel which one that was.
    control : Engage, Raster or Feedback, optional
        How the controller comes to the setpoint: every pixel engaged anew from far (the default), the state carried
        along lines quasi-statically, or a feedback in time. In time "averaging" is the slow flow of the amplitude,
        "march" the equation of motion, and "auto" the former unless the quality factor is below 20, and for lines on
        which the amplitude changes too much within a period the latter.
    accuracy : Accuracy, optional
        Largest error against the exact orbit, for "auto".
    realism : Realism, optional
        What a real microscope adds: noise, drift, offsets of lines, a change of the tip, quantisation; none by default.
    variables : str or iterable of str, optional
        Which variables to return, all below by default; `status` always comes along. Also higher harmonics, amplitude_2
        to amplitude_6 [m] and phase_2 to phase_6 [degree], and channels that are derived from others, by the names of
        `phasemap.channels`: "loss_tangent", "loss_tangent_corrected" and more; and what only these need,
        contact_storage, adhesion_loss and adhesion_virial [J], whose integrals cost more than an interpolated pixel.
        What a second mode shows comes by default where the drive has one.
    strict : bool
        Raise where a pixel has no solution, instead of leaving NaN and a status.
    progress : callable, optional
        Called as ``progress(done, total)`` from the calling thread, in distinct materials, in pixels where materials
        are interpolated or too many to be kept, or in lines of a feedback.
    threads : int, optional
        All cores by default, one for each block of a surface in Dask arrays. The numbers do not depend on it.
    checkpoint : path-like, optional
        A folder where what is done is kept every few seconds. If this process is killed, the same call goes on from
        there; once the image is safe, the folder may be deleted. Not for a surface in Dask arrays.

    Returns
    -------
    xarray.Dataset
        Dims ("y", "x"), row 0 at the top, coordinates in m: height, phase, amplitude, tip_offset, mean_deflection,
        indentation [m and degree], dissipation, virial [J], flags, and errors where estimated; each says what it is.
        `Raster` and `Feedback` have a leading dim "direction", trace and retrace; `Feedback` has fewer, averaged over
        the time in each pixel, with amplitude_error, and the gains in its attributes. An image of films has their
        thickness [m] as a coordinate of its pixels.

    Raises
    ------
    SolveError
        With `strict`, if a pixel has no solution.

    Notes
    -----
    A material that occurs in many pixels is solved once. A term that no pixel has is not evaluated.

    Where an image has more than some thousand different materials (some hundred under films of liquid), "auto" solves a
    part that spans them and interpolates (`phasemap.imaging.interpolation`): never across a jump of the orbit, with an
    error estimated at materials of the image itself, and the rest is solved one by one. `solver` says "interpolated"
    there. Of `Raster` that is what engagement finds; the other branch is solved for each material to which the tip
    comes on it.

    Of a surface whose maps are Dask arrays the image has Dask arrays too, of the same numbers: to compute them, or to
    write them with ``to_zarr`` or ``to_netcdf``, simulates block by block, on a cluster if there is one. What is only
    known then is missing among the attributes, and the gains of a feedback are variables. All variables that are wanted
    should be computed at once. The maps are computed twice, for a survey and to be filled, so that none is kept;
    persist those that cost more time than memory.

    Beside the maps and what is returned, this takes less than 256 MiB for images of up to 4096 x 4096 pixels.

    Examples
    --------
    >>> import phasemap as pm
    >>> surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    >>> image = pm.simulate(surface, scope, setpoint=0.7)
    >>> [round(float(p), 2) for p in image.phase.values[0]]
    [42.05, 44.5]
    """
    asked = _Asked(
        solver, control or Engage(), accuracy or Accuracy(), realism or Realism(), variables, strict, progress, threads,
        checkpoint,
    )  # fmt: skip
    if isinstance(setpoint, (list, tuple)) or getattr(setpoint, "ndim", 0) > 0:
        return _at_each(surface, scope, setpoint, asked)
    return _at_one(surface, scope, check_setpoint(setpoint), asked)


@dataclass(frozen=True)
class _Asked:
    """Options of `simulate`, besides surface, microscope and setpoint."""

    solver: str
    control: Control
    accuracy: Accuracy
    realism: Realism
    variables: str | Iterable[str] | None
    strict: bool = False
    progress: Progress | None = None
    threads: int | None = None
    checkpoint: str | os.PathLike[str] | None = None


def check_job(surface: Surface, scope: Microscope, setpoint: float, **options: Any) -> Job:
    """Refuse what `simulate` with these options would refuse before it begins; what it would do is returned."""
    return _checked(surface, scope, check_setpoint(setpoint), _Asked(**options))[0]


def _checked(
    surface: Surface, scope: Microscope, setpoint: float, asked: _Asked
) -> tuple[Job, tuple[str, ...], tuple[str, ...], bool]:
    """The work of an image; variables that stay in it, those derived, and whether they are derived with the orbits."""
    control = asked.control
    if scope.interaction.law.takes_film and surface.thickness is None:
        allowed = f"a thickness of the film in m where the contact is {scope.interaction.law.name!r}"
        raise InputError("thickness", None, allowed, "It may be a map, infinite where there is no film.")
    simulator = simulator_of(control)
    realism = check_realism(asked.realism, control, surface.shape[0])
    stay, derived = split(asked.variables, control, scope)
    # Of the orbits, where an image shows what they do; else of the image, as an instrument would.
    early = derived if not (control.in_time or changes(realism)) else ()
    names = (*inputs_of(stay, () if early else derived, control), *early)
    if surface.lazy:
        check_lazy(realism, asked.strict, asked.progress, asked.checkpoint)
    else:
        check_image(surface.shape, names, control.directions, workspace(realism))
    surface = drifted(surface, realism.drift)
    method = by_name(asked.solver)
    place, amplitude, workers = (
        Window(0, 0, surface.shape),
        setpoint * scope.driven_amplitude,
        workers_of(asked.threads),
    )
    job = Job(
        surface, place, scope, amplitude, control, method, asked.accuracy, realism, names, workers, asked.progress
    )
    simulator.check(job)
    _check_memory(job, (*stay, *derived))
    return job, stay, derived, bool(early)


def _at_one(surface: Surface, scope: Microscope, setpoint: float, asked: _Asked) -> xr.Dataset:
    """The image at one setpoint."""
    started = time.perf_counter()
    job, stay, derived, early = _checked(surface, scope, setpoint, asked)
    surface, control, realism = job.surface, job.control, job.realism
    configuration = {
        "microscope": describe(scope), "setpoint": setpoint, "solver": job.solver.name, "control": describe(control),
        "accuracy": describe(asked.accuracy), "realism": describe(realism), "shape": list(surface.shape),
        "pixel_size": list(surface.pixel_size),
    }  # fmt: skip
    if surface.lazy:
        image = simulate_lazily(replace(job, workers=asked.threads or 1))
    else:
        kept = None
        if asked.checkpoint is not None:
            law, named = scope.interaction.law, {**configuration, "variables": job.names}
            kept = Checkpoint(asked.checkpoint, surface, law, named)
        image = _in_memory(replace(job, memo=kept), kept, asked.strict)
        image.attrs["seconds"] = round(time.perf_counter() - started, 6)
    image.attrs.update(provenance(configuration, "simulated"))
    image.attrs.update(IN_TIME if control.in_time else {})
    image = with_channels(finish(image, realism), stay, () if early else derived, control, scope)
    if surface.thickness is not None:
        image = image.assign_coords(thickness=surface.to_dataset()["thickness"])
    if not surface.lazy:
        tell(line for describe in (describe_failures, describe_validity) for line in describe(image))
    return image


def _at_each(surface: Surface, scope: Microscope, setpoints: Any, asked: _Asked) -> xr.Dataset:
    """An image at each setpoint, along a dim of that name."""
    values = [check_setpoint(one) for one in setpoints]
    if len(set(values)) < len(values) or not values:
        raise InputError("setpoint", str(setpoints), "one number, or several different ones")
    realism, images = check_realism(asked.realism, asked.control, surface.shape[0]), []
    for i, value in enumerate(values):  # each with noise of its own, as images that are taken one after the other
        noise = replace(realism, seed=realism.seed + i)
        images.append(_at_one(surface, scope, value, replace(asked, realism=noise)))
    about = {"long_name": "setpoint amplitude over free amplitude", "units": "1"}
    image = xr.concat(images, xr.Variable("setpoint", values, about), combine_attrs="drop_conflicts")
    first = json.loads(images[0].attrs["configuration"])
    image = image.assign(_differing(images, asked.control))
    return image.assign_attrs(provenance({**first, "setpoint": values}, "simulated"))


def _differing(images: list[xr.Dataset], control: Control) -> dict[str, Any]:
    """Findings of the control, and steps of quantisation, that are not the same at all setpoints."""
    found = {name: ([one.attrs.get(name) for one in images], {"long_name": long_name})
             for name, long_name in simulator_of(control).notes.items()}  # fmt: skip
    for name, values in images[0].data_vars.items():
        about = {"long_name": f"step of the quantisation of {name}", "units": values.attrs.get("units", "1")}
        found[f"{name}_quantisation_step"] = [one[name].attrs.get("quantisation_step") for one in images], about
    return {
        name: ("setpoint", np.array(values, float), about)
        for name, (values, about) in found.items()
        if len(set(values)) > 1
    }


def _check_memory(job: Job, asked: tuple[str, ...]) -> None:
    """Refuse what contacts that remember do not have, for they are marched in time; `asked` as it was named."""
    if job.surface.lazy and job.scope.interaction.withdrawal == "ting":
        raise InputError("surface", Word("in Dask arrays"), "maps in memory where withdrawal is 'ting'")
    if not job.only_in_time:
        return
    check_marches(job.solver.name)
    if job.surface.relaxes:
        check_memory(job.scope.interaction.law, relaxes=True)
    if isinstance(job.control, Raster):
        hint = "Raster goes from orbit to orbit of static forces; Feedback scans lines in time, dents and all."
        raise InputError("control", "Raster", "Engage or Feedback where contacts remember or are wet", hint)
    check_marched(True, job.scope)
    check_integrals([name for name in asked if {*OF_ADHESION, *OF_FORCES}.intersection(needs_of((name,)))])


def workspace(realism: Realism) -> int:
    """Bytes a pixel that realism takes besides the image: copies of maps that drift, and of what is digitised."""
    return 64 * any(realism.drift) + 32 * bool(realism.bits or realism.line_offset or realism.phase_offset)


def _in_memory(job: Job, checkpoint: Checkpoint | None, strict: bool) -> xr.Dataset:
    """The image of a surface in memory, and in its attributes what was found out about the materials."""
    surface, scope = job.surface, job.scope
    surveyed = survey(surface, simulator_of(job.control).most(job), workers=job.workers)
    canvas = Canvas(surface, job.names, job.control.directions)
    stretches = plan_image(job, surveyed)
    if checkpoint is None:
        fill_part(job, stretches, canvas)
    else:
        fill_kept(job, stretches, canvas, checkpoint)
    if strict:
        _refuse_failures(canvas.status.reshape(-1, *surface.shape), describe(scope.interaction))
    largest, viscous = _largest_material(surface, job.workers), surface.viscosity is not None
    work = make_work(largest, viscous, scope, scope.driven_amplitude, marched=True)
    return canvas.image().assign_attrs(
        dict(zip(FORCES, forces_of(largest, viscous, scope), strict=True)),
        modelled="; ".join(modelled(work, scope, surface.topography is not None, job.remembers)),
        distinct_materials=surveyed.count,
    )


def modelled(work: Work, scope: Microscope, topography: bool, remembers: bool) -> list[str]:
    """Forces and effects that act in this work, in words."""
    rows, law = work.rows, scope.interaction.law
    names = [next((name for name, one in LAWS.items() if one == law), law.name) + " contact"]
    if np.any(rows[:, col.LONGRANGE] > rows[:, col.BIAS]):
        names.append(f"{law.attraction.name.replace(' ', '-')} attraction")
    if np.any(rows[:, col.FORMING] < 0):
        names.append("necks of liquid")
    if np.any(np.abs(rows[:, col.BIAS]) > 0):
        names.append("electrostatic bias" if scope.interaction.bias else f"{scope.interaction.outside.name} force")
    if np.any(rows[:, col.DAMPING] > 0):
        names.append(f"damping with depth^{scope.interaction.damping_exponent:g}")
    if remembers:
        names.append("relaxation after Ting" if not np.any(rows[:, col.DAMPING] > 0) else "withdrawal after Ting")
    if scope.tip.modulus is not None:
        names.append("elastic tip")
    if topography:
        names.append("topography")
    return names


def _largest_material(surface: Surface, workers: int) -> Array:
    """Row with the largest of every property, of contact angles the smallest: zero is what no pixel has."""
    columns = [column.reshape(-1) for column in surface.columns]
    sign = np.ones(len(columns))
    if surface.contact_angle is not None:
        sign[PLAIN + MORE.index("contact_angle")] = -1

    def largest_in(first: int, last: int) -> list[float]:
        return [np.fmax.reduce(one * column[first:last]) for one, column in zip(sign, columns, strict=True)]

    found = found_in(largest_in, bounds_of(len(columns[0]), MANY), workers)
    return np.asarray(np.nan_to_num(sign * np.fmax.reduce(found, axis=0, keepdims=True), posinf=np.inf))


def _refuse_failures(status: Array, interaction: dict[str, Any]) -> None:
    """Raise where a status, shape (directions, ny, nx), is not good; `interaction` as `describe` gives it."""
    bad = status != 0
    if bad.any():
        place = np.unravel_index(np.argmax(bad), bad.shape)
        row, column = (int(i) for i in place[1:])
        advice = Status.of(int(status[place])).advice(interaction=interaction)
        count = int(bad.sum())
        failed = "1 pixel has no solution; it is" if count == 1 else f"{count} pixels have no solution; the first is"
        raise SolveError(f"{failed} at row {row}, column {column}. {advice}")
