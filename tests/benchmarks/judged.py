"""Random plans, and damaged ones, judged by planner and by an integrator of the tests' own.

    python tests/benchmarks/judged.py [--plans 200] [--damages 500] [--seed 25]

Writes results/judging/outside.md. `outside_judge.py` has the other judge and the damages.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from outside_judge import OUTCOMES, campaign

from planner.support.package import provenance

ROOT = Path(__file__).parents[2]

HEAD = """# Plans judged from outside

{plans} plans of random problems (two or three joints; collocation, polynomial, piecewise,
convex; three in ten retimed) and {damages} damaged files, by little or much, seed {seed}. Each was
judged by `load_plan` and by DOP853 with samples of everything that is limited; both read the
plan's u(t) and the system's NumPy kinematics, and share nothing else. *No form*: refused before
there was a motion to judge, with the reason. *Too close*: within a fifth of a tolerance.

{provenance}

"""


def main() -> int:
    """Judge, write the table, and say what the judges disagree about."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plans", type=int, default=200)
    parser.add_argument("--damages", type=int, default=500)
    parser.add_argument("--seed", type=int, default=25)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tally, told = campaign(given.plans, given.damages, given.seed, Path(folder))
    rows = [["judged", *OUTCOMES], ["---"] * (1 + len(OUTCOMES))]
    names = list(dict.fromkeys(name for name, _ in tally))
    rows += [[name, *(str(tally[name, each]) for each in OUTCOMES)] for name in names]
    sums = [sum(tally[name, each] for name in names) for each in OUTCOMES]
    rows.append(["**all**", *(f"**{each}**" for each in sums)])
    head = HEAD.format(**vars(given), provenance=provenance("python tests/benchmarks/judged.py"))
    text = head + "\n".join("| " + " | ".join(row) + " |" for row in rows)
    text += "\n" + "".join(f"\n- {line}" for line in told) + "\n" * bool(told)
    (ROOT / "results" / "judging" / "outside.md").write_text(text, encoding="utf-8")
    print(text)
    return int(bool(told))


if __name__ == "__main__":
    sys.exit(main())
