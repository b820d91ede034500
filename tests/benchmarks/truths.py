"""The whole procedure of docs/howto/bench.md on arms that differ more and more from the model.

    python tests/benchmarks/truths.py                  # writes results/truths
    python tests/benchmarks/truths.py --truths T1 T5 --arms 1   # some of it, to look at

The arm is truths.c, which shares no code with planner/machine; the package sees only its logs.
A folder under out/ keeps finished arms, and the same command of the same code goes on where it was
ended.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shlex
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import results_pages
from matplotlib.figure import Figure
from rich.progress import Progress

import planner
from planner import Identification, Log, Machine, Plan, Problem
from planner.support.arrays import Array
from planner.support.package import provenance
from planner.support.tables import Column, markdown_table

ROOT, HERE = Path(__file__).parents[2], Path(__file__).parent
SEED = 31077
TICK_S, REST_S = 0.01, 0.5
NOISE_DEG, RESOLUTION_DEG, PLACED_DEG = 0.03, 0.088, 0.3
"""Of the encoders; standard deviation of the pose to which an arm is brought by hand."""
GOALS = {(30.0, 30.0, 30.0): 10.0, (25.0, -20.0, 10.0): 14.0, (20.0, 25.0, -15.0): 14.0}
"""Goals, degrees, and the time for each, s; the drive reverses on the way to the last two."""

D = float(np.pi / 180)
Numbers = dict[str, Any]
"""An arm, in degrees and SI units, by the names of `Machine` where it has them."""

# -- the arm -----------------------------------------------------------------------------------


def _fields(text: str) -> list[tuple[str, Any]]:
    """Fields of a structure of doubles: "a b[2]"."""
    parts = [word.rstrip("]").split("[") for word in text.split()]
    return [(p[0], ctypes.c_double * int(p[1]) if p[1:] else ctypes.c_double) for p in parts]


class CArm(ctypes.Structure):
    """`Arm` of truths.c."""

    _fields_ = _fields(
        "step_s gain[2] bias[2] bandwidth[2] damping most_speed most_ramp gearhead[2] k_g k[2]"
        " creep creep_per_nm lateral capacity eccentric[3] phase[3] gap[2] edge gap_swing"
        " friction_swing breakaway one_way stiffness[2] coulomb[2] viscous[2] cable[2]"
        " cable_rest[2] inertia[2] reach[3] shaft_damping"
    )


class CState(ctypes.Structure):
    """`State` of truths.c."""

    _fields_ = _fields(
        "speed[2] ramp[2] motor[2] disk last axis[2] theta[3] before spin[2] stuck[2] command[2]"
        " pending[18] count"
    )


def built(folder: Path) -> Any:
    """truths.c as a function."""
    target = folder / "truths.so"
    words = ["cc", "-O3", "-std=c99", "-shared", "-fPIC", str(HERE / "truths.c"), "-lm"]
    subprocess.run([*words, "-o", str(target)], check=True)
    return ctypes.CDLL(str(target)).run


def drawn(k: int) -> Numbers:
    """Arm number k, of the class of the package's machine; the first has much backlash."""
    rng = np.random.default_rng([SEED, k])

    def about(value: float, share: float, count: int = 2) -> list[float]:
        return [round(x, 5) for x in (value * (1 + share * rng.normal(size=count))).tolist()]

    friction = about(0.147, 0.2, 1) + about(0.198, 0.2, 1)
    return {
        "backlash_deg": [4.8, 2.1] if k == 0 else about(2.65, 0.2),
        "coulomb_friction_nm": friction,
        "shaft_stiffness_nm_per_rad": about(3.33, 0.1),
        "viscous_friction_nms_per_rad": about(0.0449, 0.2),
        "servo_bandwidth_rad_s": about(67.2, 0.1),
        "gearhead_backlash_deg": about(0.504, 0.2),
        "input_gain_error": about(0.003, 1.0),
        "input_bias_rad_s": about(0.0005, 1.0),
        "gear_ratio_error": [0.0, 0.0],
        "lateral_friction": max(0.02, *about(0.1, 0.5, 1)),
        "friction_capacity_nm": about(1.58, 0.1, 1)[0],
        "creep": 0.00316,
        "creep_per_nm": about(0.00446, 0.2, 1)[0],
        "delay_s": 0.005,
    }


