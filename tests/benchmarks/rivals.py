"""What anybody would write by hand for the same problems: a page of CasADi, nothing of `planner`.

The manipulator's equations stand here once more. All expand the whole problem into one graph of
scalars, as one does for speed, and start from the same straight line. Each maker returns a call
that solves once from scratch and gives the duration's equal pieces with their inputs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

K_INTERVALS, DEGREE = 40, 3
TOLERANCE = 1e-9


@dataclass
class Outcome:
    """One solve: seconds, objective (NaN: failed), iterations, and the inputs.

    Inputs, shape (K, m, 2), are values at m shares of each piece, between which a polynomial runs.
    Shares are equal from 0 to 1, and pieces equally long, where they are left out.
    """

    seconds: float
    objective: float
    iterations: int
    inputs: Any = None
    shares: Any = None
    edges: Any = None


@dataclass
class Arm:
    """A problem in plain numbers (radians, seconds)."""

    K: list[float]
    k_g: float
    start: Any
    goal: Any
    duration: float
    input_limit: float
    joint_limit: float
    z2: float | None  # z2 <= -z2

    @property
    def size(self) -> int:
        return len(self.start)

    def rates(self, q: Any, u: Any) -> Any:
        """Equation (6)."""
        return ca.vertcat(*self.rate_list(q, u, ca.cos))

    def rate_list(self, q: Any, u: Any, cos: Callable[[Any], Any]) -> list[Any]:
        """The same by any algebra's cosine."""
        n = len(self.K) + 1
        c = [cos(q[i]) for i in range(1, n + 1)]
        out = [self.k_g * _product(c[: n - 2]) * u[0], u[1]]
        gears = [self.k_g * K for K in self.K]
        passive = [gears[j] * c[j] ** 3 * _product(c[:j]) * u[0] for j in range(n - 1)]
        return [*out, *passive]

    def z2_of(self, q: Any, algebra: Any = ca) -> Any:
        """Chained coordinate z2 of three joints, by hand."""
        cos, sin = algebra.cos, algebra.sin
        return -3 * self.K[0] * self.K[1] * cos(q[1]) ** 2 * cos(q[2]) ** 2 * sin(q[2])

    def guess(self, s: float) -> Any:
        """The straight line that `planner` starts from too, and its slope."""
        bulge = np.zeros(self.size)
        move = self.goal - self.start
        bulge[1] = 0.1
        q = self.start + s * move + bulge * np.sin(np.pi * s)
        slope = move + bulge * np.pi * np.cos(np.pi * s)
        drive = max(0.05, self.k_g * np.prod(np.cos(q[1 : self.size - 2])))
        return q, np.array([slope[0] / drive, slope[1]]) / self.duration


class _Sheet:
    """Unknowns and rows as they are written down."""

    def __init__(self) -> None:
        self.w: list[Any] = []
        self.lower: list[Any] = []
        self.upper: list[Any] = []
        self.first: list[Any] = []
        self.g: list[Any] = []
        self.low: list[float] = []
        self.high: list[float] = []
        self.equality: list[bool] = []

    def unknown(self, size: int, low: Any, high: Any, guess: Any) -> Any:
        x = ca.SX.sym(f"w{len(self.w)}", size)
        self.w.append(x)
        self.lower.append(np.broadcast_to(low, size))
        self.upper.append(np.broadcast_to(high, size))
        self.first.append(np.asarray(guess))
        return x

    def row(self, g: Any, low: float, high: float) -> None:
        self.g.append(g)
        self.low += [low] * g.numel()
        self.high += [high] * g.numel()
        self.equality += [low == high] * g.numel()

    def solver(self, plugin: str, f: Any, options: dict[str, Any]) -> Callable[[], Any]:
        problem = {"x": ca.vertcat(*self.w), "f": f, "g": ca.vertcat(*self.g)}
        common = {"expand": True, "print_time": False, "show_eval_warnings": False}
        call = ca.nlpsol("rival", plugin, problem, {**common, **options})
        numbers = {
            "x0": np.concatenate(self.first),
            "lbx": np.concatenate(self.lower),
            "ubx": np.concatenate(self.upper),
            "lbg": self.low,
            "ubg": self.high,
        }
        return lambda: (call(**numbers), call.stats())


