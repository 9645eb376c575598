"""How inputs are spoilt. Everything random comes from a `random.Random`, which may be one of Hypothesis."""

from __future__ import annotations

import copy
from collections.abc import Callable
from datetime import date, datetime, time
from random import Random
from typing import Any

from fuzz.writing import Raw

Table = dict[str, Any]

NUMBERS: tuple[Any, ...] = (
    0,
    -1,
    1,
    2,
    3,
    0.5,
    -0.0,
    2**31,
    2**32,
    2**63,
    -(2**63),
    2**64,
    10**30,
    10**400,
    1e-9,
    1e-300,
    5e-324,
    1e300,
    1.7976931348623157e308,
    -1e300,
    float("inf"),
    float("-inf"),
    float("nan"),
    Raw("0x" + "f" * 5000),
    200_000,
    10**6,
)
TEXTS: tuple[Any, ...] = (
    "",
    " ",
    ".",
    "..",
    "../..",
    "a" * 20_000,
    "\0",
    "a\0b.npy",
    "☃",
    "\u202e",
    "\x7f",
    "é" * 300,
    "'; drop table",
    "%s%n",
    "{0.__class__}",
    "__import__('os').system('false')",
    "os.system",
    "phasemap.cli:main",
    "package:os/path",
    "package:",
    "package:__main__/x",
    "package:sys/x",
    "package:phasemap/../../x.npy",
    "package:phasemap",
    "/dev/zero",
    "/dev/urandom",
    "/dev/full",
    "/dev/tty",
    "/dev/fd/0",
    "/proc/self/mem",
    "/proc/self/cmdline",
    "/etc",
    "pipe",
    "pipe.npy",
    "folder.npy",
    "loop.npy",
    "absent.npy",
    "empty.npy",
    "map.npy",
    "map.csv",
    "map.txt",
    "map.nc",
    "objects.npy",
    "bomb.npy",
    "bomb.nc",
    "sparse.npy",
    "scene.toml",
    "x",
    "y",
    "kind",
    "auto",
    "-",
    "1",
    "true",
)
OTHERS: tuple[Any, ...] = (
    True,
    False,
    [],
    {},
    [[]],
    [1],
    [1, 2],
    [1, 2, 3],
    [0, 0],
    [-1, 2],
    [10**9, 10**9],
    [10**30, 1],
    ["a", 1],
    [True, False],
    [[0, 1], [1]],
    [[0.5, 1.5]],
    [["a"]],
    [[{}]],
    {"a": 1},
    {"a": {"b": {}}},
    {"file": "map.nc", "variable": ["E"]},
    {"file": 3},
    {"generator": "roughness"},
    {"generator": "blend"},
    {"0": "soft"},
    {"low": 0, "high": 1},
    {"low": 1e-300, "high": 1e300, "scale": "log"},
    {"low": 0, "high": 10**30, "whole": True},
    {"low": [], "high": {}},
    date(1979, 5, 27),
    datetime(1979, 5, 27, 7, 32),
    time(7, 32),
    [date(1979, 5, 27)],
    Raw("[" * 150 + "]" * 150),
    Raw("[" * 3000 + "]" * 3000),
    Raw("{a=" * 150 + "1" + "}" * 150),
    Raw("1e400"),
    Raw("9" * 5000),
    Raw("0b" + "1" * 20_000),
    Raw("1" * 200 + ".0"),
    Raw("["),
    Raw("'''"),
    Raw("1979-13-45"),
    Raw("\x00"),
)
WORDS = (
    "kind",
    "shape",
    "pixel_size",
    "seed",
    "materials",
    "labels",
    "topography",
    "heights",
    "modulus",
    "adhesion",
    "damping",
    "viscosity",
    "poisson_ratio",
    "file",
    "variable",
    "generator",
    "radius",
    "period",
    "angle",
    "duty",
    "side",
    "position",
    "axis",
    "start",
    "stop",
    "area_fraction",
    "spread",
    "periodic",
    "spacing",
    "fraction",
    "annealing",
    "rms",
    "hurst",
    "correlation_length",
    "dilate",
    "half_angle",
    "allow_nan",
    "setpoint",
    "solver",
    "free_amplitude",
    "frequency",
    "contact",
    "decay_length",
    "damping_exponent",
    "bias",
    "line_rate",
    "bits",
    "drift",
    "tip_change",
    "temperature",
    "variables",
    "phase",
    "height",
    "count",
    "vary",
    "table",
    "engage",
    "order",
    "overscan",
    "a",
    "__class__",
    "",
)
KINDS = (
    "labels",
    "maps",
    "measured",
    "stripes",
    "checkerboard",
    "step",
    "particles",
    "lamellae",
    "blend",
    "gradient",
    "roughness",
    "number",
    "np",
    "__builtins__",
)
TABLES = (
    "scan",
    "surface",
    "materials",
    "cantilever",
    "tip",
    "drive",
    "interaction",
    "control",
    "accuracy",
    "realism",
    "output",
    "ensemble",
    "python",
    "",
)


