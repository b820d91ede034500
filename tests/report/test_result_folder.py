"""Folders of results: whole or not there, and what others put into them stays."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from planner import InputError
from planner.report.result_folder import MARKER, folder, refuse_unwritable_folder


def listing(path: Path) -> set[str]:
    return {str(p.relative_to(path)) for p in path.rglob("*")}


def full_disk(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write(target: Path, **files: str) -> None:
    with folder(target) as place:
        for name, text in files.items():
            file = place / name.replace("__", "/")
            file.parent.mkdir(exist_ok=True)
            file.write_text(text, encoding="utf-8")


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


def test_what_others_put_into_a_folder_stays(tmp_path: Path) -> None:
    target = tmp_path / "run"
    write(target, table="1", plans__a="a", figures__b="b")
    (target / "main.c").write_text("mine")
    (target / "plans/notes").write_text("mine")
    (target / "empty").mkdir()
    (target / "build/deep").mkdir(parents=True)
    (target / "build/deep/main.o").write_text("mine")
    (target / "link").symlink_to(tmp_path)
    write(target, table="2", plans__c="c")
    assert listing(target) == {
        *("table", "plans", "plans/c", MARKER),
        *("main.c", "plans/notes", "empty", "build", "build/deep", "build/deep/main.o", "link"),
    }
    assert (target / "table").read_text() == "2"
    assert (target / "link").is_symlink()
    assert listing(tmp_path) - {f"run/{name}" for name in listing(target)} == {"run"}


def test_a_file_that_others_wrote_or_changed_stays_beside_the_new_one(tmp_path: Path) -> None:
    target = tmp_path / "run"
    write(target, table="1")
    (target / "table").write_text("changed")
    (target / "page").write_text("mine")
    (target / "page~").write_text("mine, too")
    (target / "plans").write_text("not a folder")
    write(target, table="2", page="2", plans__a="2")
    texts = {name: (target / name).read_text() for name in ("table", "page", "plans/a")}
    assert set(texts.values()) == {"2"}
    kept = {name: (target / name).read_text() for name in ("table~", "page~", "page~~", "plans~")}
    assert sorted(kept.values()) == ["changed", "mine", "mine, too", "not a folder"]
    write(target, table="3")
    assert listing(target) == {MARKER, "table", *kept}


def test_a_list_of_an_older_or_another_hand_lets_nothing_be_removed(tmp_path: Path) -> None:
    target, victim = tmp_path / "run", tmp_path / "victim"
    write(target, table="1")
    victim.write_text("mine")
    (target / "more").write_text("mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    for text in (f"{digest}  ../victim\n{digest}  {victim}\n", "", "\0\xff"):
        (target / MARKER).write_text(text, encoding="latin-1")
        write(target, table="2")
        assert victim.exists()
        assert (target / "more").read_text() == "mine"
        assert (target / "table").read_text() == "2"


def test_a_folder_within_a_folder_is_of_the_same_run(tmp_path: Path) -> None:
    write(tmp_path / "run", table="1")
    write(tmp_path / "run/budget", shares="1")
    write(tmp_path / "run", table="2")
    assert listing(tmp_path / "run") == {MARKER, "table"}


def test_many_commands_may_write_one_folder_at_once(tmp_path: Path) -> None:
    """None fails, the folder is that of one of them, and nothing is lost or left."""
    target = tmp_path / "new/run"
    write(target, first="1")
    (target / "notes").mkdir()
    for k in range(20):
        (target / f"notes/{k}").write_text("mine")

    def writes(name: str) -> None:
        for k in range(30):
            write(target, a=f"{name} {k}", b=f"{name} {k}")

    with ThreadPoolExecutor(4) as threads:
        for done in [threads.submit(writes, name) for name in "abcd"]:
            done.result()
    assert (target / "a").read_text() == (target / "b").read_text()
    names = {"a", "b", MARKER, "notes", *(f"notes/{k}" for k in range(20))}
    assert listing(target) == names
    assert [p.name for p in target.parent.iterdir()] == ["run"]


def test_a_folder_that_is_replaced_while_it_is_looked_at_is_nobody_elses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its names are read when the other command has taken away its list, but not yet the rest."""
    target, real = tmp_path / "run", Path.iterdir
    write(target, table="old")
    (target / "mine").write_text("mine")

    def overtaken(path: Path) -> Iterator[Path]:
        monkeypatch.undo()
        write(target, table="new")
        return (each for each in real(path) if each.name != MARKER)

    monkeypatch.setattr(Path, "iterdir", overtaken)
    write(target, table="last")
    assert (target / "table").read_text() == "last"
    assert (target / "mine").read_text() == "mine"


def test_one_whose_folder_is_taken_tries_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the two renames another command makes the folder."""
    target = tmp_path / "run"
    write(target, table="old")
    (target / "mine").write_text("mine")
    real, calls = os.replace, []

    def overtaken(a: Any, b: Any) -> None:
        calls.append(a)
        if len(calls) == 2:
            (tmp_path / "run").mkdir()
            (tmp_path / "run/late").write_text("of another")
        real(a, b)

    monkeypatch.setattr(os, "replace", overtaken)
    write(target, table="new")
    assert len(calls) == 4
    assert listing(tmp_path) == {"run", f"run/{MARKER}", "run/table", "run/mine", "run/late"}
    assert (target / "table").read_text() == "new"


def test_one_whose_folder_was_taken_and_is_gone_again_tries_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what others put there is moved into a folder that the next command takes for ours."""
    target = tmp_path / "run"
    write(target, table="old")
    (target / "mine").write_text("mine")
    real, calls = os.replace, []

    def overtaken(a: Any, b: Any) -> None:
        calls.append(a)
        if len(calls) == 2:
            raise OSError(errno.ENOTEMPTY, os.strerror(errno.ENOTEMPTY))
        real(a, b)
        if Path(b) == target:  # another command is replacing it
            real(target, tmp_path / "taken")

    monkeypatch.setattr(os, "replace", overtaken)
    write(target, table="new")
    assert listing(target) == {MARKER, "mine"}
    assert (tmp_path / "taken/table").read_text() == "new"
    refuse_unwritable_folder(target)
