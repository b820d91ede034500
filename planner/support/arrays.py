"""The array type, values that cannot change, and conversions to plain Python and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NoReturn, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError


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


def floats(name: str, value: ArrayLike) -> Array:
    """Return numbers that a user gives as an array of floats.

    Args:
        name: Name of the value in messages.
        value: A number, or numbers in arrays or lists.

    Raises:
        InputError: If the value has text, None, truth values or complex numbers, or lists of
            different lengths.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} = {value!r:.60}: must be a number or an array of numbers")
    return array.astype(float, copy=False)


Item = TypeVar("Item", bound=np.generic)
Value = TypeVar("Value")


def locked(array: NDArray[Item]) -> NDArray[Item]:
    """Return an array that its caller has just made, now read-only, without a copy."""
    array.setflags(write=False)
    return array


def frozen(value: Value) -> Value:
    """Return a value that cannot change: arrays, dictionaries and lists are copied and read-only.

    The copies stay arrays, dictionaries and lists. What cannot change already is not copied.
    """
    given: Any = value
    if isinstance(given, np.ndarray) and not _is_locked(given):
        given = locked(given.copy("K"))
    elif isinstance(given, Mapping) and not isinstance(given, _FrozenDict):
        given = _FrozenDict((key, frozen(item)) for key, item in given.items())
    elif isinstance(given, list) and not isinstance(given, _FrozenList):
        given = _FrozenList(map(frozen, given))
    elif type(given) is tuple:
        given = tuple(map(frozen, given))
    return cast("Value", given)


def _is_locked(array: Any) -> bool:
    """Return whether neither the array nor one whose memory it shows can be written to."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None or isinstance(array, bytes)


class Frozen:
    """A value that cannot change after it is made: the base class of frozen dataclasses.

    Arrays, dictionaries and lists are copied when they come in, and those handed out are read-only.
    Copies and pickles are read-only too, and leave out what properties have cached.
    """

    def __post_init__(self) -> None:
        vars(self).update({name: frozen(value) for name, value in vars(self).items()})

    def __getstate__(self) -> dict[str, Any]:
        cls = type(self)
        cached = (n for n in vars(self) if isinstance(getattr(cls, n, None), cached_property))
        return {n: v for n, v in vars(self).items() if n not in {*cached}}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update({name: frozen(value) for name, value in state.items()})


def _refuse(self: Any, *_: Any, **__: Any) -> NoReturn:
    kind = "dict" if isinstance(self, dict) else "list"
    raise TypeError(f"this {kind} is read-only; change a copy of it: {kind}(...)")


class _FrozenDict(dict[Any, Any]):
    """A dictionary that cannot change."""

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return frozen, (dict(self),)


class _FrozenList(list[Any]):
    """A list that cannot change."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = append = extend = _refuse
    insert = pop = remove = clear = sort = reverse = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return frozen, (list(self),)


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
