"""The tracker on the prototype machine, and on machines that are worse than it was told.

python tests/benchmarks/robustness.py [--samples 1000]      # writes results/feedback
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import linprog

import planner
from planner import Machine, Plan, Problem, Replay, Tracker, replay
from planner.machine.feedback.course import turns_back
from planner.machine.feedback.reference import Reference
from planner.machine.feedback.tracker import TrackerControl
from planner.machine.machine import draw
from planner.report.figures.style import COLOURS, GRID_STYLE
from planner.report.result_folder import folder
from planner.support.arrays import Array
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
SEED = 0
FINE = 0.02
"""Resolution of the better encoders, degrees."""

NOISES = (False, 0.1)
"""Noise of the encoders, degrees, besides the prototype's."""

MOTIONS = (
    ([30, 30, 30], [1, 1, 1], 10.0),
    ([30, 30, 30], [-12, -13, -8], 15.0),
    ([-16.7, 1.1, -25.2], [4.6, -24.8, -2.7], 15.0),
    ([10.1, -22.3, 25.6], [25.9, -1.5, 12.7], 15.0),
    ([-17.4, 9.8, 10.9], [19.6, -23.3, -28.5], 15.0),
    ([-28.1, -3.5, 7.8], [-19.9, -26.7, -23.6], 15.0),
    ([12.0, 26.3, -9.8], [11.6, 5.2, -26.8], 15.0),
    ([5.2, -11.2, -29.3], [5.5, 11.9, -1.2], 15.0),
    ([15.2, 10.3, 8.7], [16.8, -15.7, -26.0], 15.0),
    ([-28.5, 16.8, -15.0], [-17.8, 3.5, -28.7], 15.0),
    ([29.1, -3.9, -26.6], [-1.9, 15.1, -10.1], 15.0),
    ([24.4, -22.1, -28.7], [18.1, 19.9, 7.8], 15.0),
)
"""Motions besides the paper's: start and goal, degrees, and duration, s. Two long ways back, and
ten at random within 30 degrees; the drive of the first two of these reverses."""

EACH = 12
"""Number of machines for each of these motions."""

Tamper = Callable[[Array], Array]
"""From what the encoders read (N, S) to what the tracker gets."""


@dataclass
class Flawed:
    """A tracker whose readings are tampered with, and the time its steps take."""

    tracker: Tracker
    tamper: Tamper | None = None

    def __post_init__(self) -> None:
        self.step_s: list[float] = []

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> TrackerControl:
        """See `planner.machine.closed_loop.Feedback`."""
        outer, control = self, self.tracker.start(plan, machine, numbers)

        class Tampered(TrackerControl):
            def __call__(self, t: float, measured: Array) -> Array:
                read = measured if outer.tamper is None else outer.tamper(measured)
                began = time.process_time()
                out = super().__call__(t, read)
                outer.step_s.append(time.process_time() - began)
                return out

        control.__class__ = Tampered
        return control


def lost(share: float, seed: int = 1) -> Tamper:
    """Each reading of each sample is lost with this probability."""
    rng = np.random.default_rng(seed)
    return lambda measured: np.where(rng.random(measured.shape[1]) < share, np.nan, measured)


def shifted(joint: int, degrees: float) -> Tamper:
    """The encoder of one joint reads too much."""

    def tamper(measured: Array) -> Array:
        out = measured.copy()
        out[joint] += np.deg2rad(degrees)
        return out

    return tamper


def both(*tampers: Tamper) -> Tamper:
    """One after the other."""

    def tamper(measured: Array) -> Array:
        for one in tampers:
            measured = one(measured)
        return measured

    return tamper


def spread(machine: Machine, factor: float) -> Machine:
    """Every spread times a factor; the means, which the tracker knows, stay."""
    changes: dict[str, Any] = {}
    for name, setting in machine.to_dict().items():
        if isinstance(setting, dict) and "spread" in setting:
            wide = np.multiply(setting["spread"], factor).tolist()
            changes[name] = {"value": setting["value"], "spread": wide}
    return machine.with_(**changes)


