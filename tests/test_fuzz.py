"""Bad input of every kind: a result or one clear sentence comes out, in little time and memory; nothing is executed.

`tests/fuzz/run.py` tries very many of the inputs of which some are tried here; what it found is below, a test each.
"""

from __future__ import annotations

import ast
import json
import os
import pickle
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from inspect import isfunction
from itertools import product
from pathlib import Path
from random import Random
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest
import xarray as xr
from fuzz import calls as public
from fuzz import world
from fuzz.targets import TARGETS, Target
from fuzz.writing import written
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap import generate
from phasemap._shared import memory
from phasemap._shared.errors import FileError, InputError, PhasemapError, TooLargeError
from phasemap.cli import main
from phasemap.experiment.surface import Surface
from phasemap.io.netcdf import load, save
from phasemap.scenes.ensemble import load_ensemble
from phasemap.scenes.ensemble_file import assemble
from phasemap.scenes.scene import load_scene
from phasemap.scenes.tables import read_tables, with_override

PACKAGE = Path(pm.__file__).parent
STEP = world.SAMPLES / "step.toml"
needs_reader = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyddionpy", "gwyddionpy_converter", "gwyfile", "gsffile", "skimage")),
    reason='needs pip install "afm-phasemap[read,gwy]"',
)

pytestmark = pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")  # wild numbers are the point


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    before, where = Path.cwd(), tmp_path_factory.mktemp("world")
    world.build(where)
    yield where
    os.chdir(before)


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEMAP_MEMORY", "64e6")


# Some of what `tests/fuzz/run.py` tries.


@needs_reader
@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
@pytest.mark.usefixtures("folder", "little")
@settings(max_examples=10, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(st.randoms(use_true_random=False))
def test_bad_input_gives_a_result_or_one_sentence(target: Target, rng: Random) -> None:
    made = target.make(rng)
    with suppress(PhasemapError):
        target.take(*made)
    assert not world.sprung()


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize("call", public.calls(solved=False), ids=lambda call: call.name)
def test_any_argument_that_is_anything_gives_a_result_or_one_sentence(call: public.Call) -> None:
    for argument, value in product(call.arguments, public.HOSTILE):
        with suppress(PhasemapError):
            public.take(call, argument, value)


@pytest.mark.parametrize("owner", [pm, pm.generate, pm.plot], ids=lambda owner: owner.__name__)
def test_every_public_function_looks_at_its_arguments_first(owner: ModuleType) -> None:
    functions = [found for name in owner.__all__ if isfunction(found := getattr(owner, name))]
    assert [one.__name__ for one in functions if not hasattr(one, "__wrapped__")] == []


@needs_reader
@pytest.mark.usefixtures("folder")
def test_what_is_spoilt_was_good() -> None:
    for tables in world.scenes():
        take = next(target.take for target in TARGETS if target.name == "scene")
        take(written(tables).encode(), [])
    for name in ("image.nc", "classic.nc", "image.gwy", "image.gsf", "image.stp"):
        assert "height" in pm.read_image(name)


# Scene files.


def scene(where: Path, text: str | bytes, *overrides: str) -> Any:
    path = where / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_scene(path, overrides)


@pytest.mark.parametrize("name", ["pipe", "folder.npy", "/dev/zero", "loop.npy", "a\0b", "x" * 5000])
def test_a_scene_is_a_file(folder: Path, name: str) -> None:
    with pytest.raises(FileError, match="cannot read the scene"):
        load_scene(folder / name)


def test_a_scene_that_is_nested_too_deeply_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="not valid TOML: arrays or tables are nested too deeply"):
        scene(tmp_path, "a = " + "[" * 3000 + "]" * 3000)


@pytest.mark.parametrize("part", ["a", '"a b"', "a ", "'.'"])
def test_a_key_of_thousands_of_parts_is_refused_before_it_is_parsed(tmp_path: Path, part: str) -> None:
    with pytest.raises(FileError, match="a key has more than 64 parts"):  # tomllib would take minutes
        scene(tmp_path, ".".join([part] * 100_000) + " = 1")


def test_a_scene_without_end_is_refused_before_it_is_read(tmp_path: Path) -> None:
    with (tmp_path / "scene.toml").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(FileError, match="it has 1099511627776 bytes, 4194304 are allowed"):
        load_scene(tmp_path / "scene.toml")


