"""Methods side by side on the same machines."""

from __future__ import annotations

import json
import re
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compared import CHANGES, SAMPLES, paper_comparison, refused_comparison
from printed import printed
from registered import restored

import planner
from planner import METHODS, Machine
from planner.comparison import compare as compare_module
from planner.comparison.compare import default_methods
from planner.comparison.differences import markdown_differences, rich_differences
from planner.comparison.headline import headline
from planner.comparison.rows import Row
from planner.plan.spec import Spec
from planner.report import folders
from planner.report.folders import replay_data
from planner.solve import solve_and_check
from planner.support.arrays import jsonable
from planner.support.tables import number

MIDDLE, BEST, OPTIMAL = "polynomial:travel=middle", "polynomial", "collocation"
COMPENSATED = "collocation compensated"
ROOT = Path(__file__).parents[2]


@pytest.fixture
def quick(unlimited: planner.Problem) -> planner.Problem:
    changes = {"goal.duration": 1.0, "goal.travel": 0.81, "machine.step_s": 0.01}
    return unlimited.changed(changes)


def test_default_methods_show_what_the_polynomial_and_what_compensation_can_do(
    paper: planner.Problem,
) -> None:
    plain = ["polynomial:points=auto", "sinusoid", OPTIMAL]
    both = [*plain, "polynomial compensated:points=auto", "sinusoid compensated", COMPENSATED]
    assert default_methods(paper) == [MIDDLE, *both]
    assert default_methods(paper.changed({"goal.travel": 0.81})) == [BEST, *both]
    every = paper.changed({"compensation.on": True})
    assert default_methods(every) == [MIDDLE, *plain], "compensated as they are"
    car = planner.load_problem(ROOT / "problems/car.toml")
    assert COMPENSATED not in default_methods(car)


