"""The closed loop on the emulated machine: what it gains, what it keeps, what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import InputError, Machine, Plan, Replay, Tracker, replay
from planner.machine.feedback.tracker import TrackerControl

PROBLEMS = Path(__file__).parents[3] / "problems"
SAMPLES = 40


class Watched(Tracker):
    """A tracker that remembers its commands, and may lose or falsify readings."""

    def __init__(
        self, tamper: Callable[[int, np.ndarray], np.ndarray] | None = None, **options: Any
    ) -> None:
        super().__init__(**options)
        self.tamper = tamper
        self.commands: list[np.ndarray] = []

    def start(self, plan: Plan, machine: Machine, numbers: np.ndarray) -> TrackerControl:
        control = super().start(plan, machine, numbers)
        watched = self

        class Spy(TrackerControl):
            def __call__(self, t: float, measured: np.ndarray) -> np.ndarray:
                k = len(watched.commands)
                read = measured if watched.tamper is None else watched.tamper(k, measured)
                watched.commands.append(super().__call__(t, read))
                return watched.commands[-1]

        control.__class__ = Spy
        return control


@pytest.fixture(scope="module")
def opened(smooth: Plan, machine: Machine) -> Replay:
    return replay(smooth, machine, SAMPLES, seed=3, record_s=None)


@pytest.fixture(scope="module")
def closed(smooth: Plan, machine: Machine) -> Replay:
    return replay(smooth, machine, SAMPLES, seed=3, feedback=True, record_s=0.05)


def test_it_follows_the_path_twenty_times_closer(closed: Replay, opened: Replay) -> None:
    assert closed.percentile(95) < opened.percentile(95) / 20
    assert closed.fallbacks.sum() == 0
    assert np.percentile(closed.terminal_E_deg, 95) < 0.16  # 0.146: contacts slide differently
    assert np.percentile(opened.terminal_E_deg, 95) > 2.0
    z2 = planner.chained_form(closed.plan.problem.system).z(closed.q[:, closed.t >= 0])[..., 1]
    assert z2.max() < -0.025  # the plan itself comes no closer to zero than 0.0324


def test_noise_of_encoders_costs_little(paper: planner.Problem) -> None:
    """E was 7 degrees: one reading in seven of a resting joint was taken for a push."""
    back = {"start.theta_deg": [30, 30, 30], "goal.theta_deg": [1, 1, 1]}
    plan = planner.solve(paper.changed(back), "collocation", intervals=20)
    machine = Machine.prototype(step_s=0.005)
    assert machine.mean("encoder_noise_deg") == 0.03
    noisy = replay(plan, machine, 12, seed=0, feedback=True, record_s=None)
    exact = machine.with_(encoder_noise_deg=False)
    usual = replay(plan, exact, 12, seed=0, feedback=True, record_s=None)
    assert noisy.percentile(95) < usual.percentile(95) + 0.3 < 1.0
    assert np.percentile(noisy.terminal_E_deg, 95) < 0.3
    some = replay(plan, machine, [7, 3], seed=0, feedback=True, record_s=None)
    assert np.array_equal(some.terminal_error, noisy.terminal_error[[7, 3]])  # the same noise


def test_the_prototype_as_it_is(paper: planner.Problem) -> None:
    """Its own encoders of 0.088 degrees, and the optimal plan, which is slow at its start."""
    plan, machine = planner.solve(paper, "collocation"), Machine.prototype(step_s=0.01)
    closed = replay(plan, machine, SAMPLES, seed=0, feedback=True, record_s=None)
    opened = replay(plan, machine, SAMPLES, seed=0, record_s=None)
    assert closed.percentile(95) < opened.percentile(95) / 20
    assert np.percentile(closed.terminal_E_deg, 95) < 0.18  # twice the encoders' step


def test_corrections_do_not_keep_up_the_swings_of_heavy_links(paper: planner.Problem) -> None:
    """E was 2.8 and the end 0.9 degrees when corrections answered each swing at once."""
    plan = planner.solve(paper, "collocation")
    swinging = Machine.prototype(fidelity="dynamic", step_s=0.002)
    closed = replay(plan, swinging, 12, seed=0, feedback=True, record_s=None)
    assert closed.percentile(95) < 1.2
    assert np.percentile(closed.terminal_E_deg, 95) < 0.4


def test_the_model_of_a_turn_is_that_of_the_play(parked: Plan, machine: Machine) -> None:
    """At a turn of the drive a joint is pushed to 2w elsewhere, and by 2δw more where more is
    lost; what a machine loses beyond the push that follows changes nothing."""
    ref = Tracker().design(parked, machine).ref
    turns = np.flatnonzero(np.any(np.diff(ref.way, axis=0) != 0, axis=1))
    assert len(turns) >= 3
    for k in turns:
        change = ref.way[k + 1] - ref.way[k]
        assert ref.E[k, [2, 3], [2, 3]] == pytest.approx(-change)
        jump = ref.q[k + 1, 2:] - ref.q[k, 2:]
        assert jump == pytest.approx(-change * ref.lost_motion[:, 0], abs=np.deg2rad(2.5))
    pushing = np.abs(ref.q[:, 2:] - ref.joints) < 1e-9
    assert 0.4 < pushing.mean() < 0.95
    assert np.all(ref.push[~pushing] > -2 * ref.lost_motion.max())


def test_a_compensated_plan_is_followed_along_the_path_it_compensates(
    smooth: Plan, machine: Machine, closed: Replay
) -> None:
    better = planner.compensate(smooth, machine)
    again = replay(better, machine, 20, seed=3, feedback=True, record_s=None)
    for name in ("index_E_deg", "terminal_E_deg"):
        here, there = (np.median(getattr(run, name)[:20]) for run in (again, closed))
        assert here == pytest.approx(there, abs=0.02), name


def test_the_weights_trade_the_way_for_the_end(
    smooth: Plan, machine: Machine, closed: Replay
) -> None:
    tracker = Tracker(path_error_deg=0.3, goal_error_deg=0.01)
    other = replay(smooth, machine, SAMPLES, seed=3, feedback=tracker, record_s=None)
    assert np.median(other.terminal_E_deg) < np.median(closed.terminal_E_deg)
    assert other.percentile(50) > closed.percentile(50)


def test_a_run_is_the_same_again_and_a_sample_whichever_others_run_with_it(
    smooth: Plan, machine: Machine
) -> None:
    """Machines beyond what the commands' limits allow, so that OSQP is asked often."""
    tracker = Tracker(path_error_deg=1.0, run_up=False)
    closed = replay(smooth, machine, SAMPLES, seed=3, feedback=tracker, record_s=None)
    assert tracker.design(smooth, machine).programme.solve_count > 300
    assert np.median(closed.terminal_E_deg) < 0.1  # without a run-up the end is as good,
    assert closed.percentile(50) > 1.5  # but not the way
    some = np.argsort(closed.index_E_deg)[-5:]
    again = replay(smooth, machine, some.tolist(), seed=3, feedback=tracker, record_s=None)
    assert np.array_equal(again.q, closed.q[some])


