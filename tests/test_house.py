"""The sizes that a reader can expect, of a list of arguments and of a file, and how errors say values."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import phasemap

PACKAGE = Path(phasemap.__file__).parent
MOST_ARGUMENTS, MOST_LINES = 9, 400

MANY_ARGUMENTS = {
    "_kernels/orbits/time/march.py march": "called by its address, with numbers and arrays only",
}
"""Functions that may take more, and why."""


def files() -> Iterator[tuple[str, str]]:
    """Every module of the package, by its place in it, and its text."""
    for path in sorted(PACKAGE.rglob("*.py")):
        yield path.relative_to(PACKAGE).as_posix(), path.read_text()


# Equal, not less: what no longer breaks the rule may not stay in the list.
def test_no_function_takes_more_than_nine_arguments_by_place() -> None:
    found = {
        f"{place} {one.name}"
        for place, text in files()
        for one in ast.walk(ast.parse(text))
        if isinstance(one, ast.FunctionDef) and len(one.args.posonlyargs + one.args.args) > MOST_ARGUMENTS
    }
    assert found == set(MANY_ARGUMENTS)


def test_no_file_is_longer_than_four_hundred_lines() -> None:
    assert not [place for place, text in files() if len(text.splitlines()) > MOST_LINES]


def test_a_value_that_an_error_describes_has_no_quotes() -> None:
    # "not increasing" would make of it: coordinate x is 'not increasing'. Word("not increasing") does not.
    quoted = {
        f"{place}: {said.value}"
        for place, text in files()
        for call in ast.walk(ast.parse(text))
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "InputError"
        for said in call.args[1:2]
        if isinstance(said, ast.Constant) and isinstance(said.value, str) and " " in said.value
    }
    assert not quoted
