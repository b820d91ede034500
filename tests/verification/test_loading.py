"""A plan read from a file is believed only after it was judged."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import main
from compared import quick_comparison
from scipy.io import loadmat

import planner
from planner.plan import measures
from planner.plan.trajectory import StateTrajectory
from planner.support.calculus import bernstein
from planner.support.calculus.bernstein import Bernstein

PROBLEMS = Path(__file__).parents[2] / "problems"
Edit = Callable[[dict[str, Any]], object]


@pytest.fixture(params=["law", "optimal", "retimed"])
def plan(request: pytest.FixtureRequest) -> planner.Plan:
    found: planner.Plan = request.getfixturevalue(request.param)
    return found


def edited(plan: planner.Plan, path: Path, edit: Edit) -> Path:
    """The plan's file, changed by hand."""
    data = json.loads(plan.save(path).read_text())
    edit(data)
    path.write_text(json.dumps(data))
    return path


def curve(data: dict[str, Any], name: str) -> dict[str, Any]:
    """One curve of a file's trajectory, or of the path it retimes."""
    trajectory = data["trajectory"]
    found: dict[str, Any] = trajectory.get("path", trajectory)[name]
    return found


def times(factor: float) -> Edit:
    """All coefficients of the innermost curves times a factor."""

    def edit(data: dict[str, Any]) -> None:
        for name in ("q", "u", "z", "v"):
            if name in data["trajectory"].get("path", data["trajectory"]):
                own = curve(data, name)
                own["bernstein"] = (factor * np.array(own["bernstein"])).tolist()

    return edit


def test_a_plan_left_alone_is_believed_to_the_last_bit(plan: planner.Plan, tmp_path: Path) -> None:
    path = plan.save(tmp_path / "x.json")
    back = planner.load_plan(path, strict=True)
    assert (back.verified, back.status, back.violation) == (True, "solved", "")
    assert back.certificate == plan.certificate
    assert back.save(tmp_path / "y.json").read_bytes() == path.read_bytes()


def test_coefficients_times_one_and_a_half(plan: planner.Plan, tmp_path: Path) -> None:
    path = edited(plan, tmp_path / "x.json", times(1.5))
    back = planner.load_plan(path)
    assert (back.verified, back.status, back.certificate) == (False, "verification_failed", None)
    assert "allowed" in back.violation
    more = len(planner.verify(back).violations) - 1
    assert back.violation.endswith(f" (and {more} more)" if more else "")
    assert f"not verified, status verification_failed: {back.violation}" in repr(back)
    again = planner.load_plan(back.save(tmp_path / "y.json"))
    assert (again.verified, again.status, again.violation) == (False, back.status, back.violation)
    with pytest.raises(planner.InputError, match=r"x\.json is marked as a verified plan, but"):
        planner.load_plan(path, strict=True)


def put(place: str, value: object) -> Edit:
    """Sets what is at a place, such as trajectory.q.breaks.1."""

    def edit(data: Any) -> None:
        *path, last = [int(w) if w.lstrip("-").isdigit() else w for w in place.split(".")]
        for word in path:
            data = data[word]
        data[last] = value

    return edit


GOAL = "goal theta|start|plan's"
EDITS: list[tuple[Edit, str]] = [
    (put("problem.limits", {"input_rad_s": 1e-3}), "input u[12] reaches"),
    (put("problem.goal.theta_deg", [30, 30, 31]), "goal theta3"),
    (put("problem.start.theta_deg", [1, 1, 2]), GOAL),
    (put("problem.system.K", [0.9, 0.8]), GOAL),
    (put("certificate.claims.0.guaranteed", 9.0), ""),
    (put("trajectory.v.bernstein.-1.-1.-1", None), "v_curve hold numbers that are not"),
    (lambda d: curve(d, "z")["bernstein"].pop(), "reaches"),
    (lambda d: [curve(d, n).update(breaks=[0.0, 80.0]) for n in "zv"], "duration"),
    (put("trajectory.branch.1", -1.0), "reaches"),
]


@pytest.mark.parametrize(("edit", "says"), EDITS)
def test_what_the_file_says_is_not_believed(
    law: planner.Plan, tmp_path: Path, edit: Edit, says: str
) -> None:
    back = planner.load_plan(edited(law, tmp_path / "x.json", edit))
    if says:
        assert (back.verified, back.certificate) == (False, None)
        assert re.search(says, back.violation)
    else:
        assert (back.verified, back.certificate) == (True, law.certificate)