def test_an_error_repeats_no_more_than_fits_a_screen(tmp_path: Path) -> None:
    for radius in (
        "0x" + "f" * 5000,
        "9" * 4000,
        "'" + "x" * 10_000 + "'",
        "{" + "a." * 60 + "a = 1}",
        "[" * 150 + "]" * 150,
    ):
        with pytest.raises(
            InputError, match=r"\[tip\] radius is .*; allowed: .* above 0 and at most 1 m.*\.$"
        ) as caught:
            scene(tmp_path, STEP.read_text().replace("radius = 10e-9", f"radius = {radius}"))
        assert len(str(caught.value)) < 500
    with pytest.raises(FileError, match="4300 digits"):
        scene(tmp_path, STEP.read_text().replace("radius = 10e-9", "radius = " + "9" * 5000))


def test_an_error_is_one_line_whatever_it_repeats(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        scene(tmp_path, STEP.read_text() + '\n["a\\nb\\u001b[31m"]\n')
    assert str(caught.value).isprintable()


def test_an_override_that_is_nested_too_deeply_is_text() -> None:
    assert with_override({}, "tip.radius=" + "[" * 5000)["tip"]["radius"] == "[" * 5000


def test_an_override_that_is_no_text_is_refused() -> None:
    with pytest.raises(InputError, match=r"override is 'surface\.file=.udc80'; allowed: table\.key=value"):
        with_override({}, "surface.file=\udc80")  # could not be kept in a result


def test_keys_of_an_ensemble_nested_too_deeply_are_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        STEP.read_text() + "[ensemble]\ncount = 1\n[ensemble.vary" + ".a" * 60 + "]\nb = [1]\n"
    )
    with pytest.raises(InputError, match=r"key of \[ensemble.vary\] is 'a.a"):
        load_ensemble(tmp_path / "scene.toml")


def test_an_ensemble_has_an_end(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        STEP.read_text() + "[ensemble]\ncount = 10000000000\nvary.scan.setpoint = [0.5]\n"
    )
    with pytest.raises(InputError, match=r"count is 10000000000; allowed: a whole number from 1 to 1000000"):
        load_ensemble(tmp_path / "scene.toml")


@pytest.mark.parametrize("name", ["pipe", "/dev/zero", "folder.npy"])
def test_the_table_of_an_ensemble_is_a_file(folder: Path, name: str) -> None:
    (folder / "table.toml").write_text(STEP.read_text() + f'[ensemble]\ntable = "{name}"\n')
    with pytest.raises(FileError, match=r"named in \[ensemble\] table: it is a folder, a device or a pipe"):
        load_ensemble(folder / "table.toml")


@contextmanager
def damaged_or_none(part: Path) -> Iterator[None]:
    """What is raised, if anything, says that this part is damaged, or does not fit on the others."""
    try:
        yield
    except InputError as error:
        assert "in sample 1" in error.name  # noqa: PT017
    except PhasemapError as error:
        assert str(error) == f"the sample in {part} is damaged; remove this file and run again."  # noqa: PT017


def test_a_damaged_sample_is_told_from_a_full_disk(folder: Path) -> None:
    whole = Path("part.nc").read_bytes()
    for byte in range(3000, len(whole), 497):
        damaged = Path(f"damaged{byte}.nc")  # the library may keep one open that it could not read
        damaged.write_bytes(whole[:byte] + bytes([whole[byte] ^ 255]) + whole[byte + 1 :])
        with damaged_or_none(damaged):
            assemble(Path("all.nc"), [Path("part.nc"), damaged], [], {}, True)


# Maps of a scene.


def with_map(name: str) -> None:
    from phasemap.scenes.scene import scene_from_tables

    surface = {"kind": "maps", "modulus": name, "pixel_size": 1e-9}
    scene_from_tables(world.with_materials() | {"surface": surface}, Path())


