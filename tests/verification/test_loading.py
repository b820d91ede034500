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
from compared import quick_comparison

import planner
from planner.cli.app import main
from planner.plan.measures import objective_of
from planner.report import folders as report_folder
from planner.report.page.page import write_report
from planner.report.saved import load_comparison

Edit = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def law(paper: planner.Problem) -> planner.Plan:
    """A plan in chained coordinates, with limits on inputs and joints."""
    slow = {"goal.duration": 40.0, "goal.travel": 0.8286}
    return planner.solve(paper.changed(slow), "polynomial")


@pytest.fixture(scope="module")
def optimal(paper: planner.Problem) -> planner.Plan:
    """A plan in coordinates and inputs."""
    return planner.solve(paper, "collocation")


@pytest.fixture(scope="module")
def retimed(optimal: planner.Plan) -> planner.Plan:
    return planner.retime(optimal)


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
    assert (back.verified, back.status, back.why) == (True, "solved", "")
    assert back.certificate == plan.certificate
    assert back.save(tmp_path / "y.json").read_bytes() == path.read_bytes()


def test_coefficients_times_one_and_a_half(plan: planner.Plan, tmp_path: Path) -> None:
    path = edited(plan, tmp_path / "x.json", times(1.5))
    back = planner.load_plan(path)
    assert (back.verified, back.status, back.certificate) == (False, "verification_failed", None)
    assert "allowed" in back.why
    more = len(planner.verify(back).violations) - 1
    assert back.why.endswith(f" (and {more} more)" if more else "")
    assert f"not verified, status verification_failed: {back.why}" in repr(back)
    again = planner.load_plan(back.save(tmp_path / "y.json"))
    assert (again.verified, again.status, again.why) == (False, back.status, back.why)
    with pytest.raises(planner.InputError, match=r"x\.json is marked as a verified plan, but"):
        planner.load_plan(path, strict=True)


def _input_limit(data: dict[str, Any]) -> None:
    data["problem"]["limits"] = {"input_rad_s": 1e-3}


def _last(data: dict[str, Any], name: str, value: object) -> None:
    curve(data, name)["bernstein"][-1][-1][-1] = value


EDITS: dict[str, tuple[Edit, str]] = {
    "a limit of the problem": (_input_limit, "input u[12] reaches"),
    "the goal": (lambda d: d["problem"]["goal"].update(theta_deg=[30, 30, 31]), "goal theta3"),
    "the start": (lambda d: d["problem"]["start"].update(theta_deg=[1, 1, 2]), "goal|start|plan's"),
    "the system": (lambda d: d["problem"]["system"].update(K=[0.9, 0.8]), "goal theta|start"),
    "a claim of the certificate": (
        lambda d: d["certificate"]["claims"][0].update(status="proven", guaranteed=9.0),
        "",
    ),
    "one coefficient is null": (lambda d: _last(d, "v", None), "v_curve hold numbers that are not"),
    "a lower degree": (lambda d: curve(d, "z")["bernstein"].pop(), "reaches"),
    "breaks stretched": (
        lambda d: [curve(d, n).update(breaks=[0.0, 80.0]) for n in "zv"],
        "duration",
    ),
    "the branch": (lambda d: d["trajectory"]["branch"].__setitem__(1, -1.0), "reaches"),
}


@pytest.mark.parametrize(("edit", "says"), EDITS.values(), ids=EDITS.keys())
def test_what_the_file_says_is_not_believed(
    law: planner.Plan, tmp_path: Path, edit: Edit, says: str
) -> None:
    back = planner.load_plan(edited(law, tmp_path / "x.json", edit))
    if says:
        assert (back.verified, back.certificate) == (False, None)
        assert re.search(says, back.why)
    else:
        assert (back.verified, back.certificate) == (True, law.certificate)


