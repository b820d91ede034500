"""Quantities by which methods are compared: effort, peak inputs, turns, margins of the chart.

`domain_report` finds where a trajectory lies in the chart's domain: margins, exits and crossings.

The paper tests z₂ < 0 only. The inverse exists exactly where every cos²θᵢ that it needs lies in
(0, 1], and is smooth where every one lies in (0, 1). `domain_report` tests all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from planner.errors import InputError
from planner.plan.quadrature import (
    POINTS,
    greatest,
    input_values,
    jumps,
    largest,
    read_trajectory,
    slopes,
)
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import ChainedTrajectory, Trajectory
from planner.problem.requirements.requirement import MotionPoint, Requirement
from planner.support.arrays import Array, Frozen, locked
from planner.support.calculus.chebyshev import apply, integration
from planner.support.calculus.extremes import maximum, minimum, sample_times, zeros
from planner.systems.chained_form import chained_form
from planner.systems.triangular_system import TriangularSystem

EFFORT = "integral of u1^2 + u2^2 dt"

EDGE_MARGIN = 0.05
"""Margin (for the manipulator, sin² of an angle) at which the closeness to an edge is 1/e."""

INTEGRALS = 6
"""Number of integrals that collocation minimises; see `Term.share`."""

_GAUSS = np.polynomial.legendre.leggauss(4)


def effort(trajectory: Trajectory) -> float:
    """Return ∫ u₁² + u₂² dt, by Gauss quadrature that is finer near the ends of pieces."""
    return float(np.sum(_efforts(trajectory)))


def _efforts(trajectory: Trajectory) -> Array:
    """Return ∫ uᵢ² dt of both inputs, shape (2,)."""
    times, weights = _quadrature(trajectory)
    return np.asarray(np.einsum("ij,ijk->k", weights, trajectory.u(times) ** 2))


def path_coordinates(system: TriangularSystem) -> tuple[list[int], str]:
    """Return indices of the user coordinates along which paths are measured, and their unit.

    These are the coordinates in metres, such as a vehicle's position, or else the angles except the
    path coordinate, such as an arm's joints.
    """
    user, first = system.user_coordinates, system.coordinates[0].name
    places = [i for i, c in enumerate(user) if c.unit == "m"]
    angles = [i for i, c in enumerate(user) if c.unit == "rad" and c.name != first]
    return (places, "m") if places else (angles, "rad")


def path_length(trajectory: Trajectory) -> float:
    """Return the length of the path in the coordinates of `path_coordinates`, from a polygon with
    about 5000 corners; NaN without such coordinates."""
    q = trajectory.q(sample_times(trajectory.breaks, 5000))
    return float(polygon_lengths(trajectory.system, q[None])[0])


def polygon_lengths(system: TriangularSystem, q: Array) -> Array:
    """Return the lengths of S paths, (S,), whose corners q are (S, R, N), as `path_length` does."""
    which, _ = path_coordinates(system)
    steps = np.diff(system.user(q)[..., which], axis=1)
    return np.sum(np.linalg.norm(steps, axis=-1), axis=1) if which else np.full(len(q), np.nan)


def smoothness(trajectory: Trajectory) -> float:
    """Return ∫ (du₁/dt)² + (du₂/dt)² dt; infinite where an input jumps."""
    reading = read_trajectory(trajectory)
    squares = np.sum(slopes(reading.cells, reading.u) ** 2, axis=-1)
    total = float(np.sum(apply(integration(POINTS)[-1:], squares) * reading.cells.width))
    return np.inf if np.any(jumps(reading.u)) else total


def closeness(trajectory: Trajectory) -> float:
    """Return the mean over time of Σ exp(−|margin|/EDGE_MARGIN) over the margins of the chart's
    domain."""
    times, weights = _quadrature(trajectory)
    margins = trajectory.system.chart_margins(trajectory.q(times), np.ones(trajectory.system.size))
    near = np.sum(np.exp(-np.abs(margins) / EDGE_MARGIN), axis=-1)
    return float(np.sum(weights * near)) / trajectory.duration


def effort_unit(system: TriangularSystem) -> str:
    """Return the unit of ∫ u₁² + u₂² dt: squared input times seconds; a sum if the inputs' units
    differ.

    >>> from planner.systems.manipulator import Manipulator
    >>> effort_unit(Manipulator([1.0]))
    'rad²/s'
    """
    rates = [c.unit for c in system.inputs]
    squares = [f"{r[:-2]}²/s" if r.endswith("/s") else f"{r}² s" if r else "s" for r in rates]
    return " + ".join(dict.fromkeys(squares))


def excess_share(trajectory: Trajectory, limit: Array) -> Array:
    """Return the share of each input's travel ∫|u| dt above the input's limit, shape (2,), 0 … 1.

    The share is ∫ max(|u| − limit, 0) dt / ∫ |u| dt; zero for an input that is always zero.
    """
    times, weights = _quadrature(trajectory)
    speed = np.abs(trajectory.u(times))
    above = np.maximum(speed - limit, 0.0)
    travel, lost = (np.einsum("ij,ijk->k", weights, rate) for rate in (speed, above))
    return np.asarray(np.divide(lost, travel, out=np.zeros(2), where=travel > 0))


def _quadrature(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return times and weights (M, 4) of Gauss quadrature that is finer near the ends of pieces."""
    edges = np.unique(np.concatenate([sample_times(trajectory.breaks, 1000), trajectory.breaks]))
    nodes, weights = _GAUSS
    half = np.diff(edges)[:, None] / 2
    return edges[:-1, None] + half * (1 + nodes), half * weights


