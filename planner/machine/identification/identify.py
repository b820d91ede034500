"""Identify the machine of an arm from its logs: `identify`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import InputError, expect_number
from planner.machine.identification.diagnosis import longest_standstill, refuse_misfit
from planner.machine.identification.fit import BestFit, fit, step_with_zeros
from planner.machine.identification.model import KNOWN_DEG, LEAST_NOISE_DEG, LogModel, known_row
from planner.machine.identification.parameters import FitParameter, Parameters
from planner.machine.machine import Machine, machine_for
from planner.plan.recorded.log import Log, expect_log
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.problem.tables.machine_effects import Worth
from planner.support.arrays import Array, Frozen, frozen, jsonable
from planner.support.files import toml, write_text
from planner.support.package import Figure, Table, draw_figure
from planner.support.progress import expect_listener
from planner.support.tables import Column, digits, terminal_table
from planner.systems.manipulator import Manipulator

Progress = Callable[[str, float], None]
"""Function that is called with what is done now and the fraction done, 0 … 1."""

STARTS = 2
"""Default number of searches; the second, from another start, can reveal a local minimum."""

NOISE_RATIO = 1.5
"""Multiple of an encoder's noise above which a residual is reported. On emulated arms inertia gives
7, an encoder that is eccentric by 0.1 degrees hardly more than 1."""

COARSE_DEG = 0.3
"""Resolution above which an encoder's steps exceed all unmodelled effects, degrees; 12 bits give
0.088 degrees."""

ZERO_OFF_DEG, ZERO_SPREADS = 0.3, 5.0
"""Error of an encoder's zero, and multiple of its standard deviation, above which it is reported.
On emulated arms without such an error the estimate is at most 0.12 degrees or 2.5 deviations."""

RATIO_OFF_PERCENT = 5.0
"""Error of a gear ratio above which it is reported; tolerances and creep are within 2 %."""

STANDSTILL_S = 3.0
"""Time of equal readings that is reported if there is a residual; most encoders flicker."""

SAME_SHARE = 0.9
"""Two logs are of the same run if their readings differ by less than this multiple of the noise."""

PRIOR_SHARE = 0.9
"""Fraction of its prior's deviation that a parameter keeps if the logs hardly determine it."""

END_SHARE = 5.4
"""Multiple of a kept-out run's error (rms) within which 34 of 45 ends of compensated plans lie
on the 15 arms of results/truths that are not of the model's class. With 2.13, which covered 34 of
44 on other arms, it is 14 of them."""


@dataclass(frozen=True)
class Estimate:
    """The estimate of one parameter, in `parameter.unit`.

    Attributes:
        parameter: The parameter.
        preset, value: Value of the parameter before and after the fit.
        spread: Standard deviation of the value by the bootstrap, from the readings only; it leaves
            out errors of effects that the model merges or lacks.
        told: How much the logs determine the parameter, 0 … 1: 1 minus the remaining fraction of
            the prior's standard deviation.
    """

    parameter: FitParameter
    preset: float
    value: float
    spread: float
    told: float