def radau_ipopt(arm: Arm, intervals: int = K_INTERVALS, linear: bool = False) -> Any:
    """Radau collocation with IPOPT; inputs constant in an interval, or linear and continuous."""
    sheet, f, h = _Sheet(), 0, arm.duration / intervals
    tau = np.append(0, ca.collocation_points(DEGREE, "radau"))
    C, _, _ = ca.collocation_coeff(tau[1:].tolist())
    x, u = _start(sheet, arm), None
    for k in range(intervals):
        if u is None or not linear:
            u = _input(sheet, arm, (k if linear else k + 0.5) / intervals)
        v = _input(sheet, arm, (k + 1) / intervals) if linear else u
        points = [
            _state(sheet, arm, (k + t) / intervals, k == intervals - 1 and t == 1) for t in tau[1:]
        ]
        values = ca.horzcat(x, *points)
        for j, t in enumerate(tau[1:]):
            sheet.row(values @ C[:, j] - h * arm.rates(points[j], u + t * (v - u)), 0.0, 0.0)
            if arm.z2 is not None:
                sheet.row(arm.z2_of(points[j]), -np.inf, -arm.z2)
        f += (
            h * ca.sumsqr(u) if not linear else h * (ca.sumsqr(u) + ca.dot(u, v) + ca.sumsqr(v)) / 3
        )
        x, u = points[-1], v
    quiet = {"print_level": 0, "sb": "yes", "tol": TOLERANCE}
    return _timed(sheet, sheet.solver("ipopt", f, {"ipopt": quiet}), 2, intervals, linear)


def shooting_fatrop(arm: Arm) -> Any:
    """Multiple shooting with one Runge-Kutta step an interval, constant inputs, and Fatrop."""
    sheet, f, h = _Sheet(), 0, arm.duration / K_INTERVALS
    x = _start(sheet, arm)
    for k in range(K_INTERVALS):
        u = _input(sheet, arm, (k + 0.5) / K_INTERVALS)
        a = arm.rates(x, u)
        b = arm.rates(x + h / 2 * a, u)
        c = arm.rates(x + h / 2 * b, u)
        d = arm.rates(x + h * c, u)
        following = _state(sheet, arm, (k + 1) / K_INTERVALS, k == K_INTERVALS - 1)
        sheet.row(following - (x + h / 6 * (a + 2 * b + 2 * c + d)), 0.0, 0.0)
        if arm.z2 is not None and k > 0:
            sheet.row(arm.z2_of(x), -np.inf, -arm.z2)
        f += h * ca.sumsqr(u)
        x = following
    options: dict[str, Any] = {"structure_detection": "auto", "equality": sheet.equality}
    options["fatrop"] = {"print_level": 0, "tol": TOLERANCE}
    return _timed(sheet, sheet.solver("fatrop", f, options), 2, K_INTERVALS, False)


def _start(sheet: _Sheet, arm: Arm) -> Any:
    return sheet.unknown(arm.size, arm.start, arm.start, arm.start)


def _state(sheet: _Sheet, arm: Arm, s: float, last: bool) -> Any:
    high = np.full(arm.size, arm.joint_limit)
    high[0] = np.inf
    low = -high
    if last:
        low[1:] = high[1:] = arm.goal[1:]
    return sheet.unknown(arm.size, low, high, arm.guess(s)[0])


def _input(sheet: _Sheet, arm: Arm, s: float) -> Any:
    return sheet.unknown(2, -arm.input_limit, arm.input_limit, arm.guess(s)[1])


def _timed(
    sheet: _Sheet, call: Callable[[], Any], size: int, intervals: int, linear: bool
) -> Callable[[], Outcome]:
    places, at = [], 0
    for x in sheet.w:
        if x.numel() == size:
            places.append(at + np.arange(size))
        at += x.numel()

    def solve() -> Outcome:
        began = time.process_time()
        found, stats = call()
        seconds = time.process_time() - began
        u = np.asarray(found["x"]).ravel()[np.array(places)]
        inputs = np.stack([u[:-1], u[1:]], axis=1) if linear else u[:, None]
        objective = float(found["f"]) if stats["success"] else np.nan
        return Outcome(seconds, objective, int(stats["iter_count"]), inputs)

    return solve


def _product(factors: list[Any]) -> Any:
    out: Any = 1.0
    for factor in factors:
        out = out * factor
    return out
