"""`planner sensitivity --pareto`: a curve of plans, kept point by point."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from planner.cli.arguments import read_problem
from planner.cli.output import note, print_json, print_text, progress_bar, table
from planner.cli.plan import number
from planner.cli.sweep import Interrupted
from planner.errors import InputError
from planner.files import write_bytes
from planner.interrupts import Terminated
from planner.pareto import TradeOff, trade_off
from planner.pareto.axis import KINDS

PICTURE = "trade-off.png"


def run_trade_off(
    source: Path,
    kind: str,
    points: int,
    drawn: tuple[int, int],
    *,
    changes: list[str] | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Trace the curve and print it.

    Raises:
        InputError: If an argument is wrong.
        NoPlanError: If the problem has no plan.
        Interrupted: After Ctrl-C; what is finished is kept.
    """
    if kind not in KINDS:
        raise InputError(f"--pareto {kind}: must be one of {', '.join(KINDS)}")
    if out is None:
        raise InputError("--pareto keeps a plan for each point; say where with --out FOLDER")
    if source.suffix.lower() == ".json":
        raise InputError(f"{source} is a plan; --pareto needs a problem file")
    problem = read_problem(source, changes)
    named = next(k for k in KINDS if k == kind)
    try:
        with progress_bar() as progress:
            curve = trade_off(
                problem, named, points, out, samples=drawn[0], seed=drawn[1], progress=progress
            )
            write_bytes(out / PICTURE, picture(curve))
    except (KeyboardInterrupt, Terminated):
        raise Interrupted(f"finished points are in {out}") from None
    if as_json:
        print_json({**curve.to_dict(), "written": str(out), "exit_status": 0})
    else:
        print_text(f"{problem.name}: least sensitivity against {kind}", "", _table(curve), "")
        print_text(_knee(curve))
    note(f"written to {out}")
    return 0


def picture(curve: TradeOff) -> bytes:
    """The curve's figure as PNG."""
    from io import BytesIO

    stream = BytesIO()
    curve.figure().savefig(stream, format="png", dpi=110)
    return stream.getvalue()


def _table(curve: TradeOff) -> Table:
    heads = ["", ">effort", ">duration", *(f">|{u.name}|" for u in curve.problem.system.inputs)]
    heads += [">total (deg)", ">passive (deg)", ">reversals", ">errors alone 95 % (deg)"]
    listing = table(*heads, ">machine 95 % (deg)")
    for k, p in enumerate(curve.points):
        cells = [p.effort, p.duration_s, *p.peak_u, p.total_deg, p.passive_deg]
        runs = [
            None if found is None else float(found["terminal_p95_deg"])
            for found in (p.errors_alone, p.machine)
        ]
        listing.add_row(
            "knee" if k == curve.knee_index else "",
            *(number(v) for v in cells),
            str(p.reversals),
            *(number(v) for v in runs),
        )
    return listing


def _knee(curve: TradeOff) -> str:
    first, k = curve.points[0], curve.knee
    return (
        f"The knee, farthest below the chord between the curve's ends: passive block"
        f" {number(k.passive_deg)} deg instead of {number(first.passive_deg)}, total"
        f" {number(k.total_deg)} instead of {number(first.total_deg)}"
        f" (irreducible {number(k.floor_deg)}).\nErrors are the largest joint error at the end:"
        " under the design errors alone, and on the problem's machine."
    )