def test_commands_keep_the_limits_of_speed_and_its_change(
    paper: planner.Problem, machine: Machine
) -> None:
    limits = {"input_rad_s": [0.25, 0.25], "input_rate_rad_s2": [2.0, 2.0]}
    plan = planner.solve(paper.changed({"limits": limits}), "collocation", intervals=20)
    tracker = Watched(run_up=False, path_error_deg=0.5)
    closed = replay(plan, machine, 6, seed=3, feedback=tracker, record_s=None)
    u = np.concatenate(tracker.commands)
    assert np.max(np.abs(u)) <= 0.25 + 1e-9
    assert np.max(np.abs(u[:, 0])) > 0.249  # the drive's limit is used to take up the play
    rise = np.abs(np.diff(u[:997], axis=0)) / 0.01  # until the plan's end is commanded, in 10 s
    assert 1.9 < np.max(rise) <= 2.0 + 1e-9
    assert np.median(closed.terminal_E_deg) < 1.0


def test_lost_readings_cost_little(smooth: Plan, machine: Machine) -> None:
    rng = np.random.default_rng(5)

    def lose(k: int, measured: np.ndarray) -> np.ndarray:
        lost = rng.random(measured.shape[1]) < 0.05
        return np.where(lost, np.nan, measured)

    tracker = Watched(lose)
    closed = replay(smooth, machine, 6, seed=3, feedback=tracker, record_s=None)
    assert np.percentile(closed.terminal_E_deg, 95) < 0.3


