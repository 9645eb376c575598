"""Which orbits exist at a setpoint, and which one does the tip reach?

At small free amplitudes the tip can oscillate in several ways with the same amplitude: attractive or repulsive, stable
or unstable. `phasemap.orbits` finds them all; `phasemap.solve_pixel` says which one the tip reaches when it approaches
from far away. The attractive orbits that reappear at low setpoints form an isolated branch that this tip never reaches.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

MATERIAL = pm.Material(modulus=2e9, adhesion=0.1, damping=0.005)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=16e-9),
)
SETPOINTS = np.linspace(0.99, 0.2, 159)
KINDS = {  # colour, branch, stable
    "attractive, stable": ("C0", 0, 1),
    "repulsive, stable": ("C3", 1, 1),
    "unstable": ("0.6", None, 0),
}


def main(folder: Path = Path()) -> None:
    """Write all_orbits.png."""
    found = [pm.orbits(MATERIAL, SCOPE, setpoint=setpoint) for setpoint in SETPOINTS]
    engaged = [pm.solve_pixel(MATERIAL, SCOPE, setpoint, solver="orbit") for setpoint in SETPOINTS]

    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for axes, name, factor, label in (
        (panels[0], "phase", 1, "phase (degrees)"),
        (panels[1], "height", 1e9, "height (nm)"),
    ):
        for branch in ("attractive", "repulsive"):
            values = [getattr(pixel, name) * factor if pixel.branch == branch else np.nan for pixel in engaged]
            said = "where the tip ends, coming from far" if branch == "attractive" else None
            axes.plot(SETPOINTS, values, color="#f2c14e", linewidth=8, solid_capstyle="round", label=said)
        for kind, (color, branch, stable) in KINDS.items():
            points = [
                (setpoint, value * factor)
                for setpoint, orbits in zip(SETPOINTS, found, strict=True)
                for value, b, s in zip(orbits[name].values, orbits.branch.values, orbits.stable.values, strict=True)
                if s == stable and branch in (None, b)
            ]
            axes.plot(*np.transpose(points), color=color, linestyle="none", marker=".", markersize=4, label=kind)
        axes.set(xlabel="setpoint (amplitude / free amplitude)", ylabel=label)
        axes.set_xlim(1, SETPOINTS[-1])  # approaching: from left to right
    panels[0].legend(frameon=False, fontsize=9, loc="center right")
    figure.savefig(folder / "all_orbits.png", dpi=150)

    jump = next(setpoint for setpoint, pixel in zip(SETPOINTS, engaged, strict=True) if pixel.branch == "repulsive")
    print(f"the tip is in the repulsive regime from setpoint {jump:.3f} downwards")


if __name__ == "__main__":
    main()
