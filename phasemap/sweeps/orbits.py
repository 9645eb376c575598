"""Every orbit of one material, at a setpoint or at a distance."""

from __future__ import annotations

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import Scalar
from phasemap.experiment.lever import seen
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import (
    FLOATS,
    STABILITY,
    branch_of,
    coded,
    describe,
    flag_attributes,
    float_attributes,
    provenance,
)
from phasemap.solvers.continuation.complete import orbits_of_amplitude, orbits_of_offset
from phasemap.solvers.continuation.path import Question, fixed_path
from phasemap.solvers.problem import check_setpoint


@asked_as()
def orbits(
    material: Material, scope: Microscope, setpoint: Scalar | None = None, *, tip_offset: Scalar | None = None
) -> xr.Dataset:
    """Find every periodic orbit at a setpoint or at a tip offset, stable or not.

    Parameters
    ----------
    material : Material
    scope : Microscope
    setpoint : float
        Amplitude over the free amplitude at the drive frequency, between 0 and 1. Either this or `tip_offset`.
    tip_offset : float
        Rest position of the tip above the undeformed surface [m]; negative where the lever presses.

    Returns
    -------
    xarray.Dataset
        Dim "orbit", from far to near: tip_offset, amplitude, height, mean_deflection, indentation [m], phase [degree],
        dissipation, virial [J], floquet, feedback_slope, energy_closure [1], branch and stable (flags). The attribute
        `complete` is 1 if the curve of orbits was followed to its end.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> found = pm.orbits(pm.Material(modulus=2e9, adhesion=0.1), scope, setpoint=0.8)
    >>> found.sizes["orbit"], found.stable.values.tolist()
    (3, [1, 0, 1])
    """
    if (setpoint is None) == (tip_offset is None):
        raise InputError("setpoint, tip_offset", (setpoint, tip_offset), "exactly one of the two")
    path = fixed_path(Question(material, scope))
    if setpoint is not None:
        setpoint = check_setpoint(setpoint)
        rows, complete = orbits_of_amplitude(path, setpoint * scope.driven_amplitude)
        rows = rows[np.argsort(-rows[:, col.TIP_OFFSET], kind="stable")]
    else:
        assert tip_offset is not None
        tip_offset = number("tip_offset", tip_offset, "m")
        rows, complete = orbits_of_offset(path, tip_offset)
    rows = seen(rows, path.lever)
    configuration = {
        "microscope": describe(scope), "material": describe(material), "setpoint": setpoint, "tip_offset": tip_offset
    }  # fmt: skip
    found = _orbit_dataset(rows)
    found.attrs.update(provenance(configuration, "orbits found"))
    found.attrs["complete"] = int(complete)
    return found


def _orbit_dataset(rows: np.ndarray) -> xr.Dataset:
    names = (
        "tip_offset", "amplitude", "height", "phase", "mean_deflection", "indentation", "dissipation", "virial",
        "floquet", "feedback_slope", "energy_closure",
    )  # fmt: skip
    data = {name: ("orbit", FLOATS[name].value(rows), float_attributes(name)) for name in names}
    found = xr.Dataset(data, {"orbit": ("orbit", np.arange(len(rows)), {"long_name": "orbit, far to near"})})
    found["branch"] = ("orbit", branch_of(rows), flag_attributes("branch"))
    stable = (rows[:, col.FLOQUET] < 1).astype(np.int8)
    found["stable"] = ("orbit", stable, coded("stability of the orbit at fixed tip offset", *STABILITY))
    return found
