"""What is tried: how an input is made, and what takes it. All that may come out is a result or a `PhasemapError`."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from fuzz import calls, mutate, world
from fuzz.writing import written

Input = tuple[Any, ...]


@dataclass(frozen=True)
class Target:
    """Something that takes input from outside.

    Parameters
    ----------
    name : str
    share : float
        Of all inputs of a run.
    make : callable
        An input from random numbers, in a folder that `world.build` filled.
    take : callable
        What phasemap does with it.
    """

    name: str
    share: float
    make: Callable[[Random], Input]
    take: Callable[..., object]


_numbers = itertools.count()


@contextlib.contextmanager
def _file(name: str, data: bytes) -> Iterator[str]:
    """A new file with the suffix of `name`: the library of netCDF may keep one open that it could not read."""
    path = Path(f"spoilt{next(_numbers)}{Path(name).suffix}")
    path.write_bytes(data)
    try:
        yield str(path)
    finally:
        path.unlink()


def _scene(rng: Random) -> Input:
    tables = rng.choice(world.scenes())
    return written(mutate.spoil_tables(rng, tables)).encode("utf-8", "surrogatepass"), []


def _scene_text(rng: Random) -> Input:
    text = written(rng.choice(world.scenes())).encode()
    return mutate.spoil_bytes(
        rng, text, (b"[", b"]", b"{", b'"""', b"'", b"=", b".", b"[[a]]\n", b"\xff", b"[" * 2000)
    ), []


def _overrides(rng: Random) -> Input:
    tables = rng.choice(world.scenes())
    return written(tables).encode(), [mutate.spoil_override(rng, tables) for _ in range(rng.randrange(1, 4))]


def take_scene(text: bytes, overrides: list[str]) -> None:
    """Load what may be a scene or an ensemble, and describe it."""
    from phasemap._shared.errors import PhasemapError
    from phasemap.imaging.simulation import modelled
    from phasemap.scenes.ensemble import is_ensemble, load_ensemble
    from phasemap.scenes.samples import MOST
    from phasemap.scenes.scene import load_scene, load_setup
    from phasemap.scenes.tables import read_tables
    from phasemap.solvers.problem import make_work

    Path("scene.toml").write_bytes(text)
    if is_ensemble("scene.toml", overrides):
        count = read_tables("scene.toml", overrides)["ensemble"]
        if isinstance(count, dict) and isinstance(count.get("count"), int) and 100 < count["count"] <= MOST:
            raise PhasemapError("an ensemble that takes its time")
        ensemble = load_ensemble("scene.toml", overrides)
        ensemble.check()
        scene = ensemble.scene(0)
    else:
        scene = load_scene("scene.toml", overrides)
    load_setup("scene.toml", overrides)
    json.loads(scene.to_json())
    surface, scope = scene.surface, scene.microscope
    materials = surface.unique()[0]
    amplitude = scene.options["setpoint"] * scope.driven_amplitude
    amplitudes = np.full(len(materials), amplitude)
    work = make_work(materials, surface.viscosity is not None, scope, amplitudes, marched=True)
    modelled(work, scope, surface.topography is not None, work.law.memory != 0)
    repr(surface), str(scene.options["control"]), str(scene.options["realism"])


def _command(rng: Random) -> Input:
    text, overrides = rng.choice((_scene, _scene_text, _overrides))(rng)
    return text, [one for one in overrides if "\0" not in one]  # which no shell can pass on


def take_command(text: bytes, overrides: list[str]) -> None:
    """``phasemap validate``: exit code 0, or 2 and one sentence."""
    from phasemap._shared.errors import PhasemapError
    from phasemap.cli import main

    Path("scene.toml").write_bytes(text)
    said, complained = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
        try:
            code = main(["validate", "scene.toml", *overrides])
        except SystemExit as end:  # of argparse
            code = end.code
    complaint = complained.getvalue()
    if code == 0:
        assert said.getvalue().endswith("The scene is valid.\n") and not complaint, (said.getvalue(), complaint)
        return
    assert code == 2 and complaint.startswith("phasemap: ") and complaint.endswith((".\n", "?\n")), (code, complaint)
    lines = complaint.splitlines()  # a sentence for each thing that is wrong
    assert len(complaint) < 20_000 and all(line.startswith("phasemap: ") for line in lines), complaint[:400]
    raise PhasemapError(complaint)


