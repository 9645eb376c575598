"""Sentences for arguments that a function or class does not have, misses, or has of another kind.

Whether an argument is of the kind that the annotation of its function names is told before anything is done with it.
Numbers, single texts and arrays are left to their function, which knows what of them is allowed.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import cache, wraps
from inspect import Parameter, Signature, signature
from itertools import islice
from typing import NamedTuple, ParamSpec, TypeVar

from phasemap._shared.errors import InputError, Word

MOST = 10_000  # things in a list that is no array


class Kind(NamedTuple):
    """Kind of an argument: in words, in words for several, and a test of a value."""

    words: str
    several: str
    takes: Callable[[object], bool]


CLASSES = (
    "Accuracy", "Cantilever", "Drive", "Interaction", "Material", "Microscope", "Mode", "Realism", "Scene", "Surface",
    "Tip", "TipChange", "Variation", "slice", "xr.DataArray", "xr.Dataset",
)  # fmt: skip
KINDS = {
    "None": Kind("None", "None", lambda value: value is None),
    "bool": Kind("True or False", "True and False", lambda value: type(value).__name__ == "bool"),
    "str": Kind("a string", "strings", lambda value: isinstance(value, str)),
    "os.PathLike[str]": Kind("a path", "paths", lambda value: isinstance(value, os.PathLike)),
    "Progress": Kind("a function, called as progress(done, total)", "functions",
                     lambda value: callable(value) and not isinstance(value, type)),
}  # fmt: skip
"""Kinds of arguments, by their annotation."""


def of_kind(name: str, value: object, annotation: object, hint: str = "") -> object:
    """Return the value, as a list where it could be walked through only once, or without end."""
    kind = kind_of(annotation) if isinstance(annotation, str) else None
    if kind is None:
        return value
    given = value
    if "Iterable[" in str(annotation) and isinstance(value, Iterable) and not isinstance(value, (Sequence, Mapping)):
        with suppress(Exception):  # it says that it can be walked through, and raises what it likes
            given = list(islice(value, MOST + 1))
    if kind.takes(given):
        return given
    shown = value
    if not isinstance(value, (str, bool, int, float, type(None))):
        shown = Word(f"the class {value.__name__}" if isinstance(value, type) else f"of type {type(value).__name__}")
    allowed = kind.words.replace(" or ", ", ", kind.words.count(" or ") - 1)
    raise InputError(name, shown, allowed, hint)


@cache
def kind_of(annotation: str) -> Kind | None:
    """The kind that an annotation names; None where that is left to the function."""
    return None if annotation in ("str", "str | None") else _kind(ast.parse(annotation, mode="eval").body)


def _kind(node: ast.expr) -> Kind | None:
    """The kind that a parsed annotation names, with unions and lists of kinds; None where it names none."""
    name = ast.unparse(node)
    if isinstance(node, ast.BinOp):
        left, right = _kind(node.left), _kind(node.right)
        return left and right and _either(left, right)
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) in ("Iterable", "Sequence"):
        kind = _kind(node.slice)
        return kind and _list_of(kind)
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Mapping":
        return Kind("a dict", "dicts", lambda value: isinstance(value, Mapping))
    return _instance_of(name) if name in CLASSES else KINDS.get(name)


def _either(first: Kind, second: Kind) -> Kind:
    """Kind of values that are of one kind or of another."""
    return Kind(
        f"{first.words} or {second.words}",
        f"{first.several} or {second.several}",
        lambda value: first.takes(value) or second.takes(value),
    )


def _list_of(kind: Kind) -> Kind:
    """Kind of lists and tuples of values of one kind."""

    def takes(value: object) -> bool:
        if not isinstance(value, Sequence) or isinstance(value, (str, bytes)) or len(value) > MOST:
            return False
        return all(map(kind.takes, value))

    return Kind(f"a list of {kind.several}", f"lists of {kind.several}", takes)


def _instance_of(name: str) -> Kind:
    """Told by the name of the class, so that none needs to be imported."""
    last, called = name.rpartition(".")[2], name.replace("xr.", "xarray.")
    words = f"an {called}" if called[0] in "AIx" else f"a {called}"
    return Kind(words, f"{called}s", lambda value: any(cls.__name__ == last for cls in type(value).__mro__))


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

    Their kinds are read from annotations. `hint`: what else to say where some are missing, or too many. `symbols`:
    arguments, by the names that others have for them.
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
                wrong = _wrongly(called, asked, call, len(given) - ("self" in asked.parameters), list(named), symbols)
                raise TypeError(f"{wrong or f'{called}: {error}.'} {hint}".rstrip()) from None
            for name, value in bound.arguments.items():
                order = f"The order is {call}." if name in needed else ""
                bound.arguments[name] = of_kind(name, value, asked.parameters[name].annotation, order)
            return ask(*bound.args, **bound.kwargs)

        return answer

    return helpful


def _wrongly(of: str, asked: Signature, call: str, given: int, named: list[str], symbols: Mapping[str, str]) -> str:
    """Sentence on what is wrong with a call; empty where an argument is given twice."""
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
    """Call of a function with the arguments that it needs, as text."""
    ordered = _ordered(asked)
    return f"{of}({', '.join(name if name in ordered else f'{name}=...' for name in needed)})"


def _ordered(asked: Signature) -> list[str]:
    """Names of the arguments that may be given by their order."""
    every = asked.parameters.items()
    return [name for name, one in every if one.kind is Parameter.POSITIONAL_OR_KEYWORD and name != "self"]
