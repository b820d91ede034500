"""`planner methods`, `planner systems` and `planner schema`: what there is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

import planner.systems
from planner.cli.arguments import Json
from planner.cli.output import print_json, print_text, table
from planner.errors import InputError
from planner.methods import METHODS
from planner.schema import FILES, json_schema, nearest
from planner.schema.plan import plan_schema
from planner.schema.sweep import sweep_schema
from planner.systems import TriangularSystem


def methods(as_json: Json = False) -> int:
    """List the methods that make plans, one line each."""
    found = {name: method.summary for name, method in METHODS.items()}
    return _list("method", found, as_json)


def systems(as_json: Json = False) -> int:
    """List the systems that can be steered, one line each."""
    found = {kind: _first_line(_classes()[kind].__doc__) for kind in FILES}
    return _list("system.kind", found, as_json)


def schema(
    of: Annotated[
        str,
        typer.Argument(
            metavar="[problem|sweep|plan]",
            help="Of what file.",
            autocompletion=lambda: list(_SCHEMAS),
        ),
    ] = "problem",
    as_json: Annotated[bool, typer.Option("--json", help="Accepted; the output is JSON.")] = False,
) -> int:
    """Print the JSON Schema of a problem, sweep or plan file, for editors and other programs.

    \b
    Examples:
      planner schema > problem.schema.json
      planner schema sweep > sweep.schema.json
      planner schema plan > plan.schema.json
    """
    if of not in _SCHEMAS:
        raise InputError(f"no schema of '{of}'; {nearest(of, list(_SCHEMAS))}")
    print_json(_SCHEMAS[of]())
    return 0


_SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "problem": json_schema,
    "sweep": sweep_schema,
    "plan": lambda: plan_schema(json_schema()),
}


def _list(what: str, found: dict[str, str], as_json: bool) -> int:
    if as_json:
        print_json(found)
        return 0
    listing = table(what, "what it is")
    for name, summary in found.items():
        listing.add_row(name, summary)
    print_text(listing)
    return 0


def _classes() -> dict[str, type[TriangularSystem]]:
    members = [getattr(planner.systems, name) for name in planner.systems.__all__]
    return {c.kind: c for c in members if hasattr(c, "kind")}


def _first_line(doc: str | None) -> str:
    return (doc or "").strip().partition("\n")[0].rstrip(".")
