"""How do the jumps of the frequency response move with the damping of the sample? Fig. 5 of Wang (1999)"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import paper

FC = paper.FIG3.cantilever.resonance_frequency
C = "C'"
LETTERS = ("A", "B", C, "D")


def frequencies(damping: float) -> dict[str, float]:
    """Frequencies of the jumps over the resonance frequency; without those that are lost."""
    return paper.jumps(paper.response(replace(paper.FILM, damping=damping), paper.FIG3, paper.OFFSET3), FC)


def main(folder: Path = Path()) -> None:
    """Write paper_fig5_jumps.png."""
    dampings = np.concatenate([np.linspace(0, 0.1, 26), np.linspace(0.11, 0.2, 4)])
    found = [frequencies(damping) for damping in dampings]
    curves = {letter: np.array([jumps.get(letter, np.nan) for jumps in found]) for letter in LETTERS}

    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for letter, marker in zip(LETTERS, "^osv", strict=True):
        panels[0].plot(dampings, curves[letter], marker + "-", markersize=4, label=letter)
        panels[1].plot(dampings, (curves[letter] - curves[letter][0]) * 1e3, marker + "-", markersize=4)
    panels[0].axhline(1, color="0.7", linewidth=0.8, zorder=0)
    panels[0].set(xlabel="sample damping alpha1", ylabel="jump frequency / free resonance frequency")
    panels[0].ticklabel_format(useOffset=False)
    panels[0].legend(frameon=False)
    panels[1].set(xlabel="sample damping alpha1", ylabel="shift from no damping (1e-3)", ylim=(-0.12, 0.12))
    panels[1].set_title("the same, enlarged", fontsize=10)
    figure.savefig(folder / "paper_fig5_jumps.png", dpi=150)

    last = int(np.flatnonzero(np.isfinite(curves["B"]))[-1])
    end = {letter: values[-1] for letter, values in curves.items()}
    paper.said(
        "A and D are below the resonance, B is well above",
        ", ".join(f"{letter} {values[0]:.5f}" for letter, values in curves.items()) + " without damping",
    )
    paper.said(
        "B falls fast with damping; A and C' hardly move",
        f"to alpha1 = {dampings[last]:g} B moves by {curves['B'][last] - curves['B'][0]:.5f}, C' by "
        f"{curves[C][last] - curves[C][0]:.5f} and A by {curves['A'][last] - curves['A'][0]:.0e}",
    )
    paper.said(
        "D rises with damping",
        f"to alpha1 = {dampings[-1]:g} by {end['D'] - curves['D'][0]:.5f}: steadily, but no more than C' falls",
    )
    paper.said(
        "B and C' vanish when B reaches 1",
        f"they are last seen at alpha1 = {dampings[last]:g}, B at {curves['B'][last]:.5f} and C' at "
        f"{curves[C][last]:.5f}",
    )


if __name__ == "__main__":
    main()
