"""The machine that recorded runs tell of: least squares with a prior, and how sure it is.

With x the parameters in units of their priors, δ the offsets of each log (`LogModel`) and r the
differences between angles and readings in units of the readings' noise, the fit minimises

    Σ ρ(r²) + |x|² + |δ / OFFSET|²,   ρ(s) = 18 (√(1 + s/9) − 1)

(soft L1 beyond three deviations: a reading that is wrong, or an effect that the model lacks for a
moment, pulls little). Derivatives are central differences, with all machines that one step needs in
one call of the simulation.

How sure x is comes from a bootstrap: of the residuals in blocks, since what the model lacks lasts
longer than a reading, and of the priors, since a direction in which the logs tell nothing is as
unsure as its prior. Each replicate is one linear step from the minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from planner.machine.identification.model import LogModel
from planner.machine.identification.parameters import Parameters
from planner.support.arrays import Array

OFFSET_RAD = np.deg2rad(5.0)
"""Prior of an offset at the start of a log: the prototype's lost motion."""

HALF_STEP = 0.01
"""Half of a central difference, in deviations of the prior: 0.02 degrees of lost motion, below
which kinks of the backlash would not be averaged over, and far below what changes the slopes."""

RATE_HZ, INDEPENDENT_HZ = 50.0, 25.0
"""Readings that are used a second, and how many of them count as independent."""

SOFT_FROM = 3.0
"""Deviations from which on a residual counts less than by its square."""

MOST_STEPS, TOLERANCE = 30, 1e-5

BLOCK_S, REPLICATES = 1.0, 200

START_SPREAD = 0.3
"""Starts after the first are drawn this far about the preset, in deviations of the prior."""


Tell = Callable[[str, float], None]
"""Told what is done, and which share of all, 0 … 1."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A minimum.

    Attributes:
        x: Parameters, (P,).
        spread: Standard deviation of x by the bootstrap, (P,); 1 is the prior's.
        residual: Root mean square of angles minus readings of each log and joint, (L, n), rad.
    """

    x: Array
    spread: Array
    residual: Array


