"""Which setpoint and free amplitude distinguish two materials best?

The phase contrast of polystyrene and polyethylene over both, with the lines where it jumps or inverts, and the
recommended operating point: far from any jump, with most of the contrast, and with the least indentation.
"""

from pathlib import Path

import numpy as np

import phasemap as pm

PS = pm.Material(modulus=3.0e9, adhesion=0.07, damping=0.004)
LDPE = pm.Material(modulus=0.2e9, adhesion=0.06, damping=0.03, poisson_ratio=0.45)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
)
SETPOINTS = np.linspace(0.35, 0.95, 25)
FREE_AMPLITUDES = np.linspace(10e-9, 60e-9, 11)


def main(folder: Path = Path()) -> None:
    """Write which_setpoint.png."""
    found = pm.contrast(PS, LDPE, SCOPE, SETPOINTS, free_amplitudes=FREE_AMPLITUDES, names=("PS", "LDPE"))
    pm.plot.contrast(found, folder / "which_setpoint.png", overwrite=True)
    print(found.attrs["recommendation"])
    print(f"there LDPE is {found.attrs['best_contrast']:.0f} degrees from PS")


if __name__ == "__main__":
    main()
