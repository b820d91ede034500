"""The array type, and conversions of values to plain Python and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def jsonable(value: Any) -> Any:
    """Convert a value to JSON's types; NaN and infinity become None, arrays become lists."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def plain(value: Any) -> Any:
    """Copy a value, with lists in place of tuples and arrays, and Python's numbers for NumPy's."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def hashable(value: Any) -> Any:
    """Convert dictionaries and lists to hashable values; equal values stay equal."""
    if isinstance(value, Mapping):
        return frozenset((key, hashable(item)) for key, item in value.items())
    return tuple(hashable(item) for item in value) if isinstance(value, list | tuple) else value


Array = NDArray[np.float64]


def product(matrix: Array, columns: Array) -> Array:
    """Return the product of a matrix (N, K) and columns (K, M), computed in blocks of columns.

    OpenBLAS starts threads, which are slow on a busy computer, for more than 2^18 multiplications
    (its default, GEMM_MULTITHREAD_THRESHOLD 4); blocks stay below this number.
    """
    most = max(1, 2**18 // matrix.size)
    if columns.shape[1] <= most:
        return np.asarray(matrix @ columns)
    out = np.empty((len(matrix), columns.shape[1]))
    for k in range(0, columns.shape[1], most):
        np.matmul(matrix, columns[:, k : k + most], out=out[:, k : k + most])
    return out
