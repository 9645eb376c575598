"""What are modulus, adhesion and damping of a film whose frequency response was measured?

As Wang (1999) did for Fig. 3: the drive frequency is swept up and down above a film, and the model is fitted to
amplitude and phase. The response has branches with jumps and hysteresis between them, and the starting values are wrong
by factors of up to 2. The "measurement" is a simulated sweep of the film in the paper, with noise.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import phasemap as pm

SCOPE = pm.Microscope(
    pm.Cantilever(stiffness=40.0, resonance_frequency=148.24e3, quality_factor=250.0),
    pm.Tip(radius=30e-9),
    pm.Drive(free_amplitude=155e-9),
)
TIP_OFFSET = 140e-9
FREQUENCIES = np.linspace(147.2e3, 149.2e3, 61)
NOISE = {"amplitude": 1e-9, "phase": 0.7}  # m, degree
UNITS = {"amplitude": ("amplitude (nm)", 1e9), "phase": ("phase (degrees)", 1)}
COLORS = {"up": "C3", "down": "C0"}


def measure() -> dict[str, np.ndarray]:
    """Amplitude [m] and phase [degree], up and down."""
    film = pm.Material(modulus=0.89e9, adhesion=0.37, damping=0.014)
    sweep = pm.sweep_frequency(film, SCOPE, FREQUENCIES, tip_offset=TIP_OFFSET)
    noise = np.random.default_rng(3)
    return {name: sweep[name].values + noise.normal(0, size, sweep[name].shape) for name, size in NOISE.items()}


def draw(axes: plt.Axes, curve: xr.Dataset, name: str) -> None:
    """Data of both directions over all branches of the fit."""
    label, factor = UNITS[name]
    for piece in np.unique(curve.curve_piece):
        points = curve.isel(point=np.flatnonzero(curve.curve_piece == piece))
        for stable, style in ((1, {"color": "0.35"}), (0, {"color": "0.6", "linestyle": ":"})):
            values = points[f"curve_{name}"].where(points.curve_stable == stable) * factor
            axes.plot(points.curve_frequency / 1e3, values, linewidth=1.2, **style)
    for direction, color in COLORS.items():
        values = curve[f"measured_{name}"].sel(direction=direction) * factor
        marker = "^" if direction == "up" else "v"
        axes.plot(FREQUENCIES / 1e3, values, marker, color=color, markersize=4.5, alpha=0.8, label=f"swept {direction}")
    axes.locator_params(axis="x", nbins=5)
    axes.set(xlabel="frequency (kHz)", ylabel=label, xlim=(FREQUENCIES[0] / 1e3, FREQUENCIES[-1] / 1e3))


def main(folder: Path = Path()) -> None:
    """Write fit_response.png."""
    fit = pm.fit_frequency(
        FREQUENCIES,
        scope=SCOPE,
        start=pm.Material(modulus=1.5e9, adhesion=0.2, damping=0.02),
        tip_offset=TIP_OFFSET,
        **measure(),
        **{f"{name}_error": size for name, size in NOISE.items()},
        direction=("up", "down"),
    )
    print(fit)

    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for axes, name in zip(panels, UNITS, strict=True):
        draw(axes, fit.curve, name)
    panels[0].plot([], [], color="0.35", label="fit, stable")
    panels[0].plot([], [], color="0.6", linestyle=":", label="fit, unstable")
    panels[0].legend(frameon=False)
    figure.savefig(folder / "fit_response.png", dpi=150)


if __name__ == "__main__":
    main()
