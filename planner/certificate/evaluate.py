"""CasADi functions carried out on models, instruction by instruction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from planner.certificate import functions as f
from planner.certificate.model import UNIT, Model


class UnboundedError(Exception):
    """An operation that models do not know; says which."""


class Evaluator:
    """An expression of scalars, ready to be evaluated on models.

    Args:
        arguments: CasADi column vectors (SX).
        value: Expression of them, a column vector (SX).

    Raises:
        UnboundedError: If it uses an operation that models do not know.
    """

    def __init__(self, arguments: Sequence[Any], value: Any) -> None:
        (value,) = ca.cse([ca.densify(value)])
        function = ca.Function("evaluate", list(arguments), [value])
        self.size = value.numel()
        self._steps = [
            (
                function.instruction_id(k),
                function.instruction_input(k),
                function.instruction_output(k),
                function.instruction_constant(k)
                if function.instruction_id(k) == ca.OP_CONST
                else 0.0,
            )
            for k in range(function.n_instructions())
        ]
        for operation, *_ in self._steps:
            if operation not in _KNOWN:
                raise UnboundedError(f"operation {operation} of the system's expressions")

    def __call__(self, *arguments: Sequence[Model]) -> list[Model]:
        """One model an entry of the value, for models of the arguments' entries."""
        with np.errstate(all="ignore"):  # what is infinite or undefined becomes a remainder
            return self._evaluated(*arguments)

    def _evaluated(self, *arguments: Sequence[Model]) -> list[Model]:
        cells = len(arguments[0][0].r)
        work: dict[int, Model] = {}
        out = [Model.constant(0.0, cells)] * self.size
        circular: dict[int, tuple[Model, tuple[Model, Model]]] = {}
        for operation, inputs, outputs, constant in self._steps:
            if operation == ca.OP_INPUT:
                work[outputs[0]] = arguments[inputs[0]][inputs[1]]
            elif operation == ca.OP_OUTPUT:
                out[outputs[1]] = work[inputs[0]]
            elif operation == ca.OP_CONST:
                work[outputs[0]] = Model.constant(constant, cells)
            elif operation in _CIRCULAR:
                angle = work[inputs[0]]
                if id(angle) not in circular:
                    circular[id(angle)] = (angle, f.sine_cosine(angle))
                work[outputs[0]] = _CIRCULAR[operation](*circular[id(angle)][1])
            else:
                work[outputs[0]] = _PLAIN[operation](*(work[i] for i in inputs))
        return out


def _power(base: Model, exponent: Model) -> Model:
    value = exponent.c[0, 0]
    if exponent.c.shape[1] > 1 or np.any(exponent.c != value) or np.any(exponent.r):
        raise UnboundedError("a power whose exponent is not constant")
    return f.power(base, float(value))


def _hyperbolic(sign: float) -> Callable[[Model], Model]:
    return lambda p: (f.exponential(p) + f.exponential(-p) * sign) * 0.5


def _hyperbolic_tangent(p: Model) -> Model:
    return 1.0 + f.reciprocal(f.exponential(p * 2.0) + 1.0) * -2.0


def _arccosine(p: Model) -> Model:
    return np.pi / 2 + (-f.arcsine(p)).widened(np.full(len(p.r), UNIT))


_CIRCULAR: dict[int, Callable[[Model, Model], Model]] = {
    ca.OP_SIN: lambda s, c: s,
    ca.OP_COS: lambda s, c: c,
    ca.OP_TAN: lambda s, c: s * f.reciprocal(c),
}

_PLAIN: dict[int, Callable[..., Model]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a * f.reciprocal(b),
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a * 2.0,
    ca.OP_INV: f.reciprocal,
    ca.OP_SQRT: f.square_root,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_EXP: f.exponential,
    ca.OP_LOG: f.logarithm,
    ca.OP_ATAN: f.arctangent,
    ca.OP_ASIN: f.arcsine,
    ca.OP_ACOS: _arccosine,
    ca.OP_ATAN2: f.arctangent2,
    ca.OP_SINH: _hyperbolic(-1.0),
    ca.OP_COSH: _hyperbolic(1.0),
    ca.OP_TANH: _hyperbolic_tangent,
    ca.OP_FABS: f.absolute,
    ca.OP_SIGN: f.signum,
}

_KNOWN = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *_CIRCULAR, *_PLAIN}