def strange(rng: Random) -> Any:
    """Any value but a sensible one."""
    pool = rng.choice((NUMBERS, NUMBERS, TEXTS, OTHERS))
    return copy.deepcopy(rng.choice(pool))


def near(rng: Random, value: Any) -> Any:
    """A value not far from this one."""
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int):
        return value + rng.choice((-2, -1, 1, 2)) * 10 ** rng.randrange(0, 12)
    if isinstance(value, float):
        return rng.choice((-1.0, 1.0, 1.0, 1.0)) * value * 10.0 ** rng.randrange(-40, 40)
    if isinstance(value, str):
        place = rng.randrange(0, len(value) + 1)
        return (
            value[:place] + rng.choice(("", "x", "/", ".", "é", "\n", '"', "\\")) + value[place + rng.randrange(0, 2) :]
        )
    if isinstance(value, list) and value:
        at = rng.randrange(0, len(value))
        return rng.choice(
            (value[:at], [*value, strange(rng)], [*value[:at], strange(rng), *value[at + 1 :]], value * 3)
        )
    return strange(rng)


def spoil_tables(rng: Random, tables: Table) -> Table:
    """One to four things about the tables of a scene are wrong, or at least other than before."""
    tables = copy.deepcopy(tables)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        rng.choice(_TABLE_MUTATIONS)(rng, tables)
    return tables


def _somewhere(rng: Random, tables: Table) -> Table:
    """The tables themselves, or one somewhere below."""
    table = tables
    for _ in range(rng.randrange(0, 4)):
        inside = [value for value in table.values() if isinstance(value, dict)]
        if not inside:
            break
        table = rng.choice(inside)
    return table


def _replace(rng: Random, tables: Table) -> None:
    table = _somewhere(rng, tables)
    if table:
        table[rng.choice(sorted(table))] = strange(rng)


def _shift(rng: Random, tables: Table) -> None:
    table = _somewhere(rng, tables)
    keys = [key for key, value in table.items() if not isinstance(value, dict)]
    if keys:
        key = rng.choice(keys)
        table[key] = near(rng, table[key])


def _delete(rng: Random, tables: Table) -> None:
    table = _somewhere(rng, tables)
    if table:
        del table[rng.choice(sorted(table))]


def _add(rng: Random, tables: Table) -> None:
    _somewhere(rng, tables)[rng.choice(WORDS)] = strange(rng)


def _add_table(rng: Random, tables: Table) -> None:
    tables[rng.choice(TABLES)] = {rng.choice(WORDS): strange(rng) for _ in range(rng.randrange(0, 3))}


def _kind(rng: Random, tables: Table) -> None:
    table = tables.get(rng.choice(("surface", "surface", "control")))
    if isinstance(table, dict):
        table["kind"] = rng.choice((*KINDS, "engage", "raster", "feedback"))


def _rename(rng: Random, tables: Table) -> None:
    table = _somewhere(rng, tables)
    if table:
        key = rng.choice(sorted(table))
        table[rng.choice((*WORDS, *TABLES, near(rng, key)))] = table.pop(key)


def _swap(rng: Random, tables: Table) -> None:
    one, other = _somewhere(rng, tables), _somewhere(rng, tables)
    if one and other and one is not other:
        a, b = rng.choice(sorted(one)), rng.choice(sorted(other))
        one[a], other[b] = copy.deepcopy(other[b]), copy.deepcopy(one[a])


