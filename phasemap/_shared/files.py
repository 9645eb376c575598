"""Files that users name: read where they end and are neither pipe nor device, written whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from phasemap._shared.errors import ExistsError, FileError

PIECE = 1 << 20  # byte
FULL = 1 << 20  # byte left on a disk that is full: what could not be written was larger


def size_of(path: str | os.PathLike[str], what: str) -> int:
    """Size of a file that may be read [byte]; `what` is the file, in the words of an error.

    Raises FileError if it is not a file: a pipe would be waited for, a device may never end.
    """
    try:
        about = os.stat(path)
    except (OSError, ValueError) as error:  # ValueError: a null byte
        raise FileError(f"cannot read {what}: {getattr(error, 'strerror', None) or error}.") from error
    if not stat.S_ISREG(about.st_mode):
        raise FileError(f"cannot read {what}: it is a folder, a device or a pipe, not a file.")
    return about.st_size


def reason_of(error: Exception, folder: str | os.PathLike[str] | None = None) -> str:
    """Reason why a file could not be written or read, in words.

    `folder`: where it is; libraries of file formats say "HDF error" or "Permission denied" where the disk is full.
    """
    full = isinstance(error, OSError) and error.errno == errno.ENOSPC
    with suppress(OSError):
        if folder is not None and (usage := shutil.disk_usage(folder)).total > 0:  # of the system's folders it is none
            full = full or usage.free < FULL
    return "the disk is full" if full else str(getattr(error, "strerror", None) or error)


def digest_of(path: str | os.PathLike[str], what: str) -> str:
    """The SHA-256 of a file, read piece by piece.

    Raises FileError if it cannot be read, or goes on beyond its size, as files of the system may.
    """
    left, digest = size_of(path, what), hashlib.sha256()
    try:
        with open(path, "rb") as file:
            while piece := file.read(PIECE):
                digest.update(piece)
                left -= len(piece)
                if left < 0:
                    raise FileError(f"cannot read {what}: it is longer than its size says.")
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"cannot read {what}: {error.strerror}.") from error
    return digest.hexdigest()


LONGEST_NAME = 230  # byte of the name of a file; systems allow 255, and work in progress has a longer one


def check_target(path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """Return `path` if a file can be written there, before hours are spent on what to write."""
    path = Path(path)
    if os.path.exists(path) and not path.is_file():
        raise FileError(f"cannot write {path}: it is a folder or a device, not a file.")
    if not path.parent.is_dir():
        raise FileError(f"cannot write {path}: the folder {str(path.parent)!r} does not exist.")
    if not os.access(path.parent, os.W_OK):
        raise FileError(f"cannot write {path}: no permission to write in the folder {str(path.parent)!r}.")
    if os.path.exists(path) and not overwrite:
        raise ExistsError(
            f"cannot write {path}: it exists already; overwrite=True replaces it. Or choose another name."
        )
    if "\0" in path.name:
        raise FileError(f"cannot write {path}: its name has a null byte; choose another one.")
    if len(os.fsencode(path.name)) > LONGEST_NAME:
        raise FileError(f"cannot write {path}: its name is longer than {LONGEST_NAME} bytes; choose a shorter one.")
    temporary = _temporary(path)
    try:
        temporary.touch()
        temporary.unlink()
    except OSError as error:
        where = f"no file can be made in the folder {str(path.parent)!r}"
        raise FileError(f"cannot write {path}: {where} ({reason_of(error, path.parent)}).") from error
    return path


@contextmanager
def replacing(path: str | os.PathLike[str], overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary name in the folder of `path`; what was written there becomes `path` if all went well.

    The temporary name has the suffix of `path`, and its file is removed in any case.
    """
    path = check_target(path, overwrite)
    _clear(path)
    temporary = _temporary(path)
    try:
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())  # the bytes are on the disk before the name points to them
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:  # netCDF4 reports a full disk as RuntimeError
        raise FileError(f"cannot write {path}: {reason_of(error, path.parent)}.") from error
    finally:
        temporary.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    """The name that a file has until it is whole."""
    return path.with_name(f".{path.stem}.{_host()}-{os.getpid()}.tmp{path.suffix}")


def _clear(path: Path) -> None:
    """Remove temporary files of this file that killed processes of this machine left."""
    pattern = re.compile(rf"\.{re.escape(path.stem)}\.{_host()}-(\d+)\.tmp{re.escape(path.suffix)}")
    for name in os.listdir(path.parent):
        if (found := pattern.fullmatch(name)) and not _is_alive(int(found[1])):
            path.with_name(name).unlink(missing_ok=True)


def _host() -> str:
    """The name of this machine: others may write into the same folder."""
    return re.sub(r"\W", "_", platform.node())


def _is_alive(process: int) -> bool:
    """True if a process of this number is running, or may be."""
    import psutil  # on Windows os.kill would end it

    try:
        return bool(psutil.pid_exists(process))
    except OverflowError:  # no number that a process has
        return True
