"""Parameters of Wang (1999), "The role of damping in phase imaging in tapping mode AFM", Surf. Sci. 429, 178

Shared by the examples `paper_fig*.py` and tests/examples/test_paper.py. Values that the paper gives are plain numbers
here; for what it leaves open, a value is chosen, and a comment says why.
"""

import math
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import phasemap as pm
from phasemap.experiment.interaction import MaugisDugdale

RADIUS = 30e-9
FILM = pm.Material(modulus=0.89e9, adhesion=0.37, damping=0.014)  # polyethylene as fitted in Fig. 3: K = 1.35 GPa

# Open: the range of Maugis's attraction. With d0 itself Maugis is JKR for this film (lambda = 6); with 1.5 nm
# (lambda = 1.2) it is between JKR and DMT, as the paper draws it.
LAWS = {"Hertz": "hertz", "DMT": "dmt", "Maugis": MaugisDugdale(range=1.5e-9), "JKR": "jkr"}


def lever(resonance: float, alpha0: float, base_amplitude: float) -> pm.Microscope:
    """Give the paper's lever, k = 40 N/m and R = 30 nm, by its free damping and the amplitude of its base [m].

    The range d0 of the attraction is open. 0.3 nm, phasemap's default, is the distance of atoms in contact, which is
    what d0 means where the attraction is van der Waals'. From 0.1 to 1 nm the jumps of Fig. 3, the jump A of Fig. 7 and
    the overlaps of Fig. 8 stay, a little shifted.
    """
    quality = 0.5 / alpha0
    return pm.Microscope(
        pm.Cantilever(40.0, resonance, quality),
        pm.Tip(RADIUS),
        pm.Drive(base_amplitude * quality),
        pm.Interaction("dmt", decay_length=0.3e-9),
    )


FIG3 = lever(148.24e3, 0.002, 0.62e-9)  # Q = 250, free amplitude 155 nm
FIG4 = lever(148.51e3, 0.0006, 0.152e-9)  # Q = 833, free amplitude 127 nm

# Open: the tip offsets of the frequency responses. At 140 nm (90 % of the free amplitude) the response of Fig. 3 has
# all four jumps; at 150 nm B and C' are lost, and the nearer the tip, the farther above the resonance B is. Fig. 4
# says that hysteresis is very large without damping: at 110 nm it is six times as wide as the free resonance.
OFFSET3, OFFSET4 = 140e-9, 110e-9

# Open: the film of Fig. 4, "at high damping". It is that of Fig. 3 with so much damping that, as the paper says, the
# tip is held in the attractive regime.
FILM4 = pm.Material(modulus=0.89e9, adhesion=0.37, damping=0.1)

# Open: the lever and the drive of Figs. 7 to 9. This is the lever of Fig. 3 at half its amplitude, 80 nm. At 155 nm
# the tip is repulsive on every modulus, and there is no jump A in Fig. 8; at 60 nm and less there is still hysteresis
# over the modulus at alpha1 = 0.1.
FIG7 = lever(148.24e3, 0.002, 0.32e-9)


def adhesion(force: float) -> float:
    """Work of adhesion [J/m2] of an adhesion force f0 = 2 pi w R [N]."""
    return force / (2 * math.pi * RADIUS)


# Open: the film of Fig. 7. This is the modulus of Fig. 3 and the adhesion force of Fig. 8.
FILM7 = pm.Material(modulus=0.89e9, adhesion=adhesion(40e-9))


def response(film: pm.Material, scope: pm.Microscope, tip_offset: float) -> xr.Dataset:
    """Sweep the frequency through the resonance, up and down."""
    fc = scope.cantilever.resonance_frequency
    return pm.sweep_frequency(film, scope, np.linspace(0.994, 1.012, 91) * fc, tip_offset=tip_offset)


def jumps(sweep: xr.Dataset, resonance: float) -> dict[str, float]:
    """Frequencies of the jumps over the resonance frequency, by the paper's letters: A, B upwards, C', D downwards."""
    letters = {(0, False): "A", (0, True): "B", (1, True): "C'", (1, False): "D"}
    ratios = sweep.jump_frequency.values / resonance
    directions = sweep.jump_direction.values
    return {letters[int(way), bool(ratio > 1)]: float(ratio) for way, ratio in zip(directions, ratios, strict=True)}


def draw(axes: plt.Axes, sweep: xr.Dataset, name: str, x: float = 1.0, y: float = 1.0, **style: Any) -> None:
    """Draw every orbit over the swept axis, times x and y: stable ones as lines, unstable ones dotted."""
    axis = str(sweep["status"].dims[1])
    for piece in np.unique(sweep.curve_piece):
        points = sweep.isel(point=np.flatnonzero(sweep.curve_piece == piece))
        for dots, shown in (("-", points.curve_stable), (":", 1 - points.curve_stable)):
            shown = shown.astype(bool) | (shown.shift(point=1) == 1) & (dots == ":")
            axes.plot(points[f"curve_{axis}"] * x, points[f"curve_{name}"].where(shown) * y, **{"ls": dots, **style})
            style.pop("label", None)


def said(statement: str, found: str) -> None:
    """Print what the paper states, and what was found."""
    print(f"paper: {statement}\n here: {found}")
