"""What does the damping of the sample do to the phase?

Without damping the phase is determined by the setpoint alone, up to its sign, whatever the surface is. With increasing
damping the phase decreases, and the modulus begins to matter: the softer the material, the deeper the tip sinks in, and
the more energy is dissipated.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
)
POLYMER = pm.Material(modulus=1e9, adhesion=0.05)
SETPOINTS = np.linspace(0.97, 0.3, 68)
DAMPINGS = (0.0, 0.01, 0.03, 0.1, 0.3)  # alpha1
MODULI = np.geomspace(0.05e9, 20e9, 40)
SETPOINT = 0.7
ELECTRONVOLT = 1.602e-19


def main(folder: Path = Path()) -> None:
    """Write what_damping_does.png."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12.5, 4.0), layout="constrained")
    for i, damping in enumerate(DAMPINGS):
        material = replace(POLYMER, damping=damping)
        pixels = [pm.solve_pixel(material, SCOPE, setpoint) for setpoint in SETPOINTS]
        label, color = f"{damping:g}", plt.colormaps["viridis"](i / len(DAMPINGS))
        left.plot(SETPOINTS, [pixel.phase for pixel in pixels], color=color, label=label)
        middle.plot(SETPOINTS, [pixel.dissipation / ELECTRONVOLT for pixel in pixels], color=color)

        strip = {j: replace(material, modulus=modulus) for j, modulus in enumerate(MODULI)}
        surface = pm.Surface.from_labels(np.arange(len(MODULI))[None, :], strip, pixel_size=1e-9)
        phases = pm.simulate(surface, SCOPE, SETPOINT).phase.values[0]
        right.semilogx(MODULI / 1e9, phases, color=color)
        print(f"damping {damping:4g}: from {MODULI[0] / 1e9:g} to {MODULI[-1] / 1e9:g} GPa the phase rises by "
              f"{phases[-1] - phases[0]:5.1f} degrees")  # fmt: skip
    for axes in (left, middle):
        axes.set_xlabel("setpoint (amplitude / free amplitude)")
        axes.set_xlim(1, SETPOINTS[-1])  # approaching: from left to right
    left.set(ylabel="phase (degrees)", title="1 GPa")
    left.legend(title="damping alpha1", frameon=False)
    middle.set(ylabel="energy into the surface (eV per cycle)", title="1 GPa")
    right.set(xlabel="modulus (GPa)", ylabel="phase (degrees)", title=f"setpoint {SETPOINT:g}")
    right.xaxis.set_major_formatter("{x:g}")
    figure.savefig(folder / "what_damping_does.png", dpi=150)


if __name__ == "__main__":
    main()
