"""How thin must a film be for the phase to show what lies under it?

A wedge of a soft polymer on silicon, from 2 to 500 nm thick, once bonded to the wafer and once slipping on it. The
modulus of the polymer is the same everywhere: the contrast comes from the wafer, which the tip feels through the film.
On the right is the modulus that a half-space would need for the same phase, that is what one would read off such an
image without knowing about the film. Without adhesion there would be no contrast, because the loss tangent of a film is
that of its material however thin it is. Dotted lines mark films that are indented by more than 0.3 of their thickness,
where elasticity is no longer linear.
"""

import warnings
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

POLYMER = pm.Material(modulus=0.3e9, adhesion=0.05, damping=0.03, poisson_ratio=0.48)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=20e-9),
    pm.Interaction("film"),
)
SETPOINT, PIXELS = 0.8, 120
BASES = {"film": "stuck to the wafer", "slipping film": "slipping on it"}


def half_spaces() -> tuple[np.ndarray, np.ndarray]:
    """Moduli over that of the polymer, and the phases [degree] of half-spaces that have them."""
    moduli = POLYMER.modulus * np.geomspace(1, 2, 60)
    strip = {i: replace(POLYMER, modulus=modulus) for i, modulus in enumerate(moduli)}
    scope = replace(SCOPE, interaction=pm.Interaction("dmt"))
    row = pm.Surface.from_labels(np.arange(len(moduli))[None, :], strip, pixel_size=1e-9)
    return moduli / POLYMER.modulus, pm.simulate(row, scope, SETPOINT, strict=True).phase.values[0]


def main(folder: Path = Path()) -> None:
    """Write thin_film.png."""
    thickness = np.geomspace(2e-9, 500e-9, PIXELS)
    wedge = pm.Surface(
        POLYMER.modulus, POLYMER.adhesion, POLYMER.damping, poisson_ratio=POLYMER.poisson_ratio,
        thickness=np.broadcast_to(thickness, (4, PIXELS)), topography=np.broadcast_to(thickness, (4, PIXELS)),
        pixel_size=5e-9,
    )  # fmt: skip
    ratios, known = half_spaces()
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 3.8), layout="constrained")
    for contact, label in BASES.items():
        with warnings.catch_warnings():  # of films that are too thin, which are dotted
            warnings.simplefilter("ignore", pm.ResultWarning)
            image = pm.simulate(wedge, replace(SCOPE, interaction=pm.Interaction(contact)), SETPOINT, strict=True)
        phase, depth = image.phase.values[0], image.indentation.values[0]
        good = depth < 0.3 * thickness
        for axes, values in zip(panels, (phase, np.interp(phase, known, ratios)), strict=True):
            (line,) = axes.semilogx(thickness[good] * 1e9, values[good], label=label)
            axes.semilogx(thickness * 1e9, values, color=line.get_color(), linestyle=":", linewidth=1)
        seen = thickness[phase - known[0] > 1.0].max()
        print(f"{label}: the wafer changes the phase by more than a degree up to a thickness of {seen * 1e9:.0f} nm")
    for axes, name in zip(panels, ("phase (degrees)", "apparent over true modulus"), strict=True):
        axes.set(xlabel="thickness of the film (nm)", ylabel=name)
        axes.xaxis.set_major_formatter("{x:g}")
    panels[0].legend(frameon=False)
    panels[0].axhline(known[0], color="0.6", linewidth=0.8)
    panels[1].axhline(1.0, color="0.6", linewidth=0.8)
    figure.savefig(folder / "thin_film.png", dpi=150)


if __name__ == "__main__":
    main()
