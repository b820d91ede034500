"""The methods that make plans: one file each, one registry, and how a new one comes in.

Methods with options in one line of text, as in `polynomial:travel=middle` or
`collocation compensated`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from planner.errors import InputError
from planner.methods import keeping
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.kinds import add_method_table, load_plugins, remember
from planner.problem.tables.method_options import (
    CollocationOptions,
    ConvexOptions,
    DesensitisedOptions,
    PiecewiseOptions,
    PolynomialOptions,
    SinusoidOptions,
    SinusoidStepsOptions,
)
from planner.support.arrays import plain
from planner.support.files import parse_toml
from planner.support.tables import brief, line
from planner.support.user_tables import Table, nearest, parse


@dataclass(frozen=True)
class Later:
    """Where a function is, whose module (and with it, say, OSQP) is imported when it is wanted."""

    module: str
    name: str

    def __call__(self) -> Callable[..., Plan]:
        """The function."""
        found: Callable[..., Plan] = getattr(import_module(self.module), self.name)
        return found


@dataclass(frozen=True)
class Method:
    """An entry of the registry.

    Attributes:
        name: As users write it; also the name of its `[method.*]` table.
        summary: One line for listings.
        options: The table of its options.
        made_by: What makes its plans, or where that is.
        keeps: What it says before it searches: which parts of what is asked it keeps.
        remade_by: The same from a plan of a neighbouring problem, or None.
        refines: The method whose plan it starts from, or None. Where that finds none this finds
            none, so that `check` does not try it.
        finds_time: Whether it reports a too short duration by itself and finds a longer one.
    """

    name: str
    summary: str
    options: type[Any]
    made_by: Callable[[Problem, Any], Plan] | Later
    keeps: keeping.Keeps = keeping.nothing
    remade_by: Callable[[Problem, Any, Plan], Plan] | Later | None = None
    refines: str | None = None
    finds_time: bool = False

    @property
    def plan(self) -> Callable[[Problem, Any], Plan]:
        """From problem and options to a plan that is not verified yet."""
        return self.made_by() if isinstance(self.made_by, Later) else self.made_by

    @property
    def replan(self) -> Callable[[Problem, Any, Plan], Plan] | None:
        """The same as `plan` from a plan of a neighbouring problem, or None."""
        return self.remade_by() if isinstance(self.remade_by, Later) else self.remade_by


_ALL = (
    Method(
        "polynomial",
        "the paper's method: v1 constant, v2 polynomial, with constraint points",
        PolynomialOptions,
        Later("planner.methods.laws.polynomial", "plan_polynomial"),
        keeping.law(keeping.one_leg),
    ),
    Method(
        "piecewise",
        "multirate: v1 constant, v2 piecewise constant",
        PiecewiseOptions,
        Later("planner.methods.laws.piecewise", "plan_piecewise"),
        keeping.law(keeping.slots),
    ),
    Method(
        "sinusoid",
        "one period of v1 = a0 + a1 sin wt, v2 = sum of bj cos jwt",
        SinusoidOptions,
        Later("planner.methods.laws.sinusoids", "plan_sinusoid"),
        keeping.law(keeping.smooth),
    ),
    Method(
        "sinusoid_steps",
        "z1 and z2 first, then one further coordinate in each period of sinusoids",
        SinusoidStepsOptions,
        Later("planner.methods.laws.sinusoids", "plan_sinusoid_steps"),
        keeping.law(keeping.steps),
    ),
    Method(
        "collocation",
        "optimal plans in joint coordinates within all limits, by direct collocation",
        CollocationOptions,
        Later("planner.methods.collocation.method", "plan_collocation"),
        keeping.collocation,
        Later("planner.methods.collocation.method", "replan_collocation"),
        finds_time=True,
    ),
    Method(
        "convex",
        "globally optimal path in the chart with its gap, or a certificate that none exists",
        ConvexOptions,
        Later("planner.methods.convex.method", "plan_convex"),
        keeping.convex,
    ),
    Method(
        "desensitised",
        "least response to errors of inputs, start and constants, traded against effort",
        DesensitisedOptions,
        Later("planner.methods.desensitised.method", "plan_desensitised"),
        keeping.desensitised,
        Later("planner.methods.desensitised.method", "plan_desensitised"),
        refines="collocation",
        finds_time=True,
    ),
)

METHODS = {method.name: method for method in _ALL}
"""By name. What plugins register is in it once the first problem is read."""

COMPENSATED = "compensated"
"""After the name of a method: its plan compensated for the machine."""

ALL = "all"
"""In place of methods: every one there is."""


def all_methods() -> dict[str, Method]:
    """`METHODS` with what plugins bring.

    Raises:
        InputError: If a plugin fails.
    """
    load_plugins()
    return METHODS


def register_method(
    name: str,
    plan: Callable[[Problem, Any], Plan],
    *,
    options: type[Table],
    summary: str,
    keeps: keeping.Keeps = keeping.nothing,
    replan: Callable[[Problem, Any, Plan], Plan] | None = None,
    refines: str | None = None,
    finds_time: bool = False,
) -> None:
    """Register a method for `solve`, `compare`, `check`, sweeps and problem files.

    Other processes, such as workers of a sweep, know it only from a plugin: a package whose entry
    point `planner.plugins` names a function that calls this one.

    Args:
        name: Name of the method: a Python identifier.
        plan: A function of the problem and an instance of `options` that returns a plan, which
            `solve` then verifies. If it finds none it raises a `NoPlanError` with the reason.
        options: The table `[method.NAME]` of problem files, a `planner.support.user_tables.Table`;
            every key has a default.
        summary: One line for listings.
        keeps: From the problem, a `Demand` of it and a `Part` of that to "kept" where no motion of
            the method breaks it, "judged" where that is left to the judge, or "never": then the
            problem is refused before the method begins. When left out all is judged.
        replan: As `plan`, from a plan of a neighbouring problem.
        refines: The method whose plan it starts from, if any; `check` then does not try it by
            itself.
        finds_time: Whether it reports by itself that a duration is too short and finds a longer
            one.

    Raises:
        InputError: If the name is taken or invalid, or an argument has the wrong type.
    """
    if not isinstance(name, str) or not name.isidentifier() or not name.isascii():
        raise InputError(
            f"method '{line(str(name))}' cannot be registered: a name has letters, digits and _,"
            " and begins with a letter"
        )
    if name in METHODS:
        raise InputError(f"method '{name}' exists already: {METHODS[name].summary}")
    if name == ALL or name.startswith("_") or hasattr(Table, name):
        raise InputError(f"method '{name}' cannot be registered: the name is reserved")
    entry = Method(name, summary, options, plan, keeps, replan, refines, finds_time)
    if why := next(_faults(entry), None):
        raise InputError(f"method '{name}' cannot be registered: {why}")
    add_method_table(name, options)
    METHODS[name] = entry
    remember(f"method '{name}'")


def _faults(method: Any) -> Iterator[str]:
    """Why an entry is no method."""
    for key in ("plan", "keeps", "replan"):
        function = getattr(method, key)
        if not callable(function) and not (key == "replan" and function is None):
            yield f"{key} = {line(repr(function))} is not a function"
    if not isinstance(method.options, type) or not issubclass(method.options, Table):
        yield f"options = {line(repr(method.options))} is not a subclass of Table"
    elif bare := [key for key, field in method.options.model_fields.items() if field.is_required()]:
        yield f"its option {', '.join(bare)} has no default"
    if not isinstance(method.summary, str) or not method.summary.strip():
        yield "summary is not a text"
    if method.refines is not None and method.refines not in METHODS:
        yield f"refines = {line(repr(method.refines))} is no method"


def find_method(name: str) -> Method:
    """The registry's entry of that name.

    Raises:
        InputError: If there is none; names the nearest. If it is looked for among plugins, and one
            fails.
    """
    if not isinstance(name, str) or (name not in METHODS and name not in all_methods()):
        raise InputError(
            f"unknown method '{brief(str(name))}'; {nearest(str(name), list(METHODS))}"
        )
    return METHODS[name]


def merged_options(problem: Problem, method: Method, options: dict[str, Any]) -> Any:
    """The method's option table: the problem's, overridden by keywords."""
    table = getattr(problem.methods, method.name, None)  # None: read before it was registered
    if table is not None and not options:
        return table
    own = {} if table is None else table.model_dump(exclude_unset=True)
    return parse(method.options, {**own, **plain(options)}, f"options of method '{method.name}'")


@dataclass(frozen=True)
class Spec:
    """A method and what to change in its options.

    Attributes:
        label: The text it was read from; names it in tables and figures.
        method: Name of the method.
        options: Options that override the problem's table of that method.
        compensated: Whether its plan is compensated for the machine.
    """

    label: str
    method: str
    options: Mapping[str, Any]
    compensated: bool = False


def parse_spec(text: str) -> Spec:
    """Read `method` or `method:key=value:key=value`, or either with `compensated` after the method.

    Values are TOML values; a plain word may go without quotes.

    Raises:
        InputError: If the method is unknown (names the nearest) or an option is not `key=value`.
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
    """Read several specs and check their options, before any of them is run.

    Args:
        problem: Supplies the option tables that the specs override.
        specs: A list, or one text with commas between (outside brackets and quotes).

    Raises:
        InputError: If there is none, one is wrong, or two are the same.
    """
    texts = list(_split(specs, ",")) if isinstance(specs, str) else specs
    if not isinstance(texts, Iterable) or not all(isinstance(text, str) for text in texts):
        raise InputError(
            f"methods = {brief(repr(specs))}: give a list of names, for example ['polynomial',"
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
        table = parse_toml(f"value = {value}")
    except ValueError:
        table = {}
    if table.keys() == {"value"}:
        return table["value"]
    if re.fullmatch(r"[A-Za-z][\w.+-]*", value):
        return value
    raise InputError(
        f"'{text}': option '{key}' = {value} is not a value; write a number, true, false, a"
        " word, or a list such as [[5.0, -0.2]]"
    )


def _split(text: str, separator: str) -> Iterator[str]:
    """Split at a separator outside brackets and quotes."""
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
