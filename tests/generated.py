"""Files that are written from tables of the package: `make generated`.

`planner/methods/options.pyi` is what editors and type checkers know of the keywords of `solve`;
`planner/machine/layout.h` is what Python hands over to compiled code; `docs/pages.py` makes the
pages of the reference.
"""

from __future__ import annotations

import inspect
import json
import sys
import types
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import planner
from planner import METHODS
from planner.machine import compiled

HOME = Path(planner.__file__).parent
if HOME.parent != Path(__file__).parents[1]:
    sys.exit(f"{__file__} would write into {HOME}: put its own checkout on PYTHONPATH")
sys.path.append(str(Path(__file__).parents[1] / "docs"))
import pages  # noqa: E402

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
    return {
        HOME / "methods" / "options.pyi": stub(),
        HOME / "machine" / "layout.h": layout(),
        **pages.pages(),
    }


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


_LAYOUT = """\
/* What Python hands over. Written from the tables of compiled.py by `make generated`. */

#ifndef LAYOUT_H
#define LAYOUT_H

#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#ifdef _MSC_VER
#define INLINE static __forceinline
#else
#define INLINE static inline __attribute__((always_inline))
#endif

"""


def layout() -> str:
    """The header that all C files of the replay include."""
    return _LAYOUT + "\n".join(_layout()) + "\n\n#endif\n"


def _layout() -> Iterator[str]:
    limited, plays, most = compiled.LIMITED_LAWS, compiled.PLAY_LAWS, compiled.MOST_PASSIVE
    sizes = {"BODIES": compiled.ROWS["bodies"], "LIMITED": limited, "PLAYS": plays}
    sizes |= {"LAWS": compiled.DYNAMIC_NUMBERS["pieces"], "STATE": compiled.ROWS["count"]}
    yield f"#define VERSION {compiled.VERSION}"
    yield "#define MOTORS 2"
    yield f"#define JOINTS {most} /* passive ones, at most; of the following as many as then */"
    yield from (f"#define {name} {a + b * most}" for name, (a, b) in sizes.items())
    fields = [f"int64_t {', '.join(compiled.COUNTS)};", "double k_g, gamma;"]
    yield from _struct("Model", fields + [f"{t} *{name};" for name, t in compiled.ARRAYS.items()])
    yield from _struct(
        "Commands", ["const double *value;", f"int64_t {', '.join(compiled.STRIDES)};"]
    )
    yield from _pointers("Own", "parameters", compiled.MACHINE_NUMBERS)
    yield from _pointers("Held", "state", compiled.STATE_NUMBERS)
    yield from _pointers("Moving", "moving", compiled.DYNAMIC_NUMBERS)
    yield from _struct(
        "Masses", [f"double {name}[{a + b * most}];" for name, (a, b) in compiled.MASSES.items()]
    )
    yield "INLINE Masses masses_of(int m, const double *from, int64_t samples)"
    yield "{\n    Masses p;"
    at = 0, 0
    for name, (a, b) in compiled.MASSES.items():
        yield f"    for (int i = 0; i < {_sum(a, b)}; i++)"
        yield f"        p.{name}[i] = from[({_sum(*at)} + i) * samples];"
        at = at[0] + a, at[1] + b
    yield "    return p;\n}"
    rows = {**compiled.ROWS, "limited": limited, "plays": plays}
    yield from _struct("Rows", [f"int m, {', '.join(rows)};"])
    yield "INLINE Rows rows_of(int m)\n{\n    Rows r;\n    r.m = m;"
    yield from (f"    r.{name} = {_sum(*size)};" for name, size in rows.items())
    yield "    return r;\n}"


def _struct(name: str, fields: Sequence[str]) -> Iterator[str]:
    yield "\ntypedef struct {"
    yield from (f"    {field}" for field in fields)
    yield f"}} {name};\n"


def _pointers(name: str, array: str, table: dict[str, tuple[int, int]]) -> Iterator[str]:
    """A struct that points to the parts of the numbers of w machines, each part's number in a row
    of w; how it is got; and how many numbers a machine has."""
    kind = f"{compiled.ARRAYS[array]} *"
    yield from _struct(name, [f"{kind}{part}; /* {_sum(*size)} */" for part, size in table.items()])
    yield f"INLINE {name} {name.lower()}({kind}at, int64_t m, int64_t w)\n{{\n    {name} out;"
    a, b = 0, 0
    for part, (more, each) in table.items():
        yield f"    out.{part} = at + ({_sum(a, b)}) * w;"
        a, b = a + more, b + each
    yield "    return out;\n}"
    yield f"\nINLINE int64_t {name.lower()}_count(int64_t m) {{ return {_sum(a, b)}; }}"


def _sum(a: int, b: int) -> str:
    each = "m" if b == 1 else f"{b} * m"
    return str(a) if not b else f"{a} + {each}" if a else each


if __name__ == "__main__":
    for path, text in files().items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:  # make compares dates
            path.write_text(text, encoding="utf-8")
