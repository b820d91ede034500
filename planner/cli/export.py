"""`planner export`: a plan as a file for another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Json, PlanPath
from planner.cli.output import note, print_json, waiting
from planner.export import FORMATS
from planner.export import export as write
from planner.export.files import find_format
from planner.export.samples import RATE_HZ
from planner.files import refuse_unwritable
from planner.loading import load_plan


def export(
    plan: PlanPath,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The file to write.")],
    format: Annotated[
        str | None,
        typer.Option(
            "--format",
            "-f",
            help=f"One of {', '.join(FORMATS)}; by the ending of FILE when left out.",
            show_default=False,
            autocompletion=lambda: list(FORMATS.items()),
        ),
    ] = None,
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Samples a second (not for json).")
    ] = RATE_HZ,
    joints: Annotated[
        str | None,
        typer.Option(
            "--joints",
            metavar="A,B",
            help="For ros2: the two joint names that the robot's controller knows.",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    """Write a plan as a CSV, JSON, ROS 2 or MATLAB file.

    PLAN is a file that `planner plan --out` wrote. A ROS 2 trajectory needs a plan that starts and
    ends at rest: plan it with --set method.collocation.rest=true.

    \b
    Examples:
      planner export plan.json --out plan.csv
      planner export plan.json --format mat --out plan.mat
      planner plan problems/paper.toml --set method.collocation.rest=true --out rest.json
      planner export rest.json --format ros2 --joints disk,joint1 --out trajectory.yaml
    """
    name = find_format(out, format)
    refuse_unwritable(out)
    names = None if joints is None else joints.split(",")
    with waiting(f"writing {name}"):
        written = str(
            write(load_plan(plan, strict=True), out, name, rate_hz=rate, joint_names=names)
        )
    if as_json:
        print_json({"plan": str(plan), "format": name, "written": written, "exit_status": 0})
    note(f"written to {written}")
    return 0
