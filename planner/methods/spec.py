"""Methods with options as one line of text: `polynomial:travel=middle`, `sinusoid compensated`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from planner.errors import InputError
from planner.methods.registry import find_method, merged_options
from planner.plan.plan import COMPENSATED
from planner.problem.problem import Problem
from planner.support.files import toml_value
from planner.support.tables import line, shorten


@dataclass(frozen=True)
class Spec:
    """A method and changes of its options, as read from one line of text.

    Attributes:
        label: The text that was read, which is also the name in tables and figures.
        method: Name of the method.
        options: Options that override the problem's table of the method.
        compensated: Whether to compensate the method's plan for the machine.
    """

    label: str
    method: str
    options: Mapping[str, Any]
    compensated: bool = False


def parse_spec(text: str) -> Spec:
    """Read `method` or `method:key=value:key=value`, or either with `compensated` after the method.

    Values are TOML values; a plain word needs no quotes.

    Raises:
        InputError: If the method is unknown (with the nearest name) or an option is not
            `key=value`.
    """
    name, *settings = (part.strip() for part in _split(text, ":"))
    first, _, word = name.partition(" ")
    compensated = word.strip() == COMPENSATED
    if compensated:
        name = first
    find_method(name)
    options: dict[str, Any] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        key = key.strip()
        if not equals or not key or not value.strip():
            raise InputError(
                f"'{text}': option '{setting}' is not key=value; write for example"
                f" '{name}:key=value'"
            )
        if key in options:
            raise InputError(f"'{text}': option '{key}' is given twice")
        options[key] = _value(text, key, value.strip())
    return Spec(line(text).strip(), name, options, compensated)


def parse_specs(problem: Problem, specs: str | Sequence[str]) -> list[Spec]:
    """Read several specs and check the options of each before any is run.

    Args:
        problem: The problem with the option tables that the specs override.
        specs: A list, or one text with separating commas (outside brackets and quotes).

    Raises:
        InputError: If there is no spec, a spec is wrong, or two are the same.
    """
    texts = list(_split(specs, ",")) if isinstance(specs, str) else specs
    if not isinstance(texts, Iterable) or not all(isinstance(text, str) for text in texts):
        raise InputError(
            f"methods = {shorten(repr(specs))}: give a list of names, for example ['polynomial',"
            " 'collocation']"
        )
    parsed = [parse_spec(text) for text in texts]
    if not parsed:
        raise InputError("no method named; give at least one, for example 'collocation'")
    labels = [spec.label for spec in parsed]
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(f"'{label}' is named twice; give each method and its options once")
    for spec in parsed:
        merged_options(problem, find_method(spec.method), dict(spec.options))
    return parsed


def _value(text: str, key: str, value: str) -> Any:
    try:
        return toml_value(value)
    except ValueError:
        raise InputError(
            f"'{text}': option '{key}' = {value} is not a value; write a number, true, false, a"
            " word, or a list such as [[5.0, -0.2]]"
        ) from None


def _split(text: str, separator: str) -> Iterator[str]:
    """Yield the parts of a text between separators that lie outside brackets and quotes."""
    depth, quote, start = 0, "", 0
    for k, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "[{(":
            depth += 1
        elif character in ")}]":
            depth -= 1
        elif character == separator and depth == 0:
            yield text[start:k]
            start = k + 1
    yield text[start:]
