"""Replays of a plan on the emulated machine: errors and their distribution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import ABOVE_ZERO, InputError, expect, expect_number
from planner.machine.closed_loop import Feedback, encoder_readings
from planner.machine.friction.contacts import contact_name
from planner.machine.limits import (
    MachineLimit,
    limit_words,
    lower_margins,
    machine_limits,
    parts_of,
)
from planner.machine.machine import Draws, Machine, draw, machine_for, sample_numbers
from planner.machine.simulate import Progress, Recording, simulate
from planner.plan.plan import Plan, refuse_inexecutable
from planner.plan.samples import import_library, plan_facts
from planner.problem.requirements.requirement import Requirement
from planner.support.arrays import Array, Frozen
from planner.support.package import DataFrame, Dataset, Figure, Table, draw_figure
from planner.support.progress import expect_listener
from planner.support.tables import facts, notebook_html, number
from planner.systems.manipulator import Manipulator

SETTLE_S = 0.5
"""Default time after the plan's end with zero command, seconds."""

RECORD_S = 0.02
"""Default time between two recorded instants, seconds."""


@dataclass(frozen=True, eq=False, repr=False)
class Replay(Recording, Frozen):
    """Motions of a plan on S random samples of a machine.

    Attributes:
        plan: The plan.
        machine: The machine from whose distribution the samples are drawn.
        seed: Random seed; together with `numbers` it reproduces every sample.
        numbers: Sample numbers, shape (S,).
        t: Recorded times, shape (R,), s; 0 is the plan's start. The first is the beginning of the
            controller's preparatory motion, if it makes one, and the last `settle_s` after the
            plan's end.
        q: True coordinates of the first M samples, whose motions are kept (by default all), shape
            (M, R, N), in the coordinates' units; `motion` gives those of any sample.
        motor_rates: Speeds of both motors of these samples, shape (M, R, 2), rad/s.
        peak_rates: Largest |speed| of both motors at the recorded times, shape (S, 2), rad/s.
        saturated_s: Time during which the command of each motor exceeded its limit of speed or
            torque, shape (S, 2), s.
        slip_s: Time during which a friction contact was in gross slip, so that the joints behind it
            stood still, shape (S,), s.
        slip_begin: Time at which gross slip began, shape (S,), s; NaN if there was none.
        slip_contact: Number of the contact that slipped, shape (S,), counted from 0 in the order
            P1, P2, P3 at joint 1, then at joint 2, and so on; −1 if none slipped.
        margin: Least distance from each part of the limits that machines can break, negative
            beyond, shape (S, P), in the parts' units; see `limits`. NaN with `record_s=None`.
        margin_s: Time of the least distance, shape (S, P), s.
        terminal_error: True end minus planned end, shape (S, N), in the coordinates' units.
        deviation: Largest |true − plan| over time of the coordinates after the first, (S, N−1). For
            a compensated plan both errors refer to the original plan, from its start on.
        end_state: Where the gearhead of motor 1 and the axis of each joint of an arm rest at the
            end, shape (S, 1+n): entries of `machine.start_state`, 1 as after a motion forward.
        effort: ∫ u₁² + u₂² dt of the controller's commands, (S,); None in open loop.
        fallbacks: Number of control steps in which the controller used a fallback command, (S,).
        run_s: Time from the first command to the end of the last, s: the plan's duration, and with
            feedback also the controller's preparation before and its correction after the plan.
        feedback: The feedback law; None in open loop.
        settle_s: Time with zero command after the plan's end, s.
        record_s: Time between recorded instants, s, or None; see `replay`.
        after: The run before, which left the machines where this one begins; or None.
    """

    plan: Plan
    machine: Machine
    seed: int
    numbers: NDArray[np.int64]
    feedback: Feedback | None
    settle_s: float
    record_s: float | None
    after: Replay | None = None

    def __repr__(self) -> str:
        count = len(self.numbers)
        more = "" if count > 1 else " on this machine; samples=100 shows how machines differ"
        words = [f"{self.error_words}{more}", self.slip_words, self.limit_words]
        return (
            f"Replay({self.plan.label} plan, {count} sample{'s' if count > 1 else ''},"
            f" seed {self.seed}: {'; '.join(filter(None, words))})"
        )

    @property
    def error_words(self) -> str:
        """Median and 95th percentile of E in words; E alone for one machine, which has neither."""
        if len(self.numbers) == 1:
            return f"E {self.index_E_deg[0]:.3g} deg"
        of = " from the predicted motion" if self.plan.ends_on_machine else ""
        return f"E{of} median {self.percentile(50):.3g} deg, 95 % {self.percentile(95):.3g} deg"

    @property
    def slip_words(self) -> str:
        """Words on which contact slips grossly, when, and on how many machines; "" without slip."""
        slips, count = np.flatnonzero(self.slip_contact >= 0), len(self.numbers)
        if not slips.size:
            return ""
        first = slips[np.nanargmin(self.slip_begin[slips])]
        return (
            f"gross slip on {len(slips)} of {count} machine{'s' if count > 1 else ''}, first of"
            f" contact {contact_name(int(self.slip_contact[first]))} at"
            f" {self.slip_begin[first]:.3g} s: the joints behind the contact stand still for at"
            f" most {self.slip_s[slips].max():.2g} s"
        )

    @cached_property
    def limits(self) -> tuple[MachineLimit, ...]:
        """Results of checking joint limits, obstacles, the links' clearance and z₂ on the machines.

        The limits are checked at the recorded times; there are none with `record_s=None`.
        """
        under_way = (self.t >= 0) & (self.t <= self.plan.duration)
        times, shape = self.t[under_way], (1, self.margin.shape[1])
        planned, when = np.full(shape, np.inf), np.zeros(shape)
        lower_margins(planned, when, self.plan.problem, self.plan.q(times)[None], times)
        margins = planned[0], self.margin, self.margin_s
        return machine_limits(self.plan.problem, *margins, self.numbers)

    @property
    def limit_share(self) -> float:
        """Share (0 … 1) of the machines that break a limit of `limits`; NaN if none was checked."""
        return float(np.mean(np.any(self.margin < 0, axis=1))) if self.limits else np.nan

    @property
    def physical_share(self) -> float:
        """Share (0 … 1) of the machines that break a physical limit, one whose violation may break
        something; NaN if no limit was checked.

        The others are limits of chained coordinates. A machine that crosses z₂ = 0 comes to no
        harm: its rates, eq. (6), are smooth in q and contain no z₂, and only cosθ = 0 stops a
        joint. At most the change of coordinates from z to q is singular there.
        """
        return float(np.mean(self._beyond(lambda each: each.physical))) if self.limits else np.nan

    @property
    def limit_words(self) -> str:
        """Words on which limits the machines break, and what would help; "" if none is broken."""
        kinds = [
            limit_words(
                [each for each in self.limits if each.requirement.physical == kind],
                int(np.sum(self._beyond(lambda each, kind=kind: each.physical == kind))),  # type: ignore[misc]
            )
            for kind in (True, False)
        ]
        return "; ".join(filter(None, kinds))

    @property
    def touching(self) -> int:
        """Number of machines whose links touch an obstacle or each other."""
        return int(np.sum(self._beyond(lambda each: each.solid)))

    @property
    def touch_words(self) -> str:
        """Words on how many machines touch what, and what clearance would help; "" if none does."""
        return limit_words([each for each in self.limits if each.requirement.solid], self.touching)

    def _beyond(self, kind: Callable[[Requirement], bool]) -> NDArray[np.bool_]:
        """Return which machines break a limit of one kind, (S,)."""
        kinds = [kind(each) for each, *_ in parts_of(self.plan.problem)]
        return np.asarray(np.any(self.margin[:, kinds] < 0, axis=1))

    def percentile(self, percent: float) -> float:
        """Return the percentile (0 … 100) of E over the samples, degrees; 50 is the median.

        Raises:
            InputError: If the argument is no number from 0 to 100.
        """
        expect_number("percent", percent, "a number from 0 to 100", 0.0, 100.0)
        return float(np.percentile(self.index_E_deg, percent))

    @cached_property
    def draws(self) -> Draws:
        """Parameters of each sample, drawn again from the seed and the sample numbers."""
        return _draws(self.plan, self.machine, self.numbers, self.seed, self.after)

    @property
    def joint_1_range_deg(self) -> tuple[float, float]:
        """Least and greatest angle of an arm's joint 1, degrees, in the whole recorded motion from
        the controller's preparation until it has settled; NaN if no machine's motion is kept."""
        if not (isinstance(self.plan.problem.system, Manipulator) and self.q.size):
            return np.nan, np.nan
        theta = np.rad2deg(self.q[:, :, 1])
        return float(theta.min()), float(theta.max())

    def motion(self, place: int) -> Array:
        """Return the true coordinates of the sample at index `place` of `numbers`, shape (R, N).

        If the sample's motion was not kept, the sample is replayed.
        """
        if place < len(self.q):
            return np.asarray(self.q[place])
        return np.asarray(self.again([int(self.numbers[place])]).q[0])

    @cached_property
    def whole(self) -> Replay:
        """This replay with the motions of all samples, which are replayed if some were not kept."""
        return self if len(self.q) == len(self.numbers) else self.again(self.numbers.tolist())

    def again(self, numbers: Sequence[int]) -> Replay:
        """Replay the samples with the given numbers in the same way, and keep their motions."""
        return replay(
            self.plan,
            self.machine,
            numbers,
            self.seed,
            self.feedback or False,
            settle_s=self.settle_s,
            record_s=self.record_s,
            after=self.after,
        )

    @property
    def angles(self) -> tuple[int, ...]:
        """Array indices of the coordinates after the first that are angles (θ₁ … θₙ)."""
        coordinates = self.plan.problem.system.coordinates
        return tuple(i for i, c in enumerate(coordinates) if i and c.unit == "rad")

    @property
    def terminal_error_deg(self) -> Array:
        """True end minus planned end of each angle, shape (S, n), degrees, signed."""
        return np.rad2deg(self.terminal_error[:, list(self.angles)])

    @property
    def largest_error_deg(self) -> Array:
        """Largest |true − plan| of each angle over all steps, shape (S, n), degrees."""
        return np.rad2deg(self.deviation[:, [i - 1 for i in self.angles]])

    @property
    def index_E_deg(self) -> Array:
        """The paper's index of error, shape (S,), degrees: E = max |θ_r − θ_d|, eq. (29).

        The paper defines a maximum over the joints but does not say over which times. We take all
        times from the start until the servos have settled, since the paper applies the index to the
        curves of Fig. 9 ("5 degree error on the θ3 curve"). `terminal_E_deg` is the other
        interpretation.
        """
        return np.asarray(self.largest_error_deg.max(axis=1))

    @property
    def terminal_E_deg(self) -> Array:
        """Largest |error| over the angles at the end, shape (S,), degrees."""
        return np.asarray(np.abs(self.terminal_error_deg).max(axis=1))

    @property
    def measured(self) -> Array:
        """Coordinates as the encoders read them, shape (M, R, N)."""
        draws = self.draws.part(slice(len(self.q)))
        return encoder_readings(self.plan.problem.system, draws, self.q.T, self.t).T

    @property
    def worst(self) -> int:
        """Number of the sample with the largest E; `replay(…, samples=[worst])` reproduces it."""
        return int(self.numbers[np.argmax(self.index_E_deg)])

    def to_frame(self) -> DataFrame:
        """Return one row per machine: its errors, and every parameter that differs between
        machines.

        Index: number of the sample. Columns: E_deg (eq. 29), terminal_E_deg, terminal_NAME_deg for
        each angle, then effects by name, with _1, _2 ... if there is one per motor or joint.

        Raises:
            InputError: If pandas is not installed.
        """
        columns: dict[str, Array] = {}
        if self.angles:
            columns |= {"E_deg": self.index_E_deg, "terminal_E_deg": self.terminal_E_deg}
        coordinates = self.plan.problem.system.coordinates
        for i, error in zip(self.angles, self.terminal_error_deg.T, strict=True):
            columns[f"terminal_{coordinates[i].name}_deg"] = error
        for name, values in self.draws.values.items():
            for k, row in enumerate(values, start=1):
                if np.ptp(row) > 0:
                    columns[name if len(values) == 1 else f"{name}_{k}"] = row
        pandas = import_library("pandas")
        frame = pandas.DataFrame(columns, index=pandas.Index(self.numbers, name="sample"))
        frame.attrs = {**plan_facts(self.plan), "seed": self.seed}
        return frame

    def to_xarray(self) -> Dataset:
        """Return the true motions and motor speeds of the machines whose motions are kept, over
        sample and time.

        Raises:
            InputError: If xarray is not installed.
        """
        system = self.plan.problem.system
        return import_library("xarray").Dataset(
            {
                "q": (("sample", "time", "coordinate"), self.q),
                "motor_rates": (("sample", "time", "input"), self.motor_rates),
                "terminal_error": (("sample", "coordinate"), self.terminal_error[: len(self.q)]),
            },
            coords={
                "sample": self.numbers[: len(self.q)],
                "time": ("time", self.t, {"units": "s"}),
                "coordinate": [c.name for c in system.coordinates],
                "input": [c.name for c in system.inputs],
                "unit_of_q": ("coordinate", [c.unit for c in system.coordinates]),
            },
            attrs={**plan_facts(self.plan), "seed": self.seed},
        )

    def _repr_html_(self) -> str:
        return notebook_html(self.table())

    def table(self) -> Table:
        """Return errors, slip and broken limits for a terminal: `rich.print(run.table())`."""
        statistics = STATISTICS.values() if self.angles else ()
        rows = [(each.title, f"{number(each.of(self))} deg") for each in statistics]
        words = {"slip": self.slip_words, "limits": self.limit_words}
        rows += [(name, text or "none") for name, text in words.items()]
        first = [("machines", f"{len(self.numbers)}, seed {self.seed}")]
        if worth := self.machine.worth:
            first.append(("on the arm", worth.words))
        return facts([*first, *rows])

    def plot(self) -> Figure:
        """Draw the motions with `planner.report.plot_replays`."""
        return draw_figure("on_the_machine.plot_replays", self)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of a comparison table, JSON-ready, in degrees and seconds.

        Over all samples: median and 95th percentile of E and of the terminal error, the median of
        each angle's terminal error, the longest saturation of each motor, gross slip of friction
        contacts, and the number of fallback steps of the controller.
        """
        return {
            "samples": len(self.numbers),
            "seed": self.seed,
            "worth": self.machine.worth and self.machine.worth.model_dump(),
            **{name: statistic.of(self) for name, statistic in STATISTICS.items()},
            "terminal_error_median_deg": np.median(self.terminal_error_deg, axis=0).tolist(),
            "largest_error_median_deg": np.median(self.largest_error_deg, axis=0).tolist(),
            "saturated_s": self.saturated_s.max(axis=0).tolist(),
            "slip_machines": int(np.sum(self.slip_contact >= 0)),
            "slip_s": float(self.slip_s.max()),
            "slip": self.slip_words,
            "limit_share": self.limit_share,
            "physical_share": self.physical_share,
            "limits": self.limit_words,
            "fallbacks": int(self.fallbacks.sum()),
        }


@dataclass(frozen=True)
class MotionError:
    """An error of one machine's motion.

    Attributes:
        words: What it is.
        of: Returns the error on each machine of a replay, shape (S,), degrees. If it reads motions
            (`q`, `motor_rates`, `measured`) beside other quantities, it takes those of `whole`.
    """

    words: str
    of: Callable[[Replay], Array]


@dataclass(frozen=True)
class Statistic:
    """A percentile of an error over the machines, in degrees.

    Attributes:
        error: Name of the error, a key of `ERRORS`.
        percent: Percentage of the machines with a smaller error.
    """

    error: str
    percent: int

    def of(self, run: Replay) -> float:
        """Return this statistic of a replay, in degrees."""
        error = ERRORS[self.error]
        errors = error.of(run)
        if len(errors) < len(run.numbers):  # those of the kept motions alone
            errors = error.of(run.whole)
        return float(np.percentile(errors, self.percent))

    @property
    def title(self) -> str:
        """Heading of the statistic's column, such as "E 95 %"."""
        return f"{self.error} {self.percent} %"


