"""Read a recorded run of an arm from a CSV file: `read_log`.

In row k, u is the command to the motors from t of that row until the next row, and theta is the
encoders' reading at t, before the command acts. `Log` has times in seconds from the first row and
angles in radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from planner.errors import InputError, expect
from planner.plan.plan import Plan
from planner.plan.recorded.bag import is_bag, read_bag
from planner.plan.recorded.columns import find_columns, parse_name
from planner.plan.recorded.number_table import Blanks, NumberTable, read_table
from planner.plan.samples import MAX_ROWS
from planner.plan.trajectory import StateTrajectory
from planner.problem.problem import AnyProblem, problem_of
from planner.support.arrays import Array, Frozen, floats, frozen
from planner.support.calculus.bernstein import Bernstein
from planner.support.files import write_text
from planner.support.tables import csv_text

RECORDED = "recorded"
"""Method and status of a plan made from a recorded run."""

LEAST_ROWS = 50
"""Least number of rows of a log. Fewer rows cover under half a second at the usual 100 Hz, in which
no joint takes up its backlash."""

POSE_READINGS, POSE_S = 20, 0.2
MOST_POSE_DRIFT_DEG, MOST_POSE_OFF_DEG = 0.1, 0.5
"""The last `POSE_READINGS` readings, or all of the last `POSE_S` if there are more, show an arm at
rest if the medians of their first and second half differ by at most the first limit, and each
reading differs from the median of all by at most the second. An encoder that flickers by its step
of 0.088 degrees changes either by that step."""

GAP_RATIO = 2.5
"""Multiple of the usual interval above which two rows have a gap; jitter is smaller."""

EVEN_SHARE = 0.02
"""Difference from even spacing, as a share of the interval, below which times are made even."""

MOST_JITTER_S = 0.0012
"""Error of the time between two rows, in a tenth of them, that is reported. Stamps rounded to
milliseconds give 0.001; commands up to 3 ms late give 0.002."""

JUMP_DEG, MOST_RATE_DEG_S = 20.0, 600.0
"""Largest plausible change of an angle between two rows: the jump plus the rate times the interval.
The prototype reaches 30 degrees a second."""

LEAST_JUMP_DEG, JUMP_RATIO = 0.6, 2.5
"""A step between two rows that stands out from the steps around it by more than the first, and by
more than this multiple of the 99th percentile of all steps and of the encoder's resolution, is no
motion. Emulated arms reach 0.6 of that, with noise of 0.2 degrees, readings that are held for five
rows or steps of a degree 0.8."""

UNIT_RATIO = 8.0
"""Largest plausible ratio between the turns of joint 1 and motor 2, which are equal but for gear
errors. More, or less than the inverse, means a wrong unit: degrees for radians give 57. Turns below
`LEAST_TURN_RAD` are not checked."""
LEAST_TURN_RAD = np.deg2rad(4.0)

LEAST_LIKENESS = 0.5
"""Least correlation of joint 1's readings with the integral of u₂; 0.9 with the right columns."""