@dataclass(frozen=True)
class PredictionError:
    """Largest and root mean square difference of predicted and read angles, (n,), degrees."""

    largest_deg: tuple[float, ...]
    rms_deg: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Identification(Frozen):
    """The result of `identify`.

    Attributes:
        machine: The identified machine, without spreads except those of the state at the start of a
            run. Its encoders have the noise of the runs; its `worth` says how far to believe it.
        preset: The machine with which the search began.
        problem: The problem that defines the arm.
        logs: The logs that were fitted.
        kept_out: The log that was kept for testing; None if there was only one log.
        estimates: The estimate of each parameter.
        residual_deg: Root mean square of the residuals, by log and joint, (L, n), degrees.
        noise_deg: Noise of each log's readings, (L, n), degrees.
        warnings: Doubts about the result, in sentences.
    """

    machine: Machine
    preset: Machine
    problem: Problem
    logs: tuple[Log, ...]
    kept_out: Log | None
    estimates: tuple[Estimate, ...]
    residual_deg: Array
    noise_deg: Array
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        lost = [each for each in self.estimates if each.parameter.key.startswith("w")]
        text = ", ".join(f"{each.parameter.key} {each.value:.3g} deg" for each in lost)
        return (
            f"Identification({len(self.logs)} log{'s' * (len(self.logs) > 1)}: {text}; residual"
            f" {np.sqrt(np.mean(self.residual_deg**2)):.2g} deg, {len(self.warnings)} warnings)"
        )

    def __getitem__(self, key: str) -> Estimate:
        """Return the estimate of the parameter with this key, such as "w2"."""
        return next(each for each in self.estimates if each.parameter.key == key)

    @property
    def merged(self) -> tuple[str, ...]:
        """Parameters that stand for several effects, since logs of angles cannot separate them."""
        rows = [each.parameter for each in self.estimates if each.parameter.merged]
        kinds = (row.name.rstrip("0123456789 ").replace(" of joint", "") for row in rows)
        texts = (f"{kind}: {row.merged}" for kind, row in zip(kinds, rows, strict=True))
        return tuple(dict.fromkeys(texts))

    @property
    def untold(self) -> tuple[str, ...]:
        """Names of parameters that the logs hardly determine, so that they stay near the preset."""
        return tuple(e.parameter.name for e in self.estimates if e.told < 1 - PRIOR_SHARE)

    def __post_init__(self) -> None:
        super().__post_init__()
        log, worth = self.kept_out, dict[str, Any](tested=False)
        if log is not None and all(_turns(log, i) for i in range(1, log.theta.shape[1])):
            found, preset = (_pooled(self.errors[name]) for name in ("identified", "preset"))
            width = END_SHARE * found
            worth = {"tested": True, "improves": found < preset, "half_width_deg": width}
        object.__setattr__(self, "machine", self.machine.with_(worth=worth))

    @property
    def worth(self) -> str:
        """A sentence that says how far plans for this machine can be believed."""
        words = self._worth.words
        hint = " (planner motion check makes one; give it last)" * (self.improves is None)
        return f"{words[0].upper()}{words[1:]}{hint}."

    def predict(self, log: Log, machine: Machine | None = None) -> Log:
        """Predict the angles of a log from its commands.

        Args:
            log: Any log of the arm.
            machine: Another machine, such as `preset`, in place of the identified one.

        Returns:
            The log with predicted angles in place of the readings. The readings stay until every
            joint has moved by a degree, since the arm's state is unknown until then.

        Raises:
            InputError: If the log is of another arm, or a joint does not move in it.
        """
        machine = self.machine if machine is None else machine
        shifted = replace(log, theta=log.theta - self._zeros)
        prediction = predict_run(shifted, self.problem, machine)
        return replace(prediction, theta=prediction.theta + self._zeros)

    @property
    def _zeros(self) -> Array:
        """Encoder readings at joint angles of zero, (n,), rad."""
        values = {each.parameter.key: np.deg2rad(each.value) for each in self.estimates}
        return np.array([values.get(f"zero{i}", 0.0) for i in range(1, self.problem.system.size)])

    def error(self, log: Log, machine: Machine | None = None) -> PredictionError:
        """Return the error of the prediction of a log; for the arguments see `predict`."""
        gap = np.abs(self.predict(log, machine).theta_deg - log.theta_deg)
        first = int(np.flatnonzero(gap.any(axis=1))[0]) if gap.any() else 0
        rms = np.sqrt(np.mean(gap[first:] ** 2, axis=0))
        return PredictionError(tuple(gap.max(axis=0).tolist()), tuple(rms.tolist()))

    @cached_property
    def errors(self) -> dict[str, PredictionError]:
        """Errors of this machine and of the preset in predicting the run that was kept out."""
        if self.kept_out is None:
            return {}
        mine, presets = self.error(self.kept_out), self.error(self.kept_out, self.preset)
        return frozen({"identified": mine, "preset": presets})

    @property
    def _worth(self) -> Worth:
        assert self.machine.worth is not None
        return self.machine.worth

    @property
    def improves(self) -> bool | None:
        """Whether the machine predicts the run that was kept out better than the preset does.

        Only a run in which every passive joint reverses tests that: without reversal, a machine
        whose lost motion is a degree off predicts as well. None if not tested.
        """
        return self._worth.improves

    @property
    def verdict(self) -> str:
        """`improves` in words."""
        return {None: "not tested", True: "better", False: "no better"}[self.improves]

    @property
    def half_width_deg(self) -> float:
        """Half width about the predicted end of a plan, degrees; NaN if not tested.

        `END_SHARE` times the error of predicting the run that was kept out, root mean square over
        all passive joints. No confidence interval: see `END_SHARE`.
        """
        return float("nan" if (width := self._worth.half_width_deg) is None else width)

    def table(self) -> Table:
        """Return the estimates as a table for a terminal: `rich.print(found.table())`."""
        return terminal_table(COLUMNS, self.estimates)

    def plot(self) -> Figure:
        """Plot each run's residuals, those of the preset, and the uncertainty of each number."""
        return draw_figure("recorded.identification_figure", self)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-ready data."""
        data = {
            "machine": self.machine.to_dict(),
            "parameters": [
                {name: getattr(e.parameter, name) for name in ("key", "name", "unit")}
                | {name: getattr(e, name) for name in ("preset", "value", "spread", "told")}
                for e in self.estimates
            ],
            "merged": list(self.merged),
            "untold": list(self.untold),
            "residual_deg": self.residual_deg.tolist(),
            "noise_deg": self.noise_deg.tolist(),
            "kept_out": None if self.kept_out is None else self.kept_out.source,
            "errors": {k: vars(error) for k, error in self.errors.items()},
            "improves": self.improves,
            "verdict": self.verdict,
            "half_width_deg": self.half_width_deg,
            "warnings": list(self.warnings),
        }
        return dict(jsonable(data))

    def to_toml(self) -> str:
        """Return the `[machine]` table of a problem file, with comments on its origin."""
        head = [f"# Identified from {len(self.logs)} run{'s' * (len(self.logs) > 1)}."]
        head += [f"# {self.worth}"]
        head += [f"# One number stands for several. {text}." for text in self.merged]
        head += [f"# Warning: {text}" for text in self.warnings]
        rows = [f"{key} = {toml(value)}" for key, value in self.machine.to_dict().items()]
        return "\n".join([*head, "[machine]", *rows]) + "\n"

    def save(self, path: str | Path) -> Path:
        """Write the identified machine's `[machine]` table; `planner.load_machine` reads it back.

        Raises:
            InputError: If the file cannot be written.
        """
        return write_text(path, self.to_toml())


COLUMNS: list[Column[Estimate]] = [
    Column("parameter", "", lambda e: e.parameter.key, left=True),
    Column("of", "", lambda e: e.parameter.name, left=True),
    Column("unit", "", lambda e: e.parameter.unit, left=True),
    Column("preset", "", lambda e: e.preset, digits(4)),
    Column("found", "", lambda e: e.value, digits(4)),
    Column("+-", "", lambda e: e.spread, digits(2)),
    Column("told", "", lambda e: e.told, "{:.2f}".format),
]


def identify(
    logs: Log | Sequence[Log],
    problem: AnyProblem,
    machine: Machine | str | None = "prototype",
    *,
    starts: int = STARTS,
    seed: int = 0,
    progress: Progress | None = None,
) -> Identification:
    """Identify the machine of an arm from recorded runs.

    Lost motion, ratios, lags, gains, biases and the gearheads' backlash are fitted to the runs,
    with a prior about the preset (see `planner.machine.identification.parameters` and `fit`). If
    the runs show that an encoder's zero is off, the zeros are fitted too, except that of the last
    joint, on whose angle no rate depends. The result names parameters that stand for several
    effects or that the runs do not determine. If there are several runs, the last is kept out, to
    test how well the machine predicts it.

    Args:
        logs: One run or several; see `planner.read_log`. The motion of `planner.excitation`
            determines most parameters.
        problem: The problem that defines the arm: number of joints and gear constants.
        machine: Start of the search, and the values that are not fitted: a machine, the name of a
            preset, or None for the problem's own. With fidelity "dynamic" the model has inertia,
            separates friction, backlash and twist, and a fit takes two minutes.
        starts: Number of searches from different starts, of which the best counts.
        seed: Random seed of these starts and of the bootstrap.
        progress: Called with what is done now and the fraction done, 0 … 1.

    Raises:
        InputError: If there is no log or one is given twice, the system is not an arm with friction
            disks, or a log has another number of joints, does not move one of them by a degree, or
            fits the arm only with another sign, unit, order of columns or clock.
    """
    problem = problem_of(problem)
    tell = expect_listener(progress)
    every = [logs] if isinstance(logs, Log) else list(logs)
    for log in every:
        expect_log(log)
    if not every:
        raise InputError("identify needs at least one log; planner.read_log(path) reads one")
    expect_number("starts", starts, "a number of searches, at least 1", 1, whole=True)
    system = problem.system
    if not isinstance(system, Manipulator):
        raise InputError(
            f"{problem.source}: only machines of arms with friction disks can be identified"
            f" (system.kind = 'manipulator'), and this is a {system.kind}"
        )
    preset = machine_for(problem.machine, machine)
    parameters = Parameters(preset, system)
    _refuse_twice(every)
    for log in every:
        log.plan(problem)  # raises if the number of joints differs
        known_row(log)  # raises if a joint does not move
        refuse_misfit(log, system)
    kept_out = every.pop() if len(every) > 1 else None
    models = [LogModel(log, problem, parameters) for log in every]
    result = fit(models, parameters, starts, seed, tell)
    more = Parameters(preset, system, zeros=True)
    also = [LogModel(log, problem, more) for log in every]
    estimates = tuple(_estimates(parameters, result))
    if any(_wrong_zeros(_estimates(more, step_with_zeros(also, more, result)))):
        again = fit(also, more, starts, seed, tell)
        if any(_wrong_zeros(corrections := tuple(_estimates(more, again)))):
            parameters, result, estimates = more, again, corrections
    noise = np.rad2deg([model.noise for model in models])
    residual = np.rad2deg(result.residual)
    return Identification(
        machine=parameters.machine(result.x).with_(
            encoder_noise_deg=_noise_before_rounding(noise, preset)
        ),
        preset=preset,
        problem=problem,
        logs=tuple(every),
        kept_out=kept_out,
        estimates=estimates,
        residual_deg=residual,
        noise_deg=noise,
        warnings=tuple(find_warnings(every, estimates, residual, noise)),
    )


def _pooled(error: PredictionError) -> float:
    """Return the root mean square over all passive joints, degrees."""
    return float(np.sqrt(np.mean(np.square(error.rms_deg[1:]))))


def _noise_before_rounding(noise: Array, machine: Machine) -> list[float]:
    """Return each encoder's noise before its readings are rounded, degrees, from the noise of the
    logs' readings, (L, n), which contains the rounding."""
    rounding = machine.mean("encoder_resolution_deg") ** 2 / 12
    own = np.mean(noise**2, axis=0) - rounding
    return [float(f"{x:.2g}") for x in np.sqrt(np.maximum(own, LEAST_NOISE_DEG**2))]