def test_by_default_every_plan_is_compensated_once_it_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is refused has no second row, and no plan is searched twice."""
    specs = [MIDDLE, BEST, OPTIMAL]
    more = ["polynomial compensated:travel=middle", f"{BEST} compensated", COMPENSATED]
    monkeypatch.setattr(compare_module, "default_methods", lambda problem: [*specs, *more])
    problem = planner.load_problem(ROOT / "problems/paper.toml", CHANGES)
    result = planner.compare(problem, samples=40)
    assert [(r.label, r.solved) for r in result.rows] == [
        (MIDDLE, False), *((label, True) for label in (*specs[1:], *more[1:]))
    ]  # fmt: skip
    plain, better = result[BEST], result[f"{BEST} compensated"]
    assert better.plan.compensates.q(3.0).tolist() == plain.plan.q(3.0).tolist()
    assert plain.took_s < better.took_s
    assert plain.duration_s == 10 < better.duration_s
    said = f"{better.label} by {number(better.duration_s - 10)} s"
    assert said in result.markdown().split("Longer than goal.duration: ")[1]
    words = result.headline
    taken = result[COMPENSATED]  # the paired test tells it from the other in neither error
    start = f"Take {taken.label} for the way: E {number(taken.E_median_deg)} deg in the median"
    assert words.startswith(start)
    base = taken.label.replace(" compensated", "")
    assert f"instead of {number(result[base].E_median_deg)} deg ({base})" in words
    _, prices, cautions = words.split("\n")
    assert prices.startswith("It takes ")
    assert f"0.1 deg or more from {better.label} (E " in prices
    assert cautions.startswith("Stand clear: ")
    assert result.in_order[0] is taken
    assert result.in_order[1:] == [row for row in result.rows if row is not taken]
    below = result.markdown()
    now, was = (
        [r.E_p95_deg for r in result.rows if r.solved and (COMPENSATED.split()[1] in r.label) == it]
        for it in (True, False)
    )
    assert (len(now), len(was)) == (2, 2)
    assert max(now) < min(was)
    told = f"E 95 % {number(min(now))} to {number(max(now))} deg, not {number(min(was))} to"
    assert f"whichever method planned: {told} {number(max(was))} deg." in below
    efforts = [result[name].effort for name in (OPTIMAL, BEST)]
    assert f"in effort: {number(efforts[0])} to {number(efforts[1])} rad²/s." in below
    pairs = list(zip(result.differences, result.end_differences, strict=True))
    for E, end in pairs:
        gap = result[end.first].replay.terminal_E_deg - result[end.second].replay.terminal_E_deg
        assert (E.first, E.second) == (end.first, end.second)
        assert end.median_deg == np.median(gap)


def test_the_plan_to_take_is_chosen_by_what_was_asked(tmp_path: Path) -> None:
    """The plan that ends at the goal by its way has a small E from its own motion alone: it is not
    for the way, and at the end no worse than the compensated plan, which takes more."""
    problem, turning = ROOT / "problems/paper.toml", "collocation:end=machine"
    given = planner.load_problem(problem, CHANGES)
    result = planner.compare(given, [OPTIMAL, turning, COMPENSATED], samples=60, by="end")
    ends = {row.label: row.end_median_deg for row in result.rows}
    assert ends[turning] < ends[COMPENSATED] + 0.2 < ends[OPTIMAL] - 3
    assert result[turning].E_median_deg < result[OPTIMAL].E_median_deg - 3
    assert "errors from the motion predicted on the machine" in result[turning].note
    words = f"Take {turning} for the end: {number(ends[turning])} deg in the median"
    assert result.headline.startswith(words)
    assert f"{COMPENSATED} ({number(ends[COMPENSATED])} deg)" in result.headline
    taken = {by: replace(result, by=by).recommended for by in ("way", "end", "effort", "time")}
    assert {by: row.label for by, row in taken.items() if row} == {
        "way": COMPENSATED, "end": turning, "effort": OPTIMAL, "time": OPTIMAL
    }  # fmt: skip
    assert replace(result, by="effort").headline.startswith(f"Take {OPTIMAL}: of 3 verified plans")
    assert "--by end" in str(result.to_dict()["command"])
    assert planner.report.load_comparison(result.save(tmp_path / "kept")).by == "end"
    with pytest.raises(planner.InputError, match="way, end, effort, time"):
        planner.compare(given, [OPTIMAL], samples=1, by="goal")  # type: ignore[arg-type]


def test_the_headline_says_when_there_is_no_choice() -> None:
    assert "None of the methods" in refused_comparison().headline
    assert refused_comparison().to_dict()["headline"] == refused_comparison().headline
    car = planner.load_problem(ROOT / "problems/car.toml", {"machine.step_s": 0.01})
    result = planner.compare(car, ["collocation"], samples=5)
    assert result.headline == "collocation reaches the goal and keeps every limit."


@pytest.fixture(scope="module")
def compensated() -> planner.Comparison:
    problem = planner.load_problem(ROOT / "problems/paper.toml", {"machine.step_s": 0.01})
    return planner.compare(problem, [OPTIMAL, COMPENSATED], samples=100, seed=3)


def test_of_plans_that_the_test_cannot_tell_apart_the_cheapest_is_taken(
    compensated: planner.Comparison,
) -> None:
    """Medians may lie apart where the plans, machine by machine, do not."""
    plain, better = compensated.rows
    less = better.E_median_deg - 3 * compensated.threshold_deg
    dear = replace(
        better, spec=Spec("desensitised", compensated=True), effort=4.0, E_median_deg=less
    )
    result = replace(compensated, rows=(dear, plain, better))
    assert result.best is dear
    assert result.recommended is better
    words = result.headline
    assert (
        f"{dear.label} (E {number(less)} deg), which takes 4 rad²/s of effort instead of" in words
    )
    assert "on machines without inertia (quasi-static), unwound at the start." in words
    homed = replace(result, machine=planner.Machine.prototype(start_state="forward"))
    assert "inertia (quasi-static), forward at the start." in homed.headline
    table = " ".join(printed(rich_differences(result)))
    assert f"{COMPENSATED} against the others" in " ".join(table.split())


def test_a_plan_that_breaks_limits_on_many_machines_comes_after_one_that_does_not(
    compensated: planner.Comparison,
) -> None:
    plain, better = compensated.rows
    nearer = replace(
        better, spec=Spec("polynomial", compensated=True), E_median_deg=0.1, beyond_physical=3.9
    )
    result = replace(compensated, rows=(plain, better, nearer))
    assert result.recommended is better
    assert f"{nearer.label} (E 0.1 deg) breaks a limit on 3.9 % of the machines." in result.headline
    only = replace(compensated, rows=(plain, nearer)).headline
    assert only.startswith(f"Take {plain.label}")
    assert f"{nearer.label} (E 0.1 deg) breaks a limit on 3.9 % of the machines." in only
    less = 0.9 * better.effort
    harmless = replace(nearer, beyond_limits=3.9, beyond_physical=0, effort=less)
    assert replace(compensated, rows=(plain, better, harmless)).recommended is harmless


def test_no_plan_is_recommended_whose_machines_break_a_physical_limit(
    compensated: planner.Comparison,
) -> None:
    rows = [
        replace(r, beyond_limits=n, beyond_physical=n)
        for r, n in zip(compensated.rows, [7, 3], strict=True)
    ]
    result = replace(compensated, rows=tuple(rows))
    assert result.recommended is None
    assert result.headline == (
        f"No plan is recommended. On 3 % of the machines {rows[1].label} breaks a limit, the fewest"
        " of all plans."
    )


def test_a_worse_plan_is_told_apart_on_few_machines_too(compensated: planner.Comparison) -> None:
    """Two machines can show nothing to a test; that both agree decides."""
    plain, better = compensated.rows
    few = planner.compare(compensated.problem, [OPTIMAL, COMPENSATED], samples=2, seed=3)
    assert not few.differences[0].significant
    assert few.recommended.label == better.label
    assert plain.effort < better.effort


def test_the_headline_prices_a_plan_against_the_next_best_of_its_kind(
    compensated: planner.Comparison,
) -> None:
    plain, better = compensated.rows
    worse = replace(plain, spec=Spec("sinusoid", compensated=True), effort=0.2)
    words = replace(compensated, rows=(plain, better, worse)).headline
    priced = f"{number(better.effort)} rad²/s of effort instead of 0.2"
    named = f"{worse.label} (E {number(worse.E_median_deg)} deg)"
    assert f"The next best plan with compensation is {named}." in words
    assert words.split(f"{named}. {better.label} takes ")[1].split(".\n")[0].endswith(priced)


def test_where_joint_1_comes_in_the_whole_motion_stands_beside_the_recommendation(
    compensated: planner.Comparison, tmp_path: Path
) -> None:
    """Who stands clear of the preparation alone is hit later: the motion itself goes further."""
    plain, better = compensated.rows
    run = planner.replay(better.plan, better.replay.machine, 5, seed=3, feedback=True)
    spec = replace(better.spec, feedback=True)
    closed = replace(
        better, spec=spec, duration_s=run.run_s, joint_1_range_deg=run.joint_1_range_deg
    )
    ranges = {}
    for row, motion in ((better, better.replay), (closed, run)):
        theta1 = np.rad2deg(motion.q[:, :, 1])
        assert row.joint_1_range_deg == (theta1.min(), theta1.max())
        ranges[row.feedback] = np.floor(theta1.min()), np.ceil(theta1.max())
    prepares = np.rad2deg(better.replay.q[:, better.replay.t < better.plan.lead_s, 1].max())
    assert prepares + 3 < ranges[False][1] < ranges[True][1] - 20

    def told(*rows: Row) -> list[tuple[float, float]]:
        words = replace(compensated, rows=rows).headline
        found = re.findall(r"between (-?\d+) and (-?\d+) deg", words)
        return [(float(low), float(high)) for low, high in found]

    assert told(plain, better, closed) == [ranges[False], ranges[True]]
    assert told(plain) == []
    kept = planner.report.load_comparison(compensated.save(tmp_path / "kept"))
    assert kept[COMPENSATED].joint_1_range_deg == pytest.approx(better.joint_1_range_deg)
    assert kept.headline == compensated.headline
    file = tmp_path / "kept/comparison.json"
    data = json.loads(file.read_text())
    for row in data["rows"]:
        row["swing_deg"] = row.pop("joint_1_range_deg")  # before the plan's start alone
    file.write_text(json.dumps(data))
    assert told(*planner.report.load_comparison(tmp_path / "kept").rows) == []


def test_the_headline_names_a_nearer_plan_that_is_refused(compensated: planner.Comparison) -> None:
    plain, better = compensated.rows
    why, ways = "goal theta2 reaches 0.164 deg, allowed 0", ("more time", "no compensation")
    refused = replace(better, solved=False, why=why, ways=ways)
    assert refused.advice == "more time; or no compensation"
    start, label, lines = headline([plain, refused], compensated.threshold_deg, compensated.machine)
    words = "\n".join([start + label + lines[0], *lines[1:]])
    assert words.startswith(f"Take {plain.label}: the only plan that reaches the goal")
    ends = [number(row.end_median_deg) for row in (better, plain)]
    assert f"{better.label} ({why}): E {number(better.E_median_deg)} deg instead of" in words
    assert words.endswith(f"{ends[0]} deg instead of {ends[1]} deg at the end. Try: more time.")
    assert "refused" not in str(headline([plain, refused], 100.0, compensated.machine))


def test_a_compensated_plan_is_compared_on_the_path_it_compensates(
    compensated: planner.Comparison,
) -> None:
    plain, better = compensated.rows
    assert better.solved
    assert better.plan.compensates is not None
    assert better.method == OPTIMAL
    assert better.E_p95_deg < 3.6 < 6.5 < plain.E_p95_deg
    assert better.end_p95_deg < 3.6 < 6.0 < plain.end_p95_deg
    run = better.replay
    assert better.end_median_deg == np.median(run.terminal_E_deg)
    assert better.end_p95_deg == np.percentile(run.terminal_E_deg, 95)
    assert "end 95 %" in compensated.markdown()
    assert compensated.best is compensated[COMPENSATED]


def test_a_compensated_plan_that_leaves_its_path_says_so() -> None:
    quick = {"machine.step_s": 0.01, "compensation.preparation": False}
    crossing = planner.load_problem(ROOT / "problems/crossing.toml", quick)
    result = planner.compare(crossing, [COMPENSATED], samples=2)
    assert "leaves the original path by up to" in result.rows[0].note
    assert "leaves the original path by up to" in result.markdown()


def test_it_is_compensated_for_the_machine_of_the_comparison(paper: planner.Problem) -> None:
    machine = planner.Machine.prototype(backlash_deg=0.5, step_s=0.01)
    (row,) = planner.compare(paper, [COMPENSATED], machine=machine, samples=2).rows
    assert planner.Machine.from_table(row.plan.compensation.machine) == machine
    asked = paper.changed({"compensation": {"on": True, "preparation": False}})
    for spec in (OPTIMAL, COMPENSATED):
        (row,) = planner.compare(asked, [spec], machine=machine, samples=2).rows
        assert planner.Machine.from_table(row.plan.compensation.machine) == machine
        assert row.plan.lead_s == 0


def test_small_differences_are_neither_better_nor_worse(compensated: planner.Comparison) -> None:
    (d,) = compensated.differences
    assert d.significant
    assert d.matters
    assert d.threshold_deg == 0.1
    assert markdown_differences(compensated).count("| worse |") == 2  # at any time, at the end
    alike = replace(compensated, threshold_deg=9.0)
    assert "no difference that matters" in markdown_differences(alike)


def test_a_saved_comparison_recommends_the_same_plan(
    compensated: planner.Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a threshold that its user chose, on machines that its user chose."""
    monkeypatch.setattr(folders, "_write_figures", lambda *_: None)
    chosen = tuple(range(len(compensated[OPTIMAL].replay.numbers)))
    alike = replace(compensated, threshold_deg=9.0, chosen=chosen)
    assert (alike.recommended.label, compensated.recommended.label) == (OPTIMAL, COMPENSATED)
    back = planner.report.load_comparison(alike.save(tmp_path / "alike"))
    assert (back.threshold_deg, back.chosen) == (9.0, chosen)
    assert (back.recommended.label, back.headline) == (OPTIMAL, alike.headline)
    assert alike.to_dict()["command"] is None, "the command has another threshold"
    file = tmp_path / "alike/comparison.json"
    data = json.loads(file.read_text())
    for damage in ({"threshold_deg": "9"}, {"chosen": [-1]}):
        file.write_text(json.dumps(data | damage))
        with pytest.raises(planner.InputError):
            planner.report.load_comparison(tmp_path / "alike")
    del data["threshold_deg"], data["chosen"]
    file.write_text(json.dumps(data))
    assert planner.report.load_comparison(tmp_path / "alike").recommended.label == COMPENSATED