def chart_smoothness(trajectory: Trajectory) -> float:
    """Return half the integral of (dz₂/dz₁)² over |z₁| of a path in the chart, before retiming; NaN
    for another path."""
    if (path := _chart_path(trajectory)) is None:
        return np.nan
    times, weights = _quadrature(path)
    v1, v2 = np.moveaxis(path.v(times), -1, 0)
    return float(np.sum(weights * v2**2 / np.abs(v1))) / 2


def chart_peak(trajectory: Trajectory) -> float:
    """Return the peak |v₂| for a constant v₁ of a path in the chart; NaN for another path."""
    if (path := _chart_path(trajectory)) is None:
        return np.nan
    highest = float(np.max(np.abs(path.v_curve.c[..., 1])))  # v₂ is linear on each piece at most
    return highest * path.duration / trajectory.duration


def _chart_path(trajectory: Trajectory) -> ChainedTrajectory | None:
    while isinstance(trajectory, RetimedTrajectory):
        trajectory = trajectory.path
    return trajectory if isinstance(trajectory, ChainedTrajectory) else None


@dataclass(frozen=True, eq=False)
class Objective(Frozen):
    """What a plan minimises: a sum of named terms.

    Attributes:
        kind: First word of its name, such as "effort"; without terms the whole name.
        terms: Exact weight of each term: a key of `TERMS`, or a term in words that only the method
            can compute.
    """

    kind: str = ""
    terms: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The objective in words; weights are rounded to six digits."""
        named = [(TERMS[k].words if k in TERMS else k, w) for k, w in self.terms.items()]
        parts = [words if weight == 1 else f"{weight:g} x {words}" for words, weight in named]
        return f"{self.kind}: {' + '.join(parts)}" if parts else self.kind

    def value(self, trajectory: Trajectory) -> float | None:
        """Return the objective of a motion; None if the motion alone does not determine it."""
        if not self.terms or not self.terms.keys() <= TERMS.keys():
            return None
        with np.errstate(all="ignore"):  # an edited file may contain any motion
            value = sum(weight * TERMS[key].value(trajectory) for key, weight in self.terms.items())
        return None if np.isnan(value) else float(value)

    @cached_property
    def weights(self) -> Array:
        """Weights of the integrals that collocation minimises, shape (6,); see `Term.share`.

        Raises:
            InputError: If collocation has no integral for a term of `TERMS`.
        """
        out = np.zeros(INTEGRALS)
        for key in filter(TERMS.__contains__, self.terms):  # a method computes its own terms
            if not TERMS[key].share:
                raise InputError(f"collocation has no integral for the term '{key}'")
            out[: len(TERMS[key].share)] += self.terms[key] * np.array(TERMS[key].share)
        return locked(out)


@dataclass(frozen=True)
class Term:
    """A term of an objective.

    Attributes:
        words: What it is, in the objective's name.
        value: Returns its value for a motion.
        share: Its share in each integral that collocation minimises: the duration, each ∫uᵢ² dt,
            each ∫(duᵢ/dt)² dt, and the closeness to the domain's edge; what is left out at its end
            is zero. Empty if collocation does not minimise it.
    """

    words: str
    value: Callable[[Trajectory], float]
    share: Sequence[float] = ()


TERMS: dict[str, Term] = {
    "duration": Term("duration", lambda trajectory: trajectory.duration, (1,)),
    "effort": Term(EFFORT, effort, (0, 1, 1)),
    "effort u1": Term("integral of u1^2 dt", lambda curve: _efforts(curve)[0], (0, 1)),
    "effort u2": Term("integral of u2^2 dt", lambda curve: _efforts(curve)[1], (0, 0, 1)),
    "effort, not minimised": Term(f"{EFFORT} (not minimised by this method)", effort),
    "smoothness": Term("integral of (du1/dt)^2 + (du2/dt)^2 dt", smoothness, (0, 0, 0, 1, 1)),
    "closeness": Term("mean closeness to the domain's edge", closeness, (0, 0, 0, 0, 0, 1)),
    "least duration": Term("the least for this path, in seconds", lambda curve: curve.duration),
    "slowed duration": Term(
        "the least within input limits, slowed as a whole for other limits, in seconds",
        lambda trajectory: trajectory.duration,
    ),
    "chart smoothness": Term("half the integral of (dz2/dz1)^2 over |z1|", chart_smoothness),
    "chart peak": Term("|v2| with v1 constant", chart_peak),
}
"""The terms of objectives, by their names in plan files."""


def peak_inputs(trajectory: Trajectory) -> Array:
    """Return the largest |u₁| and |u₂| over all time, shape (2,); NaN where an input is
    undefined."""
    reading = read_trajectory(trajectory)
    return largest(reading.cells, reading.u)


REST_SHARE = 1e-6
"""Largest |u| that counts as rest, relative to the input's peak."""


