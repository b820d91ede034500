"""Validation of the tables of a problem file: strict types, no unknown keys, clear messages.

Pydantic's errors become one line per key: key, value, what is allowed, nearest valid key.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import reprlib
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import islice, pairwise
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from planner.errors import InputError
from planner.support.arrays import frozen
from planner.support.tables import shorten

Model = TypeVar("Model", bound=BaseModel)


class Table(BaseModel):
    """Base class of the tables in files that users write."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,  # build on first use: most problems use only a few tables
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Describe each key by the text below it in the class."""
        texts = _texts(cls.__module__)
        for name, field in cls.model_fields.items():
            field.description = field.description or texts.get((cls.__name__, name))

    def model_post_init(self, _: Any) -> None:
        """Make lists and dictionaries read-only, like the table itself."""
        vars(self).update({name: frozen(value) for name, value in vars(self).items()})


@cache
def _texts(module: str) -> dict[tuple[str, str], str]:
    """Return the text below each annotated name of a module's classes, by class and name.

    Pydantic's `use_attribute_docstrings` reads the file anew for each class, a tenth of a second in
    all; this takes a seventh of that.
    """
    try:
        body = ast.parse(inspect.getsource(sys.modules[module])).body
    except (OSError, TypeError, KeyError, SyntaxError):  # typed in, or without its source
        return {}
    out = {}
    for each in (item for item in body if isinstance(item, ast.ClassDef)):
        for both in pairwise(each.body):
            match both:
                case ast.AnnAssign(target=ast.Name(key)), ast.Expr(ast.Constant(str(text))):
                    out[each.name, key] = " ".join(text.split())
    return out


def parse(model: type[Model], data: Any, source: str) -> Model:
    """Validate raw data and return an instance of `model`.

    Args:
        model: The table's model.
        data: The raw table.
        source: Name in messages: a file, or "options of method polynomial".

    Raises:
        InputError: One line per key: source, key, value, what is allowed, nearest valid key.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = _explain(model, data, error.errors())
        raise InputError(f"\n{source}: ".join(lines), source) from None


Positive = Annotated[float, Field(gt=0)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]

Path = tuple[Any, ...]

MOST_ERRORS = 10
"""Most errors reported for one table; more errors usually have a common cause."""

_short_repr = reprlib.Repr()  # does not format all of a list of a million numbers
_short_repr.maxlist = _short_repr.maxtuple = _short_repr.maxdict = 20
_short_repr.maxstring = _short_repr.maxother = _short_repr.maxlong = 80

_PHRASES = {
    "literal_error": "{expected}",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text in quotes",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "a list of at least {min_length} values, not {actual_length}",
    "too_long": "a list of at most {max_length} values, not {actual_length}",
}


def _explain(model: type[BaseModel], data: Any, errors: Sequence[Any]) -> list[str]:
    """Convert Pydantic's validation errors to messages, one line per key."""
    grouped: dict[Path, list[Any]] = {}
    for error in errors:
        grouped.setdefault(_path(data, error), []).append(error)
    above = {path[:k] for path in grouped for k in range(len(path))}
    # An error of a list is left out if it lies in an entry, which has an error of its own.
    own = {p: any(e["type"] == "value_error" for e in group) for p, group in grouped.items()}
    faults = {p: e for p, e in grouped.items() if p not in above or own[p]}
    typos = _typos(model, faults)
    reported = {p: e for p, e in faults.items() if e[0]["type"] != "missing" or p not in typos}
    lines = [_line(model, path, group) for path, group in islice(reported.items(), MOST_ERRORS)]
    more = len(reported) - len(lines)
    return lines + [f"and {more} more errors"] * (more > 0)


def allowed_hint(word: str, allowed: Sequence[str]) -> str:
    """Return a hint for a wrong word: the nearest allowed word, if any, and all allowed words."""
    close = _closest_match(word, allowed)
    hint = f"did you mean '{close}'? " if close else ""
    return f"{hint}allowed: {', '.join(allowed)}"