@pytest.mark.parametrize("gap_deg", [0.0, 1.0])
def test_compensation_decides_only_where_the_paired_test_says_so(
    compensated: planner.Comparison, gap_deg: float
) -> None:
    """Both compensated plans are far better than both others; is one better than the other?"""
    plain, better = compensated.rows
    worse, plain2 = (
        replace(
            row,
            spec=replace(row.spec, method="sinusoid"),
            machine_errors_deg=row.machine_errors_deg + gap,
            E_median_deg=row.E_median_deg + gap,
            E_p95_deg=row.E_p95_deg + gap,
        )
        for row, gap in ((better, gap_deg), (plain, 0.0))
    )
    result = replace(compensated, rows=(plain, better, plain2, worse))
    verdicts = {(d.first, d.second): d.is_clear for d in result.differences}
    assert verdicts[better.label, worse.label] == bool(gap_deg)
    ranges = f"E 95 % {number(better.E_p95_deg)}"
    says = ["decides the accuracy, whichever method planned", "makes every plan better"]
    below = result.markdown()
    assert f"Compensation {says[bool(gap_deg)]}: {ranges}" in below
    assert says[not gap_deg] not in below


def test_nothing_decides_where_the_paired_test_does_not_tell_plans_apart(
    compensated: planner.Comparison,
) -> None:
    """By their 95th percentiles alone the compensated plans are better."""
    plain, better = compensated.rows
    alike = replace(better, machine_errors_deg=plain.machine_errors_deg)
    more = [replace(r, spec=replace(r.spec, method="sinusoid")) for r in (plain, alike)]
    result = replace(compensated, rows=(plain, alike, *more))
    assert alike.E_p95_deg < plain.E_p95_deg
    assert "Compensation" not in result.markdown()