def moving_inputs(trajectory: Trajectory, time: float) -> list[str]:
    """Return a text such as "|u1| = 0.5 rad/s" for each input that is not zero at a time.

    An undefined input (NaN) counts as not zero.
    """
    u, peaks = np.abs(trajectory.u(time)), np.maximum(peak_inputs(trajectory), 1e-12)
    return [
        f"|{each.name}| = {u[i]:.4g} {each.unit}"
        for i, each in enumerate(trajectory.system.inputs)
        if not u[i] <= REST_SHARE * peaks[i]
    ]


def peak_rates(trajectory: Trajectory) -> Array:
    """Return the largest |du₁/dt| and |du₂/dt|, shape (2,); infinite where an input jumps."""
    reading = read_trajectory(trajectory)
    peaks = largest(reading.cells, slopes(reading.cells, reading.u))
    return np.where(jumps(reading.u), np.inf, peaks)


LEAST_TURN = 0.02
"""Least reversal of the path coordinate that counts as a turn, as a share of its range."""


def turns(trajectory: Trajectory) -> Array:
    """Return the times (m,), s, at which q₁ turns back by more than `LEAST_TURN` of its range."""
    t = np.linspace(0.0, trajectory.duration, 2001)
    way = trajectory.q(t)[:, 0]
    least, out, heading, far = LEAST_TURN * float(np.ptp(way)), [], 0.0, 0
    for k, value in enumerate(way):
        ahead = value - way[far]
        if heading and ahead * heading >= 0:
            far = k
        elif abs(ahead) > least:
            out += [t[far]] if heading else []
            heading, far = float(np.sign(ahead)), k
    return np.array(out)


def slowing_factor(requirements: Sequence[Requirement], trajectory: Trajectory) -> float:
    """Return the factor on a motion's time with which the motion just meets the limits on speed.

    The factor is below 1 if the motion could be faster, infinite if an input with limited rate
    jumps, NaN if a limited value is undefined. A driftless system's path does not depend on timing:
    inputs scale with 1/T, their rates with 1/T².
    """
    speed_limits = [requirement for requirement in requirements if requirement.speed_power]
    formulas = [requirement for requirement in speed_limits if not requirement.is_direct]
    system, factors = trajectory.system, [0.0]

    def row_values(q: Array, u: Array) -> Array:
        point = MotionPoint.of(system, q, u, np.zeros_like(u))
        return np.stack([v for r in formulas for v in r.values(point)], axis=-1)

    reading = read_trajectory(trajectory, input_values, *[row_values] * bool(formulas))
    cells = reading.cells
    point = MotionPoint.of(system, reading.q, reading.u, slopes(cells, reading.u))
    for requirement in speed_limits:
        values = np.stack(requirement.values(point), axis=-1)
        top, _ = greatest(cells, np.concatenate([values, -values], axis=-1))
        most, below = np.split(top, 2)
        slower_by = requirement.slowing_factor(-below, most)
        jumping = jumps(reading.u) if "du" in requirement.reads else np.zeros(2, bool)
        indices = [part.index for part in requirement.parts] if requirement.is_direct else [0, 1]
        factors.append(np.inf if any(jumping[indices]) else float(np.max(slower_by)))
    return float(np.max(factors))


