"""Every public name, called with one argument that is anything but right and the others good.

``python tests/fuzz/run.py --only calls --inputs 20000`` tries them at random; `grid` is all of them in order.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Iterator
from functools import cache, wraps
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from fuzz.world import SAMPLES


class Call(NamedTuple):
    """Something public that can be called.

    Parameters
    ----------
    name : str
    function : callable
    good : dict
        Arguments with which it works, by their names.
    """

    name: str
    function: Callable[..., object]
    good: dict[str, Any]

    @property
    def arguments(self) -> list[str]:
        """The names of all arguments that it has."""
        kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
        named = [name for name, one in inspect.signature(self.function).parameters.items() if one.kind not in kinds]
        return list(dict.fromkeys((*named, *self.good)))


class _Stubborn:
    """Has everything that a number and a sequence have, and raises in all of it."""

    def _raise(self, *_: object) -> Any:
        raise RuntimeError("not today")

    __float__ = __int__ = __index__ = __len__ = __iter__ = __getitem__ = __array__ = __str__ = __repr__ = _raise


_SCAN = [
    "scan.setpoint=0.7", "cantilever.stiffness=40", "cantilever.resonance_frequency=300e3",
    "cantilever.quality_factor=400", "tip.radius=10e-9", "drive.free_amplitude=20e-9",
]  # fmt: skip


def _image() -> xr.Dataset:
    """An image of another program: good for nothing where a number is meant."""
    return xr.Dataset({"height": (("y", "x"), np.eye(2))}, {"y": [0.0, 1e-9], "x": [0.0, 1e-9]})


HOSTILE: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "True": lambda: True,
    "NaN": lambda: np.nan,
    "infinity": lambda: -np.inf,
    "0": lambda: 0,
    "-1": lambda: -1,
    "0.3": lambda: 0.3,
    "1e300": lambda: 1e300,
    "10**30": lambda: 10**30,
    "10**400": lambda: 10**400,
    "complex": lambda: 1j,
    "empty text": lambda: "",
    "text": lambda: "hostile",
    "another unit": lambda: "5 parsecs per second",
    "a range without end": lambda: "0:1:99999999",
    "a null byte": lambda: "a\0b",
    "much text": lambda: "x" * 100_000,
    "bytes": lambda: b"hostile",
    "an empty list": list,
    "a list": lambda: [0.3, 0.4, 0.5],
    "a list of strings": lambda: ["a", "b"],
    "a tuple of None": lambda: (None, None),
    "a list of lists": lambda: [[0.3, 0.4], [0.5, 0.6]],
    "a ragged list": lambda: [[0.3], [0.4, 0.5]],
    "a ragged array": lambda: np.array([np.ones(1), np.ones(2)], object),
    "an array of objects": lambda: np.array([object(), None], object),
    "a scalar array": lambda: np.array(0.3),
    "an empty array": lambda: np.empty((0, 3)),
    "an array": lambda: np.linspace(0.1, 0.9, 12).reshape(3, 4),
    "an array of NaN": lambda: np.full(3, np.nan),
    "a cube": lambda: np.full((2, 2, 2), 0.5),
    "a complex array": lambda: np.array([1j, 2.0]),
    "a masked array": lambda: np.ma.masked_array([0.3, 0.4, 0.5], [False, True, False]),
    "times": lambda: np.array(["2020-01-01", "2021-01-01"], "M8[s]"),
    "a set": lambda: {0.3, 0.4},
    "a dict": lambda: {"a": 0.3},
    "a dict of dicts": lambda: {0: {1: {}}},
    "a generator": lambda: (one for one in (0.3, 0.4)),
    "an iterator without end": lambda: itertools.repeat(0.3),
    "texts without end": lambda: itertools.repeat("phase"),
    "a range": lambda: range(10**12),
    "a Dataset": _image,
    "an empty Dataset": xr.Dataset,
    "a DataArray": lambda: xr.DataArray(np.ones((2, 3)), dims=("a", "b")),
    "a class": lambda: dict,
    "a function": lambda: len,
    "an object": object,
    "an object that raises": _Stubborn,
    "a slice": lambda: slice(None),
}


@cache
def calls(solved: bool = True) -> tuple[Call, ...]:
    """All that is public, or what solves nothing, with arguments that are good."""
    return (*_of_parts(), *(_of_results() if solved else ()))


@cache
def grid(solved: bool = True) -> tuple[tuple[Call, str, str], ...]:
    """Each argument of each call with each hostile value."""
    return tuple((call, argument, value) for call in calls(solved) for argument in call.arguments for value in HOSTILE)


def take(call: Call, argument: str, value: str) -> None:
    """Call it with the hostile value in that argument."""
    call.function(**{**call.good, argument: HOSTILE[value]()})


class _Parts(NamedTuple):
    """What most calls need."""

    scope: Any
    soft: Any
    hard: Any
    surface: Any


def _parts() -> _Parts:
    import phasemap as pm

    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    surface = pm.Surface([[1e9, 3e9], [1e9, 2e9], [3e9, 3e9]], 0.05, 0.01, pixel_size=4e-9)
    return _Parts(scope, pm.Material(1e9, 0.05, 0.01), pm.Material(3e9, 0.02, 0.02), surface)


LABELS = [[0, 1], [1, 1], [0, 0]]


def _of_parts() -> Iterator[Call]:
    """Samples and microscopes."""
    import phasemap as pm

    scope, soft, hard, surface = _parts()
    lever, tip, drive = scope.cantilever, scope.tip, scope.drive
    size = {"shape": (24, 32), "pixel_size": 4e-9}
    values: dict[type, dict[str, Any]] = {
        pm.Accuracy: {}, pm.Cantilever: {"stiffness": 40.0, "resonance_frequency": 3e5, "quality_factor": 400.0},
        pm.Drive: {"free_amplitude": 2e-8}, pm.Engage: {}, pm.Feedback: {}, pm.Interaction: {},
        pm.Material: {"modulus": 1e9}, pm.Microscope: {"cantilever": lever, "tip": tip, "drive": drive},
        pm.Mode: {},
        pm.Eigenmode: {"frequency_ratio": 6.3, "quality_factor": 400.0},
        pm.Raster: {}, pm.Realism: {}, pm.Tip: {"radius": 1e-8}, pm.TipChange: {"line": 1, "radius": 2e-8},
        pm.Surface: {"modulus": [[1e9, 3e9]], "pixel_size": 4e-9}, pm.interaction.Cone: {}, pm.interaction.Film: {},
        pm.interaction.FlatPunch: {}, pm.interaction.MaugisDugdale: {},
        pm.interaction.Neck: {"length": 2e-9},
    }  # fmt: skip
    for cls, good in values.items():
        yield Call(cls.__name__, cls, good)
    yield Call("Cantilever.preset", pm.Cantilever.preset, {"name": "PPP-NCHR", "stiffness": 40.0})
    plate = {"length": 1e-4, "width": 3e-5, "thickness": 1e-6, "modulus": 1.7e11, "density": 2330.0}
    yield Call("Cantilever.rectangular", pm.Cantilever.rectangular, plate)
    wet = pm.Cantilever.preset("AC240TS").in_liquid
    yield Call("Cantilever.in_liquid", wet, {"density": 998.0, "viscosity": 1e-3, "modes": 2})
    yield Call("Material.preset", pm.Material.preset, {"name": "PS", "damping": 0.01})
    yield Call("Feedback.dwell", pm.Feedback().dwell, {"pixels": 64})
    lengths = {
        "blend": {"spacing": 40e-9}, "checkerboard": {"side": 9e-9}, "lamellae": {"period": 40e-9, "annealing": 3},
        "particles": {"radius": 9e-9, "area_fraction": 0.2}, "step": {}, "stripes": {"period": 40e-9},
        "roughness": {"rms": 1e-9, "correlation_length": 20e-9},
    }  # fmt: skip
    for name, good in lengths.items():
        yield Call(f"generate.{name}", getattr(pm.generate, name), {**size, **good})
    yield Call("generate.gradient", pm.generate.gradient, {"shape": (3, 4), "start": 0.0, "stop": 1.0})

    yield Call("Surface.from_labels", pm.Surface.from_labels,
               {"labels": LABELS, "materials": {0: soft, 1: hard}, "pixel_size": 4e-9})  # fmt: skip
    yield Call("Surface.from_dataset", pm.Surface.from_dataset, {"dataset": surface.to_dataset()})
    yield Call("Surface.dilated", surface.dilated, {"tip": tip})
    yield Call("Surface.seen_by", surface.seen_by, {"scope": scope, "setpoint": 0.7})
    yield Call("Surface.rows", surface.rows, {"rows": slice(0, 1)})


def _of_results() -> Iterator[Call]:
    """Images and sweeps, and what is made of them."""
    import phasemap as pm

    scope, soft, hard, surface = _parts()
    image = pm.simulate(surface, scope, 0.7, variables=("height", "phase", "amplitude", "tip_offset", "branch"))
    rng = np.random.default_rng(1)
    wide = pm.Surface(rng.uniform(1e9, 3e9, (12, 16)), 0.05, 0.01, topography=rng.normal(size=(12, 16)) * 1e-9,
                      pixel_size=4e-9)  # fmt: skip
    large, other = (pm.simulate(wide, scope, setpoint, solver="averaging") for setpoint in (0.7, 0.6))
    curve = pm.sweep_setpoint(soft, scope, [0.5, 0.6, 0.7])
    offsets = np.linspace(19e-9, 12e-9, 5)
    distance = pm.sweep_distance(soft, scope, offsets)
    measured = distance.phase.sel(direction="approach").values
    frequencies = np.linspace(299e3, 301e3, 5)
    resonance = pm.sweep_frequency(soft, scope, frequencies, tip_offset=18e-9)
    mapped = pm.contrast(soft, hard, scope, [0.5, 0.6, 0.7], [15e-9, 20e-9], solver="averaging")

    solved = {"scope": scope, "setpoint": 0.7}
    yield Call("simulate", pm.simulate, {"surface": surface, **solved})
    yield Call("sensitivity", pm.sensitivity, {"surface": surface, **solved})
    yield Call("solve_pixel", pm.solve_pixel, {"material": soft, **solved})
    yield Call("orbits", pm.orbits, {"material": soft, **solved})
    with_scope = {"material": soft, "scope": scope}
    yield Call("force_curve", pm.force_curve, with_scope)
    yield Call("sweep_setpoint", pm.sweep_setpoint, {**with_scope, "setpoints": [0.6, 0.7]})
    yield Call("sweep_distance", pm.sweep_distance, {**with_scope, "tip_offsets": offsets})
    yield Call("sweep_frequency", pm.sweep_frequency,
               {**with_scope, "frequencies": frequencies, "tip_offset": 18e-9})  # fmt: skip
    yield Call("sweep_parameter", pm.sweep_parameter,
               {**with_scope, "name": "modulus", "values": [1e9, 2e9], "setpoint": 0.7})  # fmt: skip
    yield Call("contrast", pm.contrast, {"first": soft, "second": hard, "scope": scope, "setpoints": [0.5, 0.6],
                                         "solver": "averaging"})  # fmt: skip
    fitted = {"scope": scope, "start": soft, "parameters": ("modulus",), "starts": 1}
    yield Call("fit_distance", pm.fit_distance,
               {"tip_offsets": offsets, "phase": measured, "phase_error": 0.1, **fitted})  # fmt: skip
    phases = resonance.phase.sel(direction="up").values
    yield Call("fit_frequency", pm.fit_frequency, {"frequencies": frequencies, "phase": phases, "phase_error": 0.1,
                                                   "tip_offset": 18e-9, **fitted})  # fmt: skip
    yield Call("fit_regions", pm.fit_regions, {"images": image, "labels": LABELS, "scope": scope,
                                               "setpoints": 0.7, "phase_zero": 0.0})  # fmt: skip
    yield Call("invert", pm.invert, {"images": image, "scope": scope, "setpoints": 0.7, "phase_zero": 0.0})

    yield Call("channels", pm.channels, {"image": large})
    yield Call("check", pm.check, {"image": image, "surface": surface, "scope": scope, "pixels": 2})
    yield Call("compare", pm.compare, {"measured": large, "simulated": large})
    yield Call("register", pm.register, {"fixed": large, "moving": large})
    yield Call("Registration.apply", pm.register(large, large).apply, {"moving": large})
    yield Call("level", pm.level, {"image": large})
    yield Call("phase_lag", pm.phase_lag, {"phase": large.phase})
    yield Call("to_sidpy", pm.to_sidpy, {"image": image})
    written = {"ds": large, "path": "written.gsf", "overwrite": True}
    yield Call("export to .gwy", pm.export, written | {"path": "written.gwy"})
    yield Call("export", pm.export, written | {"variable": "phase"})
    large.to_netcdf("read.nc")
    yield Call("read_image", pm.read_image, {"path": "read.nc"})
    np.savetxt("curve.txt", np.linspace(1.0, 2.0, 90).reshape(30, 3))
    yield Call("read_curve", pm.read_curve,
               {"path": "curve.txt", "columns": ("z [nm]", "amplitude [nm]", "phase [deg]")})  # fmt: skip
    scene = (SAMPLES / "step.toml").read_text(encoding="utf-8").replace("[128, 256]", "[4, 8]")
    Path("step.toml").write_text(scene, encoding="utf-8")
    varied = "[ensemble]\ncount = 2\n[ensemble.vary]\nscan.setpoint = [0.5, 0.7]\n"
    Path("runs.toml").write_text(f"{scene}\n{varied}", encoding="utf-8")
    yield Call("load_scene", pm.load_scene, {"path": "step.toml"})
    yield Call("load_ensemble", pm.load_ensemble, {"path": "runs.toml"})
    yield Call("scene_from", pm.scene_from, {"image": large, "path": "from.toml", "overwrite": True,
                                             "overrides": _SCAN})  # fmt: skip
    yield Call("series", pm.series, {"files": [large, other], "scope": scope, "setpoints": [0.6, 0.7],
                                     "labels": np.arange(192).reshape(12, 16) % 2, "sign": 1})  # fmt: skip
    drawn = {"image": large, "plot": large, "contrast": mapped, "curve": curve, "comparison": pm.compare(large, large)}
    for name, ds in drawn.items():
        yield Call(f"plot.{name}", _closed(getattr(pm.plot, name)), {"ds": ds, "path": "plot.png", "overwrite": True})


def _closed(draw: Callable[..., Any]) -> Callable[..., None]:
    """The same, but for the figure, which is closed."""

    @wraps(draw)
    def drawn(*given: Any, **named: Any) -> None:
        from matplotlib import pyplot

        try:
            draw(*given, **named)
        finally:
            pyplot.close("all")

    return drawn
