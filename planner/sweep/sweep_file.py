"""The tables of a sweep file: a base problem and the keys that vary.

The points of a sweep are all combinations of rows, grid and sample of dotted keys. Values have a
canonical text, so that equal descriptions have equal keys.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from planner.errors import InputError
from planner.problem.tables.problem_file import ProblemFile
from planner.support.arrays import Array
from planner.support.user_tables import Pair, Table, allowed_hint

MAX_POINTS = 1_000_000
Whole = Annotated[int, Field(ge=0)]
WholePair = Annotated[list[int], Field(min_length=2, max_length=2)]


class Range(Table):
    """Evenly spaced values of a key."""

    low: float = Field(alias="from")
    """First value."""
    high: float = Field(alias="to")
    """Last value."""
    count: Annotated[int, Field(ge=2, le=MAX_POINTS)]
    """How many."""
    spacing: Literal["linear", "log"] = "linear"
    """Equal differences, or equal ratios."""

    @model_validator(mode="after")
    def _check_spacing(self) -> Range:
        if self.low == self.high:
            raise ValueError("'from' and 'to' are the same; give one value in a list instead")
        if self.spacing == "log" and not self.low * self.high > 0:
            raise ValueError("spacing = 'log' needs two ends of the same sign, not zero")
        return self


class Distribution(Table):
    """Distribution of the values of a key; exactly one of the fields is given."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    uniform: Pair | None = None
    """[low, high]."""
    log_uniform: Pair | None = None
    """[low, high], both positive; uniform in the logarithm."""
    normal: Pair | None = None
    """[mean, standard deviation]."""
    integer: WholePair | None = None
    """[low, high], both included."""
    choice: Annotated[list[Any], Field(min_length=1)] | None = None
    """Any of these values, equally likely."""

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise ValueError(
                    f"unknown key '{key}'; {allowed_hint(str(key), [*cls.model_fields])}"
                )
        return data

    @model_validator(mode="after")
    def _check_single(self) -> Distribution:
        fields = self.model_fields_set
        if len(fields) != 1:
            raise ValueError(f"give exactly one of {', '.join(Distribution.model_fields)}")
        for name in fields & {"uniform", "log_uniform", "integer"}:
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} = [{low:g}, {high:g}]: the first must be the lower")
        if self.log_uniform and self.log_uniform[0] <= 0:
            raise ValueError("log_uniform: both ends must be positive")
        if self.normal and self.normal[1] <= 0:
            raise ValueError("normal: the standard deviation must be positive")
        return self


class SampleTable(Table):
    """A sample: number of points, kind of sequence, and a distribution for each dotted key."""

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={"propertyNames": {"pattern": r"^(count|seed|method|.+\..+)$"}},
    )
    __pydantic_extra__: dict[str, Distribution] = Field(init=False)

    count: Annotated[int, Field(ge=1, le=MAX_POINTS)]
    """Number of points."""
    seed: Whole = 0
    """Seed of the draws."""
    method: Literal["sobol", "random"] = "sobol"
    """Scrambled Sobol sequence, or independent draws."""

    _own_keys: ClassVar[tuple[str, ...]] = ("count", "seed", "method")

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, data: Any) -> Any:
        for key, value in data.items() if isinstance(data, dict) else ():
            if "." in key and _is_axis(value):
                raise ValueError(f"'{key}' has a list or a range of values: put it under [grid]")
            if "." in key and not isinstance(value, dict | Distribution):
                raise ValueError(f"'{key}' has a single value: put it under [set]")
            if "." not in key and key not in cls._own_keys:
                hint = allowed_hint(key, [*cls._own_keys, "dotted keys of the problem"])
                raise ValueError(f"unknown key '{key}'; {hint}")
        return data

    @property
    def keys(self) -> dict[str, Distribution]:
        """The distribution of each dotted key."""
        return dict(self.__pydantic_extra__)


