"""How slowly must one scan?

The feedback follows the surface with a lag. For an integrating controller the error is the speed of the surface divided
by the gain: half the line rate, half the error. A line of stripes on a gently undulating surface is scanned at several
rates, with the slow flow and with the full equation of motion, and compared with the image of an infinitely slow scan.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phasemap as pm

SOFT = pm.Material(modulus=1e9, adhesion=0.05, damping=0.01)
STIFF = pm.Material(modulus=3e9, adhesion=0.05, damping=0.005)
SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=300e3, quality_factor=400.0),
    pm.Tip(radius=10e-9),
    pm.Drive(free_amplitude=40e-9),
)
SETPOINT = 0.7
PLACE = np.arange(48)  # pixels of the line
RELIEF = 1e-9 * np.sin(PLACE * np.pi / 12)
GOOD = 1.0  # degree
TICKS = 0.5, 1, 2, 4, 8, 16, 32, 64  # Hz
ENGINES = {  # solver: name, style, line rates [Hz]; the equation of motion takes every period as it comes
    "averaging": ("slow flow", {"color": "C0", "marker": ".", "markersize": 8}, np.geomspace(0.5, 64, 15)),
    "march": (
        "equation of motion",
        {"color": "C1", "marker": "o", "markersize": 9, "fillstyle": "none", "linestyle": "none"},
        np.geomspace(2, 64, 6),
    ),
}


def main(folder: Path = Path()) -> None:
    """Write line_rate.png."""
    labels = PLACE // 12 % 2
    surface = pm.Surface.from_labels([labels], {0: SOFT, 1: STIFF}, pixel_size=8e-9, topography=[RELIEF])
    still = pm.simulate(surface, SCOPE, SETPOINT, "orbit")
    rises = abs(np.diff(RELIEF + still.tip_offset.values[0])).max()  # of the tip, from pixel to pixel

    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for solver, (name, style, rates) in ENGINES.items():
        found = []
        for rate in rates:
            image = pm.simulate(surface, SCOPE, SETPOINT, solver, pm.Feedback(line_rate=rate))
            phase, height = (abs(image[what] - still[what]) for what in ("phase", "tip_offset"))
            found.append([phase.max(), (phase**2).mean() ** 0.5, height.max() * 1e9, (height**2).mean() ** 0.5 * 1e9])
        largest, rms, largest_height, rms_height = np.array(found, float).T
        for axes, values, about in (
            (panels[0], largest, "largest"),
            (panels[0], rms, "rms"),
            (panels[1], largest_height, "largest"),
            (panels[1], rms_height, "rms"),
        ):
            faint = 1.0 if about == "largest" else 0.45
            axes.loglog(rates, values, alpha=faint, label=f"{name}, {about}", **style)
        if solver == "averaging":
            gain = image.attrs["integral_gain_per_second"]  # as tuned
            print(f"phase within {GOOD:g} degree up to {np.interp(GOOD, largest, rates):.2g} Hz")
        for rate, phase, height in zip(rates, largest, largest_height, strict=True):
            print(f"{name}, {rate:5.3g} Hz: {phase:.2g} degree, {height:.2g} nm at most")

    lag = [1e9 * rises / (gain * pm.Feedback(line_rate=rate).dwell(len(PLACE))) for rate in TICKS]
    panels[1].loglog(TICKS, lag, "k--", linewidth=1, label="integrator: speed / gain")
    print(f"an integrator alone, {TICKS[1]:g} Hz: {lag[1]:.2g} nm; cantilever and lock-in add the rest")
    panels[0].axhline(GOOD, color="0.6", linewidth=0.8, zorder=0)
    for axes, what in zip(panels, ("phase (degrees)", "height (nm)"), strict=True):
        axes.set(xlabel="line rate (Hz)", ylabel=f"error of the {what}")
        axes.set_xticks(TICKS, [f"{rate:g}" for rate in TICKS])
        axes.xaxis.minorticks_off()
        axes.legend(frameon=False, fontsize=9)
    figure.savefig(folder / "line_rate.png", dpi=150)


if __name__ == "__main__":
    main()
