"""What does a soft cantilever show in liquid?

At a quality factor of 3 the oscillation decays within a period, the higher harmonics are large, and first-order
averaging fails. Here the cantilever is a point on a spring, whose phase hardly distinguishes a soft gel from one ten
times as stiff; the indentation does. The phase of a beam does, too: see the example of gel beside glass. It also
matters how the cantilever is driven: a shaker moves its base by a third of the amplitude, which the detector does not
see.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SOFT = pm.Material(modulus=30e6, adhesion=0.001, damping=0.05, poisson_ratio=0.48)
STIFF = pm.Material(modulus=300e6, adhesion=0.001, damping=0.02)
SETPOINTS = np.linspace(0.95, 0.5, 46)
WAYS = {"direct": "driven at the tip", "base": "driven by a shaker"}


def scope(excitation: str) -> pm.Microscope:
    """Give a lever of 0.1 N/m in water."""
    return pm.Microscope(
        pm.Cantilever(stiffness=0.1, resonance_frequency=10e3, quality_factor=3.0, participation=1),
        pm.Tip(radius=10e-9),
        pm.Drive(free_amplitude=10e-9, excitation=excitation),
        pm.Interaction(contact="dmt", decay_length=0.3e-9),
    )


def main(folder: Path = Path()) -> None:
    """Write soft_lever_in_liquid.png."""
    figure, panels = plt.subplots(1, 3, figsize=(12.5, 4.0), layout="constrained")
    for i, (excitation, words) in enumerate(WAYS.items()):
        for material, style, name in ((SOFT, "--", "30 MPa"), (STIFF, "-", "300 MPa")):
            pixels = [pm.solve_pixel(material, scope(excitation), setpoint) for setpoint in SETPOINTS]
            phases = [pixel.phase for pixel in pixels]
            panels[0].plot(SETPOINTS, phases, style, color=f"C{i}", label=f"{name}, {words}")
            depths = [1e9 * pixel.indentation for pixel in pixels]
            panels[1].plot(SETPOINTS, depths, style, color=f"C{i}")
            at = int(np.abs(SETPOINTS - 0.8).argmin())
            print(f"{name:>7}, {words:<18}: {phases[at]:5.1f} degrees at a setpoint of 0.8, {depths[at]:.1f} nm deep")
    panels[0].legend(frameon=False, fontsize=8)
    panels[0].set_ylabel("phase (degrees)")
    panels[1].set_ylabel("largest indentation (nm)")
    for axes in panels[:2]:
        axes.set_xlabel("setpoint (amplitude / free amplitude)")
        axes.set_xlim(1, SETPOINTS[-1])  # approaching: from left to right

    near = np.linspace(12e-9, 5e-9, 8)
    curve = pm.sweep_distance(STIFF, scope("direct"), near, samples=256).sel(direction="approach").isel(tip_offset=-1)
    panels[2].plot(curve.drive_phase, 1e9 * curve.trace_deflection, color="0.3")
    panels[2].set(xlabel="phase of the drive (degrees)", ylabel="position of the tip (nm)", title="one period, 300 MPa")
    force = panels[2].twinx()
    force.plot(curve.drive_phase, 1e9 * curve.trace_force, color="C3")
    force.set_ylabel("force (nN)", color="C3")
    figure.savefig(folder / "soft_lever_in_liquid.png", dpi=150)


if __name__ == "__main__":
    main()
