"""The array type, and conversions of values to plain Python and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def jsonable(value: Any) -> Any:
    """Convert to lists, dictionaries and finite numbers; NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def plain(value: Any) -> Any:
    """Copy a value as a file would hold it: lists for tuples and arrays, Python's numbers."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def hashable(value: Any) -> Any:
    """Convert a plain value to a hashable one; equal values stay equal."""
    if isinstance(value, Mapping):
        return frozenset((key, hashable(item)) for key, item in value.items())
    if isinstance(value, list | tuple):
        return tuple(hashable(item) for item in value)
    return value


Array = NDArray[np.float64]


def product(matrix: Array, columns: Array) -> Array:
    """Multiply a matrix by columns (K, M) in blocks, to keep OpenBLAS on one thread.

    OpenBLAS starts threads for products of more than 2^18 multiplications (its default,
    GEMM_MULTITHREAD_THRESHOLD 4). On a busy computer the threads cost more than they save.
    """
    most = max(1, 2**18 // matrix.size)
    if columns.shape[1] <= most:
        return np.asarray(matrix @ columns)
    out = np.empty((len(matrix), columns.shape[1]))
    for k in range(0, columns.shape[1], most):
        np.matmul(matrix, columns[:, k : k + most], out=out[:, k : k + most])
    return out
