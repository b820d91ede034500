"""Call CasADi functions on NumPy arrays."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca


class Call(threading.local):
    """The first output of a CasADi function, evaluated on NumPy arrays; one buffer per thread.

    CasADi reads the arrays' memory directly, without a check of their shapes and sizes.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._size = function.nnz_out(0)

    def __call__(self, *arguments: Array) -> Array:
        """Return the output's nonzeros, shape (n,), column by column as CasADi stores a matrix."""
        out, buffer, kept_alive = np.empty(self._size), self._buffer, []
        for i, value in enumerate(arguments):
            kept_alive.append(np.ascontiguousarray(value, dtype=float).reshape(-1))
            buffer.set_arg(i, kept_alive[i].data)
        buffer.set_res(0, out.data)
        self._evaluate()
        return out


class Pointwise:
    """A function of column vectors, evaluated over the leading axes of its arguments.

    CasADi stores matrices by columns, so a row-major array (m, k) of m points is the (k, m) matrix
    that CasADi's `map` expects, and CasADi can read the array's memory directly.

    Args:
        name: The function's name in CasADi's messages.
        arguments: CasADi column vectors.
        value: Expression of the arguments, a column vector or matrix.
    """

    def __init__(self, name: str, arguments: Sequence[Any], value: Any) -> None:
        self.__setstate__(ca.Function(name, list(arguments), [ca.densify(value)]))

    def __getstate__(self) -> Any:
        return self.function

    def __setstate__(self, function: Any) -> None:
        self.function = function
        self.shape = function.size_out(0)
        self._mapped = {0: Call(function)}  # key k: the function mapped over 2^k points

    def __call__(self, *arguments: Array) -> Array:
        """Return the function's values at points given by arrays (…, k) with equal leading axes.

        Returns:
            Array (…, r) for a column of r entries, or (…, r, c) for a matrix.
        """
        lead = arguments[0].shape[:-1]
        count = math.prod(lead)
        rows, columns = self.shape
        points = [a.reshape(count, a.shape[-1]) for a in arguments]
        done, parts = 0, [np.empty(0)]
        # split the points into powers of two: building a map is slow, so few sizes are kept
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