SHAPES: dict[str, tuple[Edit, str]] = {
    "breaks that go back": (lambda d: curve(d, "q")["breaks"].reverse(), "breaks"),
    "a break twice": (
        lambda d: curve(d, "q")["breaks"].__setitem__(1, 0.0),
        "must increase",
    ),
    "a first break that is not 0": (
        lambda d: curve(d, "q")["breaks"].__setitem__(0, 1e-3),
        "must increase",
    ),
    "other breaks of u": (
        lambda d: curve(d, "u")["breaks"].__setitem__(1, 1e-3),
        "must have the same breaks",
    ),
    "a piece less": (lambda d: [row.pop() for row in curve(d, "u")["bernstein"]], "x and c|`?c"),
    "a coordinate less": (
        lambda d: [piece.pop() for row in curve(d, "q")["bernstein"] for piece in row],
        r"q_curve must have real values of shape \(4,\), not \(3,\)",
    ),
    "a ragged list": (lambda d: curve(d, "q")["bernstein"][0][0].pop(), "inhomogeneous"),
    "no coefficients": (lambda d: curve(d, "q").update(bernstein=[]), "q_curve|dimension|c"),
    "a scalar": (lambda d: curve(d, "u").update(bernstein=[[0.0] * 99]), "u_curve|pieces|x"),
    "a number beyond all sense": (
        lambda d: _last(d, "u", -1e16),
        r"'trajectory\.u\.bernstein\[[0-9]\]\[[0-9]+\]\[1\]' = -1e\+16: must be at least -1e\+15",
    ),
    "a degree beyond all sense": (
        lambda d: curve(d, "u").update(bernstein=[curve(d, "u")["bernstein"][0]] * 52),
        "u_curve has degree 51; at most 50 is read",
    ),
    "a negative count": (
        lambda d: d.update(iterations=-5),
        "'iterations' = -5: must be at least 0",
    ),
    "a count of many digits": (lambda d: d.update(iterations=10**200), "'iterations' = 1000.*most"),
    "a negative time": (lambda d: d.update(solve_time_s=-1.0), "'solve_time_s' = -1.0: must be at"),
    "an objective beyond all sense": (
        lambda d: d.update(objective=1e300),
        "'objective' = 1e\\+300",
    ),
    "an infinite number": (lambda d: _last(d, "u", float("inf")), "trajectory.*finite"),
    "a system of another size": (
        lambda d: d["problem"].update(
            system={"kind": "manipulator", "joints": 2, "K": [0.9], "k_g": 1.0},
            start={"theta_deg": [1, 1]},
            goal={"theta_deg": [30, 30], "duration": 10.0},
        ),
        "q_curve must have real values|allowed|limits",
    ),
}


@pytest.mark.parametrize(("edit", "says"), SHAPES.values(), ids=SHAPES.keys())
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
    assert back.why.startswith("the clock goes from 0 to ")


def test_a_plan_that_never_claimed_to_be_one_keeps_its_status(
    paper: planner.Problem, tmp_path: Path
) -> None:
    fig5 = planner.load_problem(Path(paper.source).parent / "paper-fig5.toml")
    singular = planner.solve(fig5, "polynomial", allow_singular=True)
    back = planner.load_plan(singular.save(tmp_path / "x.json"), strict=True)
    assert (back.verified, back.status, back.why) == (False, "singular", "")
    with pytest.raises(planner.VerificationError) as caught:
        planner.solve(paper.changed({"goal.travel": 0.82}), "polynomial")
    refused = caught.value.plan
    assert refused is not None
    back = planner.load_plan(refused.save(tmp_path / "y.json"), strict=True)
    assert (back.verified, back.status, back.why) == (False, "verification_failed", "")
    # An edited one may not borrow a certificate either.
    lying = replace(refused, certificate=planner.certify(planner.solve(paper)))
    back = planner.load_plan(lying.save(tmp_path / "z.json"))
    assert back.certificate is not None
    assert not back.certificate.ok


