"""The points of a sweep: rows, grid and sample of dotted keys, and all their combinations.

One text for one value, so that equal descriptions have equal keys.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.support.arrays import Array
from planner.sweep.sweep_file import MAX_POINTS, Distribution, Range, SampleTable, SweepFile

Point = dict[str, Any]
"""Dotted keys and their values."""


def points(table: SweepFile, source: str) -> list[Point]:
    """Every combination of rows, grid values and draws, the last varying fastest.

    Args:
        table: The sweep's tables, keys flat.
        source: What to name in messages.

    Raises:
        InputError: If nothing varies, a key varies twice, or there are too many points.
    """
    keys = varied(table)
    _refuse_clashes(table, keys, source)
    axes = {key: _axis(values) for key, values in table.grid.items()}
    for key, values in axes.items():
        _refuse_repeats(key, values, source)
    rows = table.cases or [{}]
    draws = table.sample.count if table.sample else 1
    count = len(rows) * draws * math.prod(len(values) for values in axes.values())
    if count > MAX_POINTS:
        raise InputError(f"{source}: {count} points are more than {MAX_POINTS}; vary less at once")
    grid = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    sample = _sample(table.sample) if table.sample else [{}]
    return [{**a, **b, **c} for a, b, c in itertools.product(rows, grid, sample)]


def varied(table: SweepFile) -> list[str]:
    """Every key that varies, each once, in the order of the file: rows, grid, sample."""
    drawn = table.sample.keys if table.sample else {}
    return list(dict.fromkeys([*_row_keys(table), *table.grid, *drawn]))


def flat(tables: Mapping[str, Any]) -> Point:
    """Dotted keys from nested tables: `goal.travel = 1` means the same as `"goal.travel" = 1`.

    Keys are taken apart down to the keys of the problem's tables, one level deeper in `method`.
    """
    out: Point = {}
    for name, value in tables.items():
        if "." in name or not isinstance(value, Mapping):
            out[name] = value
            continue
        for key, inner in value.items():
            if name == "method" and isinstance(inner, Mapping):
                out |= {f"{name}.{key}.{last}": item for last, item in inner.items()}
            else:
                out[f"{name}.{key}"] = inner
    return out


def _row_keys(table: SweepFile) -> Iterable[str]:
    return itertools.chain.from_iterable(table.cases)


def _refuse_clashes(table: SweepFile, keys: list[str], source: str) -> None:
    if not keys:
        raise InputError(
            f"{source}: nothing varies; give [grid], [sample] or [[cases]], as in"
            ' [grid] "goal.travel" = [0.80, 0.82]'
        )
    drawn = table.sample.keys if table.sample else {}
    if table.sample and not drawn:
        raise InputError(
            f"{source}: [sample] names no key to draw; add for example"
            ' "limits.z2_margin" = { uniform = [0.0, 0.02] }'
        )
    blocks = [*dict.fromkeys(_row_keys(table)), *table.grid, *drawn]
    for key in keys:
        if blocks.count(key) > 1:
            raise InputError(f"{source}: '{key}' varies in two of cases, grid and sample; keep one")
        for other in keys:
            if other.startswith(f"{key}."):
                raise InputError(f"{source}: '{key}' and '{other}' both vary; one holds the other")


def _refuse_repeats(key: str, values: list[Any], source: str) -> None:
    seen: set[str] = set()
    for value in values:
        text = json.dumps(value, sort_keys=True)
        if text in seen:
            raise InputError(f"{source}: grid '{key}' has the value {text} twice; give it once")
        seen.add(text)


def _axis(values: list[Any] | Range) -> list[Any]:
    if isinstance(values, list):
        return values
    space = np.linspace if values.spacing == "linear" else np.geomspace
    # Twelve digits, so that 0.812 is not 0.8119999999999999 and equal values have equal keys.
    return [float(f"{v:.12g}") for v in space(values.low, values.high, values.count)]


def _sample(table: SampleTable) -> list[Point]:
    """The draws; a larger count begins with the draws of a smaller one."""
    keys = table.keys
    columns = [_drawn(d, u) for d, u in zip(keys.values(), _unit(table, len(keys)).T, strict=True)]
    return [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]


def _unit(table: SampleTable, size: int) -> Array:
    """Points of the open unit cube, shape (count, size)."""
    rng = np.random.default_rng(table.seed)
    if table.method == "random":
        cube = rng.random((table.count, size))
    else:
        from scipy.stats import qmc  # slow to import

        sequence = qmc.Sobol(size, scramble=True, seed=rng)
        cube = sequence.random_base2(math.ceil(math.log2(max(table.count, 1))))[: table.count]
    return np.clip(cube, 1e-12, 1 - 1e-12)


def _drawn(distribution: Distribution, unit: Array) -> list[Any]:
    """Values of one key at positions `unit`, shape (count,), of its cumulative distribution."""
    from scipy.special import ndtri

    if distribution.choice is not None:
        values = distribution.choice
        return [values[int(u * len(values))] for u in unit]
    if distribution.integer is not None:
        first, last = distribution.integer
        return [int(v) for v in first + np.floor(unit * (last - first + 1))]
    if distribution.normal is not None:
        mean, deviation = distribution.normal
        return [float(v) for v in mean + deviation * ndtri(unit)]
    if distribution.log_uniform is not None:
        low, high = np.log(distribution.log_uniform)
        return [float(v) for v in np.exp(low + (high - low) * unit)]
    assert distribution.uniform is not None
    low, high = distribution.uniform
    return [float(v) for v in low + (high - low) * unit]


def canonical(value: Any) -> str:
    """JSON with sorted keys and no spaces; what JSON lacks (TOML's dates) becomes text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def digest(value: Any) -> str:
    """SHA-256 of `canonical`, 64 hexadecimal digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()
