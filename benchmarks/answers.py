"""Solve tasks given as plain numbers with whichever phasemap is on the path; run by `compare` as a process of its own.

Only public names are used here, since the same file drives the package of an older commit. The process reads pickled
lists of tasks on its standard input and answers each list, pickled, on its standard output.
"""

from __future__ import annotations

import contextlib
import pickle
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Array = np.ndarray
Plain = Mapping[str, Any]

CURVE_PHASE, CURVE_LENGTH, CURVE_SHARE = 1e-3, 1e-12, 1e-6
"""What curves and scans, which state no errors, may differ by [degree, m, share of the largest value]."""
CODES = ("status", "branch", "motion", "stable", "fold_branch", "jump_direction")
"""Variables that must be equal."""
LENGTHS = ("tip_offset", "fold_tip_offset", "jump_from_tip_offset", "jump_to_tip_offset")
PHASES = ("phase", "fold_phase", "jump_from_phase", "jump_to_phase", "mode2_phase")
SHARES = ("fold_frequency", "fold_setpoint", "fold_amplitude", "jump_frequency", "jump_setpoint", "amplitude")
SEEN = ("indentation", "mean_deflection", "dissipation", "virial")
"""Variables whose largest relative difference is reported, without a limit."""


@dataclass
class Answer:
    """What a task gave: integer codes, numbers with the error that they may have, and numbers only looked at."""

    codes: dict[str, Array] = field(default_factory=dict)
    values: dict[str, Array] = field(default_factory=dict)
    within: dict[str, Array] = field(default_factory=dict)  # of each of `values`, in its unit
    seen: dict[str, Array] = field(default_factory=dict)


def microscope(plain: Plain) -> Any:
    """Return the microscope that plain numbers describe."""
    import phasemap as pm

    interaction = dict(plain["interaction"])
    contact = interaction.get("contact", "dmt")
    if not isinstance(contact, str):  # the name of a law's class and its parameter
        interaction["contact"] = getattr(pm.interaction, contact[0])(*contact[1:])
    drive = dict(plain["drive"])
    if drive.get("second") is not None:
        drive["second"] = pm.Mode(**drive["second"])
    return pm.Microscope(
        pm.Cantilever(*plain["cantilever"]), pm.Tip(*plain["tip"]), pm.Drive(**drive), pm.Interaction(**interaction)
    )


def image(task: Plain) -> Answer:
    """Image of maps of material properties, each pixel engaged from far or as `control` says."""
    import phasemap as pm

    maps: dict[str, Any] = {name: np.atleast_2d(values) for name, values in task["maps"].items()}
    surface = pm.Surface(**maps, pixel_size=task.get("pixel_size", 4e-9))
    name, options = task.get("control", ("Engage", {}))
    given = {"variables": task["variables"]} if "variables" in task else {}
    scope, control = microscope(task["scope"]), getattr(pm, name)(**options)
    found = pm.simulate(
        surface, scope, task["setpoint"], solver=task.get("solver", "auto"), control=control, threads=1, **given
    )
    return _answer(found)


def curve(task: Plain) -> Answer:
    """Distance, setpoint or frequency curve of a material, with its folds and jumps."""
    import phasemap as pm

    sweep = getattr(pm, f"sweep_{task['sweep']}")
    return _answer(sweep(pm.Material(**task["material"]), microscope(task["scope"]), task["axis"], **task["options"]))


def orbits(task: Plain) -> Answer:
    """Every orbit of a material at a setpoint."""
    import phasemap as pm

    return _answer(pm.orbits(pm.Material(**task["material"]), microscope(task["scope"]), setpoint=task["setpoint"]))


def _answer(found: Any) -> Answer:
    """Take from a Dataset what is compared."""
    answer = Answer()
    for name in CODES:
        if name in found:
            answer.codes[name] = found[name].values
    limits = {**dict.fromkeys(LENGTHS, CURVE_LENGTH), **dict.fromkeys(PHASES, CURVE_PHASE), **dict.fromkeys(SHARES)}
    for name, limit in limits.items():
        if name not in found:
            continue
        values = found[name].values
        answer.values[name] = values
        answer.within[name] = np.full(values.shape, CURVE_SHARE * _largest(values) if limit is None else limit)
    for name, stated in (("phase", "error_phase"), ("tip_offset", "error_height")):
        if stated in found and np.isfinite(found[stated]).any():
            answer.within[name] = found[stated].values
    answer.seen = {name: found[name].values for name in SEEN if name in found}
    return answer


def _largest(values: Array) -> float:
    """Largest absolute value that is finite."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


KINDS = {"image": image, "curve": curve, "orbits": orbits}


def solve(tasks: Sequence[Plain]) -> tuple[list[Answer], float]:
    """Answer tasks, and the processor time that it took [s]."""
    started = time.process_time()
    answers = [KINDS[task["kind"]](task) for task in tasks]
    return answers, time.process_time() - started


def main() -> None:
    """Answer lists of tasks until the input ends."""
    replies = sys.stdout.buffer
    with contextlib.redirect_stdout(sys.stderr), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # extremes are not plausible, which is what they are here for
        while True:
            try:
                tasks = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            pickle.dump(solve(tasks), replies)
            replies.flush()


if __name__ == "__main__":
    main()
