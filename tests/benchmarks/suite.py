"""Every method on every shipped problem: solved and verified, or refused with a reason.

python tests/benchmarks/suite.py            # writes results/suite/README.md
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import planner
from planner import InputError, NoPlanError
from planner.report.result_folder import folder
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
HEAD = """# Every method on every problem

Each cell is a verified plan (its travel, and whether it turns back), or the kind of refusal; the
reasons follow below.

"""


def main() -> int:
    """Run all pairs, print and write the table."""
    paths = sorted((ROOT / "problems").glob("*.toml"))
    names = list(planner.METHODS)
    rows, reasons = [], []
    for path in paths:
        problem = planner.load_problem(path)
        cells = []
        for name in names:
            began = time.perf_counter()
            cell, reason = _outcome(problem, name)
            took = time.perf_counter() - began
            print(f"{path.stem:14} {name:15} {cell:24} {took:6.2f} s", file=sys.stderr, flush=True)
            cells.append(cell)
            if reason:
                reasons.append(f"- **{path.stem}, {name}**: {reason}")
        rows.append([f"{path.stem} ({problem.system.kind})", *cells])
    table = [["problem", *names], ["---"] * (len(names) + 1), *rows]
    lines = ["| " + " | ".join(row) + " |" for row in table]
    text = HEAD + "\n".join([provenance("make suite"), "", *lines])
    text += "\n\n## Why not\n\n" + "\n".join(reasons) + "\n"
    with folder(ROOT / "results" / "suite") as place:
        (place / "README.md").write_text(text, encoding="utf-8")
    return 0


def _outcome(problem: planner.Problem, name: str) -> tuple[str, str]:
    try:
        plan = planner.solve(problem, name)
    except NoPlanError as error:
        reason = error.reason.split(": ", 1)[-1].replace("\n", " ")
        broken = "; ".join(str(v) for v in error.violations[:2])
        return error.status.replace("_", " "), f"{reason}{': ' if broken else ''}{broken}"
    except InputError as error:
        return "bad input", str(error).split(": ", 1)[-1].replace("\n", " ")
    assert plan.verified
    return f"travel {plan.travel:.4g}", ""


if __name__ == "__main__":
    raise SystemExit(main())
