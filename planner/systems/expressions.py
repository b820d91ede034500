"""Convert between expressions as text, in problem files, and CasADi expressions."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.support.casadi import ca
from planner.support.tables import shorten

FUNCTIONS = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("exp", "log", "sqrt", "fabs"),
)
"""Names of the CasADi functions that an expression in text may call."""

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def parse_expression(text: str, symbols: Mapping[str, Any], where: str = "expression") -> Any:
    """Turn text such as "tan(theta) / cos(phi)**2" into a CasADi expression.

    Args:
        text: Numbers, names, `pi`, + - * / **, and the functions of `FUNCTIONS`.
        symbols: CasADi expression or number that each name stands for.
        where: Origin of the text, for messages.

    Raises:
        InputError: If the text is not such an expression; the message names the wrong part.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{where}: {shorten(text)!r} is not an expression") from None
    try:
        return _Reader(shorten(text), {"pi": np.pi, **symbols}, where).build(tree.body)
    except RecursionError:
        raise InputError(
            f"{where}: {shorten(text)!r} has too many terms or brackets ({len(text)} characters);"
            " at most some hundred can be read"
        ) from None


@dataclass(frozen=True)
class _Reader:
    text: str
    symbols: Mapping[str, Any]
    where: str

    def build(self, node: ast.expr) -> Any:
        value = ca.SX(self._translate(node))
        if value.is_constant() and not value.is_regular():
            raise InputError(
                f"{self.where}: {_source(node)!r} in {self.text!r} has no finite value"
            )
        return value

    def _translate(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return _check_finite(number, self.where)
            case ast.Name(id=name) if name in self.symbols:
                return self.symbols[name]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return _BINARY[type(op)](self.build(left), self.build(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.build(operand)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.build(operand)
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
                return _call(name, [self.build(a) for a in args], self.where)
        raise InputError(
            f"{self.where}: {_source(node)!r} in {self.text!r} is not understood; names:"
            f" {', '.join(self.symbols)}; functions: {', '.join(FUNCTIONS)}; operators: + - * / **"
        )


def _check_finite(number: float, where: str) -> float:
    try:
        return float(number)
    except OverflowError:
        raise InputError(f"{where}: a whole number has hundreds of digits") from None


def _source(node: ast.expr) -> str:
    return shorten(ast.unparse(node))


def _call(name: str, args: list[Any], where: str) -> Any:
    count = 2 if name == "atan2" else 1
    if len(args) != count:
        raise InputError(f"{where}: {name} takes {count} argument{'s' if count > 1 else ''}")
    return getattr(ca, name)(*args)


_TEMPLATES = {
    "ADD": "({} + {})",
    "SUB": "({} - {})",
    "MUL": "({} * {})",
    "DIV": "({} / {})",
    "POW": "({} ** {})",
    "CONSTPOW": "({} ** {})",
    "NEG": "(-{})",
    "SQ": "({} ** 2)",
    "TWICE": "(2 * {})",
    "INV": "(1 / {})",
    **{name.upper(): f"{name}({{}})" for name in FUNCTIONS},
    "ATAN2": "atan2({}, {})",
}
"""Text for each CasADi operation, {} for an operand, by the operation's name without `OP_`."""


def operator_templates() -> dict[int, str]:
    """Return the text for each CasADi operation, {} for an operand, by its integer code."""
    return {getattr(ca, f"OP_{name}"): template for name, template in _TEMPLATES.items()}


def write_expression(expression: Any, where: str = "expression") -> str:
    """Write a scalar CasADi SX expression as text that `parse_expression` can read.

    Raises:
        InputError: If the expression is not a scalar SX, or has an operation without a text.
    """
    scalar = ca.SX(expression)
    if scalar.numel() != 1:
        raise InputError(f"{where}: not a scalar but of shape {scalar.shape}")
    if scalar.nnz() == 0:
        return "0.0"

    templates = operator_templates()

    def text(node: Any) -> str:
        if node.is_constant():
            return repr(float(node))
        if node.is_symbolic():
            return str(node.name())
        if node.op() not in templates:
            allowed = f"+ - * / ** and {', '.join(FUNCTIONS)}"
            raise InputError(f"{where}: {node} cannot be written in a file; use {allowed}")
        return templates[node.op()].format(*(text(node.dep(k)) for k in range(node.n_dep())))

    return text(scalar)
