"""Compiled code on disk, as long as nothing that it depends on changes: a file for each function and argument types.

A file is found by its name, which has a digest of everything that its bits depend on: the sources of all kernels, of a
formula all that it uses, the versions of Python, numba and LLVM, and the processor. It begins with a digest of its
content. What is damaged, or of another version, is not found, and compiled again; what cannot be written is compiled
again by the next process, after one sentence on stderr.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pathlib
import pickle
import stat
import sys
import tempfile
import types as python_types
import uuid
import zlib
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import serialize
from numba.core.compiler import CompileResult

SUFFIX, KERNELS = ".compiled", "phasemap._kernels."
_DIGEST = hashlib.sha256().digest_size
_written: list[int] = []  # sizes of files


def written() -> int:
    """How much this process has kept on disk [bytes]."""
    return sum(_written)


class DiskCache:
    """The files of one function, as numba's dispatchers ask for them."""

    def __init__(self, function: Any, form: str = "") -> None:
        self._function, self._form = function, form

    @property
    def cache_path(self) -> str:
        """Where the files are."""
        return str(folder() or "")

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """The code for a signature; None if there is none."""
        target_context.refresh()
        path = self._path(sig, target_context.codegen())
        try:
            content = path.read_bytes() if path else b""
            if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
                return None
            return CompileResult._rebuild(target_context, *pickle.loads(zlib.decompress(content[_DIGEST:])))
        except Exception:  # a file that says what it is and yet cannot be read is worth no more than none
            return None

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep the code for a signature, in place of what an older source gave."""
        path = self._path(sig, data.codegen)
        if path is None or data.library.has_dynamic_globals:
            return
        content = zlib.compress(serialize.dumps(data._reduce()), 1)
        try:
            for old in path.parent.glob(path.name.rsplit(".", 2)[0] + ".*" + SUFFIX):
                old.unlink(missing_ok=True)
            part = path.with_suffix(f".{uuid.uuid4().hex}")
            part.write_bytes(hashlib.sha256(content).digest() + content)
            os.replace(part, path)
            _written.append(len(content) + _DIGEST)
        except OSError as error:
            _say_once(f"compiled code cannot be kept in {path.parent} ({error.strerror}); the next run compiles again.")

    def _path(self, sig: Any, codegen: Any) -> pathlib.Path | None:
        """The file for a signature."""
        place = folder()
        if place is None:
            return None
        of_what = hashlib.sha256(repr((sig, codegen.magic_tuple())).encode()).hexdigest()[:16]
        of_which = hashlib.sha256(sources() + self._own().encode()).hexdigest()[:16]
        return place / f"{self._name()}-{python()}-{of_what}.{of_which}{SUFFIX}"

    def _name(self) -> str:
        """Of the function, as its files begin."""
        return f"{self._function.__module__.removeprefix(KERNELS)}.{self._function.__name__}{self._form}"

    def _own(self) -> str:
        """What the code depends on beside the sources of the kernels, of which a kernel is one."""
        return "" if self._function.__module__.startswith(KERNELS) else fingerprint(self._function)

    def flush(self) -> None:
        """Remove the files of this function."""
        place = folder()
        for old in place.glob(f"{self._name()}-{python()}-*{SUFFIX}") if place else ():
            old.unlink(missing_ok=True)


@functools.cache
def python() -> str:
    """The interpreter and compiler that code was made by."""
    return f"py{sys.version_info[0]}{sys.version_info[1]}-numba{numba.__version__}-llvm{llvmlite.__version__}"


@functools.cache
def sources() -> bytes:
    """Digest of the source of all kernels."""
    digest = hashlib.sha256()
    root = pathlib.Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.digest()


def places() -> list[pathlib.Path]:
    """Where compiled code may be kept, best first."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    first = pathlib.Path(named) / "phasemap" if named else pathlib.Path(__file__).parent / "__pycache__"
    return [first, pathlib.Path(home) / "phasemap", pathlib.Path(tempfile.gettempdir()) / f"phasemap-{_user()}"]


def _user() -> int:
    """Number of the user who runs this; 0 where users have none."""
    return int(getattr(os, "getuid", int)())


@functools.cache
def folder() -> pathlib.Path | None:
    """Where compiled code is kept: the first of `places` that can be written by this user only; None without one."""
    for place in places():
        try:
            place.mkdir(mode=0o755, parents=True, exist_ok=True)
            known = place.stat()
            of_others = known.st_uid not in (0, _user()) or stat.S_IMODE(known.st_mode) & 0o002
            if not of_others:  # nobody else may put code there
                tempfile.TemporaryFile(dir=place).close()
                return place
        except OSError:
            continue
    tried = ", ".join(map(str, places())) or "no place"
    _say_once(f"compiled code cannot be kept ({tried}): every run compiles again.")
    return None


@functools.cache
def _say_once(sentence: str) -> None:
    """Say it on stderr, once a process."""
    print(f"phasemap: {sentence}", file=sys.stderr)


def fingerprint(function: Any, seen: set[int] | None = None) -> str:
    """Return the sha256 of a function's bytecode, constants and, recursively, of all names that it uses."""
    seen = set() if seen is None else seen
    function = getattr(function, "py_func", function)
    if id(function) in seen:
        return ""
    seen.add(id(function))
    code = function.__code__
    constants = [c for c in code.co_consts if not isinstance(c, python_types.CodeType)]
    digest = hashlib.sha256(code.co_code + repr(constants).encode() + repr(code.co_names).encode())
    used = [(n, function.__globals__[n]) for n in code.co_names if n in function.__globals__]
    used += list(zip(code.co_freevars, (cell.cell_contents for cell in function.__closure__ or ()), strict=True))
    for name, value in used:
        if hasattr(value, "py_func") or isinstance(value, python_types.FunctionType):
            digest.update((name + fingerprint(value, seen)).encode())
        elif isinstance(value, (int, float, complex, str, bool, tuple)):
            digest.update(f"{name}={value!r}".encode())
        elif isinstance(value, np.ndarray):
            digest.update(name.encode() + value.tobytes())
        else:
            digest.update(name.encode())
    return digest.hexdigest()