@pytest.mark.usefixtures("folder", "little")
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("pipe.npy", "it is a folder, a device or a pipe"),  # it would be waited for
        ("/dev/zero", "it is a folder, a device or a pipe"),  # it has no end
        ("folder.npy", "it is a folder, a device or a pipe"),
        ("loop.npy", "symbolic links"),
        ("sparse.npy", "needs 800 GB of memory, and 64 MB are free"),
        ("bomb.npy", "allocate|reshape"),  # 8 TB are declared, 80 bytes there
        ("bomb.nc", "needs 960 GB of memory, and 64 MB are free"),  # declared, and never written
        ("objects.npy", "Object arrays"),
        ("zip.npy", "an archive, not an array"),
        ("pickle.npy", "pickle"),
        ("header.npy", "header|EOF|unterminated|closed"),
        ("a\0b.npy", "null byte"),
        ("/proc/self/cmdline", "longer than its size says"),  # as other files of the system, some of which do not end
        ("package:__main__/x.npy", "not installed"),
    ],
)  # fmt: skip
def test_a_map_that_cannot_be_is_refused_before_it_is_read(name: str, reason: str) -> None:
    with zipfile.ZipFile("zip.npy", "w") as archive:
        archive.writestr("x.npy", b"")
    Path("pickle.npy").write_bytes(pickle.dumps(world._Trap()))
    Path("header.npy").write_bytes(Path("map.npy").read_bytes().replace(b"(4, 6)", b"(4, 6("))
    with pytest.raises((FileError, TooLargeError), match=reason):
        with_map(name)
    assert not world.sprung()


def test_labels_without_end_are_no_whole_numbers(folder: Path) -> None:
    np.save("infinite.npy", np.array([[np.inf, 0.0], [1e300, 1.0]]))
    surface = {"kind": "labels", "labels": "infinite.npy", "materials": ["a", "b"], "pixel_size": 1e-9}
    (folder / "scene.toml").write_text(written(world.with_materials() | {"surface": surface}))
    with pytest.raises(InputError, match="type of labels is 'float64'; allowed: whole numbers"):
        load_scene("scene.toml")


@pytest.mark.parametrize(
    "relief", ["[1, 2, 3]", "[['a']]", "[[1e-9, 2e-9]]", "1979-05-27", "true", "[[0.0], [1.0, 2.0]]"]
)
def test_a_relief_to_which_heights_cannot_be_added_is_refused(relief: str) -> None:
    with pytest.raises(InputError, match=r"\[surface\] topography is .*; allowed: one number or a"):
        load_scene(STEP, [f"surface.topography={relief}"])
    assert load_scene(STEP, ["surface.topography=2e-9"]).surface.topography.max() == 7e-9


# Memory.