LAST = "trajectory.u.bernstein.-1.-1.-1"
TWO_JOINTS = {
    "system": {"kind": "manipulator", "joints": 2, "K": [0.9], "k_g": 1.0},
    "start": {"theta_deg": [1, 1]},
    "goal": {"theta_deg": [30, 30], "duration": 10.0},
}
SHAPES: list[tuple[Edit, str]] = [
    (lambda d: curve(d, "q")["breaks"].reverse(), "breaks"),
    (put("trajectory.q.breaks.1", 0.0), "must increase"),
    (put("trajectory.q.breaks.0", 1e-3), "must increase"),
    (put("trajectory.u.breaks.1", 1e-3), "must have the same breaks"),
    (lambda d: [row.pop() for row in curve(d, "u")["bernstein"]], "x and c|`?c"),
    (
        lambda d: [piece.pop() for row in curve(d, "q")["bernstein"] for piece in row],
        r"q_curve must have real values of shape \(4,\), not \(3,\)",
    ),
    (lambda d: curve(d, "q")["bernstein"][0][0].pop(), "inhomogeneous"),
    (put("trajectory.q.bernstein", []), "q_curve|dimension|c"),
    (put("trajectory.u.bernstein", [[0.0] * 99]), "u_curve|pieces|x"),
    (put(LAST, -1e16), r"'trajectory\.u\.bernstein\[\d\]\[\d+\]\[1\]' = -1e\+16: .* least -1e\+15"),
    (put(LAST, float("inf")), "trajectory.*finite"),
    (put("iterations", -5), "'iterations' = -5: must be at least 0"),
    (put("iterations", 10**200), "'iterations' = 1000.*most"),
    (put("solve_time_s", -1.0), r"'solve_time_s' = -1\.0: must be at"),
    (put("aim", {"kind": "time", "terms": {"duration": float("nan")}}), "aim.terms.duration"),
    (put("aim", {"kind": "time", "terms": {str(k): 1 for k in range(99)}}), "aim.terms"),
    (put("objective", 1e300), r"'objective' = 1e\+300"),
    (lambda d: d["problem"].update(TWO_JOINTS), "q_curve must have real values|allowed|limits"),
]


