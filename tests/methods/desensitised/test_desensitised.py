"""Plans made against errors: better than the known optima, within limits, honest refusals."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perturbed import draws, motions

import planner
from planner.methods.collocation.long_arms.exact_motion import has_only_limits
from planner.methods.collocation.pipeline import collocation_task
from planner.methods.desensitised.method import desensitised_task
from planner.plan.measures import turns
from planner.support.deadline import time_up

PROBLEMS = Path(__file__).parents[3] / "problems"


@pytest.fixture(scope="module")
def example(paper: planner.Problem) -> planner.Problem:
    """The paper's example with the limit that the known optima have."""
    return paper.changed({"limits.input_rad_s": [0.6, 0.6]})


@pytest.fixture(scope="module")
def reversing(example: planner.Problem) -> planner.Plan:
    return planner.solve(example, "desensitised", reversal=True, intervals=24)


@pytest.fixture(scope="module")
def one_way(example: planner.Problem) -> planner.Plan:
    return planner.solve(example, "desensitised", starts=2, intervals=20)


def test_reversing_plan_beats_the_known_optimum(reversing: planner.Plan) -> None:
    found = planner.sensitivity(reversing)
    assert reversing.verified
    assert found.passive_block_deg() < 0.04  # known: 0.066
    assert found.total_deg() < 1.05 * found.floor_deg()
    assert np.min(reversing.u(np.linspace(0, 10, 401))[:, 0]) < -0.1


def test_one_way_plan_beats_the_known_optimum(one_way: planner.Plan) -> None:
    found = planner.sensitivity(one_way)
    assert one_way.verified
    assert found.passive_block_deg() < 0.26  # known: 0.315
    assert found.total_deg() < 1.04
    assert np.min(one_way.u(np.linspace(0, 10, 401))[:, 0]) >= 0


def test_the_winner_is_named_and_is_the_best(reversing: planner.Plan) -> None:
    tried = reversing.notes["tried"]
    assert len(tried) == 4
    best = min((e for e in tried if e["objective"] is not None), key=lambda e: e["objective"])
    winner = next(e for e in tried if e["start"] == reversing.notes["start"])
    assert winner["objective"] == pytest.approx(best["objective"], rel=1e-6)


def test_nonlinear_monte_carlo_agrees(reversing: planner.Plan, paper: planner.Problem) -> None:
    spread = reversing.notes["spread"]
    easy = planner.solve(paper, "collocation")
    for plan in (reversing, easy):
        ends = motions(plan, draws(spread, 500))[:, 0] - plan.q(plan.duration)
        seen = np.rad2deg(np.sqrt(np.sum(np.mean(ends[:, 1:] ** 2, axis=0))))
        assert seen == pytest.approx(planner.sensitivity(plan).total_deg(), rel=0.05)
        few = {k: v for k, v in spread.items() if k in ("start theta1", "gain u2")}
        passive = motions(plan, draws(few, 500))[:, 0] - plan.q(plan.duration)
        seen = np.rad2deg(np.sqrt(np.sum(np.mean(passive[:, 2:] ** 2, axis=0))))
        # what is left of the passive block is of second order in the errors
        assert seen == pytest.approx(
            planner.sensitivity(plan).passive_block_deg(), rel=0.08, abs=0.02
        )


def test_the_effort_limit_bites(paper: planner.Problem, reversing: planner.Plan) -> None:
    assert reversing.effort > 1.0
    plan = planner.solve(paper, "desensitised", starts=1, intervals=20, effort_limit=0.6)
    assert plan.effort == pytest.approx(0.6, abs=1e-6)


def test_under_an_effort_limit_joint_1_may_take_the_other_side(example: planner.Problem) -> None:
    """The drive reads cos theta1; the easy plan's theta1 is positive, the best one's is not."""
    plan = planner.solve(example, "desensitised", effort_limit=0.808)
    assert planner.sensitivity(plan).passive_block_deg() < 0.33  # its neighbours: 0.369, 0.428
    assert np.min(plan.q(np.linspace(0, 10, 201))[:, 1]) < -0.6