@pytest.mark.parametrize("name", generate.__all__)
def test_a_generator_says_how_much_memory_there_is_not(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEMAP_MEMORY", "21e9")
    more: dict[str, dict[str, Any]] = {
        "stripes": {"period": 1e-7},
        "checkerboard": {"side": 1e-7},
        "gradient": {"start": 0.0, "stop": 1.0},
        "step": {},
        "particles": {"radius": 1e-8, "area_fraction": 0.1},
        "lamellae": {"period": 1e-7},
        "blend": {"spacing": 1e-7},
        "roughness": {"rms": 1e-9, "correlation_length": 1e-7},
    }
    pixels = {} if name == "gradient" else {"pixel_size": 4e-9}
    with pytest.raises(
        TooLargeError, match=r"to generate 200000 x 200000 pixels needs .* and 21 GB are free\. Take fewer"
    ):
        getattr(generate, name)((200_000, 200_000), **pixels, **more[name])


def test_what_is_asked_for_is_held_against_memory_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEMAP_MEMORY", "2e9")
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    soft, many = pm.Material(1e9), np.linspace(10e-9, 20e-9, 100_000)
    with pytest.raises(TooLargeError, match=r"a contrast map of 1 x 100000 x 100000 points needs .* and 2 GB are free"):
        pm.contrast(soft, soft, scope, np.linspace(0.3, 0.9, 100_000), many)
    edge = Surface([[1e9, 3e9]], pixel_size=4e-9)
    with pytest.raises(TooLargeError, match=r"to see edges with a disc of radius 3\.16 m needs .* and 2 GB are free"):
        edge.seen_by(scope, 0.7, depth=1e9)
    with pytest.raises(TooLargeError, match="setpoints needs 8 TB of memory, and 2 GB are free"):
        pm.sweep_setpoint(soft, scope, range(10**12))


def test_discs_take_memory_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEMAP_MEMORY", "20e6")
    with pytest.raises(
        TooLargeError, match=r"an image of 1\.59e\+05 discs needs 47\.7 MB of memory, and 20 MB are free"
    ):
        generate.particles((1000, 1000), 1e-9, radius=1e-9, area_fraction=0.5)


def test_an_image_says_how_much_memory_there_is_not(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    surface = Surface(modulus=1e9, pixel_size=4e-9, shape=(200_000, 200_000))  # which takes the memory of one number
    monkeypatch.setenv("PHASEMAP_MEMORY", "21e9")
    # 13 variables of 8 bytes and 4 of 1 byte
    with pytest.raises(TooLargeError, match=r"an image of 200000 x 200000 pixels with 17 variables needs 4\.32 TB"):
        pm.simulate(surface, scope, 0.7)
    with pytest.raises(TooLargeError, match=r"2 variables in 2 directions needs 720 GB"):
        pm.simulate(surface, scope, 0.7, control=pm.Raster(), variables=["phase"])
    (tmp_path / "scene.toml").write_text(
        written(
            {
                **world.with_materials(),
                "surface": {"kind": "maps", "modulus": 1e9, "shape": [10**6] * 2, "pixel_size": 1e-9},
            }
        )
    )
    assert main(["validate", str(tmp_path / "scene.toml")]) == 2


def test_memory_is_told_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEMAP_MEMORY", "3e9")
    assert memory.available() == 3e9
    for wrong in ("much", "-1", "nan", ""):
        monkeypatch.setenv("PHASEMAP_MEMORY", wrong)
        with pytest.raises(
            InputError, match=r"the environment variable PHASEMAP_MEMORY is .*; allowed: a number of bytes"
        ):
            memory.available()


@pytest.mark.parametrize(
    ("files", "free"),
    [
        ({"/proc/self/cgroup": "0::/job\n", "job/memory.max": "4000\n", "job/memory.current": "1500\n"}, 2500),
        (
            {
                "/proc/self/cgroup": "0::/a/b\n",
                "a/memory.max": "900\n",
                "a/memory.current": "500\n",
                "a/b/memory.max": "max\n",
                "a/b/memory.current": "1\n",
            },
            400,
        ),
        (
            {
                "/proc/self/cgroup": "0::/\n",
                "memory.max": "900\n",
                "memory.current": "800\n",
                "memory.stat": "anon 100\ninactive_file 600\n",
            },
            700,
        ),
        (
            {
                "/proc/self/cgroup": "3:memory:/j\n1:cpu:/j\n",
                "memory/j/memory.limit_in_bytes": "5\n",
                "memory/j/memory.usage_in_bytes": "3\n",
            },
            2,
        ),
        ({}, 7 * 1024),
    ],
    ids=["group", "group in a group", "cache", "version 1", "machine"],
)
def test_the_least_limit_holds(files: dict[str, str], free: int, monkeypatch: pytest.MonkeyPatch) -> None:
    known = {str(memory.GROUPS / name): text for name, text in files.items()}  # an absolute name stays as it is
    monkeypatch.delenv("PHASEMAP_MEMORY", raising=False)
    monkeypatch.setattr(memory, "_text", lambda path: known.get(str(path), ""))
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=7 * 1024))
    assert memory.available() == free


# Surfaces.


@pytest.mark.usefixtures("little")
def test_a_view_of_a_number_takes_the_memory_of_a_number() -> None:
    wide = np.broadcast_to(np.float64(1e9), (10**6, 10**6))
    assert Surface(wide, pixel_size=1e-9).shape == (10**6, 10**6)
    for part in (np.ones((10**6, 1)), np.ones(10**6)):
        with pytest.raises(
            TooLargeError, match="modulus with 1000000 x 1000000 pixels needs 8 TB of memory, and 64 MB"
        ):
            Surface(np.broadcast_to(part, wide.shape), pixel_size=1e-9)
    with pytest.raises(TooLargeError, match="labels with 1000000 x 1000000 pixels needs 36 TB"):
        Surface.from_labels(np.broadcast_to(np.uint8(0), wide.shape), {0: pm.Material(1e9)}, pixel_size=1e-9)


@pytest.mark.parametrize("shape", [(10**9, 1), (10**30, 10**30)])
def test_a_side_has_at_most_a_hundred_million_pixels(shape: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=r"number of rows is 10+; allowed: a whole number from 1 to 100000000"):
        Surface(1e9, pixel_size=1e-9, shape=shape)


class Hostile:
    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise KeyError("mine")


