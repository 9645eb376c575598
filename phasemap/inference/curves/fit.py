"""Fits of modulus, adhesion, damping and whatever else to a measured frequency response or distance curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number, whole
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.interaction import Interaction, check_memory
from phasemap.experiment.material import Material, relaxes
from phasemap.experiment.microscope import Microscope
from phasemap.inference.curves.data import CurveSetting, check_data, check_parameters
from phasemap.inference.curves.evidence import search
from phasemap.inference.curves.recorded import (
    EVERY,
    as_known_to,
    begun,
    check_unsaid,
    compared,
    of_curve,
    refused,
    under,
    with_law,
)  # fmt: skip
from phasemap.inference.curves.residuals import CurveProblem
from phasemap.inference.curves.result import Fit, make_fit
from phasemap.inference.determined import PRIOR
from phasemap.solvers.continuation.path import Question

__all__ = ["Fit", "fit_distance", "fit_frequency"]


@asked_as()
def fit_frequency(
    frequencies: Any,
    *,
    scope: Microscope,
    start: Material,
    tip_offset: float,
    amplitude: Any = None,
    amplitude_error: Any = None,
    phase: Any = None,
    phase_error: Any = None,
    direction: Any = "up",
    parameters: Any = None,
    starts: int = 5,
) -> Fit:
    """Fit a material to a measured frequency response by least squares, as Wang (1999) did for Fig. 3.

    Each datum is compared with the stable branch that is nearest to it, so that it does not matter at first where the
    response jumps; in the end the branches are checked against those that a sweep of the fitted material visits.

    Parameters
    ----------
    frequencies : array_like, shape (n,)
        [Hz], rising or falling.
    scope : Microscope
        Its drive says the free amplitude at resonance; its own frequency is not used.
    start : Material
        Where to start: within a factor of about 3 of the truth.
    tip_offset : float
        Rest position of the tip above the undeformed surface [m].
    amplitude, phase : array_like, shape (n,) or (2, n)
        Measured first harmonic [m] and phase [degree], 0 at free resonance and positive repulsive; one may be missing.
    amplitude_error, phase_error : array_like or float
        Standard errors of these [m, degree], above 0.
    direction : str or tuple
        "up", "down", or ("up", "down") for data of shape (2, n).
    parameters : sequence of str, optional
        What to fit: "modulus", "adhesion", "damping" (the default; "viscosity" if `start` has one), "stiffness",
        "resonance_frequency", "quality_factor", "radius", "free_amplitude", "decay_length", "tip_offset",
        "amplitude_scale" (amplitude read over the true one) or "phase_offset" (phase read less the true one).
        The rest stays as given, and a parameter that must stay positive has to start above 0. Beforehand, the
        material's are known within a factor of 10 and the microscope's within 1.44; a mapping of names to such factors,
        or to standard errors of offsets, says otherwise. Three times as far is searched.
    starts : int
        Most starting points that are tried as long as chi2 is unlikely.

    Returns
    -------
    Fit
        Look at `good` before the values: a parameter that the data do not determine has an infinite error.

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 148.24e3, 250.0), pm.Tip(30e-9), pm.Drive(155e-9))
    >>> frequencies = np.linspace(147.8e3, 148.8e3, 11)
    >>> film = pm.Material(modulus=0.89e9, adhesion=0.37, damping=0.014)
    >>> sweep = pm.sweep_frequency(film, scope, frequencies, tip_offset=140e-9).sel(direction="up")
    >>> fit = pm.fit_frequency(
    ...     frequencies, scope=scope, start=pm.Material(1.5e9, 0.37, 0.02), tip_offset=140e-9, phase=sweep.phase,
    ...     phase_error=0.05, parameters=("modulus", "damping"))
    >>> fit.good, round(fit.material.modulus / 1e9, 3), round(fit.material.damping, 4)
    (True, 0.89, 0.014)
    """
    height = number("tip_offset", tip_offset, "m")
    given = {"amplitude": (amplitude, amplitude_error), "phase": (phase, phase_error)}
    return _fit("frequency", frequencies, given, direction, (start, scope, height), parameters, starts)


@asked_as()
def fit_distance(
    tip_offsets: Any,
    *,
    scope: Microscope,
    start: Material = PRIOR,
    laws: Sequence[str | Interaction] | str | None = None,
    offset: float = 0.0,
    amplitude: Any = None,
    amplitude_error: Any = None,
    phase: Any = None,
    phase_error: Any = None,
    direction: Any = None,
    parameters: Any = None,
    starts: int = 5,
) -> Fit:
    """Fit a material to a measured amplitude-phase-distance curve by least squares.

    Parameters
    ----------
    tip_offsets : array_like, shape (n,), or xarray.Dataset
        Rest positions of the tip above the undeformed surface [m], rising or falling, but for a constant. Or a curve of
        `phasemap.read_curve`: then amplitude, phase, their errors and directions are its own, and material, offset,
        decay length, tip radius, sensitivity of the amplitude, zero of the phase and "free_phase" (how far beside the
        resonance the lever is driven: the phase of the free lever) are fitted.
    scope : Microscope
        Its free amplitude is not used for a curve that was read.
    start : Material
        Adhesion or damping of 0 is put at that of the default where it is fitted to a curve that was read. Of one that
        relaxes the modulus is fitted with the shape of its relaxation kept, in time, which takes minutes.
    laws : sequence of str or Interaction, optional
        Contact laws to compare, or "all", for a material that relaxes all that know it; by default that of `scope`. One
        by name keeps the rest of the interaction of `scope` but for what it refuses, which `Fit.status` says.
        Each starts, too, from what the best before it found, so name simple ones first. Besides `parameters`, decay
        lengths are fitted and the own numbers of "neck", "lossy dmt" and films, of "capillary" the film of tip and
        sample together, but not what does not act: adhesion and decay length of "hertz". "lossy dmt" and "capillary"
        are marched in time, which takes minutes.
    offset : float
        That constant, which is added to `tip_offsets` [m]; fitted where `parameters` has "offset".
    amplitude, amplitude_error, phase, phase_error : array_like
        As in `fit_frequency`; not beside a curve that was read.
    direction : str or tuple
        "approach" (the default), "retract", or ("approach", "retract") for data of shape (2, n). A curve that was read
        has its own; one of two is ``curve.sel(direction="approach")``.
    parameters : sequence of str or mapping, optional
        As in `fit_frequency`, with "offset" in place of "tip_offset", and "sensitivity" (of the amplitude, over the
        supposed one; the free amplitude follows it), "free_phase" [degree], "thickness" of a film, "liquid_film",
        "relaxation_time", and the numbers of the contact law by their names ("adhesion_ratio", "outer_loss"; that of a
        `Neck` is "neck_length"), known within a factor of 10. Of a curve that was read, a sequence says what is
        fitted in place of the above, and a mapping adds to it, or changes how well it is known.
    starts : int
        As in `fit_frequency`.

    Returns
    -------
    Fit
        As of `fit_frequency`; the tip offsets of its curve have the offset in them. Of several laws the likeliest one;
        `rivals` has the others.

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    >>> film, far = pm.Material(modulus=1e9, adhesion=0.05, damping=0.01), np.linspace(21e-9, 12e-9, 31)
    >>> seen = pm.sweep_distance(film, scope, far).sel(direction="approach")
    >>> fit = pm.fit_distance(
    ...     far - 3e-9, scope=scope, start=pm.Material(2e9, 0.05, 0.005), phase=seen.phase, phase_error=0.5,
    ...     amplitude=seen.amplitude, amplitude_error=0.1e-9, parameters=("modulus", "damping", "offset"))
    >>> fit.good, round(fit.values["offset"] * 1e9, 2)
    (True, 3.0)
    """
    height = number("offset", offset, "m")
    given = {"amplitude": (amplitude, amplitude_error), "phase": (phase, phase_error)}
    read = hasattr(tip_offsets, "data_vars")
    as_asked = laws is None and (not read or isinstance(parameters, Sequence))
    if read:
        check_unsaid(
            height, amplitude=amplitude, amplitude_error=amplitude_error, phase=phase, phase_error=phase_error,
            direction=direction,
        )  # fmt: skip
        start = begun(start, parameters)
        tip_offsets, given, direction, scope, height, parameters = of_curve(tip_offsets, scope, start, parameters)
    direction = "approach" if direction is None else direction
    if as_asked:
        return _fit("tip_offset", tip_offsets, given, direction, (start, scope, height), parameters, starts)
    named, left_out = compared(laws, scope, start)
    if not named:
        raise InputError("laws", laws, f"one at least of {', '.join(EVERY)}, or all")
    fits: list[Fit] = []
    for law in named:
        beneath, first, more = under(law, scope, start)
        first, unknown = as_known_to(beneath.interaction.law, first) if len(named) > 1 else (first, "")
        asked = with_law(parameters, CurveSetting(first, beneath, height), more)
        known = max(fits, key=lambda one: one.evidence).values if fits else {}
        fit = _fit("tip_offset", tip_offsets, given, direction, (first, beneath, height), asked, starts, known)
        refusal = refused(scope.interaction, beneath.interaction) if isinstance(law, str) else ""
        fits.append(replace(fit, status=" ".join(filter(None, (fit.status, refusal, unknown)))))
    best, *others = sorted(fits, key=lambda one: -one.evidence)
    return replace(best, rivals=tuple(others), status=f"{best.status} {left_out}".rstrip())


def _fit(
    axis: str, values: Any, given: dict[str, tuple[Any, Any]], direction: Any,
    begun: tuple[Material, Microscope, float], parameters: Any, starts: int, known: Mapping[str, float] | None = None,
) -> Fit:  # fmt: skip
    """A fit from `begun`, as of `CurveSetting`, tried first from values `known` of a simpler law, if there are any."""
    if axis == "frequency" and Question(*begun[:2]).only_in_time:
        allowed = "one of a material and a law that are not marched in time"
        raise InputError("a frequency response", Word("given"), allowed, "fit_distance fits these too.")
    if relaxes(begun[0]):
        check_memory(begun[1].interaction.law, relaxes=True)
    data, setup = check_data(axis, values, direction, given), CurveSetting(*begun)
    chosen = check_parameters(parameters, setup, axis)
    if data.size <= len(chosen):
        raise InputError(
            "number of data", data.size, f"more than the number of fitted parameters, which is {len(chosen)}"
        )
    problem = CurveProblem(data, setup, chosen)
    first = [np.array([one.q(known.get(one.name, one.start)) for one in chosen])] if known else []
    return make_fit(problem, search(problem, whole("starts", starts, 1), first))