def _closest_match(word: str, allowed: Sequence[str]) -> str | None:
    return next(iter(difflib.get_close_matches(word[:100], allowed, n=1, cutoff=0.5)), None)


def _path(data: Any, error: Any) -> Path:
    """Return the keys that lead to an error in `data`, without Pydantic's own tags of unions."""
    out: list[Any] = []
    *parents, last = error["loc"] or (None,)
    for part in parents:
        if _contains(data, part):
            out.append(part)
            data = data[part]
    if _contains(data, last) or error["type"] in ("missing", "extra_forbidden"):
        out.append(last)
    return tuple(out)


def _contains(data: Any, part: Any) -> bool:
    if isinstance(data, Mapping):
        return part in data
    return isinstance(data, list) and isinstance(part, int) and part < len(data)


def _typos(model: type[BaseModel], grouped: Mapping[Path, Any]) -> set[Path]:
    """Return the paths of missing keys for which a misspelt key was probably meant."""
    every = (p for p, group in grouped.items() if group[0]["type"] == "extra_forbidden")
    unknown = list(islice(every, MOST_ERRORS))
    meant = {p: _closest_match(str(p[-1]), _keys_at(model, p[:-1])) for p in unknown}
    return {(*p[:-1], key) for p, key in meant.items() if key is not None}


def _line(model: type[BaseModel], path: Path, group: Sequence[Any]) -> str:
    where, value = _dot(path), shorten(_short_repr.repr(group[0]["input"]))
    match group[0]["type"]:
        case "extra_forbidden":
            keys = _keys_at(model, path[:-1])
            hint = _home_table(model, path) or allowed_hint(str(path[-1]), keys)
            return f"unknown key '{where}' (value {value}); {hint}"
        case "missing":
            return f"missing key '{where}'"
        case "value_error":
            text = str(group[0]["ctx"]["error"])
            if not where:
                return text
            shown = "" if isinstance(group[0]["input"], Mapping) else f" = {value}"
            return f"'{where}'{shown}: {text}"
    options = list(dict.fromkeys(_phrase(e) for e in group))
    return f"'{where}' = {value}: must be {' or '.join(options)}"


def _phrase(error: Any) -> str:
    if phrase := _PHRASES.get(error["type"]):
        return phrase.format(**error.get("ctx", {}))
    return str(error["msg"]).replace("Input should be ", "", 1)


def _dot(parts: Sequence[Any]) -> str:
    names = (f"[{p}]" if isinstance(p, int) else f".{shorten(str(p))}" for p in parts)
    return "".join(names).lstrip(".")


def _home_table(model: type[BaseModel], path: Path) -> str:
    """Return a hint that names the tables with a key like the unknown key at `path`, or "".

    If the unknown key is a coordinate in the table of a waypoint, the hint names the waypoint's q.
    """
    homes = [
        name
        for name, table in _fields(model).items()
        if (name,) != path[:-1] and path[-1] in _fields(_table_in(table.annotation))
    ]
    is_place = path[0] == "waypoints" and bool({"start", "goal"} & set(homes))
    if is_place and "q" in _keys_at(model, path[:-1]):
        return f"write it into {_dot(path[:-1])}.q: q = {{ {path[-1]} = ... }}"
    return f"it belongs to [{'] or ['.join(homes)}]" if homes else ""


def _fields(model: Any) -> dict[str, Any]:
    """Return a table's fields by their keys in files (the alias, if a field has one)."""
    return {f.alias or name: f for name, f in getattr(model, "model_fields", {}).items()}


def _keys_at(model: type[BaseModel], path: Path) -> list[str]:
    """Return the keys that the table at `path` may have."""
    return list(_fields(_table_at(model, path)))


def _table_at(model: type[BaseModel], path: Path) -> Any:
    """Return the class of the table at `path`."""
    current: Any = model
    for part in path:
        if part in _fields(current):
            current = _table_in(_fields(current)[part].annotation)
    return current


def _table_in(annotation: Any) -> Any:
    """Return the first class of a table in a type, as in `Table | None`; None without one."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_table_in, get_args(annotation))), None)