@pytest.mark.parametrize(
    "value",
    [Hostile(), np.ma.masked_array([["a"]]), np.ma.masked_array([[None]]), [[1.0], [2.0, 3.0]], [[[[1]]]], 1j, {}],
)
def test_what_is_no_map_is_refused(value: Any) -> None:
    with pytest.raises(InputError):
        Surface(value, pixel_size=1e-9)


@pytest.mark.parametrize("name", ["modulus", "adhesion", "poisson_ratio"])
def test_a_map_that_is_needed_is_not_none(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is None; allowed: one number or a 2-D map"):
        Surface(**{"modulus": 1e9, name: None}, pixel_size=1e-9, shape=(2, 2))


def test_the_shape_of_a_generated_field_is_said_once(tmp_path: Path) -> None:
    field = "topography = { generator = 'roughness', rms = 1e-9, correlation_length = 3e-8, shape = [2, 2] }"
    with pytest.raises(
        InputError, match=r"\[surface.topography\] shape is \[2, 2\]; allowed: nothing, for it is that of"
    ):
        scene(tmp_path, STEP.read_text().replace("heights = [0.0, 5e-9]", field))


@pytest.mark.parametrize(
    ("override", "name"),
    [
        ("surface.pixel_size=1e200", "pixel_size"),
        ("drive.frequency=1e300", "drive frequency over resonance frequency"),
        ("tip.radius=1e300", "radius"),
        ("interaction.bias=1e200", "bias"),
        ("interaction.damping_exponent=1e5", "damping_exponent"),
        ("surface.seed=0x" + "f" * 5000, "seed"),
    ],
)
def test_a_number_whose_powers_are_infinite_is_refused(override: str, name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is .*; allowed: "):
        load_scene(world.SAMPLES / "blend.toml", [override])


@pytest.mark.parametrize("value", ["yes", [1, 2], np.array([True, False]), None])
def test_allow_nan_is_true_or_false(value: Any) -> None:
    with pytest.raises(InputError, match=r"allow_nan is .*; allowed: True or False"):
        Surface(1e9, pixel_size=1e-9, shape=(2, 2), allow_nan=value)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("step", {"axis": ["x"]}),
        ("step", {"axis": np.array(["x", "y"])}),
        ("particles", {"radius": 9e-9, "area_fraction": 0.3, "periodic": np.zeros((3, 0))}),
        ("lamellae", {"period": 40e-9, "annealing": 10**9}),  # hours
    ],
)
def test_a_generator_refuses_what_it_cannot_use(name: str, arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"axis|periodic|annealing"):
        getattr(generate, name)((64, 64), 4e-9, **arguments)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"y": list("ab")}, "coordinate y is '2 values of type .*'; allowed: positions of the pixel centres"),
        (
            {"x": np.array(["2000-01-01", "2000-01-02", "2000-01-03"], "M8[ns]")},
            "coordinate x is '3 values of type datetime64",
        ),
        ({"modulus": (("y", "x"), np.full((2, 3), {}), {"units": "GPa"})}, "type of modulus is 'object'"),
        ({"modulus": (("y", "x"), np.full((2, 3), 1e308), {"units": "GPa"})}, "modulus is inf"),
        ({"adhesion": ((), "soft", {"units": "mN/m"})}, "adhesion is 'soft'"),
    ],
)
def test_a_dataset_of_something_else_is_refused(change: dict[str, Any], reason: str) -> None:
    good = Surface(1e9, 0.05, pixel_size=1e-9, shape=(2, 3)).to_dataset()
    with pytest.raises(InputError, match=reason):
        Surface.from_dataset(
            good.assign(change) if "modulus" in change or "adhesion" in change else good.assign_coords(change)
        )


def test_one_number_in_a_dataset_may_have_a_prefix() -> None:
    good = Surface(1e9, 0.05, pixel_size=1e-9, shape=(2, 3)).to_dataset()
    assert Surface.from_dataset(good.assign(adhesion=((), 50.0, {"units": "mN/m"}))).adhesion[0, 0] == 0.05


def test_a_disc_is_not_without_end() -> None:
    with pytest.raises(InputError, match=r"radius is 1e\+308; allowed: a finite number of at most 1e\+100 m"):
        generate.particles((24, 32), 4e-9, radius=1e308, area_fraction=0.3)


# Files of data.