def fit(
    models: Sequence[LogModel],
    parameters: Parameters,
    starts: int,
    seed: int,
    tell: Tell,
) -> Fit:
    """The best of the minima that some starts lead to.

    Args:
        models: The logs.
        parameters: What is fitted.
        starts: How many; the first is the preset.
        seed: Of the others, and of the bootstrap.
        tell: Told what is done and which share of all, 0 … 1.
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
        solution = least_squares(
            problem.residuals,
            z,
            problem.slopes,
            bounds=(problem.low, problem.high),
            loss="soft_l1",
            f_scale=SOFT_FROM,
            tr_solver="lsmr",  # thousands of rows a column, of which an SVD takes most of the time
            max_nfev=MOST_STEPS,
            xtol=TOLERANCE,
            ftol=TOLERANCE,
        )
        if best is None or solution.cost < best.cost:
            best = solution
    assert best is not None
    x, offsets = problem.split(best.x)
    gaps = [
        m.angles(x[None], o[None])[0] - m.log.theta for m, o in zip(models, offsets, strict=True)
    ]
    residual = [
        np.sqrt(np.mean(g[m.known :] ** 2, axis=0)) for m, g in zip(models, gaps, strict=True)
    ]
    spread = problem.bootstrap(best.x, random)
    return Fit(x, spread, np.array(residual))


def _share(tell: Tell, start: int, starts: int, count: int) -> None:
    """Say how far the searches are, after so many evaluations of one."""
    tell(f"fitting, start {start + 1} of {starts}", (start + min(1.0, count / MOST_STEPS)) / starts)


class _LeastSquares:
    """Residuals of z, the parameters and then the offsets of each log, scaled by `OFFSET_RAD`."""

    def __init__(self, models: Sequence[LogModel], parameters: Parameters) -> None:
        self._models, self.machine = models, len(parameters.rows)
        self._joints = models[0].log.theta.shape[1]
        self.size = self.machine + len(models) * self._joints
        room = np.full(self.size - self.machine, 20.0)  # a hundred degrees: none
        self.low = np.concatenate([parameters.low, -room])
        self.high = np.concatenate([parameters.high, room])
        self.heard: Callable[[int], None] = lambda count: None
        self.count = 0
        self._kept: tuple[Array, Array, Array] | None = None

    def split(self, z: Array) -> tuple[Array, Array]:
        """Parameters (P,) and offsets (L, n), rad."""
        offsets = OFFSET_RAD * z[self.machine :].reshape(len(self._models), self._joints)
        return z[: self.machine], offsets

    def with_settled_offsets(self, z: Array) -> Array:
        """The same with the offsets that the readings ask for."""
        x = z[: self.machine]
        offsets = [model.settled_offsets(x[None])[0] for model in self._models]
        return np.concatenate([x, np.ravel(offsets) / OFFSET_RAD])

    def residuals(self, z: Array) -> Array:
        """Of readings, then of the priors of z."""
        return self._evaluate(z)[0]

    def slopes(self, z: Array) -> Array:
        """Derivatives of `residuals`."""
        return self._evaluate(z)[1]

    def _evaluate(self, z: Array) -> tuple[Array, Array]:
        """Both, since they come of one call of the simulation."""
        if self._kept is None or not np.array_equal(self._kept[0], z):
            self.count += 1
            self.heard(self.count)
            x, offsets = self.split(z)
            residuals, slopes = [], []
            for k, model in enumerate(self._models):
                first = self.machine + k * self._joints
                columns = [*range(self.machine), *range(first, first + self._joints)]
                values, derivatives = self._of_log(model, x, offsets[k], columns, z)
                rows = np.zeros((len(values), self.size))
                rows[:, columns] = derivatives
                residuals.append(values)
                slopes.append(rows)
            self._kept = (
                z.copy(),
                np.concatenate([*residuals, z]),
                np.concatenate([*slopes, np.eye(self.size)]),
            )
        return self._kept[1], self._kept[2]

    def _of_log(
        self, model: LogModel, x: Array, offsets: Array, columns: Sequence[int], z: Array
    ) -> tuple[Array, Array]:
        """Residuals of a log, (m,), and their derivatives by some of z, (m, columns)."""
        count = len(columns)
        step = HALF_STEP * np.eye(count)
        moved = np.concatenate([np.zeros((1, count)), step, -step])
        limits = self.low[columns] - z[columns], self.high[columns] - z[columns]
        moved = np.clip(moved, *limits)
        machines = x + moved[:, : self.machine]
        starts = offsets + OFFSET_RAD * moved[:, self.machine :]
        stride = max(1, round(1 / RATE_HZ / model.log.interval_s))
        weight = np.sqrt(min(1.0, INDEPENDENT_HZ * stride * model.log.interval_s))
        rows = slice(model.known, None, stride)
        gap = (model.angles(machines, starts)[:, rows] - model.log.theta[rows]) / model.noise
        values = weight * gap.reshape(len(gap), -1)
        width = np.diag(moved[1 : 1 + count] - moved[1 + count :])
        return values[0], ((values[1 : 1 + count] - values[1 + count :]) / width[:, None]).T

    def bootstrap(self, z: Array, random: np.random.Generator) -> Array:
        """Standard deviation of the parameters, (P,)."""
        residuals, slopes = self._evaluate(z)
        data = len(residuals) - self.size
        per_block = max(1, round(BLOCK_S * INDEPENDENT_HZ * 2)) * self._joints
        block = np.arange(data) // per_block
        blocks = int(block[-1]) + 1
        soft = 1 / np.sqrt(1 + (residuals[:data] / SOFT_FROM) ** 2)  # ρ'
        gradient = np.zeros((blocks, self.size))
        np.add.at(gradient, block, slopes[:data] * (soft * residuals[:data])[:, None])
        hessian = slopes[:data].T @ (soft[:, None] * slopes[:data]) + np.eye(self.size)
        counts = random.multinomial(blocks, np.full(blocks, 1 / blocks), size=REPLICATES)
        priors = random.normal(size=(REPLICATES, self.size))
        pull = counts @ gradient + z - priors
        steps = np.linalg.solve(hessian, pull.T)[: self.machine]
        return np.asarray(np.std(steps, axis=1))
