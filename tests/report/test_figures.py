"""Figures show what they say, without a display and without pyplot."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from compared import ROOT, outside, quick_comparison
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from scipy.interpolate import BPoly

import planner
from planner.plan.trajectory import StateTrajectory
from planner.report import (
    plot_arm,
    plot_efforts,
    plot_errors,
    plot_inputs,
    plot_joints,
    plot_map,
    plot_replays,
    plot_z,
)
from planner.report.figures.on_the_machine import median_sample
from planner.report.figures.over_time import plot
from planner.report.figures.style import COLOURS, curves, symbol
from planner.report.folders import REPLAY_FIGURES, replay_data
from planner.report.page.series import page_data
from planner.report.panels import (
    PLAN_FIGURES,
    Peak,
    PlanePanel,
    PlanFigure,
    Series,
    TimePanel,
    z2_band,
)

MIDDLE, BEST = "polynomial:travel=middle", "polynomial"


@pytest.fixture(scope="module")
def plans() -> dict[str, planner.Plan]:
    found = {row.label: row.plan for row in quick_comparison().rows if row.plan is not None}
    assert set(found) == {MIDDLE, BEST}
    return found


def lines(ax: Any, colour: str) -> list[Any]:
    return [line for line in ax.lines if line.get_color() == colour]


def test_no_figure_touches_pyplot_and_planner_imports_no_matplotlib() -> None:
    code = (
        "import sys, planner, planner.report\n"
        "assert 'matplotlib' not in sys.modules\n"
        f"p = planner.load_problem({str(ROOT / 'problems/paper-fig5.toml')!r})\n"
        "plan = planner.solve(p, 'polynomial', allow_singular=True)\n"
        "planner.report.plot_z(plan)[0].savefig('/dev/null', format='png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=60)


# -- z ---------------------------------------------------------------------------------------------


def test_band_is_the_one_of_the_theory(plans: dict[str, planner.Plan]) -> None:
    plan = plans[BEST]
    t = np.linspace(0, plan.duration, 50)
    low, high = z2_band(plan, t)
    K2, K3 = plan.problem.system.K
    c = np.cbrt(plan.z(t)[:, 2] / K3)
    np.testing.assert_allclose(low, -3 * K2 * K3 * c**2 * np.sqrt(1 - c**2), rtol=1e-12)
    np.testing.assert_allclose(high, 0, atol=1e-15)


def test_z_has_a_column_a_plan_and_the_curves_in_it(plans: dict[str, planner.Plan]) -> None:
    figure, axes = plot_z(plans)
    assert axes.shape == (2, 2)
    assert axes[0, 0].get_ylabel() == "$z_{2}$"
    assert axes[1, 1].get_xlabel() == "time (s)"
    for column, (label, plan) in enumerate(plans.items()):
        (curve,) = lines(axes[0, column], COLOURS[column])
        t, z2 = curve.get_data()
        np.testing.assert_allclose(z2, plan.z(t)[:, 1])
        assert label.split(":")[0] in axes[0, column].get_title()
        assert len(lines(axes[1, column], COLOURS[column])) == 2
        assert any(isinstance(c, PolyCollection) for c in axes[0, column].collections)
    assert figure._repr_png_().startswith(b"\x89PNG"), "a notebook shows it"


def test_more_than_four_plans_go_on_below(plans: dict[str, planner.Plan]) -> None:
    many = {f"plan {k}": [*plans.values()][k % 2] for k in range(6)}
    _, axes = plot_z(many)
    assert axes.shape == (4, 3), "in rows of as many as possible"
    titles = [axes[2 * (k // 3), k % 3].get_title() for k in range(6)]
    assert all(title.startswith(f"plan {k}") for k, title in enumerate(titles))
    del many["plan 5"]
    _, axes = plot_z(many)
    shown = [[ax.get_visible() for ax in row] for row in axes]
    assert shown == [[True] * 3] * 2 + [[True, True, False]] * 2
    assert len({ax.get_ylim() for ax in axes[::2].flat if ax.get_visible()}) == 1
    _, own = plot_z(many, axes=Figure().subplots(2, 5))
    assert own.shape == (2, 5), "own axes keep one column a plan"


def test_refused_plans_are_dashed_and_say_so(plans: dict[str, planner.Plan]) -> None:
    _, axes = plot_z(plans)
    assert "refused" in axes[0, 0].get_title()
    assert "refused" not in axes[0, 1].get_title()
    assert lines(axes[0, 0], COLOURS[0])[0].get_linestyle() == "--"
    assert lines(axes[0, 1], COLOURS[1])[0].get_linestyle() == "-"


def test_exits_from_the_domain_are_marked_where_they_are() -> None:
    plan = outside()
    figure, axes = plot_z(plan)
    (marks,) = (line for line in axes[0, 0].lines if line.get_marker() == "x")
    np.testing.assert_allclose(marks.get_xdata(), plan.domain.exits_s)
    low, _ = z2_band(plan, marks.get_xdata())
    np.testing.assert_allclose(marks.get_ydata(), low, atol=1e-9)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "leaves or re-enters the domain" in words


def test_other_systems_show_the_margin_with_the_outside_shaded() -> None:
    problem = planner.load_problem(ROOT / "problems/car.toml")
    plan = planner.solve(problem, "polynomial")
    _, axes = plot_z(plan)
    assert axes.shape == (3, 1)
    assert axes[1, 0].get_ylabel() == "least margin of the domain"
    (curve,) = lines(axes[1, 0], COLOURS[0])
    assert np.min(curve.get_ydata()) == pytest.approx(plan.domain.margin, abs=1e-4)
    assert axes[1, 0].patches


# -- joints, inputs, arm ---------------------------------------------------------------------------


def test_joints_are_in_degrees_and_end_at_the_goal(plans: dict[str, planner.Plan]) -> None:
    figure, axes = plot_joints(plans)
    panels = list(axes.flat)
    assert [ax.get_ylabel() for ax in panels] == [rf"$\theta_{{{i}}}$ (deg)" for i in (1, 2, 3)]
    for i, ax in enumerate(panels, start=1):
        for column, plan in enumerate(plans.values()):
            t, angle = lines(ax, COLOURS[column])[0].get_data()
            np.testing.assert_allclose(angle, np.rad2deg(plan.q(t)[:, i]))
            assert angle[-1] == pytest.approx(30, abs=1e-6)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [f"{MIDDLE} (refused)", BEST]


def test_joint_limits_appear_when_the_motion_comes_near(plans: dict[str, planner.Plan]) -> None:
    def limit_lines(degrees: float) -> int:
        problem = plans[BEST].problem.changed({"limits.joint_deg": degrees})
        _, axes = plot_joints(replace(plans[BEST], problem=problem))
        return sum(line.get_linestyle() == ":" for line in axes[0, 0].lines)

    assert limit_lines(45.0) == 1
    assert limit_lines(85.0) == 0


def test_inputs_stay_readable_and_name_the_peak(plans: dict[str, planner.Plan]) -> None:
    _, axes = plot_inputs(plans)
    u1, u2 = axes[0]
    assert (u1.get_ylabel(), u2.get_ylabel()) == ("$u_{1}$ (rad/s)", "$u_{2}$ (rad/s)")
    for ax in (u1, u2):
        limits = sorted(line.get_ydata()[0] for line in ax.lines if line.get_linestyle() == ":")
        assert limits == [-0.6, 0.6]
        assert max(np.abs(ax.get_ylim())) < 1.2
    notes = [text.get_text() for text in u2.texts]
    assert f"{MIDDLE} peaks at 83, t = 0 s" in notes
    assert not any("peaks" in text.get_text() for text in u1.texts)
    data = lines(u2, COLOURS[0])[0].get_ydata()
    assert np.max(data) == pytest.approx(83, rel=0.01)


def test_inputs_without_limits_have_no_limit_lines(unlimited: planner.Problem) -> None:
    plan = planner.solve(unlimited.changed({"goal.travel": 0.8286}), "polynomial")
    _, axes = plot_inputs(plan)
    for i, ax in enumerate(axes[0]):
        assert not any(line.get_linestyle() == ":" for line in ax.lines)
        t = np.linspace(0.5, plan.duration, 100)
        assert np.max(np.abs(plan.u(t)[:, i])) < ax.get_ylim()[1]
        assert not ax.texts, "a peak of three times the usual is shown, not named"


def test_the_map_shows_paths_start_goal_limits_and_the_chart(
    plans: dict[str, planner.Plan],
) -> None:
    _, axes = plot_map(plans)
    (ax,) = axes.flat
    assert (ax.get_xlabel(), ax.get_ylabel()) == (r"$\theta_{1}$ (deg)", r"$\theta_{2}$ (deg)")
    for k, plan in enumerate(plans.values()):
        (path,) = lines(ax, COLOURS[k])
        t = path.get_xdata(), path.get_ydata()
        np.testing.assert_allclose(np.transpose(t)[[0, -1]], [[1, 1], [30, 30]], atol=1e-6)
        theta1 = plan.q(np.linspace(0, plan.duration, 1000))[:, 1]
        np.testing.assert_allclose(np.max(t[0]), np.rad2deg(theta1.max()), rtol=1e-3)
    (chart,) = ax.patches
    assert (chart.get_xy(), chart.get_width(), chart.get_height()) == ((0.0, 0.0), 90.0, 90.0)
    assert {text.get_text() for text in ax.texts} == {"start", "goal"}
    limits = [line for line in ax.lines if line.get_linestyle() == ":"]
    assert len(limits) == 4
    with pytest.raises(planner.InputError, match="'map'"):
        plot_map(planner.solve(planner.load_problem(ROOT / "problems/car.toml"), "polynomial"))


def test_a_picture_in_the_plane_shows_all_that_its_panel_declares(
    plans: dict[str, planner.Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each field of `PlanePanel` changes the picture, and the scale of both axes is equal."""
    t = np.linspace(0.0, 1.0, 5)
    whole = PlanePanel(
        "plane", "the arm", "m", [Series(0, t, t)], note="a note", names=["x", "y"],
        ends=[(0.0, 0.0), (1.0, 1.0)], view=[(-1.0, 2.0), (-1.0, 3.0)],
        region=[(-0.5, 1.5), (-0.5, 2.5)], limits=[(0, 1.2)], poses=[[(0, 0), (1, 0)]] * 3,
        discs=[[0.5, 2.0, 0.25]], tips=[(0.7, 0.8)],
        key=[("below", "outside"), ("limit", "limits"), ("path", "the tip"), ("ramp", "poses")],
    )  # fmt: skip

    def drawn(panel: PlanePanel) -> list[str]:
        one = PlanFigure("own", lambda _: [panel], "Own", "")
        monkeypatch.setitem(PLAN_FIGURES, "own", one)
        figure, axes = plot("own", plans[BEST])
        (ax,) = axes.flat
        assert ax.get_aspect() == 1.0
        words = [text.get_text() for text in figure.findobj(Text)]
        shapes = [(line.get_xydata().tolist(), line.get_marker()) for line in ax.lines]
        patches = [patch.get_extents().bounds for patch in ax.patches]
        return [*map(str, (sorted(words), shapes, patches, ax.get_xlim(), ax.get_ylim()))]

    every = drawn(whole)
    for word in ("the arm; a note", "outside", "limits", "the tip", "poses", "start", "goal"):
        assert word in every[0]
    for field in fields(PlanePanel):
        if field.name in ("id", "unit", "title", "series", "names"):
            changed: Any = {"names": ["a", "b"], "series": [Series(0, t, -t)]}
            value = changed.get(field.name, "other")
        else:
            value = field.default
        if field.name != "id":  # names the panel for the program
            assert drawn(replace(whole, **{field.name: value})) != every, field.name


