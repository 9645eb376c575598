"""The benchmark set: the same images wherever and whenever it is made, and scores that say what they claim."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import benchmark
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import phasemap as pm

STORED = json.loads((Path(__file__).parents[1] / "data" / "benchmark.json").read_text())
# Degree. Another free amplitude by 1e-10 of itself moves no mean by 1e-8, and that of "turning", where a jump from one
# orbit to the other comes earlier or later, by 0.004.
ROUNDING = {"turning": 0.1}


@pytest.fixture(scope="module", autouse=True)
def made_once() -> Iterator[None]:
    """Each case is simulated once for all that is asked of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(benchmark, "make", cache(benchmark.make))
        yield


def summary(images: tuple[xr.Dataset, ...]) -> list[float]:
    """Mean and spread of the phase [degree] and spread of the height [nm] at each setpoint."""
    return [float(x) for one in images for x in (one.phase.mean(), one.phase.std(), 1e9 * one.height.std())]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if i % 4 else []) for i, name in enumerate(benchmark.CASES)]
)
def test_an_image_of_the_benchmark_is_what_it_was(name: str) -> None:
    assert STORED["version"] == benchmark.VERSION, "other images are another version, with other numbers here"
    task, truth = benchmark.make(name, "small")
    assert summary(task.images) == pytest.approx(STORED[name], rel=0, abs=ROUNDING.get(name, 1e-3))
    assert len(np.unique(truth.labels)) == task.materials == len(benchmark.CASES[name].materials)
    for image in task.images:  # nothing of the truth is given away
        assert set(image.data_vars) == set(benchmark.CHANNELS) and set(image.attrs) == {"setpoint", "line_rate"}
        assert np.isfinite(image.phase).all()


@pytest.mark.slow
def test_two_methods_are_scored_on_every_case_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plt.switch_backend("agg")
    benchmark.main(tmp_path)
    plt.close("all")
    told = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    assert [line[0] for line in told] == [*benchmark.CASES, "mean"]
    scores = np.array([line[1:] for line in told])
    assert (scores[:, 1] == "-").all() and (scores[:, 0] == scores[:, 2]).all()  # of the same labels
    assert ((0 <= scores[:, 2:].astype(float)) & (scores[:, 2:].astype(float) <= 1)).all()
    assert (tmp_path / "benchmark.png").read_bytes().startswith(b"\x89PNG")


def test_twelve_cases_have_three_sizes() -> None:
    assert len(benchmark.CASES) == 12 and list(benchmark.SIZES) == ["small", "medium", "large"]


LABELS = np.array([[0, 0, 1, 1], [0, 0, 1, 1]])
TRUTH = benchmark.Answer(LABELS, np.where(LABELS == 0, 1e9, 3e9))


def test_the_truth_scores_one_whatever_its_labels_are_called() -> None:
    assert benchmark.score(TRUTH, TRUTH) == {"segmentation": 1.0, "inversion": 1.0}
    assert benchmark.score(benchmark.Answer(7 - 3 * LABELS), TRUTH)["segmentation"] == 1.0


def test_a_material_that_is_missed_or_split_costs_its_share() -> None:
    one = benchmark.score(benchmark.Answer(np.zeros_like(LABELS)), TRUTH)
    assert one["segmentation"] == pytest.approx((4 / 8 + 0) / 2) and np.isnan(one["inversion"])
    split = benchmark.score(benchmark.Answer(np.array([[0, 2, 1, 1], [0, 0, 1, 1]])), TRUTH)
    assert split["segmentation"] == pytest.approx((3 / 4 + 1) / 2)


def test_a_modulus_is_right_within_the_factor_and_wrong_where_it_is_not_said() -> None:
    off = np.array([[1.4, 1.6, 1 / 1.4, 1 / 1.6], [1, np.nan, 1, 1]]) * TRUTH.modulus
    assert benchmark.score(benchmark.Answer(LABELS, off), TRUTH)["inversion"] == pytest.approx(5 / 8)


def test_images_and_truth_are_written_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "CASES", {"stripes": benchmark.CASES["stripes"]})
    benchmark.write(tmp_path, "small")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["stripes.nc", "stripes_truth.nc"]
    with xr.open_dataset(tmp_path / "stripes.nc") as images, xr.open_dataset(tmp_path / "stripes_truth.nc") as truth:
        assert images.phase.dims == ("setpoint", "direction", "y", "x") and images.setpoint.values.tolist() == [
            0.8,
            0.55,
        ]
        assert (
            images.attrs["benchmark"] == "phasemap-benchmark 4" and images.attrs["phasemap_version"] == pm.__version__
        )
        assert np.array_equal(truth.label, benchmark.make("stripes", "small")[1].labels)
        assert images.x.identical(truth.x)