def _refuse_twice(logs: Sequence[Log]) -> None:
    for first, second in combinations(logs, 2):
        rows = min(len(first.t), len(second.t))
        ends = slice(rows), slice(-rows, None)  # a copy may lack the run's end or its start
        if any(_are_alike(first.theta[part], second.theta[part]) for part in ends):
            raise InputError(
                f"{first.source} and {second.source} are the same run; give each run once, since"
                " the last run tests the fit of the others"
            )


def _are_alike(a: Array, b: Array) -> bool:
    """Return whether readings (R, n) differ by less than their noise: copies, perhaps rounded.

    Readings of two runs differ by √2 times the noise or more, second differences by √6 times.
    """
    if a.shape != b.shape:
        return False
    noise = np.sqrt(np.mean(np.diff(a, n=2, axis=0) ** 2) / 6)
    return bool(np.sqrt(np.mean((a - b) ** 2)) <= SAME_SHARE * noise)


def _estimates(parameters: Parameters, result: BestFit) -> Iterator[Estimate]:
    values = parameters.values(result.x)
    for row, value, left in zip(parameters.rows, values, result.spread.tolist(), strict=True):
        found = float(value) / row.scale, left * row.prior / row.scale, 1.0 - min(1.0, left)
        yield Estimate(row, row.value / row.scale, *found)


