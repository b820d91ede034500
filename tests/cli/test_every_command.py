"""What every command has: help with an example, --json, --quiet, --verbose, completion."""

from __future__ import annotations

import functools
import inspect
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from command import main

import planner
from planner.cli.app import COMMANDS, load_command
from planner.cli.output import add_common_options

PAPER = Path(__file__).parents[2] / "problems/paper.toml"
FAST = ("plan", PAPER, "-m", "polynomial", "--set", "goal.travel=0.82", "--set", "limits={}")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command(command: str, run: Callable) -> None:
    text = run(command, "--help").out
    for word in ("--json", "-q, --quiet", "-v, --verbose", "-h, --help"):
        assert word in text
    assert "Example" in text
    assert f"  planner {command}" in text
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 80
    assert command in run("--help").out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_list_of_methods_counts(command: str, run: Callable) -> None:
    """A name that no method has is refused, whether it is in the first list or in the last."""
    if "--methods" not in run(command, "--help").out:
        assert command not in {"check", "compare", "budget", "sensitivity"}
        return
    for names in (("pie", "polynomial"), ("polynomial", "pie")):
        result = run(command, PAPER, *(word for name in names for word in ("--methods", name)))
        assert result.status == 2
        assert "'pie'" in result.err


@pytest.mark.parametrize("command", COMMANDS)
def test_the_list_says_of_a_command_what_the_command_says(command: str) -> None:
    assert COMMANDS[command][1] == (inspect.getdoc(load_command(command)) or "").splitlines()[0]


def test_every_function_that_ends_with_a_status_is_a_command_in_the_list_and_in_the_guide() -> None:
    rooms = [
        import_module(f"planner.cli.{name}") for name in {room for room, _ in COMMANDS.values()}
    ]
    ending = {
        name
        for room in rooms
        for name, one in inspect.getmembers(room, inspect.isfunction)
        if one.__module__ == room.__name__ and one.__annotations__.get("return") == "int"
    }
    assert {name for name in ending if not name.startswith("_")} == set(COMMANDS)
    guide = (PAPER.parents[1] / "docs/start.md").read_text("utf-8").partition("## All commands")[2]
    told = " ".join(row for row in guide.splitlines() if row.startswith("| `planner "))
    assert [name for name in COMMANDS if not re.search(rf"`(planner )?{name}\b", told)] == []


@pytest.mark.parametrize("command", [["plan", PAPER], ["new"], ["systems"]])
def test_quiet_and_verbose_exclude_each_other(command: list, run: Callable) -> None:
    result = run(*command, "-q", "-v")
    assert result.status == 2
    says = "planner: --quiet and --verbose contradict each other; give one of them\n"
    assert result.err == says


@pytest.mark.parametrize("command", COMMANDS)
def test_no_output_replaces_an_input(command: str, tmp_path: Path) -> None:
    function, calls = load_command(command), list[dict]()

    @functools.wraps(function)
    def recorded(**options: Any) -> int:
        calls.append(options)
        return 0

    file, link = tmp_path / "file", tmp_path / "link"
    file.touch()
    link.symlink_to(file)
    hints = get_type_hints(function)
    named = {name for name, hint in hints.items() if "Path" in str(hint)}
    for out in sorted(named & OUTPUTS):
        for name in sorted(named - {out}):
            several = "list" in str(hints[name])
            with pytest.raises(planner.InputError, match=str(tmp_path)):
                add_common_options(recorded)(**{out: link, name: [file] if several else file})
    assert calls == []
    assert add_common_options(recorded)(**dict.fromkeys(named - OUTPUTS, file)) == 0


OUTPUTS = {"out", "figure", "export_to"}


def test_a_file_is_not_written_over_itself(
    refused: Callable, run: Callable, tmp_path: Path
) -> None:
    mine, machine = tmp_path / "mine.toml", tmp_path / "machine.toml"
    assert run("new", mine).status == 0
    machine.touch()
    refused(["plan", mine, "--out", mine], "mine.toml")
    refused(["motion", "homing", mine, "--out", mine], "mine.toml")
    refused(["plan", mine, "--machine", machine, "--out", machine], "machine.toml: ")
    refused(["identify", tmp_path / "r.csv", "--problem", mine, "-o", mine], "mine.toml")
    refused(["identify", "r.csv", "-p", mine, "--from", machine, "-o", machine], "machine.toml: ")


