"""Surfaces in Dask arrays: the same bits as in memory, block by block, on clusters and beyond the memory."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
import dask.array as da
import numpy as np
import pytest
import xarray as xr
from distributed import Client, LocalCluster
from hypothesis import given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap.experiment.surface_maps import QUANTITIES
from phasemap.imaging import dask as blocks
from phasemap.imaging import engaged, raster
from phasemap.imaging.interpolation import atlas
from phasemap.imaging.materials import Window, survey

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
SOFT, HARD = pm.Material(0.5e9, adhesion=0.1, damping=0.1), pm.Material(3e9, adhesion=0.15, damping=0.005)
SHAPE = (11, 14)
ENGAGE = pm.Engage()
QUICK = pm.Feedback(line_rate=100.0, engage="image")  # 93 periods over each of 14 pixels
NOISY = pm.Realism(temperature=295.0, detector_noise=1e-13)
CONTROLS = {
    "engage": (ENGAGE, None),
    "raster line": (pm.Raster(engage="line"), None),
    "raster image": (pm.Raster(engage="image"), None),
    "feedback line": (pm.Feedback(line_rate=100.0, engage="line"), NOISY),
    "feedback image": (QUICK, NOISY),
    "changed tip": (pm.Raster(engage="image"), pm.Realism(tip_change=pm.TipChange(4, 14e-9), line_offset=1e-10)),
    "changed tip in time": (QUICK, pm.Realism(temperature=295.0, tip_change=pm.TipChange(4, 14e-9))),
}

pytestmark = pytest.mark.filterwarnings(
    "ignore:Consolidated metadata is currently not part in the Zarr format 3:UserWarning",  # of every to_zarr
    "ignore:The data type .FixedLengthUTF32:FutureWarning",  # of text, such as the names of the directions
)


def few(shape: tuple[int, int] = SHAPE, seed: int = 0) -> pm.Surface:
    """Some materials, some relief; adhesion is the same everywhere."""
    rng = np.random.default_rng(seed)
    modulus, damping = rng.choice([0.5e9, 1e9, 3e9], shape), rng.choice([0.1, 0.005], shape)
    return pm.Surface(modulus, 0.12, damping, topography=rng.uniform(0, 1e-9, shape), pixel_size=4e-9)


def lazily(surface: pm.Surface, chunks: Any) -> pm.Surface:
    """The same surface in Dask arrays; what is the same everywhere stays a number."""

    def lazy(name: str) -> Any:
        value = getattr(surface, name)
        return value if value is None or not any(value.strides) else da.from_array(value, chunks=chunks)

    maps = {name: lazy(name) for name in QUANTITIES}
    return pm.Surface(**maps, pixel_size=surface.pixel_size, allow_nan=surface.allow_nan)


def simulate(surface: pm.Surface, control: Any = ENGAGE, realism: Any = None, **more: Any) -> xr.Dataset:
    return pm.simulate(surface, SCOPE, 0.7, control=control, realism=realism, **more)


def said(image: xr.Dataset) -> str:
    """By what the pixels of an image were solved, in words."""
    meanings, numbers = image.solver.flag_meanings.split(), image.solver.flag_values
    return " ".join(meanings[list(numbers).index(number)] for number in np.unique(image.solver))


def assert_same(lazy: xr.Dataset, whole: xr.Dataset) -> None:
    """Bit for bit; what a control found out is a variable in one and an attribute of the other."""
    image = lazy.compute()
    assert set(whole.data_vars) <= set(image.data_vars)
    for name, variable in whole.variables.items():
        mine = image[name].variable
        assert mine.dims == variable.dims and mine.dtype == variable.dtype and str(mine.attrs) == str(variable.attrs)
        assert np.ascontiguousarray(mine.values).tobytes() == np.ascontiguousarray(variable.values).tobytes(), name
    found = set(image.data_vars) - set(whole.data_vars)
    assert all(image[name].item() == whole.attrs[name] for name in found)
    assert image.attrs["configuration"] == whole.attrs["configuration"]


@pytest.fixture(scope="module")
def images() -> dict[str, xr.Dataset]:
    """Of every control, in memory."""
    return {name: simulate(few(), control, realism) for name, (control, realism) in CONTROLS.items()}


@pytest.mark.parametrize("name", CONTROLS)
@pytest.mark.parametrize("chunks", [(4, 5), ((1, 7, 3), (9, 5))])
def test_lazy_image_is_that_in_memory_bit_for_bit(name: str, chunks: Any, images: dict[str, xr.Dataset]) -> None:
    lazy = simulate(lazily(few(), chunks), *CONTROLS[name])
    assert all(variable.chunks is not None for variable in lazy.data_vars.values())
    assert_same(lazy, images[name])


def cuts(side: int) -> st.SearchStrategy[tuple[int, ...]]:
    """Ways to cut a side into pieces."""
    inner = st.sets(st.integers(1, side - 1), max_size=4).map(sorted)
    return inner.map(lambda places: tuple(np.diff([0, *places, side]).tolist()))


@pytest.mark.parametrize("name", ["engage", "raster image", "changed tip"])
@given(cuts(SHAPE[0]), cuts(SHAPE[1]), cuts(SHAPE[0]), cuts(SHAPE[1]), st.integers(1, 60))
@settings(max_examples=8, deadline=None)
def test_no_cut_into_blocks_changes_a_bit(
    name: str, images: dict[str, xr.Dataset], ys: Any, xs: Any, other_ys: Any, other_xs: Any, lines: int
) -> None:
    surface = few()
    modulus, topography = (
        da.from_array(surface.modulus, (ys, xs)),
        da.from_array(surface.topography, (other_ys, other_xs)),
    )
    lazy = pm.Surface(modulus, 0.12, surface.damping, topography=topography, pixel_size=surface.pixel_size)
    with pytest.MonkeyPatch.context() as patch, dask.config.set(scheduler="synchronous"):
        patch.setattr(blocks, "LINES", lines)
        assert_same(simulate(lazy, *CONTROLS[name]), images[name])


def test_pixels_without_material_stay_nan() -> None:
    surface = few()
    modulus = surface.modulus.copy()
    modulus[2:5, 3:11] = np.nan
    holed = pm.Surface(modulus, 0.12, surface.damping, pixel_size=4e-9, allow_nan=True)
    for control in (ENGAGE, pm.Raster(engage="image")):
        assert_same(simulate(lazily(holed, (3, 4)), control), simulate(holed, control))


def test_more_materials_than_are_kept_are_solved_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    surface = few()
    continuous = pm.Surface(np.geomspace(0.5e9, 4e9, 154).reshape(SHAPE), 0.1, surface.damping, pixel_size=4e-9)
    for control in (ENGAGE, pm.Raster(engage="image")):
        whole = simulate(continuous, control, solver="orbit")
        monkeypatch.setattr(engaged, "MOST", 6)
        monkeypatch.setattr(raster, "MOST", 6)
        assert_same(simulate(lazily(continuous, (4, 5)), control, solver="orbit"), whole)
        monkeypatch.undo()


def test_atlas_of_a_lazy_surface_is_that_in_memory() -> None:
    rng = np.random.default_rng(3)
    surface = pm.Surface(rng.uniform(1e9, 3e9, (110, 110)), rng.uniform(0.03, 0.08, (110, 110)), 0.01, pixel_size=4e-9)
    whole = simulate(surface)
    assert "interpolated" in str(whole.solver.attrs) and (whole.solver == whole.solver.max()).mean() > 0.5
    assert_same(simulate(lazily(surface, (40, 73))), whole)


@pytest.mark.parametrize("varies", [(), ("thickness",), ("poisson_ratio",)], ids=["alike", "thickness", "poisson"])
def test_lazy_films_are_interpolated_only_where_they_are_alike(
    varies: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engaged, "FEW", 4)
    monkeypatch.setattr(engaged, "MOST", 4)
    monkeypatch.setattr(atlas, "LEAST", 1)
    monkeypatch.setattr(atlas, "WORTH", 1e3)  # an atlas pays, however small the image
    rng = np.random.default_rng(0)
    maps = {"poisson_ratio": rng.uniform(0.2, 0.4, (4, 6)), "thickness": rng.uniform(5e-9, 50e-9, (4, 6))}
    films = {name: one if name in varies else one[0, 0] for name, one in maps.items()}
    surface = pm.Surface(rng.uniform(1e8, 3e8, (4, 6)), 0.02, 0.01, **films, pixel_size=4e-9)
    interaction = pm.Interaction("film", decay_length=None)
    scope = pm.Microscope(pm.Cantilever(2.0, 70e3, 100.0), pm.Tip(10e-9), pm.Drive(20e-9), interaction)
    whole, lazy = (pm.simulate(one, scope, 0.7) for one in (surface, lazily(surface, (2, 3))))
    assert ("interpolated" in said(whole)) == (not varies)
    assert_same(lazy, whole)


def test_lazy_materials_that_relax_are_those_in_memory() -> None:
    moduli = np.array([[2e9, 1e9], [1e9, 2e9]])
    solid = {"relaxed_modulus": 5e8, "relaxation_time": 20e-9, "pixel_size": 1e-9}
    later, now = (pm.Surface(one, **solid) for one in (da.from_array(moduli, chunks=(1, 2)), moduli))
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    images = [pm.simulate(one, scope, 0.6, variables=["phase"]) for one in (later, now)]
    np.testing.assert_array_equal(images[0].compute().phase, images[1].phase)


def test_averaging_and_chosen_variables() -> None:
    names = ("phase", "dissipation")
    whole = simulate(few(), solver="averaging", variables=names)
    assert_same(simulate(lazily(few(), (4, 5)), solver="averaging", variables=names), whole)


def test_labels_in_dask_arrays() -> None:
    labels = np.random.default_rng(1).integers(0, 2, SHAPE, np.int16)
    both = {0: SOFT, 1: HARD}
    lazy = pm.Surface.from_labels(da.from_array(labels, chunks=(4, 5)), both, pixel_size=4e-9)
    assert lazy.lazy and lazy.compute() == pm.Surface.from_labels(labels, both, pixel_size=4e-9)
    assert_same(simulate(lazy), simulate(lazy.compute()))


@pytest.mark.parametrize("kind", ["zarr", "netcdf"])
def test_surface_in_a_file_stays_there(kind: str, tmp_path: Path, images: dict[str, xr.Dataset]) -> None:
    maps = few().to_dataset()
    if kind == "zarr":
        maps.chunk(y=4, x=5).to_zarr(tmp_path / "maps.zarr")
        opened = xr.open_zarr(tmp_path / "maps.zarr")
    else:
        maps.to_netcdf(tmp_path / "maps.nc")
        opened = xr.open_dataset(tmp_path / "maps.nc", chunks={"y": 4, "x": 5})
    with opened:
        surface = pm.Surface.from_dataset(opened)
        assert surface.lazy
        assert_same(simulate(surface), images["engage"])


@pytest.mark.parametrize("name", ["engage", "raster image"])
def test_scheduler_does_not_matter(name: str, images: dict[str, xr.Dataset]) -> None:
    lazy = simulate(lazily(few(), (4, 5)), *CONTROLS[name])
    for scheduler in ("synchronous", "threads"):
        with dask.config.set(scheduler=scheduler):
            assert_same(lazy, images[name])


# When it is computed


class Counted:
    """A map that counts how often a block of it is computed."""

    def __init__(self, values: np.ndarray, chunks: Any) -> None:
        self.values, self.computed = values, 0
        self.map = da.map_blocks(self._block, da.from_array(values, chunks=chunks), dtype=float, meta=values[:0, :0])

    def _block(self, block: np.ndarray) -> np.ndarray:
        self.computed += 1
        return block


@pytest.mark.parametrize("name", ["engage", "raster image", "feedback line"])
def test_nothing_is_computed_before_it_is_asked_for(name: str) -> None:
    control, realism = CONTROLS[name]
    modulus = Counted(few().modulus, (4, 5))
    image = simulate(pm.Surface(modulus.map, 0.12, 0.02, pixel_size=4e-9), control, realism)
    str(image), image.phase.shape, image.sizes
    assert modulus.computed == 0
    image.compute(scheduler="synchronous")
    assert modulus.computed == 2 * 9  # blocks, for the survey and to be filled


@pytest.mark.parametrize(("row", "column"), [(0, 0), (9, 13)])
def test_bad_value_says_where_it_is(row: int, column: int) -> None:
    modulus = few().modulus.copy()
    modulus[row, column] = -1.0
    image = simulate(pm.Surface(da.from_array(modulus, chunks=(4, 5)), pixel_size=4e-9))
    with pytest.raises(pm.InputError, match=r"modulus is -1.0; allowed: .* row (\d+), column (\d+)") as raised:
        image.compute(scheduler="synchronous")
    numbers = [int(number) for number in re.findall(r"(?:row|column) (\d+)", str(raised.value))]
    assert (numbers[0] + numbers[2], numbers[1] + numbers[3]) == (row, column)


def test_maps_that_change_between_survey_and_filling_are_refused() -> None:
    rng = np.random.default_rng()
    modulus = da.map_blocks(lambda: rng.uniform(1e9, 2e9, (4, 4)), chunks=((4, 4), (4, 4)), dtype=float)
    with pytest.raises(pm.InputError, match="surface is not the same; allowed: maps that are the same"):
        simulate(pm.Surface(modulus, pixel_size=4e-9)).compute()


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"strict": True}, "strict is True; allowed: False for a surface in Dask arrays"),
        ({"progress": print}, "progress is given; allowed: None"),
        ({"checkpoint": "parts"}, "checkpoint is 'parts'; allowed: None"),
        ({"realism": pm.Realism(bits=8)}, "bits is 8; allowed: None"),
        ({"realism": pm.Realism(drift=(1e-9, 0.0, 0.0))}, r"drift is \(1e-09, 0.0, 0.0\); allowed: \(0.0, 0.0, 0.0\)"),
    ],
)
def test_what_needs_the_whole_image_is_refused_in_a_sentence(more: dict[str, Any], sentence: str) -> None:
    with pytest.raises(pm.InputError, match=sentence) as raised:
        simulate(lazily(few(), (4, 5)), **more)
    assert "\n" not in str(raised.value)


def test_surveys_of_parts_say_the_same_in_any_order() -> None:
    surface = few((40, 50))
    for most in (100, 4):
        parts = []
        for top in range(0, 40, 13):
            for left in range(0, 50, 17):
                cut = np.s_[top : top + 13, left : left + 17]
                maps = {name: getattr(surface, name)[cut] for name in ("modulus", "damping")}
                part = pm.Surface(**maps, adhesion=0.12, pixel_size=4e-9)
                parts.append(survey(part, most, Window(top, left, surface.shape)))
        whole = survey(surface, most, Window(0, 0, surface.shape))
        for seed in range(3):
            shuffled = [parts[i] for i in np.random.default_rng(seed).permutation(len(parts))]
            joined = shuffled[0]
            for other in shuffled[1:]:
                joined = joined.joined(other, most)
            counted = 6 if most > 6 else surface.shape[0] * surface.shape[1]
            assert joined.count == whole.count == counted and np.array_equal(joined.sample, whole.sample)
            assert (joined.materials is None) == (most < 6)


WITHOUT = """
import sys
import phasemap as pm
dask = {"dask", "distributed", "zarr"}
assert not dask & set(sys.modules)
sys.modules.update(dict.fromkeys(dask))  # xarray imports Dask where it finds it; here none is found
scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(1e-8), pm.Drive(2e-8))
pm.simulate(pm.Surface([[1e9, 2e9]], pixel_size=1e-9), scope, 0.7)
print("done")
"""


@pytest.mark.slow
def test_phasemap_works_without_dask() -> None:
    said = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=False)
    assert (said.stdout, said.stderr) == ("done\n", "")


# Memory


def rows_of(side: int, height: int) -> da.Array:
    """A map of two numbers that is made block by block."""

    def block(block_info: Any = None) -> np.ndarray:
        (top, bottom), (left, right) = block_info[None]["array-location"]
        y, x = np.ogrid[top:bottom, left:right]
        return np.where((y // 40 + x // 60) % 2 == 0, 1e9, 3e9)

    chunks = da.core.normalize_chunks((height, height), (side, side))
    return da.map_blocks(block, chunks=chunks, dtype=float, meta=np.empty((0, 0)))


def peak(side: int, control: Any, store: Path) -> float:
    """Bytes that the image of a map takes while it is written."""
    surface = pm.Surface(rows_of(side, 128), 0.05, 0.01, pixel_size=4e-9)
    image = simulate(surface, control, variables=["height"])
    tracemalloc.start()
    try:
        with dask.config.set(scheduler="threads", num_workers=2):
            image.to_zarr(store, consolidated=False)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("control", [ENGAGE, pm.Raster(engage="line")], ids=["engage", "raster"])
def test_memory_does_not_grow_with_the_map(control: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "LINES", 1 << 14)
    simulate(few(), control)  # what is loaded once
    peak(256, control, tmp_path / "first")
    small, large = peak(512, control, tmp_path / "small"), peak(1024, control, tmp_path / "large")
    # A map that is kept would add 0.75 of its size. Whole lines take a row of blocks at once, twice as wide: 0.4.
    assert large < small + 0.6 * 1024**2 * 8


# Clusters


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two processes of this machine, and nothing of the network."""
    with (
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
        ) as cluster,
        Client(cluster) as connected,
    ):
        yield connected