ERRORS = {
    "E": MotionError(
        "largest joint error on the machine at any time after the preparation (eq. 29)",
        lambda run: run.index_E_deg,
    ),
    "end": MotionError(
        "largest joint error on the machine at the end", lambda run: run.terminal_E_deg
    ),
}
"""The errors of one machine's motion, by name."""

STATISTICS = {
    "E_median_deg": Statistic("E", 50),
    "E_p95_deg": Statistic("E", 95),
    "end_median_deg": Statistic("end", 50),
    "end_p95_deg": Statistic("end", 95),
}
"""Statistics of the errors over all machines of a replay, by their names in rows, JSON and CSV."""

ERROR_WORDS = "; ".join(f"{name}: {error.words}" for name, error in ERRORS.items())
PERCENTILE_WORDS = " and ".join(
    f"median ({p} %)" if p == 50 else f"{p}th percentile ({p} %)"
    for p in sorted({statistic.percent for statistic in STATISTICS.values()})
)
"""Words of captions that explain `ERRORS` and the percentiles of `STATISTICS`."""


def replay(
    plan: Plan,
    machine: Machine | str | None = None,
    samples: int | Sequence[int] = 1,
    seed: int = 0,
    feedback: bool | Feedback = False,
    *,
    settle_s: float = SETTLE_S,
    record_s: float | None = RECORD_S,
    motions: int | None = None,
    progress: Progress | None = None,
    after: Replay | None = None,
) -> Replay:
    """Replay a plan on samples of an emulated machine, open loop or with feedback.

    The same seed gives every plan the same machines, and sample k is the same machine whatever the
    number of samples, so that plans can be compared sample by sample.

    Args:
        plan: An executable plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        samples: Number of samples, or a list of sample numbers (from 0). How machines differ takes
            a hundred or more.
        seed: Random seed.
        feedback: False for open loop. True for feedback by the tracker with the problem's
            `[feedback]` table; or a `planner.Tracker`; or another
            `planner.machine.closed_loop.Feedback`.
        settle_s: Time with zero command after the plan's end, s. This time keeps servo lag out of
            the terminal error.
        record_s: Time between recorded instants, s; None records only the plan's start, its end and
            the final instant. Errors use all simulation steps, recorded or not.
        motions: Number of samples, from the first, whose motions are kept; all by default. Errors
            are kept for all samples, some hundred bytes each.
        progress: Called with (steps done, steps in all).
        after: The run before on the same machines: each begins in the pose and the state in which
            that run left it, so that `machine.start_state` and `initial_angle_error_deg` do not
            count.

    Raises:
        InputError: If the plan has no real inputs, the machine does not match the system, an
            argument is out of range, `after` is of other machines, or the motions to keep take more
            than 2 GB of memory. Besides the motions a replay takes half a GB and some hundred bytes
            per sample, a tracker some kB per control period.
    """
    refuse_inexecutable(plan)
    closing = feedback_of(plan, feedback)
    numbers = sample_numbers(samples)
    _check(seed, settle_s, record_s, motions)
    expect_listener(progress)
    used = machine_for(plan.problem.machine, machine)
    recording = simulate(
        plan,
        used,
        _draws(plan, used, numbers, seed, after),
        settle_s=settle_s,
        record_s=record_s,
        motions=motions,
        feedback=closing,
        progress=progress,
    )
    return Replay(
        **vars(recording),
        plan=plan,
        machine=used,
        seed=seed,
        numbers=numbers,
        feedback=closing,
        settle_s=settle_s,
        record_s=record_s,
        after=after,
    )


