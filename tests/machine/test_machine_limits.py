"""What machines break of the limits that the plan keeps."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import planner
from planner import Plan
from planner.comparison.comparison import comparison_csv
from planner.report.page.words import verdict_html
from planner.verification.verify import LIMIT_TOLERANCE

ROOT = Path(__file__).parents[2]
MACHINES = 60
GAP_M = 2e-6


@pytest.fixture(scope="module")
def plan() -> Plan:
    changes = {"machine.step_s": 0.01, "limits.input_rad_s": 0.6}
    return planner.solve(planner.load_problem(ROOT / "problems/paper.toml", changes), "polynomial")


def beside(plan: Plan, t: float) -> Plan:
    """The same motion with a post that the tip passes at t with next to no distance."""
    points = plan.problem.system.arm_points(plan.q(np.linspace(0, 10, 4001))[:, 1:])
    tip = plan.problem.system.arm_points(plan.q(t)[1:])[-1]
    centre = tip + 0.5 * tip / np.linalg.norm(tip)
    nearest = np.min([distance(points[:, k], points[:, k + 1], centre).min() for k in range(3)])
    disc = {"centre_m": centre.tolist(), "radius_m": float(nearest - GAP_M)}
    return replace(plan, problem=plan.problem.changed({"obstacles": [disc]}))


def distance(start: np.ndarray, end: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Of links (R, 2) from a place, by many points on each."""
    share = np.linspace(0, 1, 401)[:, None, None]
    return np.linalg.norm(start + share * (end - start) - place, axis=-1).min(axis=0)


def test_a_plan_that_grazes_a_post_is_verified_and_every_machine_hits_it(plan: Plan) -> None:
    grazing = beside(plan, 5.0)
    assert planner.verify(grazing).ok
    run = planner.replay(grazing, samples=MACHINES, seed=2)
    assert run.limit_share == 1
    assert run.limit_words.startswith(f"{MACHINES} of {MACHINES} machines break a limit: clearance")
    (worst,) = [each for each in run.limits if each.broken == MACHINES]
    (disc,) = grazing.problem.obstacles
    points = grazing.problem.system.arm_points(run.q[..., 1:])
    link = int(worst.part.label.split()[3])
    free = np.array(
        [distance(p[:, link - 1], p[:, link], disc.centre) - disc.radius for p in points]
    )
    assert worst.worst == pytest.approx(free.min(), abs=1e-4)
    sample, at = np.unravel_index(np.argmin(free), free.shape)
    assert worst.sample == run.numbers[sample]
    assert worst.t_s == pytest.approx(run.t[at], abs=0.05)
    assert worst.sweep == pytest.approx(np.percentile(GAP_M - free.min(axis=1), 95), abs=1e-4)
    assert f"clearance_m = {np.ceil(1000 * worst.sweep) / 1000:g} of obstacle 1" in run.limit_words
    assert run.limit_words in repr(run)
    assert run.to_dict()["limit_share"] == 1


def test_a_clearance_is_there_to_stray_in(plan: Plan) -> None:
    """The plan keeps it; a machine breaks nothing until it touches."""
    grazing = beside(plan, 5.0)
    sweep = max(each.sweep for each in planner.replay(grazing, samples=MACHINES, seed=2).limits)
    (disc,) = grazing.problem.to_dict()["obstacles"]
    smaller = {**disc, "radius_m": disc["radius_m"] - sweep, "clearance_m": sweep}
    kept = replace(plan, problem=plan.problem.changed({"obstacles": [smaller]}))
    assert planner.verify(kept).ok
    claim = next(c for c in planner.certify(kept).claims if "link 3 from obstacle" in c.label)
    assert claim.status == "proven"
    assert 0 < claim.guaranteed <= claim.attained < 2 * GAP_M
    run = planner.replay(kept, samples=MACHINES, seed=2)
    assert 0 < run.limit_share <= 0.05 + 1e-9
    forgiven = 3 * LIMIT_TOLERANCE  # what `verify` forgives this arm, whose links are 3 m long
    wider = {**smaller, "clearance_m": sweep + GAP_M + 2 * forgiven}
    broken = planner.verify(replace(plan, problem=plan.problem.changed({"obstacles": [wider]})))
    (violation,) = broken.violations
    assert violation.label == "clearance of link 3 from obstacle 1"
    assert violation.limit == pytest.approx(sweep + GAP_M + 2 * forgiven)
    assert violation.value == pytest.approx(sweep + GAP_M, abs=2e-7)


@pytest.mark.campaign
def test_every_machine_hits_the_shipped_post_and_few_with_the_clearance_told() -> None:
    """As docs/howto/compare.md says of problems/obstacle.toml."""
    grazing = planner.load_problem(ROOT / "problems/obstacle.toml")
    (disc,) = grazing.to_dict()["obstacles"]
    wider = grazing.changed({"obstacles": [{**disc, "clearance_m": 0.15}]})
    shares = [planner.replay(planner.solve(p), samples=300).limit_share for p in (grazing, wider)]
    assert shares == pytest.approx([1, 1 / 30], abs=1 / 60)


