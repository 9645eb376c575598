"""The force between tip and surface against depth, as the laws of interaction have it."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels.columns import FORMING, RELEASE
from phasemap._kernels.law import contact_force, longrange_force
from phasemap._shared.asked import asked_as
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import describe, provenance
from phasemap.solvers.problem import work_of_material
from phasemap.sweeps.sweep import check_axis

DEPTHS = "-5 nm:2 nm:281"
USUAL = (0.0, 1e-5)  # m, of depths and distances of interest


@asked_as()
def force_curve(material: Material, scope: Microscope, depths: Any = DEPTHS) -> xr.Dataset:
    """The conservative force of a material on the tip, approaching and retracting.

    Parameters
    ----------
    material : Material
    scope : Microscope
        Its tip and its interaction.
    depths : array_like or str, optional
        How deep the tip is in the surface [m], negative outside, rising or falling.

    Returns
    -------
    xarray.Dataset
        Dims ("direction", "depth"), approach and retract: force [N], positive repulsive. The two differ where a law of
        contact draws out a neck, and where one of liquid forms. Damping, which needs a velocity, is not in it.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip("10 nm"), pm.Drive("20 nm"))
    >>> curve = pm.force_curve(pm.Material("3 GPa", adhesion="50 mJ/m^2"), scope, ["-0.3 nm", "0 nm", "1 nm"])
    >>> (1e9 * curve.force.sel(direction="approach")).round(2).values.tolist()
    [-0.79, -3.14, 11.27]
    """
    axis = check_axis("depths", depths, "m", usual=USUAL)
    work = work_of_material(material, scope, scope.driven_amplitude, marched=scope.interaction.law.wets)
    row = work.rows[0]
    forces = [
        [(contact_force if depth >= ends else longrange_force)(work.law, depth, row) for depth in axis.tolist()]
        for ends in (row[FORMING], row[RELEASE])
    ]
    about = {"long_name": "force of the surface on the tip, positive repulsive", "units": "N"}
    return xr.Dataset(
        {"force": (("direction", "depth"), np.array(forces), about)},
        {
            "direction": ["approach", "retract"],
            "depth": ("depth", axis, {"long_name": "depth of the tip in the surface", "units": "m"}),
        },
        provenance({"microscope": describe(scope), "material": describe(material)}, "force calculated"),
    )