class ReplayTable(Table):
    """Settings of the replays of every plan on the emulated machine."""

    samples: Whole = Field(0, le=1_000_000)
    """Number of machines for each plan; 0: none."""
    seed: Whole = 0
    """Seed of the machines, the same for every case."""


class SweepFile(Table):
    """The tables of a sweep file.

    The points are all combinations of the rows of `cases`, the values of `grid` and the draws of
    `sample`; every method plans every point.
    """

    title: str = ""
    """One line that says what the sweep shows."""
    problem: str | dict[str, Any]
    """Base problem: a problem file, relative to the sweep file, or its tables."""
    methods: Annotated[list[str], Field(min_length=1)]
    """Methods, with options if needed, as in 'polynomial:travel=middle'."""
    changes: dict[str, Any] = Field(default_factory=dict, alias="set")
    """Dotted keys to change in every case."""
    cases: list[dict[str, Any]] = Field(default_factory=list)
    """Rows of dotted keys and values that go together."""
    grid: dict[str, Annotated[list[Any], Field(min_length=1)] | Range] = Field(default_factory=dict)
    """Dotted keys, each with a list of values or a range."""
    sample: SampleTable | None = None
    """A sample of dotted keys."""
    replay: ReplayTable = Field(default_factory=ReplayTable)
    plans: bool = False
    """Keep every plan in the database."""

    @model_validator(mode="before")
    @classmethod
    def _places(cls, data: Any) -> Any:
        """Refuse a key in the wrong place and name the table where it belongs."""
        if not isinstance(data, dict):
            return data
        keys = {field.alias or name for name, field in cls.model_fields.items()}
        for key in data.keys() - keys:
            if place := _place_of(key):
                raise ValueError(f"'{key}' is outside of all tables: put it under {place}")
        for name in ("set", "grid"):
            for key in table if isinstance(table := data.get(name), dict) else ():
                if "." not in key and (place := _place_of(key)) and f"[{name}]" not in place:
                    raise ValueError(
                        f"'{name}.{key}' belongs under {place}; [{name}] has dotted keys"
                    )
        grid = data.get("grid")
        for key, value in grid.items() if isinstance(grid, dict) else ():
            if isinstance(value, dict) and value.keys() & Distribution.model_fields.keys():
                raise ValueError(f"'grid.{key}' is drawn at random: put it under [sample]")
        return data


def _is_axis(value: Any) -> bool:
    """Return whether a value is a list or a range, as in a grid."""
    ends = {field.alias or name for name, field in Range.model_fields.items()}
    return isinstance(value, list) or (isinstance(value, dict) and bool(value.keys() & ends))


def _place_of(key: str) -> str:
    """Return the table to which a misplaced key belongs, as in "[replay]"; "" if unknown."""
    tables: dict[str, type[Table]] = {"[sample]": SampleTable, "[replay]": ReplayTable}
    if places := [name for name, table in tables.items() if key in table.model_fields]:
        return " or ".join(places)
    if "." in key or key in ProblemFile.model_fields or key in ("system", "start", "goal"):
        return "[set] (the same in every case), [grid] (lists, ranges) or [sample] (draws)"
    return ""


Point = dict[str, Any]
"""One point of a sweep: dotted keys of the problem, and their values."""


def points(table: SweepFile, source: str) -> list[Point]:
    """Return the points of a sweep: every combination of row, grid values and draw, draws fastest.

    Args:
        table: The tables of the sweep, with dotted keys.
        source: The name of the file in messages.

    Raises:
        InputError: If nothing varies, a key varies twice, or there are too many points.
    """
    _refuse_clashes(table, varied_keys(table), source)
    axes = {key: _axis_values(values) for key, values in table.grid.items()}
    for key, values in axes.items():
        _refuse_repeats(key, values, source)
    rows = table.cases or [{}]
    draws = table.sample.count if table.sample else 1
    count = len(rows) * draws * math.prod(len(values) for values in axes.values())
    if count > MAX_POINTS:
        raise InputError(f"{source}: {count} points are more than {MAX_POINTS}; vary less at once")
    grid = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    sample = _sample_points(table.sample) if table.sample else [{}]
    return [{**a, **b, **c} for a, b, c in itertools.product(rows, grid, sample)]


