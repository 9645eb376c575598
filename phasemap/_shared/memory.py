"""Free memory, and a sentence with the numbers where something would not fit, before it is allocated.

What is free is the least of what the system has, what a control group (a container, a batch job) leaves, and what
``ulimit -v`` leaves. The environment variable ``PHASEMAP_MEMORY`` says otherwise, in bytes: ``PHASEMAP_MEMORY=64e9``.
Machine and process are psutil's; control groups, which it does not know, are read here.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

from phasemap._shared.errors import InputError, TooLargeError

VARIABLE = "PHASEMAP_MEMORY"
GROUPS = Path("/sys/fs/cgroup")  # where Linux has its control groups


def check_fits(what: str, size: float, advice: str = "Take fewer pixels.") -> None:
    """Raise TooLargeError where something, such as "an image of 512 x 512 pixels", needs more bytes than are free."""
    if size < 1 << 20:  # which is not worth a look
        return
    free = available()
    if size > free:
        sentence = f"{what} needs {size_in_words(size)} of memory, and {size_in_words(free)} are free."
        raise TooLargeError(f"{sentence} {advice} {VARIABLE}, in bytes, sets another limit.")


def available() -> float:
    """Memory that may be taken [byte]."""
    told = os.environ.get(VARIABLE)
    if told is None:
        import psutil

        return min([float(psutil.virtual_memory().available), *_left_by_groups(), *_left_by_process()])
    try:
        limit = float(told)
    except ValueError:
        limit = math.nan
    if not limit > 0:
        raise InputError(f"the environment variable {VARIABLE}", told, "a number of bytes above 0")
    return limit


def size_in_words(size: float) -> str:
    """A number of bytes, with the prefix that suits it."""
    power = min(int(math.log10(size)) // 3, 8) if 1 <= size < math.inf else 0
    return f"{size / 1000**power:.3g} {['', 'k', 'M', 'G', 'T', 'P', 'E', 'Z', 'Y'][power]}B"


def _left_by_groups() -> Iterator[float]:
    """Memory that the control groups of this process leave, each within the next; the cache of files does not count."""
    for line in _text(Path("/proc/self/cgroup")).splitlines():
        _, kinds, name = line.split(":", 2)
        if kinds not in ("", "memory"):
            continue
        root = GROUPS / kinds
        limit, use = (
            ("memory.max", "memory.current") if not kinds else ("memory.limit_in_bytes", "memory.usage_in_bytes")
        )
        group = root / name.strip("/")
        for folder in (group, *group.parents):
            most, used = (_text(folder / file).strip() for file in (limit, use))
            if most.isdecimal() and used.isdecimal():
                cache = _fields(folder / "memory.stat").get("inactive_file", 0.0)
                yield max(float(most) - float(used) + cache, 0.0)
            if folder == root:
                break


def _left_by_process() -> Iterator[float]:
    """Memory that a limit of the address space leaves."""
    import psutil

    process = psutil.Process()
    if not hasattr(process, "rlimit"):  # psutil knows the limit on Linux and FreeBSD
        return
    limit = process.rlimit(psutil.RLIMIT_AS)[0]
    if limit != psutil.RLIM_INFINITY:
        yield max(float(limit - process.memory_info().vms), 0.0)


def _fields(path: Path) -> dict[str, float]:
    """The numbers of a file that has a name and a number in each line."""
    rows = (line.split() for line in _text(path).splitlines())
    return {row[0]: float(row[1]) for row in rows if len(row) > 1 and row[1].isdecimal()}


def _text(path: Path) -> str:
    """Text of a file of the system; empty where there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""
