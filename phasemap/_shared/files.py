"""Files that users name: only those are opened that are there, end, and are neither a pipe nor a device."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import stat
from contextlib import suppress

from phasemap._shared.errors import FileError

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
    """Why a file could not be written or read, in words.

    `folder`: where it is; libraries of file formats say "HDF error" or "Permission denied" where the disk is full.
    """
    full = isinstance(error, OSError) and error.errno == errno.ENOSPC
    with suppress(OSError):
        full = full or (folder is not None and shutil.disk_usage(folder).free < FULL)
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
