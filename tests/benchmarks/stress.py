"""A campaign over random problems: does collocation always answer, how well, how soon?

    python tests/benchmarks/stress.py [--first n2:150,n3:150 | --all] [--minutes 30] [--share 1/2]

Each finished case is a line of results/stress/records.txt, written at once; the same command goes
on where the last one of the same code ended. Cases come in one order, in which all families, kinds
and numbers of joints are mixed from the beginning: what has been run is at any time a fair sample.
At the end results/stress/README.md is written; `--minutes 0` does only that. `--all` runs 5,000
problems (hours); without it the first of each group are run (a quarter of an hour).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from results_pages import begin_records, read_records
from stress_problems import GROUPS, SEED, Case, data, order

import planner
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "results" / "stress"
RECORDS = FOLDER / "records.txt"
FIRST = "n2:150,n3:150,n4:40,n5:4,systems:30"
"""So many problems of each group are run if nothing else is asked for."""

CUT = {"n5": 1800.0, "n6": 1800.0}
"""Seconds granted to a case."""

ANSWERS = ("verified", "infeasible")


@dataclass(frozen=True)
class Record:
    """A line of the records: CPU seconds of the search, duration in s, value of the objective."""

    case: Case
    outcome: str
    stage: str
    cpu: float
    duration: float
    objective: float
    why: str = ""

    def __str__(self) -> str:
        c = self.case
        key = f"{c.group} {c.family} {c.kind} {c.number}"
        figures = f"{self.cpu:.3g} {self.duration:.6g} {self.objective:.6g}"
        return f"{key} {self.outcome} {self.stage} {figures} {self.why}".rstrip()

    @property
    def motion(self) -> float:
        """What is compared: the duration where it is free, the effort where it is given."""
        return self.duration if self.case.share is None else self.objective


Records = dict[Case, Record]


def main() -> int:
    """Run what is not in the records yet, as far as asked for, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=np.inf, help="no case begins later")
    parser.add_argument("--share", default="1/1", help="2/3: the second third, for three processes")
    parser.add_argument("--first", default=FIRST, help="so many of each group, as n2:100,n4:20")
    parser.add_argument("--all", action="store_true", help="5,000 problems (hours)")
    given = parser.parse_args()
    part, parts = map(int, given.share.split("/"))
    most = dict(word.split(":") for word in given.first.split(","))
    end, known = time.monotonic() + 60 * given.minutes, read(begin_records("stress", RECORDS))
    if given.minutes > 0:  # what is imported when first used is in no case's time
        planner.solve(planner.load_problem(ROOT / "problems" / "paper.toml"), "collocation")
    begun = Counter[str]()
    for case in order():
        begun[case.group] += 1
        chosen = given.all or begun[case.group] <= int(most.get(case.group, 0))
        if chosen and case.number % parts == part - 1 and time.monotonic() < end:
            run(case, known)
    (FOLDER / "README.md").write_text(page([*read(RECORDS).values()]), encoding="utf-8")
    return 0


def run(case: Case, known: Records) -> None:
    """Plan a case unless that is done, and write it down; a given duration is looked up first."""
    if case in known:
        return
    duration = None
    if case.share:
        free = Case(case.group, case.family, "plain", case.number)
        run(free, known)
        if known[free].outcome != "verified":
            return  # there is no shortest duration to give
        duration = round(known[free].duration * case.share, 6)
    known[case] = Record(case, *measured(case, duration))
    with RECORDS.open("a", encoding="utf-8") as out:
        out.write(f"{known[case]}\n")


def read(path: Path) -> Records:
    """Records by case; of several of one case the last."""
    out: Records = {}
    for line in read_records(path):
        group, family, kind, number, outcome, stage, *rest = line.split(" ", 9)
        cpu, duration, objective = map(float, rest[:3])
        case = Case(group, family, kind, int(number))
        out[case] = Record(case, outcome, stage, cpu, duration, objective, "".join(rest[3:]))
    return out


def measured(case: Case, duration: float | None) -> tuple[str, str, float, float, float, str]:
    """What a record says after its case. Judging is not in the time."""
    method, options = planner.METHODS["collocation"], dict[str, Any]()
    if case.group in CUT:
        options["time_limit_s"] = CUT[case.group]
    cpu, began, known = float("nan"), time.process_time(), duration or float("nan")
    try:
        problem = planner.Problem.from_dict(data(case, duration))
        began = time.process_time()
        plan = method.plan(problem, method.options(**options))
        cpu = time.process_time() - began
        check = planner.verify(plan)
        planner.certify(plan)
    except planner.NoPlanError as error:
        cpu = time.process_time() - began
        return error.status, "refusal", cpu, known, float("nan"), in_one_line(error)
    except Exception as error:  # a bug is a result too
        return "bug", "-", cpu, known, float("nan"), in_one_line(error)
    stage = plan.notes.get("stage", "-").replace(" ", "-")
    why = "; ".join(map(str, check.violations))
    outcome = "broken" if why else "verified" if plan.status == "solved" else plan.status
    return outcome, stage, cpu, plan.duration, plan.objective, why


