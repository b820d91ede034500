"""The options of `solve` that editors complete, method by method, are those of the tables."""

from __future__ import annotations

import inspect
import types
from typing import (
    Annotated,
    Any,
    Literal,
    Union,
    get_args,
    get_origin,
    get_overloads,
    get_type_hints,
    is_typeddict,
)

import pytest

import planner
from planner.methods import registry
from planner.methods.registry import METHODS, Solve, SolveKeywords
from planner.solve import solve

CALL: Any = types.SimpleNamespace(
    __module__=Solve.__module__, __qualname__=f"{Solve.__name__}.__call__"
)
"""Under this name Python keeps the forms of the call."""

DECLARED = {
    get_args(hint)[0]: overload
    for overload in get_overloads(CALL)
    if get_origin(hint := get_type_hints(overload, include_extras=True)["method"]) is Literal
}
"""By the method's name: the form of `solve` that takes it."""

NAMES = tuple(METHODS)
"""Those of the planner itself; other tests may register more."""

OWN = inspect.signature(planner.solve).parameters.keys()


def bare(annotation: Any) -> Any:
    """A type without the ranges that a table adds to it."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return bare(arguments[0])
    if origin in (Union, types.UnionType):
        return Union[tuple(bare(each) for each in arguments)]  # noqa: UP007
    return list[bare(arguments[0])] if origin is list else annotation  # type: ignore[misc]


@pytest.mark.parametrize("name", NAMES)
def test_keys_and_types_are_those_of_the_table(name: str) -> None:
    unpacked = get_type_hints(DECLARED[name], include_extras=True)["options"]
    (typed,) = get_args(unpacked)
    assert typed.__name__ == "".join(word.title() for word in name.split("_"))
    assert not typed.__required_keys__
    fields = METHODS[name].options.model_fields
    wanted = {key: bare(field.annotation) for key, field in fields.items() if key not in OWN}
    assert get_type_hints(typed) == get_type_hints(SolveKeywords) | wanted


def test_every_form_has_the_arguments_of_solve_and_one_takes_any_name() -> None:
    *_, last = forms = get_overloads(CALL)
    assert tuple(sorted(DECLARED)) == tuple(sorted(NAMES))
    assert len(forms) == len(NAMES) + 1
    assert get_type_hints(last)["method"] is str
    hints = get_type_hints(solve)
    call = get_type_hints(SolveKeywords)
    assert call == {key: hints[key] for key in call}
    for form in forms:
        own = inspect.signature(form).parameters.keys() - {"self"}
        assert own | call.keys() == OWN
    assert (
        sum(is_typeddict(each) for name, each in vars(registry).items() if name[0] != "_")
        == len(NAMES) + 1
    )
    first = inspect.signature(forms[0]).parameters["method"]
    assert first.default is not inspect.Parameter.empty  # what is meant where no method is named
    assert "collocation" in str(first.annotation)
