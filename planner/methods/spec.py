"""Read methods with options from one line of text, and check them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from planner.errors import InputError
from planner.methods.registry import ALL, all_methods, find_method, merged_options
from planner.plan.spec import Spec, split
from planner.problem.problem import Problem
from planner.support.files import toml_value
from planner.support.tables import shorten


def parse_spec(text: str | Spec, *, feedback: bool = False) -> Spec:
    """Read `method` or `method:key=value:key=value`, or either with `compensated` after the method.

    Values are TOML values; a plain word needs no quotes. A spec that was read already is returned.

    Args:
        text: The text of one spec.
        feedback: Whether " + feedback" may follow, as in a comparison.

    Raises:
        InputError: If the method is unknown (with the nearest name), an option is not
            `key=value`, or feedback has no meaning here.
    """
    if isinstance(text, Spec):
        return text
    spec = Spec.of_label(text) if isinstance(text, str) else Spec(text)
    find_method(spec.method)
    if spec.feedback and not feedback:
        raise InputError(f"'{text}': only replays have feedback; name the plan, '{spec.text}'")
    options: dict[str, Any] = {}
    for setting in spec.settings:
        key, equals, value = setting.partition("=")
        key = key.strip()
        if not equals or not key or not value.strip():
            raise InputError(
                f"'{text}': option '{setting}' is not key=value; write for example"
                f" '{spec.method}:key=value'"
            )
        if key in options:
            raise InputError(f"'{text}': option '{key}' is given twice")
        options[key] = _value(text, key, value.strip())
    return replace(spec, options=options)


def parse_specs(
    problem: Problem, specs: str | Sequence[str], *, feedback: bool = False
) -> list[Spec]:
    """Read several specs and check the options of each before any is run.

    Args:
        problem: The problem with the option tables that the specs override.
        specs: A list, or one text with separating commas (outside brackets and quotes); "all" means
            every method.
        feedback: As for `parse_spec`.

    Raises:
        InputError: If there is no spec, a spec is wrong, or two are the same.
    """
    if specs == ALL:
        return [Spec(name) for name in all_methods()]
    texts = list(split(specs, ",")) if isinstance(specs, str) else specs
    if not isinstance(texts, Iterable) or not all(isinstance(text, str) for text in texts):
        raise InputError(
            f"methods = {shorten(repr(specs))}: give a list of names, for example ['polynomial',"
            " 'collocation']"
        )
    parsed = [parse_spec(text, feedback=feedback) for text in texts]
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
