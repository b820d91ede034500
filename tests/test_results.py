"""Results alike: each can be shown as a table, as data and as a figure, saved and read back."""

from __future__ import annotations

import json
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from test_frozen import made, public_classes

import planner

RESULTS = (
    "Budget", "Comparison", "DesignStudy", "Identification", "MachineSensitivity", "Plan",
    "Replay", "Sensitivities", "Sensitivity", "Sweep", "TradeOff",
)  # fmt: skip
MEANS = ("table", "to_dict", "plot", "save")

WITHOUT = {
    ("Sweep", "table"): "it says what to run; `load_sweep` returns the table of what has run",
    ("Sweep", "plot"): "as for its table",
    ("Sweep", "save"): "it is read from the user's own file",
    (
        "Replay",
        "save",
    ): "its plan, machine and seed repeat it; `to_frame`, `to_xarray` export",
    ("MachineSensitivity", "save"): "it is part of a sensitivity's folder, and a plan repeats it",
    ("TradeOff", "save"): "`trade_off` saves each point in its folder as soon as it is found",
}
"""What a result lacks, and why."""


def budget_of(found: Any) -> Any:
    """A budget, or the only one of a folder, with everything that it holds."""
    budget = found if isinstance(found, planner.Budget) else found["collocation"]
    return budget.plan, budget.to_dict(), repr(budget.costs)


LOADERS: dict[str, tuple[Callable[[Path], Any], Callable[[Any], Any]]] = {
    "Budget": (planner.report.load_budgets, budget_of),
    "Comparison": (planner.report.load_comparison, attrgetter("plans", "headline", "seed")),
    "Plan": (planner.load_plan, planner.Plan.to_dict),
}
"""What reads a result back, and what of it is equal then."""

WITHOUT_LOADER = {
    "DesignStudy": "`design_study` with the same folder reads the finished cases",
    "Identification": "its machine is what is kept: `load_machine` reads it",
    "MachineSensitivity": "not saved",
    "Replay": "not saved",
    "Sensitivities": "computed from the saved plans in milliseconds",
    "Sensitivity": "computed from the saved plan in milliseconds",
    "Sweep": "`Sweep.load` reads the user's file, `load_sweep` the results",
    "TradeOff": "`trade_off` with the same folder reads the finished points",
}

PAIRS = [(name, means) for name in RESULTS for means in MEANS if (name, means) not in WITHOUT]


def test_every_result_is_here_and_no_excuse_is_idle() -> None:
    shown = {"table", "plot"}
    assert {n for n in public_classes() if shown <= set(dir(getattr(planner, n)))} <= set(RESULTS)
    assert [pair for pair in WITHOUT if hasattr(getattr(planner, pair[0]), pair[1])] == []
    assert sorted([*LOADERS, *WITHOUT_LOADER]) == sorted(RESULTS)


@pytest.mark.parametrize(("name", "means"), PAIRS)
def test_results_have_the_same_means(name: str, means: str, tmp_path: Path) -> None:
    call = getattr(made(name), means)
    if means == "save":
        path = tmp_path / ("kept.toml" if name == "Identification" else "kept")
        assert call(path) == path
        assert path.exists()
        if name in LOADERS:
            load, what = LOADERS[name]
            assert what(load(path)) == what(made(name))
        return
    result = call()
    if means == "to_dict":
        assert json.loads(json.dumps(result, allow_nan=False)) == result
    elif means == "plot":
        assert isinstance(result, Figure)
        assert result.axes
    else:
        assert isinstance(result, Table)
        console = Console(width=100)
        with console.capture() as capture:
            console.print(result)
        assert max(map(len, capture.get().splitlines())) <= 100
        assert len(capture.get().split()) > 5


@pytest.mark.parametrize("name", ["Plan", "Comparison"])
def test_any_figure_is_drawn_by_name(name: str) -> None:
    assert len(made(name).plot("inputs").axes) == 2
    joints = made(name).problem.system.size - 1
    assert len(made(name).plot("joints").axes) == joints
    with pytest.raises(planner.InputError, match="no figure 'jonts'; did you mean 'joints'"):
        made(name).plot("jonts")


def test_the_tables_of_commands_are_those_of_results() -> None:
    table = made("Plan").table()
    assert {"status", "effort", "certificate"} <= set(table_cells(table, 0))
    found = made("Sensitivity")
    loud = table_cells(found.table(), 0)
    assert set(loud) <= set(found.parameters)
    assert len(loud) > 3


def table_cells(table: Table, column: int) -> list[str]:
    return [str(cell) for cell in table.columns[column].cells]
