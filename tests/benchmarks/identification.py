"""An arm that obeys: how exactly machines are found from a log, and what that is worth at the end.

python tests/benchmarks/identification.py [--arms 50]      # writes results/identification
python tests/benchmarks/identification.py --only thousand  # one section anew, the others stay
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import planner
from planner import HomingRule, Identification, Log, Machine, Plan, Problem
from planner.machine.feedback.homing import HomingController
from planner.machine.machine import draw
from planner.support.arrays import Array
from planner.support.package import release

ROOT = Path(__file__).parents[2]
SEED = 20271
"""Nothing was chosen with this seed."""

TICK_S, NOISE_DEG, WAIT_S = 0.01, 0.03, 0.5
GOALS = {
    "(30, 30, 30), one way": (30.0, 30.0, 30.0),
    "(25, -20, 10), the drive reverses": (25.0, -20.0, 10.0),
    "(20, 25, -15), the drive reverses": (20.0, 25.0, -15.0),
    "(40, -10, -20), the drive reverses": (40.0, -10.0, -20.0),
}

TURNING_S = 14.0
"""Duration of plans whose drive reverses: from some poses ten seconds are too short."""

OF_A_RUN = {
    "initial_play": {"value": 0.0, "spread": 0.7},
    "initial_angle_error_deg": {"value": 0.0, "spread": 1.0},
}
"""How an arm stands before homing: anywhere in its backlash."""

Record = Callable[[Plan, Machine, int], Log]


def arms(count: int, spreads: float = 1.0, **more: Any) -> list[Machine]:
    """Single machines drawn from the prototype's spreads, times a factor; they differ in runs."""
    preset = Machine.prototype()
    wide = {
        name: {"value": setting["value"], "spread": times(spreads, setting["spread"])}
        for name, q in preset.effects.items()
        if q.varies and name not in OF_A_RUN
        for setting in [q.to_setting()]
    }
    for name in ("viscous_friction_nms_per_rad", "servo_bandwidth_rad_s", "creep_per_nm"):
        value = preset.effects[
            name
        ].to_setting()  # which the prototypes have alike, and arms do not
        wide[name] = {"value": value, "spread": times(0.2 * spreads, value)}
    drawn = draw(preset.with_(**wide), 3, np.arange(count), SEED)
    singles = []
    for k in range(count):
        own = {name: drawn[name][:, k].tolist() for name in wide}
        own = {name: x[0] if len(x) == 1 else x for name, x in own.items()}
        singles.append(preset.nominal().with_(**own, **OF_A_RUN, **more))
    return singles


def times(factor: float, setting: Any) -> Any:
    """A number, or each of a list, times a factor."""
    return [factor * x for x in setting] if isinstance(setting, list) else factor * setting


def lost_deg(machine: Machine) -> Array:
    """Lost motion of joints 2 and 3, degrees."""
    names = ("backlash_deg", "coulomb_friction_nm", "shaft_stiffness_nm_per_rad")
    backlash, friction, stiffness = (machine.mean(name, 3) for name in names)
    return backlash / 2 + np.rad2deg(friction / stiffness)


def pair(values: Any, digits: int = 3) -> str:
    """Median and 95th percentile."""
    middle, high = np.percentile(np.ravel(values), [50, 95])
    return f"{middle:.{digits}f} / {high:.{digits}f}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


# -- what is recorded ------------------------------------------------------------------------------


def as_it_is(plan: Plan, arm: Machine, sample: int) -> Log:
    """Noise and resolution alone."""
    return planner.emulate_log(plan, arm, sample=sample, seed=SEED, noise_deg=NOISE_DEG)


def with_inertia(plan: Plan, arm: Machine, sample: int) -> Log:
    """Of the arm with masses."""
    return as_it_is(plan, arm.with_(fidelity="dynamic"), sample)


