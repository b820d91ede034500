"""Write the tracker (feedback controller) of one plan as a folder of C code for a real machine.

tracker.h, tracker.c and selftest.c are the same for every plan. Other files come from the tracker's
design in Python, so that both versions follow the same reference: sizes.h (types and sizes),
tables.h (numbers, and the system's nominal rates as C code), recording.h (readings of one emulated
machine and the expected commands).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from string import Template
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.closed_loop import Controller, Feedback
from planner.machine.feedback import estimate, programme, tracker
from planner.machine.feedback.run_up import hindrance
from planner.machine.feedback.tracker import Tracker, TrackerDesign
from planner.machine.identification.band import MACHINES, MEAN_S, band, told_deg
from planner.machine.machine import Machine, machine_for
from planner.machine.replay import replay
from planner.plan.plan import Plan, refuse_inexecutable
from planner.report.charts.scripts import source
from planner.support.arrays import Array
from planner.systems.expressions import operator_templates
from planner.systems.triangular_system import TriangularSystem

PACKAGE = "planner.report.controller"
SOURCES = ("tracker.h", "tracker.c", "selftest.c")

FREE = 1e30
"""Number that stands for infinity and fits into a float."""

ROUNDING: dict[str, dict[str, float]] = {
    "double": {"TOLERANCE": 1e-9, "DEPENDENT": 1e-12, "ROUNDING_TICKS": 1e-9},
    "float": {"TOLERANCE": 1e-5, "DEPENDENT": 1e-6, "ROUNDING_TICKS": 1e-4},
}
"""Rounding tolerances, by type of numbers.

TOLERANCE is the allowed violation of a constraint, as a distance in the space of the optimisation
variables c. DEPENDENT is the squared norm up to which an orthogonalised unit vector counts as zero.
A time that is less than ROUNDING_TICKS ticks before a tick counts as this tick.
"""

ALLOWED_SHARE: dict[str, float] = {"double": 5e-4, "float": 0.02}
"""Tolerance of commands in the self-test, relative to the greatest command, by type of numbers.
That of double covers the inaccuracy of OSQP, the solver in Python."""

ODD_SHARE: dict[str, float] = {"double": 0.0, "float": 0.02}
"""Share of the self-test's periods in which commands may differ by more than `ALLOWED_SHARE`.
Rounding can decide whether a joint has moved; later readings bring both versions together."""

LEAST_SPREAD_RAD = 1e-4
"""Addition to the spread of readings, which is zero where machines read exactly; less than
any encoder's."""

MAX_STEPS = 400
"""Largest number of steps of the active-set method; the worst of 200 arms needs a tenth."""


def controller_files(plan: Plan, machine: Machine | None, real: str) -> dict[str, str]:
    """Return the text of every file of the C tracker's folder, by file name.

    Args:
        plan: The plan; may be compensated.
        machine: The machine whose mean values the tracker knows; by default the `[machine]` table.
        real: Type of the numbers in C, "double" or "float".

    Raises:
        InputError: If the plan cannot be executed, the options of `[feedback]` do not fit the
            machine, or the system's rates contain a function that C lacks.
        UntrackableError: If the plan's inputs are far beyond the limits of the commands.
    """
    refuse_inexecutable(plan)
    machine = machine_for(plan.problem.machine, machine)
    follower = Tracker(plan.problem.feedback)
    design = follower.design(plan, machine)
    return {name: source(PACKAGE, name) for name in SOURCES} | {
        "sizes.h": _sizes(design, real),
        "tables.h": _tables(design, plan.problem.system, real, _band(plan, machine, follower)),
        "recording.h": _recording(plan, machine, follower, real),
        "README.md": _readme(plan, machine, design, real),
    }


# -- data of the tracker ---------------------------------------------------------------------------


def _sizes(design: TrackerDesign, real: str) -> str:
    clock, ref = design.ref.timing, design.ref
    # From the oldest tick that a forecast needs to the last that is decided.
    ring = 2 * clock.ticks + clock.latency + int(np.ceil(np.max(clock.shift) / clock.tick)) + 2
    sizes = {
        "COORDINATES": ref.q.shape[1],
        "TICKS": clock.ticks,
        "LATENCY_TICKS": clock.latency,
        "PERIODS": len(ref.feed),
        "HORIZON": design.programme.horizon,
        "RING": ring,
    }
    lines = [f"#define TRACKER_{name} {value}" for name, value in sizes.items()]
    lines += [f"#define TRACKER_PERIOD_S {clock.period!r}", f"typedef {real} tracker_real;"]
    return _guard("TRACKER_SIZES_H", lines)


