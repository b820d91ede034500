"""`planner plan`: solve one problem by one method and verify the plan.

`planner verify`: judge the plan in a file.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from planner.cli.arguments import (
    Changes,
    MachineFile,
    MethodName,
    PlanPath,
    PoseFrom,
    ProblemPath,
    TimeLimit,
    figure_option,
    out_option,
    read_problem,
)
from planner.cli.output import (
    INTERRUPT_STATUS,
    ReportedStatus,
    finish,
    is_interrupted,
    job,
    keep_best_on_interrupt,
    number,
    say,
    search_ended_early,
)
from planner.errors import InputError, NoPlanError
from planner.methods.registry import parse_spec
from planner.plan.plan import Plan
from planner.plan.recorded.log import read_log
from planner.problem.problem import Problem
from planner.report.properties import properties
from planner.solve import solve_and_check
from planner.support.files import refuse_picture, refuse_unwritable, write_figure
from planner.support.interrupts import signal_listener
from planner.support.tables import facts
from planner.systems.triangular_system import PlanarArm
from planner.verification.summary import plan_summary, refusal_summary
from planner.verification.verdict import load_plan
from planner.verification.verify import verify as check_plan

SPACE_MACHINES, MOST_INSTANTS = 100, 500
"""Numbers of machines and of recorded instants in `machine_facts`."""


def plan(
    problem: ProblemPath,
    method: MethodName = "collocation",
    time_limit: TimeLimit = None,
    changes: Changes = None,
    machine: MachineFile = None,
    pose_from: PoseFrom = None,
    after: Annotated[
        Path | None,
        typer.Option(
            "--after",
            metavar="PLAN",
            help="Start where this compensated plan (JSON) leaves the arm: its pose, or that of"
            " --pose-from, and its state of backlash and shafts.",
        ),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(
            "--again",
            metavar="PLAN",
            help="The goal again, aimed off by the error at the end of this plan's run (--run),"
            " from its start or the pose of --pose-from.",
        ),
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option("--run", metavar="LOG", help="The recorded run (CSV) of the plan of --again."),
    ] = None,
    out: Annotated[Path | None, out_option("FILE", "Save the plan in this JSON file.")] = None,
    figure: Annotated[Path | None, figure_option("Draw the plan's coordinates over time")] = None,
) -> int:
    """Make a plan, verify it and print its properties.

    A plan that breaks a requirement is refused: the command prints what is broken and what would
    help, and ends with status 3. Ctrl-C ends the search; the best motion found so far, if any, is
    refined, verified and written, with status 130. A second Ctrl-C ends the command at once.

    \b
    Examples:
      planner plan problems/paper.toml
      planner plan problems/paper.toml --method polynomial --set goal.travel=0.82
      planner plan problems/paper.toml --set goal.duration=8 --out plan.json
      planner plan problems/paper-fig4.toml --method polynomial \\
        --set method.polynomial.allow_singular=true
      planner plan arm.toml --machine my-machine.toml --pose-from homed.csv \\
        --set machine.start_state=forward --set compensation.on=true
      planner plan arm.toml --machine my-machine.toml --after plan.json \\
        --set goal.theta_deg=[40,30,20] --set compensation.on=true --out next.json
    """
    spec = parse_spec(method)
    task = read_problem(problem, changes, machine)
    pose = None if pose_from is None else read_log(pose_from).pose_deg
    if again is not None or run is not None:
        if again is None or run is None or after is not None:
            raise InputError("--again needs the run of its plan in --run, and no --after")
        task = task.again(load_plan(again, strict=True), read_log(run).pose_deg)
    if after is not None:
        task = task.after(load_plan(after, strict=True), pose)
    elif pose is not None:
        task = task.from_pose(pose)
    refuse_unwritable(out)
    refuse_picture(figure)
    try:
        with job(f"planning with {spec.label}"), keep_best_on_interrupt():
            began = time.perf_counter()
            motion, check = solve_and_check(task, spec, time_limit_s=time_limit)
            took = time.perf_counter() - began
            if after is not None:
                motion = replace(motion, notes={**motion.notes, "after": after.name})
            summary = plan_summary(motion, check)
            # A compensated plan swings before it starts.
            summary["on_machines"], touch = (
                machine_facts(motion, motion.is_compensated) if motion.verified else (None, "")
            )
    except NoPlanError as error:
        return _report_refusal(task, spec.method, error)
    summary |= _heading(task) | {"written": out and motion.save(out), "figure": figure}
    if figure is not None:
        write_figure(figure, motion.plot("joints" if motion.executable else "z"))
    status = 0
    if search_ended_early():
        status = ReportedStatus(INTERRUPT_STATUS)
        say("planner: interrupted: this is the best plan found so far")
    rows = [*properties(motion, summary, machine), ("time", _time(summary, took))]
    rows += [("emulated", touch)] * bool(touch)
    parts = (f"{task.name}: {spec.label}", facts(rows), "", _verdict(motion))
    return finish(summary, *parts, status=status, where="plan written to {}")


def verify(plan: PlanPath) -> int:
    """Judge a saved plan anew, by an independent integrator.

    Ends with status 0 if the plan reaches the goal and keeps every limit at all times, else with
    status 3 and what it breaks.

    \b
    Examples:
      planner plan problems/paper.toml --out plan.json
      planner verify plan.json
    """
    with job("verifying"):
        motion = load_plan(plan)
        if not motion.verified:
            broken = motion.violation or "; ".join(map(str, check_plan(motion).violations))
            error = NoPlanError(f"not verified: {broken or motion.status}", source=str(plan))
            error.status = motion.status
            raise error
        summary = plan_summary(motion)
    title = f"{motion.problem.name}: {motion.label}"
    parts = (title, facts(properties(motion, summary)), "", _verdict(motion))
    return finish({**summary, "problem": motion.problem.name, "file": plan}, *parts)


def machine_facts(
    plan: Plan, space: bool = False, feedback: bool = False
) -> tuple[dict[str, Any] | None, str]:
    """Return where random machines take an arm and what its links touch, as data and in words.

    Return None and "" for other systems, and if no `space` is asked for and the problem has no
    obstacles and no clearance of the links. The data have the least and greatest joint angles, and
    x and y of all joints and the tip.
    """
    from planner.machine.replay import RECORD_S, replay  # slow to import

    arm, solid = plan.problem.system, any(each.solid for each in plan.problem.requirements)
    if not isinstance(arm, PlanarArm) or not (solid or space):
        return None, ""
    record_s = max(RECORD_S, plan.duration / MOST_INSTANTS)
    run = replay(plan, samples=SPACE_MACHINES, record_s=record_s, feedback=feedback)
    theta = run.q[:, :, 1:]
    ends = {f"theta{i}_deg": np.rad2deg(each) for i, each in enumerate(theta.T, start=1)}
    ends |= dict(zip(("x_m", "y_m"), arm.arm_points(theta).T, strict=True))
    room = {name: [float(each.min()), float(each.max())] for name, each in ends.items()}
    limits = [str(each) for each in run.limits if each.requirement.physical]
    touch = {"touching": run.touching, "words": run.touch_words or None}
    more = {"space": room, "limits": limits} if space else {}
    data = {"machines": SPACE_MACHINES, **touch, **more}
    free = run.touch_words or f"none of {SPACE_MACHINES} machines touches an obstacle or itself"
    names = ([*name.split("_"), " to ".join(map(number, room[name]))] for name in room)
    stand = ", ".join(f"{name} {each} {unit}" for name, unit, each in names)
    return data, "; ".join([free] * solid + [f"stand clear: {stand}"] * space)


def _report_refusal(problem: Problem, method: str, error: NoPlanError) -> int:
    if is_interrupted() or search_ended_early():
        raise signal_listener.exception
    say(f"planner: no plan ({error.status.replace('_', ' ')})", "bold red")
    say(str(error))
    summary = _heading(problem) | refusal_summary(error, method, problem.system)
    return finish({**summary, "error": str(error), "written": None}, status=error.exit_status)


def _heading(problem: Problem) -> dict[str, Any]:
    return {"problem": problem.name, "file": problem.source}


def _verdict(plan: Plan) -> str:
    if plan.verified:
        how = "verified by integrating its inputs independently"
        if plan.compensates is not None:
            how = "verified on the nominal machine, for which it is made"
        text = f"The plan reaches the goal and keeps every limit ({how})."
        if plan.jump_words:
            text += f"\nIt {plan.jump_words}: limits on input rates hold from its start to its end."
        if why := str(plan.notes.get("ended_early", "")):
            text += f"\n{why[0].upper()}{why[1:]}; more time may find a better one."
        return text
    return (
        "For study only, not executable: the path leaves the domain of the chained-form chart,"
        " where no real angles exist."
    )


def _time(summary: Mapping[str, Any], took: float) -> str:
    solve, build = number(summary["solve_time_s"]), number(summary["build_time_s"])
    of_these = f"of these {solve} s to solve, {build} s to prepare"
    whole = f"{number(took)} s in all, with verification"
    return f"{whole}; {of_these}; {summary['iterations']} iterations"