@pytest.mark.usefixtures("folder", "little")
def test_a_file_that_declares_more_than_fits_is_refused() -> None:
    for read in (load, pm.read_image):
        with pytest.raises(TooLargeError, match=r"to read bomb.nc needs 960 GB of memory, and 64 MB are free"):
            read("bomb.nc")


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", "{}", "[" * 5000, '{"microscope": {"cantilever": 3}}', '"' + "a" * 9999]
)
def test_a_configuration_that_phasemap_did_not_write_is_passed_over(tmp_path: Path, text: str) -> None:
    image = xr.Dataset(
        {"height": (("y", "x"), np.zeros((2, 2)), {"units": "m"})},
        {dim: (dim, [1e-9, 3e-9], {"units": "m"}) for dim in ("y", "x")},
        {"configuration": text},
    )
    assert "stiffness" not in pm.read_image(save(image, tmp_path / "image.nc")).attrs


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", ["classic.nc", "map3.nc"])
def test_a_wrong_count_in_a_classic_file_does_not_keep_its_library_busy(name: str) -> None:
    good = Path(name).read_bytes()
    words = [int.from_bytes(good[at : at + 4], "big") for at in range(0, 400, 4)]
    counts = [4 * at for at in range(1, 99) if words[at] in (10, 11, 12) and words[at + 1] < 99]
    assert counts  # tags, a count behind each
    for at in counts:
        Path("count.nc").write_bytes(good[: at + 4] + b"\x7f" + good[at + 5 :])
        with pytest.raises(FileError, match=r"cannot read count\.nc: it is not a netCDF file, or it is damaged"):
            load("count.nc")  # the library alone takes 2 GB and 5 s


@pytest.mark.parametrize(
    "form", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA", "NETCDF4", "NETCDF4_CLASSIC"]
)
def test_a_netcdf_file_of_every_kind_is_read(tmp_path: Path, form: str) -> None:
    netCDF4 = pytest.importorskip("netCDF4")
    with netCDF4.Dataset(tmp_path / "maps.nc", "w", format=form) as file:
        file.setncatts({"title": "odd", "numbers": np.arange(3, dtype=np.int32)})
        for dim, count in (("y", 3), ("x", 5)):
            file.createDimension(dim, count)
            file.createVariable(dim, "f8", (dim,))[:] = (np.arange(count) + 0.5) * 4e-9
        for name, value in (("modulus", 1e9), ("adhesion", 0.05)):
            file.createVariable(name, "f8", ("y", "x"))[:] = value
    assert Surface.from_dataset(load(tmp_path / "maps.nc")) == Surface(1e9, 0.05, pixel_size=4e-9, shape=(3, 5))


