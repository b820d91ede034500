"""`planner animate`: plans as a film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Json
from planner.cli.output import note, print_json, progress_bar
from planner.loading import load_plan
from planner.plan import Plan
from planner.report import animate as film
from planner.report.animation import check_film


def animate(
    plans: Annotated[
        list[Path],
        typer.Argument(metavar="PLAN", help="Plan files (JSON) of `planner plan --out`."),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The film: FILE.gif or FILE.mp4.")
    ],
    fps: Annotated[int, typer.Option("--fps", help="Pictures a second, 1 to 60.")] = 25,
    speed: Annotated[
        float, typer.Option("--speed", help="Seconds of motion a second of the film.")
    ] = 1.0,
    as_json: Json = False,
) -> int:
    """Write plans as a film, GIF or MP4, on the same clock.

    An MP4 needs ffmpeg, on the path or by the extra 'video'.

    \b
    Examples:
      planner animate plan.json --out plan.gif
      planner animate polynomial.json collocation.json --speed 2 --out both.mp4
    """
    check_film(out, fps, speed)
    found = _labelled(plans)
    with progress_bar() as tell:
        written = film(
            found,
            out,
            fps=fps,
            speed=speed,
            progress=lambda done, total: tell("drawing frames", done / total),
        )
    if as_json:
        print_json({"plans": [str(p) for p in plans], "written": str(written), "exit_status": 0})
    note(f"written to {written}")
    return 0


def _labelled(paths: Sequence[Path]) -> dict[str, Plan]:
    """Plans by the names of their methods; by those of their files where methods are the same."""
    loaded = [load_plan(path, strict=True) for path in paths]
    methods = [plan.method for plan in loaded]
    if len(set(methods)) == len(methods):
        return dict(zip(methods, loaded, strict=True))
    names = [path.stem.removesuffix(".refused") for path in paths]
    return {
        name if names.count(name) == 1 else f"{k}: {name}": plan
        for k, (name, plan) in enumerate(zip(names, loaded, strict=True), start=1)
    }
