"""How does the phase depend on the setpoint, and on damping? Fig. 7 of Wang (1999)

Without damping the amplitude alone determines the phase, up to its sign: F+ in the repulsive regime, F- in the
attractive one.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import paper
import xarray as xr

import phasemap as pm

SETPOINTS = np.concatenate([np.linspace(0.995, 0.1, 90), np.geomspace(0.095, 0.004, 25)])
DAMPINGS = (0.0, 0.02, 0.1, 0.3, 0.4, 0.5, 1.0)


def approach(damping: float, **film: float) -> xr.Dataset:
    """Lower the setpoint of Fig. 7 over a film of this damping, and raise it again."""
    return pm.sweep_setpoint(replace(paper.FILM7, damping=damping, **film), paper.FIG7, SETPOINTS)


def averaging_error(damping: float, setpoint: float) -> float:
    """Phase of first-order averaging less that of the exact orbit [degree]."""
    film = replace(paper.FILM7, damping=damping)
    averaged, exact = (pm.solve_pixel(film, paper.FIG7, setpoint, solver=name) for name in ("averaging", "orbit"))
    return averaged.phase - exact.phase


def main(folder: Path = Path()) -> None:
    """Write paper_fig7_setpoint.png."""
    found = {damping: approach(damping) for damping in DAMPINGS}
    figure, axes = plt.subplots(figsize=(7.4, 5.2), layout="constrained")
    between = np.linspace(0, 1, 201)
    for sign, name in ((1, "$F_+$"), (-1, "$F_-$")):
        axes.plot(between, sign * np.degrees(np.arccos(between)), color="0.75", linewidth=6, zorder=0)
        axes.annotate(name, (0.42, sign * 65.2), (8, 10 * sign), textcoords="offset points", va="center", fontsize=12)
    for i, (damping, sweep) in enumerate(found.items()):
        phase = sweep.phase.sel(direction="down")
        axes.plot(SETPOINTS, phase, ".-", markersize=3, linewidth=1.2, color=f"C{i}", label=f"{damping:g}")
    dots = np.linspace(0.1, 0.9, 17)
    for i, damping in enumerate(DAMPINGS[1:4], start=1):
        film = replace(paper.FILM7, damping=damping)
        averaged = [pm.solve_pixel(film, paper.FIG7, setpoint, solver="averaging").phase for setpoint in dots]
        axes.plot(dots, averaged, "o", markerfacecolor="none", color=f"C{i}", label="averaged" if i == 3 else None)
    start = float(found[0.0].jump_setpoint[0])
    axes.annotate("A", (start, -np.degrees(np.arccos(start))), (2, -14), textcoords="offset points", weight="bold")
    axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xlabel="setpoint (amplitude / free amplitude)", ylabel="phase (degrees)", xlim=(0, 1), ylim=(-95, 95))
    axes.legend(title="damping alpha1", fontsize=8, loc="lower right", ncols=2)
    figure.savefig(folder / "paper_fig7_setpoint.png", dpi=150)

    down = {damping: sweep.phase.sel(direction="down") for damping, sweep in found.items()}
    away = np.abs(np.abs(down[0.0]) - np.degrees(np.arccos(SETPOINTS)))
    paper.said(
        "without damping there are only F+ and F-, whatever the size of the forces",
        f"the phase is within {float(away.max()):.2f}° of plus or minus arccos of the setpoint; the rest is lost "
        "in higher harmonics of the lever",
    )
    paper.said(
        "the start is on F-, the phase jumps to F+ at A, and tends to 90° in the end",
        f"A is at {start:.3f}; at {SETPOINTS[-1]:.3f} the phase is {float(down[0.0][-1]):.1f}°",
    )
    # At the smallest setpoints the tip sticks to a film that damps much, and swings in contact.
    taps = {
        damping: down[damping].where(sweep.tip_offset.sel(direction="down") > 0) for damping, sweep in found.items()
    }
    some = taps[0.4].where(SETPOINTS < 0.9)
    best = int(some.argmax("setpoint"))
    back = found[0.5]
    paper.said(
        "the phase passes a maximum, and may return to F-",
        f"at alpha1 = 0.4 it passes {float(some[best]):.1f}° at {SETPOINTS[best]:.2f}; at 0.5 it jumps to "
        f"{float(back.jump_to_phase[0]):.0f}° at {float(back.jump_setpoint[0]):.2f}",
    )
    at = int(np.abs(SETPOINTS - 0.5).argmin())
    paper.said(
        "damping lowers the phase, and at high damping it is negative at every setpoint",
        "at 0.5 it is " + ", ".join(f"{float(phase[at]):.0f}°" for phase in down.values())
        + f"; at alpha1 = 1 never above {float(taps[1.0].max()):.1f}° as long as the tip taps",
    )  # fmt: skip
    errors = {setpoint: averaging_error(0.3, setpoint) for setpoint in (0.7, 0.4, 0.2, 0.05)}
    paper.said(
        "averaging agrees with the numerical solution above a setpoint of 0.4",
        "at alpha1 = 0.3 it is off by " + ", ".join(f"{error:.1f}° at {s:g}" for s, error in errors.items()),
    )


if __name__ == "__main__":
    main()
