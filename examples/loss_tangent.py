"""How far is the loss tangent that an instrument shows from that of the material?

The formula that instruments use takes the whole virial as elastic. Adhesion adds an attraction to the virial, so that
the loss tangent comes out too large, the more so the stickier the sample and the gentler the tapping. With the energy
that the contact stores along the tap in its place it is that of the material, omega eta / (2 E*).
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

import phasemap as pm

MODULUS, VISCOSITY, POISSON_RATIO = 1e9, 20.0, 0.35
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
)
ADHESION = np.linspace(0.0, 0.1, 81)
SETPOINTS = np.linspace(0.95, 0.4, 56)
SHOWN = {0.95: "tab:red", 0.8: "tab:blue", 0.4: "tab:green"}


def of_material() -> float:
    """Loss tangent of the Kelvin-Voigt contact, omega eta / (2 E*)."""
    omega = 2 * np.pi * SCOPE.cantilever.resonance_frequency
    return omega * VISCOSITY * (1 - POISSON_RATIO**2) / (2 * MODULUS)


def maps() -> dict[str, np.ndarray]:
    """Loss tangents over that of the material, raw and corrected, over setpoint and adhesion."""
    # A sample whose adhesion grows along x, imaged at one setpoint after another.
    wedge = pm.Surface(
        modulus=MODULUS,
        adhesion=ADHESION[np.newaxis],
        viscosity=VISCOSITY,
        poisson_ratio=POISSON_RATIO,
        pixel_size=1e-9,
    )
    found: dict[str, list[np.ndarray]] = {"loss_tangent": [], "loss_tangent_corrected": []}
    for setpoint in SETPOINTS:
        image = pm.simulate(wedge, SCOPE, setpoint, variables=list(found))
        for name, rows in found.items():
            rows.append(image[name].values[0])
    return {name: np.array(rows) / of_material() for name, rows in found.items()}


def main(folder: Path = Path()) -> None:
    """Write loss_tangent.png."""
    found = maps()
    raw, corrected = found.values()
    at = int(np.argmin(np.abs(ADHESION - 0.06))), int(np.argmin(np.abs(SETPOINTS - 0.8)))
    times = f"{raw[at[::-1]]:.2f} times the material's, {corrected[at[::-1]]:.2f} times when corrected"
    print(f"adhesion 0.06 J/m2, setpoint 0.8: {times}")

    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.1), layout="constrained")
    shading = {"shading": "nearest", "rasterized": True}
    mesh = panels[0].pcolormesh(ADHESION, SETPOINTS, raw, cmap="viridis", norm=LogNorm(1, 2.5), **shading)
    levels = panels[0].contour(ADHESION, SETPOINTS, raw, [1.1, 1.2, 1.5, 2.0], colors="white", linewidths=0.9)
    panels[0].clabel(levels, fmt="%g", fontsize=8)
    figure.colorbar(mesh, ax=panels[0], label="over the material's", ticks=[1, 1.5, 2, 2.5], format="%g", extend="both")
    panels[0].set(title="Raw, by the instrument's formula", ylabel="setpoint (amplitude / free amplitude)")
    for setpoint, colour in SHOWN.items():
        line = int(np.argmin(np.abs(SETPOINTS - setpoint)))
        panels[1].plot(ADHESION, raw[line], color=colour, label=f"raw, setpoint {setpoint}")
        panels[1].plot(ADHESION, corrected[line], "--", color=colour)
    panels[1].plot([], [], "k--", label="corrected, all three")
    panels[1].set(title="Raw and corrected", ylabel="over the material's", xlim=(0.0, 0.1))
    panels[1].legend(frameon=False)
    for axes in panels:
        axes.set_xlabel("work of adhesion (J/m²)")
    figure.savefig(folder / "loss_tangent.png", dpi=150)


if __name__ == "__main__":
    main()
