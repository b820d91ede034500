"""The command as a process of its own: exit status, streams, Ctrl-C, pipes, terminals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

PAPER = str(Path(__file__).parents[2] / "problems/paper.toml")
PLANNER = [sys.executable, "-m", "planner"]

# `python -m planner`, whose law says that it runs and then waits to be interrupted.
LONG_JOB = """
import runpy, signal, sys, time
from dataclasses import replace
import planner

def long_job(problem, options):
    print("running", file=sys.stderr, flush=True)
    time.sleep({seconds})
    return law.plan(problem, options)

law = planner.METHODS["polynomial"]
planner.METHODS["polynomial"] = replace(law, plan=long_job)
runpy.run_module("planner", run_name="__main__", alter_sys=True)
"""


# Says that it refines the motion it held at Ctrl-C, and takes its time.
SLOW_END = """
import sys, time
import planner.cli.app
from planner.methods.collocation import method as collocation_method

def slowly(*arguments):
    print("refining what is held", file=sys.stderr, flush=True)
    time.sleep({seconds})
    return polished(*arguments)

polished, collocation_method.polish = collocation_method.polish, slowly
sys.exit(planner.cli.app.main(sys.argv[1:]))
"""


def started(words: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_ctrl_c_ends_quietly_and_writes_nothing(tmp_path: Path) -> None:
    words = ["plan", PAPER, "--method", "polynomial", "--json", "--out", str(tmp_path / "out")]
    with started([sys.executable, "-c", LONG_JOB.format(seconds=60), *words]) as job:
        assert job.stderr is not None
        said = job.stderr.readline()
        job.send_signal(signal.SIGINT)
        stdout, stderr = job.communicate(timeout=120)
    assert said == "running\n"
    assert job.returncode == 130
    assert stderr == "planner: interrupted, nothing written\n"
    assert json.loads(stdout)["status"] == "interrupted"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_while_a_motion_is_held(presses: int, tmp_path: Path) -> None:
    """It is refined and written; nothing is where Ctrl-C is pressed once more before that."""
    script = SLOW_END.format(seconds=60 if presses == 2 else 0)
    options = ["start=wander", "starts=2000", "attempts=2000"]
    sets = [word for each in options for word in ("--set", f"method.collocation.{each}")]
    out = tmp_path / "plan.json"
    words = ["plan", PAPER, "--json", "--verbose", "--out", str(out), *sets]
    with started([sys.executable, "-c", script, *words]) as job:
        assert job.stderr is not None
        said = iter(job.stderr)
        assert any("'random loop 2'" in line for line in said)
        job.send_signal(signal.SIGINT)
        assert any("refining what is held" in line for line in said)
        if presses == 2:
            job.send_signal(signal.SIGINT)
        stdout, stderr = job.communicate(timeout=60)
    answer = json.loads(stdout)
    assert job.returncode == answer["exit_status"] == 130
    assert answer["status"] == "interrupted"
    if presses == 1:
        assert answer["verified"]
        assert "planner: interrupted: this is the best plan found so far" in stderr
        assert json.loads(out.read_text())["status"] == "interrupted"
    else:
        assert "planner: interrupted, nothing written" in stderr
        assert list(tmp_path.iterdir()) == []


def test_a_job_in_the_background_of_a_script_leaves_ctrl_c_alone() -> None:
    ignored = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    words = ["plan", PAPER, "--method", "polynomial", "--set", "limits={}"]
    with started([sys.executable, "-c", ignored + LONG_JOB.format(seconds=0.3), *words]) as job:
        assert job.stderr is not None
        assert job.stderr.readline() == "running\n"
        job.send_signal(signal.SIGINT)
        assert "interrupted" not in job.communicate(timeout=120)[1]
    assert job.returncode == 0


def test_a_reader_that_leaves_is_no_error() -> None:
    with started([*PLANNER, "schema"]) as job:
        assert job.stdout is not None
        assert job.stderr is not None
        job.stdout.close()
        assert job.stderr.read() == ""
        assert job.wait(timeout=30) == 0


def test_a_reader_of_the_messages_that_leaves_changes_neither_result_nor_status() -> None:
    compared = ["compare", PAPER, "-n", "2", "--methods", "sinusoid", "--verbose"]
    for words, status in [(["plan", "none.toml"], 2), (["plan", "--frob"], 2), (compared, 0)]:
        with started([*PLANNER, *words]) as job:
            assert job.stdout is not None
            assert job.stderr is not None
            job.stderr.close()
            assert bool(job.stdout.read()) == (status == 0)
            assert job.wait(timeout=60) == status


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs the device /dev/full")
def test_a_full_disk_behind_standard_output_is_told() -> None:
    """Each command in a process that ends as one does, of which only the start is shared."""
    script = """
import os, sys, warnings
from planner.cli.app import main
warnings.simplefilter("ignore")  # of forks beside threads
for words in (["methods", "--json"], ["methods"], ["--version"], ["--help"]):
    if os.fork() == 0:
        sys.exit(main(words, last=True))
    print(os.waitstatus_to_exitcode(os.wait()[1]), file=sys.stderr, flush=True)
"""
    with open("/dev/full", "w", encoding="utf-8") as full:
        words = [sys.executable, "-c", script]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=True)
    says = "planner: cannot write standard output: No space left on device"
    assert done.stderr.splitlines() == [says, "2"] * 4


def test_a_terminal_wraps_all_but_commands() -> None:
    script = (
        "from planner.cli.output import print_text, say\n"
        "from planner.support.tables import CommandLine\n"
        "words = ['planner', 'check', 'my file.toml', *['--set', 'goal.travel=2.0'] * 8]\n"
        "for write in (print_text, say):\n"
        "    write(CommandLine.of(*words, after='Next: '))\n"
        "    write('the planner ' * 15)\n"
    )
    ours, theirs = os.openpty()
    environment = os.environ | {"COLUMNS": "80", "TERM": "xterm"}
    words = [sys.executable, "-c", script]
    subprocess.run(words, stdout=theirs, stderr=theirs, env=environment, check=True)
    os.close(theirs)
    lines = [line.rstrip() for line in os.read(ours, 65536).decode().splitlines()]
    os.close(ours)
    command = "Next: planner check 'my file.toml'" + 8 * " --set goal.travel=2.0"
    assert lines[0] == lines[len(lines) // 2] == command
    assert max(len(line) for line in lines if line != command) <= 80


def test_colours_on_a_terminal_only(run: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"} | {"TERM": "xterm"}
    ours, theirs = os.openpty()
    done = subprocess.run([*PLANNER, "methods"], stdout=theirs, env=environment, check=True)
    os.close(theirs)
    assert done.returncode == 0
    assert b"\x1b[" in os.read(ours, 65536)
    os.close(ours)
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert "\x1b" not in run("methods").out