def test_an_effort_limit_below_the_least_is_named(paper: planner.Problem) -> None:
    with pytest.raises(planner.NotConvergedError, match="effort reaches") as refusal:
        planner.solve(paper, "desensitised", starts=1, intervals=12, effort_limit=0.2)
    assert not any(" on theta" in violation.label for violation in refusal.value.violations)


def test_time_that_ends_before_the_mesh_is_fine_leaves_no_plan(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(*_: object) -> None:
        raise time_up()

    monkeypatch.setattr("planner.methods.collocation.best.transfer", ended)
    monkeypatch.setattr("planner.methods.desensitised.method.plan_collocation", lambda *_: easy)
    easy = planner.solve(paper, "collocation")
    with pytest.raises(planner.TimeLimitError):
        planner.solve(paper, "desensitised", starts=1, intervals=5, time_limit_s=600)


def test_back_off_keeps_perturbed_motions_inside(paper: planner.Problem) -> None:
    tight = paper.changed({"limits.joint_deg": 36})
    options = {"starts": 1, "intervals": 24, "effort": 0.5, "passive": 0.0, "terminal": 0.01}
    t = np.linspace(0, 10, 81)

    def outside(plan: planner.Plan) -> float:
        q = motions(plan, draws(plan.notes["spread"], 200, seed=3), t)
        return float(np.mean(np.max(np.abs(q[:, :, 1:]), axis=(1, 2)) > np.deg2rad(36)))

    assert outside(planner.solve(tight, "desensitised", **options)) > 0.3
    free = tight.changed({"limits": {k: v for k, v in tight.to_dict()["limits"].items()
                                     if k != "z2_margin"}})  # fmt: skip
    backed = planner.solve(free, "desensitised", **options, backoff=3.0)
    assert outside(backed) < 0.02


def test_no_room_to_back_off_at_the_start(paper: planner.Problem) -> None:
    with pytest.raises(planner.InfeasibleError, match=r"backoff = 3 needs .* on z2") as refusal:
        planner.solve(paper, "desensitised", backoff=3.0)
    assert "backoff = " in str(refusal.value.advice)
    assert "limits.z2_margin" in str(refusal.value.advice)


def test_back_off_is_kept_at_the_goal(paper: planner.Problem) -> None:
    """The goal lies inside its limit, but nearer to it than three standard deviations."""
    changes = {"limits.joint_deg": 31.0, "start.theta_deg": [10, 20, 10]}
    tight = planner.Problem.from_dict(planner.problem.conditions.with_changes(
        {k: v for k, v in paper.to_dict().items() if k != "limits"}, changes))  # fmt: skip
    assert planner.solve(tight, "desensitised", starts=1, intervals=12).verified
    with pytest.raises(planner.NotConvergedError) as refusal:
        planner.solve(tight, "desensitised", starts=1, intervals=12, backoff=3.0)
    labels = [violation.label for violation in refusal.value.violations]
    assert any(label.endswith("with 3 standard deviations of back-off") for label in labels)
    assert "limits.joint_deg" in str(refusal.value.advice)


def test_a_coarse_mesh_is_refined(paper: planner.Problem) -> None:
    plan = planner.solve(paper, "desensitised", starts=1, intervals=5)
    assert plan.verified
    assert plan.notes["intervals"][0] == 5 < plan.notes["intervals"][-1]


def test_no_path_kept_as_it_is_stands_for_the_least_response(paper: planner.Problem) -> None:
    free = {k: v for k, v in paper.to_dict()["limits"].items() if k != "z2_margin"}
    problem = paper.changed({"limits": free})
    assert has_only_limits(collocation_task(problem, planner.METHODS["collocation"].options(), 8))
    options = planner.METHODS["desensitised"].options(intervals=8)
    assert not has_only_limits(desensitised_task(problem, options))


def test_input_rates_rest_and_a_free_duration(paper: planner.Problem) -> None:
    changes = {"limits.input_rate_rad_s2": [2.0, 2.0], "goal.duration": "free"}
    problem = paper.changed({**changes, "start.theta_deg": [10, 20, 10]})
    plan = planner.solve(problem, "desensitised", starts=1, intervals=24, rest=True)
    assert plan.verified
    np.testing.assert_allclose(plan.u(np.array([0.0, plan.duration])), 0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "intervals"),
    [
        pytest.param("crossing", 16, marks=pytest.mark.campaign),
        pytest.param("parking", 24, marks=pytest.mark.campaign),
        pytest.param("four-joint", 16, marks=pytest.mark.campaign),
        ("ball-gear", 16),
    ],
)
def test_other_problems(name: str, intervals: int) -> None:
    problem = planner.load_problem(PROBLEMS / f"{name}.toml")
    plan = planner.solve(problem, "desensitised", starts=1, intervals=intervals)
    easy = planner.solve(problem, "collocation")
    assert plan.verified
    assert planner.sensitivity(plan).total_deg() <= planner.sensitivity(easy).total_deg() + 1e-6


