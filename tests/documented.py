"""Variables that docs/reference/files.md lists, against those of a result."""

from __future__ import annotations

import re
from pathlib import Path

import xarray as xr

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "files.md"
NUMBERED = re.compile(r"^(image|labels|x|y)_\d+$")


def check(title: str, ds: xr.Dataset, absent: tuple[str, ...] = ()) -> None:
    """Compare names, dimensions and units; of a number of files, the first stands for all."""
    section = PAGE.read_text(encoding="utf-8").partition(f"## {title}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`.*?) \| (.*?) \| (.*?) \| .* \|$", section, re.MULTILINE)
    said = {name: (dims, unit) for names, dims, unit in rows for name in re.findall(r"`(\w+)`", names)}
    found = {NUMBERED.sub(r"\1_0", str(name)): variable for name, variable in ds.variables.items()}
    assert set(found) == set(said) - set(absent)
    for name, variable in found.items():
        dims, unit = said[name]
        assert {NUMBERED.sub(r"\1_0", str(dim)) for dim in variable.dims} <= set(dims.split(", ")), name
        if unit == "flag":
            assert "flag_meanings" in variable.attrs, name
        elif unit == "text":
            assert variable.dtype.kind in "UO", name
        elif name not in ("y", "x"):  # which are as the images had them
            assert variable.attrs.get("units", "1") == unit, name
