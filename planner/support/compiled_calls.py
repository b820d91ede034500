"""CasADi functions on NumPy arrays."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca


class Call(threading.local):
    """A CasADi function's first value on NumPy arrays; each thread has a buffer of its own.

    The arrays' own memory is handed over; neither their shapes nor their sizes are checked.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._size = function.nnz_out(0)

    def __call__(self, *arguments: Array) -> Array:
        """All nonzeros, shape (n,); those of matrices by columns, as CasADi stores them."""
        out, buffer, kept_alive = np.empty(self._size), self._buffer, []
        for i, given in enumerate(arguments):
            kept_alive.append(np.ascontiguousarray(given, dtype=float).reshape(-1))
            buffer.set_arg(i, kept_alive[i].data)
        buffer.set_res(0, out.data)
        self._evaluate()
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

    def __init__(self, name: str, arguments: Sequence[Any], value: Any) -> None:
        self.function = ca.Function(name, list(arguments), [ca.densify(value)])
        self.shape = self.function.size_out(0)
        self._mapped = {0: Call(self.function)}  # by the power of two of the points they take

    def __call__(self, *arguments: Array) -> Array:
        """Values at points given by arrays (…, k) whose leading axes agree.

        Returns:
            Array (…, r) of a column of r, or (…, r, c) of a matrix.
        """
        lead = arguments[0].shape[:-1]
        count = math.prod(lead)
        rows, columns = self.shape
        points = [a.reshape(count, a.shape[-1]) for a in arguments]
        done, parts = 0, [np.empty(0)]
        # any count is a sum of few powers of two, and a map takes long to make
        for power in range(count.bit_length() - 1, -1, -1):
            if count & 2**power:
                if power not in self._mapped:
                    self._mapped[power] = Call(self.function.map(2**power))
                parts.append(self._mapped[power](*[p[done : done + 2**power] for p in points]))
                done += 2**power
        out = parts[1] if len(parts) == 2 else np.concatenate(parts)
        out = out.reshape(count, columns, rows)
        if columns == 1:
            return out.reshape(*lead, rows)
        return np.ascontiguousarray(out.swapaxes(-1, -2)).reshape(*lead, rows, columns)
