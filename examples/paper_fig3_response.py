"""Which branches does the frequency response on polyethylene have, and where does it jump? Fig. 3 of Wang (1999)

Free, attractive and repulsive branches are joined by unstable ones. When the frequency is swept up, the amplitude
jumps at A to the repulsive branch and at B off it; when it is swept down, the amplitude jumps at C' to the repulsive
branch and at D back to the free one.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import paper
import xarray as xr

FC = paper.FIG3.cantilever.resonance_frequency
C = "C'"
BESIDE = {"A": (6, -4), "B": (6, 2), "C'": (7, -2), "D": (-13, -2)}  # places of the letters [points]


def mark(axes: plt.Axes, sweep: xr.Dataset, name: str, factor: float) -> None:
    """Draw the jumps as arrows with the paper's letters."""
    for i, letter in enumerate(paper.jumps(sweep, FC)):
        x = float(sweep.jump_frequency[i]) / FC
        start, end = (float(sweep[f"jump_{way}_{name}"][i]) * factor for way in ("from", "to"))
        color = "C3" if sweep.jump_direction[i] == 0 else "C0"
        axes.annotate("", (x, end), (x, start), arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.6})
        axes.annotate(letter, (x, start), BESIDE[letter], textcoords="offset points", color=color, weight="bold")


def main(folder: Path = Path()) -> None:
    """Write paper_fig3_response.png."""
    sweep = paper.response(paper.FILM, paper.FIG3, paper.OFFSET3)
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for axes, name, factor, label in (
        (panels[0], "amplitude", 1e9, "amplitude (nm)"),
        (panels[1], "phase", 1, "phase (degrees)"),
    ):
        paper.draw(axes, sweep, name, 1 / FC, factor, color="0.2", linewidth=1.4)
        mark(axes, sweep, name, factor)
        axes.set(xlabel="drive frequency / free resonance frequency", ylabel=label, xlim=(0.9965, 1.0035))
    panels[0].set_ylim(70, 160)
    for place, branch in {(0.9969, 105): "free", (1.0024, 108): "free", (0.9994, 134): "attractive"}.items():
        panels[0].text(*place, branch, color="0.4")
    panels[0].text(0.9995, 151.5, "repulsive", color="0.4")
    panels[1].set_ylim(-65, 65)
    panels[1].axhline(0, color="0.8", linewidth=0.8, zorder=0)
    for style, label in (("-", "stable"), (":", "unstable")):
        panels[1].plot([], [], color="0.2", linestyle=style, label=label)
    panels[1].plot([], [], color="C3", marker=">", linestyle="none", label="jump, swept up")
    panels[1].plot([], [], color="C0", marker="<", linestyle="none", label="jump, swept down")
    panels[1].legend(frameon=False)
    figure.savefig(folder / "paper_fig3_response.png", dpi=150)

    found = paper.jumps(sweep, FC)
    paper.said(
        "free, attractive and repulsive branches joined by unstable ones, with jumps A, B, C', D",
        "jumps at " + ", ".join(f"{letter} {found[letter]:.5f}" for letter in BESIDE)
        + f" of the resonance, {sweep.sizes['fold']} folds",
    )  # fmt: skip
    paper.said(
        "up and down sweeps differ (hysteresis)",
        f"between D and A ({(found['A'] - found['D']) * FC:.0f} Hz) and between C' and B "
        f"({(found['B'] - found[C]) * FC:.0f} Hz)",
    )


if __name__ == "__main__":
    main()
