"""Which force does each contact theory give? Fig. 2 of Wang (1999)

Hertz, DMT, Maugis-Dugdale and JKR contact with the film of Fig. 3, and the long-range attraction outside contact.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import paper

from phasemap.experiment.interaction import Interaction
from phasemap.experiment.interaction.longrange import InverseSquare

ADHESION = 2 * np.pi * paper.FILM.adhesion * paper.RADIUS


def forces(law: str, depths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] at each depth [m] in contact, necks included, and before contact; NaN where there is none."""
    interaction = Interaction(paper.LAWS[law], decay_length=0.3e-9)
    stiffness = np.array([4 / 3 * paper.FILM.modulus / (1 - paper.FILM.poisson_ratio**2)])
    row = interaction.columns(stiffness, np.array([paper.FILM.adhesion]), np.zeros(1), paper.RADIUS)[0]
    inside = np.array([interaction.law.force(d, row) if d >= row[10] else np.nan for d in depths])
    outside = np.array([InverseSquare.force(d, row) if d < 0 else np.nan for d in depths])
    return inside, outside


def main(folder: Path = Path()) -> None:
    """Write paper_fig2_forces.png."""
    depths = np.linspace(-4e-9, 14e-9, 721)
    figure, axes = plt.subplots(figsize=(6.2, 4.4), layout="constrained")
    for law in paper.LAWS:
        inside, outside = forces(law, depths)
        (line,) = axes.plot(-depths * 1e9, inside * 1e9, label=law)
        axes.plot(-depths * 1e9, outside * 1e9, "--", linewidth=1, color=line.get_color())
    axes.plot([], [], "--", color="0.4", label="long range")
    axes.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    axes.set(xlabel="tip-sample separation (nm)", ylabel="force (nN)", xlim=(-14, 4))
    axes.legend(frameon=False)
    figure.savefig(folder / "paper_fig2_forces.png", dpi=150)

    first, deep, deeper = ({law: forces(law, np.array([d]))[0][0] for law in paper.LAWS} for d in (0, 10e-9, 100e-9))
    paper.said(
        "f0 = 69.7 nN; attraction and contact join at d = 0",
        f"2 pi w R = {ADHESION * 1e9:.1f} nN; at d = 0 the force is "
        + ", ".join(f"{value / ADHESION:.2f} f0 ({law})" for law, value in first.items()),
    )  # fmt: skip
    paper.said(
        "the force is attractive at small separation and approaches Hertz at large deformation",
        "of Hertz it is at 10 and 100 nm "
        + ", ".join(f"{deep[law] / deep['Hertz']:.2f} and {deeper[law] / deeper['Hertz']:.2f} ({law})" for law in deep),
    )


if __name__ == "__main__":
    main()