def _ratios_and_drives(arm: Numbers) -> Numbers:
    natural = [1.4 * b for b in arm["servo_bandwidth_rad_s"]]  # their lag is 2 z / b
    more = {"servo_bandwidth_rad_s": natural, "damping": 0.7, "delay_s": 0.012}
    return {**arm, **more, "gear_ratio_error": [0.005, -0.005], "jitter_s": 0.003}


def _edges_and_friction(arm: Numbers) -> Numbers:
    return {**arm, "edge_deg": 0.15, "breakaway": 0.1, "friction_swing": 0.1}


def _eccentric(arm: Numbers) -> Numbers:
    return {**arm, "eccentric": [0.005, 0.005, 0.005], "encoder_eccentric_deg": [0.15, 0.05]}


def _inertia(arm: Numbers) -> Numbers:
    inertia = {"inertia": [0.05, 0.0316], "reach": [0.02, 0.012, 0.012], "shaft_damping": 0.02}
    return {**arm, **inertia}


def _rest(arm: Numbers) -> Numbers:
    more = {"gap_swing": 0.1, "one_way": 0.1, "cable": [0.03, 0.03], "zero_deg": [0.6, -0.4, 0.0]}
    return {**arm, **more}


ADDED = (_ratios_and_drives, _edges_and_friction, _eccentric, _inertia, _rest)
"""What truths 2 ... 6 add to an arm of the model's own class, truth 1."""


CASES: dict[str, tuple[int, dict[str, Any]]] = {
    "T1": (1, {}),
    "T2": (2, {}),
    "T2, limited": (2, {"limits.input_rate_rad_s2": 2.0}),
    **{f"T{truth}": (truth, {}) for truth in range(3, len(ADDED) + 2)},
}
"""Truths, and what is changed in the problem."""


def arm_of(truth: int, k: int) -> Numbers:
    """Arm number k as truth number `truth`, from 1."""
    arm = drawn(k)
    for adds in ADDED[: truth - 1]:
        arm = adds(arm)
    return arm


