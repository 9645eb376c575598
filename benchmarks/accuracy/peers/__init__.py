"""General integrators used as their users would: shooting with Newton's method, from the averaged orbit.

Each peer integrates one period; what is around it is the same for all (`shooting`). A peer that is not installed is
left out, and the report says so.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Protocol

from benchmarks.accuracy.peers.heyoka import Heyoka
from benchmarks.accuracy.peers.numbalsoda import Numbalsoda
from benchmarks.accuracy.peers.scipy import Scipy
from benchmarks.accuracy.peers.shooting import Period, Shoot

__all__ = ["PEERS", "Peer", "Period", "Shoot", "installed"]


class Peer(Protocol):
    """What a peer offers."""

    name: str
    tolerances: tuple[float, ...]
    share: int  # one in so many cases is given to it, so that a slow one does not take minutes

    def prepare(self, tolerance: float) -> tuple[Shoot, Period]:
        """Compile what finds an orbit and what integrates one period, at this tolerance."""
        ...


PEERS: tuple[Peer, ...] = (Numbalsoda(), Heyoka(), Scipy())


def installed() -> tuple[list[Peer], list[str]]:
    """Peers that can be imported, and the names of those that cannot.

    Examples
    --------
    >>> present, absent = installed()
    >>> "scipy" in [peer.name for peer in present], len(present) + len(absent)
    (True, 3)
    """
    present = [peer for peer in PEERS if find_spec(peer.name) is not None]
    return present, [peer.name for peer in PEERS if peer not in present]
