"""Draw the pictures of the front page's cards: `python docs/cards.py`, from the root of the repository."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import phasemap as pm

FOLDER = Path(__file__).parent / "_static" / "cards"
SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(25e-9))
PARTICLE = pm.Material(3e9, adhesion=0.15, damping=0.005)
MATRIX = pm.Material(0.5e9, adhesion=0.02, damping=0.02, poisson_ratio=0.48)
PS, LDPE = pm.Material.preset("PS"), pm.Material.preset("LDPE")


def bare(axes: Axes) -> None:
    """Leave the curves alone: no upper and right edge."""
    axes.spines[["top", "right"]].set_visible(False)


def inversion(left: Axes, right: Axes) -> None:
    """The same particles at two setpoints."""
    labels = pm.generate.particles((128, 128), 4e-9, radius=45e-9, area_fraction=0.35, seed=4)
    surface = pm.Surface.from_labels(labels, {0: MATRIX, 1: PARTICLE}, pixel_size=4e-9)
    for axes, setpoint in ((left, 0.92), (right, 0.7)):
        axes.imshow(pm.simulate(surface, SCOPE, setpoint).phase, cmap="cividis")
        axes.set(xticks=[], yticks=[], title=f"setpoint {setpoint}")


def lever(axes: Axes) -> None:
    """Contrast against the free amplitude."""
    free = np.arange(5e-9, 101e-9, 3e-9)
    for name in ("PPP-NCHR", "PPP-FMR", "PPP-CONTR"):
        cantilever = pm.Cantilever.preset(name)
        scopes = [pm.Microscope(cantilever, SCOPE.tip, pm.Drive(one)) for one in free]
        phases = [pm.solve_pixel(LDPE, one, 0.8).phase - pm.solve_pixel(PS, one, 0.8).phase for one in scopes]
        axes.plot(1e9 * free, phases, linewidth=2.5, label=f"{cantilever.stiffness:g} N/m")
    axes.set(xlabel="free amplitude (nm)", ylabel="contrast (°)")
    axes.legend(frameon=False, loc="lower right")
    bare(axes)


def setpoint(axes: Axes) -> None:
    """The map of the contrast, with the recommended point."""
    levels, free = np.linspace(0.4, 0.96, 25), np.linspace(8e-9, 60e-9, 25)
    found = pm.contrast(PARTICLE, MATRIX, SCOPE, levels, free)
    most = float(abs(found.contrast).max())
    axes.pcolormesh(levels, 1e9 * free, found.contrast, cmap="coolwarm", vmin=-most, vmax=most, shading="gouraud")
    best = found.attrs["best_setpoint"], 1e9 * found.attrs["best_free_amplitude"]
    axes.plot(*best, "*", markersize=26, markerfacecolor="#ffe14d", markeredgecolor="black")
    axes.set(xlabel="setpoint", ylabel="free amplitude (nm)")


def real(axes: Axes) -> None:
    """Every orbit on a sticky particle against the distance."""
    found = pm.sweep_distance(PARTICLE, SCOPE, np.linspace(27e-9, 18e-9, 120))
    pieces, stable = found.curve_piece.values, found.curve_stable.values == 1
    x, y = 1e9 * found.curve_tip_offset.values, found.curve_phase.values
    for wanted, style, word in ((True, "-", "stable"), (False, ":", "unstable")):
        shown = np.where(stable == wanted, y, np.nan)
        shown[1:][np.diff(pieces) != 0] = np.nan
        axes.plot(x, shown, style, color="C0" if wanted else "0.4", linewidth=3, label=word)
    axes.set(xlabel="distance (nm)", ylabel="phase (°)", xlim=(18, 27))
    axes.legend(frameon=False)
    bare(axes)


def soft(axes: Axes) -> None:
    """The map of the modulus that an inversion finds."""
    labels = pm.generate.blend((64, 96), 4e-9, spacing=90e-9, seed=7)
    varied = pm.Variation(modulus=0.15, adhesion=0.0, loss=0.0, correlation_length=30e-9)
    domains = {0: pm.Material(0.2e9, adhesion=0.06, damping=0.03), 1: pm.Material(1e9, adhesion=0.07, damping=0.01)}
    surface = pm.Surface.from_labels(labels, domains, pixel_size=4e-9, variation=varied)
    stack = [pm.simulate(surface, SCOPE, one) for one in (0.5, 0.6, 0.7, 0.8)]
    found = pm.invert(stack, SCOPE, phase_zero=0.0, phase_error=0.2, height_error=0.05e-9)
    shown = axes.imshow(1e-9 * found.modulus, cmap="plasma")
    axes.set(xticks=[], yticks=[])
    axes.figure.colorbar(shown, ax=axes, label="modulus (GPa)")


def scan(left: Axes, right: Axes) -> None:
    """Height and phase of a scan in time, with noise."""
    image = pm.load_scene("samples/scan.toml").simulate().sel(direction="trace")
    for axes, name, cmap in ((left, "height", "afmhot"), (right, "phase", "cividis")):
        low, high = np.nanpercentile(image[name], (0.5, 99.5))
        axes.imshow(image[name], cmap=cmap, vmin=low, vmax=high)
        axes.set(xticks=[], yticks=[], title=name)


CARDS: dict[Callable[..., None], int] = {inversion: 2, lever: 1, setpoint: 1, real: 1, soft: 1, scan: 2}


def main() -> None:
    """Draw all of them."""
    FOLDER.mkdir(exist_ok=True)
    plt.rcParams.update({"font.size": 15, "axes.titlesize": 15, "legend.fontsize": 14})
    for draw, panels in CARDS.items():
        figure, axes = plt.subplots(1, panels, figsize=(5.4, 3.3), layout="constrained", squeeze=False)
        draw(*axes[0])
        figure.savefig(FOLDER / f"{draw.__name__}.png", dpi=110)


if __name__ == "__main__":
    main()
