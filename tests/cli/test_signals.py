"""Ctrl-C and SIGTERM at any moment: one line, status 130 or 143, nothing left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import pytest

from planner.report import result_folder
from planner.support import deadline, files
from planner.support.interrupts import (
    Terminated,
    handle_signals,
    hear_signals,
    hold_signals,
    signal_listener,
)

PAPER = Path(__file__).parents[2] / "problems/paper.toml"
SCRIPT = Path(sys.executable).with_name("planner")
STARTS = [[sys.executable, "-m", "planner"], [str(SCRIPT)]]
SAID = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
BOTH = pytest.mark.parametrize("number", list(SAID), ids=lambda n: n.name)

# Sends itself a signal when a module is about to be loaded.
WHEN_LOADED = """
import os, sys
import planner_start

class Press:
    def find_spec(self, name, *_):
        if name == {module!r}:
            os.kill(os.getpid(), {number})

sys.meta_path.insert(0, Press())
sys.exit(planner_start.main())
"""


@BOTH
@pytest.mark.parametrize("module", ["planner.cli", "casadi._casadi"])
def test_a_signal_while_modules_load(module: str, number: signal.Signals, tmp_path: Path) -> None:
    code = WHEN_LOADED.format(module=module, number=int(number))
    words = ["plan", PAPER, "--method", "polynomial", "--out", tmp_path / "plan.json", "--json"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 128 + number
    assert done.stderr == f"planner: {SAID[number]}, nothing written\n"
    assert json.loads(done.stdout)["exit_status"] == 128 + number
    assert list(tmp_path.iterdir()) == []


def hears(job: subprocess.Popen[bytes], number: int) -> bool:
    """Whether a process has a handler for a signal; before that it is Python that starts."""
    status = Path(f"/proc/{job.pid}/status").read_text(encoding="utf-8")
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
@pytest.mark.parametrize(
    "moments",
    [
        (0.0, 0.2, 0.5, 1.0),
        pytest.param((0.1, 0.4, 0.7, 1.5, 2.0, 2.5, 3.5, 5.5), marks=pytest.mark.campaign),
    ],
    ids=len,
)
def test_signals_at_many_moments(moments: tuple[float, ...], tmp_path: Path) -> None:
    """All processes at once, each with its own moment, from loading to writing."""
    jobs = []
    for k, moment in enumerate(moments):
        (tmp_path / str(k)).mkdir()
        number = list(SAID)[k // 2 % 2]
        words = ["compare", str(PAPER), "--methods", "polynomial:travel=middle", "-n", "5"]
        words += ["--out", str(tmp_path / str(k) / "run")]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        jobs.append((moment, number, subprocess.Popen([*STARTS[k % 2], *words], **pipes)))
    ended = 0
    for *_, job in jobs:
        while not hears(job, signal.SIGTERM):
            time.sleep(0.01)
    began = time.monotonic()
    for k, (moment, number, job) in enumerate(jobs):
        time.sleep(max(0.0, began + moment - time.monotonic()))
        job.send_signal(number)
        said = job.communicate(timeout=60)[1].decode()
        left = [p.name for p in (tmp_path / str(k)).iterdir()]
        assert job.returncode in (3, 128 + number), said  # 3: it was done before
        assert "Traceback" not in said
        if job.returncode == 128 + number:
            ended += 1
            assert said.count("\n") == 1, said
            assert SAID[number] in said
        assert left in ([], ["run"])
    assert ended


def handled(number: signal.Signals) -> type[BaseException]:
    return KeyboardInterrupt if number == signal.SIGINT else Terminated


class Gone:
    """What a weak reference is to."""


@BOTH
def test_no_signal_is_lost_where_python_drops_exceptions(
    number: signal.Signals, capfd: pytest.CaptureFixture[str]
) -> None:
    """What a weak reference's callback raises is dropped, with a traceback on standard error."""
    there = [Gone()]
    callback = weakref.ref(there[0], lambda _: signal.raise_signal(number))

    def work() -> None:
        there.clear()
        deadline.check()

    with pytest.raises(handled(number)), hear_signals():
        work()
    assert callback() is None
    assert capfd.readouterr() == ("", "")


@BOTH
@pytest.mark.parametrize("step", ["mkdtemp", "rmtree", "replace"])
def test_a_folder_leaves_nothing_whenever_it_is_stopped(
    number: signal.Signals, step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also between making a folder and noting its name, and in cleaning up."""
    owner: Any = {
        "mkdtemp": result_folder.tempfile,
        "rmtree": result_folder.shutil,
        "replace": result_folder.os,
    }[step]
    real: Callable[..., Any] = getattr(owner, step)

    def pressed(*words: Any, **options: Any) -> Any:
        signal.raise_signal(number)
        made = real(*words, **options)
        signal.raise_signal(number)
        return made

    monkeypatch.setattr(owner, step, pressed)
    with (
        pytest.raises(handled(number)),
        hear_signals(),
        result_folder.folder(tmp_path / "new/run") as place,
    ):
        (place / "half.txt").touch()
    left = {p.name for p in tmp_path.rglob("*")}
    # A folder that was complete when the signal came stays, and only whole.
    assert left == ({"new", "run", "half.txt", ".planner"} if step != "mkdtemp" else set())


@BOTH
def test_a_file_is_whole_or_not_there(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.fdopen

    def pressed(*words: Any, **options: Any) -> Any:
        signal.raise_signal(number)
        return real(*words, **options)

    monkeypatch.setattr(os, "fdopen", pressed)
    with pytest.raises(handled(number)), hear_signals():
        files.write_text(tmp_path / "a.json", "{}")
    assert list(tmp_path.iterdir()) == []


@BOTH
@pytest.mark.parametrize("heard", [True, False], ids=["command", "library"])
def test_a_signal_that_compiled_code_swallows_is_heeded(
    number: signal.Signals, heard: bool
) -> None:
    def swallow() -> None:
        with suppress(BaseException):
            signal.raise_signal(number)

    if not heard:
        signal.signal(number, signal.default_int_handler)
    error = handled(number) if heard else KeyboardInterrupt
    with pytest.raises(error), hear_signals() if heard else nullcontext(), hold_signals():
        swallow()


def test_signals_are_held_back_and_none_is_lost() -> None:
    steps = []

    def two_steps() -> None:
        with hold_signals():
            with hold_signals():
                signal.raise_signal(signal.SIGINT)
                signal.raise_signal(signal.SIGTERM)
                steps.append(1)
            steps.append(2)
            handle_signals()
            steps.append(3)

    with pytest.raises(Terminated), hear_signals():
        two_steps()
    assert steps == [1, 2]
    assert signal_listener.status == 143


@BOTH
def test_an_error_that_hides_a_signal_is_no_bug(
    number: signal.Signals, run: Callable, law: Callable
) -> None:
    def hides(plan: Any) -> Any:
        with suppress(BaseException):
            signal.raise_signal(number)
        raise ImportError("initialization failed")

    law(hides)
    result = run("plan", PAPER, "--method", "polynomial")
    assert result.status == 128 + number
    assert result.err == f"planner: {SAID[number]}, nothing written\n"


def test_what_was_written_before_a_signal_is_told(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(text: str) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("planner.cli.start.note", pressed)
    target = tmp_path / "problem.toml"
    result = run("new", target)
    assert result.status == 143
    assert result.err == f"planner: terminated, {target} written before\n"
    assert target.exists()
