"""What every table of a problem file shares: strict types, no unknown keys, one clear message."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from planner.errors import InputError

Model = TypeVar("Model", bound=BaseModel)


class Table(BaseModel):
    """A table of a problem file."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def parse(model: type[Model], data: Any, source: str, at: Sequence[str] = ()) -> Model:
    """Validate `data` as `model`.

    Args:
        model: The table's model.
        data: The raw table.
        source: What to name in messages: a file, or "options of method polynomial".
        at: Keys that lead to the table.

    Raises:
        InputError: One line an error: source, key, value, what is allowed, nearest valid key.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = _unique(_explain(model, e, at) for e in error.errors())
        raise InputError("\n".join(f"{source}: {line}" for line in lines)) from None


def nearest(word: str, allowed: Sequence[str]) -> str:
    """A sentence on what is allowed, led by the nearest match if one is near."""
    close = difflib.get_close_matches(word, allowed, n=1, cutoff=0.5)
    hint = f"did you mean '{close[0]}'? " if close else ""
    return f"{hint}allowed: {', '.join(allowed)}"


def _unique(lines: Any) -> list[str]:
    return list(dict.fromkeys(lines))


def _explain(model: type[BaseModel], error: Any, at: Sequence[str]) -> str:
    loc = [part for part in error["loc"] if not _is_union_tag(part)]
    where = _dotted([*at, *loc])
    value = _shown(error["input"])
    match error["type"]:
        case "extra_forbidden":
            keys = _keys_at(model, error["loc"][:-1])
            return f"unknown key '{where}' (value {value}); {nearest(str(loc[-1]), keys)}"
        case "missing":
            return f"missing key '{where}'"
        case "value_error":
            return (
                f"'{where}' = {value}: {error['ctx']['error']}"
                if where
                else str(error["ctx"]["error"])
            )
        case "finite_number":
            return f"'{where}' = {value}: must be a finite number"
        case _:
            return f"'{where}' = {value}: {_lower(error['msg'])}"


def _is_union_tag(part: Any) -> bool:
    return isinstance(part, str) and (
        part.startswith(("literal[", "tuple[", "list[", "function-")) or part in _TAGS
    )


_TAGS = frozenset({"float", "int", "bool", "str", "constrained-float", "constrained-int"})


def _dotted(parts: Sequence[Any]) -> str:
    out = ""
    for part in parts:
        out += f"[{part}]" if isinstance(part, int) else f".{part}"
    return out.lstrip(".")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _lower(text: str) -> str:
    return text.replace("Input should", "should", 1)


def _keys_at(model: type[BaseModel], loc: Sequence[Any]) -> list[str]:
    """Keys of the table that `loc` leads to; aliases where a field has one."""
    current: Any = model
    for part in loc:
        fields = getattr(current, "model_fields", {})
        named = {f.alias or name: f for name, f in fields.items()}
        if part in named:
            current = _table_in(named[part].annotation)
    fields = getattr(current, "model_fields", {})
    return [f.alias or name for name, f in fields.items()]


def _table_in(annotation: Any) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for option in get_args(annotation):
        found = _table_in(option)
        if found is not None:
            return found
    return None