def test_feedback_closes_the_last_plan_which_is_compensated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = sys.modules["planner.machine.replay"]
    monkeypatch.setattr(module, "feedback_of", lambda plan, on: _Held() if on else None)
    monkeypatch.setattr(compare_module, "default_methods", lambda problem: [OPTIMAL, COMPENSATED])
    problem = planner.load_problem(ROOT / "problems/paper.toml", {"machine.step_s": 0.01})
    result = planner.compare(problem, samples=1, feedback=True)
    labels = [row.label for row in result.rows]
    assert labels == [OPTIMAL, COMPENSATED, "collocation compensated + feedback"]


def test_polynomials_are_refused_with_the_reason_and_collocation_is_solved() -> None:
    result = paper_comparison()
    with pytest.raises(KeyError):
        result["nothing"]
    with pytest.raises(planner.InputError, match="'nothing'"):
        result["nothing"]
    assert result[OPTIMAL].solved
    assert result[OPTIMAL].why == ""
    assert result[OPTIMAL].plan.verified
    for label, peak in ((MIDDLE, 83.0), (BEST, 0.5825)):
        row = result[label]
        assert not row.solved
        assert (row.plan.status, row.plan.verified) == ("verification_failed", False)
        assert row.peak_u[1] == pytest.approx(peak, rel=0.01)
        assert row.why == f"input u2 reaches {row.peak_u[1]:.3g} rad/s, allowed 0.5"


