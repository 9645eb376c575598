"""Does the phase tell a gel from a glass in liquid?

A tap in liquid makes the second eigenmode of the cantilever ring, and the energy that it takes depends on how stiff the
sample is: Melcher, Carrasco, Xu, Carrascosa, Gomez-Herrero, Raman and de Pablo, PNAS 106, 13655 (2009). A model with
the first mode alone sees next to nothing of it.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

GEL, GLASS = pm.Material(modulus=10e6, poisson_ratio=0.3), pm.Material(modulus=1e9, poisson_ratio=0.3)
MODES = {"first mode alone": (), "two modes": (pm.Eigenmode(frequency_ratio=7.5, quality_factor=6.0),)}
SETPOINT = 0.8


def scope(modes: tuple[pm.Eigenmode, ...]) -> pm.Microscope:
    """Give a lever of 0.1 N/m in water, driven by a shaker."""
    return pm.Microscope(
        pm.Cantilever(stiffness=0.1, resonance_frequency=20e3, quality_factor=2.5, modes=modes),
        pm.Tip(radius=10e-9, modulus=130e9, poisson_ratio=0.27),
        pm.Drive(free_amplitude=10e-9, excitation="base"),
        pm.Interaction(contact="hertz", decay_length=None),
    )


def main(folder: Path = Path()) -> None:
    """Write gel_beside_glass.png."""
    labels = np.zeros((96, 96), int)
    rows, columns = np.mgrid[:96, :96]
    for y, x, radius in ((30, 28, 16), (62, 66, 21), (20, 74, 11), (80, 22, 10)):
        labels[(rows - y) ** 2 + (columns - x) ** 2 < radius**2] = 1
    surface = pm.Surface.from_labels(labels, {0: GEL, 1: GLASS}, pixel_size=5e-9)
    images = {name: pm.simulate(surface, scope(modes), SETPOINT) for name, modes in MODES.items()}
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.0), layout="constrained")
    low = min(float(image.phase.min()) for image in images.values())
    high = max(float(image.phase.max()) for image in images.values())
    for axes, (name, image) in zip(panels, images.items(), strict=True):
        drawn = axes.imshow(image.phase, vmin=low, vmax=high, cmap="cividis", extent=(0, 480, 480, 0))
        contrast = float(image.phase.max() - image.phase.min())
        axes.set(title=f"{name}\n{contrast:.1f} degrees from gel to glass", xlabel="x (nm)", ylabel="y (nm)")
        print(f"{name:>16}: {contrast:.2f} degrees between 10 MPa and 1 GPa")
    figure.colorbar(drawn, ax=panels, label="phase (degrees)", shrink=0.85)
    figure.savefig(folder / "gel_beside_glass.png", dpi=150)


if __name__ == "__main__":
    main()
