"""Attributes of an image may be anything: a verdict or one sentence comes out, in little time, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap.cli import main
from phasemap.io.netcdf import save
from phasemap.scenes.scene import load_scene
from phasemap.validation import check as checking

STEP = Path(__file__).parents[2] / "samples" / "step.toml"
ATTRIBUTES = ("configuration", "scene")
DEEP = 100_000


CONTROLS = {
    "engage": ["realism.tip_change={line=2,radius=2e-8}", "realism.drift=[4e-9, 0.0, 1e-9]", "realism.bits=12"],
    "raster": ["control.kind=raster"],
    "feedback": ["control.kind=feedback", "control.line_rate=20.0", "realism.line_offset=1e-10"],
}


@pytest.fixture(scope="module")
def images() -> dict[str, xr.Dataset]:
    """One image for each control."""
    return {name: load_scene(STEP, ["surface.shape=[6, 8]", *more]).simulate() for name, more in CONTROLS.items()}


@pytest.fixture
def good(images: dict[str, xr.Dataset]) -> xr.Dataset:
    return images["engage"]


def changed(image: xr.Dataset, attribute: str, *path: str, value: Any) -> xr.Dataset:
    """The image with one value in the JSON of an attribute changed."""
    stored = inside = json.loads(image.attrs[attribute])
    for name in path[:-1]:
        inside = inside[name]
    inside[path[-1]] = value
    return image.assign_attrs({attribute: json.dumps(stored)})


@pytest.mark.parametrize("attribute", ATTRIBUTES)
@pytest.mark.parametrize(
    "value",
    [
        "[" * DEEP, '{"a":' * DEEP, "", "null", "5", "[]", "{}", '"text"', "NaN", "1" * 5000, "\ud7ff{", "[[1, 2]]",
        5, 2.5, np.arange(3), np.array([], float),
    ],
    ids=lambda value: repr(value)[:12],
)  # fmt: skip
def test_what_is_no_configuration_or_scene_is_said_in_one_sentence(
    attribute: str, value: Any, good: xr.Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = save(good.assign_attrs({attribute: value}), tmp_path / "image.nc")
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and len(said) < 1000 and "Traceback" not in said


@pytest.mark.parametrize("shape", [[12000, 12000], [10**9, 1], [8, 6], [6.5, 8], "6 x 8", None, [], 48])
def test_shapes_are_compared_before_anything_is_generated(
    shape: Any, good: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def generated(*_: Any) -> NoReturn:
        raise AssertionError("a surface was made")

    monkeypatch.setattr("phasemap.scenes.surface.build_surface", generated)
    with pytest.raises(pm.InputError, match=r"shape of the image's scene is .*; allowed: \[6, 8\], that of the image"):
        pm.check(changed(good, "scene", "surface", "shape", value=shape))


class ReachedError(pm.PhasemapError):
    """What was said could be read: pixels would be solved now."""


@pytest.fixture
def unsolved(monkeypatch: pytest.MonkeyPatch) -> None:
    def reached(*_: Any) -> NoReturn:
        raise ReachedError

    for name in ("image_again", "solve_again"):
        monkeypatch.setattr(checking, name, reached)
    monkeypatch.setenv("PHASEMAP_MEMORY", "64e6")


WORDS = [
    "orbit", "jkr", "engage", "feedback", "tipchange", "neck", "maps", "blend", "package:os/x", "../a", "image",
]  # fmt: skip
KEYS = ["kind", "file", "generator", "radius", "line", "contact", "x"]
NUMBERS = st.sampled_from(
    [0, -1, 1, 2, 1e-300, 5e-324, 1e300, -1e300, 2**53, 10**400, np.nan, np.inf, -np.inf, 0.5, 1e-9]
)
VALUES = st.recursive(
    NUMBERS | st.none() | st.booleans() | st.text(max_size=6)
    | st.sampled_from(WORDS),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=3),
    max_leaves=4,
)  # fmt: skip


def places(table: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where something stands in tables in tables."""
    if path:
        yield path
    if isinstance(table, (dict, list)):
        for key in table if isinstance(table, dict) else range(len(table)):
            yield from places(table[key], (*path, key))


@pytest.mark.slow
@pytest.mark.usefixtures("unsolved")
@settings(max_examples=150, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_whatever_the_attributes_say_a_verdict_or_one_sentence_comes_out(
    images: dict[str, xr.Dataset], data: st.DataObject
) -> None:
    image = images[data.draw(st.sampled_from(sorted(images)))].copy()
    for attribute in data.draw(st.lists(st.sampled_from(ATTRIBUTES), min_size=1, max_size=3)):
        stored = json.loads(image.attrs[attribute])
        path = data.draw(st.sampled_from(sorted(places(stored), key=str)))
        inside = stored
        for key in path[:-1]:
            inside = inside[key]
        if data.draw(st.integers(0, 9)):
            inside[path[-1]] = data.draw(VALUES)
        else:
            del inside[path[-1]]
        image = image.assign_attrs({attribute: json.dumps(stored)})
    with suppress(pm.PhasemapError):
        assert not pm.check(image).holds  # which is known without solving pixels


@pytest.mark.usefixtures("unsolved")
@settings(max_examples=100, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_whatever_the_variables_are_a_verdict_or_one_sentence_comes_out(
    images: dict[str, xr.Dataset], data: st.DataObject
) -> None:
    image = images[data.draw(st.sampled_from(sorted(images)))].copy(deep=True)
    name = data.draw(st.sampled_from(list(map(str, image.variables))))
    values = data.draw(
        st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0, -5.0, "text", b"bytes", True, None, 2**40, 1j])
    )
    if data.draw(st.booleans()):
        key = data.draw(st.sampled_from(["units", "flag_values", "flag_meanings", "comment", "quantisation_step"]))
        image[name].attrs[key] = data.draw(st.sampled_from([5, "x", np.arange(3), np.array(["a", "b"]), np.nan]))
    elif data.draw(st.booleans()):
        image = image.drop_vars(name)
    else:
        image[name] = image[name].dims, np.full(image[name].shape, values), image[name].attrs
    with suppress(pm.PhasemapError):
        assert not pm.check(image).holds