def eccentric(plan: Plan, arm: Machine, sample: int) -> Log:
    """By encoders that are off by 0.1 degrees twice a turn."""
    log = as_it_is(plan, arm, sample)
    return replace(log, theta=log.theta + np.deg2rad(0.1) * np.sin(2 * log.theta + [0.3, 1.1, 2.0]))


def drifting(plan: Plan, arm: Machine, sample: int) -> Log:
    """While friction grows by a third: between the motions of the two."""
    friction = 1.33 * arm.mean("coulomb_friction_nm", 3)
    cold = as_it_is(plan, arm, sample)
    warm = as_it_is(plan, arm.with_(coulomb_friction_nm=friction.tolist()), sample)
    share = (cold.t / cold.t[-1])[:, None]
    return replace(cold, theta=(1 - share) * cold.theta + share * warm.theta)


LACKING: dict[str, Record] = {
    "nothing": as_it_is,
    "inertia": with_inertia,
    "encoders eccentric by 0.1 deg": eccentric,
    "friction grows by a third during the run": drifting,
}


class Study:
    """All tables.

    Args:
        count: Number of arms.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.problem = planner.load_problem(ROOT / "problems/paper.toml")
        self.motion = planner.excitation(self.problem)
        turning = {"goal.theta_deg": [25, -20, 10], "limits.z2_margin": None}
        other = self.problem.changed(turning)
        self.others = [planner.solve(self.problem), planner.solve(other)]
        self._found: dict[tuple[Machine, int, str], tuple[Identification, float]] = {}

    def found(self, arm: Machine, k: int, record: Record = as_it_is) -> Identification:
        """What one run of 30 s tells; of an arm with masses a model that has them, too."""
        return self._timed(arm, k, record)[0]

    def _timed(self, arm: Machine, k: int, record: Record) -> tuple[Identification, float]:
        """The same with its CPU seconds; each is made once, for all tables."""
        key = arm, k, record.__name__
        if key not in self._found:
            preset, log = Machine.prototype(fidelity=arm.fidelity), record(self.motion, arm, k)
            began = time.process_time()
            found = planner.identify(log, self.problem, preset)
            self._found[key] = found, time.process_time() - began
        return self._found[key]

    # -- identification ----------------------------------------------------------------------------

    def exactness(self) -> str:
        """Arms with the prototype's spreads and with twice these."""
        rows = []
        for spreads, count in ((1.0, self.count), (2.0, max(2, self.count // 2))):
            rows.append(
                [f"{spreads:g} times", str(count), *self._row(arms(count, spreads), as_it_is)]
            )
        return table(["spreads of the prototype", "arms", *HEAD], rows)

    def lacking(self) -> str:
        """Arms that do what the model lacks."""
        count = max(2, self.count // 3)
        rows = [[words, *self._row(arms(count), record)] for words, record in LACKING.items()]
        known = self._row(arms(count, fidelity="dynamic"), as_it_is)
        rows.append(["nothing: inertia, and the model has it (`fidelity = 'dynamic'`)", *known])
        return table(["the model lacks", *HEAD], rows)

    def _row(self, every: Sequence[Machine], record: Record) -> list[str]:
        lost, before, ratio, warned, sure, ours, preset, seconds = ([] for _ in range(8))
        for k, arm in enumerate(every):
            found, took = self._timed(arm, k, record)
            seconds.append(took)
            miss = np.array([found["w2"].value, found["w3"].value]) - lost_deg(arm)
            lost.append(np.abs(miss))
            before.append(np.abs(lost_deg(found.preset) - lost_deg(arm)))
            sure.append(miss / [found["w2"].spread, found["w3"].spread])
            ratio.append(np.max(found.residual_deg / found.noise_deg))
            warned.append(bool(found.warnings))
            for plan in self.others:
                silent = record(plan, arm.with_(encoder_resolution_deg=False), 1000 + k)
                ours.append(max(found.error(silent).largest_deg))
                preset.append(max(found.error(silent, found.preset).largest_deg))
        z = np.sqrt(np.mean(np.square(sure)))
        return [pair(before, 2), pair(lost), f"{z:.1f}", pair(ratio, 2), f"{np.mean(warned):.0%}",
                pair(preset, 2), pair(ours, 2), f"{np.median(seconds):.1f}"]  # fmt: skip

    # -- the whole procedure -----------------------------------------------------------------------

    def procedure(self) -> str:
        """Home, read, plan from the pose, compensate, run: errors at the end."""
        return self._procedure("quasi-static", list(GOALS), self.count)

    def inertia(self) -> str:
        """The same on arms with masses."""
        return self._procedure("dynamic", list(GOALS)[:2], max(2, self.count // 3))

    def _procedure(self, fidelity: str, goals: Sequence[str], count: int) -> str:
        several = {words: count if "one way" in words else max(2, count // 4) for words in goals}
        rows = [self._runs(fidelity, w, GOALS[w], number) for w, number in several.items()]
        return table(["truth", "goal (deg)", "arms", "homing s", *CASES, "refused"], rows)

    def thousand(self) -> str:
        """The preset's commands from the homed state, on a thousand machines: whose fault it is."""
        preset = Machine.prototype(**dict.fromkeys(OF_A_RUN, False))
        machine = preset.with_(start_state="forward")
        rows = []
        for words, goal in GOALS.items():
            plan = homed_compensation(planner.solve(self._task(words, goal)), preset)
            runs = {"all spreads": machine}
            if "one way" in words:
                runs |= {name: _alone(machine, name) for name in _varying(machine)}
                runs["all but lateral_friction"] = machine.with_(
                    lateral_friction=machine.effects["lateral_friction"].value[0]
                )
            for case, drawn in runs.items():
                run = planner.replay(plan, drawn, 1000, SEED, record_s=None)
                rows.append([words, case, pair(run.terminal_E_deg)])
        return table(["goal (deg)", "what varies", "end"], rows)

    def drift(self) -> str:
        """The whole procedure with what is known of each arm, with and without the motors' bias."""
        words, goal = next(iter(GOALS.items()))
        rows = []
        for case, changes in {"as drawn": {}, "no bias": {"input_bias_rad_s": False}}.items():
            ends = []
            for k, arm in enumerate(arm.with_(**changes) for arm in arms(max(2, self.count // 3))):
                way = Homed.run(self.problem, arm, k)
                plan = planner.solve(from_pose(self._task(words, goal), way.pose_deg))
                end = way.end_after(homed_compensation(plan, arm))
                ends.append(float(np.abs(end - goal).max()))
            rows.append([case, str(len(ends)), pair(ends)])
        return table(["the arm's own machine", "arms", "end"], rows)

    def _task(self, words: str, goal: Sequence[float]) -> Problem:
        task = self.problem.changed({"limits.z2_margin": None, "goal.theta_deg": list(goal)})
        return task.changed({"goal.duration": TURNING_S}) if "reverses" in words else task

    def _runs(self, fidelity: str, words: str, goal: Sequence[float], count: int) -> list[str]:
        ends: dict[str, list[float]] = {case: [] for case in CASES}
        lengths, refused = [], 0
        for k, arm in enumerate(arms(count, fidelity=fidelity)):
            machines = {
                "not compensated": None,
                "preset": Machine.prototype(fidelity=fidelity),
                "identified": self.found(arm, k).machine,
                "the arm's own": arm,
            }
            way = Homed.run(self.problem, arm, k)
            lengths.append(len(way.commands) * TICK_S)
            plan = planner.solve(from_pose(self._task(words, goal), way.pose_deg))
            for case, machine in machines.items():
                try:
                    commands = plan if machine is None else homed_compensation(plan, machine)
                except planner.NoPlanError:
                    refused += 1
                    continue
                end = way.end_after(commands)
                ends[case].append(float(np.abs(end - goal).max()))
            print(
                words, fidelity, k, {c: round(e[-1], 3) for c, e in ends.items() if e}, flush=True
            )
        cells = [pair(values) if values else "" for values in ends.values()]
        return [fidelity, words, str(count), pair(lengths, 1), *cells, str(refused)]


HEAD = [
    "lost motion off before, deg", "identified", "over its own spread, rms",
    "residual over noise", "warned", "other runs off, preset, deg", "identified", "CPU s",
]  # fmt: skip
CASES = ["not compensated", "preset", "identified", "the arm's own"]


def _varying(machine: Machine) -> list[str]:
    return [name for name, effect in machine.effects.items() if effect.varies]


def _alone(machine: Machine, name: str) -> Machine:
    """The machine that varies in one effect."""
    nominal = machine.nominal()
    return nominal.with_(**{name: machine.effects[name].to_setting()})


def from_pose(problem: Problem, pose_deg: Array) -> Problem:
    """The task from where the arm stands."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", planner.InputWarning)
        return problem.from_pose(pose_deg)


def homed_compensation(plan: Plan, machine: Machine) -> Plan:
    """Commands for a machine whose axes are all ahead of their joints when the plan begins."""
    known = machine.nominal().with_(start_state="forward")
    return planner.compensate(plan, known, back_off=False)  # of spreads, which one arm has not


class KeptRule(HomingRule):
    """Keeps its controller, which says when it ended the slow turn."""

    controller: HomingController

    def start(self, plan: Plan, machine: Machine, numbers: Any) -> HomingController:
        """As of `HomingRule`."""
        self.controller = super().start(plan, machine, numbers)
        return self.controller


@dataclass(frozen=True, eq=False)
class Homed:
    """An arm that was homed by the rule, and was read.

    Attributes:
        problem: Of the arm.
        arm: The arm.
        sample: Number of its run.
        commands: What it was told until then, (K, 2).
        pose_deg: What 20 readings say, (3,).
    """

    problem: Problem
    arm: Machine
    sample: int
    commands: Array
    pose_deg: Array

    @classmethod
    def run(cls, problem: Problem, arm: Machine, sample: int) -> Homed:
        """Home an arm from somewhere in its backlash."""
        plan, rule = planner.homing(problem), KeptRule()
        planner.replay(plan, arm, [sample], SEED, rule, record_s=None)
        left = float(rule.controller.done_s[0])
        skipped = plan.notes["until"]["to_s"] - left
        t = TICK_S * np.arange(round((plan.duration - skipped) / TICK_S))
        u = plan.trajectory.u(t + np.where(t >= left - 1e-9, skipped, 0.0))
        commands = np.concatenate([u, np.zeros((round(WAIT_S / TICK_S), 2))])
        homed = cls(problem, arm, sample, commands, np.zeros(3))
        read = homed._angles(commands)[-round(WAIT_S / TICK_S) :][:20]
        noise = np.random.default_rng([SEED, sample]).normal(size=read.shape)
        step = 0.088
        return replace(homed, pose_deg=(np.round((read + NOISE_DEG * noise) / step) * step).mean(0))

    def end_after(self, plan: Plan) -> Array:
        """Angles once a plan's commands have been run too, degrees."""
        t = TICK_S * np.arange(round(plan.duration / TICK_S))
        u = np.concatenate([self.commands, plan.trajectory.u(t), np.zeros((50, 2))])
        return np.asarray(self._angles(u)[-1])

    def _angles(self, u: Array) -> Array:
        """True angles at the ticks of commands, (K, 3), degrees."""
        theta = np.repeat(self.problem.start[None, 1:], len(u), axis=0)
        log = Log(TICK_S * np.arange(len(u)), u, theta)
        run = planner.replay(
            log.plan(self.problem), self.arm, [self.sample], SEED, settle_s=0.0, record_s=TICK_S
        )
        return np.asarray(np.rad2deg(run.q[0, :, 1:]))


# -- a session -----------------------------------------------------------------------------------


def session() -> str:
    """A user's commands, timed; an emulated arm runs the motions meanwhile."""
    (arm,), rows = arms(1), []
    with tempfile.TemporaryDirectory() as name:
        place, problem = Path(name), ROOT / "problems/paper.toml"

        def command(*words: Any) -> None:
            environment = {**os.environ, "COLUMNS": "200"}
            before = os.times()
            subprocess.run(
                [sys.executable, "-m", "planner", *map(str, words), "--quiet"],
                check=True, cwd=place, env=environment, stdout=subprocess.DEVNULL,
            )  # fmt: skip
            after = os.times()
            took = after.children_user + after.children_system
            took -= before.children_user + before.children_system
            told = " ".join(str(w).replace(str(problem), "problem.toml") for w in words)
            rows.append([f"`planner {told}`", f"{took:.1f}"])

        def on_the_arm(words: str, seconds: float) -> None:
            rows.append([words, f"{seconds:.1f}"])

        command("motion", "homing", problem, "--out", "homing.json")
        command("motion", "excitation", problem, "--out", "excitation.json")
        motion = planner.load_plan(place / "excitation.json")
        as_it_is(motion, arm, 0).save(place / "1.csv")
        on_the_arm("the excitation on the arm", motion.duration)
        way = Homed.run(planner.load_problem(problem), arm, 1)
        on_the_arm("homing on the arm", TICK_S * len(way.commands))
        posed = np.repeat(np.deg2rad(way.pose_deg)[None], 60, axis=0)
        Log(TICK_S * np.arange(60), np.zeros((60, 2)), posed).save(place / "homed.csv")
        command("identify", "1.csv", "--problem", problem, "--out", "arm.toml")
        command("plan", problem, "--machine", "arm.toml", "--pose-from", "homed.csv",
                "--set", "machine.start_state=forward", "--set", "compensation.on=true",
                "--out", "plan.json")  # fmt: skip
        command("export", "plan.json", "--out", "plan.csv")
        plan = planner.load_plan(place / "plan.json")
        as_it_is(plan, arm, 2).save(place / "2.csv")
        on_the_arm("the plan on the arm", plan.duration)
        command("log", "2.csv", "--problem", problem, "--plan", "plan.json", "--out", "run.png")
    return table(["step", "s; of commands CPU s"], rows)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything, or some sections, and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=50)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, help="Sections to make anew.")
    parser.add_argument("--out", type=Path, default=ROOT / "results/identification")
    options = parser.parse_args(arguments)
    study, page = Study(options.arms), options.out / "README.md"
    words = (ROOT / "tests/benchmarks/identification.md").read_text(encoding="utf-8")
    parts = dict.fromkeys(SECTIONS, "")
    if options.only:
        parts |= dict(_sections(page.read_text(encoding="utf-8")))
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only or SECTIONS:
        began = time.perf_counter()
        made = session() if name == "session" else str(getattr(study, name)())
        only = f" --only {name}" if options.only else ""
        told = f"python tests/benchmarks/identification.py --arms {options.arms}{only}"
        signed = f"Made by `{told}` with {release()}."
        parts[name] = f"<!-- {name} -->\n{made}\n\n{signed}\n<!-- end -->"
        print(f"{name}: {time.perf_counter() - began:.0f} s\n{made}", flush=True)
        page.write_text(words.format(seed=SEED, **parts), encoding="utf-8")
    study.found(arms(1)[0], 0).plot().savefig(options.out / "identification.png", dpi=100)
    return 0


SECTIONS = ("thousand", "drift", "procedure", "exactness", "lacking", "inertia", "session")


def _sections(page: str) -> Iterator[tuple[str, str]]:
    """The sections of a page, each with the words that say how it was made."""
    for found in re.finditer(r"<!-- (\w+) -->\n.*?\n<!-- end -->", page, re.DOTALL):
        yield found[1], found[0]


if __name__ == "__main__":
    sys.exit(main())
