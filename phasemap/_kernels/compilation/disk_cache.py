"""Compiled code on disk, as long as nothing that it depends on changes: a file for each function and argument types.

A file is found by its name, which has a digest of everything that its bits depend on: the sources of all kernels as
they were loaded, of a formula all that it uses, the versions of Python, numba and LLVM, the major one of numpy, and the
processor. It begins with a digest of this name and its content. What is damaged, renamed, of another version, or in the
reach of another user is not found, and compiled again; what cannot be written is compiled again by the next process,
after one sentence on stderr.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pathlib
import pickle
import re
import sys
import tempfile
import uuid
import zlib
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from numba.core import serialize
from numba.core.compiler import CompileResult

from phasemap._kernels import loaded_sources
from phasemap._kernels.compilation.private_files import is_private_folder, read, user, write

SUFFIX, KERNELS = ".compiled", "phasemap._kernels."
_DIGEST = hashlib.sha256().digest_size
_written: list[int] = []  # sizes of files


def written() -> int:
    """Size of the code that this process has kept on disk [bytes]."""
    return sum(_written)


class DiskCache:
    """The files of one function, as numba's dispatchers ask for them."""

    def __init__(self, function: Any, form: str = "", digest: str | None = None) -> None:
        """`digest`: of what the code depends on beside the sources of the kernels, of which a kernel is one.

        Of another function, nothing is kept without it.
        """
        module = function.__module__
        name = f"{module.removeprefix(KERNELS)}.{function.__qualname__}"
        self._name = re.sub(r"[^\w.]+", "-", name, flags=re.ASCII)[:100] + form
        self._digest = "" if digest is None and module.startswith(KERNELS) else digest

    @property
    def cache_path(self) -> str:
        """Folder of the files, for numba, which shows it; their names begin with `_name`."""
        return str(folder() or "")

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """The code for a signature; None if there is none."""
        target_context.refresh()
        return _loaded(self._path(sig, target_context.codegen()), target_context)

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Keep the code for a signature, in place of that of an older source."""
        path = self._path(sig, data.codegen)
        if path is None or data.library.has_dynamic_globals:
            return
        content = zlib.compress(serialize.dumps(data._reduce()), 1)
        try:
            for old in path.parent.glob(path.name.rsplit(".", 2)[0] + ".*" + SUFFIX):
                old.unlink(missing_ok=True)
            part = path.with_suffix(f".{uuid.uuid4().hex}")
            write(part, _seal(path, content) + content)
            os.replace(part, path)
            _written.append(len(content) + _DIGEST)
        except OSError as error:
            _say_once(f"compiled code cannot be kept in {path.parent} ({error.strerror}); the next run compiles again.")

    def _path(self, sig: Any, codegen: Any) -> pathlib.Path | None:
        """File for a signature; None where it is not known on what the code depends."""
        place, sources = folder(), loaded_sources.digest()
        if place is None or sources is None or self._digest is None:
            return None
        of_what = hashlib.sha256(repr((sig, codegen.magic_tuple())).encode()).hexdigest()[:16]
        of_which = hashlib.sha256(sources + self._digest.encode()).hexdigest()[:16]
        return place / f"{self._name}-{versions()}-{of_what}.{of_which}{SUFFIX}"

    def flush(self) -> None:
        """Remove the files of this function."""
        place = folder()
        for old in place.glob(f"{self._name}-{versions()}-*{SUFFIX}") if place else ():
            old.unlink(missing_ok=True)


def _loaded(path: pathlib.Path | None, target_context: Any) -> CompileResult | None:
    """Compiled code in a file; None where there is none, or it is not what was written there."""
    try:
        if path is None:
            return None
        content = read(path)
        if _seal(path, content[_DIGEST:]) != content[:_DIGEST]:
            return None
        return CompileResult._rebuild(target_context, *pickle.loads(zlib.decompress(content[_DIGEST:])))
    except Exception:  # a file that says what it is and yet cannot be read is worth no more than none
        return None


def _seal(path: pathlib.Path, content: bytes) -> bytes:
    """Digest of the content of a file and of its name, by which it is found."""
    return hashlib.sha256(path.name.encode() + b"\0" + content).digest()


@functools.cache
def versions() -> str:
    """The interpreter, the compiler and the library that code was made by."""
    python = f"py{sys.version_info[0]}{sys.version_info[1]}"
    return f"{python}-numpy{np.__version__.split('.')[0]}-numba{numba.__version__}-llvm{llvmlite.__version__}"


def places() -> list[pathlib.Path]:
    """Folders in which compiled code may be kept, best first."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    first = pathlib.Path(named) / "phasemap" if named else pathlib.Path(__file__).parents[1] / "__pycache__"
    return [first, pathlib.Path(home) / "phasemap", pathlib.Path(tempfile.gettempdir()) / f"phasemap-{user()}"]


@functools.cache
def folder() -> pathlib.Path | None:
    """Folder of compiled code: the first of `places` that can be written by this user only; None without one."""
    for place in places():
        try:
            place.mkdir(mode=0o755, parents=True, exist_ok=True)
            found = place.resolve()
            if is_private_folder(found):
                tempfile.TemporaryFile(dir=found).close()
                return found
        except OSError:
            continue
    tried = ", ".join(map(str, places())) or "no place"
    _say_once(f"compiled code cannot be kept ({tried}: not writable, or not by you alone): every run compiles again.")
    return None


@functools.cache
def _say_once(sentence: str) -> None:
    """Print a message on stderr, once a process."""
    print(f"phasemap: {sentence}", file=sys.stderr)
