"""`planner motion`, `log` and `identify`: measure an arm and identify its machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from planner.cli.arguments import (
    Changes,
    MachineFile,
    PoseFrom,
    ProblemPath,
    figure_option,
    out_option,
    read_problem,
)
from planner.cli.output import finish, job, number, numbers, say
from planner.cli.plan import machine_facts
from planner.compensation import seating
from planner.errors import InputError, NoPlanError
from planner.machine.identification.band import departure
from planner.machine.identification.identify import Identification, predict_run
from planner.machine.identification.identify import identify as run_identification
from planner.machine.machine import Machine, load_machine
from planner.methods.motions import MOTIONS as OTHERS
from planner.plan.recorded.log import read_log
from planner.report.figures.recorded import plot_run
from planner.support.files import refuse_picture, refuse_unwritable, write_figure
from planner.support.tables import facts
from planner.support.user_tables import allowed_hint
from planner.verification.verdict import load_plan

Columns = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar="NAME=COLUMN",
        help="A column with another name in the file: our name with unit, then the file's name,"
        " for example theta1_rad=/joint_states/position[0]; repeatable.",
    ),
]
LogProblem = Annotated[
    Path, typer.Option("--problem", "-p", metavar="PROBLEM", help="The problem file of the arm.")
]

MOTIONS = {**OTHERS, "seating": seating}


def motion(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help=f"One of {', '.join(MOTIONS)}.",
            autocompletion=lambda: list(MOTIONS),
        ),
    ],
    problem: ProblemPath,
    pose_from: PoseFrom = None,
    changes: Changes = None,
    machine: MachineFile = None,
    out: Annotated[
        Path | None, out_option("FILE", "Save it in this JSON file, like a plan.")
    ] = None,
) -> int:
    """Make a motion to home, seat, identify or test an arm.

    excitation: for 30 s the drive reverses in a square wave while joint 1 follows two sines.
    check: slower, 20 s; `planner identify` tests its result on that run if it is the last one.
    homing: the drive turns back, forward, then slowly forward until the encoders have risen; joint
    1 moves last. seating: the same end without readings, for an arm whose lost motion is known.
    signs: motor 2 turns forward by 2 degrees, then motor 1. All begin at the problem's start and
    keep its limits except z2_margin. Export them like a plan. Without --out the command only shows
    where the arm goes.

    \b
    Examples:
      planner motion excitation problems/paper.toml
      planner motion excitation problems/paper.toml --out excitation.json
      planner motion homing problems/paper.toml --out homing.json
      planner export excitation.json --out excitation.csv
    """
    if kind not in MOTIONS:
        raise InputError(f"no motion '{kind}'; {allowed_hint(kind, list(MOTIONS))}")
    task = read_problem(problem, changes, machine)
    if pose_from is not None:
        task = task.from_pose(read_log(pose_from).pose_deg)
    refuse_unwritable(out)
    with job(f"making the {kind} motion"):
        plan = MOTIONS[kind](task)
        space, words = machine_facts(plan, space=True)
    q = np.rad2deg(plan.q(np.linspace(0.0, plan.duration, 1001))[:, 1:])
    ranges = [f"{number(a)} to {number(b)}" for a, b in zip(q.min(0), q.max(0), strict=True)]
    rows = [("duration", f"{number(plan.duration)} s")]
    rows += [(f"theta{i + 1}", f"{text} deg") for i, text in enumerate(ranges)]
    rows.append(("on machines", words))
    rows += [("worst", each) for each in (space or {}).get("limits", ())]
    if until := plan.notes.get("until"):
        text = (
            f"between {number(until['from_s'])} and {number(until['to_s'])} s, once every passive"
            f" encoder is {until['rise_deg']:g} deg above its least reading since"
            f" {number(until['count_from_s'])} s"
        )
        rows.append(("go on to its last part", text))
    data = {
        "motion": kind,
        "duration_s": plan.duration,
        "theta_min_deg": q.min(0).tolist(),
        "theta_max_deg": q.max(0).tolist(),
        "on_machines": space,
        "until": until,
        "verified": plan.verified,
        "written": out and plan.save(out),
    }
    return finish(data, f"{task.name}: {kind}", facts(rows), where="motion written to {}")


def log(
    run: Annotated[Path, typer.Argument(metavar="LOG", help="A recorded run (CSV).")],
    problem: LogProblem,
    plan: Annotated[
        Path | None,
        typer.Option("--plan", metavar="PLAN", help="The plan that was executed (JSON)."),
    ] = None,
    machine: MachineFile = None,
    columns: Columns = None,
    out: Annotated[
        Path | None, out_option("FILE", "Draw the run with plan and prediction (PNG, SVG, PDF).")
    ] = None,
) -> int:
    """Check a recorded run, and compare it with its plan.

    A run is a CSV file with one header line: t, u1, u2, theta1 ... thetan with units, as in
    t_s,u1_rad_s,u2_rad_s,theta1_deg,theta2_deg,theta3_deg. The commands of a row hold until the
    next row; its angles are measured before the commands act. For a compensated plan, errors are
    measured from the requested path; the deviation from the motion predicted for the compensated
    plan's machine, preparation included, is printed too (and drawn in the picture's lower row).
    With --plan or --machine the verdict says where the run leaves the band that 95 % of the
    machines keep, and what is likely: another start, or another arm than the machine.

    \b
    Examples:
      planner log runs/1.csv --problem arm.toml
      planner log runs/1.csv --problem arm.toml --machine my-machine.toml
      planner log runs/1.csv --problem arm.toml --plan plan.json --out run.png
    """
    task = read_problem(problem, None)
    if out is not None and plan is None:
        raise InputError("--out draws the run with its plan; give the plan with --plan")
    refuse_picture(out)
    with job("reading"):
        recorded = read_log(run, _columns(columns))
        recorded.plan(task)
        motion = None if plan is None else load_plan(plan)
    data: dict[str, Any] = {
        "log": run,
        "rows": len(recorded.t),
        "duration_s": float(recorded.t[-1]),
        "interval_s": recorded.interval_s,
        "jitter": recorded.jitter_words or None,
        "written": None,
    }
    rows = [("rows", f"{len(recorded.t)}, every {number(recorded.interval_s)} s")]
    rows.append(("duration", f"{number(float(recorded.t[-1]))} s"))
    if late := recorded.jitter_words:
        say(f"warning: {late}", "yellow")
    used = Machine.from_table(task.machine) if machine is None else load_machine(machine)
    if motion is not None and motion.compensation is not None:
        told = motion.compensation.machine
        state = {"start_state": told["start_state"], "initial_angle_error_deg": False}
        used = Machine.from_table(told) if machine is None else used.with_(**state)
    if motion is not None or machine is not None:
        with job("replaying"):
            left = departure(recorded, task, used, motion)
        data["leaves_band"] = left and vars(left)
        rows.append(("verdict", str(left or "stays in the band of 95 % of the machines")))
    if motion is not None:
        off, moved = recorded.errors_deg(motion)
        data["terminal_error_deg"] = off[-1].tolist()
        data["largest_error_deg"] = np.nanmax(np.abs(off), axis=0).tolist()
        rows.append(("largest error", f"{numbers(data['largest_error_deg'])} deg"))
        rows.append(("error at the end", f"{numbers(data['terminal_error_deg'])} deg"))
        data["largest_from_motion_deg"] = np.max(np.abs(moved), axis=0).tolist()
        if motion.is_compensated:
            rows.append(("", "errors are measured from the requested path, from its start on"))
            words = f"largest {numbers(data['largest_from_motion_deg'])} deg"
            rows.append(("off the prediction", f"{words}, from the compensated plan's motion"))
        if out is not None:
            with job("predicting and drawing"):
                write_figure(out, plot_run(recorded, motion, predict_run(recorded, task, used))[0])
            data["written"] = out
    return finish(data, str(run), facts(rows))


def identify(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG", help="Recorded runs (CSV).")],
    problem: LogProblem,
    preset: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="MACHINE",
            help="Machine where the search begins: name of a preset, or a file from this command.",
        ),
    ] = None,
    columns: Columns = None,
    starts: Annotated[
        int, typer.Option("--starts", min=1, help="Number of searches, each from another start.")
    ] = 2,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of starts and bootstrap.")] = 0,
    figure: Annotated[Path | None, figure_option("Draw the residuals of each run")] = None,
    out: Annotated[
        Path | None, out_option("FILE", "Write the machine as a [machine] table (TOML).")
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Write a machine that is no better than the preset.")
    ] = False,
) -> int:
    """Find the machine of an arm from recorded runs.

    With several runs, the last run (with runs/*.csv the last by name) is kept out of the fit. If
    every joint after the first reverses in it, the error of predicting that run says how far plans
    for this machine can be believed. A machine that predicts it no better than the preset is not
    written (exit status 3) without --anyway.
    `planner motion excitation` makes the most informative motion. The fit takes about 6 CPU s for
    each run of 30 s, half of that with --starts 1.

    \b
    Examples:
      planner identify runs/*.csv --problem arm.toml --out my-machine.toml
      planner compare arm.toml --machine my-machine.toml
    """
    task = read_problem(problem, None)
    refuse_picture(figure)
    refuse_unwritable(out)
    machine: Machine | str = str(preset or "prototype")
    if preset is not None and preset.suffix == ".toml":
        machine = load_machine(preset)
    with job("reading the runs") as tell:
        names = _columns(columns)
        result = run_identification(
            [read_log(path, names) for path in logs],
            task,
            machine,
            starts=starts,
            seed=seed,
            progress=tell,
        )
        if figure is not None:
            tell("drawing", 1.0)
            write_figure(figure, result.plot())
    for text in result.warnings:
        say(f"warning: {text}", "yellow")
    withheld = out is not None and result.improves is False and not anyway
    written = None if withheld else out and result.save(out)
    if withheld:
        say("not written: the machine is no better than the preset (--anyway writes it)", "yellow")
    return finish(
        {**result.to_dict(), "written": written},
        result.table(),
        "",
        *_words(result),
        where="machine written to {}",
        status=NoPlanError.exit_status if withheld else 0,
    )


def _words(result: Identification) -> Iterator[str]:
    yield "+-: standard deviation (bootstrap). told: how far the runs fix the parameter, 0 to 1."
    for text in result.merged:
        yield f"One number for several parameters: {text}."
    if result.untold:
        names = ", ".join(result.untold)
        yield f"Hardly determined by these runs, so near the preset: {names}."
    rms = (np.sqrt(np.mean(e**2, axis=0)) for e in (result.residual_deg, result.noise_deg))
    left, usual = map(numbers, rms)
    yield f"residual of the runs: {left} deg (rms); noise of the encoders: {usual} deg"
    for name, error in result.errors.items():
        assert result.kept_out is not None
        yield (
            f"{result.kept_out.source}, not fitted, predicted by the {name} machine: largest error"
            f" {numbers(error.largest_deg)} deg, rms {numbers(error.rms_deg)} deg"
        )
    yield result.worth


def _columns(pairs: list[str] | None) -> dict[str, str]:
    """Parse the words after `--column`, each `name=column`, into the file's columns by our name.

    Raises:
        InputError: If a word does not have that form.
    """
    out = {}
    for pair in pairs or []:
        name, equals, theirs = pair.partition("=")
        if not (name and equals and theirs):
            raise InputError(f"--column {pair}: write it as theta1_deg=name_in_the_file")
        out[name.strip()] = theirs.strip()
    return out
