"""Can an agent that operates a microscope practise on a simulated one?

A digital twin with the interface of the AFM in DTMicroscope: `get_scan`, `go_to`, `scan_arbitrary_path`,
`get_spectrum`. There, a scan looks up recorded data. Here every scan is simulated in time, with its feedback, so that
setpoint, drive and gains take effect, and a spectrum is an approach and retraction at the current position of the tip.
The agent in this example lowers the setpoint until the phase contrast is largest. As in DTMicroscope, arrays have the
axes channel, x and y.
"""

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


class Twin:
    """A microscope over a sample; what `DTMicroscope.base.afm.AFM_Microscope` looks up, this one simulates."""

    def __init__(self, labels: np.ndarray, materials: dict[int, pm.Material], pitch: float) -> None:
        self.labels, self.materials = labels, materials
        self.surface = pm.Surface.from_labels(labels, materials, pixel_size=pitch, topography=2e-9 * labels)
        self.scope, self.setpoint, self.feedback = SCOPE, 0.9, pm.Feedback(line_rate=4.0)
        self.x_coords, self.y_coords = ((np.arange(n) + 0.5) * pitch for n in labels.shape[::-1])
        self.go_to(float(self.x_coords[0]), float(self.y_coords[0]))

    def tune(self, *, setpoint: float | None = None, free_amplitude: float | None = None, **gains: float) -> None:
        """Change settings; gains are those of `phasemap.Feedback`."""
        self.setpoint = self.setpoint if setpoint is None else setpoint
        if free_amplitude is not None:
            self.scope = replace(self.scope, drive=pm.Drive(free_amplitude))
        self.feedback = replace(self.feedback, **gains)

    def get_scan(self, channels: list[str] | None = None, trace: str = "forward") -> np.ndarray:
        """Scan, and give the channels asked for ("Height", "Phase", "Amplitude"), over channel, x and y."""
        image = pm.simulate(self.surface, self.scope, self.setpoint, "averaging", self.feedback)
        one = image.sel(direction="trace" if trace == "forward" else "retrace")
        names = [channel.lower() for channel in channels or ("Height", "Phase", "Amplitude")]
        return np.stack([one[name].transpose("x", "y").values for name in names])

    def go_to(self, x: float, y: float) -> bool:
        """Move the tip, as far as the stage goes."""
        self.x, self.y = (
            float(np.clip(at, axis.min(), axis.max())) for at, axis in ((x, self.x_coords), (y, self.y_coords))
        )
        return True

    def scan_arbitrary_path(self, path_points: np.ndarray, channels: list[str] | None = None) -> np.ndarray:
        """The pixels nearest to points (x, y) of a path, over channel and point."""
        points = np.asarray(path_points)
        x, y = (
            np.abs(axis[:, None] - points[:, i]).argmin(axis=0) for i, axis in ((0, self.x_coords), (1, self.y_coords))
        )
        return self.get_scan(channels)[:, x, y]

    def get_spectrum(self, location: tuple[float, float] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] and the amplitude [m] over the pixel, over approach and retraction."""
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
