"""How errors of inputs, start and constants affect the end of an open-loop plan.

First-order sensitivities S(t) = ∂q(t)/∂p follow Ṡ = A S + ∂f/∂p along the plan; see
`planner.systems.linearisation` for the parameters p. A machine is not smooth; its sensitivities are
paired differences: `planner.robustness.machine_sensitivity`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.plan.plan import Plan, refuse_inexecutable
from planner.support.arrays import Array, Frozen
from planner.support.calculus import runge_kutta
from planner.support.calculus.extremes import sample_times
from planner.support.compiled_calls import Pointwise
from planner.support.package import Figure, Table, draw_figure, import_function
from planner.support.tables import Column, number, terminal_table
from planner.systems.ball_gear import BallGear
from planner.systems.linearisation import linearise, parameters
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

PAPER_SPREAD: Mapping[str, float] = {"gain": 0.01, "start": float(np.deg2rad(0.5))}
"""Default spread for comparing plans: 1 % of input gains and 0.5° of every starting angle."""

MEANINGS = (
    "Passive block: response of the angles after joint 1 (of a vehicle: after its first angle) at"
    " the end, to errors of the start of joint 1 and of the gain of u2; it depends on the path."
    " Floor: the part that depends only on start and goal. Total: root of the sum of all squares."
)
"""Explanation of the terms in the tables."""

REFERENCE: Mapping[str, float] = {
    "gain": 0.01,
    "bias": 0.001,
    "delay": 0.01,
    "stretch": 0.01,
    "start": float(np.deg2rad(0.5)),
    "gear": 0.01,
}
"""A typical error of each family of parameters, in its unit, where no spread is given."""


@dataclass(frozen=True, eq=False)
class Sensitivity(Frozen):
    """First-order sensitivities of one plan's coordinates to errors of P parameters.

    Attributes:
        plan: The plan.
        t: Times (m,), seconds.
        along: S(t), shape (m, N, P): change of coordinate i per unit of parameter j.
        parameters: Names of the P parameters, in order.
        units: Units of the parameters ("1" for relative errors).
    """

    plan: Plan
    t: Array
    along: Array
    parameters: tuple[str, ...]
    units: tuple[str, ...]

    def __repr__(self) -> str:
        return (
            f"Sensitivity({self.plan.method} plan, {len(self.parameters)} parameters: at the end"
            f" {self.total_deg():.4g} deg, of it the floor {self.floor_deg():.4g} deg, passive"
            f" block {self.passive_block_deg():.4g} deg)"
        )

    @property
    def terminal(self) -> Array:
        """Sensitivities S(T) at the end of the plan, shape (N, P)."""
        return np.asarray(self.along[-1])

    def entry(self, coordinate: str, parameter: str) -> float:
        """Return the sensitivity S(T) of one coordinate at the end to one parameter.

        Raises:
            InputError: If a name is unknown; the message lists the known names.
        """
        names = [c.name for c in self.plan.problem.system.coordinates]
        for name, options in ((coordinate, names), (parameter, list(self.parameters))):
            if name not in options:
                raise InputError(f"unknown name '{name}'; known: {', '.join(options)}")
        row, column = names.index(coordinate), self.parameters.index(parameter)
        return float(self.terminal[row, column])

    def total_deg(self, spread: Mapping[str, float] = PAPER_SPREAD) -> float:
        """Return the root sum of squares of all joints' responses to all parameters, in degrees.

        Args:
            spread: Standard deviation of each parameter by its name, or of a family by its first
                word ("gain", "bias", "delay", "stretch", "start"; "gear" for the constants); 0 for
                parameters not named.
        """
        return self._rss(spread, np.ones_like(self.terminal, dtype=bool))

    def floor_deg(self, spread: Mapping[str, float] = PAPER_SPREAD) -> float:
        """Return the part of `total_deg`, in degrees, that depends only on start and goal."""
        return self._rss(spread, self.floor)

    def passive_block_deg(self, spread: Mapping[str, float] = PAPER_SPREAD) -> float:
        """Return the response of θ₂ … θₙ to the start of θ₁ and the gain of u₂, in degrees.

        This root sum of squares depends on the path, so desensitised plans are compared by it.
        """
        mask = np.zeros_like(self.terminal, dtype=bool)
        first = self.plan.problem.system.coordinates[1].name
        second = self.plan.problem.system.inputs[1].name
        for name in (f"start {first}", f"gain {second}"):
            mask[2:, self.parameters.index(name)] = True
        return self._rss(spread, mask)

    def reference(self, spread: Mapping[str, float] = PAPER_SPREAD) -> Array:
        """Return the error of each parameter, in its unit, for which responses are shown, (P,).

        This error is the standard deviation, or, if that is zero, the typical one in `REFERENCE`.
        """
        sigma = self.standard_deviation(spread)
        usual = [REFERENCE[p.family] for p in parameters(self.plan.problem.system)]
        return np.where(sigma > 0, sigma, usual)

    def contribution_deg(self, spread: Mapping[str, float] = PAPER_SPREAD) -> Array:
        """Return responses of angles at the end to each `reference`, shape (n, P), degrees."""
        return np.asarray(np.rad2deg(self.terminal[self.angles] * self.reference(spread)))

    @property
    def angles(self) -> list[int]:
        """Indices of the coordinates that are angles, without the first coordinate."""
        coordinates = self.plan.problem.system.coordinates
        return [i for i, c in enumerate(coordinates) if i and c.unit == "rad"]

    def along_deg(self, spread: Mapping[str, float] = PAPER_SPREAD) -> Array:
        """Return the standard deviation of each angle at the times `t`, shape (m, n), degrees."""
        response = self.along[:, self.angles] * self.standard_deviation(spread)
        return np.asarray(np.rad2deg(np.sqrt(np.sum(response**2, axis=-1))))

    def table(self, spread: Mapping[str, float] = PAPER_SPREAD) -> Table:
        """Return the responses to each `reference` as a table for `rich.print`; * is the floor.

        Errors without a response are left out. The sums are below the table.
        """
        coordinates = self.plan.problem.system.coordinates
        sizes, values = self.reference(spread), self.contribution_deg(spread)

        def cell(angle: int, p: int) -> str:
            value = float(values[angle, p])
            if abs(value) < 5e-7:
                return ""
            return f"{value:.3g}{'*' if self.floor[self.angles[angle], p] else ' '}"

        columns: list[Column[int]] = [
            Column("error", "", lambda p: self.parameters[p], left=True),
            Column("size", "", lambda p: size_of(float(sizes[p]), self.units[p])),
        ]
        angles = [
            Column(coordinates[i].name, "deg", partial(cell, k)) for k, i in enumerate(self.angles)
        ]
        loud = [p for p in range(len(sizes)) if any(angle.text(p) for angle in angles)]
        total, floor = self.total_deg(spread), self.floor_deg(spread)
        least = 100 * (1 - floor / total) if total else 0.0
        caption = (
            f"One standard deviation of each of {', '.join(spread)}: total {number(total, 4)} deg."
            f"\n* floor: {number(floor, 4)} deg."
            f"\nPassive block: {number(self.passive_block_deg(spread), 4)} deg.\n{MEANINGS}"
            f"\nAnother path reduces the total by at most {least:.0f} %."
        )
        return terminal_table([*columns, *angles], loud, caption=caption, ruled=True, gap=1)

    def plot(self, spread: Mapping[str, float] = PAPER_SPREAD) -> Figure:
        """Draw the responses with `planner.report.plot_sensitivity`."""
        return draw_figure("robustness.plot_sensitivity", self, spread)

    def save(self, folder: str | Path, spread: Mapping[str, float] = PAPER_SPREAD) -> Path:
        """Write data, matrix, plan and figures to a folder, all or nothing.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        save = import_function("planner.report.folders.save_sensitivity")
        return Path(save(self, None, spread, folder))

    def to_dict(self, spread: Mapping[str, float] = PAPER_SPREAD) -> dict[str, Any]:
        """Return JSON-ready data: matrix in SI units, responses to reference errors (deg), sums."""
        names = [c.name for c in self.plan.problem.system.coordinates]
        angles = [names[i] for i in self.angles]
        contribution = self.contribution_deg(spread)
        fixed = self.floor
        columns = [
            {
                "parameter": name,
                "unit": self.units[p],
                "standard_deviation": float(self.standard_deviation(spread)[p]),
                "reference": float(self.reference(spread)[p]),
                "response_deg": dict(zip(angles, contribution[:, p].tolist(), strict=True)),
                "floor": [names[i] for i in np.flatnonzero(fixed[:, p])],
            }
            for p, name in enumerate(self.parameters)
        ]
        even = np.linspace(0, self.plan.duration, 51)
        instants = [int(np.argmin(np.abs(self.t - t))) for t in even]
        along = self.along_deg(spread)[instants]
        return {
            "coordinates": names,
            "parameters": columns,
            "matrix": self.terminal.tolist(),
            "total_deg": self.total_deg(spread),
            "floor_deg": self.floor_deg(spread),
            "passive_block_deg": self.passive_block_deg(spread),
            "along": {
                "t_s": self.t[instants].tolist(),
                "standard_deviation_deg": dict(zip(angles, along.T.tolist(), strict=True)),
                "matrix": self.along[instants].tolist(),
            },
        }

    @property
    def floor(self) -> NDArray[np.bool_]:
        """Mask (N, P) of the entries of S(T) that depend only on start and goal.

        The rate of q₂, and of each θᵢ of the arms, does not depend on that coordinate itself, so an
        error of its start reaches the end unchanged. The gain of u₂ scales the travel of q₂. The
        constant of a joint scales its travel, as the gain of u₁ does for the first passive joint.
        """
        system, names = self.plan.problem.system, self.parameters
        mask = np.zeros_like(self.terminal, dtype=bool)
        mask[1, names.index(f"gain {system.inputs[1].name}")] = True
        mask[1, names.index(f"bias {system.inputs[1].name}")] = True
        first = names.index(f"start {system.coordinates[0].name}")
        mask[1, first + 1] = True
        if isinstance(system, Manipulator | BallGear):
            for i in range(2, system.size):
                mask[i, first + i] = True
                mask[i, names.index(f"K{i}")] = True
            mask[2, names.index(f"gain {system.inputs[0].name}")] = True
        return mask

    def standard_deviation(self, spread: Mapping[str, float]) -> Array:
        """Return the standard deviation of each parameter, shape (P,), in the parameters' units."""
        names = parameters(self.plan.problem.system)
        return np.array([spread.get(p.name, spread.get(p.family, 0.0)) for p in names])

    def _rss(self, spread: Mapping[str, float], mask: NDArray[np.bool_]) -> float:
        response = np.where(mask, self.terminal, 0.0)[self.angles] * self.standard_deviation(spread)
        return float(np.rad2deg(np.sqrt(np.sum(response**2))))


