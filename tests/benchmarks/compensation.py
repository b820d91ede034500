"""What knowing the hardware is worth without sensors, and what it cannot take away.

python tests/benchmarks/compensation.py [--samples 1000]      # writes results/compensation
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
from matplotlib.figure import Figure

import planner
from planner import Machine, Plan, Replay
from planner.machine.feedforward.legs import reversals
from planner.machine.friction.contact_load import contact_load
from planner.plan.measures import peak_inputs
from planner.problem.tables.machine_effects import StartState
from planner.report.figures.style import GRID_STYLE, colour_of, shade_holds
from planner.report.result_folder import folder
from planner.support.arrays import Array
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
SEED = 2026
"""Nothing was chosen with this seed."""

WRONG = {
    "friction 20 % more": {"coulomb_friction_nm": 1.2, "viscous_friction_nms_per_rad": 1.2},
    "stiffness 20 % less": {"shaft_stiffness_nm_per_rad": 0.8},
    "backlash 50 % more": {"backlash_deg": 1.5},
}
PLAIN, DEFAULT = "as it is", "correction, forward preparation, backing off (the default)"
WAY = 'not compensated: planned with `end = "machine"`'
RANDOM = {3: (23, 15.0, 7), 4: (7, 35.0, 7)}
"""Random plans whose drive turns back, by the number of joints: how many, seconds, and the seed of
starts and goals, within 40 degrees. Nothing was chosen with these seeds."""
FRONT_S, FRONT_WEIGHTS = (10.0, 12.0, 15.0), (0.0, 5.0, 10.0, 20.0, 50.0)
"""Durations, and weights of the ends' spread, of the plans with `end = "machine"` of the front."""
SEEN_LATE = (
    *("initial_play", "initial_angle_error_deg", "input_bias_rad_s"),
    *("input_gain_error", "gear_ratio_error"),
)
"""Spreads whose effect on the end no open-loop plan changes much. The others (lost motion, sideways
friction) act less if the last swings become smaller and smaller, or where theta1 is small."""
FEW = 10
"""Machines whose pose is read and for each of which a plan is then made."""
NEXT = {"back": [1.0, 1.0, 1.0], "on": [40.0, 26.0, 9.0]}
"""Goals after that of the paper, degrees: the start of the paper, and another; in 20 s."""
METHODS = {"polynomial": {"points": "auto"}, "sinusoid": {}, "collocation": {}}
CAPACITIES_NM = (0.5, 1.0, 2.5, 5.0)
"""Beside that of the preset: over the range of typical parts, see results/calibration."""
OTHERS = ("crossing", "parking", "four-joint", "paper-fig4")


