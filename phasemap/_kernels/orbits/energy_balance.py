"""Energy balance of an orbit over a period, in [J] or over the stiffness: what is supplied is lost, if it is exact."""

from __future__ import annotations

from phasemap._kernels.compilation import kernel


@kernel(inline=True)
def energy_closure(supplied: float, one_loss: float, other_loss: float) -> float:
    """Energy in less energy out, over energy in [1]; the losses are those in the surface and into the air."""
    return (supplied - one_loss - other_loss) / supplied
