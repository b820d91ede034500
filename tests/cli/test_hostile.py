"""Hostile text and files: an input error with one short message, no bug, no raw controls."""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest
from command import main

import planner
from planner.support import tables as display
from planner.support.files import parse_json, read_bytes

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER = (PROBLEMS / "paper.toml").read_text(encoding="utf-8")
CUSTOM = (PROBLEMS / "custom.toml").read_text(encoding="utf-8")
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
EVIL = r"\u001b[31mred\u009b2J\u0007\u202eevil [red]x[/red] $\\frac{ $ | <script>a</script> `"


def test_a_byte_order_mark_is_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "bom.toml"
    path.write_text("\ufeff" + PAPER, encoding="utf-8")
    assert planner.load_problem(path) == planner.load_problem(PROBLEMS / "paper.toml")


def test_no_more_than_allowed_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(planner.InputError, match=r"allowed 4e-06 MB"):
        read_bytes(path, 4)


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, '{"a": ' * 100_000, "1" * 5000, '{"a": 1, "a": 2}', "[1" + "0" * 400 + "]"],
)
def test_hostile_json(text: str) -> None:
    with pytest.raises(ValueError, match=r"deeply|digits|twice"):
        parse_json(text)


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a comparison whose title, units and label are hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    text = CUSTOM.replace('"m2"]', f'"{EVIL}"]')
    text = re.sub(r'^title = ".*"', lambda _: f'title = "={EVIL}"', text, flags=re.MULTILINE)
    (folder / "evil.toml").write_text(text, encoding="utf-8")
    words = ["compare", folder / "evil.toml", "--methods", "polynomial", "-n", "2", "--report"]
    words += ["--set", "machine.step_s=0.01"]
    assert main([*map(str, words), "--out", str(folder / "out")]) in (0, 3)
    return folder / "out"


def test_no_format_shows_raw_controls(compared: Path, tmp_path: Path) -> None:
    for path in compared.rglob("*"):
        if path.suffix in (".md", ".csv", ".html"):
            assert not RAW.search(path.read_text(encoding="utf-8")), path.name
    figures = planner.load_comparison(compared).figures()
    assert figures
    for name, figure in figures.items():
        figure.savefig(tmp_path / "drawn.svg")
        assert not RAW.search((tmp_path / "drawn.svg").read_text(encoding="utf-8")), name
        ET.parse(tmp_path / "drawn.svg")
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


def test_cells_of_text_are_no_formulas() -> None:
    rows = [["=cmd|'/C calc'!A1", "+x", "-y", "@z", "\tq"], [-1.5, "-1.5", "+2e3", 3, ""]]
    first, second = display.csv_text(rows).splitlines()
    assert first == "'=cmd|'/C calc'!A1,'+x,'-y,'@z,'\tq"
    assert second == "-1.5,-1.5,+2e3,3,"


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("comparison.json", "junk"),
        ("comparison.json", "[" * 100_000),
        ("comparison.json", "[]"),
        ("comparison.json", {"command": [1]}),
        ("comparison.json", {"versions": [1]}),
        ("comparison.json", {"rows": 3}),
        ("comparison.json", {"rows": [3]}),
        ("replays.json", '{"polynomial": 5}'),
        ("replays.json", '{"polynomial": {"E_deg": "x", "median": 3}}'),
        ("plans/*.json", "{}"),
    ],
    ids=str,
)
def test_junk_in_a_comparison_folder(
    file: str, text: str | dict[str, object], run: Callable, compared: Path, tmp_path: Path
) -> None:
    shutil.copytree(compared, tmp_path / "c")
    path = next((tmp_path / "c").glob(file), tmp_path / "c" / file)
    entry = isinstance(text, dict)
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | text) if entry else text)  # type: ignore[operator, arg-type]
    result = run("report", tmp_path / "c", "--out", tmp_path / "page.html")
    assert result.status == 2
    assert str(tmp_path / "c") in result.err
    assert "is damaged" in result.err or not entry
    assert not (tmp_path / "page.html").exists()


TABLES = {
    "problem": str(PROBLEMS / "paper.toml"),
    "methods": ["polynomial"],
    "grid": {"goal.duration": [0.01, 0.02]},
}


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("points", "changes", "{"),
        ("points", "changes", "[1]"),
        ("points", "changes", "[" * 100_000),
        ("points", "changes", b"\xff\xfe"),
        ("sweeps", "keys", "3"),
    ],
)
def test_broken_json_in_a_database(table: str, column: str, value: object, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    path = tmp_path / "s.sqlite"
    planner.run_sweep(TABLES, path, workers=0)
    db = sqlite3.connect(path)
    with db:
        db.execute(f"UPDATE {table} SET {column} = ?", (value,))
    db.close()
    with pytest.raises(planner.InputError, match=r"s\.sqlite is damaged"):
        planner.load_sweep(path)


def test_broken_bytes_in_a_database(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    planner.run_sweep(TABLES, path, workers=0)
    content = path.read_bytes()
    path.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))
    with pytest.raises(planner.InputError, match=r"cannot use the database .*s\.sqlite"):
        planner.run_sweep(TABLES, path, workers=0)


@pytest.mark.parametrize("replaced", [False, True])
def test_a_database_that_is_deleted_meanwhile_is_no_success(replaced: bool, tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"

    def delete(doing: str, share: float) -> None:
        path.unlink(missing_ok=True)
        if replaced:
            path.touch()

    with pytest.raises(planner.InputError, match="deleted or replaced while the sweep ran"):
        planner.run_sweep(TABLES, path, workers=0, progress=delete)


ADDRESSES = ["junk", "://", "tcp://", "tcp://host", "tcp://host:99999", "x://host:1", "\x00"]


@pytest.mark.parametrize("address", [*ADDRESSES, "tcp://a b:1"])
def test_a_junk_address_of_a_cluster(address: str, tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match="Dask scheduler"):
        planner.run_sweep(TABLES, tmp_path / "s.sqlite", cluster=address)
