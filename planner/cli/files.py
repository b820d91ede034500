"""`planner export`, `animate` and `report`: write a file for another program, a film, a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import PlanPath, out_option
from planner.cli.output import finish, job, number
from planner.cli.plan import machine_facts
from planner.plan.plan import Plan
from planner.plan.samples import RATE_HZ, held_miss
from planner.report.export import FORMATS, Real, find_format, fitting, refuse_target, slowed
from planner.report.export import export as write
from planner.report.figures.style import to_display, unit_of
from planner.report.film import animate as film
from planner.report.film import check_film
from planner.report.page.page import write_report
from planner.verification.verdict import load_plan


def export(
    plan: PlanPath,
    out: Annotated[
        Path,
        out_option(
            "FILE", "The file to write; for the format c, a folder, in which your own files stay."
        ),
    ],
    format: Annotated[
        str | None,
        typer.Option(
            "--format",
            "-f",
            help=f"One of {', '.join(FORMATS)}; by default from the ending of FILE.",
            show_default=False,
            autocompletion=lambda: [(name, one.holds) for name, one in FORMATS.items()],
        ),
    ] = None,
    rate: Annotated[
        float,
        typer.Option("--rate", metavar="HZ", help=f"For {fitting('rate_hz')}: samples per second."),
    ] = RATE_HZ,
    joints: Annotated[
        str | None,
        typer.Option(
            "--joints",
            metavar="A,B,...",
            help=f"For {fitting('joint_names')}: names of the two motors in the robot's"
            " controller, or of all joints of the arm (theta1,theta2,theta3).",
        ),
    ] = None,
    slow: Annotated[
        float,
        typer.Option(
            "--slow",
            metavar="FACTOR",
            min=1,
            help=f"For {fitting('slow')}: the motion takes so many times as long, for a first run."
            " The README of c says how there.",
        ),
    ] = 1.0,
    real: Annotated[
        Real, typer.Option("--real", help=f"For {fitting('real')}: type of the numbers.")
    ] = "double",
) -> int:
    """Write a plan as a file for another program.

    PLAN is a file that `planner plan --out` wrote. A ROS 2 trajectory needs a plan that starts and
    ends at rest, as with limited input rates (--set limits.input_rate_rad_s2=2.0). The format c
    writes a folder with the plan's tracker in C, for a machine like that of the problem's [machine]
    table.

    \b
    Examples:
      planner export plan.json --out plan.csv
      planner export plan.json --slow 10 --out first.csv
      planner export plan.json --format matlab --out plan.mat
      planner plan arm.toml --set limits.input_rate_rad_s2=2.0 --out rest.json
      planner export rest.json --format ros2 --joints disk,joint1 --out ros.yaml
      planner export rest.json --joints theta1,theta2,theta3 --out arm.yaml
      planner export rest.json --out arm.urdf
      planner export rest.json --format c --real float --out controller
    """
    name = find_format(out, format)
    refuse_target(out, name)
    names = None if joints is None else joints.split(",")
    with job(f"writing {name}"):
        motion = load_plan(plan, strict=True)
        written = write(motion, out, name, rate_hz=rate, joint_names=names, real=real, slow=slow)
        shown, form = slowed(motion, slow), FORMATS[name]
        miss = _held_miss(shown, rate) if form.sample_and_hold else {}
        space = machine_facts(motion, True, form.has_feedback) if form.is_command else (None, "")
    sent = " and ".join(form.command_columns(motion))
    data = {"plan": plan, "format": name, "written": written, "held_miss": miss or None}
    data |= {"only_sampled": motion.sampled_labels, "claimed": motion.file_figures}
    data |= {"jumps": motion.jump_words or None, "on_machines": space[0]}
    data |= {"start": motion.start_words or None, "after": motion.notes.get("after")}
    data["worth"] = motion.worth and motion.worth.model_dump()
    words = f"; send the motors {sent}" * bool(sent)
    if miss:
        off = ", ".join(f"{each} {number(value)}" for each, value in miss.items())
        words += f"{' and' if sent else ';'} hold each row until the next, {1e3 / rate:.4g} ms:"
        words += f" on an ideal machine the end is off by {off}"
    for each in filter(None, [motion.start_words, *motion.reservations, space[1]]):
        words += f"; {each}".replace("{", "{{").replace("}", "}}")
    return finish(data, where="written to {}" + words)


def _held_miss(plan: Plan, rate_hz: float) -> dict[str, float]:
    """Return how far from its end a plan ends if each sampled command is held until the next.

    The distances are by coordinate with unit; those of angles are in degrees.
    """
    names = plan.problem.system.user_coordinates
    return {
        f"{each.name}_{unit_of(each) or '1'}": float(to_display(value, each.unit))
        for each, value in zip(names, held_miss(plan, rate_hz), strict=True)
    }


def animate(
    plans: Annotated[
        list[Path],
        typer.Argument(metavar="PLAN", help="Plan files (JSON) from `planner plan --out`."),
    ],
    out: Annotated[Path, out_option("FILE", "The film: FILE.gif or FILE.mp4.")],
    fps: Annotated[int, typer.Option("--fps", help="Frames per second, 1 to 60.")] = 25,
    speed: Annotated[
        float, typer.Option("--speed", help="Speed: seconds of motion per second of the film.")
    ] = 1.0,
) -> int:
    """Write plans as a film (GIF or MP4) with a common clock.

    An MP4 needs ffmpeg, on the path or from the extra 'video'.

    \b
    Examples:
      planner animate plan.json --out plan.gif
      planner animate out/paper/plans/*.json --speed 2 --out all.mp4
    """
    check_film(out, fps, speed)
    motions = plans_by_label(plans)
    with job() as tell:

        def report(done: int, total: int) -> None:
            tell("drawing frames", done / total)

        written = film(motions, out, fps=fps, speed=speed, progress=report)
    return finish({"plans": plans, "written": written})


def plans_by_label(paths: Sequence[Path]) -> dict[str, Plan]:
    """Load plan files; return plans by method, or by file name if two have the same method."""
    loaded = [load_plan(path, strict=True) for path in paths]
    methods = [plan.label for plan in loaded]
    if len(set(methods)) == len(methods):
        return dict(zip(methods, loaded, strict=True))
    names = [path.stem.removesuffix(".refused") for path in paths]
    return {
        name if names.count(name) == 1 else f"{k}: {name}": plan
        for k, (name, plan) in enumerate(zip(names, loaded, strict=True), start=1)
    }


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="A folder from `planner compare --out`.")
    ],
    out: Annotated[
        Path | None, out_option("FILE", "The page. Default: report.html in FOLDER.")
    ] = None,
) -> int:
    """Write a comparison as one HTML page.

    The page opens from disk, without a network. It holds the table, the motion of two plans side by
    side, figures that show values under the pointer, the distribution of the error, and the command
    that reproduces the comparison.

    \b
    Examples:
      planner compare problems/paper.toml --out out/paper
      planner report out/paper
      planner report out/paper --out paper.html
    """
    with job("writing the page"):
        data = {"folder": folder, "written": write_report(folder, out)}
    return finish(data, where="written to {}; open it in a browser")
