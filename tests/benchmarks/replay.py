"""How fast replays are: 1,000 machines through 10 s, against other ways to compute it.

    python tests/benchmarks/replay.py [--samples N] [--out FOLDER]

The same plan on the same machines (the prototype, quasi-static) by

- `planner.replay`, compiled, with one thread and with one a core;
- `planner.replay` in NumPy, as where no compiler was at hand;
- a loop in C written for this machine alone (replay.c), built here with -O3, one thread;
- scipy's solve_ivp on the same model as a differential equation, a few machines of them.

Each is the best of some runs, in turns, so that a busy computer disturbs all alike. That they agree
is checked before their times are given.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import copysign, cos, hypot, sqrt
from pathlib import Path
from time import perf_counter, process_time
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.integrate import solve_ivp

import planner
from planner.machine import compiled
from planner.machine.commands import Command, lengths
from planner.machine.machine import Draws
from planner.support.arrays import Array
from planner.support.files import write_text
from planner.support.package import provenance

ROOT, HERE = Path(__file__).parents[2], Path(__file__).parent
SOURCE = HERE / "replay.c"
SCIPY_SAMPLES = 3
OURS, HAND, SCIPY = "compiled, 1 thread", "C by hand", "solve_ivp"
CORES = len(os.sched_getaffinity(0))
K_G, K2, K3 = 0.668811, 0.870125, 0.711625
MACHINE = planner.Machine.prototype()
BANDWIDTH = MACHINE.effects["servo_bandwidth_rad_s"].value[0]


def plan_of() -> planner.Plan:
    """The paper's example over 10 s."""
    limits = {"limits": {}, "goal.travel": 0.828}
    return planner.solve(planner.load_problem(ROOT / "problems/paper.toml", limits), "polynomial")


# -- in C, by hand -------------------------------------------------------------------------


@dataclass
class ByHand:
    """replay.c on the machines of a replay."""

    replay: planner.Replay
    call: Any

    def __post_init__(self) -> None:
        run = self.replay
        plan, draws = run.plan, run.draws
        command = Command(plan, 0.01, draws, MACHINE.step_s, run.t)
        (self._h,) = set(lengths(command.t))
        self._commands = np.ascontiguousarray(command.block(0, len(command.t) - 1)[:, 0, :, 0])
        self._running = command.running.astype(np.uint8)
        self._desired = np.ascontiguousarray(plan.trajectory.q(command.t)[:, 1:])
        row = np.full(len(command.t), -1, dtype=np.int32)
        row[np.searchsorted(command.t, run.t)] = np.arange(len(run.t))
        self._row = row
        self._parameters, self._start = _numbers(draws, run.q[:, 0])
        self.q, self.speed = np.empty_like(run.q), np.empty_like(run.motor_rates)

    def __call__(self) -> None:
        """Run once."""
        count, rows, _ = self.q.shape
        gap = np.abs(self.q[:, 0, 1:] * 0)
        self.call(
            count, len(self._running), rows,
            *(ctypes.c_double(x) for x in (self._h, BANDWIDTH, 3.0, 30.0, K_G)),
            *(a.ctypes.data_as(ctypes.c_void_p) for a in (
                self._parameters, self._commands, self._running, self._desired, self._row,
                self._start, self.q, self.speed, gap)),
        )  # fmt: skip
        self.gap = gap


def _numbers(draws: Draws, start: Array) -> tuple[Array, Array]:
    """Parameters and start in the order of replay.c."""
    half = np.deg2rad(draws["backlash_deg"]) / 2
    k = K_G * np.array([[K2], [K3]]) * (1 + draws["gear_ratio_error"])
    rows = [
        1 + draws["input_gain_error"], draws["input_bias_rad_s"], draws["creep"],
        draws["creep_per_nm"], draws["friction_capacity_nm"], k,
        np.deg2rad(draws["gearhead_backlash_deg"]) / 2, draws["creep"] * 0, half,
        draws["shaft_stiffness_nm_per_rad"], draws["coulomb_friction_nm"],
        draws["viscous_friction_nms_per_rad"], draws["lateral_friction"],
    ]  # fmt: skip
    axes = start[:, 2:] + (draws["initial_play"] * half).T
    return np.concatenate(rows).T.copy(), np.concatenate([start, axes], axis=1)


