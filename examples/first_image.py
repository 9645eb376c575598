"""What does a phase image of two polymers look like?

A blend of polystyrene and low-density polyethylene, simulated and drawn: the scene samples/blend.toml in Python.
"""

from pathlib import Path

import phasemap as pm
from phasemap.plot import plot


def main(folder: Path = Path()) -> None:
    """Write first_image.nc and first_image.png."""
    scope = pm.Microscope(
        pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
        pm.Tip(radius=10e-9),
        pm.Drive(free_amplitude=40e-9),
        pm.Interaction(contact="dmt", decay_length=0.3e-9),
    )
    ps = pm.Material(modulus=3.0e9, adhesion=0.07, damping=0.004)
    ldpe = pm.Material(modulus=0.2e9, adhesion=0.06, damping=0.03, poisson_ratio=0.45)

    shape, pixel_size = (256, 256), 4e-9
    labels = pm.generate.blend(shape, pixel_size, spacing=160e-9, fraction=0.45, seed=7)
    roughness = pm.generate.roughness(shape, pixel_size, rms=0.4e-9, correlation_length=60e-9, seed=3)
    surface = pm.Surface.from_labels(labels, {0: ps, 1: ldpe}, pixel_size=pixel_size, topography=roughness)

    image = pm.simulate(surface, scope, setpoint=0.7)
    image.to_netcdf(folder / "first_image.nc")
    plot(image, folder / "first_image.png", overwrite=True)

    for name, label in {"polystyrene": 0, "polyethylene": 1}.items():
        print(f"{name:<13} {float(image.phase.where(labels == label).mean()):6.2f} degrees")
    print(f"energy out equals energy in to {float(abs(image.energy_closure).max()):.1e}")


if __name__ == "__main__":
    main()