def sensitivity(plan: Plan, samples: int = 2000) -> Sensitivity:
    """Compute first-order sensitivities of an executable plan, along the motion and at its end.

    Args:
        plan: Any executable plan. A compensated plan has the sensitivity of the plan that it
            compensates, which is the one of the result.
        samples: Approximate number of integration steps; steps are shorter near breaks of the plan.

    Raises:
        InputError: If the plan cannot be executed.
    """
    refuse_inexecutable(plan)
    plan = plan.compensates or plan
    system = plan.problem.system
    known = parameters(system)
    names, units = tuple(p.name for p in known), tuple(p.unit for p in known)
    t = np.unique(sample_times(plan.t, samples))
    S = np.zeros((len(t), system.size, len(names)))
    first = names.index(f"start {system.coordinates[0].name}")
    S[0, :, first : first + system.size] = np.eye(system.size)
    ends = np.where(np.isin(t[1:], plan.t[1:-1]), np.nextafter(t[1:], 0.0), t[1:])
    places = (t[:-1], (t[:-1] + t[1:]) / 2, ends)
    both = [_derivatives(system)(plan.q(at), plan.u(at), at[:, None]) for at in places]
    A, B = ([each[..., part] for each in both] for part in np.s_[: system.size, system.size :])
    for k, h in enumerate(np.diff(t)):
        S[k + 1] = runge_kutta.step(lambda S, j, k=k: A[j][k] @ S + B[j][k], S[k], h)  # type: ignore[misc]
    return Sensitivity(plan, t, S, names, units)


@lru_cache(maxsize=32)
def _derivatives(system: TriangularSystem) -> Pointwise:
    """Return the function (q, u, t) → [∂f/∂q, ∂f/∂p], parameters p in the order of `parameters`."""
    form = linearise(system)
    value = ca.horzcat(form.A, *(form.forcing[p.name] for p in parameters(system)))
    return Pointwise("derivatives", [form.q, form.u, form.t], value)


def size_of(value: float, unit: str) -> str:
    """Return an error's size as text with its unit: fractions in percent, angles in degrees."""
    if unit == "1":
        return f"{100 * value:.3g} %"
    if unit == "rad":
        return f"{np.rad2deg(value):.3g} deg"
    return f"{value:.3g} {unit}"
