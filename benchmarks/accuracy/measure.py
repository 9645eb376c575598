"""Measuring: every method on the cases of every regime."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.accuracy.cases import Field, prepare
from benchmarks.accuracy.methods import methods_of
from benchmarks.accuracy.peers import Peer
from benchmarks.accuracy.record import GOOD, NO_ORBIT, NOT_RUN, OTHER_ORBIT, unmeasured
from benchmarks.accuracy.regimes import REGIMES, Regime
from benchmarks.accuracy.runners import Answer, Runner, runner_of
from benchmarks.compile import of_solvers

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Say = Callable[[str], None]

OTHER = 1.0
"""[degree] An orbit farther from the reference than this is another one, or as wrong."""


@dataclass(frozen=True)
class Plan:
    """How much is measured."""

    batches: int = 5  # microscopes drawn in a regime
    timed: int = 64  # pixels under each that are timed
    references: int = 8  # pixels under each that are compared with the reference, at most `timed`
    seed: int = 1  # of the cases drawn
    budget: float = 0.15  # seconds for which the timing of a solver is repeated in each regime, all rounds together
    rounds: int = 3  # how often everything is timed in turn
    cold: bool = True  # whether compilation is timed too, with an empty cache
    regimes: tuple[Regime, ...] = REGIMES

    @classmethod
    def of(cls, pixels: int, seed: int, quick: bool = False) -> Plan:
        """A plan that compares about this many pixels a regime with the reference.

        Examples
        --------
        >>> plan = Plan.of(40, seed=1)
        >>> plan.batches * plan.references, plan.batches * plan.timed
        (40, 320)
        """
        batches = min(max(2, math.ceil(pixels / 8)), pixels, 8)
        references = math.ceil(pixels / batches)
        timed = max(48 if quick else 64, references)
        return cls(batches, timed, references, seed, 0.04 if quick else 0.15, 2 if quick else 3, not quick)


def measure(plan: Plan, peers: list[Peer], absent: list[str], say: Say) -> xr.Dataset:
    """Do everything that a plan says.

    `absent`: names of those that are not installed.
    """
    started = time.perf_counter()
    methods = methods_of(peers)
    with ThreadPoolExecutor(1) as beside:  # this does nothing that is timed meanwhile
        compiling = beside.submit(of_solvers, plan.cold)
        fields = _fields(plan, say)
        say("waiting for a compilation from scratch" if plan.cold else "compiling, or reading what is compiled")
        compiled = compiling.result()
    ds = unmeasured(methods, fields, asdict(plan) | {"regimes": [regime.name for regime in plan.regimes]})
    runners = []
    for m, method in enumerate(methods):
        say(f"compiling {method.label}")
        begun = time.process_time()
        runners.append(runner := runner_of(method, plan.budget / plan.rounds))
        for field in fields:
            runner.solve(replace(field, known=field.known[:1]))
        ds["compile_time"][m] = compiled.get(method.family, time.process_time() - begun)
    _time(ds, fields, runners, plan.rounds, say)
    return ds.assign_attrs(
        not_installed=", ".join(absent),
        compilation="with an empty cache" if plan.cold else "what was compiled before is reused",
        seed=plan.seed,
        timed_pixels=plan.batches * plan.timed,
        seconds=round(time.perf_counter() - started, 1),
    )


def _time(ds: xr.Dataset, fields: tuple[Field, ...], runners: list[Runner], rounds: int, say: Say) -> None:
    """Time everything in several rounds, for what disturbs the machine seldom meets a method in all of them."""
    shortest: dict[tuple[int, int], Array] = {}  # seconds of each piece of work, then of a period of each case
    for number in range(rounds):
        for m, runner in enumerate(runners):
            say(f"timing, round {number + 1} of {rounds}: {ds['solver'].values[m]}")
            for r, field in enumerate(fields):
                seconds, answers = runner.solve(field)
                if number == 0:
                    _compare(ds.isel(regime=r, solver=m), field, answers)
                clock = np.concatenate([seconds, runner.periods(field)])
                clock = shortest[r, m] = np.fmin(clock, shortest.get((r, m), clock))
                ds["time"][r, m] = runner.per_pixel(field, clock[: len(seconds)])
                periods = clock[len(seconds) :]
                ds["period_time"][r, m] = periods[np.isfinite(periods)].mean() if np.isfinite(periods).any() else np.nan


def _fields(plan: Plan, say: Say) -> tuple[Field, ...]:
    fields = []
    for number, regime in enumerate(plan.regimes):
        done = 0

        def tick(name: str = regime.name) -> None:
            nonlocal done
            done += 1
            say(f"reference orbits of {name}: {done} of {plan.batches * plan.references}")

        # A generator for each regime: its cases are the same whatever other regimes are measured.
        rng = np.random.default_rng([plan.seed, number])
        fields.append(prepare(regime, plan.batches, plan.timed, plan.references, rng, tick))
    return tuple(fields)


def _compare(row: xr.Dataset, field: Field, answers: list[Answer | None]) -> None:
    """Note errors of a method in a regime, and where there is no orbit or another one.

    `row`: views of the arrays over "case".
    """
    numbers = ("phase_error", "height_error", "phase_bound", "height_bound")
    result, noted = row["result"].values, {name: row[name].values for name in numbers}
    for c, (known, answer) in enumerate(zip(field.known, answers, strict=True)):
        if known.reference is None:
            continue
        if answer is None:
            result[c] = NOT_RUN
        elif not math.isfinite(answer.phase + answer.tip_offset):
            result[c] = NO_ORBIT
        else:
            error = (answer.phase - known.reference.phase + 180) % 360 - 180
            result[c] = GOOD if abs(error) <= OTHER else OTHER_ORBIT
            noted["phase_error"][c] = error
            noted["height_error"][c] = answer.tip_offset - known.reference.tip_offset
            noted["phase_bound"][c], noted["height_bound"][c] = answer.phase_bound, answer.height_bound