def _band(plan: Plan, machine: Machine, follower: Tracker) -> dict[str, Array]:
    """Return the band in which the readings of 95 % of the machines stay, (K, N−1), rad."""
    recorder = Recorder(follower, lambda _, read: read)
    replay(plan, machine, MACHINES, feedback=recorder, record_s=None)
    read = np.array([read[1:] for _, read, _ in recorder.log])
    floor = np.deg2rad(told_deg(machine)) + LEAST_SPREAD_RAD
    middle, half = band(np.moveaxis(read, 2, 0), floor)
    return {"MIDDLE": np.nan_to_num(middle), "BAND": np.nan_to_num(half, nan=FREE)}


def _tables(
    design: TrackerDesign, system: TriangularSystem, real: str, readings: dict[str, Array]
) -> str:
    ref, clock = design.ref, design.ref.timing
    numbers = {
        "TICK_S": clock.tick,
        "PERIOD_S": clock.period,
        "DRIVE_PLAY": float(design.play[0]),
        "FREE": FREE,
        "UNREACHABLE": programme.STATE_TOLERANCE_RAD,
        "LIMIT_ROUNDING": max(programme.LIMIT_ROUNDING, ROUNDING[real]["TOLERANCE"] / 10),
        **{name: ROUNDING[real][name] for name in ("TOLERANCE", "DEPENDENT", "ROUNDING_TICKS")},
        **{name: getattr(estimate, name) for name in (
            "RATE_SPREAD", "LOST_SPREAD", "UNMODELLED_SPREAD_RAD", "SETTLING_SHARE",
            "FITTING_SPREADS", "EXACT_READING_SPREAD", "NOISE_SHARE", "REST_SHARE",
            "PUSHED_SPREADS", "UNKNOWN_VARIANCE")},
        "PLAY_SPREAD_SHARE": tracker.PLAY_SPREAD_SHARE,
        "MEAN_SHARE": min(1.0, clock.period / MEAN_S),
    }  # fmt: skip
    whole = {
        "RATED": int(design.ramp),
        "STATE_LIMITS": ref.rows.shape[1],
        "CROSSES_PLAY": int(np.any(design.play)),
        "CROSSING_PERIODS": tracker.CROSSING_PERIODS,
        "MAX_STEPS": MAX_STEPS,
    }
    write = _writer(real)
    lines = [f"#define FN(name) name{'##f' if real == 'float' else ''}"]
    lines += [f"#define {name} {value}" for name, value in whole.items()]
    lines += [f"#define {name} ({write(value)})" for name, value in numbers.items()]
    lines += [
        _array(f"static const real {name}", value, write)
        for name, value in (_arrays(design) | readings).items()
    ]
    if design.ramp:
        lines.append(_array("static const int LAST_TICK", ref.last_ticks, str))
    return _guard("TRACKER_TABLES_H", [*lines, *_rates_in_c(system, write)])


def _arrays(design: TrackerDesign) -> dict[str, Array]:
    """Return the tracker's tables of numbers, by their names in C."""
    ref, law, clock = design.ref, design.law, design.ref.timing
    count = len(ref.feed)
    arrays = {
        "SHIFT_TICKS": clock.shift / clock.tick,
        "HALF_STEP": np.minimum(design.resolution[:, 0] / 2, FREE),
        "READING_VARIANCE": design.variance[:, 0],
        "NOISE": design.noise[1:, 0],
        "MEAN_LOST_MOTION": design.lost_motion[:, 0],
        "COURSE_LOST_MOTION": ref.lost_motion[:, 0],
        "PASSING": design.passing,
        "START": ref.start,
        "LIMIT": ref.limit,
        "FIRST": ref.first_inputs,
        "FEED": ref.feed,
        "Q": ref.q[:count],
        "JOINT": ref.joints[:count],
        "WAY": ref.way[:count],
        "PUSH": ref.push[:count],
        "NEXT_PUSH": ref.next_push[:count],
        "A": ref.A,
        "B": ref.B,
        "E": ref.E,
        "GAIN": law.gain,
        "ROOT": law.root,
        "LOW": ref.low,
        "HIGH": ref.high,
        "LIMITED": ref.rows,
        "FLOOR": ref.floor,
        "CEILING": ref.ceiling,
    }
    if design.ramp:
        changes = np.array([programme.change_range(ref, i) for i in range(count)])
        arrays |= {
            "RATE": ref.rate,
            "B_BEFORE": ref.B_before,
            "CHANGE_LOW": changes[:, 0],
            "CHANGE_HIGH": changes[:, 1],
        }
    return arrays