def _deepen(rng: Random, tables: Table) -> None:
    key = ".".join(["a"] * rng.choice((5, 100, 3000)))
    table = _somewhere(rng, tables)
    table[rng.choice((*WORDS, *sorted(table)))] = Raw("{" + key + " = 1}")


_TABLE_MUTATIONS: tuple[Callable[[Random, Table], None], ...] = (
    _replace,
    _replace,
    _replace,
    _shift,
    _shift,
    _shift,
    _shift,
    _delete,
    _add,
    _add,
    _add_table,
    _kind,
    _rename,
    _swap,
    _deepen,
)


def spoil_override(rng: Random, tables: Table) -> str:
    """``table.key=value`` of the command line, more or less."""
    name, table = rng.choice([*tables.items()])
    keys = sorted(table) if isinstance(table, dict) and table else WORDS
    key = rng.choice(keys) if rng.random() < 0.8 else rng.choice(WORDS)
    value = table[key] if isinstance(table, dict) and key in table else 1.0
    kind = rng.randrange(0, 40)
    if kind < 15:
        text = str(near(rng, value))
    elif kind < 30:
        text = str(strange(rng)) if rng.random() < 0.5 else repr(strange(rng))
    else:
        text = rng.choice(("{" + "a." * 4000 + "a = 1}", "[" * 20_000, "1\nx = 2", "'unclosed", "\udc80", "1 # note"))
    whole = f"{name}.{key}={text}"
    if kind == 39:
        return rng.choice(("." * 3000 + "=1", "a." * 4000 + "a=1", text, "=", "a=1", f"{name}.{key}.{'b.' * 200}c=1"))
    return near(rng, whole) if kind == 38 else whole


def spoil_bytes(rng: Random, data: bytes, more: tuple[bytes, ...] = ()) -> bytes:
    """One to six places of a file are wrong, or it ends early."""
    spoilt = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        rng.choice(_BYTE_MUTATIONS)(rng, spoilt)
        if more and rng.random() < 0.3:
            at = rng.randrange(0, len(spoilt) + 1)
            spoilt[at:at] = rng.choice(more)
    return bytes(spoilt)


def _place(rng: Random, data: bytearray) -> int:
    """Anywhere, but half of the time where a header is."""
    end = len(data) if rng.random() < 0.5 else min(len(data), 4096)
    return rng.randrange(0, end + 1)


def _flip(rng: Random, data: bytearray) -> None:
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if data:
            data[min(_place(rng, data), len(data) - 1)] ^= 1 << rng.randrange(0, 8)


def _cut(rng: Random, data: bytearray) -> None:
    del data[_place(rng, data) :]


def _drop(rng: Random, data: bytearray) -> None:
    at = _place(rng, data)
    del data[at : at + rng.choice((1, 2, 4, 8, 100, 1000))]


def _double(rng: Random, data: bytearray) -> None:
    at = _place(rng, data)
    data[at:at] = data[at : at + rng.choice((1, 4, 16, 200))] * rng.choice((1, 2, 50))


def _overwrite(rng: Random, data: bytearray) -> None:
    at = _place(rng, data)
    size = rng.choice((1, 2, 4, 8))
    value = rng.choice((b"\xff" * size, b"\0" * size, b"\x7f" + b"\xff" * (size - 1), b"\xff" * (size - 1) + b"\x7f"))
    data[at : at + size] = value


def _digit(rng: Random, data: bytearray) -> None:
    """Numbers written as text, such as those that say how long something is."""
    places = [at for at, byte in enumerate(data[:8192]) if 48 <= byte <= 57]
    if places:
        at = rng.choice(places)
        data[at : at + 1] = rng.choice((b"9", b"0", b"-1", b"99999999", b"1e99", b"nan", b"x", b""))


def _noise(rng: Random, data: bytearray) -> None:
    at = _place(rng, data)
    noise = bytes(rng.randrange(0, 256) for _ in range(rng.choice((1, 4, 32))))
    data[at : at + len(noise)] = noise


_BYTE_MUTATIONS: tuple[Callable[[Random, bytearray], None], ...] = (
    _flip,
    _flip,
    _flip,
    _cut,
    _drop,
    _double,
    _overwrite,
    _overwrite,
    _digit,
    _digit,
    _noise,
)