def built(folder: Path) -> Any:
    """replay.c as a library."""
    target = folder / "replay.so"
    words = ["cc", "-O3", "-std=c99", "-shared", "-fPIC", str(SOURCE), "-lm", "-o", str(target)]
    subprocess.run(words, check=True)
    return ctypes.CDLL(str(target)).replay


# -- by scipy ------------------------------------------------------------------------------


def by_scipy(hand: ByHand, sample: int) -> Array:
    """The same machine as a differential equation; coordinates at the end, (4,).

    State: speeds of the motors, angle of gearhead 1 and of the disk after it, axis and angle of
    each joint, coordinate of the last disk. The play is a rate that is passed on in contact alone.
    """
    p = hand._parameters[sample].tolist()
    start = hand._start[sample].tolist()
    commands, delay, period = hand._commands, 0.005, 0.01
    over = hand.replay.plan.duration + delay
    ends = [*np.arange(delay, over - period / 2, period), over, hand.replay.t[-1]]

    def rates(t: float, x: Array) -> list[float]:
        return _rates(x.tolist(), p, *reference)

    x = np.array([0, 0, 0, 0, start[1], start[1], start[4], start[2], start[5], start[3], start[0]])
    begin = 0.0
    for end in ends:
        row = min(round((begin + (end - begin) / 2) / hand._h), len(commands) - 1)
        bias = p[2:4] if begin < hand.replay.plan.duration - 1e-9 else [0.0, 0.0]
        reference = [
            min(max(p[i] * float(commands[row, i]) + bias[i], -3.0), 3.0) for i in range(2)
        ]
        x = solve_ivp(rates, (begin, end), x, rtol=1e-6, atol=1e-9).y[:, -1]
        begin = end
    return x[[10, 5, 7, 9]]


def _rates(x: list[float], p: list[float], r1: float, r2: float) -> list[float]:
    w1, w2, m, disk, a1, t1, a2, t2, a3, t3, _ = x
    accelerations = [min(max(BANDWIDTH * (r - w), -30.0), 30.0) for r, w in ((r1, w1), (r2, w2))]
    c1, c2, sign = cos(t1), cos(t2), copysign(1.0, w1) if w1 else 0.0
    u = _passed_on(m - disk, p[9], w1)
    free2, free3 = _beyond(a2 - t2, p[12]), _beyond(a3 - t3, p[13])
    at3, at2 = p[7] * p[15] * free3 * sign, p[7] * p[14] * free2 * sign
    sideways1, sideways2 = p[20] * sqrt(1 - c1 * c1), p[20] * sqrt(1 - c2 * c2)
    middle2, part23 = _contact(at2, c1, sideways1, p)
    first2, part22 = _contact(middle2, c1, sideways1, p)
    middle3, part33 = _contact(at3, c2, sideways2, p)
    first3, part32 = _contact(middle3, c2, sideways2, p)
    driver3, part31 = _contact(first3, c2, sideways2, p)
    _, part21 = _contact(first2 + p[8] / p[7] * driver3, c1, sideways1, p)
    v1 = u * c1 * part21
    v2 = v1 * c2 * part31
    return [
        *accelerations, w1, u, w2, _passed_on(a1 - t1, p[10], w2),
        p[7] * part22 * part23 * v1 * c1 * c1,
        p[14] / p[18] * _beyond(a2 - t2, p[12] + p[16] / p[14]),
        p[8] * part32 * part33 * v2 * c2 * c2,
        p[15] / p[19] * _beyond(a3 - t3, p[13] + p[17] / p[15]),
        K_G * v1,
    ]  # fmt: skip


def _contact(load: float, cosine: float, sideways: float, p: list[float]) -> tuple[float, float]:
    """What the driver of a contact feels, N m, and the part of its rate that is passed on."""
    capacity, (creep, per_nm) = p[6], p[4:6]
    assert -0.99 * capacity < load < capacity * cosine / hypot(cosine, sideways)
    hold = sqrt(capacity * capacity - load * load)
    part = 1 - sideways * load / (cosine * hold)
    return load * cosine + sideways * hold, part * (1 - creep - per_nm * abs(load))


def _beyond(gap: float, half: float) -> float:
    return gap - min(max(gap, -half), half)