def slowed_polynomial(problem: Problem) -> Plan:
    """The paper's law at its best travel, slowed until it keeps the input limits."""
    limits = problem.to_dict()["limits"]
    free = problem.changed({"limits": {"joint_deg": limits["joint_deg"]}})
    plan = planner.solve(free, "polynomial")
    peak = planner.plan.measures.peak_inputs(plan.trajectory)
    factor = float(np.max(peak / problem.limits.input)) * (1 + 1e-6)
    slow = problem.changed({"goal.duration": plan.duration * factor})
    out = replace(plan, problem=slow, trajectory=plan.trajectory.slowed(factor))
    assert planner.verify(out).ok
    return out


Row = tuple[str, Replay]


def figures_of(run: Replay) -> list[str]:
    """Median and 95th percentile of E over all time and at the end, as table cells."""
    end = run.terminal_E_deg
    cells = [run.percentile(50), run.percentile(95), np.median(end), np.percentile(end, 95)]
    return [f"{cell:.3g}" for cell in cells] + [str(int(run.fallbacks.sum()))]


def table(rows: Sequence[Row]) -> str:
    """A Markdown table."""
    head = ["run", "E 50 %", "E 95 %", "end 50 %", "end 95 %", "fallbacks"]
    lines = [head, ["---"] + ["---:"] * 5, *([label, *figures_of(run)] for label, run in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def gain(rows: Sequence[Row]) -> str:
    """How many times lower the tracker's 95th percentiles are than the polynomial's."""

    def high(run: Replay) -> Array:
        return np.array([run.percentile(95), np.percentile(run.terminal_E_deg, 95)])

    way, end = high(rows[0][1]) / high(rows[2][1])
    fine_way, fine_end = high(rows[0][1]) / high(rows[3][1])
    return (
        f"{way:.0f} times lower at any time and {end:.0f} times at the end, with encoders of"
        f" {FINE:g} degrees {fine_way:.0f} and {fine_end:.0f} times"
    )


class Study:
    """All runs, on the same machines."""

    def __init__(self, samples: int) -> None:
        self.samples = samples
        self.problem = planner.load_problem(ROOT / "problems/paper.toml")
        self.plan = planner.solve(self.problem, "collocation")
        self.machine = Machine.prototype()
        self.fine = Machine.prototype(encoder_resolution_deg=FINE)
        self.tracker = Tracker()
        self.late: dict[float, float] = {}

    def closed(
        self,
        label: str,
        machine: Machine,
        tracker: Tracker,
        tamper: Tamper | None = None,
        samples: int | None = None,
        record: float | None = None,
    ) -> Row:
        """One run with feedback, said on standard error."""
        began = time.perf_counter()
        feedback = Flawed(tracker, tamper)
        count = samples or self.samples
        run = replay(self.plan, machine, count, SEED, feedback=feedback, record_s=record)
        took = time.perf_counter() - began
        print(f"{label:60} {figures_of(run)} {took:5.1f} s", file=sys.stderr, flush=True)
        return label, run

    def main_rows(self) -> list[Row]:
        """Open loop and closed, on the machine as it is."""
        law = slowed_polynomial(self.problem)
        opened = partial(replay, samples=self.samples, seed=SEED, record_s=None)
        rows = [
            ("open loop: polynomial, slowed to the limits", opened(law, self.machine)),
            ("open loop: collocation", opened(self.plan, self.machine)),
        ]
        for name, machine in (("0.088", self.machine), (f"{FINE:g}", self.fine)):
            rows.append(self.closed(f"feedback, encoders {name} deg", machine, self.tracker))
        for noise in NOISES:
            said = f"noise {noise:g} deg" if noise else "no noise"
            noisy = self.machine.with_(encoder_noise_deg=noise)
            label = f"feedback, encoders 0.088 deg, {said}"
            rows.append(self.closed(label, noisy, self.tracker))
        others: list[dict[str, Any]] = [
            {"path_error_deg": 0.2, "goal_error_deg": 0.1},
            {"path_error_deg": 0.3, "goal_error_deg": 0.015},
            {"path_error_deg": 3.0, "goal_error_deg": 0.05, "run_up": False},
        ]
        for options in others:
            said = "".join(f", `{key} = {str(value).lower()}`" for key, value in options.items())
            label = f"feedback, encoders {FINE:g} deg{said}"
            rows.append(self.closed(label, self.fine, Tracker(**options)))
        return rows

    def flawed_rows(self, samples: int) -> list[Row]:
        """What the tracker does not know of."""
        rows = []
        worst = both(shifted(3, 0.2), lost(0.05))
        for machine, name in ((self.machine, "0.088"), (self.fine, f"{FINE:g}")):
            run = partial(self.closed, tracker=self.tracker, samples=samples)
            start = f"encoders {name} deg"
            rows.append(run(f"{start}: as it should be", machine))
            rows.append(run(f"{start}: all spreads doubled", spread(machine, 2)))
            for joint in (1, 2, 3):
                label = f"{start}: encoder of joint {joint} reads 0.2 deg too much"
                rows.append(run(label, machine, tamper=shifted(joint, 0.2)))
            rows.append(run(f"{start}: one reading in twenty lost", machine, tamper=lost(0.05)))
            rows.append(run(f"{start}: all three (joint 3)", spread(machine, 2), tamper=worst))
        swinging = Machine.prototype(fidelity="dynamic")
        rows.append(run("encoders 0.088 deg: joints that swing (dynamic)", swinging))
        return rows

    def sweeps(self, samples: int) -> Figure:
        """Where it breaks: each flaw made worse and worse."""
        cases: list[tuple[str, Sequence[float], Callable[[float], dict[str, Any]]]] = [
            (
                "spreads, times the design",
                (1, 2, 3, 4, 6),
                lambda x: {"machine": spread(self.fine, x)},
            ),
            (
                "offset of encoder 3 (deg)",
                (0, 0.1, 0.2, 0.5, 1),
                lambda x: {"tamper": shifted(3, x)},
            ),
            ("readings lost (share)", (0, 0.05, 0.2, 0.5, 0.8), lambda x: {"tamper": lost(x)}),
            ("true delay (s); 0.005 known", (0.005, 0.02, 0.05, 0.1, 0.15), lambda x: {"late": x}),
        ]
        figure = Figure(figsize=(11, 3.2), layout="constrained")
        axes = figure.subplots(1, len(cases), sharey=True)
        for axis, (label, values, change) in zip(axes, cases, strict=True):
            runs = [self._changed(f"{label} = {x:g}", change(x), samples) for x in values]
            ways = [run.percentile(95) for run in runs]
            ends = [np.percentile(run.terminal_E_deg, 95) for run in runs]
            if "delay" in label:
                self.late = dict(zip(values, ways, strict=True))
            axis.plot(values, ways, "o-", color=COLOURS[0], label="at any time")
            axis.plot(values, ends, "s--", color=COLOURS[1], label="at the end")
            axis.set_xlabel(label)
            axis.set_yscale("log")
            axis.grid(**GRID_STYLE)
        axes[0].set_ylabel("largest error, 95 % (deg)")
        axes[0].legend(fontsize="small")
        return figure

    def _changed(self, label: str, changes: dict[str, Any], samples: int) -> Replay:
        machine, tracker = changes.get("machine", self.fine), self.tracker
        if "late" in changes:  # the tracker is designed for the machine that it believes in
            tracker = Believing(tracker, machine)
            machine = machine.with_(delay_s=changes["late"])
        return self.closed(label, machine, tracker, changes.get("tamper"), samples)[1]


class Believing(Tracker):
    """A tracker that takes every machine for the one it knows."""

    def __init__(self, tracker: Tracker, known: Machine) -> None:
        super().__init__(tracker.options)
        self._known = known

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> TrackerControl:
        """See `Tracker`."""
        return super().start(plan, self._known, numbers)


def preparation(study: Study) -> dict[str, str]:
    """How long the arm prepares, and how far joints go; with doubled spreads; swinging."""

    def reference(machine: Machine) -> Reference:
        return study.tracker.design(study.plan, machine).ref

    ref = reference(study.machine)
    q = np.rad2deg(ref.q[ref.s <= 0])
    slow = Machine.prototype(fidelity="dynamic")
    return {
        "LEAD": f"{-ref.timing.begin:.0f}",
        "UP": f"{q[:, 1].max():.0f}",
        "BACK": f"{np.max(q[-1, 2:] - q[:, 2:].min(axis=0)):.0f}",
        "WIDE": f"{-reference(spread(study.machine, 2)).timing.begin:.0f}",
        "SLOW": f"{-reference(slow).timing.begin:.0f}",
    }


def listed(words: Iterable[str]) -> str:
    """In one sentence."""
    *most, last = words
    return f"{', '.join(most)} and {last}"


def objections(study: Study, samples: int) -> str:
    """What the paper holds against feedback, measured."""
    _, run = study.closed("objections", study.machine, study.tracker, None, samples, 0.02)
    z2 = planner.chained_form(study.problem.system).z(run.q)[..., 1]
    before, runs = z2[:, run.t < 0], z2[:, run.t >= 0]
    beyond = np.rad2deg(run.q[:, :, 2:] - study.problem.goal[2:]).max()
    return (
        f"Over {samples} machines, once the plan runs: z2 never rises above {runs.max():.4f} (the"
        f" margin asked for is -{study.problem.limits.z2_margin:g}; the plan begins at"
        f" {runs[:, 0].mean():.4f}), and no passive joint overshoots its goal of 30 degrees by more"
        f" than {beyond:.2f} degrees. In the preparation before, which no limit on z2 bounds, z2"
        f" rises to {before.max():.2f}: only the chart is singular there."
    )


def least_possible(study: Study, samples: int) -> str:
    """The least E of each machine, to first order, if its gear ratios were known in advance.

    A linear programme: corrections without any limit, start within E, no other flaw.
    """
    ref = study.tracker.design(study.plan, study.fine).ref
    first = int(np.argmax(ref.s >= 0))
    gears = draw(study.fine, 3, np.arange(samples), SEED)["gear_ratio_error"]
    # δθ at each period's end as a linear function of (δq(0), v₀, v₁, …), and of ε
    count, size = len(ref.feed) - first, 4
    rows, drift = [], []
    Z, e = np.zeros((size, size + 2 * count)), np.zeros((size, 2))
    Z[:, :size] = np.eye(size)
    for j in range(count):
        rows.append(Z[1:].copy())
        drift.append(e[1:].copy())
        k = first + j
        Z, e = ref.A[k] @ Z, ref.A[k] @ e + ref.E[k][:, :2]
        Z[:, size + 2 * j : size + 2 * j + 2] += ref.B[k]
    Z, e = np.concatenate(rows), np.concatenate(drift)
    ones = np.ones((len(Z), 1))
    A = np.block([[Z, -ones], [-Z, -ones]])
    cost = np.zeros(A.shape[1])
    cost[-1] = 1.0
    least = []
    for epsilon in gears.T:
        shift = e @ epsilon
        found = linprog(cost, A, np.concatenate([-shift, shift]), bounds=(None, None))
        least.append(np.rad2deg(found.fun))
    return f"{np.percentile(least, 95):.2f}"


def motions(study: Study) -> str:
    """E and the end of all motions together, for each noise of the encoders, as a table."""
    plans = [study.plan]
    for start, goal, seconds in MOTIONS:
        changes = {"start.theta_deg": start, "goal.theta_deg": goal, "goal.duration": seconds}
        problem = study.problem.changed({**changes, "limits.z2_margin": None})
        plan = planner.solve(problem, "collocation")
        plans.append(planner.compensate(plan, study.machine) if turns_back(plan) else plan)
    one_way = np.array([plan.compensates is None for plan in plans])
    lines = [
        "| motions | noise | E 50 % | E 95 % | worst | end 50 % | end 95 % |",
        "|---" * 7 + "|",
    ]
    for noise in (False, 0.03, 0.1):
        machine = study.machine.with_(encoder_noise_deg=noise)
        runs = [replay(plan, machine, EACH, SEED, True, record_s=None) for plan in plans]
        for which, label in ((one_way, "one way"), (~one_way, "reversing, compensated")):
            chosen = [run for run, is_meant in zip(runs, which, strict=True) if is_meant]
            way = np.concatenate([run.index_E_deg for run in chosen])
            end = np.concatenate([run.terminal_E_deg for run in chosen])
            cells = [*np.percentile(way, [50, 95, 100]), *np.percentile(end, [50, 95])]
            said = " | ".join(f"{cell:.2f}" for cell in cells)
            lines.append(f"| {len(chosen)} {label} | {noise:g} deg | {said} |")
    return "\n".join(lines)


TURNING = ("crossing", "parking", "paper-fig4", "four-joint")
"""Problems whose plans of collocation turn the drive back on its way."""


def turns(machine: Machine, samples: int) -> str:
    """What closing the loop gains at the end of compensated plans that turn back."""
    found = []
    for name in TURNING:
        problem = planner.load_problem(ROOT / f"problems/{name}.toml")
        plain = planner.solve(problem, "collocation")
        try:
            plan = planner.compensate(plain, machine)
        except planner.NoPlanError:
            found.append(f"{name} none, for its compensation is refused")
            continue
        ends = [
            np.percentile(
                replay(plan, machine, samples, SEED, closed, record_s=None).terminal_E_deg, [50, 95]
            )
            for closed in (False, True)
        ]
        opened, closed = (f"{end[0]:.2f} and {end[1]:.2f}" for end in ends)
        found.append(f"{name} {closed} degrees, {opened} in open loop")
    return "; ".join(found) + "."


def step_times(study: Study) -> str:
    """Processor time of single control steps, one sample at a time."""
    feedback = Flawed(study.tracker)
    for k in range(10):
        replay(study.plan, study.machine, [k], SEED, feedback=feedback, record_s=None)
    median, high = np.percentile(np.array(feedback.step_s) * 1e3, [50, 99])
    return (
        f"One control step of one arm takes {median:.1f} ms of processor time in the median and"
        f" {high:.1f} ms in the 99th percentile ({len(feedback.step_s)} steps) of a period of 100."
    )


def main() -> int:
    """Run everything and write the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1000)
    samples = parser.parse_args().samples
    study = Study(samples)
    fewer = max(1, samples // 5)
    rows = study.main_rows()
    figure = study.sweeps(max(1, samples // 20))
    parts = {
        "MADE_BY": provenance("make robustness"),
        "MAIN": table(rows),
        "GAIN": gain(rows),
        "LATE": f"{rows[-1][1].percentile(50):.1f}",
        **preparation(study),
        "DELAYS": listed(f"{value:g}" for value in study.late),
        "LATES": listed(f"{error:.2g}" for error in study.late.values()),
        "FLAWED": table(study.flawed_rows(fewer)),
        "MOTIONS": motions(study),
        "TURNS": turns(study.fine, fewer),
        "FEWER": str(fewer),
        "SAMPLES": str(samples),
        "OBJECTIONS": objections(study, fewer),
        "STEPS": step_times(study),
        "LEAST": least_possible(study, min(fewer, 100)),
    }
    text = (Path(__file__).parent / "robustness.md").read_text(encoding="utf-8")
    for key, value in parts.items():
        text = text.replace(f"<{key}>", value)
    with folder(ROOT / "results" / "feedback") as place:
        (place / "README.md").write_text(text, encoding="utf-8")
        figure.savefig(place / "robustness.png", dpi=110)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
