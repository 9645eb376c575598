"""Status of a pixel: the statuses by number, from 0 on, each with the advice that it gives."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any


class Status(Enum):
    """Status of a pixel; the order is the code kept in a Dataset."""

    good = "A stable orbit, or irregular motion whose mean amplitude and phase are steady."
    no_stable_orbit = (
        "No stable orbit has the setpoint amplitude: the amplitude jumps across it. "
        "Raise the free amplitude, or take another setpoint."
    )
    not_converged = "The solver did not converge. Use solver='march', and please report the parameters."
    unstable = (
        "The orbit at this setpoint repeats only every second period or drifts. "
        "Raise the setpoint or lower the amplitude."
    )
    not_settled = (
        "The motion did not become steady within the number of drive periods that may be integrated. "
        "Allow more with Accuracy(periods=...), in a scene accuracy.periods."
    )
    invalid = (
        "The material has a property that is not a number (NaN), or one that the contact law cannot have: adhesion "
        "without stiffness where there is a neck, films of liquid so thick that they meet where their neck breaks, "
        "damping without stiffness with withdrawal='ting', or what makes numbers of a law of your own infinite or NaN."
    )
    too_many_contacts = "The tip touches the sample more often per period than the solver follows. Use solver='march'."
    no_averaged_orbit = "First-order averaging finds no orbit on the branch that the tip reaches. Use solver='orbit'."
    creates_energy = (
        "The neck of this contact law breaks within reach of the long-range force, so that a loop would create energy. "
        "Use contact='maugis' or 'dmt', a shorter decay_length, or decay_length=None (in a scene 'none')."
    )
    out_of_range = "The scanner reached the end of its range. Give a larger scanner_range, or level the surface."
    diverged = "The feedback became unstable, or the tip stays in the surface. Lower the gains or the line rate."
    not_engaged = (
        "The tip did not reach the setpoint when it was lowered at the start of this line. "
        "Take another setpoint, or another free amplitude."
    )

    def advice(self, held: str = "", interaction: Mapping[str, Any] | None = None) -> str:
        """What it means and what helps; in a sweep what helps there, by what is `held`: "setpoint" or "tip offset".

        What makes a material invalid is said of the laws of an `interaction`, as `describe` gives it, or of all laws.
        """
        if self is Status.invalid and interaction:
            contact = interaction.get("contact", "dmt")
            name = str(contact.get("kind") if isinstance(contact, Mapping) else contact)
            cannot = [CANNOT_HAVE.get(name, OF_OWN), OF_TING if interaction.get("withdrawal") == "ting" else ""]
            return f"The material has a property that is not a number (NaN){''.join(cannot)}."
        if self is Status.no_stable_orbit and held == "tip offset":
            return "No stable orbit was found at this tip offset. Take another one, or a larger free amplitude."
        if self in (Status.not_converged, Status.not_settled) and held:  # there is no solver to choose, and no accuracy
            return f"{self.value.partition('. ')[0]}. Sweep values beside these, or over a narrower range."
        return self.value

    @property
    def code(self) -> int:
        """The integer kept in a Dataset."""
        return _CODES[self]

    @classmethod
    def of(cls, code: int) -> Status:
        """Return the status with this code."""
        return list(cls)[code]


OF_OWN = ", or one for which numbers of this contact law are infinite or NaN"
OF_TING = ", or damping without stiffness, whose dents would never come back"
CANNOT_HAVE = {
    **dict.fromkeys(("hertz", "dmt", "cone", "punch", "film", "slipping film", "neck", "lossydmt", "table"), ""),
    **dict.fromkeys(("jkr", "maugis", "maugisdugdale"), ", or adhesion without stiffness, which this law cannot have"),
    "capillary": ", or films of liquid so thick that they meet where their neck breaks",
}
"""What a contact law of phasemap cannot have, besides NaN, by its name in a configuration."""
_CODES = {status: code for code, status in enumerate(Status)}
