"""How sharp is an edge between two materials in a phase image?

A tip touches and attracts an area, not a point. If every pixel is simulated by itself, a map that changes from one
pixel to the next gives an unrealistically sharp edge. `Surface.seen_by` makes the edge as wide as the contact, which
is wider on a softer sample.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import phasemap as pm

SOFT = pm.Material(modulus=0.2e9, adhesion=0.06, damping=0.03, poisson_ratio=0.45)
STIFF = pm.Material(modulus=3e9, adhesion=0.08, damping=0.005)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
)
PIXEL, SETPOINT, ROW = 1e-9, 0.7, 60


def main(folder: Path = Path()) -> None:
    """Write seen_by_tip.png."""
    labels = pm.generate.particles((128, 128), PIXEL, radius=14e-9, area_fraction=0.3, seed=2)
    sharp = pm.Surface.from_labels(labels, {0: SOFT, 1: STIFF}, pixel_size=PIXEL)
    surfaces = {"Points": sharp, "Seen by the tip": sharp.seen_by(SCOPE, SETPOINT)}
    images = {name: pm.simulate(surface, SCOPE, SETPOINT, variables=["phase"]) for name, surface in surfaces.items()}

    figure, panels = plt.subplots(1, 3, figsize=(12, 3.9), layout="constrained")
    low, high = float(images["Points"].phase.min()), float(images["Points"].phase.max())
    for axes, (name, image) in zip(panels[:2], images.items(), strict=True):
        shown = axes.imshow(image.phase, cmap="cividis", vmin=low, vmax=high, extent=(0, 128, 128, 0))
        axes.axhline(ROW + 0.5, color="white", linewidth=0.8, linestyle=":")
        axes.set(title=name, xlabel="x (nm)", ylabel="y (nm)")
    figure.colorbar(shown, ax=panels[:2], label="phase (degrees)")
    for name, image in images.items():
        panels[2].step(image.x * 1e9, image.phase[ROW], where="mid", label=name)
    panels[2].set(xlabel="x along the dotted line (nm)")
    panels[2].legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(folder / "seen_by_tip.png", dpi=150)
    steps = {name: float(abs(image.phase.diff("x")).max()) for name, image in images.items()}
    print(
        "largest step from pixel to pixel: " + ", ".join(f"{name} {step:.1f} degrees" for name, step in steps.items())
    )


if __name__ == "__main__":
    main()
