"""Measuring: every method on the cases of every regime."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from phasemap.validation.bench.cases import Field, prepare
from phasemap.validation.bench.compiling import of_solvers
from phasemap.validation.bench.methods import Method, methods_of
from phasemap.validation.bench.peers import Peer
from phasemap.validation.bench.regimes import REGIMES, Regime
from phasemap.validation.bench.runners import Answer, Runner, runner_of

Array = np.ndarray
Say = Callable[[str], None]

GOOD, NO_ORBIT, OTHER_ORBIT, NOT_RUN, NO_REFERENCE = range(5)
"""What became of a method on a case."""
RESULTS = ("good", "no_orbit", "other_orbit", "not_run", "no_reference")
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


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured; arrays over (regime, method, case) unless said otherwise."""

    plan: Plan
    methods: tuple[Method, ...]
    absent: tuple[str, ...]
    fields: tuple[Field, ...]
    # phase_error, height_error: against the reference [degree, m], with sign
    phase_error: Array
    height_error: Array
    # phase_bound, height_bound: what the solver itself estimates [degree, m]; NaN where it does not
    phase_bound: Array
    height_bound: Array
    result: Array  # int8; a place in `RESULTS`
    time: Array  # shape (regime, method); per distinct pixel on one core [s]
    # shape (regime, method); per period of the oscillation [s]; NaN for methods that do not integrate in time
    period_time: Array
    compile_time: Array  # shape (method,); of the processor [s]
    # shape (regime, method, 2, pieces); shortest time so far of each piece of work, and of a period of each case
    # [s]
    clock: Array
    seconds: float  # that all of it took


def measure(plan: Plan, peers: list[Peer], absent: list[str], say: Say) -> Measured:
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
    measured = _empty(plan, methods, tuple(absent), fields)
    runners = _runners(measured, compiled, say)
    for number in range(plan.rounds):
        _one_round(measured, runners, number, say)
    return replace(measured, seconds=time.perf_counter() - started)


def _runners(measured: Measured, compiled: dict[str, float], say: Say) -> list[Runner]:
    """Make a first call of every method, and note how long compilation takes."""
    runners = []
    for m, method in enumerate(measured.methods):
        say(f"compiling {method.label}")
        begun = time.process_time()
        runner = runner_of(method, measured.plan.budget / measured.plan.rounds)
        runners.append(runner)
        for field in measured.fields:
            runner.solve(replace(field, known=field.known[:1]))
        measured.compile_time[m] = compiled.get(method.family, time.process_time() - begun)
    return runners


def _one_round(measured: Measured, runners: list[Runner], number: int, say: Say) -> None:
    """Time everything once more; several rounds, for what disturbs the machine seldom meets a method in all of them."""
    for m, (method, runner) in enumerate(zip(measured.methods, runners, strict=True)):
        say(f"timing, round {number + 1} of {measured.plan.rounds}: {method.label}")
        for r, field in enumerate(measured.fields):
            seconds, answers = runner.solve(field)
            periods = runner.periods(field)
            if number == 0:
                _compare(measured, r, m, answers)
            else:
                seconds = np.fmin(seconds, measured.clock[r, m, 0, : len(seconds)])
                periods = np.fmin(periods, measured.clock[r, m, 1, : len(periods)])
            measured.clock[r, m, 0, : len(seconds)] = seconds
            measured.clock[r, m, 1, : len(periods)] = periods
            measured.time[r, m] = runner.per_pixel(field, seconds)
            known = periods[np.isfinite(periods)]
            measured.period_time[r, m] = known.mean() if known.size else np.nan


def _empty(plan: Plan, methods: tuple[Method, ...], absent: tuple[str, ...], fields: tuple[Field, ...]) -> Measured:
    """Arrays to be filled."""
    shape = (len(fields), len(methods), max(len(field.known) for field in fields))
    return Measured(
        plan=plan,
        methods=methods,
        absent=absent,
        fields=fields,
        phase_error=np.full(shape, np.nan),
        height_error=np.full(shape, np.nan),
        phase_bound=np.full(shape, np.nan),
        height_bound=np.full(shape, np.nan),
        result=np.full(shape, NO_REFERENCE, np.int8),
        time=np.full(shape[:2], np.nan),
        period_time=np.full(shape[:2], np.nan),
        compile_time=np.full(len(methods), np.nan),
        clock=np.full((*shape[:2], 2, max(shape[2], plan.batches)), np.nan),
        seconds=0.0,
    )


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


def _compare(measured: Measured, r: int, m: int, answers: list[Answer | None]) -> None:
    """Note errors, and where there is no orbit or another one."""
    for c, (known, answer) in enumerate(zip(measured.fields[r].known, answers, strict=True)):
        place = r, m, c
        if known.reference is None:
            continue
        if answer is None:
            measured.result[place] = NOT_RUN
        elif not math.isfinite(answer.phase + answer.tip_offset):
            measured.result[place] = NO_ORBIT
        else:
            error = (answer.phase - known.reference.phase + 180) % 360 - 180
            measured.result[place] = GOOD if abs(error) <= OTHER else OTHER_ORBIT
            measured.phase_error[place] = error
            measured.height_error[place] = answer.tip_offset - known.reference.tip_offset
            measured.phase_bound[place], measured.height_bound[place] = answer.phase_bound, answer.height_bound