class Study:
    """All runs, on the same machines.

    Args:
        samples: Number of machines.
    """

    def __init__(self, samples: int) -> None:
        self.samples = samples
        self.machine = Machine.prototype()
        self.plain = planner.solve(planner.load_problem(ROOT / "problems/paper.toml"))
        self.turning = planner.solve(self.plain.problem, end="machine")
        self.better = planner.compensate(self.plain)

    def run(self, plan: Plan, machine: Machine | None = None) -> Replay:
        """A plan on the machines."""
        return planner.replay(plan, machine or self.machine, self.samples, SEED)

    def ways(self) -> tuple[str, dict[str, Replay]]:
        """The paper's problem by each way of compensating."""
        dynamic = Machine.prototype(fidelity="dynamic")
        rows: list[tuple[str, dict[str, Any] | None, Machine]] = [
            (PLAIN, None, self.machine),
            (WAY, None, self.machine),
            ("correction", {"preparation": False, "back_off": False}, self.machine),
            (DEFAULT, {}, self.machine),
            ("the same without backing off at the end", {"back_off": False}, self.machine),
            ("with inertia: as it is", None, dynamic),
            ("with inertia: the default", {}, dynamic),
        ]
        cells, runs = [], {}
        for label, options, machine in rows:
            began = time.perf_counter()
            plan = self.turning if label == WAY else self.plain
            if options is not None:
                plan = planner.compensate(self.plain, machine, **options)
            took = time.perf_counter() - began
            runs[label] = run = self.run(plan, machine)
            peaks = peak_inputs(plan.trajectory)
            own = ["", ""]
            if options is not None:
                own = [f"{plan.lead_s:.2f}, {plan.tail_s:.2f}", f"{took:.2f}"]
            price = [f"{plan.duration:.1f}", f"{plan.effort:.3g}"]
            cells.append([label, *errors(run), *price, *own, f"{peaks[0]:.3f}, {peaks[1]:.3f}"])
        head = [*HEAD, "whole s", "effort rad²/s", "before, after the plan s", "computed in s"]
        head.append("largest inputs rad/s")
        return table(["plan", *head], cells), runs

    def front(self) -> tuple[str, Figure, float]:
        """Effort and end of plans that end at the goal on the machine, and their floor."""
        settings = {name: q.to_setting() for name, q in self.machine.effects.items() if q.varies}
        calm = {name: s | {"spread": 0.0} for name, s in settings.items() if name not in SEEN_LATE}
        floor = percentile(self.run(self.turning, self.machine.with_(**calm)))
        figure = Figure(figsize=(9, 4.2), layout="constrained")
        axis, cells = figure.subplots(), []
        for seconds in FRONT_S:
            problem = self.plain.problem.changed({"goal.duration": seconds})
            points = []
            for weight in FRONT_WEIGHTS:
                try:
                    plan = planner.solve(problem, end="machine", spread_weight=weight)
                except planner.NoPlanError as error:
                    cells.append([f"{seconds:g}", f"{weight:g}", "", f"refused: {error.reason}"])
                    continue
                run = self.run(plan)
                points.append((plan.effort, percentile(run)))
                end = pair(run.terminal_E_deg)
                cells.append([f"{seconds:g}", f"{weight:g}", f"{plan.effort:.3g}", end])
            axis.plot(*np.transpose(points), "o-", label=f'end = "machine", {seconds:g} s')
        for run, words, mark in (
            (self.run(self.plain), "collocation, 10 s", "s"),
            (self.run(self.better), f"compensated, {self.better.duration:.1f} s", "D"),
        ):
            axis.plot(run.plan.effort, percentile(run), mark, color="black", fillstyle="none")
            words = f" {words}"
            axis.annotate(words, (run.plan.effort, percentile(run)), va="center", fontsize=9)
        axis.axhline(floor, color="black", linestyle="--", linewidth=1.2)
        axis.annotate("floor (estimate)", (0.3, floor), va="bottom", fontsize=9)
        axis.set_xlabel("effort (rad²/s)")
        axis.set_ylabel("end of 95 % of machines (deg)")
        axis.set_ylim(bottom=0.0)
        axis.grid(**GRID_STYLE)
        axis.legend(frameon=False, loc="upper right")
        words = "What a closer end costs without any sensor: effort beside the end's error"
        figure.suptitle(words, fontsize=11)
        return table(["s", "weight of the spread", "effort rad²/s", "end"], cells), figure, floor

    def wrong(self) -> str:
        """Machines whose mean is another than that allowed for."""
        cells = [["as it is told", *errors(self.run(self.better))]]
        for label, factors in WRONG.items():
            table_ = self.machine.to_dict()
            changed = {name: scaled(table_[name], by) for name, by in factors.items()}
            cells.append([label, *errors(self.run(self.better, self.machine.with_(**changed)))])
        return table(["the machines have", *HEAD], cells)

    def spreads(self) -> tuple[str, Array]:
        """What each spread leaves alone, and what is left without it."""
        found = []
        nominal = self.machine.nominal()
        for name, quantity in self.machine.effects.items():
            if quantity.varies:
                setting = quantity.to_setting()
                alone = self.run(self.better, nominal.with_(**{name: setting}))
                mean = {**setting, "spread": 0.0}
                without = self.run(self.better, self.machine.with_(**{name: mean}))
                spread = np.std(alone.terminal_error_deg, axis=0)
                found.append((name, spread, percentile(without), without.percentile(95)))
        found.sort(key=lambda row: -float(np.linalg.norm(row[1])))
        cells = [
            [f"`{name}`", *(f"{s:.2f}" for s in spread), f"{way:.2f}", f"{end:.2f}"]
            for name, spread, end, way in found
        ]
        root = np.linalg.norm([spread for _, spread, *_ in found], axis=0)
        joints = [f"theta{k + 1}" for k in range(len(root))]
        head = ["spread", *joints, "E 95 % without it", "end 95 % without it"]
        all_of = ["all, root sum of squares", *(f"{s:.2f}" for s in root), "", ""]
        return table(head, [*cells, all_of]), root

    def widths(self) -> str:
        """What other spreads, which have no source, would give: all of them halved and doubled."""
        cells = []
        for factor in (0.5, 1.0, 2.0):
            spread = {}
            for name, quantity in self.machine.effects.items():
                if quantity.varies:
                    setting = quantity.to_setting()
                    spread[name] = {**setting, "spread": scaled(setting["spread"], factor)}
            run = self.run(self.better, self.machine.with_(**spread))
            cells.append([f"times {factor:g}", pair(run.index_E_deg), pair(run.terminal_E_deg)])
        return table(["all spreads", "E", "end"], cells)

    def capacities(self) -> str:
        """Contacts that transmit less or more than the prototype's, and what that costs motor 1."""
        known = self.machine.effects["friction_capacity_nm"]
        preset = float(known.value[0])
        share = float(known.spread[0]) / preset
        cells = []
        for capacity in sorted([*CAPACITIES_NM, preset]):
            setting = {"value": capacity, "spread": share * capacity}
            machine = self.machine.with_(friction_capacity_nm=setting)
            load = contact_load(self.plain, machine, self.samples, SEED)
            before = self.run(self.plain, machine)
            after = self.run(planner.compensate(self.plain, machine), machine)
            slip = int(np.sum(before.slip_s > 0))
            used, motor = (np.percentile(v, 99) for v in (load.share, load.motor_nm))
            runs = [pair(v) for r in (before, after) for v in (r.index_E_deg, r.terminal_E_deg)]
            cells.append([f"{capacity:.3g}", f"{used:.2f}", str(slip), f"{motor:.2f}", *runs])
        head = ["capacity, N m", "load over that of gross slip", "slip", "torque of motor 1, N m"]
        return table([*head, "E as it is", "end as it is", "E", "end"], cells)

    def others(self) -> str:
        """Other problems and other methods."""
        cells = []
        asked = [(name, "collocation") for name in OTHERS]
        asked += [("paper", "sinusoid"), ("paper", "convex"), ("paper", "desensitised")]
        for name, method in asked:
            plain = planner.solve(planner.load_problem(ROOT / f"problems/{name}.toml"), method)
            label = name if method == "collocation" else f"{name}, {method}"
            cells.append([label, *self.compared(plain)[0]])
        return table(COMPARED, cells)

    def compared(self, plain: Plan) -> tuple[list[str], list[float]]:
        """The cells of `COMPARED` of a plan; E and end, 50 and 95 %, as it is and compensated, E
        from predicted likewise, and CPU time. Of a refused plan the figures are those of its
        prediction's commands."""
        began, why = time.process_time(), ""
        try:
            better = planner.compensate(plain)
        except planner.NoPlanError as error:
            if error.plan is None or error.plan.compensation is None:
                raise
            better, why = error.plan, " (refused)"
        took = time.process_time() - began
        before, after = self.run(plain), self.run(better)
        turns = len(reversals(plain)[1])
        held = sum(end - begin for begin, end in better.clock.holds)
        cells = [f"{turns}{why}", pair(before.index_E_deg), pair(after.index_E_deg)]
        cells += [pair(from_predicted(after)), pair(before.terminal_E_deg)]
        cells += [pair(after.terminal_E_deg), f"{better.lead_s:.1f}", f"{held:.1f}", f"{took:.1f}"]
        runs = [v for r in (before, after) for v in (r.index_E_deg, r.terminal_E_deg)]
        runs.append(from_predicted(after))
        return cells, [*np.concatenate([np.percentile(v, [50, 95]) for v in runs]).tolist(), took]

    def starts(self) -> str:
        """Methods, plain, compensated for an unwound arm, and for how it stood."""
        states = get_args(StartState)
        machines = [Machine.prototype(start_state=state) for state in states]
        cells = []
        for method, options in METHODS.items():
            plain = planner.solve(self.plain.problem, method, **options)
            rows = {
                "": [plain] * len(states),
                " compensated": [planner.compensate(plain)] * len(states),
                " compensated, told": [planner.compensate(plain, each) for each in machines],
            }
            for label, plans in rows.items():
                runs = list(map(self.run, plans, machines))
                cells.append([f"{method}{label}, E", *(pair(r.index_E_deg) for r in runs)])
                cells.append(["end", *(pair(r.terminal_E_deg) for r in runs)])
        return table(["plan", *states], cells)

    def moved(self) -> str:
        """An arm that has just run the compensated plan of the paper, at its next goal."""
        last, cells = self.better, []
        before = self.run(last)
        few = planner.replay(last, self.machine, FEW, SEED)
        poses = np.rad2deg(few.q[:, -1, 1:])
        changes = {"goal.travel": "free", "goal.duration": 20.0, "limits.z2_margin": None}
        free = last.problem.changed({**changes, "compensation.on": True})
        for words, goal in NEXT.items():
            task = free.changed({"goal.theta_deg": goal})

            def plan(asked: planner.Problem) -> Plan:
                return planner.solve(asked, "collocation")

            for label, asked in {
                "not told": task.from_pose(last.notes["end_theta_deg"]),
                "told (`--after last.json`)": task.after(last),
            }.items():
                run = planner.replay(plan(asked), self.machine, self.samples, SEED, after=before)
                ends = [pair(run.index_E_deg), pair(run.terminal_E_deg)]
                cells.append([words, label, str(self.samples), f"{run.plan.duration:.1f}", *ends])
            ways: dict[str, Plan | None] = {"not told, pose read": None}
            ways["told, pose read (`--after last.json --pose-from run.csv`)"] = last
            here = task.from_pose(last.notes["end_theta_deg"])
            ways["seated, pose read"] = planner.seating(here, self.machine)
            ways["homed, pose read"] = planner.homing(here)
            for label, motion in ways.items():
                errors, took = [], []
                for k in range(FEW):
                    run, pose, spent = few, poses[k], 0.0
                    if motion is not None and motion is not last:
                        rule = planner.HomingRule() if "until" in motion.notes else False
                        run = planner.replay(motion, self.machine, [k], SEED, rule, after=few)
                        pose, spent = np.rad2deg(run.q[0, -1, 1:]), float(motion.duration)
                    asked = task.from_pose(pose) if motion is None else task.after(motion, pose)
                    end = planner.replay(plan(asked), self.machine, [k], SEED, after=run)
                    errors.append([end.index_E_deg[0], end.terminal_E_deg[0]])
                    took.append(spent + end.plan.duration)
                ends = [pair(each) for each in np.transpose(errors)]
                cells.append([words, label, str(FEW), f"{np.median(took):.1f}", *ends])
        return table(["next goal", "the plan", "machines", "s", "E", "end"], cells)

    def random(self, joints: int) -> str:
        """Random plans whose drive turns back: each, the median and the largest of all."""
        count, seconds, seed = RANDOM[joints]
        rng, cells, figures = np.random.default_rng(seed), [], []
        while len(cells) < count:
            start, goal = np.round(rng.uniform(-40, 40, (2, joints)), 1)
            problem = planner.Problem.manipulator(
                start, goal, duration=seconds, input_rad_s=0.5, joint_deg=80
            )
            try:
                plain = planner.solve(problem, time_limit_s=60)
            except planner.NoPlanError:
                continue
            if reversals(plain)[1]:
                row, numbers = self.compared(plain)
                cells.append([str(len(cells) + 1), *row])
                figures.append(numbers)
        for name, by in (("median", np.median), ("largest", np.max)):
            f = by(np.array(figures), axis=0)
            pairs = [f"{f[k]:.2f} / {f[k + 1]:.2f}" for k in (0, 4, 8, 2, 6)]
            cells.append([name, "", *pairs, "", "", f"{f[10]:.1f}"])
        worse = sum(row[5] > row[1] for row in figures)
        cells.append(["above plain, E 95 %", str(worse), *[""] * 8])
        return table(COMPARED, cells)


