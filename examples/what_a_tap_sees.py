"""Which frequency does a tap see?

A solid with one relaxation time has its largest loss at the frequency 1/(2 pi tau). Phase does not probe it by a sine:
the tip is in contact for a small part of the period and never pulls. So the loss tangent that an instrument shows
falls ever more short of that at the drive's frequency, the longer the relaxation takes.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

MODULUS, RELAXED = 2e9, 1e9
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
    pm.Interaction("hertz", decay_length=None),
)
TIMES = np.geomspace(5e-9, 5e-6, 25)
SETPOINTS = {0.9: "tab:blue", 0.6: "tab:orange"}


def at_drive(time: np.ndarray) -> np.ndarray:
    """Loss tangent of the solid under a sine at the drive's frequency."""
    turn = 2 * np.pi * SCOPE.cantilever.resonance_frequency * time
    return turn * (MODULUS - RELAXED) / (RELAXED + MODULUS * turn**2)


def seen(setpoint: float) -> np.ndarray:
    """Loss tangent that the instrument's formula gives, at each relaxation time."""
    wedge = pm.Surface(MODULUS, relaxed_modulus=RELAXED, relaxation_time=TIMES[np.newaxis], pixel_size=1e-9)
    image = pm.simulate(wedge, SCOPE, setpoint, variables=["loss_tangent"])
    return image["loss_tangent"].values[0]


def main(folder: Path = Path()) -> None:
    """Write what_a_tap_sees.png."""
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.0), layout="constrained", sharex=True)
    panels[0].loglog(TIMES * 1e9, at_drive(TIMES), "k--", label="material at 300 kHz")
    for setpoint, colour in SETPOINTS.items():
        found = seen(setpoint)
        panels[0].loglog(TIMES * 1e9, found, color=colour, label=f"seen at setpoint {setpoint}")
        panels[1].semilogx(TIMES * 1e9, found / at_drive(TIMES), color=colour, label=f"setpoint {setpoint}")
        at = int(np.argmin(np.abs(TIMES - 100e-9)))
        print(f"setpoint {setpoint}: at {TIMES[at] * 1e9:.0f} ns it sees {found[at] / at_drive(TIMES)[at]:.2f} of it")
    panels[0].set(xlabel="relaxation time (ns)", ylabel="loss tangent")
    panels[1].set(xlabel="relaxation time (ns)", ylabel="seen, over that at the drive's frequency", ylim=(0, 1))
    panels[0].legend(frameon=False)
    panels[1].legend(frameon=False)
    figure.savefig(folder / "what_a_tap_sees.png", dpi=150)


if __name__ == "__main__":
    main()
