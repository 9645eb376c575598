"""Which orbits are there at a setpoint, and on which one does the microscope end?

At small free amplitudes the tip can oscillate in several ways with the same amplitude: attractive or repulsive, stable
or not. `phasemap.orbits` finds them all; `phasemap.solve_pixel` says which one the controller meets when it approaches
from far.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

MATERIAL = pm.Material(modulus=2e9, adhesion=0.1, damping=0.005)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=15e-9),
)
KINDS = {
    "attractive, stable": ("C0", 0, 1),
    "repulsive, stable": ("C3", 1, 1),
    "unstable": ("0.6", None, 0),
}


def main(folder: Path = Path()) -> None:
    """Write all_orbits.png."""
    setpoints = np.linspace(0.98, 0.2, 157)
    found = [pm.orbits(MATERIAL, SCOPE, setpoint=setpoint) for setpoint in setpoints]
    engaged = [pm.solve_pixel(MATERIAL, SCOPE, setpoint, solver="orbit") for setpoint in setpoints]

    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for axes, name, factor, label in (
        (panels[0], "phase", 1, "phase (degrees)"),
        (panels[1], "height", 1e9, "height (nm)"),
    ):
        axes.plot(
            setpoints,
            [getattr(pixel, name) * factor for pixel in engaged],
            color="#f2c14e",
            linestyle="none",
            marker="s",
            markersize=7,
            label="where the tip ends, coming from far",
        )
        for kind, (color, branch, stable) in KINDS.items():
            points = [
                (setpoint, value * factor)
                for setpoint, orbits in zip(setpoints, found, strict=True)
                for value, b, s in zip(orbits[name].values, orbits.branch.values, orbits.stable.values, strict=True)
                if s == stable and branch in (None, b)
            ]
            axes.plot(*np.transpose(points), color=color, linestyle="none", marker=".", markersize=4, label=kind)
        axes.set(xlabel="setpoint (amplitude / free amplitude)", ylabel=label)
        axes.set_xlim(1, setpoints[-1])  # approaching: from left to right
    panels[0].legend(frameon=False, fontsize=9)
    figure.savefig(folder / "all_orbits.png", dpi=150)

    counts = [orbits.sizes["orbit"] for orbits in found]
    jump = next(setpoint for setpoint, pixel in zip(setpoints, engaged, strict=True) if pixel.branch == "repulsive")
    print(f"{min(counts)} to {max(counts)} orbits at a setpoint; the tip jumps to the repulsive one at {jump:.3f}")


if __name__ == "__main__":
    main()