@dataclass(frozen=True, repr=False)
class DomainReport:
    """Result of `domain_report`.

    Attributes:
        ok: Whether the trajectory stays strictly inside the chart's domain at all times.
        margin: Least margin (cos²θ or 1 − cos²θ, dimensionless); negative outside the domain.
        time_s: Time of the least margin, in seconds.
        label: Name of the least margin.
        exits_s: Times at which the trajectory leaves or re-enters the domain, in seconds.
        z2_crossings_s: Times at which z₂ = 0, in seconds.
        z2_max: Greatest z₂ over all time.
        z2_min: Least z₂ over all time.
    """

    ok: bool
    margin: float
    time_s: float
    label: str
    exits_s: tuple[float, ...]
    z2_crossings_s: tuple[float, ...]
    z2_max: float
    z2_min: float

    def __repr__(self) -> str:
        where = "inside the chart" if self.ok else f"leaves the chart {len(self.exits_s)} times"
        return (
            f"DomainReport({where}: least margin {self.margin:.3g} ({self.label}) at"
            f" t = {self.time_s:.4g} s, z2 from {self.z2_min:.3g} to {self.z2_max:.3g})"
        )

    @property
    def singular_times_s(self) -> tuple[float, ...]:
        """Increasing times at which the chart is singular or left, s; empty if `ok`."""
        if self.ok:  # z2 = 0 is singular for the paper's three-joint arm, not for every system
            return ()
        times = sorted((*self.exits_s, *self.z2_crossings_s))
        return tuple(t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > 1e-9)


def worst_margin(margins: Array) -> Array:
    """Return the least margin over the last axis, ignoring NaN (another is then negative)."""
    return np.asarray(np.min(np.where(np.isnan(margins), np.inf, margins), axis=-1))


def domain_report(trajectory: Trajectory) -> DomainReport:
    """Return margins, exits and crossings of a trajectory in the chart's domain, over all time.

    If the path stays inside, the extremes of the margins and z₂ are those of their Chebyshev
    series. A path that leaves the domain has no coordinates outside; then margins and z₂ come from
    the trajectory's z(t), and sampling and root-finding give the extremes and exits.
    """
    if isinstance(trajectory, RetimedTrajectory):
        path = domain_report(trajectory.path)
        if path.ok:
            crossings = tuple(trajectory.time_of(np.array(path.z2_crossings_s)).tolist())
            time_s = float(trajectory.time_of(path.time_s))
            return replace(path, time_s=time_s, z2_crossings_s=crossings)
    return _report_inside(trajectory) or _report_outside(trajectory)


def _report_inside(trajectory: Trajectory) -> DomainReport | None:
    """Return the report of a path that stays strictly inside the domain; None for other paths."""
    system, form = trajectory.system, chained_form(trajectory.system)
    with np.errstate(all="ignore"):
        branch = system.branch(trajectory.q(0.0))

        def watched(q: Array, _: Array) -> Array:
            return np.concatenate([-system.chart_margins(q, branch), form.z(q)[..., 1:2]], axis=-1)

        reading = read_trajectory(trajectory, watched)
        values = watched(reading.q, reading.u)
        tops, times = greatest(reading.cells, np.concatenate([values, -values[..., -1:]], axis=-1))
    if not np.all(tops[:-2] < 0):
        return None
    worst = int(np.argmax(tops[:-2]))
    high, low = float(tops[-2]), -float(tops[-1])
    crossings = zeros(_z2(trajectory), sample_times(trajectory.breaks)) if low <= 0 <= high else []
    return DomainReport(
        ok=True,
        margin=-float(tops[worst]),
        time_s=float(times[worst]),
        label=system.margin_labels[worst][1],
        exits_s=(),
        z2_crossings_s=tuple(crossings),
        z2_max=high,
        z2_min=low,
    )


def _report_outside(trajectory: Trajectory) -> DomainReport:
    times = sample_times(trajectory.breaks)

    def worst(t: Array) -> Array:
        return worst_margin(trajectory.margins(t))

    margin, when = minimum(worst, times)
    row = trajectory.margins(when)
    index = int(np.argmin(np.where(np.isnan(row), np.inf, row)))
    z2 = _z2(trajectory)
    return DomainReport(
        ok=margin > 0,
        margin=margin,
        time_s=when,
        label=trajectory.system.margin_labels[index][1],
        exits_s=tuple(zeros(worst, times)),
        z2_crossings_s=tuple(zeros(z2, times)),
        z2_max=maximum(z2, times)[0],
        z2_min=minimum(z2, times)[0],
    )


def _z2(trajectory: Trajectory) -> Callable[[Array], Array]:
    return lambda t: np.asarray(trajectory.z(t)[..., 1])
