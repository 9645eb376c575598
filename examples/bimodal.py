"""Which modulus does a bimodal image show?

AM-FM imaging drives a second mode with a small amplitude and reads a modulus from the shift of its frequency. The
formula that instruments use knows Hertz's contact only. Here the adhesion grows from left to right, in a blend of two
polymers that are otherwise the same all over: the modulus shown comes out too large, the more so the stickier and the
softer the sample.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(40.0, 300e3, 400.0, modes=(pm.Eigenmode(frequency_ratio=6.267, quality_factor=600.0),)),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9, second=pm.Mode(free_amplitude=0.1e-9)),
)
SIZE, PIXEL, SETPOINT, POISSON_RATIO = 96, 4e-9, 0.7, 0.35
SOFT, STIFF = 0.5e9, 3e9
ADHESION = np.linspace(0.0, 0.1, SIZE)


def main(folder: Path = Path()) -> None:
    """Write bimodal.png."""
    stiff = pm.generate.blend((SIZE, SIZE), PIXEL, spacing=80e-9, seed=7) == 0
    modulus, adhesion = np.where(stiff, STIFF, SOFT), np.broadcast_to(ADHESION, stiff.shape)
    surface = pm.Surface(modulus, adhesion=adhesion, viscosity=10.0, poisson_ratio=POISSON_RATIO, pixel_size=PIXEL)
    image = pm.simulate(surface, SCOPE, SETPOINT)
    true = modulus / (1 - POISSON_RATIO**2)
    shown = image.bimodal_modulus.values
    bias = shown / true

    figure, panels = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained", width_ratios=(1, 1, 1, 1.15))
    extent = (0, SIZE * PIXEL * 1e9, SIZE * PIXEL * 1e9, 0)
    most = max(float(shown.max()), float(true.max())) * 1e-9
    for axes, values, title in zip(panels, (true, shown), ("Of the material", "As AM-FM shows it"), strict=False):
        drawn = axes.imshow(values * 1e-9, cmap="cividis", vmin=0, vmax=most, extent=extent)
        axes.set(title=title, xlabel="x (nm)", ylabel="y (nm)")
    figure.colorbar(drawn, ax=panels[1], label="effective modulus (GPa)")
    drawn = panels[2].imshow(bias, cmap="viridis", vmin=1, extent=extent)
    panels[2].set(title="The one over the other", xlabel="x (nm)", ylabel="y (nm)")
    figure.colorbar(drawn, ax=panels[2], label="bias")
    for where, label in ((~stiff, f"{SOFT * 1e-9:g} GPa"), (stiff, f"{STIFF * 1e-9:g} GPa")):
        line = np.array([bias[where[:, i], i].mean() for i in range(SIZE)])
        panels[3].plot(ADHESION, line, label=label)
        print(f"{label}: {line[0]:.2f} times the modulus without adhesion, {line[-1]:.2f} times at 0.1 J/m2")
    panels[3].set(xlabel="work of adhesion (J/m²)", ylabel="bias")
    panels[3].legend(frameon=False)
    figure.savefig(folder / "bimodal.png", dpi=150)


if __name__ == "__main__":
    main()
