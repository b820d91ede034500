"""A recorded run beside its plan and its prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import InputError, Log, Machine, Problem, emulate_log, identify, solve
from planner.machine.identification.identify import predict_run
from planner.report import plot_joints, plot_run
from planner.report.figures.style import REFUSED_SUFFIX


def test_a_run_is_drawn_from_its_first_command(paper: Problem) -> None:
    """Though the recording began before it."""
    plan = solve(paper, "collocation")
    arm = Machine.prototype().nominal()
    log = emulate_log(plan, arm)
    early = 137
    late = Log(
        0.01 * np.arange(len(log.t) + early),
        np.concatenate([np.zeros((early, 2)), log.u]),
        np.concatenate([np.repeat(log.theta[:1], early, axis=0), log.theta]),
    )
    prediction = predict_run(late, paper, arm)
    figure, axes = plot_run(late, plan, prediction)
    assert axes.shape == (2, 3)
    recorded, planned, predicted = axes[0, 1].lines
    np.testing.assert_allclose(recorded.get_xdata(), late.t - 0.01 * early, atol=1e-9)
    np.testing.assert_allclose(planned.get_ydata()[early + 500], np.rad2deg(plan.q(5.0)[2]))
    np.testing.assert_allclose(predicted.get_ydata(), prediction.theta_deg[:, 1])
    from_plan, its_mean, from_prediction, _ = axes[1, 1].lines
    read = from_plan.get_ydata()
    assert its_mean.get_ydata()[500] == pytest.approx(np.mean(read[485:516]))
    assert its_mean.get_ydata()[-1] == pytest.approx(np.mean(read[-16:]))
    assert abs(from_plan.get_ydata()[-1]) > 3  # an arm without compensation
    assert np.abs(from_prediction.get_ydata()).max() < 0.3
    assert [text.get_text() for text in figure.legends[0].texts] == [
        "recorded",
        "plan",
        "prediction",
    ]


def test_a_run_is_drawn_like_a_plan_and_is_none_that_was_refused(paper: Problem) -> None:
    plan = solve(paper, "collocation")
    log = emulate_log(plan, Machine.prototype().nominal())
    figure, axes = plot_joints({"plan": plan, "recorded": log.plan(paper)})
    labels = [text.get_text() for text in figure.legends[0].texts]
    assert labels == ["plan", "recorded"]
    assert not any(REFUSED_SUFFIX in label for label in labels)
    np.testing.assert_allclose(axes.flat[2].lines[-1].get_ydata()[-1], log.theta_deg[-1, 2])


def test_an_identification_is_drawn_with_the_run_that_was_kept_out(paper: Problem) -> None:
    plan = solve(paper, "collocation")
    arm = Machine.prototype().nominal()
    runs = [replace(emulate_log(plan, arm, sample=k), source=f"run {k}") for k in (0, 1)]
    found = identify(runs, paper, starts=1)
    figure = found.plot()
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles == ["run 0", "run 1 (kept out of the fit)", ""]
    ticks = [label.get_text() for label in figure.axes[-1].get_xticklabels()]
    assert ticks == [each.parameter.key for each in found.estimates]
    with pytest.raises(InputError, match=r"\bLog\b"):
        plot_run(plan, plan)  # type: ignore[arg-type]