def test_arm_shows_poses_from_start_to_goal(plans: dict[str, planner.Plan]) -> None:
    _, axes = plot_arm(plans, poses=7)
    assert axes.shape == (1, 2)
    plan = plans[BEST]
    poses = [line for line in axes[0, 1].lines if len(line.get_xdata()) == 4]
    assert len(poses) == 7
    for pose, when in ((poses[0], 0.0), (poses[-1], plan.duration)):
        expected = plan.problem.system.arm_points(plan.q(when)[1:])
        np.testing.assert_allclose(np.transpose(pose.get_data()), expected)
    (path,) = lines(axes[0, 1], COLOURS[1])
    np.testing.assert_allclose(path.get_xydata()[-1], expected[-1])
    assert axes[0, 0].get_aspect() == 1


def test_where_links_come_nearest_is_marked() -> None:
    problem = planner.Problem.manipulator(
        [5, 60, 60, 60], [45, 60, 60, 59], link_lengths=[0.4, 0.2, 0.2, 0.35], duration=1.0,
        changes={"limits.self_clearance_m": 0.05},
    )  # fmt: skip
    end = problem.start + np.deg2rad([0, 40, 0, 0, 0])
    curve = BPoly(np.stack([problem.start, end])[:, None], [0.0, 1.0])
    u = BPoly(np.array([[[0.0, np.deg2rad(40)]]]), [0.0, 1.0])
    turning = StateTrajectory(problem.system, curve, u)
    _, axes = plot_arm(planner.Plan(problem, "collocation", {}, turning))
    drawn = [line for line in axes[0, 0].lines if line.get_color() == "crimson"]
    pose, gap = (np.array(line.get_data()).T for line in drawn)
    assert len(pose) == 5
    assert np.linalg.norm(gap[1] - gap[0]) == pytest.approx(0.2)  # joints 2 and 3, all the time
    assert "links 0.2 m apart" in {text.get_text() for text in axes[0, 0].texts}


