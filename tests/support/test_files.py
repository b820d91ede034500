import errno
import os
from pathlib import Path
from typing import Any

import pytest

from planner import InputError
from planner.support.files import folder, refuse_unwritable, refuse_unwritable_folder, write_text


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


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs the device /dev/full")
def test_a_full_device_is_named_and_left_alone() -> None:
    with pytest.raises(InputError, match=r"cannot write /dev/full: No space left"):
        write_text("/dev/full", "x")
    assert Path("/dev/full").is_char_device()


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.json"
    target.write_text("old", encoding="utf-8")
    monkeypatch.setattr(os, "replace", full_disk)
    with pytest.raises(InputError, match=r"cannot write .*a\.json: No space left on device"):
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


def test_folder_appears_only_when_complete(tmp_path: Path) -> None:
    target = tmp_path / "new/run"
    with folder(target) as staging:
        (staging / "table.txt").write_text("1", encoding="utf-8")
        assert not target.exists()
    assert (target / "table.txt").read_text(encoding="utf-8") == "1"
    with folder(target) as staging:
        (staging / "other.txt").touch()
    assert listing(target) == {"other.txt", ".planner"}
    assert listing(tmp_path / "new") == {"run", "run/other.txt", "run/.planner"}


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
def test_folder_leaves_nothing_when_stopped(tmp_path: Path, stop: type[BaseException]) -> None:
    def stopped_half_way() -> None:
        with folder(tmp_path / "new/run") as staging:
            (staging / "half.txt").touch()
            raise stop

    with pytest.raises(stop):
        stopped_half_way()
    assert listing(tmp_path) == set()


def test_folder_keeps_the_old_run_when_the_disk_fills(tmp_path: Path) -> None:
    with folder(tmp_path / "run") as staging:
        (staging / "old.txt").touch()
    with pytest.raises(InputError, match="No space left"), folder(tmp_path / "run"):
        full_disk()
    assert listing(tmp_path) == {"run", "run/old.txt", "run/.planner"}


def test_folder_keeps_the_old_run_when_the_swap_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "run"
    with folder(target) as staging:
        (staging / "old.txt").touch()
    real, calls = os.replace, []

    def second_fails(a: Any, b: Any) -> None:
        calls.append(a)
        if len(calls) == 2:
            full_disk()
        real(a, b)

    monkeypatch.setattr(os, "replace", second_fails)
    with pytest.raises(InputError, match="No space left"), folder(target):
        pass
    assert len(calls) == 3
    assert listing(tmp_path) == {"run", "run/old.txt", "run/.planner"}


def test_places_no_folder_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").touch()
    before = listing(tmp_path)
    cases = {
        "mine": "holds files that are not from an earlier run",
        "mine/thesis.tex": "is a file; name a folder",
        "mine/thesis.tex/out": "is a file, not a folder",
        ".": "is the current folder",
    }
    monkeypatch.chdir(tmp_path)
    for name, message in cases.items():
        with pytest.raises(InputError, match=message):
            refuse_unwritable_folder(name)
        with pytest.raises(InputError, match=message), folder(name):
            pytest.fail("the block must not run")
    assert listing(tmp_path) == before


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