def _draws(
    plan: Plan, machine: Machine, numbers: NDArray[np.int64], seed: int, after: Replay | None
) -> Draws:
    """Return the machines `numbers`, as drawn or as the run `after` left them.

    Raises:
        InputError: If `after` is no run, or of other machines or another system.
    """
    draws = draw(machine, plan.problem.system.size - 1, numbers, seed)
    if after is None:
        return draws
    expect(Replay, after, "planner.replay(plan) makes one")
    before = after.machine.with_(start_state="unwound"), after.seed, after.plan.problem.system
    same = before == (machine.with_(start_state="unwound"), seed, plan.problem.system)
    if not same or not np.isin(numbers, after.numbers).all():
        raise InputError(
            "after: a run of the same arm, machine, seed and samples, but for machine.start_state"
        )
    place = np.array([np.flatnonzero(after.numbers == k)[0] for k in numbers])
    end = after.terminal_error[place] + after.plan.goal
    return replace(draws, start=after.end_state[place].T, pose=end[:, 1:].T)


def feedback_of(plan: Plan, feedback: bool | Feedback) -> Feedback | None:
    """Return the feedback law for the argument `feedback` of `replay`; None for open loop."""
    if feedback is True:
        from planner.machine.feedback.tracker import Tracker  # imports OSQP, needed only here

        return Tracker(plan.problem.feedback)
    if feedback is False:
        return None
    if not callable(getattr(feedback, "start", None)):
        raise InputError(f"feedback = {feedback!r}: must be True, False, or a planner.Tracker")
    return feedback


def _check(seed: int, settle_s: float, record_s: float | None, motions: int | None) -> None:
    expect_number("seed", seed, "an integer >= 0", 0, whole=True)
    expect_number("settle_s", settle_s, "a time >= 0, in seconds", 0)
    if record_s is not None:
        expect_number("record_s", record_s, "a time > 0, in seconds, or None", ABOVE_ZERO)
    if motions is not None:
        expect_number("motions", motions, "a number of samples, or None for all", 0, whole=True)