def test_a_goal_of_the_tip_is_a_cross() -> None:
    plan = planner.solve(planner.load_problem(ROOT / "problems/tip.toml"))
    _, axes = plot_arm(plan)
    (cross,) = [line for line in axes[0, 0].lines if line.get_marker() == "x"]
    np.testing.assert_allclose(np.ravel(cross.get_data()), [0.4964, 0.6598])


def test_vehicles_are_drawn_by_their_path() -> None:
    plan = planner.solve(planner.load_problem(ROOT / "problems/car.toml"), "polynomial")
    _, axes = plot_arm([plan, plan])
    assert axes.shape == (2, 1)
    (path,) = lines(axes[0, 0], COLOURS[0])
    np.testing.assert_allclose(path.get_xydata()[-1], plan.q(plan.duration)[[0, -1]], atol=1e-9)


# -- errors and replays ----------------------------------------------------------------------------


def test_errors_are_a_distribution_with_its_percentiles() -> None:
    one = np.linspace(1, 2, 101)
    _, ax = plot_errors({"none": None, "one": one, "other": 100 * one})
    assert ax.get_xscale() == "log"
    steps, dots = lines(ax, COLOURS[1])
    np.testing.assert_allclose(steps.get_ydata()[[0, -1]], [1 / 101, 1])
    np.testing.assert_allclose(dots.get_data(), [[1.5, 1.95], [0.5, 0.95]])
    assert not lines(ax, COLOURS[0])
    assert "deg" in ax.get_xlabel()
    _, ax = plot_errors({"one": one})
    assert ax.get_xscale() == "linear"


