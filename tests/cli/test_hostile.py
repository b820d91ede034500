"""Hostile text and files: an input error with one short message, no bug, no raw controls."""

from __future__ import annotations

import json
import os
import re
import shutil
import sqlite3
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest

import planner
from planner.cli.app import main
from planner.support import tables as display
from planner.support.files import parse_json, parse_toml, read_bytes
from planner.sweep.results import load_sweep
from planner.sweep.run import run_sweep

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER = (PROBLEMS / "paper.toml").read_text(encoding="utf-8")
CUSTOM = (PROBLEMS / "custom.toml").read_text(encoding="utf-8")
DURATION, K_G = "duration = 10.0", "k_g = 0.668811"
SLOPES = 'slopes = ["tan(heading)", "y"]'
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
EVIL = r"\u001b[31mred\u009b2J\u0007\u202eevil [red]x[/red] $\\frac{ $ | <script>a</script> `"


def slopes(last: str) -> str:
    return CUSTOM.replace(SLOPES, f'slopes = ["tan(heading)", "{last}"]')


TEXTS = {
    "number of 5,000 digits": (PAPER.replace(DURATION, "duration = " + "1" * 5000), "digits"),
    "the same in hexadecimal": (PAPER.replace(DURATION, "duration = 0x" + "f" * 5000), "digits"),
    "brackets 100,000 deep": ("a = " + "[" * 100_000 + "]" * 100_000, "nested too deeply"),
    "tables 60 deep": (PAPER + "\n[" + "a." * 60 + "b]\n", "nested too deeply"),
    "key of 100,000 parts": ("a" + ".a" * 100_000 + " = 1", "more than 100 parts"),
    "600 terms": (slopes("y" + " + 1e-3*y" * 600), "too many terms"),
    "100,000 terms": (slopes("y" + "+y" * 100_000), "is not an expression|too many terms"),
    "number of 400 digits in an expression": (slopes("y + " + "1" * 400), "hundreds of digits"),
    "interval of the whole line": (
        CUSTOM.replace("[-3.0, 3.0]", "[-1e14, 1e308]"),
        r"'system\.intervals\.y\[1\]' = 1e\+308: too large",
    ),
    "20,000 tables": (
        PAPER + "".join(f"\n[x{k}]\na = 1" for k in range(20_000)),
        r"(?s)unknown key 'x0'.*and 19990 more errors",
    ),
    "k_g of 1e308": (PAPER.replace(K_G, "k_g = 1e308"), r"'system\.k_g' = 1e\+308: too large"),
    "k_g of 1e-308": (PAPER.replace(K_G, "k_g = 1e-308"), r"'system\.k_g' = 1e-308: too small"),
    "k_g of -0.0": (PAPER.replace(K_G, "k_g = -0.0"), r"'system\.k_g' = -0\.0"),
    "duration of 1e308": (PAPER.replace(DURATION, "duration = 1e308"), "too large"),
    "limits of 5e-324": (PAPER.replace("[0.5, 0.5]", "[5e-324, 0.5]"), r"rad_s\[0\]'.*too small"),
    "a date": (PAPER.replace(DURATION, "duration = 2020-01-01"), r"'goal\.duration' = datetime"),
    "controls in a key": (PAPER.replace(DURATION, f'"{EVIL}" = 1'), r"unknown key 'goal\."),
    "lone surrogate": ('title = "\\ud800"\n' + PAPER, "not valid TOML"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_hostile_text_of_a_problem(name: str, run: Callable, tmp_path: Path) -> None:
    text, says = TEXTS[name]
    path = tmp_path / "hostile.toml"
    path.write_text(text, encoding="utf-8")
    began = time.process_time()
    result = run("plan", path, "--method", "polynomial")
    assert result.status == 2
    assert time.process_time() - began < 4  # two are promised; this also runs beside other tests
    assert "hostile.toml" in result.err
    assert re.search(says, result.err)
    assert len(result.err) < 3000
    assert not RAW.search(result.err)
    assert run("plan", path, "--json").json["status"] == "bad_input"


def test_a_byte_order_mark_is_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "bom.toml"
    path.write_text("\ufeff" + PAPER, encoding="utf-8")
    assert planner.load_problem(path) == planner.load_problem(PROBLEMS / "paper.toml")


def places(folder: Path) -> list[Path]:
    """A pipe, a device, a link to itself, a folder, and a file of five gigabytes."""
    os.mkfifo(folder / "pipe")
    (folder / "zero").symlink_to("/dev/zero")
    (folder / "loop").symlink_to("loop")
    with (folder / "huge").open("wb") as stream:
        stream.truncate(5 * 10**9)
    return [folder / name for name in ("pipe", "zero", "loop", ".", "huge")]


READ = ["plan {}", "check {}", "compare {}", "sweep {}", "budget {}", "sensitivity {}"]
READ += ["export {} --out o.csv", "animate {} --out o.gif", "report {}"]


@pytest.mark.parametrize("command", READ)
def test_what_is_no_file_is_refused_before_reading(
    command: str, run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for path in places(tmp_path):
        words = command.split()
        if command.startswith("report"):
            (tmp_path / "folder").mkdir(exist_ok=True)
            (tmp_path / "folder/comparison.json").unlink(missing_ok=True)
            (tmp_path / "folder/comparison.json").symlink_to(path)
            path = tmp_path / "folder"
        result = run(*(str(path) if word == "{}" else word for word in words))
        assert result.status == 2
        assert result.err.count("\n") == 1
        assert "cannot read" in result.err


def test_no_more_than_allowed_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(planner.InputError, match="at most"):
        read_bytes(path, 4)


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, '{"a": ' * 100_000, "1" * 5000, '{"a": 1, "a": 2}', "[1" + "0" * 400 + "]"],
)
def test_hostile_json(text: str) -> None:
    with pytest.raises(ValueError, match=r"deeply|digits|twice"):
        parse_json(text)


def test_deep_but_sane_values_are_read() -> None:
    assert parse_toml("a = [[[[1]]]]") == {"a": [[[[1]]]]}
    assert parse_json("3") == 3


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a comparison whose title, units and label are hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    text = CUSTOM.replace('"m2"]', f'"{EVIL}"]')
    text = re.sub(r'^title = ".*"', lambda _: f'title = "={EVIL}"', text, flags=re.MULTILINE)
    (folder / "evil.toml").write_text(text, encoding="utf-8")
    words = ["compare", folder / "evil.toml", "--methods", "polynomial", "-n", "2", "--report"]
    assert main([*map(str, words), "--out", str(folder / "out")]) in (0, 3)
    return folder / "out"


def test_no_format_shows_raw_controls(compared: Path) -> None:
    for path in compared.rglob("*"):
        if path.suffix in (".md", ".csv", ".html", ".svg"):
            assert not RAW.search(path.read_text(encoding="utf-8")), path.name
        if path.suffix == ".svg":
            ET.parse(path)
    assert "<script>a</script>" not in (compared / "report.html").read_text(encoding="utf-8")
    heading = (compared / "table.md").read_text(encoding="utf-8").partition("\n")[0]
    assert r"\<script\>" in heading
    assert r"\|" in heading


def test_what_was_written_comes_back_as_it_was(compared: Path) -> None:
    problem = planner.load_problem(compared / "problem.toml")
    assert "\x1b[31m" in problem.to_dict()["title"]
    assert problem.name.startswith("=[31mred2Jevil [red]x[/red] $")
    kept = json.loads((compared / "comparison.json").read_text(encoding="utf-8"))
    assert kept["problem"]["title"] == problem.to_dict()["title"]


def test_the_terminal_is_not_steered(run: Callable, compared: Path) -> None:
    sweep = compared.parent / "sweep.toml"
    text = f'title = "{EVIL}"\nproblem = "out/problem.toml"\nmethods = ["polynomial"]\n'
    sweep.write_text(f'{text}[grid]\n"goal.travel" = [2.0, 2.1]\n', encoding="utf-8")
    result = run("sweep", sweep, "--dry-run")
    assert result.status == 0
    assert not RAW.search(result.out + result.err)
    assert "[red]x[/red]" in result.out
    odd = run("plan", compared.parent / "no\x1b[31m\u202esuch.toml")
    assert odd.status == 2
    assert not RAW.search(odd.err)
    assert not RAW.search(run("plan", "--no\x1b[31m").err)


def test_cells_of_text_are_no_formulas() -> None:
    rows = [["=cmd|'/C calc'!A1", "+x", "-y", "@z", "\tq"], [-1.5, "-1.5", "+2e3", 3, ""]]
    first, second = display.csv_text(rows).splitlines()
    assert first == "'=cmd|'/C calc'!A1,'+x,'-y,'@z,'\tq"
    assert second == "-1.5,-1.5,+2e3,3,"


JUNK = {
    "no JSON": ("comparison.json", "junk"),
    "brackets": ("comparison.json", "[" * 100_000),
    "a list": ("comparison.json", "[]"),
    "replays of no kind": ("replays.json", '{"polynomial": 5}'),
    "replays of words": ("replays.json", '{"polynomial": {"E_deg": "x", "median": 3}}'),
    "an empty plan": ("plans/polynomial.json", "{}"),
}


@pytest.mark.parametrize("name", JUNK)
def test_junk_in_a_comparison_folder(
    name: str, run: Callable, compared: Path, tmp_path: Path
) -> None:
    shutil.copytree(compared, tmp_path / "c")
    file, text = JUNK[name]
    if file.startswith("plans"):
        file = str(next((tmp_path / "c/plans").iterdir()).relative_to(tmp_path / "c"))
    (tmp_path / "c" / file).write_text(text, encoding="utf-8")
    result = run("report", tmp_path / "c", "--out", tmp_path / "page.html")
    assert result.status == 2
    assert str(tmp_path / "c") in result.err
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize(
    "entry", [{"command": [1]}, {"differences": "x"}, {"versions": [1]}, {"rows": 3}, {"rows": [3]}]
)
def test_damaged_entries_of_a_comparison(
    entry: dict[str, object], run: Callable, compared: Path, tmp_path: Path
) -> None:
    shutil.copytree(compared, tmp_path / "c")
    path = tmp_path / "c/comparison.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | entry))
    result = run("report", tmp_path / "c")
    assert result.status == 2
    assert "is damaged" in result.err


LONG = "n" * 300


@pytest.mark.parametrize(
    "words",
    [
        ["plan", PROBLEMS / "paper.toml", "--out"],
        ["compare", PROBLEMS / "paper.toml", "--out"],
        ["calibrate", "--out"],
        ["new"],
        ["sweep", PROBLEMS / "sweeps/paper-travel.toml", "--db"],
    ],
    ids=lambda words: words[0],
)
def test_names_that_cannot_be(
    words: list[str], run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*words, LONG)
    assert result.status == 2
    assert "File name too long" in result.err
    assert len(result.err) < 200
    os.symlink("loop", "loop")
    assert run(*words, "loop").status == 2
    assert [p.name for p in tmp_path.iterdir()] == ["loop"]


TABLES = {
    "problem": str(PROBLEMS / "paper.toml"),
    "methods": ["polynomial"],
    "grid": {"goal.duration": [0.01, 0.02]},
}


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("points.changes", "{"),
        ("points.changes", "[1]"),
        ("points.changes", "[" * 100_000),
        ("points.changes", b"\xff\xfe"),
        ("sweeps.keys", "3"),
        ("sweeps.description", "junk"),
    ],
)
def test_broken_json_in_a_database(column: str, value: object, tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    run_sweep(TABLES, path, workers=0)
    table, name = column.split(".")
    db = sqlite3.connect(path)
    with db:
        db.execute(f"UPDATE {table} SET {name} = ?", (value,))
    db.close()
    pytest.importorskip("pandas")
    with pytest.raises(planner.InputError, match=r"s\.sqlite is damaged"):
        load_sweep(path)


def test_broken_bytes_in_a_database(run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    run_sweep(TABLES, path, workers=0)
    content = path.read_bytes()
    path.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))
    with pytest.raises(planner.InputError, match=r"cannot use the database .*s\.sqlite"):
        run_sweep(TABLES, path, workers=0)


