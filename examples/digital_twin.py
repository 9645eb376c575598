"""Can an agent that operates a microscope practise on a simulated one?

A digital twin with the interface of the AFM in DTMicroscope: `get_dataset_info`, `get_scan`, `scanning_emulator`,
`go_to`, `scan_individual_line`, `scan_arbitrary_path`, `get_spectrum`. There, a scan looks up recorded data, and
`modification` adds the faults of a tip and a feedback to them. Here every scan is simulated in time, with its feedback,
so that setpoint, drive and gains (`tune`) take effect, and a spectrum is an approach and retraction at the current
position of the tip. The agent in this example lowers the setpoint until the phase contrast is largest. As in
DTMicroscope, arrays have the axes channel, x and y.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

LABELS = pm.generate.blend((24, 24), 8e-9, spacing=80e-9, seed=7)
MATRIX, DOMAIN = pm.Material(0.5e9, 0.1, 0.1, poisson_ratio=0.48), pm.Material(3e9, 0.15, 0.005)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0), pm.Tip(10e-9), pm.Drive(30e-9)
)


CHANNELS = {"Height": "m", "Phase": "deg", "Amplitude": "m"}


class Twin:
    """A microscope over a sample; what `DTMicroscope.base.afm.AFM_Microscope` looks up, this one simulates."""

    name, instrument_vendor, instrument_type = "AFM Microscope", "phasemap", "AFM"

    def __init__(self, labels: np.ndarray, materials: dict[int, pm.Material], pitch: float) -> None:
        self.labels, self.materials = labels, materials
        self.surface = pm.Surface.from_labels(labels, materials, pixel_size=pitch, topography=2e-9 * labels)
        self.scope, self.setpoint, self.feedback = SCOPE, 0.9, pm.Feedback(line_rate=4.0)
        self.x_coords, self.y_coords = ((np.arange(n) + 0.5) * pitch for n in labels.shape[::-1])
        self.x, self.y = float(self.x_coords[labels.shape[1] // 2]), float(self.y_coords[labels.shape[0] // 2])

    def tune(self, *, setpoint: float | None = None, free_amplitude: float | None = None, **gains: float) -> None:
        """Change settings; gains are those of `phasemap.Feedback`."""
        self.setpoint = self.setpoint if setpoint is None else setpoint
        if free_amplitude is not None:
            self.scope = replace(self.scope, drive=pm.Drive(free_amplitude))
        self.feedback = replace(self.feedback, **gains)

    def get_dataset_info(self) -> list[tuple[str, list]]:
        """What there is to record."""
        count = len(CHANNELS)
        return [
            ("channels", [f"Channel_{i:03d}" for i in range(count + 1)]), ("signals", [*CHANNELS, "Amplitude"]),
            ("units", [*CHANNELS.values(), "m"]), ("scans", list(range(count))), ("spectra", []),
            ("point_clouds", [count]),
        ]  # fmt: skip

    def get_scan(
        self, channels: list[str] | None = None, modification: None = None, scan_rate: float | None = None,
        trace: str = "forward", direction: str = "horizontal",
    ) -> np.ndarray:  # fmt: skip
        """Scan, and give the channels asked for over channel, x and y ("vertical": y and x); `scan_rate` in lines/s.

        A channel is asked for by its name or its key. The backward trace comes in the order in which it is recorded.
        Only None is taken as `modification`, here and below: what it fakes is simulated, and `tune` changes it.
        """
        if channels is not None and not isinstance(channels, list):
            raise TypeError("channels must be either None or a list of channel names")
        if modification is not None:
            raise ValueError("modification is not needed: tip and feedback are simulated; change them with tune")
        if scan_rate is not None:
            self.tune(line_rate=scan_rate)
        image = pm.simulate(self.surface, self.scope, self.setpoint, "averaging", self.feedback)
        one = image.sel(direction="trace" if trace == "forward" else "retrace")
        keys = {f"Channel_{i:03d}": name for i, name in enumerate(CHANNELS)}
        names = [keys.get(channel, channel).lower() for channel in channels or CHANNELS]
        found = np.stack([one[name].transpose("x", "y").values for name in names])
        found = found if trace == "forward" else found[:, ::-1]
        return found if direction == "horizontal" else found.transpose(0, 2, 1)

    def scanning_emulator(
        self, direction: str = "horizontal", channels: list[str] | None = None, scan_rate: float | None = None,
        modification: None = None,
    ) -> Iterator[np.ndarray]:  # fmt: skip
        """A scan, slice by slice along its first ("horizontal") or second ("vertical") axis, over channel and pixel."""
        scan = self.get_scan(channels, modification, scan_rate)
        yield from np.moveaxis(scan, 1 if direction == "horizontal" else 2, 0)

    def go_to(self, x: float, y: float) -> bool:
        """Move the tip, as far as the stage goes."""
        self.x, self.y = (
            float(np.clip(at, axis.min(), axis.max())) for at, axis in ((x, self.x_coords), (y, self.y_coords))
        )
        return True

    def scan_individual_line(
        self, direction: str = "horizontal", trace: str = "forward", coord: float = 0.0,
        channels: list[str] | None = None, modification: None = None,
    ) -> np.ndarray:  # fmt: skip
        """The line along x ("horizontal") at y = `coord`, or along y at x = `coord`, over channel and pixel."""
        scan = self.get_scan(channels, modification, trace=trace)
        if direction == "horizontal":
            self.go_to(float(self.x_coords[-1 if trace == "forward" else 0]), coord)
            return scan[:, :, np.abs(self.y_coords - coord).argmin()]
        self.go_to(coord, float(self.y_coords[-1]))
        column = np.abs(self.x_coords - coord).argmin()
        return scan[:, column if trace == "forward" else -1 - column]

    def scan_arbitrary_path(
        self, path_points: np.ndarray, channels: list[str] | None = None, modification: None = None
    ) -> np.ndarray:
        """The pixels on straight lines between points (x, y) of a path, over channel and pixel."""
        points = np.asarray(path_points, float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ValueError("path_points must have shape (N, 2), where N > 1 is the number of points.")
        places = np.array(
            [[np.abs(axis - at).argmin() for axis, at in zip((self.x_coords, self.y_coords), one, strict=True)]
             for one in points]
        )  # fmt: skip
        steps = np.abs(np.diff(places, axis=0)).max(axis=1)
        on = [np.linspace(a, b, n + 1) for a, b, n in zip(places, places[1:], steps, strict=False)]
        x, y = np.concatenate(on).round().astype(int).T
        return self.get_scan(channels, modification)[:, x, y]

    def get_spectrum(
        self, location: tuple[float, float] | None = None, channel: str | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] and the amplitude [m] over the pixel, over approach and retraction; there is one channel."""
        if channel not in (None, "Amplitude", f"Channel_{len(CHANNELS):03d}"):
            raise ValueError(f'The selected channel "{channel}" is not a point cloud channel.')
        x, y = location or (self.x, self.y)
        pixel = self.labels[np.abs(self.y_coords - y).argmin(), np.abs(self.x_coords - x).argmin()]
        distances = np.linspace(1.2, 0.3, 91) * self.scope.driven_amplitude
        curve = pm.sweep_distance(self.materials[int(pixel)], self.scope, distances)
        return curve.tip_offset.values, curve.amplitude.values