@pytest.mark.parametrize(("edit", "says"), SHAPES)
def test_what_cannot_be_evaluated_is_refused(
    optimal: planner.Plan, tmp_path: Path, edit: Edit, says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.load_plan(edited(optimal, tmp_path / "x.json", edit))


def test_a_clock_cut_in_half_says_so(retimed: planner.Plan, tmp_path: Path) -> None:
    def edit(data: dict[str, Any]) -> None:
        clock = data["trajectory"]["clock"]
        clock["bernstein"] = (0.5 * np.array(clock["bernstein"])).tolist()

    back = planner.load_plan(edited(retimed, tmp_path / "x.json", edit))
    assert not back.verified
    assert back.violation.startswith("the clock goes from 0 to ")


def test_a_plan_that_never_claimed_to_be_one_keeps_its_status(
    paper: planner.Problem, tmp_path: Path
) -> None:
    fig5 = planner.load_problem(Path(paper.source).parent / "paper-fig5.toml")
    singular = planner.solve(fig5, "polynomial", allow_singular=True)
    back = planner.load_plan(singular.save(tmp_path / "x.json"), strict=True)
    assert (back.verified, back.status, back.violation) == (False, "singular", "")
    with pytest.raises(planner.VerificationError) as caught:
        planner.solve(paper.changed({"goal.travel": 0.82}), "polynomial")
    refused = caught.value.plan
    assert refused is not None
    back = planner.load_plan(refused.save(tmp_path / "y.json"), strict=True)
    assert (back.verified, back.status, back.violation) == (False, "verification_failed", "")
    # An edited one may not borrow a certificate either.
    lying = replace(refused, certificate=planner.certify(planner.solve(paper)))
    back = planner.load_plan(lying.save(tmp_path / "z.json"))
    assert back.certificate is not None
    assert not back.certificate.ok


@pytest.mark.parametrize("command", ["export --out {}.mat", "animate --out {}.gif", "budget"])
def test_commands_refuse_it(
    law: planner.Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    pytest.importorskip("SALib")
    path = edited(law, tmp_path / "x.json", times(1.5))
    words = [*command.format(tmp_path / "out").split(), str(path)]
    assert main(words) == 2
    told = capsys.readouterr()
    assert "x.json is marked as a verified plan, but the plan fails the verification: " in told.err
    assert "allowed" in told.err
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]
    assert main([*words, "--json"]) == 2
    given = json.loads(capsys.readouterr().out)
    assert given["exit_status"] == 2
    assert "fails the verification" in given["error"]


# -- what a file says of its plan ----------------------------------------------------------------


def test_a_false_objective_is_corrected_with_a_warning(plan: planner.Plan, tmp_path: Path) -> None:
    """Of all that are a sum of duration and efforts; a hundred millionth is as false as all."""
    for false in (1e-3, (1 + 1e-8) * plan.objective):
        path = edited(plan, tmp_path / "x.json", put("objective", false))
        with pytest.warns(planner.InputWarning, match=r"x\.json: .* objective"):
            back = planner.load_plan(path, strict=True)
        assert back.verified
        assert back.objective == pytest.approx(plan.objective, rel=1e-12)
    close = plan.objective * (1 + 1e-10)
    path = edited(plan, tmp_path / "x.json", put("objective", close))
    assert planner.load_plan(path).objective == close


def test_an_objective_of_zero_is_right_where_nothing_turns(tmp_path: Path) -> None:
    straight = planner.load_problem(PROBLEMS / "unicycle.toml").changed({"goal.y_m": 0.0})
    plan = planner.solve(straight, "convex", objective="smooth", pieces=20)
    assert plan.objective == 0.0
    back = planner.load_plan(plan.save(tmp_path / "x.json"), strict=True)
    assert (back.objective, back.notes) == (0.0, plan.notes)


WEIGHTS = {"objective": "mixed", "smoothness_weight": 1 / 3, "edge_weight": 1.3}
OBJECTIVES: dict[str, dict[str, Any]] = {
    "time": {"goal.duration": "free", "limits.input_rad_s": [0.1234567, 0.7654321]},
    "mixed": {"goal.duration": "free", "method.collocation": {"objective": "mixed"}},
    "all terms": {"goal.duration": "free", "method.collocation": WEIGHTS},
    "smooth": {"method.collocation": {"objective": "smooth"}},
    "edge": {"method.collocation": {"objective": "edge"}},
    "edge, on a coarse mesh": {"method.collocation": {"objective": "edge", "intervals": 20}},
}


@pytest.mark.parametrize("changes", OBJECTIVES.values(), ids=OBJECTIVES.keys())
def test_every_objective_of_collocation_is_told_by_its_terms(
    paper: planner.Problem, tmp_path: Path, changes: dict[str, Any]
) -> None:
    plan = planner.solve(paper.changed(changes))
    true = planner.load_plan(plan.save(tmp_path / "true.json"))
    assert (true.objective, true.file_figures) == (plan.objective, ())
    path = edited(plan, tmp_path / "x.json", put("objective", 0.9 * plan.objective))
    with pytest.warns(planner.InputWarning, match="objective"):
        assert planner.load_plan(path).objective == pytest.approx(plan.objective, rel=1e-9)


def test_smoothness_and_closeness_are_their_integrals(paper: planner.Problem) -> None:
    """Beside sums over 200,001 times, which know neither pieces nor quadrature."""
    plan = planner.solve(paper.changed({"method.collocation": WEIGHTS, "goal.duration": "free"}))
    t = np.linspace(0.0, plan.duration, 200_001)
    slopes = np.diff(plan.u(t), axis=0) / np.diff(t)[:, None]
    near = np.exp(-np.abs(plan.trajectory.margins(t)) / 0.05).sum(axis=-1)
    effort = np.trapezoid(np.sum(plan.u(t) ** 2, axis=-1), t)
    smooth, close = np.sum(slopes**2) * t[1], np.trapezoid(near, t) / plan.duration
    total = plan.duration + effort + smooth / 3 + 1.3 * close
    assert plan.objective == pytest.approx(total, rel=1e-5)
    jumping = planner.solve(paper, input="constant").trajectory
    assert measures.Objective("smooth", {"smoothness": 1.0}).value(jumping) == np.inf


@pytest.mark.parametrize(
    ("aim", "name"),
    [
        (
            {"kind": "time", "terms": {"duration": 1, "comfort": 0.5}},
            "time: duration + 0.5 x comfort",
        ),
        ({"kind": "duration", "terms": {}}, "duration"),
        (None, "of an earlier version"),
    ],
)
def test_what_no_motion_tells_is_no_objective_of_it(
    optimal: planner.Plan, tmp_path: Path, aim: dict[str, Any] | None, name: str
) -> None:
    given = {"objective_name": "of an earlier version", "aim": aim, "objective": 1}
    path = edited(optimal, tmp_path / "x.json", lambda d: d.update(given))
    back = planner.load_plan(path)
    assert (back.objective, back.file_figures, back.objective_name) == (1, ("objective",), name)
    assert repr(back).endswith("verified, only its file says: objective)")


@pytest.mark.parametrize("objective", ["smooth", "peak"])
def test_a_false_proof_of_a_convex_plan_is_dropped(
    paper: planner.Problem, tmp_path: Path, objective: str
) -> None:
    plan = planner.solve(paper, "convex", objective=objective, pieces=20)
    true = planner.load_plan(plan.save(tmp_path / "true.json"))
    assert (true.objective, true.notes) == (plan.objective, plan.notes)
    assert (plan.file_figures, true.file_figures) == ((), ("notes.optimality",))
    false = edited(plan, tmp_path / "false.json", put("objective", 0.9 * plan.objective))
    with pytest.warns(planner.InputWarning, match="objective"):
        back = planner.load_plan(false)
    assert back.objective == pytest.approx(plan.objective, rel=1e-9)
    assert "optimality" not in back.notes
    assert back.file_figures == ()


def test_the_export_says_what_only_the_file_says(
    optimal: planner.Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def forge(data: dict[str, Any]) -> None:
        data.update(aim={"kind": "desensitised", "terms": {"passive block": 1}}, objective=1e-3)

    words = ["export", str(edited(optimal, tmp_path / "x.json", forge)), "--out"]
    assert main([*words, str(tmp_path / "x.csv")]) == 0
    assert "; only its file says: objective" in " ".join(capsys.readouterr().err.split())
    assert main([*words, str(tmp_path / "x.mat"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["claimed"], told["only_sampled"]) == (["objective"], [])
    about = loadmat(tmp_path / "x.mat", simplify_cells=True)["about"]
    assert about["claimed"] == "objective"


# -- what would take long -------------------------------------------------------------------------


def test_a_length_that_nearly_stands_still_is_not_integrated(
    retimed: planner.Plan, tmp_path: Path
) -> None:
    def still(data: dict[str, Any]) -> None:
        length = data["trajectory"]["length"]
        c = np.array(length["bernstein"])
        c[1:-1] = c[0] + 1e-12 * (c[-1] - c[0])
        length["bernstein"] = c.tolist()

    back = planner.load_plan(edited(retimed, tmp_path / "x.json", still))
    assert not back.verified
    assert back.violation.startswith("its length nearly stands still at 0 s of the path")


def test_a_file_of_many_pieces_is_refused(law: planner.Plan, tmp_path: Path) -> None:
    def cut(data: dict[str, Any]) -> None:
        own = curve(data, "z")
        own["breaks"] = np.linspace(0, own["breaks"][-1], 60_001).tolist()

    path = edited(law, tmp_path / "x.json", cut)
    with pytest.raises(planner.InputError, match=r" 60000 .* 100000 "):
        planner.load_plan(path)


def test_what_would_not_be_read_is_not_saved(
    optimal: planner.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = optimal.trajectory
    assert isinstance(path, StateTrajectory)
    monkeypatch.setattr(bernstein, "MOST_COEFFICIENTS", 1000)

    def of_pieces(count: int) -> planner.Plan:
        breaks = np.linspace(0.0, optimal.duration, count + 1)
        q, u = (
            Bernstein(np.repeat(f(breaks[:-1])[None], 2, axis=0), breaks) for f in (path.q, path.u)
        )
        cut = StateTrajectory(path.system, q, u)
        return replace(optimal, trajectory=cut, verified=False, certificate=None)

    back = planner.load_plan(of_pieces(500).save(tmp_path / "x.json"))
    assert len(back.t) == 501
    with pytest.raises(planner.InputError, match=r" 501 pieces"):
        of_pieces(501).save(tmp_path / "y.json")
    assert not (tmp_path / "y.json").exists()


# -- comparison folders --------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("planner.report.folders._write_figures", lambda *_: None)
    return quick_comparison().save(tmp_path / "paper")


def test_a_solved_row_without_a_plan_file_says_which_file_was_changed(saved: Path) -> None:
    path = saved / "comparison.json"
    data = json.loads(path.read_text())
    (row,) = (row for row in data["rows"] if row["label"] == "polynomial")
    row["plan_file"] = None
    path.write_text(json.dumps(data))
    assert planner.report.load_comparison(saved)["polynomial"].why == (
        "comparison.json was changed after it was made: no verified plan is there; compare again"
    )


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (times(1.5), "allowed"),
        (put("problem.limits.input_rad_s", [9.0, 9.0]), "its problem differs"),
        (put("verified", False), "no verified plan is there"),
    ],
)
def test_a_plan_in_a_folder_is_judged_too(
    saved: Path, capsys: pytest.CaptureFixture[str], edit: Edit, says: str
) -> None:
    path = saved / "plans/polynomial.json"
    data = json.loads(path.read_text())
    edit(data)
    path.write_text(json.dumps(data))
    found = planner.report.load_comparison(saved)
    row = found["polynomial"]
    assert not row.solved
    assert row.why.startswith("plans/polynomial.json was changed after it was made: ")
    assert says in row.why
    assert np.isnan(row.E_median_deg)
    before = quick_comparison().rows[0]
    assert (found.rows[0].why, found.rows[0].plan.status) == (before.why, before.plan.status)  # type: ignore[union-attr]
    with pytest.raises(planner.InputError, match=says):
        planner.report.write_report(saved)
    assert main(["report", str(saved)]) == 2
    assert says in capsys.readouterr().err
    assert not (saved / "report.html").exists()