@pytest.mark.slow
@pytest.mark.parametrize("name", ["engage", "raster image", "feedback image"])
def test_cluster_makes_the_same_image(name: str, client: Client, images: dict[str, xr.Dataset]) -> None:
    assert_same(simulate(lazily(few(), (4, 5)), *CONTROLS[name]), images[name])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["zarr", "netcdf"])
def test_image_is_written_from_the_cluster(
    kind: str, client: Client, tmp_path: Path, images: dict[str, xr.Dataset]
) -> None:
    image = simulate(lazily(few(), (4, 5)))
    if kind == "zarr":
        image.to_zarr(tmp_path / "image.zarr", consolidated=False)
        opened = xr.open_zarr(tmp_path / "image.zarr", consolidated=False)
    else:
        image.to_netcdf(tmp_path / "image.nc")
        opened = xr.open_dataset(tmp_path / "image.nc")
    with opened:
        for name, values in images["engage"].data_vars.items():
            assert opened[name].values.tobytes() == values.values.tobytes()


@pytest.mark.slow
def test_maps_that_are_kept_on_the_cluster(client: Client, images: dict[str, xr.Dataset]) -> None:
    surface = few()
    kept = da.from_array(surface.modulus, chunks=(4, 5)).persist()
    lazy = pm.Surface(kept, 0.12, surface.damping, topography=surface.topography, pixel_size=4e-9)
    assert_same(simulate(lazy), images["engage"])