@pytest.mark.parametrize(
    "words",
    [
        ["export", "{}", "--out", "{out}.csv"],
        ["export", "{}", "--out", "{out}.json"],
        ["export", "{}", "--out", "{out}.mat"],
        ["animate", "{}", "--out", "{out}.gif"],
        ["sensitivity", "{}", "--no-machine"],
        ["budget", "{}"],
    ],
    ids=lambda words: " ".join(words[:1] + words[3:4]),
)
def test_commands_refuse_it(
    law: planner.Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    pytest.importorskip("SALib")
    path, out = edited(law, tmp_path / "x.json", times(1.5)), tmp_path / "out"
    words = [w.replace("{}", str(path)).replace("{out}", str(out)) for w in words]
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
    """Of all that are a sum of duration and efforts; 0.3 % less is as false as nothing."""
    for false in (1e-3, 0.997 * plan.objective):
        path = edited(plan, tmp_path / "x.json", lambda d, x=false: d.update(objective=x))  # type: ignore[misc]
        with pytest.warns(planner.InputWarning, match=r"x\.json: the objective is said to be"):
            back = planner.load_plan(path, strict=True)
        assert back.verified
        assert back.objective == pytest.approx(plan.objective, rel=1e-12)
    close = plan.objective * (1 + 1e-6)
    path = edited(plan, tmp_path / "x.json", lambda d: d.update(objective=close))
    assert planner.load_plan(path).objective == close


@pytest.mark.parametrize(
    "changes",
    [
        {"goal.duration": "free", "limits.input_rad_s": [0.1234567, 0.7654321]},
        {"goal.duration": "free", "method.collocation": {"objective": "mixed"}},
    ],
    ids=["time", "mixed"],
)
def test_objectives_of_time_are_told_by_their_names(
    paper: planner.Problem, changes: dict[str, Any]
) -> None:
    plan = planner.solve(paper.changed(changes))
    found = objective_of(plan.trajectory, plan.objective_name)
    assert found == pytest.approx(plan.objective, rel=1e-6)


def test_what_no_motion_tells_is_no_objective_of_it(optimal: planner.Plan) -> None:
    for name in (
        "smooth: integral of (du1/dt)^2 + (du2/dt)^2 dt",
        "mixed: duration + 0.5 x integral of (du1/dt)^2 + (du2/dt)^2 dt",
        "time: duration + 1 x integral of u1^2 dt + peak |v2|",
        "duration",
        "",
    ):
        assert objective_of(optimal.trajectory, name) is None


# -- comparison folders --------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(report_folder, "_write_figures", lambda *_: None)
    return quick_comparison().save(tmp_path / "paper")


def _limits_widened(data: dict[str, Any]) -> None:
    data["problem"]["limits"]["input_rad_s"] = [9.0, 9.0]


def _not_verified(data: dict[str, Any]) -> None:
    data["verified"] = False


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (times(1.5), "allowed"),
        (_limits_widened, "made for another problem"),
        (_not_verified, "no verified plan is there"),
    ],
)
def test_a_plan_in_a_folder_is_judged_too(
    saved: Path, capsys: pytest.CaptureFixture[str], edit: Edit, says: str
) -> None:
    path = saved / "plans/polynomial.json"
    data = json.loads(path.read_text())
    edit(data)
    path.write_text(json.dumps(data))
    found = load_comparison(saved)
    row = found["polynomial"]
    assert not row.solved
    assert row.why.startswith("plans/polynomial.json was changed after it was made: ")
    assert says in row.why
    assert np.isnan(row.E_median_deg)
    before = quick_comparison().rows[0]
    assert (found.rows[0].why, found.rows[0].plan.status) == (before.why, before.plan.status)  # type: ignore[union-attr]
    with pytest.raises(planner.InputError, match=says):
        write_report(saved)
    assert main(["report", str(saved)]) == 2
    assert says in capsys.readouterr().err
    assert not (saved / "report.html").exists()
