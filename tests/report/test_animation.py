"""Films of plans: what they show, how long they last, and what is refused."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import main
from compared import outside
from PIL import Image

import planner
from planner.report import animate
from planner.report import film as video
from planner.support.package import how_to_install

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def plan(unlimited: planner.Problem) -> planner.Plan:
    return planner.solve(unlimited.changed({"goal.travel": 0.825}), "polynomial")


@pytest.fixture(scope="module")
def slow(plan: planner.Plan) -> planner.Plan:
    return replace(plan, trajectory=plan.trajectory.slowed(1.5))


def dark(picture: Any, left: int, right: int) -> set[tuple[int, int]]:
    """Dark pixels (the arm) between two columns."""
    grey = np.asarray(picture.convert("L"))
    rows, columns = np.nonzero(grey[60:-60, left:right] < 60)
    return set(zip(rows.tolist(), columns.tolist(), strict=True))


def test_a_gif_shows_two_plans_on_one_clock(
    plan: planner.Plan, slow: planner.Plan, tmp_path: Path
) -> None:
    told: list[tuple[int, int]] = []
    path = animate(
        {"one": plan, "other": slow},
        tmp_path / "x.gif",
        fps=3,
        speed=3.0,
        progress=lambda *at: told.append(at),
    )
    film = Image.open(path)
    longest = max(plan.duration, slow.duration)
    count = int(np.ceil(longest / 3 * 3)) + 1
    assert film.n_frames == count
    assert told == [(k + 1, count) for k in range(count)]
    durations = []
    arms = []
    for k in range(count):
        film.seek(k)
        durations.append(film.info["duration"])
        half = film.width // 2
        arms.append((dark(film, 60, half), dark(film, half + 20, film.width)))
    assert durations == [330] * (count - 1) + [330 * 4]
    for side, one in enumerate((plan, slow)):
        moving = [a[side] != b[side] for a, b in pairwise(arms)]
        arrived = int(np.ceil(one.duration / 3 * 3))
        assert all(moving[: arrived - 2]), "the arm moves until it arrives"
        assert not any(moving[arrived:]), "and stays there"
    film.close()


def test_the_arm_ends_on_its_goal(plan: planner.Plan, tmp_path: Path) -> None:
    animate(plan, tmp_path / "x.gif", fps=1, speed=5.0)
    with Image.open(tmp_path / "x.gif") as film:
        first = dark(film, 70, film.width)
        film.seek(film.n_frames - 1)
        last = dark(film, 70, film.width)
    spread = [max(c for _, c in pixels) - min(c for _, c in pixels) for pixels in (first, last)]
    assert spread[0] > 1.5 * spread[1], "stretched out at first, bent at the end"


def test_mp4_by_ffmpeg(plan: planner.Plan, tmp_path: Path) -> None:
    try:
        program = video.find_ffmpeg()
    except planner.InputError:
        pytest.skip("needs ffmpeg (extra: video)")
    path = animate(plan, tmp_path / "x.mp4", fps=10, speed=5.0)
    assert path.read_bytes()[4:8] == b"ftyp"
    done = subprocess.run([program, "-i", str(path)], capture_output=True, text=True, check=False)
    assert "h264" in done.stderr
    assert "yuv420p" in done.stderr
    assert "Duration: 00:00:03.10" in done.stderr  # 21 frames, the last one held for 10 more


def test_without_ffmpeg_an_mp4_is_refused_at_once(
    plan: planner.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    says = rf"needs ffmpeg.*{re.escape(how_to_install('video'))}.*\.gif"
    with pytest.raises(planner.InputError, match=says):
        animate(plan, tmp_path / "x.mp4")
    assert list(tmp_path.iterdir()) == []


def test_an_ffmpeg_that_fails_is_quoted(
    plan: planner.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "ffmpeg"
    broken.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda _: str(broken))
    with pytest.raises(planner.InputError, match=r"ffmpeg .*: no such codec"):
        animate(plan, tmp_path / "x.mp4", fps=5, speed=5.0)
    assert [p.name for p in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("x.avi", {}, r"must end in \.gif or \.mp4"),
        ("x.gif", {"fps": 0}, "fps = 0"),
        ("x.gif", {"fps": 61}, "fps = 61"),
        ("x.gif", {"speed": 0.0}, "speed = 0"),
        ("x.gif", {"speed": float("nan")}, "speed = nan"),
        ("x.gif", {"speed": 1e-4}, "raise the speed"),
    ],
)
def test_refusals(
    plan: planner.Plan, tmp_path: Path, name: str, options: dict[str, Any], says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        animate(plan, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_drawn(tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match="no executable plan"):
        animate(outside(), tmp_path / "x.gif")


def test_a_vehicle_drives(tmp_path: Path) -> None:
    plan = planner.solve(planner.load_problem(ROOT / "problems/unicycle.toml"), "polynomial")
    animate(plan, tmp_path / "x.gif", fps=2, speed=2.0)
    with Image.open(tmp_path / "x.gif") as film:
        assert film.n_frames == 6


def test_obstacles_and_waypoints_are_in_the_picture(plan: planner.Plan) -> None:
    from planner.report import plot_arm

    tables = {
        "obstacles": [{"centre_m": [0.8, 2.2], "radius_m": 0.3}],
        "waypoints": [{"theta_deg": [20.0, 10.0, 5.0]}, {"theta_deg": [20.0, "free", 5.0]}],
    }
    shown = replace(plan, problem=plan.problem.changed(tables))
    _, axes = plot_arm(shown)
    (disc,) = axes[0, 0].patches
    assert tuple(disc.center) == (0.8, 2.2)
    assert disc.radius == 0.3
    texts = [note.get_text() for note in axes[0, 0].texts]
    assert texts.count("obstacle\n1") == texts.count("waypoint 1") == 1
    assert "waypoint 2" not in texts


def test_animate_command(plan: planner.Plan, tmp_path: Path, capsys: Any) -> None:
    a, b = plan.save(tmp_path / "a.json"), plan.save(tmp_path / "b.refused.json")
    film = tmp_path / "x.gif"
    words = ["animate", str(a), str(b), "--out", str(film), "--fps", "2", "--speed", "5"]
    assert main(words) == 0
    assert capsys.readouterr().err == f"written to {film}\n"
    assert film.read_bytes().startswith(b"GIF89a")
    from planner.cli.files import plans_by_label

    assert list(plans_by_label([a, b])) == ["a", "b"]
    assert list(plans_by_label([a, a])) == ["1: a", "2: a"]
    assert list(plans_by_label([a])) == ["polynomial"]


def test_ctrl_c_leaves_no_film(plan: planner.Plan, tmp_path: Path) -> None:
    def interrupted(done: int, total: int) -> None:
        raise KeyboardInterrupt

    progress: Callable[[int, int], None] = interrupted
    for name in ("x.gif", *(["x.mp4"] if shutil.which("ffmpeg") else [])):
        with pytest.raises(KeyboardInterrupt):
            animate(plan, tmp_path / name, progress=progress)
    assert list(tmp_path.iterdir()) == []
