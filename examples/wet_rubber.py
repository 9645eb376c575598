"""What do a film of water on a rubber, and a stiff base below it, do to its phase?

An elastic solid loses what its necks lose, 16 eV a cycle and less than one degree of phase here. On a rubber the same
film of water takes five to eight degrees: water pulls the tip in by 4 pi R gamma, at the setpoint 0.7 to 6.0 nm in
place of 4.4, and the rubber loses 370 eV in place of 230. A base 10 nm below a thin film of the rubber holds the tip
up, and raises its phase by one to three degrees. Below the elastic solid it does nothing, for at one amplitude a phase
tells losses only.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=200.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=30e-9),
)
SETPOINTS = np.linspace(0.4, 0.92, 14)
SOLIDS = {
    "elastic": pm.Material("1 GPa", adhesion=0.05, poisson_ratio=0.45),
    "rubber": pm.Material(
        "1 GPa", adhesion=0.05, poisson_ratio=0.45, relaxed_modulus="0.3 GPa", relaxation_time="100 ns"
    ),
}
PLACES = {
    "dry": ("dmt", {}, "-"),
    "under 1 nm of water": ("capillary", {"liquid_film": 1e-9}, "--"),
    "10 nm on a rigid base": ("film", {"thickness": 10e-9}, ":"),
}


def phases(solid: str, place: str) -> np.ndarray:
    """Phase [degree] at each setpoint."""
    contact, more, _ = PLACES[place]
    scope = replace(SCOPE, interaction=pm.Interaction(contact))
    return np.array([float(pm.solve_pixel(replace(SOLIDS[solid], **more), scope, one).phase) for one in SETPOINTS])


def main(folder: Path = Path()) -> None:
    """Write wet_rubber.png."""
    figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    for solid, colour in zip(SOLIDS, ("0.45", "tab:blue"), strict=True):
        dry = phases(solid, "dry")
        for place, (_, _, line) in PLACES.items():
            found = dry if place == "dry" else phases(solid, place)
            axes.plot(SETPOINTS, found, line, color=colour, label=f"{solid}, {place}")
            print(f"{solid}, {place}: {(found - dry).min():.2f} to {(found - dry).max():.2f} degrees from dry")
    axes.set(xlabel="setpoint", ylabel="phase (degrees)")
    axes.legend(frameon=False)
    figure.savefig(folder / "wet_rubber.png", dpi=150)


if __name__ == "__main__":
    main()