def test_a_vehicle_needs_no_run_up(machine: Machine) -> None:
    problem = planner.load_problem(PROBLEMS / "unicycle.toml")
    plan = planner.solve(problem, "polynomial")
    opened = replay(plan, machine, 6, record_s=None)
    tracker = Watched()
    closed = replay(plan, machine, 6, feedback=tracker, record_s=None)
    assert len(tracker.commands) < 60
    assert np.max(np.abs(closed.terminal_error)) < np.max(np.abs(opened.terminal_error)) / 4


def test_a_long_latency_is_predicted_through(smooth: Plan, machine: Machine) -> None:
    slow = machine.with_(delay_s=0.15)
    tracker = Tracker(latency_s=0.1, run_up=False)
    closed = replay(smooth, slow, 6, seed=3, feedback=tracker, settle_s=1.0, record_s=None)
    opened = replay(smooth, slow, 6, seed=3, settle_s=1.0, record_s=None)
    assert np.median(closed.terminal_E_deg) < np.median(opened.terminal_E_deg) / 10


@pytest.mark.parametrize(
    "clock",
    [
        {"period_s": 0.25, "horizon_s": 0.5},
        pytest.param({"period_s": 0.033, "latency_s": 0}, marks=pytest.mark.campaign),
        {"period_s": 1.0, "latency_s": 1.0},
    ],
    ids=str,
)
def test_other_clocks_work_too(smooth: Plan, machine: Machine, clock: dict[str, Any]) -> None:
    tracker = Tracker(run_up=False, **clock)
    closed = replay(smooth, machine, 3, seed=3, feedback=tracker, record_s=None)
    assert np.median(closed.terminal_E_deg) < 2.0  # 5 in open loop
    assert closed.fallbacks.sum() == 0


@pytest.mark.parametrize(
    ("option", "value"),
    [("period_s", 0.0), ("path_error_deg", 0.0), ("run_up", 3), ("goal_error_deg", -1.0)],
)
def test_bad_options(option: str, value: float) -> None:
    with pytest.raises(InputError, match=f"^[^\n]*{option}[^\n]*$"):
        Tracker(**{option: value})
    with pytest.raises(InputError, match="horizon_s"):
        Tracker(horizont_s=1.0)


def test_a_clock_that_does_not_fit_the_machine_is_refused(smooth: Plan, machine: Machine) -> None:
    with pytest.raises(InputError, match=r"control_period_s = 0\.01"):
        Tracker(period_s=0.005, run_up=False).design(smooth, machine)
    with pytest.raises(InputError, match=r"feedback\.latency_s = 0\.3"):
        Tracker(latency_s=0.3, run_up=False).design(smooth, machine)


def test_a_run_up_of_four_joints_is_refused(machine: Machine) -> None:
    problem = planner.load_problem(PROBLEMS / "four-joint.toml").changed(
        {"limits": {"joint_deg": 80}}
    )
    plan = planner.solve(problem, "collocation", intervals=20)
    with pytest.raises(InputError, match="two or three joints"):
        Tracker(run_up=True).design(plan, machine)


def test_the_problem_file_holds_the_options(paper: planner.Problem) -> None:
    table = {"goal_error_deg": 0.05, "run_up": False, "horizon_s": 0.5}
    problem = paper.changed({"feedback": table})
    assert problem.feedback.goal_error_deg == 0.05
    assert problem.to_dict()["feedback"] == table
    with pytest.raises(InputError, match=r"feedback\.horizon_s"):
        paper.changed({"feedback.horizon_s": -1.0})
