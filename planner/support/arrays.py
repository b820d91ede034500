"""Arrays, and what JSON can hold of a value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def jsonable(value: Any) -> Any:
    """Plain lists, dictionaries and finite numbers; None in place of NaN and infinity."""
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
    """A copy as a file would hold it: lists for tuples and arrays, Python's numbers for NumPy's."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def hashable(value: Any) -> Any:
    """Of a plain value one that has a hash, and is equal where the plain ones are."""
    if isinstance(value, Mapping):
        return frozenset((key, hashable(item)) for key, item in value.items())
    if isinstance(value, list | tuple):
        return tuple(hashable(item) for item in value)
    return value


Array = NDArray[np.float64]


def product(matrix: Array, columns: Array) -> Array:
    """The matrix times columns (K, M), a few at a time.

    OpenBLAS starts threads for products of more than 2^18 multiplications (its default,
    GEMM_MULTITHREAD_THRESHOLD 4); on a computer that is busy they cost more than they gain.
    """
    most = max(1, 2**18 // matrix.size)
    if columns.shape[1] <= most:
        return np.asarray(matrix @ columns)
    out = np.empty((len(matrix), columns.shape[1]))
    for k in range(0, columns.shape[1], most):
        np.matmul(matrix, columns[:, k : k + most], out=out[:, k : k + most])
    return out
