"""What every table of a problem file shares: strict types, no unknown keys, one clear message."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from planner.errors import InputError
from planner.schema.messages import explain, nearest

__all__ = ["Table", "nearest", "parse"]

Model = TypeVar("Model", bound=BaseModel)


class Table(BaseModel):
    """A table of a problem file."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,  # until a table is used: most problems use a few of them
    )


def parse(model: type[Model], data: Any, source: str, at: Sequence[str] = ()) -> Model:
    """Validate `data` as `model`.

    Args:
        model: The table's model.
        data: The raw table.
        source: What to name in messages: a file, or "options of method polynomial".
        at: Keys that lead to the table.

    Raises:
        InputError: One line a key: source, key, value, what is allowed, nearest valid key.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = explain(model, data, error.errors(), at)
        raise InputError("\n".join(f"{source}: {line}" for line in lines)) from None
