"""Where a trajectory lies in the chart's domain: margins, exits and crossings over all time.

The paper tests z₂ < 0 only. The inverse exists exactly where every cos²θᵢ that the inverse asks for
lies in (0, 1]; it is smooth where every one lies in (0, 1). `domain_report` tests all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.extrema import maximum, minimum, sample_times, zeros
from planner.systems.base import Array
from planner.trajectory import ChainedTrajectory, Trajectory, polynomial_range, polynomial_roots


@dataclass(frozen=True)
class DomainReport:
    """What `domain_report` finds.

    Attributes:
        ok: Whether the trajectory stays strictly inside the chart's domain at all times.
        margin: Least signed margin (cos²θ or 1 − cos²θ, dimensionless); negative outside.
        time_s: When it is least, in seconds.
        label: Which margin that is.
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

    @property
    def singular_times_s(self) -> tuple[float, ...]:
        """All times at which the chart is singular or left, increasing; none when `ok`."""
        if self.ok:  # z2 = 0 is singular for the paper's arm of three joints, not for every system
            return ()
        times = sorted((*self.exits_s, *self.z2_crossings_s))
        return tuple(t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > 1e-9)


def worst_margin(margins: Array) -> Array:
    """Least margin over the last axis; undefined (NaN) ones follow from others and are skipped."""
    return np.asarray(np.min(np.where(np.isnan(margins), np.inf, margins), axis=-1))


def domain_report(trajectory: Trajectory) -> DomainReport:
    """Examine a trajectory over all time: polynomial roots for z₂, root-finding on the margins."""
    times = sample_times(trajectory.breaks)

    def worst(t: Array) -> Array:
        return worst_margin(trajectory.margins(t))

    margin, when = minimum(worst, times)
    row = trajectory.margins(when)
    index = int(np.argmin(np.where(np.isnan(row), np.inf, row)))
    crossings, low, high = _z2(trajectory, times)
    return DomainReport(
        ok=margin > 0,
        margin=margin,
        time_s=when,
        label=trajectory.system.margin_labels[index][1],
        exits_s=tuple(zeros(worst, times)),
        z2_crossings_s=tuple(crossings),
        z2_max=high,
        z2_min=low,
    )


def _z2(trajectory: Trajectory, times: Array) -> tuple[list[float], float, float]:
    if isinstance(trajectory, ChainedTrajectory):
        return polynomial_roots(trajectory.z_curve, 1), *polynomial_range(trajectory.z_curve, 1)

    def z2(t: Array) -> Array:
        return np.asarray(trajectory.z(t)[..., 1])

    return zeros(z2, times), minimum(z2, times)[0], maximum(z2, times)[0]