def test_the_next_command_names_the_file_as_it_was_given(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("new", "a{0}.toml").err == (
        "written to a{0}.toml; next: planner check 'a{0}.toml'\n"
    )


def test_quiet_says_only_the_result(run: Callable, tmp_path: Path) -> None:
    normal, quiet = run("new", tmp_path / "a.toml"), run("new", tmp_path / "b.toml", "-q")
    assert "written to" in normal.err
    assert quiet.err == ""
    assert (tmp_path / "b.toml").exists()
    assert run("systems", "-q").out == run("systems").out
    refused = run("plan", PAPER, "-m", "polynomial", "--set", "goal.travel=0.8", "-q")
    assert refused.status == 3
    assert "input u2 reaches" in refused.err
    warned = run(*FAST, "-q", "--set", "start.theta_deg=[0.1, 0.1, 0.1]",
                 "--set", "goal.theta_deg=[0.5, 0.5, 0.5]")  # fmt: skip
    assert "warning: " in warned.err


def test_verbose_says_versions_steps_and_times_beside_the_result(run: Callable) -> None:
    result = run(*FAST, "-v", "--json")
    assert result.json["status"] == "solved"
    first, second, *steps, last = result.err.splitlines()
    assert steps == ["verifying"]
    assert first.startswith(f"planner {planner.__version__}, python ")
    assert second == "planning with polynomial"
    assert last.startswith("plan: ")
    assert last.endswith(" s in all")
    assert run("systems").err == "", "one call must not be verbose for the next"


def test_verbose_lists_the_steps_of_a_comparison_once_each(run: Callable) -> None:
    words = ("compare", PAPER, "--methods", "polynomial", "--samples", "2", "-v", "--json",
             "--set", "goal.travel=0.82", "--set", "goal.duration=2.5")  # fmt: skip
    steps = run(*words).err.splitlines()[1:-1]
    assert "planning polynomial" in steps
    assert "replaying polynomial" in steps
    assert len(set(steps)) == len(steps)


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("planner ex", ["export"]),
        ("planner plan x.toml --method poly", ["polynomial"]),
        ("planner export x.json --format r", ["ros2"]),
        ("planner new --system tr", ["trailers"]),
        ("planner schema p", ["problem", "plan"]),
        ("planner compare x.toml --methods pie", ["piecewise"]),
        ("planner check x.toml --methods convex,pol", ["convex,polynomial"]),
        ("planner sensitivity x.toml --pareto e", ["effort"]),
    ],
)
def test_completion_offers_commands_and_values(
    words: str, offered: list[str], run: Callable, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setenv("_PLANNER_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
    with pytest.raises(SystemExit) as end:
        run()
    assert end.value.code == 0
    out, err = capsys.readouterr()
    assert (out.split(), err) == (offered, "")


def test_shells_are_told_how_to_complete(run: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "--install-completion" in run("--help").out
    monkeypatch.setenv("_PLANNER_COMPLETE", "source_bash")
    with pytest.raises(SystemExit) as end:
        run()
    assert end.value.code == 0


COMPARE = f"compare {PAPER} --methods polynomial -n 3 --set goal.duration=0.05 --out run"


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("words", ["--help", "--version", "methods", "plan --help", COMPARE])
def test_a_reader_that_has_gone_is_no_error(
    words: str, monkeypatch: pytest.MonkeyPatch, capsys: Any, tmp_path: Path
) -> None:
    """`planner compare ... --out run | head -1`, for one, still writes its folder."""
    monkeypatch.chdir(tmp_path)
    reader, writer = os.pipe()
    os.close(reader)
    stream = os.fdopen(writer, "w")
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(words.split()) == 0
    assert "planner: " not in capsys.readouterr().err
    assert (tmp_path / "run/table.md").exists() == ("compare" in words)
    assert sys.stdout is not stream
    sys.stdout.close()
    with suppress(BrokenPipeError):
        stream.close()


def test_closed_streams_are_no_bug(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert main(["methods"]) == 0
    assert main(["plan", str(tmp_path / "none.toml")]) == 2
    sys.stdout.close()
    sys.stderr.close()


def test_the_list_of_commands_is_not_cut_short(run: Callable) -> None:
    text = run("--help").out
    listed = text[text.index("Commands:") :].splitlines()[1:]
    assert len(listed) == len(COMMANDS)
    assert [line for line in listed if line.endswith("...")] == []


def test_export_command(run: Callable, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    assert run(*FAST, "--out", plan, "-q").status == 0
    written = str(tmp_path / "x.csv")
    made = run("export", plan, "--out", written, "--rate", "5", "--json").json
    miss = made.pop("held_miss")
    assert (made.pop("claimed"), made.pop("only_sampled")) == ([], [])
    assert (made.pop("jumps"), made.pop("on_machines")["touching"]) == (None, 0)
    assert (made.pop("after"), made.pop("start"), made.pop("worth")) == (None, None, None)
    assert made == {"plan": str(plan), "format": "csv", "written": written, "exit_status": 0}
    assert list(miss) == ["phi2_deg", "theta1_deg", "theta2_deg", "theta3_deg"]
    assert 1e-4 < max(map(abs, miss.values())) < 0.1
    assert len(planner.load_samples(written).t) == 51
    sent = run("export", plan, "--out", written).err
    told = "; send the motors u1_rad_s and u2_rad_s and hold each row until the next, 10 ms: on an"
    assert f"written to {written}{told} ideal machine the end is off by phi2_deg" in sent
    slow = tmp_path / "slow.json"
    assert run("plan", PAPER, "--out", slow, "-q").status == 0
    asked = ("export", slow, "--format", "c", "--out", tmp_path / "c")
    made = run(*asked, "--real", "float", "--json").json
    assert (made["format"], made["written"]) == ("c", str(tmp_path / "c"))
    assert "typedef float" in (tmp_path / "c" / "sizes.h").read_text()
    assert run(*asked, "--real", "half").status == 2
    for words, says in (
        (["x.yaml"], "rest = true"),
        (["y.csv", "--real", "float"], "'csv' has no option for type of numbers"),
        (["y.csv", "--rate", "0"], "rate_hz = 0"),
        (["y.csv", "--joints", "a,b"], "joint names"),
    ):
        result = run("export", plan, "-o", tmp_path / words[0], *words[1:])
        assert result.status == 2
        assert says in result.err
        assert not (tmp_path / words[0]).exists()