def test_the_first_command_of_the_polynomial_costs_error_on_the_machine() -> None:
    result = paper_comparison()
    assert result[MIDDLE].replay.saturated_s[:, 1].min() > 0
    assert result[MIDDLE].E_median_deg > 2 * result[OPTIMAL].E_median_deg
    assert result[MIDDLE].E_median_deg > 2 * result[BEST].E_median_deg


def test_figures_of_a_row_are_those_of_its_plan() -> None:
    row = paper_comparison()[OPTIMAL]
    assert row.effort == pytest.approx(0.33584, abs=1e-4)
    assert row.effort == row.plan.effort
    assert row.travel == row.plan.travel
    assert row.duration_s == 10.0
    assert row.domain_margin == row.plan.domain.margin
    check = planner.verify(row.plan)
    assert row.terminal_error_max_deg == np.max(np.abs(check.terminal_error_deg))
    assert row.E_p95_deg == np.percentile(row.replay.index_E_deg, 95)
    assert row.E_median_deg == np.median(row.replay.index_E_deg)


def test_every_plan_meets_the_same_machines() -> None:
    first, *others = (row.replay for row in paper_comparison().rows)
    for other in others:
        assert other.draws.values.keys() == first.draws.values.keys()
        for name, values in first.draws.values.items():
            np.testing.assert_array_equal(other.draws.values[name], values)


