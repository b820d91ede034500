"""A hundred random pairs of each family that users have: is collocation's answer there, how soon?

    python tests/benchmarks/families.py [--pairs 100] [--share 1/2] [--records FILE]

The families: arms of three and four joints within 40 and 80 degrees, each with a free duration and
with one that is given (1.02, 1.5 and 4 times the free answer, in turn). Whether a stage of the
search decides one case in a thousand is asked of each family by itself. A finished case is a line
of results/stress/families.txt; the same command goes on where the last one of the same code ended,
and a line that is deleted is made anew. At the end results/stress/families.md is written; beside an
earlier version with `--before FILE`, the records that that version wrote by this script.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from results_pages import begin_records, read_records
from stress_problems import PAIR_SEED, random_pair

import planner
from planner.support.package import release

FOLDER = Path(__file__).parents[2] / "results" / "stress"
FAMILIES = ((3, 40.0), (3, 80.0), (4, 40.0), (4, 80.0))
SHARES = (1.02, 1.5, 4.0)


@dataclass(frozen=True)
class Outcome:
    """A line of the records: seconds are of CPU, the motion is the duration or the effort."""

    joints: int
    limit_deg: float
    share: float
    number: int
    outcome: str
    stage: str
    cpu: float
    duration: float
    motion: float

    def __str__(self) -> str:
        figures = f"{self.cpu:.3g} {self.duration:.8g} {self.motion:.8g}"
        key = f"{self.joints} {self.limit_deg:g} {self.share:g} {self.number}"
        return f"{key} {self.outcome} {self.stage} {figures}"

    @property
    def key(self) -> tuple[int, float, float, int]:
        """Which case it is; share 0 is a free duration."""
        return self.joints, self.limit_deg, self.share, self.number

    @property
    def size(self) -> float:
        """What is compared between versions: the duration, or effort times duration."""
        return self.duration * (self.motion if self.share else 1.0)


def main() -> int:
    """Run what is not in the records yet, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=Path, default=FOLDER / "families.txt")
    parser.add_argument("--pairs", type=int, default=100, help="pairs of each family")
    parser.add_argument("--share", default="1/1", help="2/3: the second third, for three processes")
    parser.add_argument("--before", type=Path, help="records of an earlier version")
    given = parser.parse_args()
    part, parts = map(int, given.share.split("/"))
    planner.solve(planner.load_problem("problems/paper.toml"), "collocation")  # imports
    known = {each.key: each for each in read(begin_records("stress", given.records))}
    for number in range(part - 1, given.pairs, parts):
        for joints, limit in FAMILIES:
            free, share = known.get((joints, limit, 0.0, number)), SHARES[number % len(SHARES)]
            free = free or run(given.records, joints, limit, 0.0, number, None)
            if free.outcome == "verified" and (joints, limit, share, number) not in known:
                duration = round(free.duration * share, 6)
                run(given.records, joints, limit, share, number, duration)
    if given.records.name == "families.txt":
        last = {each.key: each for each in read(given.records)}  # of two of one case the later
        before = {each.key: each for each in read(given.before)} if given.before else {}
        text = page(list(last.values()), before)
        given.records.with_suffix(".md").write_text(text, encoding="utf-8")
    return 0


def read(path: Path) -> Iterator[Outcome]:
    """The records of a file."""
    for line in read_records(path):
        joints, limit, share, number, outcome, stage, cpu, seconds, motion = line.split()
        key = int(joints), float(limit), float(share), int(number)
        yield Outcome(*key, outcome, stage, float(cpu), float(seconds), float(motion))


def run(
    path: Path,
    joints: int,
    limit: float,
    share: float,
    number: int,
    duration: float | None,
) -> Outcome:
    """Plan a case and write it down; judging is not in the time."""
    tables = random_pair(joints, limit, number, duration or "free")
    problem, method = planner.Problem.from_dict(tables), planner.METHODS["collocation"]
    began, stage, figures = time.process_time(), "-", (float("nan"), float("nan"))
    try:
        plan = method.plan(problem, method.options())
        cpu = time.process_time() - began
        outcome = "verified" if planner.verify(plan).ok else "broken"
        stage, figures = plan.notes["stage"].replace(" ", "-"), (plan.duration, plan.objective)
    except planner.NoPlanError as error:
        outcome, cpu = error.status, time.process_time() - began
    done = Outcome(joints, limit, share, number, outcome, stage, cpu, *figures)
    with path.open("a", encoding="utf-8") as out:
        out.write(f"{done}\n")
    return done


HEAD = """# Random pairs by family

Made by `python tests/benchmarks/families.py`. Start and goal are drawn within 15/16 of the joint
limits; inputs up to 0.5 rad/s; collocation with its defaults; seed {seed}. "Given" durations are
1.02, 1.5 and 4 times the free answer, in turn. CPU s are those of the search in one thread.
Percentages are of the cases ordered: half, or 95 % of them, stay below. {done} of 100 pairs of each
family are done; the same command goes on. {release}.
"""


def page(now: Sequence[Outcome], before: dict[tuple[int, float, float, int], Outcome]) -> str:
    """All families, which stage decides, and the version before."""
    stages = list(dict.fromkeys(each.stage for each in now))
    rows, beside = [], []
    for joints, limit in FAMILIES:
        for kind in ("free", "given"):
            own = [e for e in now if (e.joints, e.limit_deg) == (joints, limit)]
            own = [e for e in own if (e.share > 0) == (kind == "given")]
            if not own:
                continue
            name = [joints, f"{limit:g}°", kind]
            count = Counter(each.stage for each in own)
            solved = sum(each.outcome == "verified" for each in own)
            cpu = np.percentile([each.cpu for each in own], [50, 95, 100])
            figures = [f"{value:.3g}" for value in cpu]
            rows.append([*name, len(own), solved, *figures, *(count[s] for s in stages)])
            both = [(before[e.key], e) for e in own if e.key in before]
            lost = sum(a.outcome == "verified" != b.outcome for a, b in both)
            won = sum(b.outcome == "verified" != a.outcome for a, b in both)
            if not both:
                continue
            spent = sum(b.cpu for _, b in both) / sum(a.cpu for a, _ in both)
            sizes = [b.size / a.size for a, b in both if a.outcome == b.outcome == "verified"]
            old, new = (np.median([pair[k].cpu for pair in both]) for k in (0, 1))
            ratio = np.percentile(sizes, [5, 50, 95])
            figures = [f"{old:.3g} → {new:.3g}", f"{spent:.2f}", *(f"{r:.3f}" for r in ratio)]
            beside.append([*name, len(both), won, lost, *figures])
    done = min(sum(e.key[:3] == (*f, 0.0) for e in now) for f in FAMILIES)
    text = HEAD.format(seed=PAIR_SEED, done=done, release=release()) + "\n"
    text += table(
        ["joints", "limit", "duration", "pairs", "verified", "CPU 50 %", "95 %", "most", *stages],
        rows,
    )
    if beside:
        text += (
            "\n## Beside the version before\n\nThe same pairs (given durations are those of each"
            " version's own free answer). Ratios below one are shorter, or of less effort times"
            " duration.\n\n"
        )
        columns = "joints|limit|duration|pairs|solved now only|before only|CPU s 50 %|all CPU"
        columns += "|motion 5 %|50 %|95 %"
        text += table(columns.split("|"), beside)
    return text


def table(names: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Rows as Markdown."""
    lines = [names, ["---"] * len(names), *([str(c) for c in row] for row in rows)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
