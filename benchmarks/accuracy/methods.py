"""What is measured: every solver of phasemap at every tolerance it has, and the peers at theirs."""

from __future__ import annotations

from dataclasses import dataclass, field

from benchmarks.accuracy.peers import Peer
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.solver import March, Solver, by_name

PHASES = (1.0, 0.1, 0.01, 1e-3, 1e-4)
"""Accuracies asked of "auto" [degree]; the height's goes along, 1 pm at 0.01 degree as by default."""
HEIGHT_PER_DEGREE = 1e-10
ETAS = (0.8, 0.6, 0.45, 0.3)
"""Step sizes of "march"; its error goes with their 8th power."""


@dataclass(frozen=True)
class Method:
    """A solver of phasemap at one tolerance, or a peer at one."""

    family: str  # what shares a line in the diagram: the name of the solver or peer
    setting: str = ""  # the tolerance in words; empty where there is none
    solver: Solver | None = None
    accuracy: Accuracy = field(default_factory=Accuracy)  # asked of the solver
    peer: Peer | None = None
    tolerance: float = 0.0  # of the peer's integrator, or eta of the march [1]

    @property
    def label(self) -> str:
        """Family and setting.

        Examples
        --------
        >>> [method.label for method in methods_of([])[:2]]
        ['averaging', 'auto 1°']
        """
        return f"{self.family} {self.setting}".strip()


def methods_of(peers: list[Peer]) -> tuple[Method, ...]:
    """Every method, in the order of the table."""
    auto = [
        Method("auto", f"{phase:g}°", by_name("auto"), Accuracy(phase, HEIGHT_PER_DEGREE * phase)) for phase in PHASES
    ]
    march = [Method("march", f"eta {eta:g}", March(eta), tolerance=eta) for eta in ETAS]
    others = [
        Method(peer.name, f"{tolerance:.0e}", peer=peer, tolerance=tolerance)
        for peer in peers
        for tolerance in peer.tolerances
    ]
    return (Method("averaging", solver=by_name("averaging")), *auto, Method("orbit", solver=by_name("orbit")),
            *march, *others)  # fmt: skip
