"""`planner reproduce`: the paper's figures and numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Json
from planner.cli.output import note, print_json, print_text, progress_bar, table
from planner.reproduce import reproduce as run_reproduction


def reproduce(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="Where figures and page go.")
    ] = Path("results/paper"),
    samples: Annotated[
        int, typer.Option("--samples", "-n", min=1, help="Machines for Figs 9 and 10.")
    ] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the machines.")] = 0,
    as_json: Json = False,
) -> int:
    """Regenerate the paper's figures and check its printed numbers.

    \b
    Example:
      planner reproduce --out results/paper
    """
    with progress_bar() as progress:
        made = run_reproduction(out, samples, seed, progress)
    if as_json:
        rows = [vars(f) for f in made.findings]
        print_json({"written": str(made.path), "seed": seed, "samples": samples, "findings": rows})
        return 0
    listing = table("where", "printed", "ours", "verdict")
    for f in made.findings:
        listing.add_row(f.where, f.printed, f.ours, f.verdict)
    print_text(listing)
    note(f"written to {made.path}")
    return 0
