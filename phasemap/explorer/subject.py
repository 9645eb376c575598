"""Subject of the page: a sample of a few materials, the microscope that looks at it, and where both came from."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from string import ascii_uppercase
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.errors import InputError, Word
from phasemap._shared.notices import unquestioned
from phasemap.experiment.control import Engage
from phasemap.experiment.labels import Variation
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import materials_of
from phasemap.experiment.microscope import Microscope, Tip
from phasemap.experiment.realism import Realism
from phasemap.experiment.surface import Surface
from phasemap.io.netcdf import load
from phasemap.scenes.scene import Scene, load_scene
from phasemap.scenes.surface import build_surface, dilate, variation_of
from phasemap.solvers.problem import check_setpoint

MOST = 8  # materials, each with three sliders
SIDE = 256  # pixels of the longer side of the image that is solved while a slider moves


class ShownSample(NamedTuple):
    """Material of each pixel, and the relief."""

    labels: NDArray[np.int32]  # shape (ny, nx); number of the material
    topography: NDArray[np.float64] | None  # shape (ny, nx), or None [m]


class Measured(NamedTuple):
    """The image of a microscope that a scene was made of, pixel by pixel of the sample."""

    height: NDArray[np.float64]  # shape (ny, nx), levelled [m]
    phase: NDArray[np.float64]  # shape (ny, nx), with an arbitrary zero [degree]

    def drawn(self, step: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Height [nm] and phase [degree] of every `step`-th pixel."""
        return 1e9 * self.height[::step, ::step], self.phase[::step, ::step]


