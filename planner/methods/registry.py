"""The registry of methods: entries, options as keywords or as text, registration of new ones.

Methods of other packages are wrapped, so that an error names the package at fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast, get_args

from planner.errors import InputError
from planner.methods import keeping
from planner.plan.plan import Plan
from planner.plan.plan_file import PlanFile
from planner.plan.spec import Spec, split
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Demand, Part
from planner.problem.tables.kinds import Provider, add_method_table, load_plugins, remember
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
from planner.support.files import toml_value
from planner.support.tables import line, shorten
from planner.support.user_tables import Table, allowed_hint, parse
from planner.verification.verify import verify

if TYPE_CHECKING:
    from planner.methods.options import Solve


def _foreign_plan(
    provider: Provider, function: Callable[..., Any], problem: Problem, options: Any, *near: Plan
) -> Plan:
    """Return another package's plan of the problem, marked as not verified.

    Raises:
        MethodError: If the function fails or does not return a plan of this problem.
    """
    answer = provider.call(function, problem, options, *near)
    plan: Plan = provider.call(_sound, provider, problem, answer)
    return plan


def _sound(provider: Provider, problem: Problem, answer: Any) -> Plan:
    """Return a package's answer if it is a complete plan of the problem.

    A compensated plan is replaced by its original; another answer raises a `MethodError`.
    """
    if not isinstance(answer, Plan):
        raise provider.error(f"returned {line(repr(answer), 60)}, which is not a plan")
    plan = answer.compensates or answer
    if plan.problem != problem:
        raise provider.error("returned a plan of another problem")
    plan = replace(plan, verified=False, certificate=None)
    try:
        parse(PlanFile, plan.to_dict(), "its plan")
    except InputError as error:
        raise provider.error(f"returned a plan that cannot be saved: {error}") from None
    verify(plan)  # a failure in here is attributed to the package
    return plan


def _foreign_keeps(
    provider: Provider, keeps: keeping.Keeps, problem: Problem, demand: Demand, part: Part
) -> keeping.Keeping:
    """Return another package's answer "kept", "judged" or "never" for one part of a demand.

    Raises:
        MethodError: If the function fails or its answer is none of these (see `keeping`).
    """
    answer = provider.call(keeps, problem, demand, part)
    if not isinstance(answer, str) or answer not in get_args(keeping.Keeping):
        allowed = ", ".join(get_args(keeping.Keeping))
        raise provider.error(f"keeps {shorten(repr(answer))}; it must be one of {allowed}")
    return cast("keeping.Keeping", answer)


@dataclass(frozen=True)
class Method:
    """An entry of the registry.

    Attributes:
        name: Name for users; also the name of its `[method.*]` table.
        summary: One line for listings.
        options: The table of its options.
        plan: Function from problem and options to a plan that is not verified yet.
        keeps: Function that says, before any search, which parts of the demands the method keeps.
        replan: Like `plan`, but starts from a plan of a neighbouring problem; or None.
        refines: The method from whose plan this method starts, or None. If the other method finds
            no plan, this method finds none either, so `check` does not try it.
        finds_time: Whether the method reports a duration that is too short and finds a longer one.
    """

    name: str
    summary: str
    options: type[Any]
    plan: Callable[[Problem, Any], Plan]
    keeps: keeping.Keeps = keeping.nothing
    replan: Callable[[Problem, Any, Plan], Plan] | None = None
    refines: str | None = None
    finds_time: bool = False


def _call(module: str, name: str, *given: Any) -> Plan:
    """Call a planning function, whose module is imported only now."""
    plan: Plan = getattr(import_module(f"planner.methods.{module}"), name)(*given)
    return plan


_ALL = (
    Method(
        "polynomial",
        "the paper's method: v1 constant, v2 polynomial, with constraint points",
        PolynomialOptions,
        partial(_call, "laws.polynomial", "plan_polynomial"),
        keeping.law(keeping.one_leg),
    ),
    Method(
        "piecewise",
        "multirate: v1 constant, v2 piecewise constant",
        PiecewiseOptions,
        partial(_call, "laws.piecewise", "plan_piecewise"),
        keeping.law(keeping.slots),
    ),
    Method(
        "sinusoid",
        "one period of v1 = a0 + a1 sin wt, v2 = sum of bj cos jwt",
        SinusoidOptions,
        partial(_call, "laws.sinusoids", "plan_sinusoid"),
        keeping.law(keeping.smooth),
    ),
    Method(
        "sinusoid_steps",
        "z1 and z2 first, then one further coordinate in each period of sinusoids",
        SinusoidStepsOptions,
        partial(_call, "laws.sinusoids", "plan_sinusoid_steps"),
        keeping.law(keeping.steps),
    ),
    Method(
        "collocation",
        "optimal plans in joint coordinates within all limits, by direct collocation",
        CollocationOptions,
        partial(_call, "collocation.machine_end", "plan_to_end"),
        keeping.collocation,
        partial(_call, "collocation.machine_end", "plan_to_end"),
        finds_time=True,
    ),
    Method(
        "convex",
        "globally optimal path in the chart with its gap, or a certificate that none exists",
        ConvexOptions,
        partial(_call, "convex.method", "plan_convex"),
        keeping.convex,
    ),
    Method(
        "desensitised",
        "least response to errors of inputs, start and constants, traded against effort",
        DesensitisedOptions,
        partial(_call, "desensitised.method", "plan_desensitised"),
        keeping.desensitised,
        partial(_call, "desensitised.method", "plan_desensitised"),
        refines="collocation",
        finds_time=True,
    ),
)


def typed(solve: Callable[..., Plan]) -> Solve:
    """Return `solve` unchanged, typed by `options.pyi`, which tells editors its keywords."""
    return cast("Solve", solve)


METHODS = {method.name: method for method in _ALL}
"""Methods by name; those of plugins are added when the first problem is read."""

ALL = "all"
"""Word that stands for every method where names of methods are given."""


def all_methods() -> dict[str, Method]:
    """Load the plugins, and return `METHODS`, which then includes their methods.

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

    Other processes, such as workers of a sweep, know the method only from a plugin: a package whose
    entry point `planner.plugins` names a function that calls `register_method`.

    Args:
        name: Name of the method: a Python identifier.
        plan: A function of the problem and an instance of `options` that returns a plan, which
            `solve` then verifies. Without a plan it raises a `NoPlanError` with the reason.
            Any other error or return value becomes a `MethodError` that names the package.
        options: The table `[method.NAME]` of problem files, a `planner.support.user_tables.Table`;
            every key has a default.
        summary: One line for listings.
        keeps: A function of the problem, a `Demand` of the problem and a `Part` of the demand:
            "kept" if every motion of the method satisfies the part, "judged" if only verification
            checks it, or "never": then the problem is refused before the method begins. By default
            everything is judged.
        replan: Like `plan`, but starts from a plan of a neighbouring problem.
        refines: The method from whose plan this method starts, if any; `check` then does not try
            this method by itself.
        finds_time: Whether the method reports a duration that is too short and finds a longer one.

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
    provider = Provider.of(f"method '{name}'", plan)
    METHODS[name] = replace(
        entry,
        plan=partial(_foreign_plan, provider, plan),
        keeps=partial(_foreign_keeps, provider, keeps),
        replan=replan and partial(_foreign_plan, provider, replan),
    )
    remember(f"method '{name}'")


def _faults(method: Any) -> Iterator[str]:
    """Yield the reasons why an entry of the registry is invalid."""
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
    """Return the registry's entry of the method with the given name.

    Raises:
        InputError: If there is no such method (the message names the nearest), or a plugin fails.
    """
    if not isinstance(name, str) or (name not in METHODS and name not in all_methods()):
        raise InputError(
            f"unknown method '{shorten(str(name))}'; {allowed_hint(str(name), list(METHODS))}"
        )
    return METHODS[name]


def merged_options(problem: Problem, method: Method, options: Mapping[str, Any]) -> Any:
    """Return a method's options: the problem's table of the method, overridden by `options`."""
    table = getattr(problem.methods, method.name, None)  # None if registered after the problem
    if table is not None and not options:
        return table
    base = {} if table is None else table.model_dump(exclude_unset=True)
    return parse(method.options, {**base, **plain(options)}, f"options of method '{method.name}'")


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
    given = split(specs, ",") if isinstance(specs, str) else specs
    texts = list(given) if isinstance(given, Iterable) else [None]
    if not all(isinstance(text, str) for text in texts):
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
            " word, or a list such as [[5.0, -0.2]]; compensated stands after the method's name"
        ) from None