def test_joint_limits_are_judged_and_without_records_nothing_is(plan: Plan) -> None:
    most = np.rad2deg(np.abs(plan.q(np.linspace(0, 10, 4001))[:, 1:]).max(axis=0)) + 1e-6
    tight = replace(plan, problem=plan.problem.changed({"limits.joint_deg": most.tolist()}))
    run = planner.replay(tight, samples=MACHINES, seed=2)
    reached = np.rad2deg(np.abs(run.q[..., 1:]).max(axis=1))
    for k, each in enumerate(each for each in run.limits if each.requirement.physical):
        assert each.part.label == f"joint theta{k + 1}"
        assert each.broken == np.sum(reached[:, k] > most[k])
        assert np.rad2deg(each.worst) == pytest.approx(reached[:, k].max())
    assert run.physical_share == np.mean(np.any(reached > most, axis=1)) > 0
    assert "limits.joint_deg = " in run.limit_words
    some = planner.replay(tight, samples=MACHINES, seed=2, motions=3)
    np.testing.assert_array_equal(some.margin, run.margin)  # of all, kept or not
    bare = planner.replay(tight, samples=3, seed=2, record_s=None)
    assert bare.limits == ()
    assert bare.limit_words == ""
    assert np.isnan(bare.limit_share)


def test_a_comparison_says_it_in_table_file_and_page(plan: Plan) -> None:
    problem = beside(plan, 5.0).problem
    result = planner.compare(problem, ["polynomial"], samples=10, seed=2)
    (row,) = result.rows
    assert row.beyond_limits == row.beyond_physical == 100
    assert result.recommended is None
    assert result.headline.startswith("No plan is recommended. ")
    assert row.remark == "100 % of machines break a limit"
    assert result.headline.endswith(f" On 100 % of the machines {row.label} breaks a limit.")
    assert "1 of 1" not in verdict_html(result)
    assert "yes: 100 % of machines break a limit" in result.markdown()
    assert row.replay is not None
    assert f"polynomial: {row.replay.limit_words}." in result.markdown()
    (line,) = csv.DictReader(io.StringIO(comparison_csv(result)))
    assert float(line["beyond_limits"]) == 100
    assert result.to_dict()["rows"][0]["replay"]["limits"] == row.replay.limit_words


def test_z2_is_judged_like_all_limits_and_reported_apart(plan: Plan) -> None:
    """The run-up of feedback crosses z2 = 0, and the swing of compensation does not."""
    problem = plan.problem
    optimal = planner.compensate(planner.solve(problem, "collocation"))
    run = planner.replay(optimal, samples=20, seed=2, feedback=True)
    z2 = planner.chained_form(problem.system).z(run.q)[..., 1] * problem.z2_sign
    (found,) = [each for each in run.limits if not each.requirement.physical]
    assert found.worst == pytest.approx(z2.min())
    assert found.worst < 0
    assert found.broken == np.sum(z2.min(axis=1) < 0.01) == 20
    assert (run.limit_share, run.physical_share) == (1, 0)
    assert run.limit_words.startswith("20 of 20 machines break a limit of chained coordinates")
    assert {key: run.to_dict()[key] for key in ("limit_share", "physical_share")} == {
        "limit_share": 1, "physical_share": 0
    }  # fmt: skip
    every = planner.compare(problem, ["collocation compensated"], samples=20, seed=2, feedback=True)
    plain, fed = every.rows
    assert every.recommended is plain
    assert (fed.beyond_limits, fed.beyond_physical) == (100, 0)
    assert fed.remark == "100 % of machines break a limit, 0 % a physical one"
    assert f" On 100 % of the machines {fed.label} breaks a limit, on 0 % a physical one" in (
        every.headline
    )
    kept = {key: every.to_dict()["rows"][1][key] for key in ("beyond_limits", "beyond_physical")}
    assert kept == {"beyond_limits": 100, "beyond_physical": 0}
    assert "| beyond limits (%) | beyond physical limits (%) |" in every.markdown()
    assert fed.remark in every._repr_html_()


def test_at_z2_zero_the_machine_is_regular_and_only_the_chart_is_not(plan: Plan) -> None:
    """Both inputs move it there, at finite rates; a change of z2 would need an infinite u2."""
    system = plan.problem.system
    q, form = np.array([0.0, 0.5, 0.0, 0.3]), planner.chained_form(system)
    assert form.z(q)[1] == 0
    rates = np.array([system.rates(q, u) for u in np.eye(2)])
    assert np.all(np.isfinite(rates))
    assert np.linalg.matrix_rank(rates) == 2
    assert rates[0, [0, 2, 3]].min() > 0.1
    assert not np.isfinite(form.u(q, np.array([1.0, 1.0]))[1])
