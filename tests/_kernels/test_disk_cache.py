"""Compiled code is executed: nothing that somebody else can have written is ever read."""

from __future__ import annotations

import os
import pickle
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import float64
from numba.core.registry import cpu_target

from phasemap._kernels import law
from phasemap._kernels.compilation import by_address, disk_cache, private_files
from phasemap._kernels.compilation.disk_cache import DiskCache

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no owners and modes")

SIGNATURE = float64(float64)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of compiled code."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "above"))
    folder = tmp_path / "above" / "phasemap"
    folder.mkdir(parents=True)
    return folder


def give_away(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let something belong to another user."""
    if os.geteuid() == 0:
        os.chown(path, 12345, -1)
    else:
        me = os.geteuid() + 1
        monkeypatch.setattr(os, "geteuid", lambda: me)


def chosen() -> Path | None:
    return disk_cache.folder.__wrapped__()


def test_a_folder_of_the_user_alone_is_used(place: Path) -> None:
    assert chosen() == place


@pytest.mark.parametrize("mode", [0o775, 0o757, 0o777, 0o1777])
def test_a_folder_where_others_may_write_is_not_used(place: Path, mode: int) -> None:
    place.chmod(mode)
    assert chosen() != place


def test_a_folder_of_another_user_is_not_used(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    give_away(place, monkeypatch)
    assert chosen() != place


def test_a_folder_that_others_may_replace_is_not_used(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    above = place.parent
    above.chmod(0o777)
    assert chosen() != place
    above.chmod(0o1777)  # as /tmp: each may rename what is his
    assert chosen() == place
    give_away(above, monkeypatch)
    assert chosen() != place


def test_a_folder_above_may_belong_to_a_group_without_others(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import grp
    import pwd

    place.parent.chmod(0o775)
    monkeypatch.setattr(pwd, "getpwuid", lambda number: SimpleNamespace(pw_name="ada"))
    for name, members, used in (("ada", [], True), ("ada", ["ada"], True), ("ada", ["bob"], False), ("all", [], False)):
        group = SimpleNamespace(gr_name=name, gr_mem=members)
        monkeypatch.setattr(grp, "getgrgid", lambda number, group=group: group)
        assert (chosen() == place) == used


def test_in_a_container_without_an_administrator_the_folders_of_the_machine_are_trusted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    above: Any = SimpleNamespace(st_uid=65534, st_gid=65534, st_mode=0o755)
    for users, trusted in (("0 0 4294967295", False), ("1000 1000 1", True)):
        said = {"uid_map": users, "overflowuid": "65534"}
        monkeypatch.setattr(Path, "read_text", lambda path, said=said: said[path.name])
        assert private_files._keeps_names(above) == trusted


def test_a_link_is_as_good_as_what_it_leads_to(place: Path, tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "phasemap").mkdir()
    place.rmdir()
    place.symlink_to(tmp_path / "open" / "phasemap")
    assert chosen() == tmp_path / "open" / "phasemap"
    (tmp_path / "open").chmod(0o777)
    assert chosen() != tmp_path / "open" / "phasemap"


class Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, sign: Path) -> None:
        self.sign = str(sign)

    def __reduce__(self) -> Any:
        return os.mkdir, (self.sign,)


def trap(of: DiskCache, sign: Path, path: Path | None = None) -> Path:
    """Put a file that says it is this function's, and the user's own."""
    path = path or of._path(SIGNATURE, cpu_target.target_context.codegen())
    assert path is not None
    content = zlib.compress(pickle.dumps(Trap(sign)))
    path.unlink(missing_ok=True)
    private_files.write(path, disk_cache._seal(path, content) + content)
    return path


def opened_as_a_link(path: Path) -> None:
    path.symlink_to(path.rename(path.with_suffix(".elsewhere")))


EXPOSED: dict[str, Callable[[Path], Any]] = {
    "written by a group": lambda path: path.chmod(0o664),
    "written by all": lambda path: path.chmod(0o606),
    "a link": opened_as_a_link,
    "a folder": lambda path: (path.unlink(), path.mkdir()),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),  # which nobody writes to
}


def test_nothing_is_unpickled_that_others_can_have_written(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_cache, "folder", lambda: place)
    cache = DiskCache(trap, digest="of a law")

    sign = place / "executed"

    def executes() -> bool:
        assert cache.load_overload(SIGNATURE, cpu_target.target_context) is None
        return sign.exists()

    for expose in EXPOSED.values():
        expose(path := trap(cache, sign))
        assert not executes()
        if path.is_dir():
            path.rmdir()
    with pytest.MonkeyPatch.context() as patch:
        give_away(trap(cache, sign), patch)
        assert not executes()
    trap(cache, sign)
    assert executes()  # it is, where the user has written it


def test_files_under_each_others_names_are_not_found(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_cache, "folder", lambda: place)

    def twice(d: float, p: np.ndarray) -> float:
        return 2.0 * d

    def thrice(d: float, p: np.ndarray) -> float:
        return 3.0 * d

    def values() -> tuple[list[float], int]:
        monkeypatch.setattr(by_address, "KEPT", found := {})
        seen = [law._called_by_python(law.address_of(one), 3.0, np.zeros(16)) for one in (twice, thrice)]
        return seen, sum(code.cache_hits for code in found.values())

    assert values() == ([6.0, 9.0], 0)
    one, other = place.iterdir()
    assert values() == ([6.0, 9.0], 2)
    one.rename(place / "between")
    other.rename(one)
    (place / "between").rename(other)
    assert values() == ([6.0, 9.0], 0)


def test_what_is_kept_is_the_users_own_whatever_the_mode_of_new_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    before = os.umask(0)
    try:
        found = chosen()
        assert found == tmp_path / "phasemap"
        private_files.write(found / "file", b"content")
    finally:
        os.umask(before)
    assert private_files.read(found / "file") == b"content"
