"""Figures that README, docs and problem files tell are those of results/ and of the methods."""

from __future__ import annotations

import re
import shlex
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.cli.app import COMMANDS
from planner.cli.arguments import read_problem
from planner.paper.reproduce import MISPRINTS
from planner.support.package import provenance

ROOT = Path(__file__).parents[1]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def table(page: str, head: str) -> list[list[str]]:
    """The rows of the Markdown table whose head begins so."""
    text = page[page.index(f"| {head}") :].split("\n\n")[0]
    return [
        [cell.strip() for cell in line.strip("| ").split("|")] for line in text.splitlines()[2:]
    ]


@pytest.mark.parametrize("folder", sorted(p.name for p in (ROOT / "results").iterdir()))
def test_a_page_names_its_command_and_version(folder: str) -> None:
    """In the folder's README, or in the table beside it that the command writes."""
    text = "\n".join(p.read_text("utf-8") for p in (ROOT / "results" / folder).glob("*.md"))
    commands = re.findall(r"(?:^    |`)(planner|make|python) ([\w/.]+)", text, flags=re.M)
    known = {"make": re.findall(r"^(\w+): ", read("Makefile"), flags=re.M), "planner": COMMANDS}
    assert any(
        (ROOT / what).is_file() if program == "python" else what in known[program]
        for program, what in commands
    )
    assert re.search(r"(?:commit|[Vv]ersions?:?) [0-9a-f]{7}\b", text)


def test_a_page_is_signed_with_the_commit_that_changed_the_package() -> None:
    """And, outside a checkout under git, with the version alone."""
    asked = ["git", "log", "-1", "--format=%h", "--abbrev=7", "--", "planner"]
    found = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    commit = found.stdout.strip()
    signed = f"planner {planner.__version__}" + (f", commit {commit}" if commit else "")
    assert provenance("make suite") == f"Made with {signed} by\n\n    make suite"


def test_the_readme_counts_the_random_problems_as_their_page_does() -> None:
    found = re.search(r"\*\*(\d+ of \d+) verified\*\*", read("results/stress/README.md"))
    assert found
    assert f"{found[1]} random problems" in " ".join(read("README.md").split())


def test_the_readme_tells_the_least_peak_of_the_plain_polynomial(paper: planner.Problem) -> None:
    with pytest.raises(planner.NoPlanError) as refused:
        planner.solve(paper, "polynomial")
    (broken,) = refused.value.violations
    assert f"best travel | no: input u2 reaches {broken.value:.3g} rad/s" in read("README.md")
    assert f"u2 reaches {broken.value:.2f} rad/s near" in read("docs/howto/explore.md")


@pytest.mark.campaign
def test_the_suite_shows_every_problem_and_todays_travels() -> None:
    """Of the page as `make suite` left it: to be run after that."""
    rows = {row[0].split()[0]: row[1:] for row in table(read("results/suite/README.md"), "problem")}
    assert set(rows) == {path.stem for path in (ROOT / "problems").glob("*.toml")}
    methods = [name for name, m in planner.METHODS.items() if m.refines is None]
    problem = planner.load_problem(ROOT / "problems/paper.toml")
    for name in ("collocation", "convex"):
        plan = planner.solve(problem, name)
        assert rows["paper"][methods.index(name)] == f"travel {plan.travel:.4g}"


README_ROWS = {
    "collocation compensated": "collocation compensated",
    "polynomial, best travel": "polynomial",
    "polynomial, points chosen": "polynomial:points=auto",
    "sinusoid": "sinusoid",
    "collocation": "collocation",
    'collocation, `end="machine"`; E from its predicted motion': "collocation:end=machine",
    "collocation compensated, with feedback": "collocation compensated + feedback",
}


def compared() -> dict[str, list[str]]:
    """The rows of results/compare by label."""
    page = table(read("results/compare/README.md").replace("\\|", ""), "method | solved")
    return {row[0].strip("`"): row for row in page}


def test_the_readme_has_the_table_of_the_comparison() -> None:
    """Row by row, to the digits that it shows; a refused plan by its reason."""
    told, page = table(read("README.md"), "method | solved"), compared()
    assert [row[0] for row in told] == [*README_ROWS]
    assert [README_ROWS[row[0]] for row in told] == [
        label for label in page if label in README_ROWS.values()
    ]
    assert {row[1].split(", ")[-1] for row in page.values() if row[1].startswith("yes:")} == {
        "0 % a physical one"  # which README says below the table
    }
    for mine in told:
        row = page[README_ROWS[mine[0]]]
        assert mine[1] == row[1].split(": ")[0] if row[1].startswith("yes") else row[1]
        shown = [cell for cells in mine[2:] for cell in cells.split(", ")]
        for short, full in zip(shown, [row[3], row[4], *row[8:12]], strict=True):
            assert f"{float(full):.{len(short.partition('.')[2])}f}" == short


def test_the_readme_tells_what_accuracy_costs() -> None:
    """Times the time and the effort of the plain plan, and of the methods that it leaves out."""
    text, page = " ".join(read("README.md").split()), compared()
    plain = page["collocation"]
    told = re.findall(r"for ([\d.]+) times the time and ([\d.]+) times the effort", text)
    told += re.findall(r"in the (same) time for ([\d.]+) times the effort", text)
    labels = [
        f"collocation{how}" for how in (" compensated", " compensated + feedback", ":end=machine")
    ]
    for label, words in zip(labels, told, strict=True):
        shares = [float(page[label][k]) / float(plain[k]) for k in (3, 4)]
        assert [float(w.replace("same", "1")) for w in words] == pytest.approx(shares, abs=0.051)
    others = [page["polynomial compensated:points=auto"], page["sinusoid compensated"]]
    efforts = " and ".join(f"{float(row[4]):.2f}" for row in others)
    assert f"polynomial and sinusoid err alike, with effort {efforts}" in text
    for row in others:
        assert float(row[8]) == pytest.approx(float(page["collocation compensated"][8]), rel=0.03)


