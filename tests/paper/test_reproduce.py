"""The reproduction of the paper: what is printed about it must be what the code computes."""

from pathlib import Path

import numpy as np
import pytest

from planner.paper.reproduce import FIGURES, Reproduction, reproduce


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    return reproduce(tmp_path_factory.mktemp("out") / "paper", samples=20, seed=0)


def test_every_figure_is_made_and_shown(made: Reproduction) -> None:
    page = (made.path / "README.md").read_text(encoding="utf-8")
    for name, _, _ in FIGURES:
        assert (made.path / f"{name}.png").stat().st_size > 10_000
        assert f"({name}.png)" in page
    assert {p.stem for p in made.path.glob("*.png")} == {name for name, _, _ in FIGURES}


def test_page_names_its_command(made: Reproduction) -> None:
    page = (made.path / "README.md").read_text(encoding="utf-8")
    assert "planner reproduce --out results/paper --samples 20 --seed 0" in page
    for finding in made.findings:
        assert finding.printed.replace("|", "\\|") in page


def test_verdicts(made: Reproduction) -> None:
    verdict = {(f.where, f.printed): f.verdict for f in made.findings}
    assert verdict["4.3, z2(T)", "-0.532"] == "misprint"
    assert verdict["Fig. 5", "and so avoids the singularities"] == "does not hold"
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


def test_scan_finds_pairs_that_keep_the_sign_and_none_inside() -> None:
    from planner.paper.numbers import scan

    found = scan(travels=31, times=19)
    assert found.tried > 100
    assert found.sign_kept > 0
    assert found.inside == 0


def test_machine_figures_are_of_the_prototype(made: Reproduction) -> None:
    error = np.median(made.cases.replay.largest_error_deg, axis=0)
    assert made.cases.replay.machine.preset == "prototype"
    assert 3.0 < error[2] < 7.0


def test_nothing_is_left_when_drawing_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    from planner.errors import InputError

    with pytest.raises(InputError, match="No space left"):
        reproduce(tmp_path / "paper", samples=1)
    assert list(tmp_path.iterdir()) == []
