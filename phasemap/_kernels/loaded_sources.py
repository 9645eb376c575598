"""Digest of the sources of all kernels, as this process has loaded them.

Imported before any kernel. Kernels are loaded when they are first needed, maybe hours later: where a file has changed
since, by an update or a change of branch, those loaded before and after may be of different versions, and no digest
says what is compiled of them.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pathlib

_ROOT = pathlib.Path(__file__).parent
_FILES = sorted(map(str, _ROOT.rglob("*.py")))


def _state() -> list[tuple[int, ...]]:
    """State of the source files, which any change alters, be it taken back; empty where a file is gone."""
    try:
        known = map(os.stat, _FILES)
        return [(one.st_ino, one.st_size, one.st_mtime_ns, one.st_ctime_ns) for one in known]
    except OSError:
        return []


_LOADED = _state()


@functools.cache
def _digest() -> bytes:
    """Digest of the source files as they are when it is first asked for."""
    digest = hashlib.sha256()
    for name in _FILES:
        content = pathlib.Path(name).read_bytes()
        digest.update(repr((os.path.relpath(name, _ROOT), len(content))).encode() + content)
    return digest.digest()


def digest() -> bytes | None:
    """Digest of all sources; None where they are unknown, or were changed since the first kernel was loaded."""
    if not _LOADED or _state() != _LOADED:
        return None
    found = _digest()
    return found if _state() == _LOADED else None  # nothing changed while they were read
