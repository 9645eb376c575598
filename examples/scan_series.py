"""What does contrast inversion look like in a scan?

A soft, lossy matrix with stiff domains on which the tip can oscillate in two ways. With gentle tapping both are in the
attractive regime. At a low setpoint the domains are in the repulsive regime, and the phases have opposite signs. In
between, the result depends on how the tip gets there: engaged on a domain it stays attractive, but an edge may switch
it to the other branch, on one line and not on the next. This gives streaks, which change with the line rate.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patheffects import withStroke

import phasemap as pm

MATRIX = pm.Material(modulus=0.5e9, adhesion=0.1, damping=0.1, poisson_ratio=0.48)
DOMAIN = pm.Material(modulus=3e9, adhesion=0.15, damping=0.005)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=20e-9),
)
SETPOINTS = 0.9, 0.8, 0.65
LINE_RATES = 1.0, 4.0, 12.0  # Hz
SIZE, PIXEL = (96, 96), 4e-9
LABELS = pm.generate.blend(SIZE, PIXEL, spacing=120e-9, fraction=0.45, seed=7)
RELIEF = pm.generate.roughness(SIZE, PIXEL, rms=1e-9, correlation_length=40e-9, seed=3)


def main(folder: Path = Path()) -> None:
    """Write scan_series.png."""
    surface = pm.Surface.from_labels(LABELS, {0: MATRIX, 1: DOMAIN}, pixel_size=PIXEL, topography=RELIEF)
    figure, panels = plt.subplots(3, 3, figsize=(8.6, 8.4), layout="constrained")
    for row, setpoint in zip(panels, SETPOINTS, strict=True):
        for axes, rate in zip(row, LINE_RATES, strict=True):
            image = pm.simulate(surface, SCOPE, setpoint, control=pm.Feedback(line_rate=rate))
            trace, retrace = image.phase.values
            shares = [np.mean(phase[LABELS == 1] > 0) for phase in (trace, retrace)]
            print(f"setpoint {setpoint:4g}, {rate:2g} Hz: of the domains {shares[0]:5.1%} are repulsive in trace, "
                  f"{shares[1]:5.1%} in retrace")  # fmt: skip
            picture = axes.imshow(trace, cmap="cividis", vmin=-55, vmax=55, interpolation="nearest")
            axes.contour(LABELS, [0.5], colors="k", linewidths=0.5, alpha=0.6)
            axes.set(xticks=[], yticks=[], title=f"setpoint {setpoint:g}, {rate:g} Hz")
    bar = 100e-9 / PIXEL
    axes = panels[0, 0]
    white = [withStroke(linewidth=4, foreground="white")]
    axes.plot([6, 6 + bar], [89, 89], color="k", linewidth=3, solid_capstyle="butt", path_effects=white)
    axes.text(6 + bar / 2, 87, "100 nm", ha="center", va="bottom", fontsize=9, path_effects=white)
    figure.colorbar(picture, ax=panels, label="phase of the trace (degrees): attractive below 0, repulsive above",
                    shrink=0.6)  # fmt: skip
    figure.savefig(folder / "scan_series.png", dpi=150)


if __name__ == "__main__":
    main()