@pytest.mark.parametrize("replaced", [False, True])
def test_a_database_that_is_deleted_meanwhile_is_no_success(replaced: bool, tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"

    def delete(doing: str, share: float) -> None:
        path.unlink(missing_ok=True)
        if replaced:
            path.touch()

    with pytest.raises(planner.InputError, match="deleted or replaced while the sweep ran"):
        run_sweep(TABLES, path, workers=0, progress=delete)


@pytest.mark.parametrize(
    "address",
    [
        "junk",
        "://",
        "tcp://",
        "tcp://host",
        "tcp://host:99999",
        "tcp://a b:1",
        "x://host:1",
        "\x00",
    ],
)
def test_a_junk_address_of_a_cluster(address: str, tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match="is not the address of a Dask scheduler"):
        run_sweep(TABLES, tmp_path / "s.sqlite", cluster=address)


@pytest.mark.parametrize(
    "words",
    [
        ["--set", "goal.travel=" + "[" * 3000],
        ["--set", "goal.duration=" + "1" * 5000],
        ["--set", "a." * 3000 + "b=1"],
        ["--set", "goal.duration=1e308"],
    ],
)
def test_hostile_words(words: list[str], run: Callable) -> None:
    result = run("plan", PROBLEMS / "paper.toml", *words)
    assert result.status == 2
    assert len(result.err) < 1000


def test_more_machines_than_memory(run: Callable) -> None:
    for number in ("1000000000", "9" * 30):
        result = run("compare", PROBLEMS / "paper.toml", "--samples", number)
        assert result.status == 2
        assert "at most 1000000 machines" in result.err
