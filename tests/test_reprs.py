"""What a notebook prints: one or a few lines a value, and tables where there are rows."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from typing import Any

import numpy as np
import pytest

import planner
from planner import TradeOff
from planner.plan.samples import sample
from planner.problem.tables.method_options import DesensitisedOptions

LONGEST = 500
"""Characters that are still read, not scrolled past."""


@pytest.fixture(scope="module")
def plan() -> planner.Plan:
    return planner.solve(planner.load_problem("problems/paper.toml"), "collocation")


@pytest.fixture(scope="module")
def comparison(plan: planner.Plan) -> planner.Comparison:
    return planner.compare(plan.problem, ["polynomial", "collocation"], samples=2)


def values(plan: planner.Plan) -> list[Any]:
    problem, machine = plan.problem, planner.Machine.prototype()
    return [
        problem,
        problem.system,
        plan,
        plan.trajectory,
        plan.certificate,
        plan.domain,
        planner.verify(plan),
        planner.replay(plan, machine, samples=2),
        machine,
        planner.chained_form(problem.system),
        planner.sensitivity(plan),
        planner.machine_sensitivity(plan, machine),
        planner.check(problem, ["polynomial"]),
        planner.travel_window(problem),
        sample(plan),
        TradeOff(problem, "effort", (), DesensitisedOptions(), machine, None),
    ]


def test_no_value_prints_its_arrays(plan: planner.Plan, comparison: planner.Comparison) -> None:
    for value in [*values(plan), comparison, comparison.rows[0]]:
        text = repr(value)
        assert len(text) < LONGEST, f"{type(value).__name__}: {len(text)} characters"
        assert type(value).__name__ in text
        assert " object at 0x" not in text
        assert "array(" not in text


@pytest.mark.parametrize("name", ["unicycle", "trailers", "custom", "ball-gear"])
def test_every_system_prints(name: str) -> None:
    plan = planner.solve(planner.load_problem(f"problems/{name}.toml"), "polynomial")
    for value in (plan.problem.system, plan.trajectory, planner.sensitivity(plan)):
        assert len(repr(value)) < LONGEST


def test_the_comparison_says_who_solved_and_who_did_not(comparison: planner.Comparison) -> None:
    refused, solved = repr(comparison).splitlines()[1:]
    assert "polynomial: refused, input u2 reaches 0.582 rad/s, allowed 0.5, E " in refused
    assert "collocation: solved, E " in solved
    assert "interrupted" not in repr(comparison)
    assert "interrupted" in repr(replace(comparison, complete=False))


def test_what_has_few_figures_prints_them_in_one_line(plan: planner.Plan) -> None:
    problem = plan.problem
    window = planner.travel_window(problem)
    margin = f"{plan.domain.margin:.3g}"
    for value, words in (
        (window, f"{window.low:.4g} to {window.high:.4g} rad: each of these is possible"),
        (planner.sensitivity(plan), f"{planner.sensitivity(plan).floor_deg():.4g}"),
        (plan.domain, f"inside the chart: least margin {margin} "),
    ):
        assert words in repr(value)
        assert "\n" not in repr(value)
    back = planner.travel_window(problem.changed({"goal.theta_deg": [30, 30, -30]}))
    assert repr(back).startswith("TravelWindow(empty: the passive joints must move in opposite")
    four = planner.travel_window(planner.load_problem("problems/four-joint.toml"))
    assert "rad: no other is possible while the disk turns one way" in repr(four)
    with pytest.raises(planner.SingularError) as refusal:
        planner.solve(problem.changed({"goal.travel": 2.0}), "polynomial")
    assert "DomainReport(leaves the chart " in repr(refusal.value.plan.domain)


def cells(shown: str) -> list[list[str]]:
    """Of the rows of a table."""
    rows = re.findall(r"<tr[^>]*>(.*?)</tr>", shown, flags=re.S)
    return [[unescape(c) for c in re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row)] for row in rows]


def test_a_comparison_is_a_table(comparison: planner.Comparison) -> None:
    head, *rows = cells(comparison._repr_html_())
    assert head[:3] == ["method", "solved", "travel (rad)"]
    assert [row[0] for row in rows] == ["collocation", "polynomial"]
    column = head.index("E 50 % (deg)")
    assert float(rows[0][column]) == pytest.approx(comparison.rows[1].E_median_deg, rel=0.01)


def test_a_check_is_a_table_that_names_what_is_broken(comparison: planner.Comparison) -> None:
    broken = planner.verify(comparison.rows[0].plan)
    rows = {row[0]: row for row in cells(broken._repr_html_())}
    assert rows["input u2"][1].startswith("input u2 reaches 0.58")
    assert float(rows["input u2"][2]) == pytest.approx(broken.margins["input u2"], rel=1e-3)
    assert rows["input u1"][1] == "kept"


def test_a_certificate_is_a_table(plan: planner.Plan) -> None:
    rows = cells(plan.certificate._repr_html_())
    assert len(rows) == 1 + len(plan.certificate.claims)
    assert all(np.isfinite(float(row[2].split()[0])) for row in rows[1:])