def _map_file(rng: Random) -> Input:
    name = rng.choice(("map.npy", "map.csv", "map.txt", "map.nc", "map3.nc"))
    return (
        name,
        mutate.spoil_bytes(rng, Path(name).read_bytes(), (b"nan", b",", b"1e999", b"(", b"#", b"\xff")),
        rng.random() < 0.5,
    )


def take_map_file(name: str, data: bytes, as_labels: bool) -> None:
    """A file with a map of a scene."""
    from phasemap.scenes.scene import scene_from_tables

    with _file(name, data) as file:
        surface: dict[str, Any] = {"kind": "maps", "modulus": file, "pixel_size": 4e-9, "allow_nan": True}
        if as_labels:
            labels = {"file": file, "variable": "damping"}
            surface = {"kind": "labels", "labels": labels, "materials": ["a", "b"], "pixel_size": 1e-9}
        scene_from_tables({**world.with_materials(), "surface": surface}, Path())


def _numpy(rng: Random) -> np.random.Generator:
    return np.random.default_rng(rng.getrandbits(32))


def _array(rng: Random) -> Any:
    """An array, or what may be taken for one."""
    shape = rng.choice((*[(4, 6)] * 20, (1, 1), (1, 7), (5, 1), (0, 3), (3, 0), (), (4,), (2, 3, 4), (6, 4)))
    values = _numpy(rng).uniform(0.0, rng.choice((0.5, 1.0, 3e9, 1e-8)), shape)
    kind = rng.randrange(0, 12)
    if kind == 0:
        codes = "?bBhHiIlLefdgFDGSUOMmV"
        with contextlib.suppress(ValueError, TypeError), np.errstate(all="ignore"):
            code = rng.choice(codes)
            values = values.real.astype(
                "V8" if code == "V" else "m8[s]" if code == "m" else "M8[s]" if code == "M" else code
            )
    elif kind == 1 and values.size:
        values = np.array(values)
        flat = values.reshape(-1)
        flat[rng.randrange(0, values.size)] = rng.choice((np.nan, np.inf, -np.inf, -1.0, 1e308, -0.0, 5e-324))
    elif kind == 2:
        values = np.asfortranarray(values)
    elif kind == 3:
        values = values[(slice(None, None, -1),) * values.ndim]
    elif kind == 4:
        values = values[(slice(None, None, 2),) * values.ndim]
    elif kind == 5:
        sides = rng.choice(((10**6, 10**6), (10**9, 10**9), (3, 10**7), (10**5, 10**5)))
        part = rng.choice(
            (
                np.float64(1e9),
                np.ones(sides[1] if sides[1] <= 10**6 else 1),
                np.ones((sides[0], 1)) if sides[0] <= 10**6 else np.int8(1),
            )
        )
        values = np.broadcast_to(part, sides)
    elif kind == 6:
        values = np.ma.masked_array(values, mask=values > 0.3)
    elif kind == 7:
        values = values.tolist()
    elif kind == 8:
        return mutate.strange(rng)
    elif kind == 9:
        return rng.choice(
            (
                None,
                [[1.0], [2.0, 3.0]],
                [["a", "b"]],
                [[None]],
                {1: 2},
                {1},
                b"x",
                object,
                iter([1]),
                range(3),
                [[1e9, "x"]],
                np.float64(1e9),
                np.array("x"),
                np.array(None),
                [[10**400]],
                1j,
                _nested(3000),
            )
        )
    if isinstance(values, np.ndarray) and rng.random() < 0.2:
        values.flags.writeable = False
    return values


