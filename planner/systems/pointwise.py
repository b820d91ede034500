"""CasADi functions of points, called on NumPy arrays of any shape without copying twice."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from planner.systems.base import Array


def evaluated(function: Any, arguments: Iterable[Array], out: Array) -> Array:
    """`out`, filled with a CasADi function's first value; matrices by columns, as it stores them.

    The arrays' own memory is handed over; neither their shapes nor their sizes are checked.
    """
    buffer, evaluate = function.buffer()
    held = [np.ascontiguousarray(a, dtype=float) for a in arguments]
    for i, array in enumerate(held):
        buffer.set_arg(i, array.reshape(-1).data)
    buffer.set_res(0, out.reshape(-1).data)
    evaluate()
    return out


class Pointwise:
    """A function of column vectors that maps over the leading axes of its arguments.

    CasADi stores matrices by columns, so a row-major array (m, k) of m points is the (k, m) matrix
    its `map` wants: the arrays' own memory is handed over.

    Args:
        name: For messages.
        arguments: CasADi column vectors.
        value: Expression of them, a column vector or matrix.
    """

    _KEPT = 32

    def __init__(self, name: str, arguments: Sequence[Any], value: Any) -> None:
        self.function = ca.Function(name, list(arguments), [ca.densify(value)])
        self.shape = self.function.size_out(0)
        self._mapped: OrderedDict[int, Any] = OrderedDict({1: self.function})

    def __call__(self, *arguments: Array) -> Array:
        """Values at points given by arrays (…, k) whose leading axes agree.

        Returns:
            Array (…, r) of a column of r, or (…, r, c) of a matrix.
        """
        lead = arguments[0].shape[:-1]
        count = math.prod(lead)
        rows, columns = self.shape
        out = np.empty((count, columns, rows))
        if count:
            evaluated(self._for(count), arguments, out)
        if columns == 1:
            return out.reshape(*lead, rows)
        return np.ascontiguousarray(out.swapaxes(-1, -2)).reshape(*lead, rows, columns)

    def _for(self, count: int) -> Any:
        if count not in self._mapped:
            self._mapped[count] = self.function.map(count)
            if len(self._mapped) > self._KEPT:
                self._mapped.popitem(last=False)
        else:
            self._mapped.move_to_end(count)
        return self._mapped[count]