@dataclass(frozen=True, eq=False)
class Subject:
    """A sample of a few materials under a microscope."""

    name: str  # of the files that are saved
    scope: Microscope
    materials: Mapping[str, Material]  # by name; the labels of the sample count them
    pixel_size: tuple[float, float]  # (dy, dx) [m]
    # What `phasemap.simulate` takes besides, as the scene says; at least setpoint and solver
    options: Mapping[str, Any]
    sample: ShownSample = field(repr=False)
    scene: Scene | None = field(default=None, repr=False)  # where it came from, if that was a scene
    in_python: bool = False  # whether the user's own Python knows its surface and microscope
    measured: Measured | None = field(default=None, repr=False)  # what is to be matched, if there is something
    _dilated: dict[Tip, ShownSample] = field(default_factory=dict, init=False, repr=False)

    @property
    def plain(self) -> bool:
        """True if engaging every pixel from far, with nothing added, is all that the scene asks for."""
        engaged = isinstance(self.options.get("control", Engage()), Engage)
        return engaged and self.realism == Realism() and not self.blurred and self.variation is None

    @property
    def realism(self) -> Realism:
        """Imperfections that the microscope adds to the image."""
        return self.options.get("realism") or Realism()

    @property
    def variation(self) -> Variation | None:
        """Variation of the materials within their domains, which they have not in the page while a slider moves."""
        return None if self.scene is None else variation_of(self.scene.config["surface"])

    @property
    def blurred(self) -> bool:
        """True if the scene asks for edges as wide as the tip, which the page shows sharp while a slider moves."""
        return self.scene is not None and bool(self.scene.config["surface"].get("seen_by_tip"))

    @property
    def strict(self) -> bool:
        """True if numbers outside all practice are errors."""
        return self.scene is not None and bool(self.scene.config["scan"].get("strict_units"))

    @property
    def folder(self) -> Path:
        """Folder where the names of files in the scene start."""
        return _folder_of(self.scene)

    @property
    def step(self) -> int:
        """Spacing of the pixels that are solved while a slider moves."""
        return -(-max(map(int, self.sample.labels.shape)) // SIDE)

    def sample_under(self, tip: Tip) -> ShownSample:
        """The sample as this tip meets it: another one only where the scene asks for a tip of finite size."""
        if self.scene is None or not self.scene.config["surface"].get("dilate") or tip == self.scope.tip:
            return self.sample
        sample = self._dilated.get(tip)
        if sample is None:
            sample = _sample_of(self.scene, tuple(self.materials), tip)
            self._dilated.clear()  # the last one is enough while a slider moves
            self._dilated[tip] = sample
        return sample


def subject_of(
    explored: Surface | Scene | str | os.PathLike[str],
    scope: Microscope | None = None,
    setpoint: float | None = None,
    overrides: Iterable[str] = (),
) -> Subject:
    """Make the subject of a surface, a scene or its file, to which `overrides` belong as in `phasemap.load_scene`.

    A surface needs a scope, and has the setpoint 0.7 to begin with if none is given, a scene its own.
    """
    if isinstance(explored, (str, os.PathLike)):
        explored = load_scene(explored, overrides)
    if isinstance(explored, Scene):
        if scope is not None:
            raise InputError("scope", scope, "nothing beside a scene, which has its own microscope")
        return _of_scene(explored, setpoint)
    if not isinstance(explored, Surface):
        raise InputError("what is explored", type(explored).__name__, "a Surface, a Scene or the file of a scene")
    if not isinstance(scope, Microscope):
        raise InputError("scope", scope, "a Microscope, for a surface has none")
    options = {"setpoint": 0.7 if setpoint is None else check_setpoint(setpoint), "solver": "auto"}
    return _of_surface(explored, scope, options)


@unquestioned()  # its numbers were looked at when the scene was read
def _of_scene(scene: Scene, setpoint: float | None) -> Subject:
    """Subject of a scene."""
    options = {**scene.options, **({} if setpoint is None else {"setpoint": check_setpoint(setpoint)})}
    if scene.config["surface"]["kind"] == "maps":
        hint = "Maps of few materials can be explored in Python: pm.explore(scene.surface, scene.microscope)."
        raise InputError("[surface] kind", "maps", "a kind whose materials have names, to be explored", hint)
    every = {name: Material(**values) for name, values in scene.config["materials"].items()}
    sample = _sample_of(scene, tuple(every), scene.microscope.tip)
    used, labels = np.unique(sample.labels, return_inverse=True)
    names = [list(every)[i] for i in used]
    _check_count(len(names))
    if len(names) < len(every):
        every = {name: every[name] for name in names}
        sample = ShownSample(labels.reshape(sample.labels.shape).astype(np.int32), sample.topography)
    name = scene.source.stem if scene.source is not None else "scene"
    measured = _measured_of(scene, sample.labels.shape)
    return Subject(name, scene.microscope, every, scene.surface.pixel_size, options, sample, scene, measured=measured)


@unquestioned()
def _of_surface(surface: Surface, scope: Microscope, options: Mapping[str, Any]) -> Subject:
    """Subject of a surface and a microscope."""
    if surface.lazy:
        raise InputError("surface", Word("in Dask arrays"), "maps in memory", "Take surface.compute().")
    rows, labels = surface.unique()
    _check_count(len(rows))
    if np.isnan(rows).any():
        raise InputError("surface", Word("without a material in some pixels"), "a material in every pixel")
    found = materials_of(rows, surface.viscosity is not None)
    materials = {f"material {ascii_uppercase[i]}": one for i, one in enumerate(found)}
    sample = ShownSample(labels, surface.topography)
    return Subject("surface", scope, materials, surface.pixel_size, options, sample, in_python=True)


def _measured_of(scene: Scene, shape: tuple[int, ...]) -> Measured | None:
    """The measured image that lies beside the labels in their file, as `phasemap.scene_from` writes it."""
    labels = scene.config["surface"].get("labels")
    named = labels.get("file", "") if isinstance(labels, Mapping) else ""
    path = _folder_of(scene) / named
    if path.suffix != ".nc" or not path.is_file():
        return None
    maps = load(path)
    if not {"phase", "topography"} <= set(maps) or maps["phase"].shape != shape:
        return None
    return Measured(maps["topography"].values, maps["phase"].values)


def _check_count(count: int) -> None:
    """Refuse a sample with more materials than a page has room for."""
    if count > MOST:
        hint = "Maps of many materials have no slider each; take Surface.from_labels or a scene with labels."
        raise InputError("number of materials", count, f"at most {MOST} in what is explored", hint)


@unquestioned()
def _sample_of(scene: Scene, names: tuple[str, ...], tip: Tip) -> ShownSample:
    """Find which material is where: the surface is made of stand-ins, which differ even where the materials do not."""
    stand_ins = {name: Material(modulus=1.0 + i) for i, name in enumerate(names)}
    every = {name: stand_ins.get(name, Material(modulus=1.0)) for name in scene.config["materials"]}
    table = {key: value for key, value in scene.config["surface"].items() if key != "variation"}
    surface = dilate(table, build_surface(dict(table), every, _folder_of(scene)).surface, tip)
    labels = np.round(surface.modulus - 1.0).astype(np.int32)
    labels.setflags(write=False)
    return ShownSample(labels, surface.topography)


def _folder_of(scene: Scene | None) -> Path:
    """Folder where the names of files in a scene start."""
    return scene.source.parent if scene is not None and scene.source is not None else Path()