def _nested(depth: int) -> Any:
    value: Any = 1.0
    for _ in range(depth):
        value = [value]
    return value


def _labels(rng: Random) -> Any:
    kind = rng.randrange(0, 8)
    if kind < 5:
        dtype = rng.choice(("int8", "uint8", "int64", "uint64", "bool", "int32"))
        return _numpy(rng).integers(0, 2, (4, 6)).astype(dtype) * rng.choice((1, 1, 1, 3))
    if kind == 5:
        side = rng.choice((10**5, 10**6, 10**9))
        return np.broadcast_to(np.uint8(1), (side, side))
    return _array(rng)


def _surface(rng: Random) -> Input:
    maps = {
        name: _array(rng)
        for name in ("modulus", "adhesion", "damping", "viscosity", "poisson_ratio", "topography")
        if rng.random() < 0.25
    }
    shape = rng.choice((None, (4, 6), (4, 6), (4, 6), (4, 6), (4, 6), (10**6, 10**6), mutate.strange(rng)))
    size = rng.choice((4e-9, 4e-9, 4e-9, (4e-9, 5e-9), (4e-9, 5e-9), mutate.strange(rng), _array(rng)))
    return (
        {"modulus": rng.choice((1e9, 2e9, _array(rng))), **maps},
        size,
        shape,
        rng.choice((*[True, False] * 6, "yes", [1, 2])),
    )


def take_surface(maps: dict[str, Any], pixel_size: Any, shape: Any, allow_nan: Any) -> None:
    """`Surface` itself, and what can be asked of it."""
    from phasemap.experiment.surface import Surface

    surface = Surface(**maps, pixel_size=pixel_size, shape=shape, allow_nan=allow_nan)
    assert surface.modulus.shape == surface.shape and not surface.modulus.flags.writeable
    if max(surface.shape) <= 10**4:
        repr(surface), surface.unique(), surface.coords()
        assert Surface.from_dataset(surface.to_dataset(), allow_nan=True).shape == surface.shape


def _from_labels(rng: Random) -> Input:
    from phasemap.experiment.material import Material

    good = Material(1e9, adhesion=0.1), Material(3e9, damping=rng.choice((0.0, 0.1))), Material(1e9, viscosity=3.0)
    key = rng.choice((0, 1, 2, True, np.int8(1), 10**30, -1, 1.5, "a", None))
    materials = rng.choice(
        (
            *[{0: good[0], 1: good[1]}] * 9,
            {0: good[0], 1: good[1], 3: good[2]},
            {key: good[0], 1: good[2]},
            {key: 3},
            {},
            None,
            [good[0]],
        )
    )
    return (
        _labels(rng),
        materials,
        rng.choice((*[4e-9] * 5, mutate.strange(rng))),
        rng.choice((None, None, _array(rng))),
    )


def take_from_labels(labels: Any, materials: Any, pixel_size: Any, topography: Any) -> None:
    """`Surface.from_labels`."""
    from phasemap.experiment.surface import Surface

    Surface.from_labels(labels, materials, pixel_size=pixel_size, topography=topography).unique()


def _generated(rng: Random) -> Input:
    from phasemap import generate

    name = rng.choice(generate.__all__)
    good: dict[str, Any] = {
        "shape": (24, 32),
        "pixel_size": 4e-9,
        "period": 40e-9,
        "duty": 0.4,
        "angle": 30.0,
        "side": 9e-9,
        "position": 3e-9,
        "axis": "y",
        "start": 0.0,
        "stop": 1.0,
        "radius": 9e-9,
        "area_fraction": 0.3,
        "spread": 0.2,
        "periodic": False,
        "seed": 3,
        "fraction": 0.4,
        "annealing": 5,
        "spacing": 40e-9,
        "rms": 1e-9,
        "correlation_length": 20e-9,
        "hurst": 0.8,
    }
    known = list(getattr(generate, name).__annotations__)
    arguments = {key: value for key, value in good.items() if key in known}
    for _ in range(rng.choice((1, 1, 2, 3))):
        key = rng.choice(sorted(arguments))
        arguments[key] = rng.choice((mutate.near(rng, arguments[key]),) * 3 + (mutate.strange(rng), _array(rng)))
    return name, arguments