@pytest.mark.parametrize(
    "attributes",
    [{"configuration": "{"}, {"configuration": "[]"}, {"configuration": '{"setpoint": "a"}'}, {"title": 3}],
)
@pytest.mark.parametrize("dims", [("y", "x"), ("tip_offset",), ("direction", "tip_offset"), ("a", "b", "c"), ()])
def test_a_file_that_phasemap_did_not_write_is_drawn_or_refused(
    tmp_path: Path, attributes: dict[str, Any], dims: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    values = (dims, np.ones((2, 3, 4)[: len(dims)]))
    save(xr.Dataset({"height": values, "phase": values, "status": values}, attrs=attributes), tmp_path / "odd.nc")
    if main(["plot", str(tmp_path / "odd.nc")]):
        complaint = capsys.readouterr().err
        assert complaint.startswith("phasemap: ") and complaint.count("\n") == 1


@needs_reader
@pytest.mark.parametrize("magic", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0", b"GIF89a"])
def test_a_picture_is_refused_before_it_is_unpacked(tmp_path: Path, magic: bytes) -> None:
    (tmp_path / "scan.spm").write_bytes(
        magic + b"\0" * 99
    )  # a real one of 388 kB takes the converter 6 GB and a minute
    with pytest.raises(FileError, match=r"scan\.spm: it is a picture, which has no units"):
        pm.read_image(tmp_path / "scan.spm")


@needs_reader
@pytest.mark.usefixtures("folder")
def test_a_container_with_a_wrong_length_does_not_keep_its_reader_busy() -> None:
    good = Path("image.gwy").read_bytes()
    at = good.index(b"/0/data\0o") + len(b"/0/data\0o")
    endless = good[:at] + b"x\0\x08\0\0\0t\0S\xff\xff\xff\xff" + good[at:]  # 4294967295 strings of no length
    nested = b""
    for _ in range(200):
        nested = b"a\0oGwyContainer\0" + len(nested).to_bytes(4, "little") + nested
    nested = b"GWYPGwyContainer\0" + len(nested).to_bytes(4, "little") + nested
    for wrong in (endless, nested, *(good[:end] for end in range(0, len(good), len(good) // 6))):
        Path("wrong.gwy").write_bytes(wrong)
        with pytest.raises(FileError, match=r"cannot (read|use) wrong\.gwy: it (is empty|is damaged|holds no image)"):
            pm.read_image("wrong.gwy")


# Nothing that is read is executed.


@cache
def nodes() -> tuple[tuple[Path, ast.AST], ...]:
    """Every node of the package's source that calls or imports."""
    kinds = (ast.Call, ast.Import, ast.ImportFrom)
    trees = [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in PACKAGE.rglob("*.py")]
    return tuple((path, node) for path, tree in trees for node in ast.walk(tree) if isinstance(node, kinds))


@cache
def calls() -> tuple[tuple[Path, str, ast.Call], ...]:
    """Every call of something with a name, and this name."""
    return tuple(
        (path, ast.unparse(node.func), node)
        for path, node in nodes()
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute)
    )


def test_nothing_in_the_package_can_execute_data() -> None:
    names = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "yaml", "jsonpickle"}
    compiled = "disk_cache.py"  # code in a folder where nobody else may write: as safe as the package itself
    for path, node in nodes():
        modules = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert path.name == compiled or not names & {module.partition(".")[0] for module in modules}, path
    for path, name, _ in calls():
        if path.name == compiled and name == "pickle.loads":
            continue
        assert name not in ("eval", "exec", "compile", "__import__", "os.system", "os.popen"), path
        assert not name.endswith((".loads", ".load_module")) or name in ("json.loads", "tomllib.loads"), (path, name)


def test_numpy_is_never_allowed_to_unpickle() -> None:
    for path, name, call in calls():
        if name in ("np.load", "numpy.load", "np.lib.format.read_array"):
            given = {one.arg: ast.unparse(one.value) for one in call.keywords}
            assert given.get("allow_pickle") == "False", path


def test_only_names_in_the_source_are_imported() -> None:
    """Modules by name: what is installed besides (`extra`) and, lazily, the package's own."""
    allowed = {"__init__.py", "io/gwyddion.py", "imaging/job.py", "comparison/scores.py"}
    allowed.add("_kernels/compilation/library.py")  # classes that a wheel's own index names beside its machine code
    for path, name, call in calls():
        if name in ("import_module", "importlib.import_module"):
            told = call.args[0]
            literal = isinstance(told, ast.Constant)
            assert literal or path.relative_to(PACKAGE).as_posix() in allowed, path
    for name in ("os.system", "phasemap.cli:main", "__import__('os').system('false')", "builtins.exec"):
        for key in (
            "scan.solver",
            "interaction.contact",
            "surface.kind",
            "control.kind",
            "surface.topography.generator",
        ):
            with pytest.raises(PhasemapError):
                load_scene(STEP, [f"{key}={name}"])


def test_an_installed_package_that_a_scene_names_is_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "trap").mkdir()
    (tmp_path / "trap" / "__init__.py").write_text("raise SystemExit")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(FileError, match="No such file"):
        scene(tmp_path, STEP.read_text().replace("heights = [0.0, 5e-9]", 'topography = "package:trap/x.npy"'))


def test_what_is_kept_in_a_file_is_json(folder: Path) -> None:
    tables = read_tables(STEP)
    assert json.loads(load_scene(STEP).to_json())["scan"]["setpoint"] == tables["scan"]["setpoint"]


# Found by a later seed


def test_a_relief_higher_than_numbers_is_refused() -> None:
    with pytest.raises(pm.InputError, match=r"rms is 1\.78"):
        pm.generate.roughness((8, 8), pixel_size=4e-9, rms=1.7e308 * 1.05, correlation_length=2e-8)


def test_a_channel_has_a_name() -> None:
    with pytest.raises(
        pm.InputError, match="phase is a int too large to be shown; allowed: the name of a channel, or None"
    ):
        pm.read_image("image.gwy", phase=10**5000)


def test_phases_at_the_end_of_numbers_overflow_nothing() -> None:
    from phasemap.io.measured import on_one_turn

    phases = np.array([-1.7e308, 1.7e308])
    assert np.array_equal(on_one_turn(phases), phases)
