"""Datasets of materials, of pixels or regions, with flags of what the data do not determine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.stack import Stack
from phasemap.inference.verdict import PARAMETERS, UNITS
from phasemap.results.variables import describe, provenance

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

FLAGS = (
    "modulus_not_determined", "adhesion_not_determined", "damping_not_determined", "poor_fit", "no_orbit", "no_data",
    "averaged_only", "ambiguous",
)  # fmt: skip
POOR, NO_ORBIT, NO_DATA, AVERAGED, AMBIGUOUS = (1 << FLAGS.index(name) for name in FLAGS[3:])


def dataset_of(
    materials: Array, errors: Array, misfit: Array, flags: NDArray[Any], stack: Stack, dims: tuple[str, ...],
    known: tuple[str, ...], configuration: dict[str, Any], how: str,
) -> xr.Dataset:  # fmt: skip
    """Materials over these dims, of whose shape `flags` are, settings over "image", and where all this comes from.

    `materials`, `errors`: last axis: the properties, and standard errors of their logarithms.
    `known`: the flags that there may be.
    """
    import xarray as xr

    found: dict[str, Any] = {}
    for i, name in enumerate(PARAMETERS):
        about = {"long_name": name, "units": UNITS[name], "ancillary_variables": f"{name}_error flag"}
        found[name] = (dims, materials[..., i], about)
        said = f"standard error of the natural logarithm of the {name}"
        found[f"{name}_error"] = (dims, errors[..., i], {"long_name": said, "units": "1"})
    said = "chi2 over degrees of freedom, about 1 where the model describes the data"
    found["misfit"] = (dims if misfit.ndim else (), misfit, {"long_name": said, "units": "1"})
    marks = np.array([1 << i for i in range(len(known))], np.uint8)
    said = "what the data do not determine, or what went wrong"
    meant: dict[str, Any] = {"long_name": said, "flag_masks": marks, "flag_meanings": " ".join(known)}
    found["flag"] = (dims, flags, meant)
    found["setpoint"] = ("image", list(stack.setpoints), {"long_name": "setpoint", "units": "1"})
    amplitudes = [one.drive.free_amplitude for one in stack.scopes]
    found["free_amplitude"] = ("image", amplitudes, {"long_name": "free amplitude at resonance", "units": "m"})
    ds = xr.Dataset(found)
    scopes = [describe(one) for one in dict.fromkeys(stack.scopes)]
    ds.attrs.update(provenance({"microscopes": scopes, "setpoints": list(stack.setpoints), **configuration}, how))
    return ds