def in_one_line(error: Exception) -> str:
    """An error in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]


HEAD = """# Random problems

{done} of {asked} problems are done: arms with two to six joints in five families,
a third each plain, with narrow joint limits and with a given duration, and trailers, ball gears and
custom systems (seed {seed}; how they are drawn: `tests/benchmarks/stress_problems.py`).
By number of joints and
system: {groups}.

Method: collocation with its defaults but no time limit (by default 60 CPU s), all by one
version. Every case should end verified, or
refused with a proof that there is no motion: **{verified} of {done} verified**, {proven} refused
with a proof, {failed} failed, in {cpu:.0f} CPU s of search.
Times are of the search alone, in CPU s of one thread; on a busy machine those of one case scatter
by a factor of two. "Motion" is the duration
in s where it is free, the effort in rad²/s (or what the inputs have) where it is given.
Percentages are of the cases ordered: half, or 95 % of them, stay below.
Pairs of families that users have: [families.md](families.md).

{provenance}
"""


def page(cases: Sequence[Record]) -> str:
    """All that is known, as Markdown."""
    count = Counter(r.outcome for r in cases)
    failed = [r for r in cases if r.outcome not in ANSWERS]
    groups = Counter(r.case.group for r in cases)
    head = HEAD.format(
        done=len(cases),
        asked=sum(3 * len(families) * many for families, many, _ in GROUPS.values()),
        groups=", ".join(f"{groups[name]} {name}" for name in GROUPS if groups[name]),
        seed=SEED,
        verified=count["verified"],
        proven=count["infeasible"],
        failed=len(failed),
        cpu=sum(r.cpu for r in cases),
        provenance=provenance("python tests/benchmarks/stress.py"),
    )
    parts = [head, _stages(cases), _families(cases)]
    if failed:
        each = (f"- {_name(r.case)}: {r.outcome}. {r.why}" for r in failed)
        parts.append("## Failed\n\n" + "\n".join(each) + "\n")
    return "\n".join(parts)


def _stages(cases: Sequence[Record]) -> str:
    stages = list(dict.fromkeys(r.stage for r in cases))
    rows = [
        [*name, *(sum(r.stage == stage for r in group) for stage in stages)]
        for name, group in _grouped(cases, lambda c: (c.group, "given" if c.share else c.kind))
    ]
    return "## Which stage decides\n\n" + _table("|".join(["system", "kind", *stages]), rows)


def _families(cases: Sequence[Record]) -> str:
    columns = "system|family|kind|verified|proof|failed|motion 50 %|95 %|CPU s 50 %|95 %|longest"
    rows = []
    for name, group in _grouped(
        cases, lambda c: (c.group, c.family, "given" if c.share else c.kind)
    ):
        solved, proven = ([r for r in group if r.outcome == outcome] for outcome in ANSWERS)
        failed = len(group) - len(solved) - len(proven)
        motion = np.percentile([r.motion for r in solved] or [np.nan], [50, 95])
        cpu = np.nanpercentile([r.cpu for r in group], [50, 95, 100])
        figures = [f"{value:.3g}" for value in (*motion, *cpu)]
        rows.append([*name, len(solved), len(proven), failed, *figures])
    return "## Each family\n\n" + _table(columns, rows)


def _grouped(records: Iterable[Record], key: Any) -> Iterator[tuple[Any, list[Record]]]:
    """Records by key, in the order of the groups and their families."""
    where = {(g, f): (i, j) for i, g in enumerate(GROUPS) for j, f in enumerate(GROUPS[g][0])}
    found: dict[Any, list[Record]] = {}
    for r in sorted(records, key=lambda r: (where[r.case.group, r.case.family], r.case.kind)):
        found.setdefault(key(r.case), []).append(r)
    return iter(found.items())


def _name(case: Case) -> str:
    return f"{case.group} {case.family} {case.kind} {case.number}"


def _table(columns: str, rows: Sequence[Sequence[object]]) -> str:
    names = columns.split("|")
    lines = [names, ["---"] * len(names), *([str(c) for c in row] for row in rows)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