def scaled(setting: Any, factor: float) -> Any:
    """A machine's setting with its mean times a factor."""
    if isinstance(setting, dict):
        return {**setting, "value": (factor * np.array(setting["value"])).tolist()}
    return (factor * np.array(setting)).tolist()


def percentile(run: Replay) -> float:
    """The 95th of the error at the end, degrees."""
    return float(np.percentile(run.terminal_E_deg, 95))


def pair(values: Array) -> str:
    """Median and 95th percentile."""
    middle, high = np.percentile(values, [50, 95])
    return f"{middle:.2f} / {high:.2f}"


def from_predicted(run: Replay) -> Array:
    """Largest |motion − plan.q| over the recorded times, degrees: from the motion predicted."""
    return largest_gap(run, run.plan)


def largest_gap(run: Replay, plan: Plan) -> Array:
    """Largest |motion − plan.q| over the recorded times, degrees."""
    gap = np.abs(run.q - plan.q(np.minimum(run.t, plan.duration)))[:, :, 1:]
    return np.asarray(np.rad2deg(gap.max(axis=(1, 2))))


HEAD = ["E", "E from predicted", "end"]
COMPARED = ["problem", "drive turns back", "E as it is", "E", "E from predicted", "end as it is"]
COMPARED += ["end", "preparation s", "held s", "CPU s"]


