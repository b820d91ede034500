"""Derivatives of what is computed by way of many intermediate values."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np


class Chain:
    """Derivatives along a chain of definitions v = F(w, v before), such as the values inside.

    With Z = dv/dw, and with mu the rates at which a function L(w, v) grows with each v by way of
    those after it, L has the Hessian (I; Z)' M (I; Z), where M is that of L + mu' F in (w, v): it
    is sparse, each collocation point standing for itself. That takes half the operations of
    differentiating L after v is put in.

    Args:
        unknowns: w, a column.
        inside: v, as columns of symbols.
        meaning: F, as columns, each in terms of w and of the columns of v before it.
    """

    def __init__(self, unknowns: Any, inside: Sequence[Any], meaning: Sequence[Any]) -> None:
        self.w, self.v, self.F = unknowns, ca.vertcat(*inside), ca.vertcat(*meaning)
        self.by_v = ca.jacobian(self.F, self.v)
        self.ends = np.cumsum([0, *(column.numel() for column in inside)]).tolist()
        rows = ca.vertsplit(ca.jacobian(self.F, self.w), self.ends)
        for k, (first, last) in enumerate(pairwise(self.ends)):
            if k > 0:
                rows[k] += self.by_v[first:last, :first] @ ca.vertcat(*rows[:k])
        self.Z = ca.vertcat(*rows)

    def jacobian(self, of: Any) -> Any:
        """First derivatives by w, as a matrix with a row for each entry of a column."""
        return ca.jacobian(of, self.w) + ca.jacobian(of, self.v) @ self.Z

    def second(self, of: Any) -> tuple[Any, Any]:
        """Gradient and Hessian by w of one function."""
        mu, count = ca.SX.sym("mu", self.v.numel()), self.w.numel()
        whole = of + ca.dot(mu, self.F)
        hessian = ca.hessian(whole, ca.vertcat(self.w, self.v))[0]
        mixed = hessian[:count, count:] @ self.Z
        own = hessian[:count, :count] + self.Z.T @ (hessian[count:, count:] @ self.Z)
        both = [ca.gradient(whole, self.w), ca.triu2symm(ca.triu(own + mixed + mixed.T))]
        gradient, hessian = ca.substitute(both, [mu], [self._growth(of)])
        return gradient, hessian

    def _growth(self, of: Any) -> Any:
        out = ca.vertsplit(ca.gradient(of, self.v), self.ends)
        for k, (first, last) in reversed(list(enumerate(pairwise(self.ends[:-1])))):
            out[k] += self.by_v[last:, first:last].T @ ca.vertcat(*out[k + 1 :])
        return ca.densify(ca.vertcat(*out))

    def closed(self, outputs: list[Any]) -> list[Any]:
        """Expressions with v put in."""
        return list(ca.substitute_inplace(ca.vertsplit(self.v), ca.vertsplit(self.F), outputs)[1])
