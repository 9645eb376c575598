"""What does a series of setpoints show?

The same place at four setpoints, from gentle to hard tapping. Sticky rubber in a matrix, on a surface without steps.
With gentle tapping the rubber appears higher; then it disappears in the height; with hard tapping it appears lower,
because the tip sinks in. Its phase changes sign, because the rubber leaves the attractive regime later than the
matrix.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=25e-9),
)
MATRIX = pm.Material(modulus=2e9, adhesion=0.05, damping=0.005)
RUBBER = pm.Material(modulus=0.3e9, adhesion=0.1, damping=0.03, poisson_ratio=0.48)
SIZE, PIXEL = (128, 128), 4e-9
LABELS = pm.generate.blend(SIZE, PIXEL, spacing=130e-9, fraction=0.4, seed=11)
RELIEF = pm.generate.roughness(SIZE, PIXEL, rms=0.5e-9, correlation_length=50e-9, seed=2)
SETPOINTS = 0.95, 0.85, 0.75, 0.6


def main(folder: Path = Path()) -> None:
    """Write setpoint_series.png."""
    surface = pm.Surface.from_labels(LABELS, {0: MATRIX, 1: RUBBER}, pixel_size=PIXEL, topography=RELIEF)
    figure, panels = plt.subplots(2, len(SETPOINTS), figsize=(12.0, 5.8), layout="constrained")
    for column, setpoint in zip(panels.T, SETPOINTS, strict=True):
        image = pm.simulate(surface, SCOPE, setpoint)
        height = 1e9 * (image.height - image.height.median())
        for axes, values, cmap, reach in ((column[0], height, "afmhot", 5), (column[1], image.phase, "cividis", 60)):
            picture = axes.imshow(values, cmap=cmap, vmin=-reach, vmax=reach, interpolation="nearest")
            axes.set(xticks=[], yticks=[])
            if setpoint == SETPOINTS[-1]:
                label = "height (nm)" if axes is column[0] else "phase (degrees)"
                figure.colorbar(picture, ax=axes, label=label, shrink=0.9)
        column[0].set_title(f"setpoint {setpoint:g}")
        rubber, matrix = image.where(LABELS == 1), image.where(LABELS == 0)
        step = 1e9 * float(rubber.tip_offset.mean() - matrix.tip_offset.mean())
        print(f"setpoint {setpoint:4g}: rubber {float(rubber.phase.mean()):6.1f} degrees, matrix "
              f"{float(matrix.phase.mean()):5.1f}; rubber seems to be {step:5.2f} nm higher")  # fmt: skip
    figure.savefig(folder / "setpoint_series.png", dpi=150)


if __name__ == "__main__":
    main()
