"""Few cases that try every two options together, and those that are refused."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import pytest

from phasemap._shared.errors import InputError

Case = dict[str, str]
Options = dict[str, tuple[str, ...]]


@dataclass(frozen=True)
class Pairs:
    """Options by name with their values, and which of them do not go together."""

    options: Options  # the first value of each is the plain one
    refused: list[tuple[str, Options]]  # what the sentence is about, and options that it refuses
    idle: list[Options]  # options that do nothing together, cannot be asked for, or take too long

    def refusals(self, case: Case) -> list[str]:
        """What a sentence that refuses these options may be about."""
        return [about for about, options in self.refused if asks_for(case, options)]

    def allowed(self, case: Case) -> bool:
        return not self.refusals(case) and not any(asks_for(case, options) for options in self.idle)

    def cases(self, begun: list[Case]) -> list[Case]:
        """Few cases that have all pairs of values which are allowed in some case, and these that are begun."""
        names = list(self.options)
        pairs = [(a, b) for m, n in itertools.combinations(names, 2) for a in self._values(m) for b in self._values(n)]
        left, cases = dict.fromkeys(pairs), list[Case]()
        for begin in [*begun, *map(dict, pairs)]:
            if len(begin) == 2 and tuple(begin.items()) not in left:
                continue
            case = dict(begin)
            for name in names:
                if name not in case:
                    found = [value for _, value in self._values(name) if self.allowed({**case, name: value})]
                    found = found or list(self.options[name][:1])
                    turn = len(cases) % len(found)  # of several that are as good, now this one and now that
                    case[name] = max(found[turn:] + found[:turn], key=lambda value: gain(case, name, value, left))
            if self.allowed(case):
                cases.append({name: case[name] for name in names})
                for pair in itertools.combinations(cases[-1].items(), 2):
                    left.pop(pair, None)
        return cases

    def never(self) -> list[Case]:
        """The plain case with each pair of options that is refused."""
        plain = {name: first for name, (first, *_) in self.options.items()}
        return [
            plain | dict(zip(options, found, strict=True))
            for _, options in self.refused
            for found in itertools.product(*options.values())
        ]

    def assert_refused(
        self, case: Case, ask: Callable[[], object], patch: pytest.MonkeyPatch, work: Iterable[tuple[object, str]]
    ) -> None:
        """Asking for these options ends in a sentence about one of them, before any of the functions of `work`."""
        for module, name in work:
            patch.setattr(module, name, lambda *_: pytest.fail("work has started"))
        with pytest.raises(InputError, match=r"\A.+ is .+; allowed: .+\Z") as raised:
            ask()
        assert raised.value.name in self.refusals(case)

    def label(self, case: Case) -> str:
        return ", ".join(value for name, value in case.items() if value != self.options[name][0]) or "plain"

    def _values(self, name: str) -> list[tuple[str, str]]:
        return [(name, value) for value in self.options[name]]


def asks_for(case: Case, options: Options) -> bool:
    return all(case.get(name) in values for name, values in options.items())


def gain(case: Case, name: str, value: str, left: dict[Any, None]) -> int:
    """Number of pairs still left that a value adds to a case."""
    new = (name, value)
    return sum((one, new) in left or (new, one) in left for one in case.items())