def errors(run: Replay) -> list[str]:
    """The cells of `HEAD`."""
    ideal, end = run.plan.compensates, pair(run.terminal_E_deg)
    if ideal is None:
        return [pair(run.index_E_deg), "", end]
    if not run.plan.is_compensated:  # whose index is measured from the motion predicted
        return [pair(largest_gap(run, ideal)), pair(run.index_E_deg), end]
    return [pair(run.index_E_deg), pair(from_predicted(run)), end]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def picture(before: Replay, turned: Replay, after: Replay) -> Figure:
    """θ₃ on the machines and its error, as planned: as it is, with the way that ends at the goal,
    compensated."""
    figure = Figure(figsize=(9, 6.4), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    lead, plain = after.plan.lead_s, before.plan
    t = np.linspace(-lead, plain.duration + after.plan.tail_s + 0.5, 800)
    planned = np.rad2deg(plain.trajectory.q(t)[:, 3])
    looks = [
        (before, 0.0, colour_of("collocation"), "not compensated"),
        (turned, 0.0, colour_of("sinusoid"), 'planned with end = "machine"'),
        (after, lead, colour_of("collocation compensated"), "compensated"),
    ]
    for run, late, colour, words in looks:
        own = run.t - late
        angle = np.rad2deg(run.q[:, :, 3])
        for axis, values in (
            (axes[0], angle),
            (axes[1], angle - np.rad2deg(plain.trajectory.q(own)[:, 3])),
        ):
            low, middle, high = np.percentile(values, [2.5, 50, 97.5], axis=0)
            axis.fill_between(own, low, high, color=colour, alpha=0.25, linewidth=0)
            axis.plot(own, middle, color=colour, linewidth=1.8, label=words)
    axes[0].plot(t, planned, color="black", linewidth=1.2, linestyle="--", label="planned")
    axes[1].axhline(0.0, color="black", linewidth=1.2, linestyle="--")
    axes[0].set_ylabel("θ3 (deg)")
    axes[1].set_ylabel("error of θ3 (deg)")
    axes[1].set_xlabel("time since the plan's start (s)")
    for axis in axes:
        axis.axvspan(-lead, 0.0, color="#EEEEEE", zorder=0)
        axis.grid(**GRID_STYLE)
        axis.set_xlim(-lead, t[-1])
    axes[0].text(
        -lead / 2, 16, "preparation:\ntakes up the\nbacklash", ha="center", va="center", fontsize=9
    )
    axes[0].legend(loc="upper left", bbox_to_anchor=(0.26, 1.0), frameon=False)
    figure.suptitle(
        f"Joint 3 of {len(before.numbers)} emulated machines without any sensor: median, and 95 %"
        " of the machines",
        fontsize=11,
    )
    return figure


def turn_picture(before: Replay, after: Replay) -> Figure:
    """θ₃ and its error around a turn: the plan with its clock held, the median machine as it is and
    compensated."""
    figure = Figure(figsize=(9, 6.4), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 1.5])
    plan, lead = after.plan, after.plan.lead_s
    wanted = np.rad2deg(plan.reference(after.t)[:, 3])
    own = np.rad2deg(before.plan.trajectory.q(before.t)[:, 3])
    axes[0].plot(after.t - lead, wanted, "k--", linewidth=1.2, label="plan, its clock held")
    looks = [
        (before, 0.0, own, colour_of("collocation"), "not compensated"),
        (after, lead, wanted, colour_of("collocation compensated"), "compensated"),
    ]
    for run, late, target, colour, words in looks:
        angle = np.rad2deg(run.q[:, :, 3])
        for axis, values in ((axes[0], angle), (axes[1], angle - target)):
            low, middle, high = np.percentile(values, [2.5, 50, 97.5], axis=0)
            axis.fill_between(run.t - late, low, high, color=colour, alpha=0.25, linewidth=0)
            axis.plot(run.t - late, middle, color=colour, linewidth=1.8, label=words)
    axes[2].plot(after.t - lead, plan.clock(after.t), color=colour_of("collocation compensated"))
    for axis, words in zip(
        axes, ("θ3 (deg)", "error of θ3 (deg)", "plan's clock (s)"), strict=True
    ):
        shade_holds(axis, plan)
        axis.set_ylabel(words)
        axis.grid(**GRID_STYLE)
        axis.set_xlim(0, after.t[-1] - lead)
    axes[2].set_xlabel("time since the plan's start (s)")
    axes[0].legend(frameon=False)
    figure.suptitle("Where the drive turns back the plan's clock is held (grey)", fontsize=11)
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=ROOT / "results/compensation")
    options = parser.parse_args(arguments)
    study = Study(options.samples)
    ways, runs = study.ways()
    wrong, (spreads, root) = study.wrong(), study.spreads()
    front, drawn_front, floor = study.front()
    text = (
        (ROOT / "tests/benchmarks/compensation.md")
        .read_text(encoding="utf-8")
        .format(
            samples=options.samples,
            seed=SEED,
            lead=study.better.lead_s,
            ways=ways,
            front=front,
            floor=floor,
            wrong=wrong,
            spreads=spreads,
            root2=root[1],
            root3=root[2],
            others=study.others(),
            three=study.random(3),
            four=study.random(4),
            starts=study.starts(),
            moved=study.moved(),
            widths=study.widths(),
            capacities=study.capacities(),
            provenance=provenance("make compensation"),
        )
    )
    crossing = planner.solve(planner.load_problem(ROOT / "problems/crossing.toml"))
    turn = turn_picture(study.run(crossing), study.run(planner.compensate(crossing)))
    with folder(options.out) as out:
        turn.savefig(out / "turn.png", dpi=130)
        drawn_front.savefig(out / "front.png", dpi=130)
        (out / "README.md").write_text(text, encoding="utf-8")
        drawn = picture(runs[PLAIN], runs[WAY], runs[DEFAULT])
        drawn.savefig(out / "compensation.png", dpi=130)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
