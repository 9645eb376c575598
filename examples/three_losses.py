"""How does a tip lose its energy: in the attraction, by adhesion, or in the bulk?

Dissipation per cycle against the amplitude, over its largest value, has another shape for each process (Garcia et al.,
Phys. Rev. Lett. 97, 016103 (2006)). A loss outside contact is largest where the tip hardly touches, at 0.9 of the free
amplitude, and then falls with the tip's velocity. Adhesion that is larger on the way out takes energy in proportion to
the depth, which hardly changes: it has a broad maximum near a half, and three quarters of it are left at a tenth of the
free amplitude. Viscosity in the bulk goes with depth and velocity: it rises steeply to a maximum at 0.7, and falls to a
fifth. So a series of setpoints tells the process, where a single phase could be any.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=30.0, resonance_frequency=300e3, quality_factor=200.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=30e-9),
)
POLYMER = pm.Material(modulus=1e9, adhesion=0.02)
VISCOUS = replace(POLYMER, viscosity=60.0)
LossyDMT = pm.interaction.LossyDMT
PROCESSES = {
    "loss outside contact": (POLYMER, LossyDMT(outer_loss=1e-7, outer_length=1.5e-9)),
    "adhesion hysteresis": (POLYMER, LossyDMT(adhesion_ratio=2.0)),
    "viscosity": (VISCOUS, "dmt"),
}
SETPOINTS = np.linspace(0.985, 0.1, 60)
ELECTRONVOLT = 1.602e-19


def dissipations(material: pm.Material, contact: object) -> np.ndarray:
    """Energy [eV] that the sample takes in a cycle, at each setpoint."""
    scope = replace(SCOPE, interaction=pm.Interaction(contact))
    return np.array([pm.solve_pixel(material, scope, one).dissipation for one in SETPOINTS]) / ELECTRONVOLT


def main(folder: Path = Path()) -> None:
    """Write three_losses.png."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.8), layout="constrained")
    for name, (material, contact) in PROCESSES.items():
        lost = dissipations(material, contact)
        left.plot(SETPOINTS, lost, label=name)
        right.plot(SETPOINTS, lost / np.nanmax(lost), label=name)
        print(f"{name}: {np.nanmax(lost):.0f} eV at {SETPOINTS[np.nanargmax(lost)]:.2f} of the free amplitude")
    left.set(xlabel="amplitude over free amplitude", ylabel="dissipation (eV per cycle)", ylim=(0, None))
    right.set(xlabel="amplitude over free amplitude", ylabel="dissipation over its maximum", ylim=(0, 1.05))
    right.legend(frameon=False)
    figure.savefig(folder / "three_losses.png", dpi=150)


if __name__ == "__main__":
    main()
