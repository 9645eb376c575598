"""Materials that are not the same everywhere: a spread of their properties within a domain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.checks import whole
from phasemap._shared.fields import Number, known_as
from phasemap._shared.shown import Shown
from phasemap.experiment.generate.waves import roughness

VARIED = {
    "modulus": "modulus", "relaxed_modulus": "modulus", "adhesion": "adhesion", "damping": "loss", "viscosity": "loss",
}  # fmt: skip
"""The property of a map, and the spread that it has."""


@known_as()
@dataclass(frozen=True, repr=False)
class Variation(Shown):
    """How much the properties of each material vary from place to place.

    Parameters
    ----------
    modulus : float
        Relative standard deviation of the modulus [1], >= 0 and at most 2: that of its logarithm, which is normally
        distributed around the material's own.
    adhesion : float
        The same for the adhesion.
    loss : float
        The same for damping or viscosity.
    correlation_length : float
        Over which they vary [m], one pixel or more and at most the shorter side of the surface.
    seed : int
        Of what is random, >= 0.

    Examples
    --------
    >>> Variation(modulus=0.2, correlation_length="30 nm")
    Variation(modulus=0.2, correlation_length=3e-08)
    """

    modulus: Number[float] = Number("1", 0.15, said="variation of the modulus", minimum=0, maximum=2)
    adhesion: Number[float] = Number("1", 0.1, said="variation of the adhesion", minimum=0, maximum=2)
    loss: Number[float] = Number("1", 0.15, said="variation of the loss", minimum=0, maximum=2)
    correlation_length: Number[float] = Number("m", 25e-9, above=0, maximum=1.0, usual=(1e-10, 1e-4))
    seed: int = 0

    def __post_init__(self) -> None:
        whole("seed", self.seed, 0)

    def of(self, maps: Mapping[str, Any], shape: tuple[int, int], sides: tuple[float, float]) -> dict[str, Any]:
        """The maps of a surface that varies so.

        `maps`: arguments of `phasemap.Surface`, numbers or arrays.
        `sides`: of a pixel, (dy, dx) [m].
        """
        factors: dict[str, NDArray[np.float64] | float] = {}
        for i, name in enumerate(("modulus", "adhesion", "loss")):
            size = getattr(self, name)
            length, seed = self.correlation_length, 3 * self.seed + i
            field = roughness(shape, sides, rms=1.0, correlation_length=length, seed=seed) if size else 0.0
            factors[name] = np.exp(size * field)
        return {key: value * factors[VARIED[key]] if key in VARIED else value for key, value in maps.items()}