def varied_keys(table: SweepFile) -> list[str]:
    """Return the varied keys without duplicates, in the order rows, grid, sample."""
    sampled = table.sample.keys if table.sample else {}
    return list(dict.fromkeys([*itertools.chain.from_iterable(table.cases), *table.grid, *sampled]))


def flatten(tables: Mapping[str, Any]) -> Point:
    """Return dotted keys for nested tables: `goal.travel = 1` becomes `"goal.travel" = 1`.

    Flattening stops at the keys of the problem's tables, one level deeper in `method`.
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


def _refuse_clashes(table: SweepFile, keys: list[str], source: str) -> None:
    if not keys:
        raise InputError(
            f"{source}: nothing varies; give [grid], [sample] or [[cases]], as in"
            ' [grid] "goal.travel" = [0.80, 0.82]'
        )
    sampled = table.sample.keys if table.sample else {}
    if table.sample and not sampled:
        raise InputError(
            f"{source}: [sample] names no key to draw; add for example"
            ' "limits.z2_margin" = { uniform = [0.0, 0.02] }'
        )
    blocks = [*dict.fromkeys(itertools.chain.from_iterable(table.cases)), *table.grid, *sampled]
    for key in keys:
        if blocks.count(key) > 1:
            raise InputError(f"{source}: '{key}' varies in two of cases, grid and sample; keep one")
        for other in keys:
            if other.startswith(f"{key}."):
                raise InputError(
                    f"{source}: '{key}' and '{other}' vary, but one contains the other; keep one"
                )


def _refuse_repeats(key: str, values: list[Any], source: str) -> None:
    seen: set[str] = set()
    for value in values:
        text = json.dumps(value, sort_keys=True)
        if text in seen:
            raise InputError(f"{source}: grid '{key}' has the value {text} twice; give it once")
        seen.add(text)


def _axis_values(values: list[Any] | Range) -> list[Any]:
    if isinstance(values, list):
        return values
    space = np.linspace if values.spacing == "linear" else np.geomspace
    # Round to twelve digits, so that 0.8119999999999999 becomes 0.812 and equal values have equal
    # keys.
    return [float(f"{v:.12g}") for v in space(values.low, values.high, values.count)]


def _sample_points(table: SampleTable) -> list[Point]:
    """Return the drawn points of a sample; a larger `count` begins with the same points."""
    keys = table.keys
    columns = [
        _draw_values(d, u)
        for d, u in zip(keys.values(), _unit_points(table, len(keys)).T, strict=True)
    ]
    return [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)]


def _unit_points(table: SampleTable, size: int) -> Array:
    """Return a sample's quasi-random or random numbers between 0 and 1, shape (count, size).

    `size` is the number of keys to draw.
    """
    rng = np.random.default_rng(table.seed)
    if table.method == "random":
        cube = rng.random((table.count, size))
    else:
        from scipy.stats import qmc  # slow to import

        sequence = qmc.Sobol(size, scramble=True, seed=rng)
        cube = sequence.random_base2(math.ceil(math.log2(max(table.count, 1))))[: table.count]
    return np.clip(cube, 1e-12, 1 - 1e-12)


def _draw_values(distribution: Distribution, unit: Array) -> list[Any]:
    """Return the quantiles of a distribution at the probabilities `unit`, shape (count,)."""
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


def canonical_json(value: Any) -> str:
    """Return a value as JSON with sorted keys and no spaces; types that JSON lacks become text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def digest(value: Any) -> str:
    """Return the SHA-256 of a value's canonical JSON, 64 hexadecimal digits."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()
