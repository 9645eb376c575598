"""Sentences for arguments that a function or class does not have, misses, or has of another kind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import ParamSpec, TypeVar

from phasemap._shared.kinds import of_kind

P = ParamSpec("P")
R = TypeVar("R")


def no_argument(of: str, name: str, names: Iterable[str], symbols: Mapping[str, str]) -> str:
    """Say that there is no such argument, and which was meant."""
    names = list(names)
    near = symbols.get(name) or next(iter(get_close_matches(name, names, 1, 0.5)), None)
    meant = f" Did you mean {near!r}?" if near else ""
    return f"{of} has no argument {name!r}; its arguments are {', '.join(names)}.{meant}"


def asked_as(hint: str = "", **symbols: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function say in a sentence which arguments it takes, where it is called with others.

    What an argument may be is read from its annotation, as `phasemap._shared.kinds` does.

    `hint`: what else to say where arguments are missing, or too many.
    `**symbols`: arguments, by the names that others have for them.
    """

    def helpful(ask: Callable[P, R]) -> Callable[P, R]:
        asked = signature(ask)
        own = [name for name in asked.parameters if name not in ("self", "cls")]
        needed = [name for name in own if asked.parameters[name].default is Parameter.empty]
        called = ask.__qualname__.split(".")[-2] if ask.__name__ == "__init__" else ask.__name__
        call = _call(called, asked, needed)

        @wraps(ask)
        def answer(*given: P.args, **named: P.kwargs) -> R:
            try:
                bound = asked.bind(*given, **named)
            except TypeError as error:
                said = _wrongly(called, asked, call, len(given) - ("self" in asked.parameters), list(named), symbols)
                raise TypeError(f"{said or f'{called}: {error}.'} {hint}".rstrip()) from None
            for name, value in bound.arguments.items():
                order = f"The order is {call}." if name in needed else ""
                bound.arguments[name] = of_kind(name, value, asked.parameters[name].annotation, order)
            return ask(*bound.args, **bound.kwargs)

        return answer

    return helpful


def _wrongly(of: str, asked: Signature, call: str, given: int, named: list[str], symbols: Mapping[str, str]) -> str:
    """What is wrong with a call, in a sentence; nothing where an argument is given twice."""
    names = [name for name in asked.parameters if name != "self"]
    for name in named:
        if name not in names:
            return no_argument(of, name, names, symbols)
    ordered = _ordered(asked)
    needed = [name for name in names if asked.parameters[name].default is Parameter.empty]
    if given > len(ordered):
        return f"{of} takes {len(ordered)} arguments by their order and {given} are given; it is called as {call}."
    missing = [name for name in needed if name not in {*ordered[:given], *named}]
    return f"{of} needs {' and '.join(missing)}; it is called as {call}." if missing else ""


def _call(of: str, asked: Signature, needed: list[str]) -> str:
    """How a function is called with what it needs."""
    ordered = _ordered(asked)
    return f"{of}({', '.join(name if name in ordered else f'{name}=...' for name in needed)})"


def _ordered(asked: Signature) -> list[str]:
    every = asked.parameters.items()
    return [name for name, one in every if one.kind is Parameter.POSITIONAL_OR_KEYWORD and name != "self"]
