"""Fit the machine to recorded runs: least squares with a prior, and the uncertainty.

With x the parameters in units of their priors, δ the offsets of each log (`LogModel`) and r the
differences between angles and readings in units of their deviation, the fit minimises

    Σ ρ(r²) + |x|² + |δ / OFFSET|²,   ρ(s) = 18 (√(1 + s/9) − 1)

(soft L1 beyond three standard deviations, so that a wrong reading or a short unmodelled effect has
little influence). The deviation is the readings' noise and, if the residual is larger, an error of
the model. Such an error lasts: readings within `MODEL_ERROR_S` of each other all have it and count
as one. Otherwise it would outweigh the prior, and parameters that the logs hardly determine would
stand for effects that the model lacks.

Derivatives are central differences; one call of the simulation runs all machines of a step.

The uncertainty of x comes from a bootstrap. It resamples the residuals in blocks, since unmodelled
effects last longer than a reading, and the priors, since a direction that the logs do not determine
is as uncertain as its prior. Each replicate is one linear step from the minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from planner.machine.identification.model import LogModel
from planner.machine.identification.parameters import Parameters
from planner.support.arrays import Array

OFFSET_RAD = np.deg2rad(5.0)
"""Standard deviation of the prior of a log's offset at its start, as large as the prototype's lost
motion."""

HALF_STEP = 0.01
"""Half step of central differences, in standard deviations of the prior: 0.02 degrees of lost
motion. A smaller step would not average over kinks of the backlash; a much larger one would change
the slopes."""

RATE_HZ, INDEPENDENT_HZ = 50.0, 25.0
"""Readings used per second, and how many of them count as independent."""

MODEL_ERROR_S = 2.0
"""Time that an error of the model lasts, s: about a swing of an arm. With 8 s the machines found
are the same within the spread of their runs."""

NOISE_MARGIN = 1.15
"""Multiple of the noise up to which a residual shows no error of the model."""

MOST_ROUNDS, SETTLED = 8, 0.05
"""Largest number of rounds in which the deviations are found, and change that ends them."""

SOFT_FROM = 3.0
"""Number of standard deviations beyond which a residual counts less than by its square."""

MOST_STEPS, TOLERANCE = 30, 1e-5

BLOCK_S, REPLICATES = 1.0, 200

START_SPREAD = 0.3
"""Standard deviation of later starts about the preset, in standard deviations of the prior."""


Tell = Callable[[str, float], None]
"""Function that is called with what is done now and the fraction done, 0 … 1."""


@dataclass(frozen=True, eq=False)
class BestFit:
    """Parameters at the minimum of the fit, with their uncertainty.

    Attributes:
        x: Parameters, (P,).
        spread: Standard deviation of x by the bootstrap, (P,); 1 is the prior's.
        residual: Root mean square of angles minus readings of each log and joint, (L, n), rad.
    """

    x: Array
    spread: Array
    residual: Array


def fit(
    models: Sequence[LogModel], parameters: Parameters, starts: int, seed: int, tell: Tell
) -> BestFit:
    """Return the best fit of the parameters to the logs among searches from several starts.

    Args:
        models: The logs.
        parameters: The parameters to fit.
        starts: Number of starts; the first is the preset.
        seed: Random seed of the other starts and of the bootstrap.
        tell: Called with what is done now and the fraction done, 0 … 1.
    """
    from scipy.optimize import least_squares  # slow to import

    problem, random = _LeastSquares(models, parameters), np.random.default_rng(seed)
    best = None
    for start in range(starts):
        z = np.zeros(problem.size)
        if start:
            z[: problem.machine] = START_SPREAD * random.normal(size=problem.machine)
        z = np.clip(z, problem.low + 1e-6, problem.high - 1e-6)
        z = problem.with_settled_offsets(z)
        problem.count, problem.heard = 0, partial(_share, tell, start, starts)
        for _ in range(1 if start else MOST_ROUNDS):  # costs compare only with the same deviations
            solution = least_squares(
                lambda z: problem.evaluate(z)[0],
                z,
                lambda z: problem.evaluate(z)[1],
                bounds=(problem.low, problem.high),
                loss="soft_l1",
                f_scale=SOFT_FROM,
                tr_solver="lsmr",  # an SVD of these tall matrices would take most of the time
                max_nfev=MOST_STEPS,
                xtol=TOLERANCE,
                ftol=TOLERANCE,
            )
            if start or not problem.weigh(solution.x):
                break
            z = np.clip(solution.x, problem.low + 1e-6, problem.high - 1e-6)
        if best is None or solution.cost < best.cost:
            best = solution
    assert best is not None
    residual = np.sqrt([np.mean(gap**2, axis=0) for gap in problem.gaps(best.x)])
    spread = problem.bootstrap(best.x, random)
    return BestFit(problem.split(best.x)[0], spread, residual)


def step_with_zeros(models: Sequence[LogModel], parameters: Parameters, best: BestFit) -> BestFit:
    """Extend a fit by the zeros of encoders, in one linear step.

    Args:
        models: The logs, for these parameters.
        parameters: The parameters, of which the zeros of encoders come last.
        best: The fit without zeros.

    Returns:
        Parameters after the step and their uncertainty, with the residual before it.
    """
    problem, count = _LeastSquares(models, parameters), len(parameters.rows)
    z = np.zeros(problem.size)
    z[: len(best.x)] = best.x
    z = problem.with_settled_offsets(z)
    _, hessian, gradient = problem.normal_equations(z)
    z -= np.linalg.solve(hessian, gradient.sum(axis=0) + z)
    spread = np.sqrt(np.diag(np.linalg.inv(hessian)))
    return BestFit(z[:count], spread[:count], best.residual)


def _share(tell: Tell, start: int, starts: int, count: int) -> None:
    """Report the progress of the searches after `count` evaluations of one."""
    tell(f"fitting, start {start + 1} of {starts}", (start + min(1.0, count / MOST_STEPS)) / starts)


class _LeastSquares:
    """Residuals as a function of z: the parameters, then each log's offsets over `OFFSET_RAD`."""

    def __init__(self, models: Sequence[LogModel], parameters: Parameters) -> None:
        self._models, self.machine = models, len(parameters.rows)
        self._joints = models[0].log.theta.shape[1]
        self.size = self.machine + len(models) * self._joints
        room = np.full(self.size - self.machine, 20.0)  # a hundred degrees: practically no bound
        self.low = np.concatenate([parameters.low, -room])
        self.high = np.concatenate([parameters.high, room])
        self.heard: Callable[[int], None] = lambda count: None
        self.count = 0
        self._kept: tuple[Array, Array, Array] | None = None
        self._deviations = [model.noise for model in models]  # of each log's readings, (n,), rad

    def split(self, z: Array) -> tuple[Array, Array]:
        """Return the parameters (P,) and the logs' offsets (L, n), rad, that z contains."""
        offsets = OFFSET_RAD * z[self.machine :].reshape(len(self._models), self._joints)
        return z[: self.machine], offsets

    def with_settled_offsets(self, z: Array) -> Array:
        """Return z with the offsets at which each log's angles agree with the readings."""
        x = z[: self.machine]
        offsets = [model.settled_offsets(x[None])[0] for model in self._models]
        return np.concatenate([x, np.ravel(offsets) / OFFSET_RAD])

    def gaps(self, z: Array) -> Iterator[Array]:
        """Yield angles minus readings of each log at z, from its known row on, (R, n), rad."""
        x, offsets = self.split(z)
        for model, offset in zip(self._models, offsets, strict=True):
            yield (model.angles(x[None], offset[None])[0] - model.log.theta)[model.known :]

    def weigh(self, z: Array) -> bool:
        """Take the deviations from the residuals at z; return whether they changed."""
        new = []
        for model, gap in zip(self._models, self.gaps(z), strict=True):
            beyond = np.mean(gap**2, axis=0) - (NOISE_MARGIN * model.noise) ** 2
            lasting = INDEPENDENT_HZ * MODEL_ERROR_S * np.maximum(beyond, 0.0)
            new.append(np.sqrt(model.noise**2 + lasting))
        change = np.abs(np.array(new) / np.array(self._deviations) - 1)
        if np.max(change) <= SETTLED:
            return False
        self._deviations, self._kept = new, None
        return True

    def evaluate(self, z: Array) -> tuple[Array, Array]:
        """Return the residuals at z and their derivatives by z, from one simulation of each log."""
        if self._kept is None or not np.array_equal(self._kept[0], z):
            self.count += 1
            self.heard(self.count)
            x, offsets = self.split(z)
            residuals, slopes = [], []
            for k, model in enumerate(self._models):
                first = self.machine + k * self._joints
                columns = [*range(self.machine), *range(first, first + self._joints)]
                deviation = self._deviations[k]
                values, derivatives = self._of_log(model, deviation, x, offsets[k], columns, z)
                rows = np.zeros((len(values), self.size))
                rows[:, columns] = derivatives
                residuals.append(values)
                slopes.append(rows)
            priors = np.eye(self.size)
            both = np.concatenate([*residuals, z]), np.concatenate([*slopes, priors])
            self._kept = (z.copy(), *both)
        return self._kept[1], self._kept[2]

    def _of_log(
        self,
        model: LogModel,
        deviation: Array,
        x: Array,
        offsets: Array,
        columns: Sequence[int],
        z: Array,
    ) -> tuple[Array, Array]:
        """Return the residuals of a log in units of the joints' `deviation`, (m,), and their
        derivatives by some entries of z, (m, columns)."""
        count = len(columns)
        step = HALF_STEP * np.eye(count)
        steps = np.concatenate([np.zeros((1, count)), step, -step])
        limits = self.low[columns] - z[columns], self.high[columns] - z[columns]
        steps = np.clip(steps, *limits)
        machines = x + steps[:, : self.machine]
        starts = offsets + OFFSET_RAD * steps[:, self.machine :]
        stride = max(1, round(1 / RATE_HZ / model.log.interval_s))
        weight = np.sqrt(min(1.0, INDEPENDENT_HZ * stride * model.log.interval_s))
        rows = slice(model.known, None, stride)
        gap = (model.angles(machines, starts)[:, rows] - model.log.theta[rows]) / deviation
        values = weight * gap.reshape(len(gap), -1)
        width = np.diag(steps[1 : 1 + count] - steps[1 + count :])
        return values[0], ((values[1 : 1 + count] - values[1 + count :]) / width[:, None]).T

    def normal_equations(self, z: Array) -> tuple[int, Array, Array]:
        """Return the number of blocks of data, the Hessian of the cost, and its gradient by block
        at z."""
        residuals, slopes = self.evaluate(z)
        data = len(residuals) - self.size
        per_block = max(1, round(BLOCK_S * INDEPENDENT_HZ * 2)) * self._joints
        block = np.arange(data) // per_block
        blocks = int(block[-1]) + 1
        soft = 1 / np.sqrt(1 + (residuals[:data] / SOFT_FROM) ** 2)  # ρ'
        gradient = np.zeros((blocks, self.size))
        np.add.at(gradient, block, slopes[:data] * (soft * residuals[:data])[:, None])
        hessian = slopes[:data].T @ (soft[:, None] * slopes[:data]) + np.eye(self.size)
        return blocks, hessian, gradient

    def bootstrap(self, z: Array, random: np.random.Generator) -> Array:
        """Estimate the parameters' standard deviations, (P,), by the bootstrap."""
        blocks, hessian, gradient = self.normal_equations(z)
        counts = random.multinomial(blocks, np.full(blocks, 1 / blocks), size=REPLICATES)
        priors = random.normal(size=(REPLICATES, self.size))
        pull = counts @ gradient + z - priors
        steps = np.linalg.solve(hessian, pull.T)[: self.machine]
        return np.asarray(np.std(steps, axis=1))