class Arm:
    """An arm on the bench: it keeps its state from run to run.

    Args:
        run: truths.c.
        numbers: What it is.
        problem: Whose ratios it was built for.
        seed: Of its noise and of where it stands.
        steps: Steps of the simulation in a period of the controller.
    """

    def __init__(
        self, run: Any, numbers: Numbers, problem: Problem, seed: Sequence[int], steps: int = 100
    ) -> None:
        self.numbers, self._run, self._steps = numbers, run, steps
        self.rng = np.random.default_rng(seed)
        n, system = numbers, problem.system
        k_g = system.k_g
        self._arm = CArm(
            step_s=TICK_S / steps, damping=n.get("damping", 0.0), most_speed=3.0, most_ramp=30.0,
            k_g=k_g, creep=n["creep"], creep_per_nm=n["creep_per_nm"],
            lateral=n["lateral_friction"], capacity=n["friction_capacity_nm"],
            edge=D * n.get("edge_deg", 0.0), gap_swing=n.get("gap_swing", 0.0),
            friction_swing=n.get("friction_swing", 0.0), breakaway=n.get("breakaway", 0.0),
            one_way=n.get("one_way", 0.0), shaft_damping=n.get("shaft_damping", 0.0),
        )  # fmt: skip
        lists = {
            "gain": [1 + e for e in n["input_gain_error"]],
            "bias": n["input_bias_rad_s"],
            "bandwidth": n["servo_bandwidth_rad_s"],
            "gearhead": [D * b / 2 for b in n["gearhead_backlash_deg"]],
            "k": [k_g * K * (1 + e) for K, e in zip(system.K, n["gear_ratio_error"], strict=True)],
            "eccentric": n.get("eccentric", [0.0] * 3),
            "phase": self.rng.uniform(0, 2 * np.pi, 3),
            "gap": [D * b / 2 for b in n["backlash_deg"]],
            "stiffness": n["shaft_stiffness_nm_per_rad"],
            "coulomb": n["coulomb_friction_nm"],
            "viscous": n["viscous_friction_nms_per_rad"],
            "cable": n.get("cable", [0.0] * 2),
            "cable_rest": [0.35, 0.35],
            "inertia": n.get("inertia", [0.0] * 2),
            "reach": n.get("reach", [0.0] * 3),
        }
        for name, values in lists.items():
            getattr(self._arm, name)[:] = list(values)
        self._turn = self.rng.uniform(0, 2 * np.pi, 3)  # of the encoders' wheels
        self.state = CState()

    @property
    def theta_deg(self) -> Array:
        """The true angles, (3,), degrees."""
        return np.array(self.state.theta) / D

    def place(self, theta_deg: Sequence[float], play: Sequence[float] | None = None) -> None:
        """Put it at rest at a pose; its axes are anywhere in their gaps, or at `play`, -1 ... 1."""
        self.state = CState()
        share = self.rng.uniform(-1, 1, 4) if play is None else np.array([*play, 0.0, 0.0])
        theta = [D * a for a in theta_deg]
        self.state.theta[:] = theta
        for j in range(2):
            self.state.axis[j] = theta[j + 1] + float(share[j]) * self._arm.gap[j]
        self.state.motor[0] = float(share[2]) * self._arm.gearhead[0]
        self.state.motor[1] = theta[0] + float(share[3]) * self._arm.gearhead[1]
        self.state.stuck[:] = [1.0, 1.0]

    def period(self, u: Array, held: bool = False) -> Array:
        """Run commands (K, 2), rad/s, of a period each; true angles at their beginnings (K, 3)."""
        u = np.ascontiguousarray(np.round(np.asarray(u, float) / 0.001) * 0.001)
        late = self.numbers["delay_s"] + self.numbers.get("jitter_s", 0.0) * self.rng.random(len(u))
        late = np.round(late / self._arm.step_s)
        theta = np.empty((len(u), 3))
        pointers = (a.ctypes.data_as(ctypes.c_void_p) for a in (u, late))
        self._run(
            ctypes.byref(self._arm), ctypes.byref(self.state), len(u), self._steps, *pointers,
            int(not held), theta.ctypes.data_as(ctypes.c_void_p),
        )  # fmt: skip
        return theta

    def read(self, theta: Array) -> Array:
        """What the encoders say of true angles (K, 3), rad: degrees."""
        once, twice = self.numbers.get("encoder_eccentric_deg", [0.0, 0.0])
        off = once * np.sin(theta + self._turn) + twice * np.sin(2 * theta + self._turn)
        read = theta / D + off + self.numbers.get("zero_deg", [0.0] * 3)
        noisy = read + NOISE_DEG * self.rng.normal(size=read.shape)
        return np.round(noisy / RESOLUTION_DEG) * RESOLUTION_DEG

    def play(self, u: Array) -> Log:
        """Run commands (K, 2); then it rests with its drives held."""
        rest = np.zeros((round(REST_S / TICK_S), 2))
        theta = np.concatenate([self.period(u), self.period(rest, held=True)])
        return self._log(np.concatenate([u, rest]), self.read(theta))

    def home(self, plan: Plan) -> Log:
        """Home it by its encoders, as the loop of a controller does."""
        player = planner.Player(plan, noise_deg=NOISE_DEG)
        said, read = [], []
        while True:
            now = self.read(np.array([self.state.theta]))[0]
            if (u := player(TICK_S * len(said), now)) is None:
                break
            said.append(u)
            read.append(now)
            self.period(u[None])
        rest = np.zeros((round(REST_S / TICK_S), 2))
        read.extend(self.read(self.period(rest, held=True)))
        return self._log(np.concatenate([said, rest]), np.array(read))

    @staticmethod
    def _log(u: Array, read_deg: Array) -> Log:
        return Log(t=TICK_S * np.arange(len(u)), u=u, theta=D * read_deg, source="the arm")


# -- the procedure -----------------------------------------------------------------------------


@dataclass(frozen=True)
class End:
    """The runs to one goal: largest errors of a joint, degrees.

    Attributes:
        predicted: Of the first plan's end on the identified machine, from the goal.
        surprise: Of the first run's end, from what was predicted.
        preset: Of the end of a run that knows only the preset, from the goal.
        first, again: Of the first run's end and of the one that aims again, from the goal.
    """

    predicted: float
    surprise: float
    preset: float
    first: float
    again: float


