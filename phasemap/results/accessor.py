"""``curve.phasemap.groups``: the variables of a Dataset by what they are given for.

xarray knows it as soon as phasemap has made a Dataset.
"""

from __future__ import annotations

import xarray as xr


@xr.register_dataset_accessor("phasemap")  # type: ignore[no-untyped-call]
class Accessor:
    """Properties that phasemap adds to an image, a sweep, or another Dataset.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever.preset("PPP-NCHR"), pm.Tip("10 nm"), pm.Drive("20 nm"))
    >>> pm.force_curve(pm.Material.preset("PS"), scope, "-2 nm:2 nm:9").phasemap
    <phasemap.groups: 1 over direction, depth>
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def __repr__(self) -> str:
        """Say what there is."""
        return f"<phasemap.groups: {'; '.join(f'{len(names)} over {dims}' for dims, names in self.groups.items())}>"

    @property
    def groups(self) -> dict[str, list[str]]:
        """The variables by what they are given for: those of a sweep for what it saw, every orbit, folds, and jumps."""
        found: dict[str, list[str]] = {}
        for name, one in self._dataset.data_vars.items():
            found.setdefault(", ".join(map(str, one.dims)) or "no dimension", []).append(str(name))
        return found