def _recording(plan: Plan, machine: Machine, follower: Tracker, real: str) -> str:
    """Return recording.h: encoder readings of one emulated machine, some lost, and the commands."""
    recorder = Recorder(follower, _lose)
    replay(plan, machine, samples=1, seed=0, feedback=recorder, record_s=None)
    write = _writer(real)
    read = np.array([read[:, 0] for _, read, _ in recorder.log])
    told = np.array([told[:, :, 0] for _, _, told in recorder.log])
    count, greatest = len(read), float(np.max(np.abs(told)))
    lines = [
        "#include <math.h>",
        '#include "sizes.h"',
        f"#define READINGS {count}",
        f"#define ALLOWED {ALLOWED_SHARE[real] * greatest!r}",
        f"#define ODD_PERIODS {int(ODD_SHARE[real] * count)}",
        _array("static const tracker_real MEASURED", read, write),
        _array("static const double EXPECTED", told, _writer("double")),
    ]
    return _guard("TRACKER_RECORDING_H", lines)


LOST_EVERY = 23
"""Number of periods from one lost reading to the next; alternately the last joint's reading or the
readings of all coordinates are lost."""


def _lose(k: int, measured: Array) -> Array:
    read = measured.copy()
    if k % LOST_EVERY == LOST_EVERY - 1:
        read[slice(None) if k // LOST_EVERY % 2 else -1] = np.nan
    return read


class Recorder:
    """Feedback that passes readings to another feedback law and records its commands.

    Args:
        feedback: The feedback law that computes the commands.
        tamper: Function of the number of a reading and the reading (N, S) that returns the reading
            for the feedback law.

    Attributes:
        log: Time, reading and commands (M, 2, S) of each period.
    """

    def __init__(
        self, feedback: Feedback, tamper: Callable[[int, Array], Array] = lambda _, read: read
    ) -> None:
        self._feedback, self._tamper = feedback, tamper
        self.log: list[tuple[float, Array, Array]] = []

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> Controller:
        """Start the feedback law, as in `Feedback`, and clear the log."""
        self._control = self._feedback.start(plan, machine, numbers)
        self.log.clear()
        return cast("Controller", self)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._control, name)

    def __call__(self, t: float, measured: Array) -> Array:
        """Return the commands for a reading, as in `Controller`; record reading and commands."""
        read = self._tamper(len(self.log), measured)
        out = self._control(t, read)
        self.log.append((t, read.copy(), out))
        return out


# -- in C -----------------------------------------------------------------------------------------


def _writer(real: str) -> Callable[[float], str]:
    """Return a function that writes a number as a C constant of the type `real`."""

    def write(value: float) -> str:
        value = float(np.clip(value, -FREE, FREE))  # NaN stays
        if np.isnan(value):
            return "NAN"
        if real == "double":
            return repr(value)
        text = f"{value:.9g}"  # nine digits identify every float
        return f"{text}f" if set(text) & set(".e") else f"{text}.0f"

    return write


def _array(head: str, values: Any, write: Callable[[Any], str]) -> str:
    """Return an array as C text; an axis of length 0 gets length 1, since C has no empty arrays."""
    values = np.asarray(values)
    values = values if values.size else np.zeros([max(1, n) for n in values.shape])

    def body(part: Any) -> str:
        if part.ndim == 1:
            return "{" + ", ".join(write(x) for x in part.tolist()) + "}"
        return "{" + ",\n".join(body(x) for x in part) + "}"

    return f"{head}{''.join(f'[{n}]' for n in values.shape)} = {body(values)};"


