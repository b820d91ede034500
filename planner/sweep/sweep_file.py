"""The tables of a sweep file: one base problem, and what varies."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, model_validator

from planner.support.user_tables import Table, nearest

MAX_POINTS = 1_000_000
Whole = Annotated[int, Field(ge=0)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
WholePair = Annotated[list[int], Field(min_length=2, max_length=2)]


class Range(Table):
    """Evenly spaced values."""

    low: float = Field(alias="from", description="First value.")
    high: float = Field(alias="to", description="Last value.")
    count: Annotated[int, Field(ge=2, le=MAX_POINTS)] = Field(description="How many.")
    spacing: Literal["linear", "log"] = Field(
        "linear", description="Equal differences, or equal ratios."
    )

    @model_validator(mode="after")
    def _spaced(self) -> Range:
        if self.low == self.high:
            raise ValueError("'from' and 'to' are the same; give one value in a list instead")
        if self.spacing == "log" and not self.low * self.high > 0:
            raise ValueError("with spacing = 'log' both ends have one sign and are not zero")
        return self


class Distribution(Table):
    """How one key is drawn; exactly one of these."""

    uniform: Pair | None = Field(None, description="[low, high].")
    log_uniform: Pair | None = Field(
        None, description="[low, high], both positive; even in the logarithm."
    )
    normal: Pair | None = Field(None, description="[mean, standard deviation].")
    integer: WholePair | None = Field(None, description="[low, high], whole numbers, both ends in.")
    choice: Annotated[list[Any], Field(min_length=1)] | None = Field(
        None, description="Any of these values, equally likely."
    )

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                raise ValueError(f"unknown key '{key}'; {nearest(str(key), [*cls.model_fields])}")
        return data

    @model_validator(mode="after")
    def _one(self) -> Distribution:
        given = self.model_fields_set
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(Distribution.model_fields)}")
        for name in given & {"uniform", "log_uniform", "integer"}:
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} = [{low:g}, {high:g}]: the first must be the lower")
        if self.log_uniform and self.log_uniform[0] <= 0:
            raise ValueError("log_uniform: both ends must be positive")
        if self.normal and self.normal[1] <= 0:
            raise ValueError("normal: the standard deviation must be positive")
        return self


class SampleTable(Table):
    """A sample: how many points, by which sequence, and one distribution a dotted key."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Distribution] = Field(init=False)

    count: Annotated[int, Field(ge=1, le=MAX_POINTS)] = Field(description="Number of points.")
    seed: Whole = Field(0, description="Seed of the draws.")
    method: Literal["sobol", "random"] = Field(
        "sobol", description="Scrambled Sobol sequence, or independent draws."
    )

    _own: ClassVar[tuple[str, ...]] = ("count", "seed", "method")

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            if "." not in key and key not in cls._own:
                hint = nearest(key, [*cls._own, "dotted keys of the problem"])
                raise ValueError(f"unknown key '{key}'; {hint}")
        return data

    @property
    def keys(self) -> dict[str, Distribution]:
        """Dotted keys and how each is drawn."""
        return dict(self.__pydantic_extra__)


class ReplayTable(Table):
    """Replays of every plan on the emulated machine."""

    samples: Whole = Field(
        0, le=1_000_000, description="Machines each plan is replayed on; 0: none."
    )
    seed: Whole = Field(0, description="Seed of the machines, the same for every case.")


class SweepFile(Table):
    """A sweep file.

    The points are all combinations of the rows of `cases`, the values of `grid` and the draws of
    `sample`; every method plans every point.
    """

    title: str = Field("", description="One line that says what the sweep shows.")
    problem: str | dict[str, Any] = Field(
        description="Base problem: a problem file, relative to the sweep file, or its tables."
    )
    methods: Annotated[list[str], Field(min_length=1)] = Field(
        description="Methods, each with options if wanted, as in 'polynomial:travel=middle'."
    )
    changes: dict[str, Any] = Field(
        default_factory=dict, alias="set", description="Dotted keys changed in every case."
    )
    cases: list[dict[str, Any]] = Field(
        default_factory=list, description="Rows of dotted keys and values that go together."
    )
    grid: dict[str, Annotated[list[Any], Field(min_length=1)] | Range] = Field(
        default_factory=dict, description="Dotted keys, each with a list of values or a range."
    )
    sample: SampleTable | None = Field(None, description="A sample of dotted keys.")
    replay: ReplayTable = Field(default_factory=ReplayTable)
    plans: bool = Field(False, description="Keep every plan in the database.")


def sweep_schema() -> dict[str, Any]:
    """JSON Schema of a sweep file, for editors; keys of blocks are taken to be dotted."""
    return SweepFile.model_json_schema()