def test_obstacles_are_cleared() -> None:
    problem = planner.load_problem(PROBLEMS / "obstacle.toml")
    free = problem.changed({"obstacles": []})
    options = {"starts": 1, "intervals": 14}
    disc = problem.obstacles[0]

    def room(plan: planner.Plan) -> float:
        q = plan.q(np.linspace(0, plan.duration, 2001))
        return float(np.min(disc.clearances(problem.system.arm_points(q[:, 1:]))))  # type: ignore[attr-defined]

    assert room(planner.solve(free, "desensitised", **options)) < -0.05  # type: ignore[arg-type]
    assert room(planner.solve(problem, "desensitised", **options)) >= -1e-6  # type: ignore[arg-type]


def test_waypoints_are_refused_with_the_way_out() -> None:
    problem = planner.load_problem(PROBLEMS / "waypoint.toml")
    with pytest.raises(planner.NoPlanError, match="does not plan for distance from waypoint 1"):
        planner.solve(problem, "desensitised")


@pytest.mark.parametrize("input", ["constant", pytest.param("linear", marks=pytest.mark.campaign)])
def test_the_drive_turns_back_only_where_the_plan_of_least_effort_does(input: str) -> None:
    problem = planner.load_problem(PROBLEMS / "crossing.toml")
    easy = planner.solve(problem, "collocation")
    options = {"starts": 1, "intervals": 24, "input": input}
    free = planner.solve(problem, "desensitised", reversal=True, **options)  # type: ignore[arg-type]
    plan = planner.solve(problem, "desensitised", **options)  # type: ignore[arg-type]
    found = [len(turns(each.trajectory)) for each in (easy, plan, free)]
    assert found == [1, 1, 3]
    passive = [planner.sensitivity(each).passive_block_deg() for each in (easy, plan, free)]
    assert passive[0] > 1.5 * passive[1] > 3 * passive[2]


def test_on_the_machine_no_worse_than_least_effort_and_compensated_as_well(
    one_way: planner.Plan,
) -> None:
    """Free to turn back it was the worst plan there is on the prototype: 9.8 degrees."""
    easy = planner.solve(one_way.problem, "collocation")
    machine = planner.Machine.prototype(step_s=0.005)
    for compensated, most in ((False, 7.5), (True, 3.1)):
        plans = [planner.compensate(p, machine) if compensated else p for p in (easy, one_way)]
        ends = [planner.replay(plan, machine, samples=300, seed=3) for plan in plans]
        least, ours = (float(np.percentile(run.terminal_E_deg, 95)) for run in ends)
        assert ours < least + 0.1 < most


def test_a_plan_next_to_one_known_comes_from_it(one_way: planner.Plan) -> None:
    near = one_way.problem.changed({"goal.theta_deg": [30.5, 30, 30]})
    plan = planner.solve(near, "desensitised", starts=2, intervals=20, warm=one_way)
    assert [entry["start"] for entry in plan.notes["tried"]] == ["the plan given"]
    other = planner.solve(planner.load_problem(PROBLEMS / "four-joint.toml"))
    with pytest.raises(planner.InputError, match="warm is a plan of another system"):
        planner.solve(near, "desensitised", warm=other)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"start_deg": [0.5, 0.5]}, "start_deg has 2 values; give one number, or 3"),
        ({"start_deg": 0.0, "gain": 0.0}, "all standard deviations are zero"),
        ({"rest": True, "input": "constant"}, "contradicts rest = true"),
    ],
)
def test_options_that_do_not_fit(
    paper: planner.Problem, options: dict[str, Any], says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.solve(paper, "desensitised", **options)
