"""The folder in which inputs are tried: good files to spoil, and files that no program should trust."""

from __future__ import annotations

import json
import os
import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from vendor_files import ibw_file, jpk_file, nanoscope_file, park_file

SAMPLES = Path(__file__).parents[2] / "samples"
FOREIGN = {  # units and file names that the samples do not have, for the sake of coverage
    "labels": {"kind": "labels", "labels": [[0, 1, 1], [0, 0, 1]], "materials": ["a", "b"], "pixel_size": 4e-9},
    "maps": {
        "kind": "maps",
        "modulus": "map.npy",
        "adhesion": 0.05,
        "damping": {"file": "map.nc", "variable": "damping"},
        "topography": {"generator": "gradient", "start": 0.0, "stop": 1e-9},
        "pixel_size": [4e-9, 5e-9],
        "shape": [4, 6],
    },
    "file": {"kind": "maps", "file": "map.nc", "allow_nan": True},
    "text": {"kind": "labels", "labels": "map.csv", "materials": {"0": "a", "1": "b"}, "pixel_size": 4e-9},
    "measured": {"kind": "measured", "file": "image.gwy", "materials": ["a", "b"]},
}


@cache
def with_materials() -> dict[str, Any]:
    """The tables of a scene with the materials a and b; its surface is another one's."""
    materials = {"a": {"modulus": 1e9}, "b": {"modulus": 3e9, "damping": 0.01, "adhesion": 0.05}}
    return tomllib.loads((SAMPLES / "step.toml").read_text(encoding="utf-8")) | {"materials": materials}


