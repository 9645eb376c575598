"""Random numbers of their own for each purpose."""

from __future__ import annotations

import numpy as np

from phasemap._shared.checks import whole


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Random numbers of their own for each purpose, such as "height": one kind of noise has no part in another.

    With one stream for all, a relief would go with the domains, and a modulus with the relief, of the same seed.
    """
    return np.random.default_rng([whole("seed", seed, 0), *purpose.encode()])