def test_same_seed_same_errors_other_seed_other_errors(quick: planner.Problem) -> None:
    def errors(seed: int) -> np.ndarray:
        result = planner.compare(quick, ["polynomial"], samples=4, seed=seed)
        return result.rows[0].replay.index_E_deg

    np.testing.assert_array_equal(errors(1), errors(1))
    assert not np.any(errors(1) == errors(2))


def test_a_plan_outside_the_domain_is_not_replayed(paper: planner.Problem) -> None:
    fixed = paper.changed({"goal.travel": float(np.pi / 4), "limits": {}})
    for spec in ("polynomial", "polynomial:allow_singular=true"):
        row = planner.compare(fixed, [spec], samples=2).rows[0]
        assert not row.solved
        assert row.plan.status == "singular"
        assert row.replay is None
        assert np.isnan([row.effort, row.E_median_deg, *row.peak_u]).all()
        assert row.travel == row.plan.travel
        assert (row.domain_ok, row.domain_margin < 0) == (False, True)
        assert row.why.startswith("leaves the chart's domain at t = ")


def test_no_plan_at_all_gives_a_row_with_the_reason(paper: planner.Problem) -> None:
    backwards = paper.changed({"goal.theta_deg": [30, 30, -30], "limits": {}})
    row = planner.compare(backwards, ["polynomial:travel=middle"], samples=2).rows[0]
    assert not row.solved
    assert row.why.startswith("leaves the chart's domain at t = ")
    assert str(backwards.source) not in row.why
    assert "\n" not in row.why


