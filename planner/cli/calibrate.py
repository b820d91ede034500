"""`planner calibrate`: the prototype preset from what the paper says."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.calibration import FITTED, Calibration, write
from planner.calibration import calibrate as run_calibration
from planner.calibration.statements import STATEMENTS
from planner.cli.arguments import Json
from planner.cli.output import note, print_json, print_text, progress_bar, table
from planner.files import refuse_unwritable_folder


def calibrate(
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FOLDER", help="Also write page and figure there."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the machines.")] = 0,
    as_json: Json = False,
) -> int:
    """Fit the emulated prototype to the paper's experiment.

    Says too what the paper cannot tell.

    \b
    Example:
      planner calibrate --out results/calibration
    """
    if out is not None:
        refuse_unwritable_folder(out)
    with progress_bar() as progress:
        found = run_calibration(progress, seed)
        if out is not None:
            progress("writing", 0.95)
            write(found, out)
    if as_json:
        print_json({**found.to_dict(), "written": str(out) if out else None})
        return 0
    _show(found)
    if out is not None:
        note(f"written to {out}")
    return 0


def _show(found: Calibration) -> None:
    listing = table("parameter", ">low", ">high", ">preset", *(f">{d.name}" for d in found.data))
    for i, r in enumerate(FITTED):
        left = [f"{d.left[i]:.2f}" for d in found.data]
        value = f"{found.fit.parameters[r.name]:g}"
        listing.add_row(r.name, f"{r.low:g}", f"{r.high:g}", value, *left)
    print_text(listing)
    for s, value in zip(STATEMENTS, found.fit.found, strict=True):
        print_text(f"{s.text}: {value:.2f} {s.unit} (target {s.target:g})")
    print_text("last columns: part of the range that is left, knowing that; 1 = not identifiable")
