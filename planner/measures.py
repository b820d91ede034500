"""Figures of a trajectory that every method is compared by: effort and peak inputs."""

from __future__ import annotations

import numpy as np

from planner.extrema import maximum, sample_times
from planner.systems.base import Array
from planner.trajectory import Trajectory

_GAUSS = np.polynomial.legendre.leggauss(4)


def effort(trajectory: Trajectory) -> float:
    """∫ u₁² + u₂² dt, by Gauss quadrature between samples that crowd towards the ends of pieces."""
    times, weights = _quadrature(trajectory)
    return float(np.sum(weights[..., None] * trajectory.u(times) ** 2))


def beyond(trajectory: Trajectory, limit: Array) -> Array:
    """Part of each input's travel ∫|u| dt that lies above a limit (2,) of |u|, 0 ... 1, (2,)."""
    times, weights = _quadrature(trajectory)
    speed = np.abs(trajectory.u(times))
    above = np.maximum(speed - limit, 0.0)
    travel, lost = (np.einsum("ij,ijk->k", weights, rate) for rate in (speed, above))
    return np.asarray(np.divide(lost, travel, out=np.zeros(2), where=travel > 0))


def _quadrature(trajectory: Trajectory) -> tuple[Array, Array]:
    """Times and weights of Gauss quadrature between samples that crowd at the ends of pieces."""
    edges = np.unique(np.concatenate([sample_times(trajectory.breaks, 1000), trajectory.breaks]))
    nodes, weights = _GAUSS
    half = np.diff(edges)[:, None] / 2
    return edges[:-1, None] + half * (1 + nodes), half * weights


def peak_inputs(trajectory: Trajectory) -> Array:
    """Largest |u₁| and |u₂| over all time, shape (2,); NaN where an input is undefined."""
    times = sample_times(trajectory.breaks)
    if np.any(np.isnan(trajectory.u(times))):
        return np.full(2, np.nan)
    return np.array([_peak(trajectory, times, i)[0] for i in range(2)])


def peak_rates(trajectory: Trajectory) -> Array:
    """Largest |du₁/dt| and |du₂/dt|, shape (2,); infinite where an input jumps inside the motion.

    Slopes are central differences between neighbouring samples of each smooth piece, which crowd
    towards its ends.
    """
    breaks = trajectory.breaks
    before = trajectory.u(np.nextafter(breaks[1:-1], 0.0))
    after = trajectory.u(breaks[1:-1])
    peaks = peak_inputs(trajectory)
    jumps = np.any(np.abs(after - before) > 1e-7 * np.maximum(peaks, 1e-12), axis=0)
    samples = sample_times(breaks).reshape(len(breaks) - 1, -1)
    gaps, width = np.diff(samples, axis=1), np.diff(breaks)[:, None]
    step = np.maximum(0.25 * gaps, 1e-6 * width)
    middle = np.clip(
        samples[:, :-1] + gaps / 2, breaks[:-1, None] + step, breaks[1:, None] - 1.001 * step
    )
    rise = trajectory.u(middle + step) - trajectory.u(middle - step)
    slopes = np.abs(rise) / (2 * step)[..., None]
    return np.where(jumps, np.inf, np.max(slopes, axis=(0, 1)))


def _peak(trajectory: Trajectory, times: Array, i: int) -> tuple[float, float]:
    return maximum(lambda t: np.abs(trajectory.u(t)[..., i]), times)
