"""How much does the phase depend on the contact theory? Fig. 6 of Wang (1999)

The response of Fig. 3 with Hertz, DMT, Maugis-Dugdale and JKR contact. Each point is taken from a distance curve at
that frequency, at the tip offset of Fig. 3, because curves along the frequency end where the tip just grazes the neck
of Maugis-Dugdale or JKR contact.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import paper

import phasemap as pm

FC = paper.FIG3.cantilever.resonance_frequency
HEIGHTS = np.linspace(160e-9, 120e-9, 5)  # with the tip offset of Fig. 3 among them


def phases(law: str, ratio: float) -> np.ndarray:
    """Phases [degree] of the stable orbits at the tip offset of Fig. 3, rising.

    Parameters
    ----------
    law : str
        One of `paper.LAWS`.
    ratio : float
        Drive frequency over the free resonance frequency.
    """
    scope = replace(
        paper.FIG3,
        drive=replace(paper.FIG3.drive, frequency=ratio * FC),
        interaction=pm.Interaction(paper.LAWS[law], decay_length=0.3e-9),
    )
    curve = pm.sweep_distance(paper.FILM, scope, HEIGHTS)
    here = np.isclose(curve.curve_tip_offset, paper.OFFSET3, rtol=1e-9, atol=0) & (curve.curve_stable == 1)
    return np.unique(curve.curve_phase.values[here].round(4))


def main(folder: Path = Path()) -> None:
    """Write paper_fig6_laws.png."""
    ratios = np.linspace(0.9965, 1.0035, 43)
    figure, panels = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    for law, marker in zip(paper.LAWS, "^osD", strict=True):
        points = [(ratio, phase) for ratio in ratios for phase in phases(law, ratio)]
        for axes in panels:
            axes.plot(*np.transpose(points), marker, markersize=4.5, markerfacecolor="none", label=law)
            axes.set_xlabel("drive frequency / free resonance frequency")
    panels[0].axhline(0, color="0.8", linewidth=0.8, zorder=0)
    panels[0].set_ylabel("phase (degrees)")
    panels[0].legend(frameon=False)
    panels[1].set(xlim=(0.9985, 1.0016), ylim=(2, 30), title="the repulsive branch, enlarged")
    figure.savefig(folder / "paper_fig6_laws.png", dpi=150)

    hard, slight = ({law: phases(law, ratio) for law in paper.LAWS} for ratio in (1.0005, 1.0015))
    paper.said(
        "on the repulsive branch the phase of DMT is less than that of Maugis, and that less than that of JKR",
        "at 1.0005 " + ", ".join(f"{law} {found[-1]:.2f}°" for law, found in hard.items()),
    )
    paper.said(
        "where the tip taps slightly, the long-range force alone sets the phase",
        "at 1.0015 " + ", ".join(f"{law} {found[0]:.4f}°" for law, found in slight.items()),
    )


if __name__ == "__main__":
    main()