def test_refused_plans_are_marked_in_every_figure_and_axes_are_named() -> None:
    found = quick_comparison()
    made = found.figures()
    (ax,) = made["effort"].axes
    unit = "(rad²/s)"
    assert ax.get_xlabel().startswith(f"effort: integral of u1^2 + u2^2 dt {unit}")
    named = [text.get_text() for legend in made["effort"].legends for text in legend.get_texts()]
    assert f"{MIDDLE} (refused)" in named
    (ax,) = made["errors"].axes
    dashed = [line.get_label() for line in ax.get_lines() if line.get_linestyle() == "--"]
    assert [label.split(":")[0] for label in dashed] == [MIDDLE.split(":")[0]]
    assert "(refused)" in dashed[0]
    titles = [ax.get_title(loc="left") for ax in made["replay"].axes]
    assert f"{MIDDLE} (refused)" in titles
    assert "polynomial" in titles


def test_pictures_and_page_decide_alike_where_an_axis_is_logarithmic_and_say_so() -> None:
    found = quick_comparison()
    for factor in (0.02, 1.0, 50.0):
        rows = tuple(
            replace(r, effort=r.effort * (factor if k else 1)) for k, r in enumerate(found.rows)
        )
        one = replace(found, rows=rows)
        figures = {f["id"]: f["panels"][0] for f in page_data(one, replay_data(one))["figures"]}
        errors = {r.label: r.replay.index_E_deg for r in rows if r.replay is not None}
        made = {"effort": plot_efforts(one)[0], "errors": plot_errors(errors)[0]}
        for name, panel, log in (
            ("effort", figures["trade"], figures["trade"]["log"][0]),
            ("errors", figures["errors"], figures["errors"]["log"]),
        ):
            (ax,) = made[name].axes
            assert log == (ax.get_xscale() == "log")
            assert log == ax.get_xlabel().endswith(", log scale")
            assert panel["across"].split()[0] in ax.get_xlabel()
        (ax,) = made["effort"].axes
        assert figures["trade"]["log"][1] == (ax.get_yscale() == "log")
        assert figures["trade"]["log"][1] == ax.get_ylabel().endswith(", log scale")


def test_feedback_keeps_its_plans_colour() -> None:
    """As in all other figures of a comparison, where plans with feedback have no curve."""
    one = np.linspace(1, 2, 101)
    _, ax = plot_errors({"a": one, "a + feedback": 0.1 * one, "b": one, "b + feedback": None})
    first, second = lines(ax, COLOURS[0]), lines(ax, COLOURS[1])
    assert [line.get_linestyle() for line in first] == ["-", "None", ":", "None"]
    assert len(second) == 2
    assert not lines(ax, COLOURS[2])


def test_replays_show_the_median_of_the_machines_at_each_time() -> None:
    row = quick_comparison()[MIDDLE]
    k = median_sample(row.replay)
    assert row.replay.index_E_deg[k] == np.median(row.replay.index_E_deg)
    _, axes = plot_replays({"x": row.replay})
    (actual,) = lines(axes[0, 0], COLOURS[0])
    middle = np.median(np.rad2deg(row.replay.q[:, :, 1]), axis=0)
    np.testing.assert_allclose(actual.get_ydata(), middle, atol=1e-9)
    (planned,) = lines(axes[0, 0], "k")
    np.testing.assert_allclose(planned.get_ydata()[-1], 30, atol=1e-6)