def _passed_on(gap: float, half: float, rate: float) -> float:
    return rate if (rate > 0 and gap >= half) or (rate < 0 and gap <= -half) else 0.0


# -- all together --------------------------------------------------------------------------


@dataclass
class Best:
    """The best of some runs: seconds on the clock, and of all processors together."""

    wall: float = np.inf
    cpu: float = np.inf

    def run(self, job: Callable[[], Any]) -> None:
        """Run once more."""
        wall, cpu = perf_counter(), process_time()
        job()
        self.wall = min(self.wall, perf_counter() - wall)
        self.cpu = min(self.cpu, process_time() - cpu)


def fastest(jobs: dict[str, Callable[[], Any]], runs: int) -> dict[str, Best]:
    """The best of so many runs of each job, in turns."""
    best = {name: Best() for name in jobs}
    for _ in range(runs):
        for name, job in jobs.items():
            best[name].run(job)
    return best


def replays(plan: planner.Plan, count: int) -> dict[str, Callable[[], planner.Replay]]:
    """Our own ways to replay, by name."""

    def compiled_by(threads: int) -> planner.Replay:
        with patch.object(compiled, "threads", lambda: threads):
            return planner.replay(plan, MACHINE, samples=count, seed=0)

    def in_numpy() -> planner.Replay:
        with patch("planner.machine.simulate.library", lambda: None):
            return planner.replay(plan, MACHINE, samples=count, seed=0)

    jobs = {f"compiled, {k} threads": partial(compiled_by, k) for k in range(2, CORES + 1)}
    return {OURS: partial(compiled_by, 1), **jobs, "NumPy": in_numpy}


def measured(samples: int, runs: int) -> list[tuple[str, Best, float]]:
    """Ways, their times, and how far they are from ours at most, rad."""
    plan = plan_of()
    jobs = replays(plan, samples)
    known = jobs[OURS]()
    gaps = {name: float(np.max(np.abs(job().q - known.q))) for name, job in jobs.items()}
    with tempfile.TemporaryDirectory() as folder:
        hand = ByHand(known, built(Path(folder)))
        best = fastest({**jobs, HAND: hand}, runs)
    gaps[HAND] = float(np.max(np.abs(hand.q - known.q)))
    one, ends = Best(), []
    for sample in range(SCIPY_SAMPLES):
        one.run(lambda sample=sample: ends.append(by_scipy(hand, sample)))
    best[SCIPY] = Best(one.wall * samples, one.cpu * samples)
    gaps[SCIPY] = float(np.max(np.abs(np.array(ends) - known.q[:SCIPY_SAMPLES, -1])))
    return [(name, best[name], gaps[name]) for name in best]


def page(rows: list[tuple[str, Best, float]], samples: int) -> str:
    """What was measured, as Markdown."""
    ours = next(best.cpu for name, best, _ in rows if name == OURS)
    lines = [
        f"| {name} | {best.wall:.3g} | {best.cpu:.3g} | {best.cpu / ours:.3g} | {gap:.0e} |"
        for name, best, gap in rows
    ]
    step = f"{1000 * MACHINE.step_s:g} ms"
    return f"""# How fast replays are

{samples} machines (prototype, quasi-static) through 10 s in steps of {step}, on {CORES} cores:

| way | clock (s) | processors (s) | against ours | largest difference (rad) |
| --- | ---: | ---: | ---: | ---: |
{chr(10).join(lines)}

"{HAND}" is tests/benchmarks/replay.c, written for this machine alone, by `cc -O3`, one thread.
"{SCIPY}" is the same model as a differential equation, restarted at every command (rtol 1e-6):
the fastest of {SCIPY_SAMPLES} machines times {samples}; its difference is that at the motion's end.
Times are the best of some runs in turns; "against ours" compares processor time.

{provenance("python tests/benchmarks/replay.py --out results/benchmarks")}
"""


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--out", type=Path, help="folder for replay.md")
    arguments = parser.parse_args()
    if compiled.library() is None:
        raise SystemExit("the package was installed without a compiler: nothing to measure")
    text = page(measured(arguments.samples, arguments.runs), arguments.samples)
    print(text)
    if arguments.out:
        write_text(arguments.out / "replay.md", text)


if __name__ == "__main__":
    main()
