"""The twin of examples/digital_twin.py is asked as the AFM of DTMicroscope is, and answers in its shapes."""

from __future__ import annotations

import inspect

import digital_twin
import numpy as np
import pytest

import phasemap as pm

INTERFACE = {  # of DTMicroscope.base.afm.AFM_Microscope; modification adds faults that are simulated here
    "get_dataset_info": [], "get_scan": ["channels", "modification", "scan_rate", "trace", "direction"],
    "scanning_emulator": ["direction", "channels", "scan_rate", "modification"], "go_to": ["x", "y"],
    "scan_individual_line": ["direction", "trace", "coord", "channels", "modification"],
    "scan_arbitrary_path": ["path_points", "channels", "modification"], "get_spectrum": ["location", "channel"],
}  # fmt: skip


@pytest.fixture
def twin(monkeypatch: pytest.MonkeyPatch) -> digital_twin.Twin:
    """A sample of 3 by 4 pixels whose scans are numbered: what is tested is what they are made into."""
    labels = np.arange(12).reshape(3, 4) % 2
    made = digital_twin.Twin(labels, {0: digital_twin.MATRIX, 1: digital_twin.DOMAIN}, 10e-9)
    maps = np.stack([np.arange(12.0).reshape(3, 4), 100 + np.arange(12.0).reshape(3, 4)])

    def simulate(*_: object) -> object:
        import xarray as xr

        dims = ("direction", "y", "x")
        names = ("height", "phase", "amplitude")
        return xr.Dataset(dict.fromkeys(names, (dims, maps)), {"direction": ["trace", "retrace"]})

    monkeypatch.setattr(pm, "simulate", simulate)
    return made


@pytest.mark.parametrize("name", INTERFACE)
def test_methods_take_what_those_of_the_afm_take(name: str) -> None:
    asked = list(inspect.signature(getattr(digital_twin.Twin, name)).parameters)
    assert asked == ["self", *INTERFACE[name]]


def test_scans_lines_and_paths_are_of_the_same_pixels(twin: digital_twin.Twin) -> None:
    scan = twin.get_scan()
    assert scan.shape == (3, 4, 3) and scan[0, 1, 2] == 9.0
    assert twin.get_scan(["Channel_001"], direction="vertical").shape == (1, 3, 4)
    back = twin.get_scan(["Phase"], trace="backward", scan_rate=2.0)
    assert back[0, :, 0].tolist() == [103.0, 102.0, 101.0, 100.0] and twin.feedback.line_rate == 2.0
    line = twin.scan_individual_line(coord=twin.y_coords[1], channels=["Height"])
    assert line.tolist() == [[4.0, 5.0, 6.0, 7.0]] and (twin.x, twin.y) == (twin.x_coords[-1], twin.y_coords[1])
    upright = twin.scan_individual_line("vertical", "backward", twin.x_coords[3], ["Height"])
    assert upright.tolist() == [[103.0, 107.0, 111.0]]
    path = twin.scan_arbitrary_path(np.array([[-1.0, -1.0], [25e-9, 25e-9], [1.0, 25e-9]]), ["Height"])
    assert path.tolist() == [[0.0, 5.0, 10.0, 10.0, 11.0]]
    assert [one.shape for one in twin.scanning_emulator(channels=["Phase"])] == [(1, 3)] * 4


def test_what_the_afm_refuses_is_refused(twin: digital_twin.Twin) -> None:
    for ask in (
        lambda: twin.get_scan(modification=[{}]), lambda: twin.get_spectrum(channel="Phase"),
        lambda: list(twin.scanning_emulator(modification=[{}])), lambda: twin.scan_individual_line(modification=[{}]),
        lambda: twin.scan_arbitrary_path(np.zeros((2, 2)), modification=[{}]),
        lambda: twin.scan_arbitrary_path(np.zeros((1, 2))),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"modification|point cloud|path_points"):
            ask()
    assert [name for name, _ in twin.get_dataset_info()] == [
        "channels", "signals", "units", "scans", "spectra", "point_clouds"
    ]  # fmt: skip
