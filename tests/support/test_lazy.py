"""Public names are imported when they are first used, and mean what the type checker is told."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import planner
import planner.report
from planner.support.package import ROOT

LAZY = [planner, planner.report]
NAMES = [(package, name) for package in LAZY for name in package.__all__]


@pytest.mark.parametrize("package", LAZY, ids=lambda package: package.__name__)
def test_table_imports_and_all_agree(package: ModuleType) -> None:
    assert package.__file__
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    told = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert told == package._homes
    assert sorted(told) == sorted(package.__all__)


@pytest.mark.parametrize(("package", "name"), NAMES, ids=[f"{p.__name__}.{n}" for p, n in NAMES])
def test_every_name_is_there_and_is_no_module(package: ModuleType, name: str) -> None:
    assert not isinstance(getattr(package, name), ModuleType)


def test_unknown_names() -> None:
    with pytest.raises(AttributeError, match="'planner' has no attribute 'nonsense'"):
        planner.nonsense  # type: ignore[attr-defined]  # noqa: B018
    assert {"solve", "Machine", "verify"} <= set(dir(planner))


def test_names_of_modules_mean_the_objects_in_every_order() -> None:
    code = """
import sys, planner
assert not {"planner.solve", "casadi", "numpy", "osqp"} & set(sys.modules)
assert planner.solve(planner.load_problem(sys.argv[1]), "collocation").verified
assert not {"osqp", "matplotlib", "typer", "planner.machine"} & set(sys.modules)
import planner.retime, planner.check
from planner.verification.verify import Check
assert callable(planner.retime) and callable(planner.check) and callable(planner.verify)
from planner import solve, compare
assert callable(solve) and callable(compare)
assert planner.systems.manipulator.Manipulator is planner.Manipulator
"""
    paper = Path(__file__).parents[2] / "problems" / "paper.toml"
    subprocess.run([sys.executable, "-c", code, str(paper)], check=True)


def test_the_root_holds_the_package() -> None:
    """Workers import from there: from the package's own folder `plan` or `check` would be ours."""
    assert Path(planner.__file__).parent == ROOT / "planner"


def test_what_commands_and_processes_of_a_sweep_start_without() -> None:
    code = """
import sys, planner.sweep.pools
heavy = {"scipy.stats", "osqp", "matplotlib", "sqlite3", "pandas", "planner.robustness.trade_off"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
import planner.cli.app  # each command starts with it
slow = {"scipy.stats", "matplotlib"}
assert not slow & set(sys.modules), slow & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