def take_generated(name: str, arguments: dict[str, Any]) -> None:
    """A generator of `phasemap.generate`."""
    from phasemap import generate

    made = getattr(generate, name)(**arguments)
    assert np.isfinite(made).all()


def _dataset(rng: Random) -> Input:
    import xarray as xr

    dims = rng.choice((("y", "x"), ("y", "x"), ("y", "x"), ("x", "y"), ("a", "b"), ("direction", "y", "x")))
    names = [
        name
        for name in ("modulus", "adhesion", "damping", "viscosity", "topography", "height", "phase")
        if rng.random() < 0.8
    ]
    variables, coords = {}, {}
    for name in names:
        values = _array(rng) if rng.random() < 0.3 else _numpy(rng).uniform(0, 1, (4, 6))
        units = rng.choice((None, "Pa", "m", "1", "J m-2", "GPa", "", "µm", "x" * 9999, 3, 1.5, [1.0, 2.0], "degree"))
        attrs = {} if units is None else {"units": units}
        with contextlib.suppress(Exception):  # what xarray itself refuses
            variables[name] = xr.Variable(dims if np.ndim(values) == 2 else dims[: np.ndim(values)], values, attrs)
    for dim, size in (("y", 4), ("x", 6)):
        axis = (np.arange(size) + 0.5) * 4e-9
        odd = (
            axis[::-1],
            axis * np.nan,
            axis.astype(str),
            axis.astype("M8[s]"),
            axis * 0,
            axis + np.inf,
            axis * 1e308,
            axis**2,
            list("abcdef")[:size],
            3.0,
            _array(rng),
        )
        values = axis if rng.random() < 0.6 else rng.choice(odd)
        with contextlib.suppress(Exception), np.errstate(all="ignore"):
            coords[dim] = xr.Variable(
                (dim,) if np.ndim(values) else (), values, {"units": rng.choice(("m", "nm", "s", 3))}
            )
    pool = (
        "{",
        "[]",
        "{}",
        "null",
        '{"microscope": {}}',
        "[" * 5000,
        '{"setpoint": "a"}',
        3,
        "x",
        "1e999",
        "NaN",
        '"a"',
        '{"microscope": {"cantilever": {"stiffness": "x", "resonance_frequency": 0, "quality_factor": -1}, "drive": '
        '{"free_amplitude": [], "frequency": 1e400}}, "setpoint": {}, "control": []}',
    )
    keys = ("configuration", "channels", "other_channels", "source", "nominal", "warnings", "direction", "setpoint")
    attributes = {key: rng.choice(pool) for key in keys if rng.random() < 0.3}
    with contextlib.suppress(Exception):
        return (xr.Dataset(variables, coords, attributes),)
    return (xr.Dataset(attrs=attributes),)


def take_dataset(dataset: Any) -> None:
    """`Surface.from_dataset`, and the same Dataset written and read as an image."""
    from phasemap._shared.errors import PhasemapError
    from phasemap.experiment.surface import Surface
    from phasemap.io.measured import one_scan
    from phasemap.io.read import read_image

    refused = 0
    try:
        Surface.from_dataset(dataset, allow_nan=True)
    except PhasemapError:
        refused += 1
    Path("written.nc").unlink(missing_ok=True)
    if dataset.nbytes > 10**6:
        raise PhasemapError("large")
    try:
        dataset.to_netcdf("written.nc")
    except Exception as error:  # what netCDF itself refuses
        raise PhasemapError("not written") from error
    one_scan(read_image("written.nc"))


