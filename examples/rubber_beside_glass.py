"""What does phase imaging show on rubber that the tip sticks to?

Rubber and glass side by side, tapped with a soft cantilever. The contact is JKR: it forms at the surface and breaks
only farther out. On glass the tip taps in every period. On soft rubber it sticks in some periods and not in others,
over many nanometres of approach, and never reaches a periodic orbit; on rubber that is cured harder, to the right of
the image, it does. Amplitude and phase at the output of the lock-in are steady all the same: they are means, with a
spread of a few hundredths of a degree.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import phasemap as pm

RUBBER = pm.Material(modulus=30e6, adhesion=0.05, damping=0.01)
GLASS = pm.Material(modulus=3e9, adhesion=0.05, damping=0.01)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=3.0, resonance_frequency=300e3, quality_factor=200.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
    pm.Interaction(contact="jkr", decay_length=0.3e-9),
)
SETPOINT = 0.6
SHAPE, PIXEL = (128, 128), 4e-9
DOMAINS = pm.generate.blend(SHAPE, PIXEL, spacing=140e-9, fraction=0.55, seed=5) == 1  # of rubber
GRADES = np.geomspace(15e6, 120e6, 32)  # modulus of the rubber from left to right [Pa]
RELIEF = pm.generate.roughness(SHAPE, PIXEL, rms=0.1e-9, correlation_length=40e-9, seed=3)
OFFSETS = np.linspace(42e-9, 12e-9, 61)


def draw_map(axes: plt.Axes, values: xr.DataArray, title: str, cmap: str) -> None:
    """Draw one quantity in colours."""
    reach = 1e9 * PIXEL * np.array(SHAPE[::-1])
    picture = axes.imshow(values, cmap=cmap, extent=(0, reach[0], reach[1], 0), interpolation="nearest")
    axes.set(xlabel="nm", yticks=[])
    axes.set_title(title, fontsize=11)
    axes.figure.colorbar(picture, ax=axes, shrink=0.9)


def main(folder: Path = Path()) -> None:
    """Write rubber_beside_glass.png."""
    modulus = np.where(DOMAINS, np.repeat(GRADES, SHAPE[1] // len(GRADES)), GLASS.modulus)
    surface = pm.Surface(modulus, RUBBER.adhesion, RUBBER.damping, topography=RELIEF, pixel_size=PIXEL)
    image = pm.simulate(surface, SCOPE, SETPOINT)
    irregular = image.motion == 1

    for name, here in {"rubber": DOMAINS, "glass": ~DOMAINS}.items():
        phase, spread = float(image.phase.where(here).mean()), float(image.phase_spread.where(here).max())
        share = float((irregular & here).sum() / here.sum())
        print(f"{name:<7} {phase:6.2f} degrees; irregular in {share:.0%} of it, spread up to {spread:.3f} degrees")
    offset = image.tip_offset
    step = float(offset.where(DOMAINS).mean() - offset.where(~DOMAINS).mean())
    print(f"a flat surface appears {step * 1e9:.2f} nm higher on the rubber")
    phases = " and ".join(f"{phase:.1f}" for phase in pm.orbits(RUBBER, SCOPE, setpoint=SETPOINT).phase.values)
    print(
        f"rubber of 30 MPa has periodic orbits with this amplitude, at {phases} degrees, but none is reached from far"
    )

    figure, panels = plt.subplots(2, 2, figsize=(9.2, 8.0), layout="constrained")
    draw_map(panels[0, 0], 1e9 * (image.height - image.height.min()), "height (nm)", "afmhot")
    draw_map(panels[0, 1], image.phase, "phase (degrees), irregular where dotted", "cividis")
    rows, columns = np.nonzero(irregular.values)
    some = (rows % 4 == 0) & (columns % 4 == 0)
    x, y = (1e9 * PIXEL * (place[some] + 0.5) for place in (columns, rows))
    panels[0, 1].plot(x, y, ".", color="white", markersize=1.8)
    draw_map(panels[1, 0], 1e3 * image.phase_spread, "spread of the phase (0.001 degrees)", "magma")

    axes = panels[1, 1]
    for name, material, colour in (("rubber", RUBBER, "C1"), ("glass", GLASS, "C0")):
        curve = pm.sweep_distance(material, SCOPE, OFFSETS).sel(direction="approach")
        stretch = curve.motion == 1
        axes.plot(1e9 * OFFSETS, curve.phase.where(~stretch), ".", color=colour, label=name)
        axes.plot(1e9 * OFFSETS, curve.phase.where(stretch), "o", color=colour, fillstyle="none", markersize=4)
        held = np.interp(SETPOINT, curve.amplitude[::-1] / SCOPE.driven_amplitude, OFFSETS[::-1])
        axes.axvline(1e9 * held, color=colour, linestyle=":", linewidth=1)
    axes.plot([], [], "o", color="0.4", fillstyle="none", markersize=4, label="irregular: mean")
    axes.plot([], [], ":", color="0.4", linewidth=1, label=f"setpoint {SETPOINT:g}")
    axes.set(xlabel="tip offset (nm)", ylabel="phase on approach (degrees)")
    axes.set_title("phase against distance, rubber of 30 MPa", fontsize=11)
    axes.legend(frameon=False, fontsize=9)
    figure.savefig(folder / "rubber_beside_glass.png", dpi=150)


if __name__ == "__main__":
    main()
