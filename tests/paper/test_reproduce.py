"""The reproduction of the paper: what is printed about it must be what the code computes."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import planner
from planner import solve
from planner.paper import detours
from planner.paper.cases import paper_problem
from planner.paper.detours import (
    CROSSING_DETOURS,
    MISSING_ANGLE_DETOURS,
    Points,
    margins_at_paper_point,
)
from planner.paper.numbers import turned_ratio
from planner.paper.reproduce import FILM, PAPER_FIGURES, Reproduction, reproduce
from planner.report.film import LAST_FRAME_S


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """Called once for the same arguments, whoever calls."""
    known: dict[str, Any] = {}

    def call(*given: Any) -> Any:
        key = repr(given)
        if key not in known:
            known[key] = function(*given)
        return known[key]

    return call


detour, scan = once(detours.detour), once(detours.scan)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detours, "detour", detour)
        patch.setattr(detours, "scan", scan)
        patch.setattr(detours, "CROSSING_DETOURS", CROSSING_DETOURS[:1])
        patch.setattr(detours, "MISSING_ANGLE_DETOURS", MISSING_ANGLE_DETOURS[:1])
        return reproduce(tmp_path_factory.mktemp("out") / "paper", samples=20, seed=0)


def test_every_figure_is_made_and_shown(made: Reproduction) -> None:
    page = (made.path / "README.md").read_text(encoding="utf-8")
    for name, _, _ in PAPER_FIGURES:
        assert (made.path / f"{name}.png").stat().st_size > 10_000
        assert f"({name}.png)" in page
    assert {p.stem for p in made.path.glob("*.png")} == {name for name, _, _ in PAPER_FIGURES}


def test_the_film_shows_the_arm_at_twice_its_speed_and_is_small(made: Reproduction) -> None:
    path = made.path / FILM
    assert path.stat().st_size < 1.5e6
    assert f"({FILM})" in (made.path / "README.md").read_text(encoding="utf-8")
    with Image.open(path) as film:
        seconds = [film.seek(k) or film.info["duration"] / 1000 for k in range(film.n_frames)]
    assert sum(seconds) == pytest.approx(made.cases.valid.duration / 2 + LAST_FRAME_S, abs=0.1)
    efforts = [made.cases.best.effort, made.cases.valid.effort]
    assert made.cases.best.verified
    assert efforts[0] < efforts[1]


def test_page_names_its_command(made: Reproduction) -> None:
    page = (made.path / "README.md").read_text(encoding="utf-8")
    assert "planner reproduce --out results/paper --samples 20 --seed 0" in page
    for finding in made.findings:
        assert finding.printed.replace("|", "\\|") in page


def test_verdicts(made: Reproduction) -> None:
    verdict = {(f.where, f.printed): f.verdict for f in made.findings}
    assert verdict["4.3, z2(T)", "-0.532"] == "misprint"
    assert verdict["Fig. 5", "and so avoids the singularities"] == "does not hold"
    step5 = verdict["4.2, step 5", "constraint points lead around singularities"]
    assert step5 == "its point never; other points yes"
    assert sum(v == "agrees" for v in verdict.values()) >= 5


def test_the_findings_are_those_of_the_plans(made: Reproduction) -> None:
    free, point, valid = made.cases.free, made.cases.point, made.cases.valid
    assert len(free.domain.z2_crossings_s) == 2
    assert point.domain.z2_max < 0
    assert not point.executable
    assert valid.verified
    texts = " ".join(f.ours for f in made.findings)
    assert "0.78635 to 0.89664" in texts
    assert "cos^2(theta1) would have to reach 1.22" in texts
    assert "-0.5225" in texts
    assert "0 at theta1 = 0 and 0 at theta2 = 0" in texts
    assert texts.count("at pi/4, an inferred travel") == 4
    assert "0.8550 rad^2/s instead of 0.8326 with z2 up to +0.085" in texts
    error = np.median(made.cases.replay.largest_error_deg, axis=0)
    assert f"theta2, not reported in the paper: {error[1]:.1f} deg" in texts


def test_the_papers_law_is_no_more_sensitive_than_the_plan_of_least_effort(
    made: Reproduction,
) -> None:
    law, best = (
        planner.sensitivity(plan).passive_block_deg()
        for plan in (made.cases.valid, made.cases.best)
    )
    assert law == pytest.approx(best, rel=0.01)
    (closing,) = [f for f in made.findings if f.where == "5"]
    assert f"{law:.3f} deg for the paper's law and {best:.3f}" in closing.ours
    assert closing.verdict == "true of every plan alike"


def test_the_papers_own_point_leads_around_at_no_travel() -> None:
    assert np.max(margins_at_paper_point()) < -0.05


def test_its_value_leads_around_a_crossing_in_a_thin_strip_of_travels() -> None:
    found = scan()
    travels = found.inside[:, 0]
    assert found.trials > 1500
    assert 0.7929 < travels.min() < travels.max() < 0.79367  # there the plain cubic stays inside
    for travel, time in found.inside[[0, -1]]:
        assert detour(travel, [[time, -0.2]]).verified


@pytest.mark.parametrize(
    ("travel", "points"),
    [
        CROSSING_DETOURS[0],
        MISSING_ANGLE_DETOURS[0],
        *(
            pytest.param(*detour, marks=pytest.mark.campaign)
            for detour in CROSSING_DETOURS[1:] + MISSING_ANGLE_DETOURS[1:]
        ),
    ],
)
def test_other_points_lead_around(travel: float, points: Points) -> None:
    plain = solve(paper_problem(travel=travel), "polynomial", allow_singular=True)
    assert not plain.domain.ok
    assert bool(plain.domain.z2_crossings_s) == ((travel, points) in CROSSING_DETOURS)
    plan = detour(travel, points)
    assert plan.verified
    assert plan.notes["points"]


PAGE = Path(__file__).parents[2] / "results" / "paper" / "README.md"


def test_points_that_work_work_as_printed() -> None:
    """At the last digits of some, the path leaves the domain or needs three times the input."""
    way = r"travel ([\d.]+) by (\(.+?\)), ([\d.]+) rad/s"
    ways = re.findall(way, PAGE.read_text("utf-8"))
    assert len(ways) == len(CROSSING_DETOURS + MISSING_ANGLE_DETOURS)
    for travel, listed, peak in ways:
        points = [[float(x) for x in pair] for pair in re.findall(r"\((.+?), (.+?)\)", listed)]
        plan = detour(float(travel), points)
        assert plan.verified
        assert f"{np.max(plan.peak_u):.3g}" == peak


def test_21_has_lost_a_sign_and_is_another_power_at_the_last_joint() -> None:
    """Corrected as the page prints it, against differences of the slopes themselves."""
    arm, n, step = planner.Manipulator([0.8, 0.7, 0.6], 0.5), 4, 1e-6
    q = np.array([0.0, 0.3, 0.5, 0.7, 0.2])
    for i in range(2, n + 1):  # theta_i' depends on theta_(i-1)
        shift = step * np.eye(n + 1)[i - 1]
        slope = (arm.slopes(q + shift)[i - 2] - arm.slopes(q - shift)[i - 2]) / (2 * step)
        before, k = q[i - 1], arm.k_g * arm.K[i - 2]
        p = arm.k_g * np.prod(np.cos(q[i : n - 1]))
        last = -3 * k / arm.k_g * np.cos(before) ** 2 * np.sin(before)
        assert slope == pytest.approx(-k * np.sin(2 * before) / p if i < n else last, rel=1e-8)


def test_the_chart_needs_no_angle_at_the_last_joint(paper: planner.Problem) -> None:
    form = planner.chained_form(paper.system)
    q = np.array([0.1, 0.3, 0.4, 0.0])
    np.testing.assert_allclose(form.q(form.z(q), paper.system.branch(q)), q, atol=1e-14)
    assert np.min(paper.system.chart_margins(q, paper.system.branch(q))) > 0


def test_plain_disks_are_excluded_by_numbers(made: Reproduction) -> None:
    found = next(f for f in made.findings if f.where == "(6)")
    assert found.verdict == "does not hold"
    assert "0.866 instead of 0.955 at 10 deg" in found.ours
    degrees = np.array([0.0, 12.0, 25.0, 40.0])
    expected = np.maximum(np.cos(3 * np.deg2rad(degrees)), 0)
    assert turned_ratio(degrees, 1.0) == pytest.approx(expected, abs=1e-12)
    assert turned_ratio(degrees, 0.0, 0.5) == pytest.approx(np.cos(np.deg2rad(degrees)) ** 3)


def test_machine_figures_are_of_the_prototype(made: Reproduction) -> None:
    error = np.median(made.cases.replay.largest_error_deg, axis=0)
    assert made.cases.replay.machine.preset == "prototype"
    assert 3.0 < error[2] < 7.0


def test_nothing_is_left_when_drawing_fails(
    made: Reproduction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    known = {"cases": made.cases, "findings": list(made.findings), "figures": {"one": Figure()}}
    for name, value in known.items():
        monkeypatch.setattr(f"planner.paper.reproduce.{name}", lambda *_, value=value: value)
    with pytest.raises(planner.InputError, match="No space left"):
        reproduce(tmp_path / "paper", samples=1)
    assert list(tmp_path.iterdir()) == []
