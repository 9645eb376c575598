"""What does scanning faster do to an image?

Stiff particles that stand out of a soft matrix, at three line rates. The feedback lags behind at every edge. Uphill the
amplitude is too small and the tip presses harder; downhill it is too large and the tip taps less, or not at all, for a
while. Both show in the phase although the material does not change there.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
)
MATRIX = pm.Material(modulus=0.5e9, adhesion=0.03, damping=0.02)
PARTICLE = pm.Material(modulus=3e9, adhesion=0.03, damping=0.004)
SIZE, PIXEL = (96, 96), 5e-9
LABELS = pm.generate.particles(SIZE, PIXEL, radius=40e-9, area_fraction=0.3, seed=4)
RELIEF = 8e-9 * LABELS + pm.generate.roughness(SIZE, PIXEL, rms=0.2e-9, correlation_length=30e-9, seed=3)
LINE_RATES = 0.5, 2.0, 8.0  # Hz
SETPOINT = 0.7


def main(folder: Path = Path()) -> None:
    """Write scan_faster.png."""
    surface = pm.Surface.from_labels(LABELS, {0: MATRIX, 1: PARTICLE}, pixel_size=PIXEL, topography=RELIEF)
    images = [pm.simulate(surface, SCOPE, SETPOINT, control=pm.Feedback(line_rate=rate)) for rate in LINE_RATES]
    error = max(float(np.abs(image.amplitude_error.values).max()) for image in images) * 1e9

    figure, panels = plt.subplots(3, 3, figsize=(10.0, 9.2), layout="constrained")
    for column, (rate, image) in zip(panels.T, zip(LINE_RATES, images, strict=True), strict=True):
        trace = image.sel(direction="trace")
        height = 1e9 * (trace.height - float(images[0].height.median()))
        for axes, values, cmap, limits in (
            (column[0], height, "afmhot", (-2, 12)),
            (column[1], 1e9 * trace.amplitude_error, "RdBu_r", (-error, error)),
            (column[2], trace.phase, "cividis", (10, 60)),
        ):
            picture = axes.imshow(values, cmap=cmap, vmin=limits[0], vmax=limits[1], interpolation="nearest")
            axes.set(xticks=[], yticks=[])
            if rate == LINE_RATES[-1]:
                figure.colorbar(picture, ax=axes, shrink=0.9)
        column[0].set_title(f"line rate {rate:g} Hz")
        wrong = float(np.sqrt((trace.amplitude_error**2).mean())) * 1e9
        print(f"{rate:3g} Hz: root-mean-square error of the amplitude {wrong:.2f} nm")
    for axes, label in zip(panels[:, 0], ("height (nm)", "amplitude error (nm)", "phase (degrees)"), strict=True):
        axes.set_ylabel(label)
    figure.savefig(folder / "scan_faster.png", dpi=150)


if __name__ == "__main__":
    main()
