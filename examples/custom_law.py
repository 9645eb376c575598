"""How does a tip of another shape change the phase? A contact law of one's own.

A contact law is a class with a name and four methods. Its formulas are plain Python, compiled on first use (about a
minute, then kept on disk); everything else, the exact orbit with its stability included, works with them unchanged.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm


@dataclass(frozen=True)
class Cone:
    """F = (2/pi) E* tan(a) d^2 (Sneddon 1965), a cone of half-angle a; E* = 3 K / 4. No adhesion."""

    name = "cone"
    half_angle: float = math.radians(35)

    def columns(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
        """p[0], the factor of d^2 [N/m2]."""
        return (2 / math.pi * 0.75 * contact_stiffness * math.tan(self.half_angle),)

    def pull(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> np.ndarray:
        """Attraction [N] where contact begins."""
        return 0.0 * adhesion

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        """Force [N] at indentation d [m]."""
        return p[0] * d * d

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        """dF/dd [N/m]."""
        return 2.0 * p[0] * d


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
        pixels = [
            pm.solve_pixel(pm.Material(modulus, damping=0.01), scope, 0.7, solver="orbit", strict=True)
            for modulus in moduli
        ]
        panels[0].semilogx(moduli / 1e9, [pixel.phase for pixel in pixels], label=label)
        panels[1].semilogx(moduli / 1e9, [pixel.indentation * 1e9 for pixel in pixels])
        print(f"{label:<24} closes energy to {max(abs(pixel.energy_closure) for pixel in pixels):.0e}")
    for axes in panels:
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("modulus (GPa)")
    panels[0].set_ylabel("phase (degrees)")
    panels[0].legend(frameon=False)
    panels[1].set(ylabel="largest indentation (nm)", ylim=(0, None))
    figure.savefig(folder / "custom_law.png", dpi=150)


if __name__ == "__main__":
    main()