@dataclass(frozen=True, eq=False)
class Session:
    """One arm from its first log to its goals.

    Attributes:
        case: Key of `CASES`.
        numbers: What it is.
        found: What was found, by the keys of `Identification`.
        kept_out_deg: Errors (rms) of the passive joints in the run that was kept out, of the
            identified machine and of the preset.
        half_width_deg: As told.
        warnings: Of the identification.
        ends: The runs to each goal.
        cpu_s: What all this took.
    """

    case: str
    numbers: Numbers
    found: dict[str, float]
    kept_out_deg: dict[str, list[float]]
    half_width_deg: float
    warnings: list[str]
    ends: list[End]
    cpu_s: float

    @property
    def covered(self) -> list[bool]:
        """Whether each first run ended as near to its prediction as told."""
        return [each.surprise <= self.half_width_deg for each in self.ends]


class Bench:
    """What one does with an arm, step by step as in docs/howto/bench.md.

    Args:
        arm: The arm.
        problem: The task, as it was written before the arm was known.
        folder: For exported plans.
    """

    def __init__(self, arm: Arm, problem: Problem, folder: Path) -> None:
        self.arm, self.problem, self.folder = arm, problem, folder
        self.homing = planner.homing(problem)
        self._zeros = np.zeros(3)

    def identify(self) -> Identification:
        """Record the excitation and the check, and identify."""
        logs = []
        for motion in (planner.excitation(self.problem), planner.check_run(self.problem)):
            self._by_hand()
            logs.append(self.run(motion))
        found = planner.identify(logs, self.problem)
        keys = {each.parameter.key: each.value for each in found.estimates}
        self._zeros = np.array([keys.get(f"zero{i}", 0.0) for i in (1, 2, 3)])
        return found

    def run(self, plan: Plan) -> Log:
        """Export a plan, and run the commands of the file."""
        path = self.folder / "plan.csv"
        planner.export(plan, path, rate_hz=1 / TICK_S)
        table = np.genfromtxt(path, delimiter=",", names=True)
        self.commands = np.stack([table["u1_rad_s"], table["u2_rad_s"]], axis=1)
        return self.arm.play(self.commands)

    def home(self) -> Array:
        """Home the arm; the pose read then, degrees."""
        return self._pose(self.arm.home(self.homing))

    def to(self, goal: Sequence[float], duration: float, found: Identification) -> End:
        """Plan from the homed arm to a goal and run; home it anew, and aim off by the error."""
        machine, preset = (
            each.with_(start_state="forward") for each in (found.machine, Machine.prototype())
        )
        self._by_hand()
        task = self.problem.changed({"goal.theta_deg": list(goal), "goal.duration": duration})
        task = task.after(self.homing, self.home())
        ideal, homed = planner.solve(task, "collocation"), deepcopy(self.arm.state)
        self.run(planner.compensate(ideal, preset))
        ends = [self.arm.theta_deg]
        self.arm.state = homed
        plan = planner.compensate(ideal, machine)
        said = np.array(plan.notes["end_theta_deg"])
        read = self._pose(self.run(plan))
        ends.append(self.arm.theta_deg)
        surprise = float(np.abs(self.arm.theta_deg - said).max())
        self._by_hand()
        again = task.again(plan, read).from_pose(self.home())
        self.run(planner.compensate(planner.solve(again, "collocation"), machine))
        ends.append(self.arm.theta_deg)
        off = [float(np.abs(end - goal).max()) for end in (said, *ends)]
        return End(off[0], surprise, *off[1:])

    def _by_hand(self) -> None:
        start = self.problem.start[1:] / D
        self.arm.place((start + self.arm.rng.normal(0, PLACED_DEG, 3)).tolist())

    def _pose(self, log: Log) -> Array:
        return log.pose_deg - self._zeros


def session(run: Any, case: str, number: int, folder: Path, tell: Callable[[], None]) -> Session:
    """One arm, from its first log to all goals."""
    began = time.process_time()
    truth, changes = CASES[case]
    changes = {"limits.z2_margin": None, **changes}
    problem = planner.load_problem(ROOT / "problems/paper.toml", changes)
    numbers = arm_of(truth, number)
    bench = Bench(Arm(run, numbers, problem, [SEED, truth, number]), problem, folder)
    found = bench.identify()
    tell()
    ends = []
    for goal, duration in GOALS.items():
        ends.append(bench.to(goal, duration, found))
        tell()
    return Session(
        case,
        numbers,
        {each.parameter.key: each.value for each in found.estimates},
        {name: list(error.rms_deg[1:]) for name, error in found.errors.items()},
        found.half_width_deg,
        list(found.warnings),
        ends,
        time.process_time() - began,
    )