def test_an_unfinished_iterate_is_not_kept_as_a_plan(
    unlimited: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    iterate = planner.solve(unlimited.changed({"goal.travel": 0.81}), "polynomial")

    def give_up(problem: planner.Problem, options: object) -> planner.Plan:
        raise planner.NotConvergedError("stopped after 3 iterations", plan=iterate)

    monkeypatch.setitem(METHODS, "polynomial", replace(METHODS["polynomial"], plan=give_up))
    row = planner.compare(unlimited, ["polynomial"], samples=2).rows[0]
    assert (row.plan, row.replay, row.why) == (None, None, "stopped after 3 iterations")


def test_a_motion_that_takes_too_long_is_drawn_and_replayed_for_study() -> None:
    """What is proven impossible comes with the fastest motion there is, squeezed into the time."""
    row = refused_comparison()["collocation"]
    assert not row.solved
    assert row.plan.duration == 2.0
    assert max(row.peak_u) > 0.5
    assert row.terminal_error_max_deg < 1e-3, "it reaches the goal"
    assert np.isfinite(row.E_median_deg)
    row = refused_comparison()["polynomial"]
    assert row.why.startswith("no plan of any kind exists: theta3 must move")
    assert (row.plan.duration, row.plan.verified, row.status) == (2.0, False, "infeasible")
    assert max(row.peak_u) > 0.5


def test_the_time_is_that_from_question_to_answer(
    unlimited: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*given: Any, **options: Any) -> Any:
        time.sleep(0.3)  # as verification and proofs may
        return solve_and_check(*given, **options)

    monkeypatch.setattr(compare_module, "solve_and_check", slow)
    row = planner.compare(unlimited, ["polynomial"], samples=1).rows[0]
    assert row.took_s > 0.3 + row.solve_time_s


def test_progress_rises_to_the_end_and_names_the_method(quick: planner.Problem) -> None:
    told: list[tuple[str, float]] = []
    planner.compare(
        quick, ["polynomial"], samples=1, progress=lambda doing, share: told.append((doing, share))
    )
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert told[0][0] == "planning polynomial"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        *(({"samples": samples}, "samples") for samples in (0, -1, 1.5, True)),
        ({"methods": ["polynomial", "polynomal"]}, "did you mean 'polynomial'"),
        ({"threshold_deg": -1.0}, "threshold_deg"),
    ],
)
def test_wrong_words_are_refused_before_planning(
    paper: planner.Problem, words: dict[str, Any], says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.compare(paper, **{"methods": ["polynomial"], **words})


def test_the_machine_can_be_given(quick: planner.Problem) -> None:
    row = planner.compare(quick, ["polynomial"], machine=Machine.ideal(), samples=2).rows[0]
    assert row.E_p95_deg < np.rad2deg(1e-6)


def test_dict_is_json_with_nulls_for_what_is_undefined(paper: planner.Problem) -> None:
    data = paper_comparison().to_dict()
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert (data["samples"], data["seed"]) == (SAMPLES, 3)
    assert data["command"].startswith("planner compare ")
    assert planner.Problem.from_dict(data["problem"]) == paper_comparison().problem
    assert Machine.from_table(data["machine"]) == paper_comparison().machine
    assert {"planner", "casadi", "numpy", "scipy", "osqp"} <= data["versions"].keys()
    missing = planner.compare(
        paper.changed({"goal.theta_deg": [30, 30, -30], "limits": {}}), ["polynomial"], samples=1
    )
    assert missing.to_dict()["rows"][0]["effort"] is None


def test_jsonable_turns_numpy_into_plain_values() -> None:
    mixed = {"a": np.float64("nan"), "b": np.arange(2), "c": (np.inf, np.True_, None, "x")}
    assert jsonable(mixed) == {"a": None, "b": [0, 1], "c": [None, True, None, "x"]}


def test_refusals_that_apply_to_every_method_fill_every_row(paper: planner.Problem) -> None:
    hurried = paper.changed({"goal.duration": 0.5})
    result = planner.compare(hurried, ["polynomial", "polynomial:travel=middle"], samples=1)
    assert not any(row.solved for row in result.rows)
    assert all("takes" in row.why and row.status == "infeasible" for row in result.rows)


# -- many methods, feedback, worst machines, Ctrl-C -----------------------------------------


def test_all_means_every_method_and_one_that_does_not_fit_stops_none(
    quick: planner.Problem,
) -> None:
    like = METHODS["polynomial"]

    def unfit(problem: planner.Problem, options: object) -> planner.Plan:
        raise planner.InputError("works on cars only", source=problem.source)

    with restored():
        METHODS.clear()
        METHODS.update(sinusoid=replace(like, name="sinusoid", plan=unfit), polynomial=like)
        result = planner.compare(quick, "all", samples=2)
        assert [row.label for row in result.rows] == ["sinusoid", "polynomial"]
        assert (result.rows[0].why, result.rows[1].solved) == ("works on cars only", True)
        with pytest.raises(planner.InputError, match="cars"):
            planner.compare(quick, ["sinusoid"], samples=2)


def test_the_worst_machine_is_the_worst_when_replayed_alone(quick: planner.Problem) -> None:
    row = planner.compare(quick, ["polynomial"], samples=12, seed=4).rows[0]
    assert row.worst is not None
    again = planner.compare(quick, ["polynomial"], samples=[row.worst], seed=4)
    assert (again.samples, again.chosen) == (1, (row.worst,))
    assert again.rows[0].E_median_deg == row.replay.index_E_deg.max()


def test_intervals_hold_their_percentiles() -> None:
    for row in paper_comparison().rows:
        low, high = row.E_median_interval_deg
        assert low <= row.E_median_deg <= high
        assert row.E_p95_interval_deg[0] <= row.E_p95_deg
        assert np.isnan(row.E_p95_interval_deg[1])  # nine machines cannot bound it


def test_differences_are_paired() -> None:
    result = paper_comparison()
    found = {(d.first, d.second): d for d in result.differences}
    assert list(found) == [(MIDDLE, BEST), (MIDDLE, OPTIMAL), (BEST, OPTIMAL)]
    middle = found[MIDDLE, OPTIMAL]
    assert middle.first_better == 0.0
    assert middle.significant
    assert middle.p_value == pytest.approx(2 / 2**SAMPLES)
    assert result.best is result[OPTIMAL]


def test_rows_with_feedback_stand_beside_those_without(
    quick: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = sys.modules["planner.machine.replay"]
    monkeypatch.setattr(module, "feedback_of", lambda plan, on: _Held() if on else None)
    result = planner.compare(quick, ["polynomial"], samples=3, feedback=True)
    free, closed = result.rows
    assert (free.label, closed.label) == ("polynomial", "polynomial + feedback")
    assert (free.feedback, closed.feedback) == (False, True)
    assert closed.plan is free.plan
    assert closed.replay.effort is not None
    assert closed.effort == np.median(closed.replay.effort) == pytest.approx(2 * 0.1**2 * 1.0)
    assert closed.peak_u == pytest.approx((0.1, 0.1), abs=0.005)
    joints = closed.replay.q[:, :, 1:]
    paths = np.linalg.norm(np.diff(joints, axis=1), axis=2).sum(axis=1)
    assert closed.path_length == pytest.approx(np.median(paths))
    assert closed.path_length < 0.5 * free.path_length == 0.5 * free.plan.path_length
    assert closed.E_median_deg > free.E_median_deg
    assert list(result.plans) == ["polynomial"]
    assert "effort" in result.figures()


def test_feedback_may_be_asked_for_one_plan(
    quick: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = sys.modules["planner.machine.replay"]
    monkeypatch.setattr(module, "feedback_of", lambda plan, on: _Held() if on else None)
    result = planner.compare(quick, "polynomial + feedback,sinusoid", samples=3)
    labels = ["polynomial", "polynomial + feedback", "sinusoid"]
    assert [row.label for row in result.rows] == labels


def test_a_plan_that_feedback_cannot_follow_is_refused_with_the_reason(
    quick: planner.Problem,
) -> None:
    problem = quick.changed({"goal.duration": 10.0, "machine.velocity_limit_rad_s": 0.05})
    result = planner.compare(problem, ["polynomial"], samples=2, feedback=True)
    free, closed = result.rows
    assert free.replay is not None
    assert closed.replay is None
    assert not closed.solved
    assert closed.why.endswith("rad/s, allowed 0.05 rad/s")
    assert np.isnan(closed.effort)
    assert {"effort", "inputs"} <= set(result.figures())
    assert free.plan is not None
    with pytest.raises(planner.InputError, match=r"u2 .* \S+ rad/s.* 0\.05 rad/s.*retime"):
        planner.replay(free.plan, feedback=True)


class _Held:
    """Feedback that only ever says 0.1 rad/s."""

    period_s, tick_s, lead_s, end_s = 0.1, 0.1, 0.0, 1.0
    fallbacks = np.zeros((), dtype=np.int64)  # of however many samples

    def start(self, plan: object, machine: object, numbers: object) -> _Held:
        return self

    def __call__(self, t: float, measured: np.ndarray) -> np.ndarray:
        return np.full((1, 2, measured.shape[1]), 0.1)


@pytest.mark.parametrize("doing", ["planning", "replaying"])
def test_ctrl_c_keeps_what_is_done(quick: planner.Problem, doing: str) -> None:
    specs = ["polynomial", "polynomial:travel=middle"]

    def press(what: str, share: float) -> None:
        if what == f"{doing} {specs[1]}":
            raise KeyboardInterrupt

    result = planner.compare(quick, specs, samples=2, progress=press)
    assert not result.complete
    assert result.rows[0].replay is not None
    assert [row.label for row in result.rows] == specs[: 1 if doing == "planning" else 2]
    if doing == "replaying":
        assert result.rows[1].plan is not None
        assert result.rows[1].replay is None
    assert "Partial: interrupted" in result.markdown()
    assert result.to_dict()["complete"] is False


def test_ctrl_c_before_anything_is_done_is_as_usual(quick: planner.Problem) -> None:
    def press(what: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        planner.compare(quick, ["polynomial"], samples=2, progress=press)


def test_the_reason_of_a_row_is_one_line_without_file_and_list(
    unlimited: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(problem: planner.Problem, options: object) -> planner.Plan:
        raise planner.NotConvergedError(
            "it takes\n10.98 s", source=problem.source, list_head=". In 10 s it breaks:"
        )

    monkeypatch.setitem(METHODS, "polynomial", replace(METHODS["polynomial"], plan=refuse))
    row = planner.compare(unlimited, ["polynomial"], samples=2).rows[0]
    assert row.why == "it takes 10.98 s"


def test_of_many_machines_a_comparison_keeps_the_errors_and_some_motions(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = paper.changed({"machine.step_s": 0.01, "feedback.run_up": False})
    whole = planner.compare(problem, [OPTIMAL], samples=9, feedback=True)
    monkeypatch.setattr(compare_module, "KEPT_MOTIONS", 2)
    some = planner.compare(problem, [OPTIMAL], samples=9, feedback=True)
    for one, other in zip(whole.rows, some.rows, strict=True):
        assert len(other.replay.q) == 2
        assert other.replay.to_dict() == one.replay.to_dict()
        assert (other.peak_u, other.E_p95_deg) == (one.peak_u, one.E_p95_deg)
    assert replay_data(some) == replay_data(whole)
    assert "replay" in some.figures()
