import errno
import os
from pathlib import Path
from typing import Any

import pytest

from planner import InputError
from planner.support.files import refuse_unwritable, write_text


def listing(path: Path) -> set[str]:
    return {str(p.relative_to(path)) for p in path.rglob("*")}


def full_disk(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_text_is_written_whole_and_replaces_the_old(tmp_path: Path) -> None:
    target = tmp_path / "a.json"
    target.write_text("old", encoding="utf-8")
    assert write_text(target, "θ = 1\n") == target
    assert target.read_text(encoding="utf-8") == "θ = 1\n"
    assert listing(tmp_path) == {"a.json"}
    assert target.stat().st_mode & 0o777 == 0o666 & ~_umask()


def test_a_link_is_followed_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real/a.json").write_text("old", encoding="utf-8")
    (tmp_path / "link.json").symlink_to(tmp_path / "real/a.json")
    write_text(tmp_path / "link.json", "new")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real/a.json").read_text(encoding="utf-8") == "new"


def test_a_pipe_is_written_to_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert pipe.is_fifo()


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="needs the folder /dev/fd")
def test_a_pipe_without_a_name_of_its_own_is_written_to() -> None:
    """As behind `--out /dev/stdout | tail` and `--out >(tail)`."""
    reader, writer = os.pipe()
    write_text(f"/dev/fd/{writer}", "through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    os.close(writer)


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs the device /dev/full")
def test_a_full_device_is_named_and_left_alone() -> None:
    with pytest.raises(InputError, match="/dev/full: No space left"):
        write_text("/dev/full", "x")
    assert Path("/dev/full").is_char_device()


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.json"
    target.write_text("old", encoding="utf-8")
    monkeypatch.setattr(os, "replace", full_disk)
    with pytest.raises(InputError, match=r"a\.json: No space left"):
        write_text(target, "new")
    assert target.read_text(encoding="utf-8") == "old"
    assert listing(tmp_path) == {"a.json"}


@pytest.mark.parametrize("check", [refuse_unwritable, lambda p: write_text(p, "x")])
def test_places_no_file_can_be_written(check: Any, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    before = listing(tmp_path)
    with pytest.raises(InputError, match=r"file is a file, not a folder"):
        check(tmp_path / "file/a.json")
    with pytest.raises(InputError, match=r"it is a folder; name a file in it"):
        check(tmp_path)
    assert listing(tmp_path) == before


def test_a_file_brings_its_folder(tmp_path: Path) -> None:
    target = tmp_path / "new/run/a.json"
    refuse_unwritable(target)
    assert listing(tmp_path) == set()
    assert write_text(target, "x").read_text(encoding="utf-8") == "x"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