@pytest.mark.slow
def test_killed_worker_changes_nothing(client: Client, images: dict[str, xr.Dataset]) -> None:
    name = "raster image"  # whose parts need the state that others end with; those of "engage" need none
    surface = few()

    def slow(block: np.ndarray) -> np.ndarray:
        time.sleep(0.15)
        return block

    modulus = da.from_array(surface.modulus, chunks=(2, 7)).map_blocks(slow, dtype=float, meta=np.empty((0, 0)))
    lazy = pm.Surface(modulus, 0.12, surface.damping, topography=surface.topography, pixel_size=4e-9)
    before = client.run(os.getpid)
    futures = client.compute(simulate(lazy, *CONTROLS[name]))

    def filled(dask_scheduler: Any) -> dict[str, int]:
        """How many parts each worker has filled and keeps."""
        return {
            address: sum("phasemap-fill" in str(task.key) for task in worker.has_what)
            for address, worker in dask_scheduler.workers.items()
        }

    deadline = time.monotonic() + 600
    while not any((held := client.run_on_scheduler(filled)).values()):
        assert not futures.done() and time.monotonic() < deadline
        time.sleep(0.01)
    victim = max(held, key=lambda address: held[address])
    os.kill(before[victim], signal.SIGKILL)
    assert not futures.done()
    assert_same(futures.result(), images[name])
    client.wait_for_workers(2)
    assert before[victim] not in client.run(os.getpid).values()
