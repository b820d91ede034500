"""Figures of a trajectory that every method is compared by: effort and peak inputs."""

from __future__ import annotations

import numpy as np

from planner.extrema import sample_times
from planner.quadrature import jumps, largest, read, slopes
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
    reading = read(trajectory)
    return largest(reading.cells, reading.u)


def peak_rates(trajectory: Trajectory) -> Array:
    """Largest |du₁/dt| and |du₂/dt|, shape (2,); infinite where an input jumps on the way."""
    reading = read(trajectory)
    peaks = largest(reading.cells, slopes(reading.cells, reading.u))
    return np.where(jumps(reading.cells, reading.u), np.inf, peaks)