@cache
def scenes() -> tuple[dict[str, Any], ...]:
    """The sample scenes with few pixels, and a scene for each other kind of surface."""
    every = []
    for path in sorted(SAMPLES.glob("*.toml")):
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        surface = tables["surface"]
        if surface["kind"] == "measured":
            continue  # one with fewer pixels is below
        if "shape" in surface:
            coarser = surface["shape"][0] // 32
            surface["shape"] = [32, 32 * surface["shape"][1] // surface["shape"][0]]
            surface["pixel_size"] *= min(coarser, 4)
            surface.update({key: 90e-9 for key in ("period", "spacing") if key in surface})
            surface.update({key: 10 for key in ("annealing",) if key in surface})
        if "ensemble" in tables:
            tables["ensemble"]["count"] = 3
        every.append(tables)
    base = with_materials()
    every += [base | {"surface": surface} for surface in FOREIGN.values()]
    every.append(every[-5] | {"ensemble": {"table": "runs.csv"}, "control": {"kind": "feedback", "line_rate": 2.0}})
    realism = {"drift": [1e-9, 0.0, 0.0], "bits": 8, "tip_change": {"line": 1, "radius": 3e-8}, "seed": 3}
    more = {"output": {"file": "out.nc", "variables": ["phase"]}, "accuracy": {"phase": 0.1, "height": 1e-11}}
    every.append(every[-5] | {"realism": realism, "control": {"kind": "raster"}, **more})
    return tuple(every)


def build(folder: Path) -> None:
    """Fill the folder."""
    os.chdir(folder)
    rng = np.random.default_rng(1)
    field = rng.uniform(1e9, 3e9, (4, 6))
    np.save("map.npy", field)
    np.savetxt("map.csv", rng.integers(0, 2, (4, 6)), fmt="%d", delimiter=",")
    np.savetxt("map.txt", field)
    Path("runs.csv").write_text("scan.setpoint,materials.a.modulus\n0.5,1e9\n0.7,2e9\n", encoding="utf-8")
    Path("empty.npy").touch()
    os.mkdir("folder.npy")
    os.symlink("loop.npy", "loop.npy")
    os.mkfifo("pipe")
    os.mkfifo("pipe.npy")
    np.save("objects.npy", np.array([[_Trap()]], object), allow_pickle=True)
    _bombs()
    _images()


class _Trap:
    """Leaves a trace where it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("sprung",)


def sprung() -> bool:
    """Whether anything in the folder was executed."""
    return os.path.exists("sprung")


def _bombs() -> None:
    """Files that claim to be larger than they are."""
    import netCDF4

    with open("bomb.npy", "wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)})
        file.write(b"\0" * 80)
    with open("sparse.npy", "wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**5)})
        file.truncate(128 + 8 * 10**11)
    with netCDF4.Dataset("bomb.nc", "w") as ds:
        for name in ("y", "x"):
            ds.createDimension(name, 200_000)
        for name in ("modulus", "height", "phase"):
            ds.createVariable(name, "f8", ("y", "x"), zlib=True, chunksizes=(1000, 1000))


def _images() -> None:
    """An image of two passes, as netCDF of both kinds and as files of other programs."""
    import xarray as xr

    from phasemap.experiment.surface import Surface
    from phasemap.io.export import export
    from phasemap.io.netcdf import save

    rng = np.random.default_rng(2)
    dims = ("direction", "y", "x")
    lever = {"stiffness": 40.0, "resonance_frequency": 3e5, "quality_factor": 400.0}
    configuration = {
        "microscope": {"cantilever": lever, "drive": {"free_amplitude": 2e-8, "frequency": None}},
        "setpoint": 0.7,
        "control": {"kind": "engage"},
    }
    image = xr.Dataset(
        {
            "height": (dims, 1e-9 * rng.normal(size=(2, 4, 6)), {"units": "m"}),
            "phase": (dims, rng.normal(size=(2, 4, 6)), {"units": "degree"}),
            "status": (dims, np.zeros((2, 4, 6), np.int8)),
        },
        {"direction": ["trace", "retrace"], "y": (np.arange(4) + 0.5) * 3e-9, "x": (np.arange(6) + 0.5) * 5e-9},
        {"configuration": json.dumps(configuration), "channels": "{}", "other_channels": "[]", "source": "x"},
    )
    image.to_netcdf("image.nc")
    save(image.isel(direction=0, drop=True).drop_attrs(deep=False).assign_attrs(distinct=3), "part.nc")
    image.drop_vars("direction").to_netcdf("classic.nc", format="NETCDF3_64BIT")
    xr.concat([image, image], "sample").to_netcdf("samples.nc")
    surface = Surface(rng.uniform(1e9, 3e9, (4, 6)), 0.05, 0.01, topography=rng.normal(size=(4, 6)), pixel_size=4e-9)
    surface.to_dataset().to_netcdf("map.nc")
    surface.to_dataset().to_netcdf("map3.nc", format="NETCDF3_CLASSIC")
    large = image.isel(direction=0, y=[0, 1, 2, 3] * 3, x=[0, 1, 2, 3] * 4).assign_coords(
        y=np.arange(0.5, 12) * 1e-9, x=np.arange(0.5, 16) * 1e-9
    )
    export(large, Path("image.gwy"))
    export(large, Path("image.gsf"), "height")
    lines = [
        "WSxM file copyright WSxM solutions",
        "SxM Image file",
        "Image header size: 00000",
        "",
        "[Control]",
        "",
        "    X Amplitude: 600 nm",
        "    Y Amplitude: 200 nm",
        "",
        "[General Info]",
        "",
        "    Head type: Topography",
        "    Image Data Type: double",
        "    Number of columns: 6",
        "    Number of rows: 4",
        "    Z Amplitude: 6 nm",
        "",
        "[Header end]",
        "",
    ]
    header = "\r\n".join(lines)
    nid = find_spec("NSFopen")
    if nid is not None and nid.submodule_search_locations:
        path = Path(nid.submodule_search_locations[0], "example", "Plotting_Data", "MoS2.nid")
        head, mark, _ = path.read_bytes().partition(b"#!")
        head = head.replace(b"Points=512", b"Points=16").replace(b"Lines=256", b"Lines=12")
        Path("image.nid").write_bytes(head + mark + rng.bytes(8 * 16 * 12 * 4))
    nanoscope_file(Path("image.001"), "20.0 nm/V")
    park_file(Path("image.tiff"), "NCM Phase", "NCM")
    jpk_file(Path("image.jpk"))
    ibw_file(Path("image.ibw"))
    Path("image.stp").write_bytes(
        header.replace("00000", f"{len(header):05d}").encode() + rng.normal(size=24).tobytes()
    )
