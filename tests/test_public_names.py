"""Public names are imported when they are first used, and mean what the type checker is told."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import planner
import planner.report
from planner.support.package import ROOT

NAMES = [(package, name) for package in (planner, planner.report) for name in package.__all__]
PAPER = ROOT / "problems" / "paper.toml"


@pytest.mark.parametrize(("package", "name"), NAMES, ids=[f"{p.__name__}.{n}" for p, n in NAMES])
def test_every_name_is_there_and_is_no_module(package: ModuleType, name: str) -> None:
    value = getattr(package, name)
    assert not isinstance(value, ModuleType)
    if callable(value):
        assert pickle.loads(pickle.dumps(value)) is value


def test_tests_import_a_public_name_from_where_it_is_public() -> None:
    """So that it may move to another module without a change of a test."""
    public = {name: getattr(package, name) for package, name in NAMES}
    line = re.compile(r"^ *from (planner\.[\w.]+) import ([\w, ]+|\([^)]*\))$", re.M)
    found = [
        f"{path.name}: {name} of {module}"
        for path in {*(ROOT / "tests").rglob("test_*.py")} - {Path(__file__)}
        for module, names in line.findall(path.read_text("utf-8"))
        for name in re.findall(r"\w+", names)
        if module != "planner.report"
        and name in public
        and getattr(import_module(module), name, None) is public[name]
    ]
    assert found == [], "import them from planner or planner.report"


def test_unknown_names_are_refused_with_the_one_that_is_meant() -> None:
    words = [sys.executable, "-c", "import planner; planner.sovle"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    last = done.stderr.splitlines()[-1]
    assert last == "AttributeError: No planner attribute sovle. Did you mean: 'solve'?"
    assert not hasattr(planner.report, "nonsense")


def test_a_package_lists_its_public_names_and_no_modules_that_were_imported() -> None:
    import planner.plan.samples

    assert planner.plan.samples
    shown = {name for name in dir(planner) if not name.startswith("__")}
    assert shown == {*planner.__all__, "report"}
    assert {name for name in dir(planner.report) if not name.startswith("__")} == {
        *planner.report.__all__
    }
    taken: dict[str, object] = {}
    exec("from planner import *", taken)
    assert taken.keys() - {"__builtins__"} == set(planner.__all__)


def test_names_of_modules_mean_the_objects_in_every_order() -> None:
    code = """
import sys, planner
assert planner.solve(planner.load_problem(sys.argv[1]), "collocation").verified
assert not {"osqp", "matplotlib", "typer", "planner.machine"} & set(sys.modules)
import planner.retime, planner.check
from planner.verification.verify import Check
assert callable(planner.retime) and callable(planner.check) and callable(planner.verify)
from planner import solve, compare
assert callable(solve) and callable(compare)
assert planner.systems.manipulator.Manipulator is planner.Manipulator
"""
    subprocess.run([sys.executable, "-c", code, str(PAPER)], check=True)


def test_the_root_holds_the_package() -> None:
    """Workers import from there: from the package's own folder `plan` or `check` would be ours."""
    assert Path(planner.__file__).parent == ROOT / "planner"


HEAVY = ("casadi.casadi", "matplotlib", "numpy", "osqp", "pandas", "pydantic", "rich", "scipy")


@pytest.mark.parametrize(
    ("word", "loaded"),
    [
        ("--help", {"numpy", "rich"}),
        ("--version", {"numpy", "rich"}),
        ("new", {"numpy", "pydantic", "rich"}),
    ],
)
def test_what_a_command_loads(word: str, loaded: set[str], tmp_path: Path) -> None:
    code = f"""
import sys, planner_start
sys.argv = ["planner", {word!r}]
planner_start.main()
print(*(name for name in {HEAVY} if name in sys.modules))
"""
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert set(done.stdout.splitlines()[-1].split()) == loaded


def test_import_planner_loads_nothing_else() -> None:
    names = ("planner", *HEAVY)
    code = f"import sys, planner; print(*(n for n in sys.modules if n.startswith({names})))"
    words = [sys.executable, "-c", code]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout == "planner\n"


def test_what_processes_of_a_sweep_start_without() -> None:
    code = """
import sys, planner.sweep.pools
heavy = {"scipy.stats", "osqp", "matplotlib", "sqlite3", "pandas", "planner.robustness.trade_off"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