def _rates_in_c(system: TriangularSystem, write: Callable[[float], str]) -> list[str]:
    """Return the lines of a C function of the system's rates, one operation per line."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    rates = ca.Function("rates", [q, u], [ca.cse(ca.densify(ca.vertcat(*system.rates_expr(q, u))))])
    powers = {ca.OP_POW: "pow({}, {})", ca.OP_CONSTPOW: "pow({}, {})", ca.OP_SQ: "({0} * {0})"}
    signs = operator_templates() | powers | {ca.OP_ASSIGN: "{}"}
    lines = []
    for k in range(rates.n_instructions()):
        operation, inputs = rates.instruction_id(k), rates.instruction_input(k)
        outputs = rates.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            lines.append(f"out[{outputs[1]}] = w[{inputs[0]}];")
            continue
        if operation == ca.OP_INPUT:
            value = f"{'qu'[inputs[0]]}[{inputs[1]}]"
        elif operation == ca.OP_CONST:
            value = write(rates.instruction_constant(k))
        elif operation in signs:
            text = re.sub(r"([a-z]\w*)\(", r"FN(\1)(", signs[operation])
            value = text.format(*(f"w[{i}]" for i in inputs))
        else:
            raise InputError(
                f"the rates of {system} cannot be written in C: they use a function other than"
                f" {', '.join(sorted(set(re.findall('[a-z]+[0-9]?', ' '.join(signs.values())))))}"
            )
        lines.append(f"w[{outputs[0]}] = {value};")
    return [
        "static void nominal_rates(const real *q, const real *u, real *out) {",
        f"    real w[{rates.sz_w()}];",
        *(f"    {line}" for line in lines),
        "}",
    ]


def _guard(name: str, lines: list[str]) -> str:
    return "\n".join([f"#ifndef {name}", f"#define {name}", *lines, "#endif", ""])


# -- words ----------------------------------------------------------------------------------------


def _readme(plan: Plan, machine: Machine, design: TrackerDesign, real: str) -> str:
    """Return README.md, which explains the tracker's calls with the plan's numbers."""
    ref, clock, system = design.ref, design.ref.timing, plan.problem.system
    size, horizon = 8 if real == "double" else 4, 2 * design.programme.horizon
    rows = horizon * (2 if design.ramp else 1) + horizon // 2 * ref.rows.shape[1]
    work = rows * (horizon + 4) + 2 * horizon**2 + 2 * (system.size + 2) * horizon
    numbers = sum(np.size(table) for table in _arrays(design).values())
    lost, steps = np.rad2deg(design.lost_motion[:, 0]), np.rad2deg(design.resolution[1:, 0])
    order = "".join(
        f"| `measured[{i}]`: {each.name}, {each.unit} | {_place(ref.start[i], each.unit)} |\n"
        for i, each in enumerate(system.coordinates)
    )
    return Template(source(PACKAGE, "README.md")).substitute(
        title=plan.problem.name,
        method=plan.method,
        fidelity=machine.fidelity,
        real=real,
        table_kb=f"{numbers * size / 1024:.0f}",
        allowed=f"{ALLOWED_SHARE[real]:.2%} of the greatest command",
        odd=f"{ODD_SHARE[real]:.0%}",
        mean=f"{MEAN_S:g}",
        tick_ms=f"{1000 * clock.tick:g}",
        slow_ms=f"{10_000 * clock.tick:g}",
        period_ms=f"{1000 * clock.period:g}",
        ticks=clock.ticks,
        latency=clock.latency,
        latency_ms=f"{1000 * clock.wait:g}",
        duration=f"{len(ref.feed) * clock.period + clock.wait:.4g}",
        periods=len(ref.feed),
        lead=f"{-clock.begin:.4g}",
        before=_before(plan, machine, design),
        start=plan.start_words or "for an arm that rests at the pose below",
        over=f"{max(0.0, ref.s[-1] - plan.duration):.2g}",
        order=order,
        inputs=", ".join(
            f"`speed[{i}]` is {each.name} in {each.unit}" for i, each in enumerate(system.inputs)
        ),
        shifts=" and ".join(f"{x:.3g}" for x in clock.shift),
        lost=_degrees(lost),
        steps=_degrees(steps),
        noise=_degrees(np.rad2deg(design.noise[1:, 0])),
        work_kb=f"{work * size / 1024:.0f}",
        most_steps=MAX_STEPS,
    )


def _before(plan: Plan, machine: Machine, design: TrackerDesign) -> str:
    """Say between which angles the joints move before the plan's start, or why they do not."""
    ref = design.ref
    angles = np.column_stack([ref.q[:, 1], ref.joints])[:-1]
    early = np.rad2deg(angles[~ref.is_counted])
    if not len(early):
        why = hindrance(plan, machine)
        return f"Nothing moves before the plan starts{f': {why}' if why else ''}."
    names = [c.name for c in plan.problem.system.coordinates[1:]]
    ends = zip(names, early.min(axis=0), early.max(axis=0), strict=True)
    ranges = ", ".join(
        f"{name} from {np.floor(low):.0f} to {np.ceil(high):.0f} degrees"
        for name, low, high in ends
    )
    return f"Stand clear: before the plan starts, the joints move within {ranges}."


def _place(value: float, unit: str) -> str:
    return f"{value:.6f} ({np.rad2deg(value):.4g} degrees)" if unit == "rad" else f"{value:.6g}"


def _degrees(values: Array) -> str:
    if not np.any(values):
        return "none"
    return f"{', '.join(f'{x:.3g}' for x in values)} degrees"