def find_warnings(
    logs: Sequence[Log], estimates: Sequence[Estimate], residual: Array, noise: Array
) -> Iterator[str]:
    """Yield what the user should know about the logs and the fit, a sentence each."""
    yield from filter(None, (log.jitter_words for log in logs))
    for log, left, usual in zip(logs, residual, noise, strict=True):
        ratio = left / usual
        if np.max(ratio) > NOISE_RATIO:
            joint = int(np.argmax(ratio))
            coarse = log.steps_deg[joint]
            if coarse > COARSE_DEG:
                yield (
                    f"{log.source}: theta{joint + 1} is read in steps of {coarse:.3g} deg, which"
                    " explain its residual; a finer encoder would tell more"
                )
                continue
            yield (
                f"{log.source}: theta{joint + 1} has a residual of {left[joint]:.3g} deg (rms), and"
                f" its encoder's noise is {usual[joint]:.2g} deg: the arm has an effect that the"
                " model lacks (inertia in fast motions, which a machine of fidelity 'dynamic' has;"
                " an encoder that is eccentric; something loose"
                + ("; commands and readings of different clocks)" if joint == 0 else ")")
            )
            first, last = longest_standstill(log.theta[:, joint])
            if (still_s := log.t[last - 1] - log.t[first]) > STANDSTILL_S:
                yield (
                    f"{log.source}: theta{joint + 1} reads exactly the same for {still_s:.3g} s"
                    f" from t = {log.t[first]:.4g} s on, which may explain its residual: is its"
                    " encoder dead?"
                )
    passive = range(1, logs[0].theta.shape[1])
    if still := [i for i in passive if not any(_turns(x, i) for x in logs)]:
        names = ", ".join(f"joint {i + 1}" for i in still)
        yield (
            f"{names} never reverses in these runs, so the lost motion cannot be determined: record"
            " planner.excitation(problem)"
        )
    for zero in _wrong_zeros(estimates):
        yield (
            f"{(angle := f'theta{zero.parameter.key[4:]}')} reads {zero.value:.2f} +-"
            f" {zero.spread:.2f} deg with the joint at zero, or friction changes with its angle."
            f" Put it at zero and look; subtract a true offset from all readings of {angle}"
        )
    for each in estimates:
        off = abs(each.value)
        if each.parameter.key.startswith("ratio") and off > max(
            RATIO_OFF_PERCENT, ZERO_SPREADS * each.spread
        ):
            yield (
                f"joint {each.parameter.key[5:]} turns {off:.3g} %"
                f" {'farther' if each.value > 0 else 'less far'} than K and k_g say: a wrong"
                " constant, or a wrong unit of u1 or of its angle"
            )


def _wrong_zeros(estimates: Iterable[Estimate]) -> Iterator[Estimate]:
    for each in estimates:
        least = max(ZERO_OFF_DEG, ZERO_SPREADS * each.spread)
        if each.parameter.key.startswith("zero") and abs(each.value) > least:
            yield each


def _turns(log: Log, joint: int) -> bool:
    """Return whether a joint both rises and falls so far that its axis must have pushed it."""
    theta = log.theta_deg[:, joint]
    risen = np.max(theta - np.minimum.accumulate(theta))
    fallen = np.max(np.maximum.accumulate(theta) - theta)
    return bool(min(risen, fallen) > KNOWN_DEG)


def predict_run(log: Log, problem: Problem, machine: Machine | str | None) -> Log:
    """Predict the angles of a log from its commands; see `Identification.predict`."""
    system = problem.system
    assert isinstance(system, Manipulator)
    parameters = Parameters(machine_for(problem.machine, machine), system)
    model, x = LogModel(log, problem, parameters), np.zeros((1, len(parameters.rows)))
    theta = model.angles(x, model.settled_offsets(x))[0]
    theta[: model.known] = log.theta[: model.known]
    return replace(log, theta=theta, source=f"prediction of {log.source}")
