"""Folders and files that only this user and the administrator can write: what is read from them may be executed.

On Windows, which has neither owners nor modes in this sense, the user's own folders are trusted as they are.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import stat

OTHERS = stat.S_IWGRP | stat.S_IWOTH


def is_private_folder(folder: pathlib.Path) -> bool:
    """True if nobody else can put a file into a folder, or another folder in its place; `folder` has no links."""
    return _is_private(folder.stat()) and all(_keeps_names(one.stat()) for one in folder.parents)


def read(path: pathlib.Path) -> bytes:
    """Content of a file.

    Raises
    ------
    OSError
        If there is none, or somebody else can write it.
    """
    more = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # a pipe would be waited for
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | more)) as file:
        known = os.fstat(file.fileno())  # of what is read, whatever has its name by now
        if not (stat.S_ISREG(known.st_mode) and _is_private(known)):
            raise PermissionError(f"{path} can be written by others")
        return file.read()


def write(path: pathlib.Path, content: bytes) -> None:
    """Write a new file that is the user's own, whatever the mode of new files is."""
    with open(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
        file.write(content)


def user() -> int:
    """Number of the user who runs this; 0 where users have none."""
    return int(getattr(os, "geteuid", int)())


def _is_private(known: os.stat_result) -> bool:
    """True if only the user and the administrator can write a file or a folder."""
    return os.name == "nt" or (known.st_uid in (0, user()) and not known.st_mode & OTHERS)


def _keeps_names(known: os.stat_result) -> bool:
    """True if nobody else can rename what is in a folder."""
    if os.name == "nt":
        return True
    if known.st_uid not in _owners_above():
        return False
    if known.st_mode & stat.S_ISVTX or not known.st_mode & OTHERS:
        return True
    return not known.st_mode & stat.S_IWOTH and not _has_members(known.st_gid)


def _owners_above() -> set[int]:
    """Possible owners of a folder above: the user, the administrator, and who stands for him in a container without."""
    owners = {0, user()}
    with contextlib.suppress(OSError):
        ranges = pathlib.Path("/proc/self/uid_map").read_text().splitlines()
        if not any(line.split()[0] == "0" for line in ranges):
            owners.add(int(pathlib.Path("/proc/sys/fs/overflowuid").read_text()))
    return owners


def _has_members(number: int) -> bool:
    """True if a group has others in it; many systems give each user a group of the same name, which has none."""
    import grp
    import pwd

    try:
        name, group = pwd.getpwuid(user()).pw_name, grp.getgrgid(number)
    except KeyError:
        return True
    return group.gr_name != name or not {name}.issuperset(group.gr_mem)
