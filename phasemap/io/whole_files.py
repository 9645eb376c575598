"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from phasemap._shared.errors import ExistsError, FileError
from phasemap._shared.files import reason_of

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
    return path


@contextmanager
def replacing(path: str | os.PathLike[str], overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary name in the folder of `path`; what was written there becomes `path` if all went well.

    The temporary name has the suffix of `path`, and its file is removed in any case.
    """
    path = check_target(path, overwrite)
    _clear(path)
    temporary = path.with_name(f".{path.stem}.{_host()}-{os.getpid()}.tmp{path.suffix}")
    try:
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())  # the bytes are on the disk before the name points to them
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:  # netCDF4 reports a full disk as RuntimeError
        raise FileError(f"cannot write {path}: {reason_of(error, path.parent)}.") from error
    finally:
        temporary.unlink(missing_ok=True)


def _clear(path: Path) -> None:
    """Remove what processes of this machine that were killed left of this file."""
    pattern = re.compile(rf"\.{re.escape(path.stem)}\.{_host()}-(\d+)\.tmp{re.escape(path.suffix)}")
    for name in os.listdir(path.parent):
        if (found := pattern.fullmatch(name)) and not _is_alive(int(found[1])):
            path.with_name(name).unlink(missing_ok=True)


def _host() -> str:
    """The name of this machine: others may write into the same folder."""
    return re.sub(r"\W", "_", platform.node())


def _is_alive(process: int) -> bool:
    if os.name == "nt":  # where os.kill ends a process whatever the signal
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # somebody else's; no number that a process has
        return True
    return True
