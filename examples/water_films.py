"""What does humidity do to a phase image?

Where films of water on tip and sample meet they draw a neck, which pulls until it breaks farther out. The tip needs a
larger swing to come through to the repulsive regime: the critical free amplitude, from which on it ends repulsive at
the setpoint, rises with humidity by 9 nm on a hydrophilic sample, and by 1 nm on a hydrophobic one, on which no water
spreads. Zitzler, Herminghaus and Mugele (Phys. Rev. B 66, 155436 (2002)) measured that it rises on the one and saw no
change on the other. That necks pull in dry air already is a limit of the model: they do in contact, however thin the
films are. A tip that water wets completely (``TIP_ANGLE = 0``) makes 12 and 4 nm of these rises.

Between the critical amplitudes of dry and of humid air patches of both kinds hardly differ at 20 %, where the tip is
repulsive on both; at 90 % it is attractive where water spreads.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=20e-9),
    pm.Drive(free_amplitude=29e-9),
    pm.Interaction(decay_length=0.2e-9),
)
TIP_ANGLE = 60.0  # degrees, of a tip that has been in air
SETPOINT = 0.8
SAMPLES = {
    "hydrophilic": pm.Material(70e9, adhesion=0.03, contact_angle=14.0),
    "hydrophobic": pm.Material(70e9, adhesion=0.03, contact_angle=110.0, liquid_film=0.0),
}
HUMIDITIES = np.linspace(0.1, 0.95, 9)
SHOWN = (0.2, 0.9)


def at_humidity(humidity: float) -> pm.Microscope:
    """The microscope in this air."""
    law = pm.interaction.Capillary(humidity=humidity, tip_angle=TIP_ANGLE)
    return replace(SCOPE, interaction=replace(SCOPE.interaction, contact=law))


def critical_amplitude(sample: pm.Material, scope: pm.Microscope, low: float = 4e-9, high: float = 60e-9) -> float:
    """Free amplitude [m], to a per cent, from which on the tip ends repulsive; by halving on a scale of logarithms."""
    while high / low > 1.01:
        middle = (low * high) ** 0.5
        if pm.solve_pixel(sample, replace(scope, drive=pm.Drive(middle)), SETPOINT).branch == "repulsive":
            high = middle
        else:
            low = middle
    return high


def main(folder: Path = Path()) -> None:
    """Write water_films.png."""
    figure, panels = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained", width_ratios=(1.25, 1, 1))
    axes = panels[0]
    for name, sample in SAMPLES.items():
        critical = [1e9 * critical_amplitude(sample, at_humidity(humidity)) for humidity in HUMIDITIES]
        axes.plot(100 * HUMIDITIES, critical, "o-", label=name)
        print(f"{name}: from {critical[0]:.1f} to {critical[-1]:.1f} nm")
    axes.axhline(1e9 * SCOPE.drive.free_amplitude, color="0.6", linestyle=":", label="of the images")
    axes.set(xlabel="relative humidity (%)", ylabel="critical free amplitude (nm)", ylim=(0, None))
    axes.legend(frameon=False)

    shape, pixel = (96, 96), 4e-9
    patches = pm.generate.blend(shape, pixel, spacing=120e-9, fraction=0.5, seed=2)
    surface = pm.Surface.from_labels(patches, list(SAMPLES.values()), pixel_size=pixel)
    for axes, humidity in zip(panels[1:], SHOWN, strict=True):
        phase = pm.simulate(surface, at_humidity(humidity), SETPOINT, strict=True).phase
        means = [float(phase.where(patches == i).mean()) for i in range(len(SAMPLES))]
        print(f"{humidity:.0%}: " + ", ".join(f"{name} {mean:.1f}" for name, mean in zip(SAMPLES, means, strict=True)))
        picture = axes.imshow(phase, cmap="cividis", vmin=-40, vmax=40, extent=(0, 384, 384, 0))
        axes.set(title=f"phase at {humidity:.0%}: {means[0]:.1f} and {means[1]:.1f}", xlabel="nm", yticks=[])
    figure.colorbar(picture, ax=panels[1:], label="degrees", shrink=0.8)
    figure.savefig(folder / "water_films.png", dpi=150)


if __name__ == "__main__":
    main()
