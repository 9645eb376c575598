"""Does the phase map modulus and adhesion? Figs. 8 and 9 of Wang (1999)

At a setpoint of 0.7 and without damping, the phase only shows which regime the tip is in. With damping it depends on
modulus and adhesion as well.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import paper
import xarray as xr

import phasemap as pm

DAMPINGS = (0.0, 0.005, 0.1)
SETPOINT = 0.7
MODULI = np.geomspace(0.02e9, 10e9, 91)
FORCES = np.geomspace(10e-9, 1000e-9, 91)


def over_modulus(damping: float) -> xr.Dataset:
    """Sweep the modulus at f0 = 40 nN, up and down."""
    film = pm.Material(modulus=MODULI[0], adhesion=paper.adhesion(40e-9), damping=damping)
    return pm.sweep_parameter(film, paper.FIG7, "modulus", MODULI, setpoint=SETPOINT)


def over_adhesion(damping: float, forces: np.ndarray = FORCES) -> xr.Dataset:
    """Sweep the work of adhesion at E = 5 GPa, up and down."""
    film = pm.Material(modulus=5e9, damping=damping)
    works = np.array([paper.adhesion(force) for force in forces])
    return pm.sweep_parameter(film, paper.FIG7, "adhesion", works, setpoint=SETPOINT)


def overlap(sweep: xr.Dataset) -> float:
    """Decades of the axis on which sweeps up and down show different phases."""
    axis = np.log10(sweep[sweep["status"].dims[1]].values)
    apart = np.abs(np.diff(sweep.phase.values, axis=0)[0]) > 1
    return float(apart.sum() * np.diff(axis).mean())


def main(folder: Path = Path()) -> None:
    """Write paper_fig8_mapping.png."""
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained", sharey=True)
    sweeps = {"modulus": [over_modulus(d) for d in DAMPINGS], "adhesion": [over_adhesion(d) for d in DAMPINGS]}
    scales = {"modulus": 1e-9, "adhesion": 2e9 * np.pi * paper.RADIUS}
    for axes, (name, found) in zip(panels, sweeps.items(), strict=True):
        axes.set_xscale("log")
        for i, (damping, sweep) in enumerate(zip(DAMPINGS, found, strict=True)):
            paper.draw(axes, sweep, "phase", scales[name], color=f"C{i}", lw=4 - 1.2 * i, label=f"alpha1 = {damping:g}")
        jump = found[0].isel(jump=0)
        x, start, end = (float(jump[f"jump_{part}"]) for part in (name, "from_phase", "to_phase"))
        x *= scales[name]
        axes.annotate("", (x, end), (x, start), arrowprops={"arrowstyle": "-|>", "color": "C0"})
        axes.annotate("A", (x, start), (6, 8), textcoords="offset points", color="C0", weight="bold")
        axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
        axes.set_xlim(*(sweep[name].values[[0, -1]] * scales[name]))
        axes.xaxis.set_major_formatter("{x:g}")
    panels[0].set(xlabel="modulus (GPa), f0 = 40 nN", ylabel="phase (degrees)", title="Fig. 8")
    panels[1].set(xlabel="adhesion force f0 (nN), E = 5 GPa", title="Fig. 9")
    panels[0].legend(frameon=False, loc="center right")
    figure.savefig(folder / "paper_fig8_mapping.png", dpi=150)

    undamped = np.abs(np.concatenate([sweep[0].phase.values.ravel() for sweep in sweeps.values()]))
    paper.said(
        "without damping the phase only jumps between about 45° and -45°",
        f"it is plus or minus {undamped.min():.3f}° to {undamped.max():.3f}°; arccos 0.7 is 45.573°",
    )
    for name, found in sweeps.items():
        wide = ", ".join(f"{overlap(sweep):.2f} at {d:g}" for d, sweep in zip(DAMPINGS, found, strict=True))
        paper.said(f"damping shrinks the overlap ({name})", f"decades of the shown axis with hysteresis: {wide}")
    phase = sweeps["modulus"][2].phase.values[0]
    slope = np.gradient(phase, np.log10(MODULI))
    steep, low, zero, high = (int(np.abs(phase - value).argmin()) for value in (phase[slope.argmax()], -40, 0, 40))
    paper.said(
        "with damping the phase rises with modulus; sensitivity is best in the transition around 0°",
        f"at alpha1 = 0.1 it rises from {phase[0]:.0f}° to {phase[-1]:.0f}°, by {slope[low]:.0f}° a decade at -40°, "
        f"{slope[steep]:.0f} at {phase[steep]:.0f}°, {slope[zero]:.0f} at 0°, {slope[high]:.0f} at 40°",
    )
    sticky = sweeps["adhesion"][2].phase.values[0]
    paper.said(
        "with damping the phase falls with adhesion",
        f"at alpha1 = 0.1 it falls from {sticky[0]:.0f}° to {sticky[-1]:.0f}°",
    )


if __name__ == "__main__":
    main()