@dataclass(frozen=True, eq=False)
class Log(Frozen):
    """A recorded run of an arm.

    Attributes:
        t: Times, shape (R,), s, from 0.
        u: Commands to both motors from each time to the next, shape (R, 2), rad/s.
        theta: Readings of the joints' encoders, shape (R, n), rad.
        source: Origin of the run, for messages.

    Raises:
        InputError: If the shapes do not match, or a number is NaN or infinite.
    """

    t: Array
    u: Array
    theta: Array
    source: str = "log"

    def __post_init__(self) -> None:
        for name in ("t", "u", "theta"):
            value = frozen(floats(f"{self.source}: {name}", getattr(self, name)))
            object.__setattr__(self, name, value)
        rows = self.t.shape[:1]
        shapes = {"t": rows, "u": (*rows, 2), "theta": (*rows, *self.theta.shape[1:2])}
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape or len(shape) != 1 + (name != "t"):
                raise InputError(
                    f"{self.source}: {name} has shape {value.shape}; a log of R rows has t (R,),"
                    " u (R, 2) and theta (R, n)"
                )
            if not np.all(np.isfinite(value)):
                raise InputError(f"{self.source}: {name} has values that are NaN or infinite")

    def __repr__(self) -> str:
        return (
            f"Log({Path(self.source).name}: {self.theta.shape[1]} joints, {len(self.t)} rows,"
            f" {self.t[-1]:.4g} s)"
        )

    @property
    def theta_deg(self) -> Array:
        """Readings, shape (R, n), degrees."""
        return np.rad2deg(self.theta)

    @property
    def pose_deg(self) -> Array:
        """Pose at the end of the run: mean of the last 20 readings, or of all in the last 0.2 s,
        shape (n,), degrees from -180 to 180.

        The error is 0.01 degrees for an encoder with steps of 0.088 degrees and noise of a third of
        a step.

        Raises:
            InputError: If a joint still moves, or a reading is far from the others.
        """
        last = self.theta_deg[-max(POSE_READINGS, round(POSE_S / self.interval_s)) :]
        half = len(last) // 2
        change = np.abs(np.median(last[-half:], axis=0) - np.median(last[:half], axis=0))
        spread = np.max(np.abs(last - np.median(last, axis=0)), axis=0)
        joint = int(np.argmax(np.maximum(change / MOST_POSE_DRIFT_DEG, spread / MOST_POSE_OFF_DEG)))
        if change[joint] > MOST_POSE_DRIFT_DEG:
            rate = change[joint] / (half * self.interval_s)
            raise InputError(
                f"{self.source}: the arm does not rest at the end: in the last {len(last)} readings"
                f" theta{joint + 1} moves at {rate:.2g} deg/s; record until the arm stands still"
            )
        if spread[joint] > MOST_POSE_OFF_DEG:
            raise InputError(
                f"{self.source}: one of the last {len(last)} readings of theta{joint + 1} differs"
                f" by {spread[joint]:.3g} deg from their median; the reading is wrong, or the"
                " encoder is too coarse"
            )
        pose = last.mean(axis=0)
        return np.asarray(np.round(pose - 360 * np.round(pose / 360), 6))

    @property
    def interval_s(self) -> float:
        """Usual (median) time between rows, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def jitter_words(self) -> str:
        """A warning if the time between rows scatters; else ""."""
        spans = np.diff(self.t)[np.diff(self.t) < GAP_RATIO * self.interval_s]
        late = float(np.percentile(np.abs(spans - self.interval_s), 90))
        if late < MOST_JITTER_S:
            return ""
        return (
            f"{self.source}: a tenth of the rows is {1000 * late:.2g} ms or more early or late. If"
            " commands come so, too, their jumps put ends up to some tenths of a degree off: set"
            " limits.input_rate_rad_s2"
        )

    @property
    def steps_deg(self) -> Array:
        """Resolution of each encoder: the least difference between two readings, (n,), degrees;
        infinite if all are equal."""
        levels = (np.unique(np.round(each, 4)) for each in self.theta_deg.T)
        return np.array([np.min(np.diff(each), initial=np.inf) for each in levels])

    @property
    def is_even(self) -> bool:
        """Whether the rows are evenly spaced in time."""
        return bool(np.ptp(np.diff(self.t)) < 1e-9 * self.interval_s)

    def start_s(self, plan: Plan) -> float:
        """Return the time in the log, s, at which a plan began, from the first nonzero commands."""
        t = np.linspace(0.0, plan.duration, 1 + round(plan.duration / self.interval_s))
        planned = t[np.argmax(_moves(plan.trajectory.u(t)))]
        return float(self.t[np.argmax(_moves(self.u))] - planned)

    def errors_deg(self, plan: Plan) -> tuple[Array, Array]:
        """Return the readings minus the angles of the executed plan, each (rows, n), degrees.

        The first are the errors from the path that the plan wants (NaN before and after it), the
        second those from the motion that it expects; they differ for a compensated plan.
        """
        t = self.t - self.start_s(plan)
        wanted, expected = plan.reference(t), plan.trajectory.q(t)
        both = (self.theta_deg - np.rad2deg(q[:, 1:]) for q in (wanted, expected))
        return next(both), next(both)

    def part(self, begin_s: float, end_s: float = np.inf) -> Log:
        """Return the rows from `begin_s` to `end_s`, s, with times that start at 0 again.

        Raises:
            InputError: If fewer than `LEAST_ROWS` are left.
        """
        chosen = (self.t >= begin_s - 1e-9) & (self.t <= end_s + 1e-9)
        if chosen.sum() < LEAST_ROWS:
            raise InputError(
                f"{self.source}: {chosen.sum()} rows from {begin_s:g} to {end_s:g} s; a log needs"
                f" at least {LEAST_ROWS}"
            )
        t = self.t[chosen]
        return replace(self, t=t - t[0], u=self.u[chosen], theta=self.theta[chosen])

    def plan(self, problem: AnyProblem) -> Plan:
        """Return the run as a plan, which `planner.replay` and all figures accept.

        The plan's inputs are the commands, each held until the next. Its coordinates are the
        readings, interpolated linearly, and the disk's angle, which the kinematics give.

        Raises:
            InputError: If the problem's system has another number of joints.
        """
        problem = problem_of(problem)
        system = problem.system
        if system.size - 1 != self.theta.shape[1]:
            raise InputError(
                f"{self.source} has {self.theta.shape[1]} joints (theta1 ...), but"
                f" {problem.source} has {system.size - 1}"
            )
        q = np.column_stack([np.zeros(len(self.t)), self.theta])
        middle = (q[:-1] + q[1:]) / 2
        turned = system.rates(middle, self.u[:-1])[:, 0] * np.diff(self.t)
        q[1:, 0] = np.cumsum(turned)
        q_curve = Bernstein(np.stack([q[:-1], q[1:]]), self.t)
        u_curve = Bernstein(self.u[None, :-1].copy(), self.t)
        trajectory = StateTrajectory(system, q_curve, u_curve)
        return Plan(problem, RECORDED, {}, trajectory, status=RECORDED)

    def save(self, path: str | Path) -> Path:
        """Write the run as CSV, with angles in degrees; `read_log` reads it back.

        Raises:
            InputError: If the file cannot be written.
        """
        names = ["t_s", "u1_rad_s", "u2_rad_s"]
        names += [f"theta{i + 1}_deg" for i in range(self.theta.shape[1])]
        columns = [self.t[:, None], self.u, self.theta_deg]
        rows = ([f"{x:.9g}" for x in row] for row in np.column_stack(columns).tolist())
        return write_text(path, csv_text([names, *rows]))


def _moves(u: Array) -> Array:
    """Return whether commands (m, 2) exceed the noise of zero commands at each time, (m,)."""
    return np.asarray(np.max(np.abs(u), axis=1) > 1e-3)


def expect_log(value: object) -> None:
    """Refuse any value but a log, such as the name of a log's file.

    Raises:
        InputError: If the value is not a log; the message says how to get one.
    """
    expect(Log, value, "planner.read_log(path) reads one")


def read_log(path: str | Path, columns: Mapping[str, str] | None = None) -> Log:
    """Read a recorded run of an arm.

    The file is a table with a header: `t`, `u1`, `u2`, `theta1` … `thetan`, each with its unit, as
    in `t_s`, `u1_rad_s`, `theta1_deg`, "θ1 [°]" or "theta1 (deg)", or with a line of units below
    or above the header. Other columns are ignored. A blank command repeats the one above. For
    separators, decimal marks, comments and encodings see `planner.plan.recorded.number_table`.

    Args:
        path: The file.
        columns: For a file with other column names, such as one exported from a ROS 2 bag. Maps
            names as above, with the unit, to the file's names, for example `{"t_ns": "stamp",
            "theta1_rad": "/joint_states/position[0]"}`.

    Raises:
        InputError: If the file cannot be read, a column or its unit is missing, a cell is not a
            number, there are fewer than 50 rows, times do not increase or have a gap, or angles
            jump or do not fit the header's unit. The message names line and column.
    """
    names = columns or {}
    expect(Mapping, names, 'columns maps names to those of the file: {"theta1_rad": "pos[0]"}')

    def known(cell: str) -> bool:
        return parse_name(cell) is not None or cell.strip() in names.values()

    if is_bag(path):
        table = read_bag(path, names)
    else:
        table = read_table(path, "a log is CSV", known, may_be_cut=True)
    places = find_columns(table, names)
    if not LEAST_ROWS <= len(table.rows) <= MAX_ROWS:
        raise InputError(
            f"{path} has {len(table.rows)} rows of readings; a log has {LEAST_ROWS} to {MAX_ROWS:,}"
        )
    blanks: dict[int, Blanks] = {
        place: "held" if name in ("u1", "u2") else "refused" for name, (place, _) in places.items()
    }
    numbers = table.numbers(blanks)
    values = {name: numbers[place] * factor for name, (place, factor) in places.items()}
    joints = sum(name.startswith("theta") for name in values)
    t = _times(values["t"], table)
    log = Log(
        t=t,
        u=np.stack([values["u1"], values["u2"]], axis=1),
        theta=np.stack([values[f"theta{i + 1}"] for i in range(joints)], axis=1),
        source=str(path),
    )
    _refuse_jumps(log, table)
    _refuse_wrong_units(log)
    return log


def _times(t: Array, table: NumberTable) -> Array:
    """Return times that start at 0; times that are even up to rounding become exactly even.

    Raises:
        InputError: If the times do not increase, or have a gap.
    """
    t = t - t[0]
    steps = np.diff(t)
    if np.any(steps <= 0):
        k = int(np.argmax(steps <= 0))
        raise InputError(
            f"{table.line(k + 1)}: time goes from {t[k]:.6g} to {t[k + 1]:.6g} s; it must"
            " increase from row to row"
        )
    usual = float(np.median(steps))
    if np.any(steps > GAP_RATIO * usual):
        k = int(np.argmax(steps))
        raise InputError(
            f"{table.line(k + 1)}: a gap of {steps[k]:.4g} s after t = {t[k]:.6g} s, in rows that"
            f" follow each other every {usual:.4g} s; the commands in the gap are unknown,"
            " so record again, or keep only the rows before or after it"
        )
    even = float(f"{t[-1] / len(steps):.9g}") * np.arange(len(t))
    return np.asarray(even if np.max(np.abs(t - even)) < EVEN_SHARE * usual else t)


def _refuse_jumps(log: Log, table: NumberTable) -> None:
    theta, n = log.theta_deg, len(log.t) - 1
    steps = np.diff(theta, axis=0)
    near = np.lib.stride_tricks.sliding_window_view(
        np.pad(steps, ((3, 3), (0, 0)), "reflect"), 3, 0
    )
    around = np.median(near, axis=-1)  # of three steps each
    beside = np.stack([around[:n], around[4:]])
    out = np.maximum(steps - beside.max(axis=0), beside.min(axis=0) - steps)
    usual = np.maximum(np.percentile(np.abs(steps), 99, axis=0), log.steps_deg)
    most = JUMP_DEG + MOST_RATE_DEG_S * np.diff(log.t)[:, None]
    jumps = out / np.minimum(np.maximum(LEAST_JUMP_DEG, JUMP_RATIO * usual), most)
    if (rows := np.flatnonzero(np.any(jumps > 1, axis=1))).size:
        k = int(rows[0])
        i = int(np.argmax(jumps[k]))
        before, after = theta[k : k + 2, i]
        turns = abs(after - before) / 360
        advice = "the encoder lost counts or was reset, or a wrong reading or unit"
        if abs(turns - round(turns)) < JUMP_DEG / 360 and turns > 0.5:
            advice = "the encoder wraps around; write continuous angles (numpy.unwrap)"
        elif after == 0:
            advice = "the reading drops to zero"
        raise InputError(
            f"{table.line(k + 1)}: theta{i + 1} jumps from {before:.5g} to {after:.5g} deg at"
            f" t = {log.t[k + 1]:.5g} s: {advice}" + f" ({len(rows)} such jumps)" * (len(rows) > 1)
        )


def _refuse_wrong_units(log: Log) -> None:
    """Refuse a log in which joint 1 does not follow motor 2, as joint 1 does in every mechanism.

    In such a log a unit, a sign, or the order of the columns is wrong.
    """
    turned = np.concatenate([[0.0], np.cumsum(log.u[:-1, 1] * np.diff(log.t))])
    commanded, read = float(np.ptp(turned)), float(np.ptp(log.theta[:, 0]))
    ratio = read / max(commanded, 1e-9)
    if max(commanded, read) < LEAST_TURN_RAD:
        return
    if 1 / UNIT_RATIO <= ratio <= UNIT_RATIO:
        alike = float(np.corrcoef(turned, log.theta[:, 0])[0, 1])
        if alike < LEAST_LIKENESS:
            raise InputError(
                f"{log.source}: joint 1 must turn with motor 2, but does not follow u2 (correlation"
                f" {alike:.2f}); check sign and order of the motors' columns"
            )
        return
    raise InputError(
        f"{log.source}: joint 1 must turn with motor 2, but turns by {np.rad2deg(read):.4g} deg"
        f" while u2 commands {np.rad2deg(commanded):.4g} deg; check the units in the header"
        " (degrees for radians), and sign and order of the motors"
    )