def kept(path: Path, make: Callable[[], Session]) -> Session:
    """A session that was run before, or one that is run now and kept."""
    if path.exists():
        data = json.loads(path.read_text("utf-8"))
        return Session(**{**data, "ends": [End(**end) for end in data["ends"]]})
    made = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(made)), encoding="utf-8")
    return made


# -- the page ----------------------------------------------------------------------------------


def built_as(numbers: Numbers) -> dict[str, float]:
    """What a log can show of an arm, by the keys of `Identification`, in their units."""
    lost = [
        backlash / 2 + friction / stiffness / D
        for backlash, friction, stiffness in zip(
            numbers["backlash_deg"],
            numbers["coulomb_friction_nm"],
            numbers["shaft_stiffness_nm_per_rad"],
            strict=True,
        )
    ]
    late = numbers["delay_s"] + numbers.get("jitter_s", 0.0) / 2
    gain = 1 + numbers["input_gain_error"][0]
    natural = numbers["servo_bandwidth_rad_s"][0]
    return {
        "w2": lost[0],
        "w3": lost[1],
        "ratio2": 100 * (gain * (1 + numbers["gear_ratio_error"][0]) - 1),
        "ratio3": 100 * (gain * (1 + numbers["gear_ratio_error"][1]) - 1),
        "servo1": 1000 * (late + max(1.0, 2 * numbers.get("damping", 0.0)) / natural),
        "gear1": numbers["gearhead_backlash_deg"][0],
        "lateral": numbers["lateral_friction"],
    }


def rms(values: Any) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _of(sessions: Sequence[Session], name: str) -> list[float]:
    return [getattr(end, name) for each in sessions for end in each.ends]


def _lost(sessions: Sequence[Session]) -> str:
    """Errors of the lost motion of joints 2 and 3."""
    return " / ".join(
        f"{rms([x.found[w] - built_as(x.numbers)[w] for x in sessions]):.2f}" for w in ("w2", "w3")
    )


def _kept_out(sessions: Sequence[Session], name: str) -> str:
    return f"{rms([x.kept_out_deg[name] for x in sessions]):.2f}"


def _told(sessions: Sequence[Session]) -> str:
    widths = [x.half_width_deg for x in sessions]
    low, high = f"{min(widths):.2f}", f"{max(widths):.2f}"
    middle = f"{rms(_of(sessions, 'predicted')):.2f}"
    return f"{middle} ± {low}" + (f" … {high}" if high != low else "")


def _covered(sessions: Sequence[Session]) -> str:
    return _count([inside for each in sessions for inside in each.covered])


def _count(flags: Sequence[bool]) -> str:
    return f"{sum(flags)} of {len(flags)}"


def _ends(sessions: Sequence[Session], name: str) -> str:
    values = _of(sessions, name)
    return f"{rms(values):.2f} ({max(values):.2f})"


COLUMNS: list[Column[list[Session]]] = [
    Column("truth", "", lambda group: group[0].case, left=True),
    Column("lost motion found off, joints 2 / 3", "deg", _lost),
    Column("kept-out run off, preset", "deg", lambda group: _kept_out(group, "preset")),
    Column("identified", "deg", lambda group: _kept_out(group, "identified")),
    Column("warned", "", lambda group: _count([bool(x.warnings) for x in group])),
    Column("predicted ± told", "deg", _told),
    Column("end off the prediction", "deg", lambda group: _ends(group, "surprise")),
    Column("covered", "", _covered),
    Column("end off the goal, preset", "deg", lambda group: _ends(group, "preset")),
    Column("identified", "deg", lambda group: _ends(group, "first")),
    Column("aimed again", "deg", lambda group: _ends(group, "again")),
]  # fmt: skip


