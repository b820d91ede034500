"""Files that are written from tables of the package: `make generated`.

`planner/methods/options.pyi` is what editors and type checkers know of the keywords of `solve`.
"""

from __future__ import annotations

import inspect
import json
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import planner
from planner.methods.registry import METHODS

HOME = Path(planner.__file__).parent
OWN = tuple(METHODS.values())
"""Those of the planner itself; other tests may register more."""

_HEAD = '''\
"""Keywords of `planner.solve` by method. Written from the tables of options by `make generated`."""

from typing import Any, Literal, Protocol, TypedDict, Unpack, overload

from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.support.progress import Listener

class SolveKeywords(TypedDict, total=False):
'''
_CALL = '''
class Solve(Protocol):
    """`planner.solve`, with the keywords of the method that is named."""
'''
_FORM = """
    @overload
    def __call__(
        self, problem: Problem, method: {}, **options: {}
    ) -> Plan: ...
"""


def files() -> dict[Path, str]:
    """By path: what each file is to hold."""
    return {HOME / "methods" / "options.pyi": stub()}


def stub() -> str:
    """The keywords of `solve`, method by method."""
    return "".join(_stub())


def _stub() -> Iterator[str]:
    own = inspect.signature(planner.solve).parameters
    every = {name: each.annotation for name, each in own.items() if each.kind == each.KEYWORD_ONLY}
    yield _HEAD + "".join(f"    {key}: {words}\n" for key, words in every.items())
    forms = []
    for method in OWN:
        title = "".join(word.title() for word in method.name.split("_"))
        yield f"\nclass {title}(SolveKeywords, total=False):\n"
        yield from (
            f"    {key}: {_spelled(field.annotation)}\n"
            for key, field in method.options.model_fields.items()
            if key not in every
        )
        default = " = ..." if method.name == own["method"].default else ""
        forms.append(_FORM.format(f'Literal["{method.name}"]{default}', f"Unpack[{title}]"))
    forms.sort(key=lambda form: " = ..." not in form)  # what is meant where none is named, first
    yield _CALL
    yield from forms
    yield _FORM.format("str = ...", "Any")


def _spelled(annotation: Any) -> str:
    """A type in Python's words, without the ranges that a table adds to it."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _spelled(parts[0])
    if origin in (Union, types.UnionType):
        return " | ".join(map(_spelled, parts))
    if origin is list:
        return f"list[{_spelled(parts[0])}]"
    if origin is Literal:
        return f"Literal[{', '.join(map(json.dumps, parts))}]"
    return "None" if annotation is types.NoneType else str(annotation.__name__)


if __name__ == "__main__":
    for path, text in files().items():
        path.write_text(text, encoding="utf-8")
