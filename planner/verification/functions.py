"""Evaluation of CasADi expressions, step by step, and of piecewise polynomials on balls."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from planner.plan.curves import Cells
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein, part
from planner.support.calculus.chebyshev import from_bernstein
from planner.verification import balls as f
from planner.verification.balls import Ball, polynomial_balls
from planner.verification.models import ROUNDING_FACTOR, ROUNDING_UNIT, Model

ArgumentBalls = Sequence[Sequence[Ball] | Mapping[int, Ball]]
"""Balls of the entries of each argument: for every argument a list, or a table by index."""


class UnboundedError(Exception):
    """Error where a quantity or an operation has no bound; the message names it."""


class Expression:
    """A CasADi expression as a list of steps, ready to be evaluated on balls.

    Args:
        arguments: CasADi column vectors (SX).
        value: Expression of the arguments, a column vector (SX).

    Raises:
        UnboundedError: If the expression uses an operation that has no formula for balls.
    """

    def __init__(self, arguments: Sequence[Any], value: Any) -> None:
        (value,) = ca.cse([ca.densify(value)])
        function = ca.Function("evaluate", list(arguments), [value])
        self.size = value.numel()
        self._steps: list[tuple[int, tuple[int, ...], float]] = []
        self._ends = [-1] * self.size
        holds: dict[int, int] = {}  # the last step that wrote each of CasADi's registers
        for k in range(function.n_instructions()):
            deadline.check_stopped()
            operation, inputs = function.instruction_id(k), function.instruction_input(k)
            if operation not in SUPPORTED:
                raise UnboundedError(f"the function {_NAMES[operation]} of an expression")
            if operation == ca.OP_OUTPUT:
                self._ends[function.instruction_output(k)[1]] = holds[inputs[0]]
                continue
            is_leaf = operation in (ca.OP_INPUT, ca.OP_CONST)
            number = function.instruction_constant(k) if operation == ca.OP_CONST else 0.0
            read = tuple(inputs) if is_leaf else tuple(holds[i] for i in inputs)
            holds[function.instruction_output(k)[0]] = len(self._steps)
            self._steps.append((operation, read, number))
        self._needed = [self._steps_to(end) for end in self._ends]

    def _steps_to(self, end: int) -> list[int]:
        """Return the numbers of step `end` and of all steps whose results it needs, in order."""
        steps, left = set(), [end] if end >= 0 else []
        while left:
            k = left.pop()
            if k not in steps:
                steps.add(k)
                operation, read, _ = self._steps[k]
                left += [] if operation in (ca.OP_INPUT, ca.OP_CONST) else read
        return sorted(steps)

    def reads(self, entry: int, argument: int) -> set[int]:
        """Return the indices of the entries of an argument that an entry of the value reads."""
        steps = [self._steps[k] for k in self._needed[entry]]
        return {read[1] for of, read, _ in steps if of == ca.OP_INPUT and read[0] == argument}

    def __call__(self, *given: Sequence[Ball]) -> list[Ball]:
        """Evaluate the expression on balls of its arguments, to one ball per entry of the value."""
        done: dict[Any, Ball] = {}
        return [self.entry(i, given, done) for i in range(self.size)]

    def entry(self, i: int, given: ArgumentBalls, done: dict[Any, Ball]) -> Ball:
        """Return the ball of entry i of the value, for the balls `given` of the arguments.

        `done` caches results of steps; calls with the same arguments should share it.
        """
        deadline.check_stopped()
        for k in self._needed[i]:
            if k in done:
                continue
            operation, read, number = self._steps[k]
            if operation == ca.OP_INPUT:
                done[k] = given[read[0]][read[1]]
            elif operation == ca.OP_CONST:
                done[k] = Ball.constant(number)
            elif operation in _CIRCULAR:
                pair = ("sine", read[0]), ("cosine", read[0])
                if pair[0] not in done:
                    done[pair[0]], done[pair[1]] = f.sine_cosine(done[read[0]])
                done[k] = _CIRCULAR[operation](done[pair[0]], done[pair[1]])
            else:
                done[k] = _ARITHMETIC[operation](*map(done.__getitem__, read))
        return done[self._ends[i]] if self._ends[i] >= 0 else Ball.constant(0.0)


def _product(a: Ball, b: Ball) -> Ball:
    """Return the product a · b, which is cheaper to compute if a or b is a number."""
    for one, other in ((a, b), (b, a)):
        if one.number is not None:
            return other.scaled(np.float64(one.number))
    return a * b


def _power(base: Ball, exponent: Ball) -> Ball:
    if exponent.number is None:
        raise UnboundedError("a power whose exponent is not constant")
    return f.power(base, exponent.number)


def _hyperbolic(sign: float) -> Callable[[Ball], Ball]:
    return lambda p: (f.exponential(p) + f.exponential(-p) * sign) * 0.5


_CIRCULAR: dict[int, Callable[[Ball, Ball], Ball]] = {
    ca.OP_SIN: lambda s, c: s,
    ca.OP_COS: lambda s, c: c,
    ca.OP_TAN: lambda s, c: s * f.reciprocal(c),
}

_ARITHMETIC: dict[int, Callable[..., Ball]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda a, b: _product(a, f.reciprocal(b)),
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a * 2.0,
    ca.OP_INV: f.reciprocal,
    ca.OP_SQRT: lambda a: f.power(a, 0.5),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_EXP: f.exponential,
    ca.OP_LOG: f.logarithm,
    ca.OP_ATAN: f.arctangent,
    ca.OP_ASIN: f.arcsine,
    ca.OP_ACOS: lambda p: (np.pi / 2 + (-f.arcsine(p))).widen(np.array([[ROUNDING_UNIT]])),
    ca.OP_ATAN2: f.arctangent2,
    ca.OP_SINH: _hyperbolic(-1.0),
    ca.OP_COSH: _hyperbolic(1.0),
    ca.OP_TANH: lambda p: 1.0 + f.reciprocal(f.exponential(p * 2.0) + 1.0) * -2.0,
    ca.OP_FABS: f.absolute,
    ca.OP_SIGN: f.signum,
}

_NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}

SUPPORTED = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *_CIRCULAR, *_ARITHMETIC}


# -- piecewise polynomials -------------------------------------------------------------------------


def polynomials(curve: Bernstein, cells: Cells, order: int = 0) -> list[Model]:
    """Return one model per component of a piecewise polynomial, or of a derivative, on the cells.

    `order` is the order of the derivative in time; 0 is the polynomial itself.
    """
    return [Model(*pair) for pair in zip(*_cell_coefficients(curve, cells, order), strict=True)]


def balls_on_cells(curve: Bernstein, cells: Cells, order: int = 0) -> list[Ball]:
    """Return one ball per component of a piecewise polynomial, or of its derivative in time."""
    return polynomial_balls(*_cell_coefficients(curve, cells, order))


def derivative(curve: Bernstein, order: int) -> tuple[Array, Array]:
    """Return the derivative's Bernstein coefficients, and bounds of their rounding errors.

    The shapes are (degree+1, P, k) and (P, k), for P pieces and k components of the curve.
    """
    c = curve.c.reshape(*curve.c.shape[:2], -1)
    width, size = np.diff(curve.x)[:, None], np.max(np.abs(c), axis=0)
    for _ in range(order):
        degree = len(c) - 1
        size = 2 * degree * size / width
        c = degree * np.diff(c, axis=0) / width if degree else np.zeros_like(c)
    return c, 6 * order * ROUNDING_UNIT * size


def refine_curve(curve: Bernstein, breaks: Array) -> Bernstein:
    """Return the same curve, within rounding, on the pieces between `breaks`.

    The curve's own breaks must be among `breaks`."""
    if np.array_equal(curve.x, breaks):
        return curve
    k = np.searchsorted(curve.x, (breaks[:-1] + breaks[1:]) / 2) - 1
    low, high = ((x - curve.x[k]) / np.diff(curve.x)[k] for x in (breaks[:-1], breaks[1:]))
    return Bernstein(part(curve.c[:, k], low[:, None], high[:, None]), breaks)


def _cell_coefficients(curve: Bernstein, cells: Cells, order: int) -> tuple[Array, Array]:
    """Return Chebyshev coefficients of a curve's derivative on cells, and their total errors.

    The shapes are (k, C, degree+1) and (k, C), for k components of the curve on C cells.
    """
    c, slip = derivative(curve, order)
    c, degree = c[:, cells.piece], len(c) - 1
    size, slips = np.max(np.abs(c), axis=0).T, slip.T[:, cells.piece]
    if degree == 0:
        return c.transpose(2, 1, 0), slips
    whole = np.all(cells.size == 1)
    if not whole:
        c = part(c, cells.low[:, None], (cells.low + cells.size)[:, None])
    matrix = from_bernstein(degree + 1)
    steps = degree + 4 + (0 if whole else 8 * degree)
    grown = steps * np.sum(np.abs(matrix)) * ROUNDING_UNIT * size
    return c.transpose(2, 1, 0) @ matrix.T, grown + slips * ROUNDING_FACTOR