def _netcdf(rng: Random) -> Input:
    name = rng.choice(("image.nc", "classic.nc", "samples.nc", "map.nc", "map3.nc"))
    return (mutate.spoil_bytes(rng, Path(name).read_bytes()),)


def take_netcdf(data: bytes) -> None:
    """A netCDF file, for all that reads one."""
    from phasemap._shared.errors import PhasemapError
    from phasemap.experiment.surface import Surface
    from phasemap.io.netcdf import load
    from phasemap.io.read import read_image

    with _file("image.nc", data) as name:
        dataset = load(name)
        for reads in (lambda: read_image(name), lambda: load(name, 1), lambda: Surface.from_dataset(dataset)):
            with contextlib.suppress(PhasemapError):
                reads()


def _measured(*names: str) -> Callable[[Random], Input]:
    def make(rng: Random) -> Input:
        name = rng.choice([name for name in names if os.path.exists(name)])
        return name, mutate.spoil_bytes(rng, Path(name).read_bytes())

    return make


def take_measured(name: str, data: bytes) -> None:
    """A microscope's file."""
    from phasemap.io.measured import one_scan
    from phasemap.io.read import read_image

    with _file(name, data) as file:
        one_scan(read_image(file), ())


def take_backend(name: str, data: bytes) -> None:
    """The same through ``xarray.open_dataset``."""
    import xarray as xr

    with _file(name, data) as file:
        xr.open_dataset(file, engine="phasemap").close()


def _table(rng: Random) -> Input:
    return (mutate.spoil_bytes(rng, Path("runs.csv").read_bytes(), (b",", b'"', b"\0", b"\n", b"scan", b"[" * 3000)),)


def take_table(data: bytes) -> None:
    """The CSV file of an ensemble."""
    from phasemap.scenes.ensemble import load_ensemble

    good = Path("runs.csv").read_bytes()
    Path("runs.csv").write_bytes(data)
    try:
        Path("scene.toml").write_text(written(world.scenes()[-2]), encoding="utf-8")
        load_ensemble("scene.toml").check()
    finally:
        Path("runs.csv").write_bytes(good)


def _parts(rng: Random) -> Input:
    return (mutate.spoil_bytes(rng, Path("part.nc").read_bytes()),)


def take_parts(data: bytes) -> None:
    """A sample of an ensemble that was kept, and damaged since."""
    from phasemap.scenes.ensemble_file import assemble

    keys = [("scan.setpoint", {"units": "1"}, [0.5, 0.6])]
    with _file("part.nc", data) as file:
        assemble(Path("whole.nc"), [Path("part.nc"), Path(file)], keys, {}, True)


def _call(rng: Random) -> Input:
    return rng.choice(calls.grid())


TARGETS = (
    Target("scene", 0.18, _scene, take_scene),
    Target("scene text", 0.2, _scene_text, take_scene),
    Target("overrides", 0.1, _overrides, take_scene),
    Target("command", 0.05, _command, take_command),
    Target("surface", 0.12, _surface, take_surface),
    Target("labels", 0.08, _from_labels, take_from_labels),
    Target("generators", 0.08, _generated, take_generated),
    Target("map files", 0.06, _map_file, take_map_file),
    Target("datasets", 0.03, _dataset, take_dataset),
    Target("netCDF", 0.04, _netcdf, take_netcdf),
    Target("ensemble table", 0.015, _table, take_table),
    Target("ensemble parts", 0.005, _parts, take_parts),
    Target("gwy", 0.01, _measured("image.gwy"), take_measured),
    Target(
        "vendors",
        0.008,
        _measured("image.gsf", "image.nid", "image.stp", "image.001", "image.tiff", "image.jpk", "image.ibw"),
        take_measured,
    ),
    Target("calls", 0.02, _call, calls.take),
    Target("xarray engine", 0.002, _measured("image.gwy", "image.gsf", "image.nc"), take_backend),
)
"""Every one of them."""