# -- common ----------------------------------------------------------------------------------------


def test_preparations_lie_before_time_zero(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = planner.solve(paper)
    better = planner.compensate(plan)
    run = planner.replay(better, samples=3)
    drawn = {"as it is": plan, "compensated": better}
    for axes in (plot_joints(drawn)[1], plot_inputs(drawn)[1], plot_z(better)[1][:2]):
        ax = axes.flat[-1]
        begins = [float(line.get_xdata()[0]) for line in ax.lines if len(line.get_xdata()) > 2]
        assert begins[-1] == pytest.approx(-better.lead_s)
        assert "plan's start" in ax.get_xlabel() or axes.flat[0] is not ax
    joints = plot_joints(drawn)[1].flat
    dots = next(line for line in joints[2].lines if line.get_marker() == "o")
    assert list(dots.get_xdata()) == pytest.approx([0.0, plan.duration + better.tail_s])
    peaks = [TimePanel("peak", "peak", "", [], view=(0.0, 1.0), notes=[Peak(0, 2.0, 5.0)])]
    monkeypatch.setitem(PLAN_FIGURES, "peak", PlanFigure("peak", lambda drawn: peaks, "", ""))
    ax = plot("peak", better)[1].flat[0]
    assert next(text.get_text() for text in ax.texts).endswith("peaks at 5, t = 2 s")
    assert [list(line.get_xdata()) for line in ax.lines] == [[2.0]]
    ax = plot_replays(run)[1].flat[0]
    assert float(ax.lines[0].get_xdata()[0]) == pytest.approx(-better.lead_s)
    assert plot_joints(plan)[1].flat[0].lines[0].get_xdata()[0] == 0.0


def test_a_plan_keeps_its_colour_in_all_figures(plans: dict[str, planner.Plan]) -> None:
    mixed = {"outside": outside(), "missing": None, **plans}
    all_three = [c.colour for c in curves(mixed)]
    assert len(set(all_three)) == 3
    assert [c.colour for c in curves(mixed, executable=True)] == all_three[1:]


def test_titles_and_legends_fit_into_the_figure() -> None:
    figures = quick_comparison().figures()
    assert list(figures) == [*PLAN_FIGURES, "arm", *REPLAY_FIGURES]
    for name, figure in figures.items():
        figure.draw_without_rendering()
        width, height = figure.get_size_inches() * figure.dpi
        words = [*figure.texts, *(t for ax in figure.axes for t in (ax.title, ax.xaxis.label))]
        boxes = [t.get_window_extent() for t in words if t.get_text()]
        boxes += [legend.get_window_extent() for legend in figure.legends]
        for box in boxes:
            assert box.x0 >= -1, name
            assert box.x1 <= width + 1, name
            assert box.y0 >= -1, name
            assert box.y1 <= height + 1, name


def test_own_axes_are_used_and_counted(plans: dict[str, planner.Plan]) -> None:
    own = Figure()
    axes = own.subplots(1, 3)
    figure, _ = plot_joints(plans, axes=axes)
    assert figure is own
    assert all(ax.lines for ax in axes)
    assert not own.legends
    with pytest.raises(planner.InputError, match=r"\b2 axes"):
        plot_inputs(plans, axes=axes)


def test_nothing_to_draw_is_said() -> None:
    for draw in (plot_joints, plot_inputs, plot_arm):
        with pytest.raises(planner.InputError, match="no executable plan"):
            draw(outside())
    with pytest.raises(planner.InputError, match="no plan to draw"):
        plot_z({"a": None})
    with pytest.raises(planner.InputError, match="replayed"):
        plot_errors({"a": None})
    with pytest.raises(planner.InputError, match="replayed"):
        plot_replays({"a": None})


def test_symbols() -> None:
    assert symbol("theta12") == r"$\theta_{12}$"
    assert symbol("u1") == "$u_{1}$"
    assert symbol("steering_rate") == "steering rate"


@pytest.mark.parametrize(("file", "unit"), [("paper", "link lengths"), ("tip", "m"), ("car", "m")])
def test_places_have_the_unit_of_the_links(file: str, unit: str) -> None:
    plan = planner.solve(planner.load_problem(f"problems/{file}.toml"), "collocation")
    _, axes = plot_arm(plan)
    assert np.ravel(axes)[0].get_xlabel() == f"x ({unit})"