NAMES = {
    "w2": "lost motion of joint 2 (deg)",
    "w3": "lost motion of joint 3 (deg)",
    "ratio2": "ratio of joint 2, with gain of motor 1 (%)",
    "ratio3": "ratio of joint 3, with gain of motor 1 (%)",
    "servo1": "lag of motor 1, with delay (ms)",
    "gear1": "backlash of gearhead 1 (deg)",
    "lateral": "lateral friction of contacts",
}


def parameters(groups: Sequence[list[Session]]) -> str:
    """What was found of the first arm, truth by truth, as Markdown."""
    groups = [group for group in groups if not CASES[group[0].case][1]]
    head = ["parameter", *(f"{group[0].case} is → found" for group in groups)]
    lines = [head, ["---", *["---:"] * len(groups)]]
    for key in built_as(groups[0][0].numbers):
        cells = [f"{built_as(g[0].numbers)[key]:.2f} → {g[0].found[key]:.2f}" for g in groups]
        lines.append([NAMES[key], *cells])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def picture(groups: Sequence[list[Session]]) -> Figure:
    """Told half widths, and how far the runs ended from prediction and goal."""
    drawn_on = Figure(figsize=(9, 4), layout="constrained")
    ax = drawn_on.subplots()
    for x, group in enumerate(groups, start=1):
        for k, each in enumerate(group):
            at = x + 0.22 * (k - (len(group) - 1) / 2)
            told = each.half_width_deg
            ax.plot([at - 0.09, at + 0.09], [told, told], "k-", lw=2, label="told half width")
            for name, mark, colour, words in MARKS:
                ends = [getattr(end, name) for end in each.ends]
                at_name = at + {"preset": -0.05, "surprise": 0.0, "again": 0.05}[name]
                ax.plot([at_name] * len(ends), ends, mark, color=colour, ms=4, label=words)
    kinds = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(kinds.values(), kinds.keys(), fontsize=8, ncols=2)
    ax.set(yscale="log", ylabel="largest error of a joint at the end (deg)")
    ax.set_xticks(range(1, len(groups) + 1), [group[0].case for group in groups])
    ax.grid(axis="y", alpha=0.3)
    return drawn_on


MARKS = [
    ("preset", "x", "tab:grey", "preset, off the goal"),
    ("surprise", "o", "tab:blue", "identified, off the prediction"),
    ("again", "^", "tab:green", "identified, aimed again, off the goal"),
]


def main() -> int:
    """Run all arms, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", nargs="+", choices=CASES, default=[*CASES], metavar="TRUTH")
    parser.add_argument("--arms", type=int, default=3, help="arms of each truth")
    parser.add_argument("--out", type=Path, default=ROOT / "results/truths")
    given = parser.parse_args()
    groups: list[list[Session]] = []
    place = results_pages.cache_path("truths")
    with tempfile.TemporaryDirectory() as name, Progress() as bar, warnings.catch_warnings():
        warnings.simplefilter("ignore", planner.InputWarning)
        run = built(Path(name))
        count = len(given.truths) * given.arms * (1 + len(GOALS))
        line = bar.add_task("runs on the arms", total=count)
        for case in given.truths:
            bar.update(line, description=case)
            group = []
            for k in range(given.arms):
                path = place / f"{case}-{k}.json"
                make = partial(session, run, case, k, Path(name), lambda: bar.advance(line))
                group.append(kept(path, make))
                bar.update(line, completed=(len(groups) * given.arms + k + 1) * (1 + len(GOALS)))
            groups.append(group)
            bar.console.print(markdown_table(COLUMNS, groups[-1:]), highlight=False)
    given.out.mkdir(parents=True, exist_ok=True)
    picture(groups).savefig(given.out / "truths.png", dpi=110)
    page = (HERE / "truths.md").read_text(encoding="utf-8")
    page = page.format(
        command=provenance(shlex.join(["python", "tests/benchmarks/truths.py", *sys.argv[1:]])),
        table=markdown_table(COLUMNS, groups),
        parameters=parameters(groups),
        arms=given.arms,
        goals=", ".join(str(tuple(round(a) for a in goal)) for goal in GOALS),
        minutes=f"{sum(each.cpu_s for group in groups for each in group) / 60:.0f}",
        seed=SEED,
    )
    (given.out / "README.md").write_text(page, encoding="utf-8")
    print(f"wrote {given.out / 'README.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
