"""How does a tip of another shape change the phase? Your own contact law

A contact law is a class derived from `ContactLaw` with one formula, in plain Python. It is compiled on first use (about
a second, then cached on disk), and everything works with it: images, sweeps, exact orbits and their stability.
"""

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm
from phasemap import ContactLaw

HALF_ANGLE = math.radians(35)


class Cone(ContactLaw):
    """F = (2/pi) E* tan(a) d^2 (Sneddon 1965), a cone of half-angle a; E* = 3 K / 4. No adhesion."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        """Force [N] at indentation d [m]; p is K [Pa], the work of adhesion [J/m2] and the tip's radius [m]."""
        return 2 / math.pi * 0.75 * p[0] * math.tan(HALF_ANGLE) * d * d


def main(folder: Path = Path()) -> None:
    """Write custom_law.png."""
    moduli = np.geomspace(0.05e9, 20e9, 25)
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 3.8), layout="constrained")
    for law, label in ((Cone(), "cone of 35°"), ("hertz", "sphere of 10 nm (Hertz)")):
        scope = pm.Microscope(
            pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
            pm.Tip(radius=10e-9),
            pm.Drive(free_amplitude=40e-9),
            pm.Interaction(contact=law, decay_length=None),
        )
        strip = {i: pm.Material(modulus, damping=0.01) for i, modulus in enumerate(moduli)}
        surface = pm.Surface.from_labels(np.arange(len(moduli))[None, :], strip, pixel_size=1e-9)
        exact = pm.simulate(surface, scope, setpoint=0.7, solver="orbit", strict=True)
        panels[0].semilogx(moduli / 1e9, exact["phase"][0], label=label)
        panels[1].semilogx(moduli / 1e9, exact["indentation"][0] * 1e9)
        print(f"{label:<24} energy balance to {float(abs(exact['energy_closure']).max()):.0e}")
        if law == "hertz":
            continue
        for solver in ("averaging", "march", "auto"):
            image = pm.simulate(surface, scope, setpoint=0.7, solver=solver, strict=True)
            away = float(abs(image["phase"] - exact["phase"]).max())
            print(f"  {solver:<10} is at most {away:.0e}° from the exact orbit")
    for axes in panels:
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("modulus (GPa)")
    panels[0].set_ylabel("phase (degrees)")
    panels[0].legend(frameon=False)
    panels[1].set(ylabel="largest indentation (nm)", ylim=(0, None))
    figure.savefig(folder / "custom_law.png", dpi=150)


if __name__ == "__main__":
    main()
