"""`planner methods`, `planner systems` and `planner schema`: what there is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from planner.cli.arguments import Json
from planner.cli.output import print_json, print_text, table
from planner.errors import InputError
from planner.methods import METHODS
from planner.schema import json_schema, nearest
from planner.schema.plan import plan_schema
from planner.schema.sweep import sweep_schema

SYSTEMS = {
    "manipulator": "arm of n joints and two motors, driven through friction disks (the paper's)",
    "ball-gear": "arm of n joints and two motors, driven through ball gears (Nakamura)",
    "unicycle": "robot with two driven wheels",
    "car": "car, driven at its rear axle and steered at the front",
    "trailers": "car with trailers, each hitched on the axle before it",
    "custom": "any triangular two-input system, given by its expressions",
}
"""Every `system.kind` with one line on it."""


def methods(as_json: Json = False) -> int:
    """List the methods that make plans, one line each.

    \b
    Example:
      planner methods
    """
    found = {name: method.summary for name, method in METHODS.items()}
    return _list("method", found, as_json)


def systems(as_json: Json = False) -> int:
    """List the systems that can be steered, one line each.

    \b
    Example:
      planner systems
    """
    return _list("system.kind", SYSTEMS, as_json)


def schema(
    of: Annotated[
        str,
        typer.Argument(
            metavar="problem|sweep|plan",
            help="Of what file.",
            autocompletion=lambda: list(_SCHEMAS),
        ),
    ] = "problem",
    as_json: Annotated[bool, typer.Option("--json", help="Accepted; the output is JSON.")] = False,
) -> int:
    """Print the JSON Schema of a problem, sweep or plan file.

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