@pytest.mark.campaign
def test_the_readme_tells_the_errors_with_inertia(paper: planner.Problem) -> None:
    """By the command below them."""
    dynamic = paper.changed({"machine.fidelity": "dynamic"})
    row = planner.compare(dynamic, ["collocation compensated"], samples=200)[
        "collocation compensated"
    ]
    told = f"With inertia E is {row.E_median_deg:.2f} and {row.E_p95_deg:.2f} deg"
    assert told in " ".join(read("README.md").split())


def test_the_theory_tells_what_the_calibration_found() -> None:
    page, told = read("results/calibration/README.md"), " ".join(read("docs/theory.md").split())
    found = re.search(r"\| the paper's words \| \d+ \| 1 of (\d+) \|", page)
    assert found
    assert f"three statements fix one combination of the {found[1]} parameters" in told
    sizes = re.findall(r"^\| largest error of theta[32] .* \| ([\d.]+) deg \|$", page, flags=re.M)
    assert f"theta2 comes to {sizes[1]} and theta3 to {sizes[0]} degrees" in told


def test_the_mean_offset_is_as_poor_as_it_is_said_to_be() -> None:
    """Step 4 of the paper, on a unicycle that is to move one metre sideways."""
    problem = planner.Problem.from_dict(
        {
            "system": {"kind": "unicycle"},
            "start": {"x_m": 0.0, "y_m": 0.0, "heading_deg": 10},
            "goal": {"x_m": 0.0, "y_m": 1.0, "heading_deg": 10, "duration": 10.0},
        }
    )
    mean, ours = (
        np.max(planner.solve(problem, "polynomial", offset=rule).peak_u)
        for rule in ("mean", "auto")
    )
    (step,) = (ours for where, _, ours in MISPRINTS if where == "step 4")
    for text in (step, read("docs/theory.md")):
        assert f"{mean:.1f} rad/s" in text
        assert f"{ours:.3f}" in text


@pytest.mark.parametrize("name", ["paper", "z2-limit", "unreachable"])
def test_k_g_is_the_printed_square_and_no_path_depends_on_it(name: str) -> None:
    problem = planner.load_problem(ROOT / f"problems/{name}.toml")
    system = problem.system
    assert isinstance(system, planner.Manipulator)
    square = (system.K[1] / system.K[0]) ** 2
    assert system.k_g == 0.668811
    assert f"{square:.6f}" in read("problems/paper.toml")
    assert system.k_g == pytest.approx(square, rel=1e-4)
    other = planner.Manipulator(system.K, float(np.sqrt(square)))
    q = np.array([0.0, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(system.slopes(q), other.slopes(q))


def test_the_angle_to_stand_clear_of_is_the_largest_of_the_whole_motion(
    paper: planner.Problem,
) -> None:
    """Swing and plan, on machines, wherever it is told; the notebook prints its own."""
    plan = planner.compensate(planner.solve(paper, "collocation"))
    runs = [planner.replay(plan, samples=100, feedback=on) for on in (False, True)]
    largest = [np.rad2deg(run.q[:, :, 1].max()) for run in runs]
    for page, words in (
        ("README.md", r"joint 1\s+comes up to (\d+)° \((\d+)° with feedback\)"),
        ("docs/howto/bench.md", r"joint 1 comes up to (\d+)° on .* and to (\d+)° with a contr"),
    ):
        (told,) = re.findall(words, read(page))
        assert [int(each) for each in told] == [np.ceil(each) for each in largest]
    early = plan.q(np.linspace(0.0, plan.lead_s, 401))[:, 1]
    assert early.max() - early[0] > 0.5  # it swings,
    assert early[-1] - early[0] < 0.5  # and comes back


def test_the_excitation_reverses_as_often_as_is_told(paper: planner.Problem) -> None:
    motion = planner.excitation(paper)
    u1 = motion.u(np.linspace(0.0, motion.duration, 30_001))[:, 0]
    signs = np.sign(u1[np.abs(u1) > 1e-6])
    assert np.count_nonzero(np.diff(signs)) == 11
    assert "reverses the drive eleven times" in read("docs/howto/bench.md")


def test_the_explorers_travel_is_in_the_domain(paper: planner.Problem) -> None:
    low, high = re.findall(
        r"\*travel\* from ([\d.]+) up to ([\d.]+)", read("docs/howto/explore.md")
    )[0]
    for travel in (low, high):
        free = paper.changed({"limits": {}}).with_travel(float(travel))
        assert planner.solve(free, "polynomial").domain.ok


@pytest.mark.parametrize("path", sorted((ROOT / "problems").glob("*.toml")), ids=lambda p: p.stem)
def test_commands_in_problem_files_are_accepted(path: Path) -> None:
    told = re.findall(r"^# *planner (.*)$", path.read_text("utf-8"), flags=re.M)
    for command in told:
        name, file, *options = shlex.split(command)
        assert name in COMMANDS
        sets = [value for key, value in pairwise(options) if key == "--set"]
        read_problem(ROOT / file, sets)


def test_gear_constants_of_the_prototype_continue_by_one_rule() -> None:
    for name in ("four-joint", "self-collision"):
        K = planner.load_problem(ROOT / f"problems/{name}.toml").system.K
        assert K[2] == pytest.approx(K[1] ** 2 / K[0], abs=5e-7)
