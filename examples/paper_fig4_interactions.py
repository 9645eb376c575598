"""How do attraction, repulsion and damping each affect the frequency response? Fig. 4 of Wang (1999)"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import paper
import xarray as xr

FC = paper.FIG4.cantilever.resonance_frequency
FILMS = {
    "all forces, high damping": paper.FILM4,
    "no adhesion (w = 0)": replace(paper.FILM4, adhesion=0.0),
    "no elasticity (K = 0)": replace(paper.FILM4, modulus=0.0),
    "no sample damping": replace(paper.FILM4, damping=0.0),
}


def responses() -> dict[str, xr.Dataset]:
    """Sweep each film in frequency, up and down."""
    return {name: paper.response(film, paper.FIG4, paper.OFFSET4) for name, film in FILMS.items()}


def peak(sweep: xr.Dataset) -> float:
    """Frequency of the largest stable amplitude, over the free resonance frequency."""
    stable = sweep.curve_amplitude.where(sweep.curve_stable == 1)
    return float(sweep.curve_frequency[int(stable.argmax("point"))]) / FC


def hysteresis(sweep: xr.Dataset) -> float:
    """Width of the frequencies that have more than one stable orbit, over the resonance frequency."""
    up, down = ([float(x) for x in sweep.jump_frequency[sweep.jump_direction == way]] for way in (0, 1))
    return sum(abs(a - b) for a, b in zip(sorted(up), sorted(down), strict=True)) / FC


def main(folder: Path = Path()) -> None:
    """Write paper_fig4_interactions.png."""
    found = responses()
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for axes, name, factor, label in (
        (panels[0], "amplitude", 1e9, "amplitude (nm)"),
        (panels[1], "phase", 1, "phase (degrees)"),
    ):
        for i, (film, sweep) in enumerate(found.items()):
            paper.draw(axes, sweep, name, 1 / FC, factor, color=f"C{i}", label=film)
        axes.set(xlabel="drive frequency / free resonance frequency", ylabel=label, xlim=(0.9965, 1.0075))
    panels[0].set_ylim(80, 130)
    panels[1].axhline(0, color="0.8", linewidth=0.8, zorder=0)
    panels[1].plot([], [], ":", color="0.4", label="unstable")
    panels[1].legend(frameon=False)
    figure.savefig(folder / "paper_fig4_interactions.png", dpi=150)

    damped, _, _, undamped = found.values()
    paper.said(
        "attraction bends the resonance to lower frequency, repulsion to higher",
        f"the largest amplitude is at {peak(found['no elasticity (K = 0)']):.5f} without elasticity and at "
        f"{peak(found['no adhesion (w = 0)']):.5f} without adhesion",
    )
    paper.said(
        "without damping the hysteresis is very large",
        f"{hysteresis(undamped):.5f} of the frequency without damping, {hysteresis(damped):.5f} with it; the free "
        f"resonance is {1 / paper.FIG4.cantilever.quality_factor:.5f} wide",
    )
    paper.said(
        "at high damping the tip stays in the attractive range, and damping lowers the phase",
        f"largest indentation {float(damped.indentation.max()) * 1e9:.1f} nm with damping, "
        f"{float(undamped.indentation.max()) * 1e9:.1f} nm without",
    )


if __name__ == "__main__":
    main()
