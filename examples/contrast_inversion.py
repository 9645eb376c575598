"""Why does the contrast of a phase image invert when one taps harder?

Stiff, sticky particles in a soft, lossy matrix. With gentle tapping, the tip is in the attractive regime on the
particles, where the phase is negative, and in the repulsive regime on the matrix: the particles are dark. At a lower
setpoint both are in the repulsive regime, and the contrast comes from dissipation: the particles are bright.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

PARTICLE = pm.Material(modulus=3e9, adhesion=0.15, damping=0.005)
MATRIX = pm.Material(modulus=0.5e9, adhesion=0.02, damping=0.02, poisson_ratio=0.48)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=25e-9),
)
GENTLE, HARD = 0.92, 0.7


def phases(material: pm.Material, setpoints: np.ndarray) -> np.ndarray:
    """Phase [degree] at each setpoint."""
    return np.array([pm.solve_pixel(material, SCOPE, setpoint).phase for setpoint in setpoints])


def main(folder: Path = Path()) -> None:
    """Write contrast_inversion.png."""
    setpoints = np.linspace(0.985, 0.4, 235)
    particle, matrix = phases(PARTICLE, setpoints), phases(MATRIX, setpoints)
    contrast = particle - matrix
    jump = int(np.flatnonzero(np.diff(np.sign(contrast)))[-1]) + 1
    print(f"the contrast inverts at a setpoint of {setpoints[jump]:.3f}")

    labels = pm.generate.particles((128, 128), 4e-9, radius=45e-9, area_fraction=0.35, seed=4)
    surface = pm.Surface.from_labels(labels, {0: MATRIX, 1: PARTICLE}, pixel_size=4e-9)

    figure = plt.figure(figsize=(9.5, 5.2), layout="constrained")
    panels = figure.subplot_mosaic([["phase", "gentle"], ["contrast", "hard"]], width_ratios=[2.1, 1])
    parts = slice(None, jump), slice(jump, None)  # a line must not bridge the jump between the regimes
    axes = panels["phase"]
    axes.plot(setpoints, matrix, color="C0", label="matrix")
    for part, label in zip(parts, ("particle", None), strict=True):
        axes.plot(setpoints[part], particle[part], color="C1", label=label)
    axes.set(ylabel="phase (degrees)", title="Phase over each material")
    axes.legend(frameon=False, loc="lower right")

    axes = panels["contrast"]
    for part, label in zip(parts, ("particles dark", "particles bright"), strict=True):
        color = "#00224e" if label == "particles dark" else "#e6c800"
        axes.fill_between(setpoints[part], contrast[part], color=color, alpha=0.5, linewidth=0, label=label)
        axes.plot(setpoints[part], contrast[part], color="0.2", linewidth=1)
    axes.set(
        xlabel="setpoint (amplitude / free amplitude)", ylabel="difference (degrees)", title="Particle minus matrix"
    )
    axes.legend(frameon=False, loc="lower right")

    for name, setpoint in {"gentle": GENTLE, "hard": HARD}.items():
        for panel in ("phase", "contrast"):
            panels[panel].axvline(setpoint, color="0.5", linestyle=":", linewidth=1)
        image = pm.simulate(surface, SCOPE, setpoint)
        picture = panels[name].imshow(image.phase, cmap="cividis")
        panels[name].set(xticks=[], yticks=[], title=f"setpoint {setpoint:g}")
        figure.colorbar(picture, ax=panels[name], label="phase (degrees)", shrink=0.9)
    for panel in ("phase", "contrast"):
        panels[panel].axhline(0, color="0.7", linewidth=0.8, zorder=0)
        panels[panel].set_xlim(setpoints[0], setpoints[-1])  # approaching: from left to right
    figure.savefig(folder / "contrast_inversion.png", dpi=150)


if __name__ == "__main__":
    main()
