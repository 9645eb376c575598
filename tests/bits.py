"""All numbers of a result in one word, to compare results of different processes bit by bit."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np
import xarray as xr


def bits(result: object) -> str:
    """Digest of every number in a Dataset, an array, a dataclass, or a collection of such."""
    digest = hashlib.sha256()
    for part in _parts(result):
        digest.update(part)
    return digest.hexdigest()


def _parts(thing: Any) -> Iterator[bytes]:
    if isinstance(thing, xr.Dataset | Mapping):
        for name in sorted(thing, key=str):
            yield str(name).encode()
            yield from _parts(thing[name])
    elif isinstance(thing, xr.DataArray | np.ndarray | float | int | np.number):
        values = np.asarray(thing)
        yield values.tobytes() if values.dtype != object else repr(values).encode()
    elif is_dataclass(thing):
        for field in fields(thing):
            yield from _parts(getattr(thing, field.name))
    elif isinstance(thing, Sequence) and not isinstance(thing, str | bytes):
        for one in thing:
            yield from _parts(one)
    else:
        assert thing is None or isinstance(thing, str | bytes | Enum), type(thing)
        yield repr(thing).encode()
