"""``image.phasemap``: what can be done with a Dataset, for those who look for it on the Dataset itself.

xarray knows it as soon as phasemap has made a Dataset or xarray has looked for what can open a file.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from phasemap.validation.checking.result import Check


@xr.register_dataset_accessor("phasemap")  # type: ignore[no-untyped-call]
class Accessor:
    """What can be done with an image, a sweep, or another Dataset of phasemap.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever.preset("PPP-NCHR"), pm.Tip("10 nm"), pm.Drive("20 nm"))
    >>> curve = pm.force_curve(pm.Material.preset("PS"), scope, "-2 nm:2 nm:9")
    >>> curve.phasemap
    <phasemap: plot(), check(), compare(other), export(path), groups of a Dataset: 1 over direction, depth>
    >>> curve.phasemap.groups
    {'direction, depth': ['force']}
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def __repr__(self) -> str:
        """Say what there is."""
        held = "; ".join(f"{len(names)} over {dims}" for dims, names in self.groups.items())
        return f"<phasemap: plot(), check(), compare(other), export(path), groups of a Dataset: {held}>"

    @property
    def groups(self) -> dict[str, list[str]]:
        """The variables by what they are given for: those of a sweep for what it saw, every orbit, folds, and jumps."""
        found: dict[str, list[str]] = {}
        for name, one in self._dataset.data_vars.items():
            found.setdefault(", ".join(map(str, one.dims)) or "no dimension", []).append(str(name))
        return found

    def plot(self, path: str | os.PathLike[str] | None = None, overwrite: bool = False, **options: Any) -> Figure:
        """Draw it, as `phasemap.plot.plot`."""
        import phasemap

        return phasemap.plot.plot(self._dataset, path, overwrite, **options)

    def check(self, *arguments: Any, **options: Any) -> Check:
        """Solve its pixels again, as `phasemap.check`."""
        import phasemap

        return phasemap.check(self._dataset, *arguments, **options)

    def compare(self, simulated: xr.Dataset, **options: Any) -> xr.Dataset:
        """Explain this image by a simulated one, as `phasemap.compare`."""
        import phasemap

        return phasemap.compare(self._dataset, simulated, **options)

    def export(self, path: str | os.PathLike[str], **options: Any) -> Path:
        """Write it for other programs, as `phasemap.export`."""
        import phasemap

        return phasemap.export(self._dataset, path, **options)
