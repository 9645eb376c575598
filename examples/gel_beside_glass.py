"""Does the phase tell a gel from a glass in liquid?

A tap in liquid makes the second eigenmode of the cantilever ring, and the energy that it takes depends on how stiff the
sample is: Melcher, Carrasco, Xu, Carrascosa, Gomez-Herrero, Raman and de Pablo, PNAS 106, 13655 (2009). A model with
the first mode alone sees next to nothing of it. The samples here are elastic: what the drive supplies is lost in the
two modes, and the phase falls where the share of the second one rises.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

GEL, GLASS = pm.Material(modulus=10e6, poisson_ratio=0.3), pm.Material(modulus=1e9, poisson_ratio=0.3)
MODES = {"first mode alone": (), "two modes": (pm.Eigenmode(frequency_ratio=7.5, quality_factor=6.0),)}
SETPOINT, MODULUS = 0.8, np.geomspace(1e6, 3e9, 40)


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
    figure, panels = plt.subplots(2, 2, figsize=(9.0, 7.4), layout="constrained")
    low = min(float(image.phase.min()) for image in images.values())
    high = max(float(image.phase.max()) for image in images.values())
    for axes, (name, image) in zip(panels[0], images.items(), strict=True):
        drawn = axes.imshow(image.phase, vmin=low, vmax=high, cmap="cividis", extent=(0, 480, 480, 0))
        contrast = float(image.phase.max() - image.phase.min())
        axes.set(title=f"{name}\n{contrast:.1f} degrees from gel to glass", xlabel="x (nm)", ylabel="y (nm)")
        print(f"{name:>16}: {contrast:.2f} degrees between 10 MPa and 1 GPa")
    figure.colorbar(drawn, ax=panels[0], label="phase (degrees)", shrink=0.85)

    row, lost = pm.Surface(modulus=MODULUS[None], poisson_ratio=0.3, pixel_size=5e-9), "modal_dissipation_2"
    for name, modes in MODES.items():
        wanted = ["phase", "drive_energy", *[lost] * bool(modes)]
        known = pm.simulate(row, scope(modes), SETPOINT, variables=wanted).isel(y=0)
        panels[1, 0].semilogx(MODULUS, known.phase, label=name)
    share = 100 * known[lost] / known.drive_energy
    panels[1, 1].semilogx(MODULUS, share, color="C1")
    print(f"the second mode loses {share[0]:.1f} % of the energy on 1 MPa, and {share[-1]:.1f} % on 3 GPa")
    panels[1, 0].set(xlabel="modulus (Pa)", ylabel="phase (degrees)")
    panels[1, 0].legend(frameon=False)
    panels[1, 1].set(xlabel="modulus (Pa)", ylabel="energy lost in the second mode (%)")
    figure.savefig(folder / "gel_beside_glass.png", dpi=150)


if __name__ == "__main__":
    main()
