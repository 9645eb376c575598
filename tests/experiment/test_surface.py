"""Surface: what it accepts, what it refuses and in which words, and what survives a round trip."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import FrozenInstanceError, replace

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from phasemap._shared.errors import InputError
from phasemap.experiment.material import Material
from phasemap.experiment.surface import Surface

# Small whole numbers tell pixels apart, and any number must survive: neither is what anybody measures.
pytestmark = pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")

SOFT = Material(modulus=1e9, adhesion=0.1, damping=0.01)
HARD = Material(modulus=3e9, adhesion=0.05, damping=0.002, poisson_ratio=0.3)

SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, max_side=6)
SIDES = st.floats(1e-12, 1e-3)


def maps(shape: tuple[int, int], low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    """Draw maps with few distinct values, or many, or one."""
    values = st.floats(low, high)
    some = st.lists(values, min_size=1, max_size=3).map(st.sampled_from)
    few = some.flatmap(lambda elements: hnp.arrays(float, shape, elements=elements))
    return st.one_of(few, hnp.arrays(float, shape, elements=values), values)


@st.composite
def surfaces(draw: st.DrawFn) -> Surface:
    shape = draw(SHAPES)
    loss = draw(st.sampled_from(["damping", "viscosity"]))
    return Surface(
        **{loss: draw(maps(shape, 0.0, 1e3))},
        modulus=draw(maps(shape, 0.0, 1e12)),
        adhesion=draw(maps(shape, 0.0, 10.0)),
        poisson_ratio=draw(maps(shape, -0.99, 0.5)),
        topography=draw(st.none() | maps(shape, -1e-6, 1e-6)),
        pixel_size=draw(st.tuples(SIDES, SIDES)),
        shape=shape,
    )


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.array_equal(np.ascontiguousarray(a).view(np.int64), np.ascontiguousarray(b).view(np.int64)))


# What a surface is


def test_numbers_and_maps_become_read_only_maps_of_one_shape() -> None:
    s = Surface(modulus=[[1000, 2000, 3000], [4000, 5000, 6000]], adhesion=0.1, pixel_size=2e-9)
    for field in (s.modulus, s.adhesion, s.damping, s.poisson_ratio):
        assert field.shape == s.shape == (2, 3)
        assert field.dtype == np.float64
        assert not field.flags.writeable
    assert s.damping.max() == 0
    assert s.viscosity is None
    assert s.topography is None
    assert s.pixel_size == (2e-9, 2e-9)
    with pytest.raises(FrozenInstanceError):
        s.modulus = s.adhesion


def test_one_number_for_all_pixels_takes_the_memory_of_one_number() -> None:
    s = Surface(modulus=np.full((50, 60), 1e9), adhesion=0.1, pixel_size=1e-9)
    assert s.modulus.shape == (50, 60)
    for field in (s.modulus, s.adhesion, s.damping, s.poisson_ratio, s.unique()[1]):
        assert field.strides == (0, 0)


def test_a_map_that_its_owner_changes_later_does_not_change_the_surface() -> None:
    mine = np.array([[1e9, 2e9]])
    view = mine.view()
    view.setflags(write=False)
    for given_map in (mine, view):
        s = Surface(modulus=given_map, pixel_size=1e-9)
        before = s.modulus.copy()
        mine *= 2
        assert np.array_equal(s.modulus, before)


def test_a_read_only_map_is_not_copied() -> None:
    mine = np.array([[1e9, 2e9]])
    mine.setflags(write=False)
    s = Surface(modulus=mine, pixel_size=1e-9)
    assert np.shares_memory(s.modulus, mine)
    assert np.shares_memory(replace(s, adhesion=1.0).modulus, mine)


@pytest.mark.parametrize("dtype", ["float32", "int16", "uint8", ">f8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_maps_of_any_real_type_and_layout_are_taken(dtype: str, order: str) -> None:
    given_map = np.array([[1, 2, 3], [4, 5, 6]], dtype=dtype, order=order)
    s = Surface(modulus=given_map, pixel_size=1e-9)
    assert s.modulus.flags.c_contiguous
    assert np.array_equal(s.modulus, [[1, 2, 3], [4, 5, 6]])


def test_the_shape_can_be_given_where_no_map_has_one() -> None:
    assert Surface(modulus=1e9, pixel_size=1e-9, shape=(3, 4)).adhesion.shape == (3, 4)


def test_coordinates_are_pixel_centres_and_row_0_is_the_top() -> None:
    y, x = Surface(modulus=1e9, pixel_size=(2**-20, 2**-21), shape=(2, 3)).coords()
    assert (y * 2**20).tolist() == [1.5, 0.5]
    assert (x * 2**20).tolist() == [0.25, 0.75, 1.25]


def test_replace_changes_one_thing() -> None:
    s = Surface.from_labels([[0, 1]], {0: SOFT, 1: HARD}, pixel_size=1e-9)
    t = replace(s, topography=[[0.0, 1e-9]])
    assert np.array_equal(t.topography, [[0.0, 1e-9]])
    assert same_bits(t.unique()[0], s.unique()[0])
    assert t != s
    assert replace(t, topography=None) == s


def test_surfaces_are_equal_if_their_values_are() -> None:
    s = Surface(modulus=[[1e9, 2e9]], pixel_size=1e-9)
    assert s == Surface(modulus=[[1e9, 2e9]], pixel_size=(1e-9, 1e-9))
    assert s != Surface(modulus=[[1e9, 2e9]], pixel_size=2e-9)
    assert s != Surface(modulus=[[1e9, 3e9]], pixel_size=1e-9)
    assert s != Surface(modulus=[[1e9, 2e9]], viscosity=0.0, pixel_size=1e-9)
    assert s != "a surface"


# What it refuses

NAN, INF = float("nan"), float("inf")
REFUSED = {
    "modulus is nan; allowed: a finite number of at least 0 Pa. It is at row 1, column 0; 2 such pixels. Fill it from "
    "its neighbours, or give allow_nan=True (in a scene allow_nan = true) to leave it without a material.": {
        "modulus": [[1.0, 2.0], [NAN, NAN]]
    },
    "topography is nan; allowed: a finite number, in m. It is at row 0, column 1. Fill it from its neighbours.": {
        "topography": [[0.0, NAN]],
        "allow_nan": True,
    },
    "topography is inf; allowed: a finite number, in m. It is at row 0, column 0.": {"topography": [[INF, 0.0]]},
    "modulus is -2.0; allowed: a finite number of at least 0 Pa. It is at row 0, column 1.": {"modulus": [[1.0, -2.0]]},
    "modulus is -1; allowed: a finite number of at least 0 Pa.": {"modulus": -1},
    "modulus is '1 GHz'; allowed: one number or a 2-D map, in Pa or each a modulus such as '3 GPa'.": {
        "modulus": "1 GHz"
    },
    "modulus is inf; allowed: a finite number of at least 0 Pa. It is at row 0, column 1.": {
        "modulus": [[NAN, INF]],
        "allow_nan": True,
    },
    "adhesion is -0.1; allowed: a finite number of at least 0 J m-2.": {"adhesion": -0.1},
    "damping is -1.0; allowed: a finite number of at least 0. It is at row 0, column 0.": {"damping": [[-1.0, 0.0]]},
    "viscosity is -1.0; allowed: a finite number of at least 0 Pa s.": {"viscosity": -1.0},
    "poisson_ratio is 0.6; allowed: a finite number above -1 and at most 0.5.": {"poisson_ratio": 0.6},
    "poisson_ratio is -1.0; allowed: a finite number above -1 and at most 0.5. It is at row 0, column 0.": {
        "poisson_ratio": [[-1.0, 0.0]]
    },
    "viscosity is given beside damping; allowed: one of the two.": {"damping": 0.1, "viscosity": 1.0},
    "shape of adhesion is (2, 1); allowed: (1, 2), that of modulus.": {
        "modulus": [[1.0, 2.0]],
        "adhesion": [[1.0], [2.0]],
    },
    "shape of modulus is (1, 2); allowed: (3, 3), the one asked for.": {"modulus": [[1.0, 1.0]], "shape": (3, 3)},
    "shape of modulus is (3,); allowed: (rows, columns) of a 2-D map. One number will do too.": {
        "modulus": [1.0, 2.0, 3.0]
    },
    "shape of modulus is (0, 3); allowed: (rows, columns) of a 2-D map. One number will do too.": {
        "modulus": np.ones((0, 3))
    },
    "modulus is 'a list of rows of unequal length'; allowed: one number or a 2-D map.": {
        "modulus": [[1.0], [1.0, 2.0]]
    },
    "type of modulus is 'complex128'; allowed: real numbers.": {"modulus": [[1j, 2.0]]},
    "shape is None; allowed: (rows, columns), where no map is given.": {"shape": None},
    "shape is 5; allowed: two whole numbers, (rows, columns).": {"shape": 5},
    "number of columns is 0; allowed: a whole number of at least 1.": {"shape": (2, 0)},
    "pixel_size is 0; allowed: a finite number above 0 m.": {"pixel_size": 0},
    "pixel_size dx is -1e-09; allowed: a finite number above 0 m.": {"pixel_size": (1e-9, -1e-9)},
    "pixel_size is (1, 2, 3); allowed: one length in m, or two, (dy, dx).": {"pixel_size": (1, 2, 3)},
}


@pytest.mark.parametrize(("sentence", "arguments"), REFUSED.items(), ids=[sentence[:40] for sentence in REFUSED])
def test_a_wrong_argument_is_refused_in_one_sentence(sentence: str, arguments: dict[str, object]) -> None:
    usual: dict[str, object] = {"modulus": 1e9, "pixel_size": 1e-9}
    if not any(isinstance(value, list) for value in arguments.values()):
        usual["shape"] = (1, 2)
    with pytest.raises(InputError) as caught:
        Surface(**{**usual, **arguments})
    assert str(caught.value) == sentence


def test_a_map_with_nan_says_where() -> None:
    modulus = np.ones((5, 20))
    modulus[3, 17] = modulus[4] = NAN
    with pytest.raises(InputError, match="row 3, column 17; 21 such pixels"):
        Surface(modulus=modulus, pixel_size=1e-9)


def test_nan_and_numbers_out_of_bounds_are_counted_apart() -> None:
    modulus = np.ones((5, 20))
    modulus[3, 17], modulus[4, :7] = -1.0, NAN
    with pytest.raises(InputError, match=r"modulus is -1.0; .* row 3, column 17\.$"):
        Surface(modulus=modulus, pixel_size=1e-9)
    with pytest.raises(InputError, match=r"modulus is nan; .* row 1, column 0; 7 such pixels"):
        Surface(modulus=modulus[[0, 4, 3]], pixel_size=1e-9)


def test_pixels_without_a_material_are_kept_on_request() -> None:
    s = Surface(modulus=[[1e9, NAN, NAN]], adhesion=0.1, pixel_size=1e-9, allow_nan=True)
    rows, inverse = s.unique()
    assert len(rows) == 2
    assert np.isnan(rows[inverse, 0]).tolist() == [[False, True, True]]
    assert Surface.from_dataset(s.to_dataset(), allow_nan=True) == s
    assert "1 GPa" in repr(s)


def test_a_surface_without_any_material_has_the_shape_asked_for() -> None:
    s = Surface(modulus=np.broadcast_to(NAN, (2, 3)), pixel_size=1e-9, allow_nan=True)
    assert s.shape == s.modulus.shape == (2, 3)
    assert s.unique()[1].tolist() == [[0, 0, 0], [0, 0, 0]]


def test_a_masked_map_counts_as_nan_under_the_mask() -> None:
    masked = np.ma.array([[1.0, 2.0]], mask=[[False, True]])
    with pytest.raises(InputError, match="row 0, column 1"):
        Surface(modulus=masked, pixel_size=1e-9)


def test_a_data_array_whose_pixels_have_another_size_is_refused() -> None:
    x = (np.arange(3) + 0.5) * 2e-9
    modulus = xr.DataArray([[1e9, 2e9, 3e9]] * 2, {"y": x[:2], "x": x}, ("y", "x"))
    assert Surface(modulus, pixel_size=2e-9).pixel_size == (2e-9, 2e-9)
    sentence = (
        r"pixel_size is '4e-09'; allowed: 2 nm, the spacing of y in {}. Without that coordinate any size is taken: "
    )
    for name, make in {
        "modulus": lambda: Surface(modulus, pixel_size="4 nm"),
        "topography": lambda: Surface.from_labels(np.ones((2, 3)), [SOFT] * 2, pixel_size=4e-9, topography=modulus * 0),
        "labels": lambda: Surface.from_labels(modulus * 0, [SOFT], pixel_size=4e-9),
    }.items():
        with pytest.raises(InputError, match=sentence.format(name)):
            make()
    assert Surface(modulus.drop_vars(["y", "x"]), pixel_size=4e-9).pixel_size == (4e-9, 4e-9)


# Labels


def test_a_label_under_a_mask_is_none() -> None:
    labels = np.ma.array([[0, 1, 1]], mask=[[False, True, False]])
    with pytest.raises(InputError, match="map of labels is masked in 1 pixels; allowed: a label in every pixel"):
        Surface.from_labels(labels, {0: SOFT, 1: HARD}, pixel_size=1e-9)
    assert Surface.from_labels(labels.filled(0), {0: SOFT, 1: HARD}, pixel_size=1e-9).shape == (1, 3)


def test_labels_choose_the_material_of_each_pixel() -> None:
    labels = np.array([[5, -3], [-3, 5]])
    s = Surface.from_labels(labels, {5: SOFT, -3: HARD, 7: SOFT}, pixel_size=1e-9)
    for name in ("modulus", "adhesion", "damping", "poisson_ratio"):
        expected = np.where(labels == 5, getattr(SOFT, name), getattr(HARD, name))
        assert np.array_equal(getattr(s, name), expected)


@pytest.mark.parametrize("dtype", ["bool", "int8", "uint8", "int64", "uint64"])
def test_labels_of_any_whole_number_type_are_taken(dtype: str) -> None:
    s = Surface.from_labels(np.array([[0, 1]], dtype), {-1: HARD, 0: SOFT, 1: HARD, 2**40: HARD}, pixel_size=1e-9)
    assert s.modulus.tolist() == [[1e9, 3e9]]


def test_labels_with_the_same_material_are_one_material() -> None:
    rows, inverse = Surface.from_labels([[0, 1, 2]], {0: SOFT, 1: HARD, 2: SOFT}, pixel_size=1e-9).unique()
    assert rows.tolist() == [[1e9, 0.1, 0.01, 0.35], [3e9, 0.05, 0.002, 0.3]]
    assert inverse.tolist() == [[0, 1, 0]]


def test_viscous_materials_give_a_viscosity_map() -> None:
    water, honey = Material(1e6, viscosity=1e-3), Material(1e6, viscosity=10.0)
    s = Surface.from_labels([[0, 1, 2]], {0: water, 1: honey, 2: Material(1e9)}, pixel_size=1e-9)
    assert s.damping is None
    assert s.viscosity.tolist() == [[1e-3, 10.0, 0.0]]


LABELS_REFUSED = {
    "label without a material is '1, 7'; allowed: labels 0, 2. It is at row 0, column 1; 3 such pixels.": (
        [[0, 1, 7], [2, 0, 1]],
        {0: SOFT, 2: HARD},
    ),
    "label without a material is '0, 1, 2, 3, 4 and more'; allowed: labels 9. It is at row 0, column 0; 6 such "
    "pixels.": ([[0, 1, 2, 3, 4, 5]], {9: SOFT}),
    "label without a material is '200'; allowed: labels -1, 300. It is at row 0, column 0.": (
        np.array([[200]], np.uint8),
        {-1: SOFT, 300: SOFT},
    ),
    "type of labels is 'float64'; allowed: whole numbers. Try labels.astype(int).": ([[0.5, 1.0]], {0: SOFT, 1: HARD}),
    "shape of labels is (2,); allowed: (rows, columns) of a 2-D map.": ([0, 1], {0: SOFT, 1: HARD}),
    "labels is 'a list of rows of unequal length'; allowed: a 2-D map of whole numbers.": ([[0], [0, 1]], {0: SOFT}),
    "materials is {}; allowed: a dict with at least one Material, such as {0: soft, 1: hard}.": ([[0]], {}),
    "label of a material is 'soft'; allowed: a whole number.": ([[0]], {"soft": SOFT}),
    "material 0 is 1000000000.0; allowed: a Material.": ([[0]], {0: 1e9}),
    "damping of material 0 is 0.01; allowed: a viscosity in its place, as material 1 has, or a damping there too. A "
    "preset takes one: Material.preset('PS', damping=0.01). Which damping a viscosity is depends on lever and tip, "
    "which a scene knows and a surface does not.": ([[0, 1]], {0: SOFT, 1: Material(1e9, viscosity=1.0)}),
}


@pytest.mark.parametrize(("sentence", "given"), LABELS_REFUSED.items(), ids=[s[:40] for s in LABELS_REFUSED])
def test_wrong_labels_are_refused_in_one_sentence(sentence: str, given: tuple[object, dict[int, Material]]) -> None:
    with pytest.raises(InputError) as caught:
        Surface.from_labels(*given, pixel_size=1e-9)
    assert str(caught.value) == sentence


# Distinct materials


@given(surfaces())
def test_unique_rebuilds_the_maps_bit_for_bit(s: Surface) -> None:
    rows, inverse = s.unique()
    columns = [s.modulus, s.adhesion, s.damping if s.viscosity is None else s.viscosity, s.poisson_ratio]
    for j, column in enumerate(columns):
        assert same_bits(rows[inverse, j], column)
    assert rows.shape[1] == 4
    assert len({row.tobytes() for row in rows}) == len(rows)
    assert np.array_equal(np.unique(inverse), np.arange(len(rows)))
    assert inverse.dtype == np.int32
    assert s.unique()[0] is rows


@given(hnp.arrays(np.int8, SHAPES, elements=st.integers(0, 3)))
def test_remembered_labels_and_maps_give_the_same_materials(labels: np.ndarray) -> None:
    materials = {0: SOFT, 1: HARD, 2: SOFT, 3: Material(2e9, 0.05, 0.002)}
    s = Surface.from_labels(labels, materials, pixel_size=1e-9)
    t = Surface(s.modulus, s.adhesion, s.damping, None, s.poisson_ratio, pixel_size=1e-9)
    assert s == t
    for a, b in zip(s.unique(), t.unique(), strict=True):
        assert np.array_equal(a, b)


def test_thousands_of_materials_are_told_apart() -> None:
    rng = np.random.default_rng(0)
    modulus, adhesion = rng.integers(1, 2000, (2, 80, 80)).astype(float)
    rows, inverse = Surface(modulus=modulus, adhesion=adhesion, pixel_size=1e-9).unique()
    assert same_bits(rows[inverse, 0], modulus)
    assert same_bits(rows[inverse, 1], adhesion)
    assert len(rows) == len(np.unique(modulus + 1j * adhesion))


# Datasets


@given(surfaces())
def test_a_dataset_round_trip_is_exact(s: Surface) -> None:
    t = Surface.from_dataset(s.to_dataset())
    assert t == s
    assert same_bits(t.modulus, s.modulus)


def test_a_netcdf_round_trip_is_exact(tmp_path: object) -> None:
    rng = np.random.default_rng(0)
    s = Surface(
        rng.random((3, 5)),
        0.1,
        viscosity=rng.random((3, 5)),
        topography=rng.random((3, 5)) * 1e-9,
        pixel_size=(0.1e-9, 0.3e-9),
    )
    written = s.to_dataset()
    written.to_netcdf(f"{tmp_path}/surface.nc")
    with xr.open_dataset(f"{tmp_path}/surface.nc") as read:
        xr.testing.assert_identical(read, written)
        assert Surface.from_dataset(read) == s
        assert "_FillValue" not in read["x"].encoding


def test_every_variable_says_what_it_is_and_in_which_unit() -> None:
    ds = Surface(modulus=1e9, topography=0.0, pixel_size=1e-9, shape=(2, 3)).to_dataset()
    assert ds.attrs == {"Conventions": "CF-1.11"}
    for name, variable in ds.variables.items():
        assert variable.attrs["long_name"]
        assert variable.attrs["units"] in {"Pa", "J m-2", "1", "m"}
        assert variable.dims == ((name,) if name in ds.coords else ("y", "x"))
    assert (np.diff(ds["y"]) < 0).all()


def dataset(**changes: tuple[object, str]) -> xr.Dataset:
    """Make a dataset of 2 x 3 pixels of 4 nm x 2 nm with some variables in other units."""
    ds = Surface(modulus=1e9, adhesion=0.05, topography=0.0, pixel_size=(4e-9, 2e-9), shape=(2, 3)).to_dataset()
    for name, (values, units) in changes.items():
        dims = (name,) if name in ds.dims else ("y", "x")
        ds = ds.assign({name: (dims, np.broadcast_to(values, [ds.sizes[dim] for dim in dims]), {"units": units})})
    return ds


@pytest.mark.parametrize(
    ("name", "value", "units", "si"),
    [
        ("modulus", 2.0, "GPa", 2e9),
        ("modulus", 2.0, "MPa", 2e6),
        ("modulus", 2.0, "kPa", 2e3),
        ("modulus", 2.0, "N/m^2", 2.0),
        ("adhesion", 50.0, "mJ m-2", 0.05),
        ("adhesion", 50.0, "mJ/m²", 0.05),
        ("adhesion", 50.0, "mN/m", 0.05),
        ("topography", 7.0, "nm", 7e-9),
        ("topography", 7.0, "µm", 7e-6),
        ("topography", 7.0, "um", 7e-6),
        ("topography", np.float32(7.0), "pm", 7e-12),
        ("damping", 0.5, "dimensionless", 0.5),
        ("damping", 0.5, "", 0.5),
    ],
)
def test_common_units_are_converted(name: str, value: float, units: str, si: float) -> None:
    assert getattr(Surface.from_dataset(dataset(**{name: (value, units)})), name)[0, 0] == si


def test_positions_in_other_units_give_the_pixel_size_in_metres() -> None:
    ds = dataset(y=(np.array([2.0, 6.0]), "nm"), x=(np.array([0.001, 0.003, 0.005]), "um"))
    assert Surface.from_dataset(ds).pixel_size == (4e-9, 2e-9)


def test_a_cut_dataset_keeps_its_pixel_size_and_starts_anew() -> None:
    s = Surface.from_dataset(dataset().isel(x=slice(1, None)))
    assert s.shape == (2, 2)
    assert s.pixel_size == pytest.approx((4e-9, 2e-9), rel=1e-12)
    assert s.coords()[1][0] == pytest.approx(1e-9)


def test_row_0_of_a_dataset_is_the_top_whichever_way_y_counts() -> None:
    s = Surface(modulus=[[1e3, 2e3, 3e3], [4e3, 5e3, 6e3]], pixel_size=1e-9)
    ds = s.to_dataset()
    earlier = ds.assign_coords(y=ds["y"].values[::-1])
    assert Surface.from_dataset(earlier) == Surface.from_dataset(ds) == s
    assert Surface(earlier["modulus"], pixel_size=1e-9) == Surface(ds["modulus"], pixel_size=1e-9) == s


def test_a_transposed_dataset_is_turned_back() -> None:
    s = Surface(modulus=[[1e3, 2e3, 3e3], [4e3, 5e3, 6e3]], pixel_size=1e-9)
    assert Surface.from_dataset(s.to_dataset().transpose("x", "y")) == s


def test_a_dataset_needs_no_more_than_modulus_and_adhesion_and_may_hold_numbers() -> None:
    ds = xr.Dataset({"modulus": 1e9, "adhesion": (("y", "x"), [[0.1, 0.2]])}, {"y": [0.5e-9], "x": [0.5e-9, 1.5e-9]})
    assert Surface.from_dataset(ds) == Surface(modulus=1e9, adhesion=[[0.1, 0.2]], pixel_size=1e-9)


DATASETS_REFUSED = {
    "list of variables in the dataset is ['modulus', 'damping', 'poisson_ratio', 'topography']; allowed: a list that "
    "has 'adhesion' in it.": dataset().drop_vars("adhesion"),
    "list of coordinates in the dataset is ['x']; allowed: a list that has 'y' in it, the position of the pixel "
    "centres in m.": dataset().drop_vars("y"),
    "units of modulus is 'kg'; allowed: Pa, or another unit of the same kind.": dataset(modulus=(1.0, "kg")),
    "units of damping is 'm'; allowed: 1, or another unit of the same kind.": dataset(damping=(1.0, "m")),
    "units of coordinate x is 'pixel'; allowed: m, or another unit of the same kind.": dataset(
        x=(np.arange(3.0), "pixel")
    ),
    "coordinate x is not increasing; allowed: one that rises from the left of the image.": dataset().isel(x=[1, 0, 2]),
    "coordinate y is not monotonic; allowed: one that falls or rises from the top of the image.": dataset(
        y=(np.array([1e-9, 1e-9]), "m")
    ),
    "spacing of x is '1e-09 to 3e-09'; allowed: the same between all pixels.": dataset(
        x=(np.array([0, 1e-9, 4e-9]), "m")
    ),
    "dims of modulus is ('time', 'y', 'x'); allowed: ('y', 'x') or none.": dataset().expand_dims("time"),
    "viscosity is given beside damping; allowed: one of the two.": dataset(viscosity=(1.0, "Pa s")),
}


@pytest.mark.parametrize(("sentence", "ds"), DATASETS_REFUSED.items(), ids=[s[:40] for s in DATASETS_REFUSED])
def test_a_wrong_dataset_is_refused_in_one_sentence(sentence: str, ds: xr.Dataset) -> None:
    with pytest.raises(InputError) as caught:
        Surface.from_dataset(ds)
    assert str(caught.value) == sentence


def test_importing_surface_and_generators_imports_neither_xarray_nor_scipy() -> None:
    check = (
        "import sys, phasemap.experiment.surface, phasemap.experiment.generate; "
        "sys.exit(bool({'xarray', 'scipy'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0
