"""What the forces outside contact do to a phase in liquid: double layer, ordered water, layers of molecules.

The same lever taps with 3 nm on the same sample, and only what acts outside contact differs: van der Waals attraction,
a double layer of equal charges that repels beside it, hydration, a liquid that lies in layers, and a Lennard-Jones
force. On the left are the forces, on the right by how much they change the phase as the setpoint falls: by less than a
degree of 10 to 57, for most of it is contact. A table takes the place of any law: the crosses are the numbers of
hydration (`Table.from_law`), and the dashed curve the same with 0.1 nN less on the way out of contact, a hysteresis
that loses energy and pulls the phase towards 0.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

Interaction, forces = pm.Interaction, pm.interaction
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=1.0, resonance_frequency=40e3, quality_factor=4.0, modes=(pm.Eigenmode(7.0, 9.0),)),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=3e-9),
)
SAMPLE = pm.Material(modulus=0.5e9, adhesion=2e-3)
LAWS = {
    "van der Waals": Interaction(),
    "DLVO": Interaction(longrange=forces.DLVO(-0.02, -0.02, debye_length=1e-9)),
    "hydration": Interaction(longrange=forces.Hydration(strength=5e-3, decay=0.8e-9)),
    "solvation": Interaction(longrange=forces.Solvation(period=0.9e-9, decay=0.9e-9), decay_length=None),
    "Lennard-Jones": Interaction(longrange="lennard-jones"),
}
SETPOINTS = np.linspace(0.98, 0.5, 33)
GAPS = np.linspace(0.0, 4e-9, 161)


def phases(interaction: pm.Interaction) -> np.ndarray:
    """Phase [degree] at each setpoint."""
    scope = replace(SCOPE, interaction=interaction)
    return np.array([pm.solve_pixel(SAMPLE, scope, one).phase for one in SETPOINTS])


def tables() -> tuple[forces.Table, forces.Table]:
    """Hydration in numbers, and with a smaller force on the way out of contact."""
    table = forces.Table.from_law(SAMPLE, replace(SCOPE, interaction=LAWS["hydration"]))
    less = np.where(np.array(table.depths) > 0.0, 0.1e-9, 0.0)
    return table, replace(table, withdrawal_forces=tuple(np.array(table.forces) - less))


def main(folder: Path = Path()) -> None:
    """Write forces_outside_contact.png."""
    attracted = phases(LAWS["van der Waals"])
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.8), layout="constrained")
    for name, interaction in LAWS.items():
        curve = pm.force_curve(SAMPLE, replace(SCOPE, interaction=interaction), -GAPS).force.sel(direction="approach")
        left.plot(1e9 * GAPS, 1e9 * curve, label=name)
        found = phases(interaction)
        right.plot(SETPOINTS, found - attracted)
        print(f"{name}: {found[0]:.1f} degrees at {SETPOINTS[0]:.2f}, {found[-1]:.1f} at {SETPOINTS[-1]:.2f}")
    same, hysteretic = tables()
    right.plot(SETPOINTS[::4], (phases(Interaction(same)) - attracted)[::4], "kx", label="hydration, as a table")
    right.plot(
        SETPOINTS, phases(Interaction(hysteretic)) - attracted, "k--", lw=1, label="the same, less on withdrawal"
    )
    left.set(xlabel="gap (nm)", ylabel="force (nN)")
    left.legend(frameon=False)
    right.set(xlabel="amplitude over free amplitude", ylabel="phase less that with van der Waals (degrees)")
    right.legend(frameon=False, loc=(0.02, 0.3))
    figure.savefig(folder / "forces_outside_contact.png", dpi=150)


if __name__ == "__main__":
    main()