def main(folder: Path = Path()) -> None:
    """Write digital_twin.png."""
    twin = Twin(LABELS, {0: MATRIX, 1: DOMAIN}, 8e-9)
    inside = LABELS.T == 1
    setpoints, contrasts, scans = (0.9, 0.8, 0.7, 0.6), [], []
    for setpoint in setpoints:
        twin.tune(setpoint=setpoint)
        phase = twin.get_scan(["Phase"])[0]
        scans.append(phase)
        contrasts.append(float(np.median(phase[inside]) - np.median(phase[~inside])))
        print(f"setpoint {setpoint}: contrast {contrasts[-1]:+.1f} degrees")
    best = int(np.argmax(np.abs(contrasts)))
    twin.tune(setpoint=setpoints[best])
    x, y = np.argwhere(inside)[0]
    twin.go_to(float(twin.x_coords[x]), float(twin.y_coords[y]))
    distances, amplitude = twin.get_spectrum()
    print(f"The agent stays at setpoint {setpoints[best]} and takes a spectrum over a domain.")

    figure, panels = plt.subplots(1, 4, figsize=(12, 3.2), layout="constrained")
    for panel, k in zip(panels, (0, best), strict=False):
        shown = panel.imshow(scans[k].T, cmap="cividis", vmin=-60, vmax=60)
        panel.set_title(f"setpoint {setpoints[k]}", fontsize=10, loc="left")
        panel.set(xticks=[], yticks=[])
    plt.colorbar(shown, ax=panels[1]).set_label("phase (degrees)", fontsize=8)
    panels[2].plot(setpoints, contrasts, "o-", color="0.2", linewidth=1.2)
    panels[2].invert_xaxis()
    panels[2].set(xlabel="setpoint")
    panels[2].set_title("contrast (degrees)", fontsize=10, loc="left")
    for direction, values in zip(("approach", "retract"), amplitude, strict=True):
        panels[3].plot(1e9 * distances, 1e9 * values, label=direction, linewidth=1.2)
    panels[3].set(xlabel="distance (nm)")
    panels[3].set_title("amplitude over a domain (nm)", fontsize=10, loc="left")
    panels[3].legend(fontsize=8, frameon=False)
    figure.savefig(folder / "digital_twin.png", dpi=150)


if __name__ == "__main__":
    main()
