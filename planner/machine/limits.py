"""Limits that machines break although the plan keeps them: joints, obstacles, other links, z₂.

A verified plan may touch an obstacle without clearance; every machine that deviates then hits it.
A limit of chained coordinates is judged too, but breaks nothing (`Demand.physical`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, product, repeat

import numpy as np
from numpy.typing import NDArray

from planner.problem.problem import Problem
from planner.problem.requirements.motion_limits import JointLimit
from planner.problem.requirements.places import Obstacle
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.problem.requirements.self_collision import SelfCollision
from planner.support.arrays import Array

BLOCK_STATES = 20_000
"""Number of states judged at once, so few that their distances stay in the cache."""

KEPT_PERCENT = 95.0
"""Percentage of the machines for which the advised clearance is enough."""


@dataclass(frozen=True)
class MachineLimit:
    """How S machines keep one limit.

    Attributes:
        requirement: The requirement that the limit is a part of.
        part: Label, unit, least and largest value of the limit.
        broken: Number of machines that break the limit.
        samples: Number of machines S.
        worst: The value furthest beyond the limit, or else nearest to it, in the part's unit.
        sample: Number of the machine with the worst value.
        t_s: Time of the worst value, s.
        sweep: 95th percentile over the machines of how much closer a machine comes to the limit
            than the plan, in the part's unit; a preparatory motion of feedback counts too.
    """

    requirement: Requirement
    part: Part
    broken: int
    samples: int
    worst: float
    sample: int
    t_s: float
    sweep: float

    def __str__(self) -> str:
        angle = self.part.unit == "rad"
        scale, unit = (180 / np.pi, "deg") if angle else (1.0, self.part.unit)
        most = self.part.high if np.isfinite(self.part.high) else self.part.low
        value, allowed = (f"{scale * x:.3g} {unit}".rstrip() for x in (self.worst, most))
        return (
            f"{self.part.label} {value} at worst, allowed {allowed} (at {self.t_s:.3g} s on machine"
            f" {self.sample}), broken by {self.broken}"
        )


def breakable_limits(problem: Problem) -> list[Requirement]:
    """Return the requirements that a machine may break: those on the coordinates along the path."""
    return [each for each in problem.requirements if each.reads == {"q"}]


def bounds(requirement: Requirement) -> tuple[Array, Array]:
    """Return the least and the largest values that a requirement allows to a machine, (R,) each.

    The clearance is left out, since it is room for machines to deviate: a machine that enters it
    without contact breaks no limit.
    """
    low, high, _ = requirement.bounds
    return low - getattr(requirement, "clearance", 0.0), high


def parts_of(problem: Problem) -> Iterator[tuple[Requirement, Part, float, float]]:
    """Yield the P parts of the limits that machines may break, each with its requirement and with
    the least and the largest value for a machine."""
    for requirement in breakable_limits(problem):
        yield from zip(repeat(requirement), requirement.parts, *bounds(requirement), strict=False)


def lower_margins(least: Array, when: Array, problem: Problem, q: Array, times: Array) -> None:
    """Update the least distances of S motions from the P parts of a problem's limits, in place.

    Args:
        least: Least distances so far, negative beyond a limit, (S, P), in the parts' units.
        when: Times of the least distances, (S, P), s.
        problem: The problem, for its limits.
        q: Coordinates, (S, R, N).
        times: Times of q, (R,), s.
    """
    limits = breakable_limits(problem)
    block = max(1, BLOCK_STATES // max(1, len(times)))
    blocks = product(range(0, len(q), block), range(0, len(times), BLOCK_STATES))
    for first, row in blocks if limits else ():
        some, part = slice(first, first + block), slice(row, row + BLOCK_STATES)
        point, parts = MotionPoint.of(problem.system, q[some, part]), count()
        for each in limits:
            low, high = bounds(each)
            for value, smallest, largest in zip(each.values(point), low, high, strict=True):
                margin = np.minimum(value - smallest, largest - value)
                place, k = np.argmin(margin, axis=1), next(parts)
                margin = np.take_along_axis(margin, place[:, None], 1)[:, 0]
                new = margin < least[some, k]
                least[some, k] = np.where(new, margin, least[some, k])
                when[some, k] = np.where(new, times[part][place], when[some, k])


def machine_limits(
    problem: Problem, planned: Array, margins: Array, times: Array, numbers: NDArray[np.int64]
) -> tuple[MachineLimit, ...]:
    """Summarise for each limit how S machines keep it.

    Args:
        problem: The problem, for its limits of P parts.
        planned: Least distances of the plan from each part, (P,).
        margins: Least distances of the machines, (S, P), NaN where they were not measured.
        times: Times of the least distances, (S, P), s.
        numbers: The machines' numbers, (S,).
    """
    out = []
    for k, (requirement, part, low, high) in enumerate(parts_of(problem)):
        distances = margins[:, k]
        if np.isnan(distances).any():
            continue
        worst = int(np.argmin(distances))
        value = high - distances[worst] if np.isfinite(high) else low + distances[worst]
        broken, sweep = np.sum(distances < 0), np.percentile(planned[k] - distances, KEPT_PERCENT)
        found = float(value), int(numbers[worst]), float(times[worst, k]), float(sweep)
        out.append(MachineLimit(requirement, part, int(broken), len(distances), *found))
    return tuple(out)


def limit_words(limits: Sequence[MachineLimit], machines: int) -> str:
    """Say which limits machines break and what would keep 95 % of the machines clear, or "".

    Args:
        limits: Result of `machine_limits`, either physical limits or those of chained coordinates.
        machines: Number of machines that break at least one of them.
    """
    violations = sorted((each for each in limits if each.broken), key=lambda each: -each.broken)
    if not violations:
        return ""
    first = violations[0]
    count = f"{machines} of {first.samples} machine{'s' if first.samples > 1 else ''}"
    more = f", and {len(violations) - 1} more limits" if len(violations) > 1 else ""
    if not first.requirement.physical:
        return f"{count} break a limit of chained coordinates, which harms nothing: {first}{more}"
    worst = {each.requirement: each for each in sorted(violations, key=lambda each: each.sweep)}
    furthest = [worst[kind] for kind in dict.fromkeys(each.requirement for each in violations)]
    ways = dict.fromkeys(filter(None, map(_advice, furthest)))
    keeps = f"; {KEPT_PERCENT:.0f} % of the machines keep clear with about {' and '.join(ways)}"
    if not ways or machines <= first.samples * (1 - KEPT_PERCENT / 100):  # as many do already
        keeps = ""
    return f"{count} break a limit: {first}{more}{keeps}"


def _advice(each: MachineLimit) -> str:
    """Return the setting that would keep 95 % of machines clear of a limit, in words, or ""."""
    requirement = each.requirement
    if each.t_s < 0:  # the settings below are for the plan, not for the motion before it
        return ""
    if isinstance(requirement, Obstacle):
        return f"clearance_m = {_round_up(each.sweep)} of obstacle {requirement.number}"
    if isinstance(requirement, SelfCollision):
        return f"limits.{requirement.key} = {_round_up(each.sweep)}"
    if isinstance(requirement, JointLimit) and each.part.key.endswith("_deg"):
        most = np.rad2deg(each.part.high - each.sweep)
        return f"{each.part.key} = {np.floor(most):g} for {requirement.limit_name(each.part)}"
    return ""


def _round_up(value: float) -> str:
    """Return a positive value rounded up to two digits, as text."""
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / step - 1e-9) * step:.2g}"
