"""A campaign over 5,000 random problems: does collocation always answer, how well, how soon?

    python tests/benchmarks/stress.py [--minutes 30] [--share 1/2] [--first n2:100,n4:20 | --failed]

Each finished case is a line of results/stress/now.txt, written at once; the same command goes on
where the last one ended, in this session or a later one. Cases come in one order, in which all
families, kinds and numbers of joints are mixed from the beginning (two and three joints are done
at 15 % of it): what has been run is at any time a fair sample. A case that failed is run again
by another version. At the end results/stress/README.md is written; `--minutes 0` does only that.

`--sample` runs the first problems of that order anew, all by this version, in less than an hour;
its records are results/stress/sample.txt.

An older version measures itself on the same problems, by this script and its own interpreter:

    OLD/.venv/bin/python tests/benchmarks/stress.py --records results/stress/before.txt
        --like results/stress/now.txt --first n2:150,n3:150,n4:40,n5:8,systems:30
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from stress_problems import GROUPS, RANDOM_STARTS, SEED, Case, data, order

import planner

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "results" / "stress"
SAMPLE = "n2:150,n3:150,n4:40,systems:30"
"""So many problems of each group are run by `--sample`."""

CUT = {"n5": 1800.0, "n6": 1800.0}
"""Seconds granted to a case, where the version knows time limits."""

ANSWERS = ("verified", "infeasible")
WORSE, SLOWER, SHORTER, WITHIN = 1.1, 1.3, 0.9, 1.02


@dataclass(frozen=True)
class Record:
    """A line of the records: CPU seconds of the search, duration in s, value of the objective."""

    version: str
    case: Case
    outcome: str
    stage: str
    cpu: float
    duration: float
    objective: float
    why: str = ""

    def __str__(self) -> str:
        c = self.case
        key = f"{self.version} {c.group} {c.family} {c.kind} {c.number}"
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
    parser.add_argument("--records", type=Path, default=FOLDER / "now.txt")
    parser.add_argument("--minutes", type=float, default=np.inf, help="no case begins later")
    parser.add_argument("--share", default="1/1", help="2/3: the second third, for three processes")
    parser.add_argument("--first", default="", help="only so many of each group, as n2:100,n4:20")
    parser.add_argument("--failed", action="store_true", help="only what other versions failed")
    parser.add_argument("--like", type=Path, help="only what was verified there, and page left out")
    parser.add_argument("--sample", action="store_true", help=f"{SAMPLE}, by this version alone")
    given = parser.parse_args()
    if given.sample:
        given.records, given.first = FOLDER / "sample.txt", SAMPLE
    part, parts = map(int, given.share.split("/"))
    most = dict(word.split(":") for word in given.first.split(",") if word)
    end, version = time.monotonic() + 60 * given.minutes, commit()
    if given.minutes > 0:  # what is imported when first used is in no case's time
        planner.solve(planner.load_problem(ROOT / "problems" / "paper.toml"), "collocation")
    known, other = read(given.records), read(given.like) if given.like else None
    if given.sample:
        known = {case: record for case, record in known.items() if record.version == version}
    begun = Counter[str]()
    for case in order():
        if other is not None and case.kind == "random":
            continue
        begun[case.group] += 1
        chosen = not most or begun[case.group] <= int(most.get(case.group, 0))
        if given.failed:
            chosen = case in known and known[case].outcome not in ANSWERS
        if chosen and case.number % parts == part - 1 and time.monotonic() < end:
            run(case, version, given.records, known, other)
    if other is None:
        now, before, few = (
            given.records.with_name(f"{a}.txt") for a in ("now", "before", "sample")
        )
        text = page(read(now), read(before), failures(now), [*lines(few)])
        given.records.with_name("README.md").write_text(text, encoding="utf-8")
    return 0


def commit() -> str:
    """What the version under test is called: its commit, or else its number."""
    asked = ["git", "-C", str(Path(planner.__file__).parent), "rev-parse", "--short=7", "HEAD"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    return found.stdout.strip() or planner.__version__


def run(case: Case, version: str, path: Path, known: Records, other: Records | None) -> None:
    """Plan a case unless that is done, and write it down; a given duration is looked up first.

    With the records of another version, only what was verified there, in the same duration.
    """
    if case in known and (known[case].outcome in ANSWERS or known[case].version == version):
        return
    duration = None
    if other is not None:
        if case not in other or other[case].outcome != "verified":
            return
        duration = other[case].duration if case.share else None
    elif case.share:
        free = Case(case.group, case.family, "plain", case.number)
        run(free, version, path, known, None)
        if known[free].outcome != "verified":
            return  # there is no shortest duration to give
        duration = round(known[free].duration * case.share, 6)
    known[case] = Record(version, case, *measured(case, duration))
    with path.open("a", encoding="utf-8") as out:
        out.write(f"{known[case]}\n")


def read(path: Path) -> Records:
    """Records by case; of several of one case the last."""
    return {record.case: record for record in lines(path)}


def failures(path: Path) -> list[Record]:
    """All that any version failed, also where a later one did not."""
    return [record for record in lines(path) if record.outcome not in ANSWERS]


def lines(path: Path) -> Iterator[Record]:
    """The records in the order in which they were written."""
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        version, group, family, kind, number, outcome, stage, *rest = line.split(" ", 10)
        cpu, duration, objective = map(float, rest[:3])
        case = Case(group, family, kind, int(number))
        why = "".join(rest[3:])
        yield Record(version, case, outcome, stage, cpu, duration, objective, why)


def measured(case: Case, duration: float | None) -> tuple[str, str, float, float, float, str]:
    """What a record says after its case. Judging is not in the time."""
    method, options = planner.METHODS["collocation"], dict[str, Any]()
    if case.kind == "random":
        options = {"start": "wander", "starts": RANDOM_STARTS, "attempts": RANDOM_STARTS}
    if case.group in CUT and "time_limit_s" in method.options.model_fields:
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

{done} of {asked} problems of `make stress` are done: arms with two to six joints in five families,
a third each plain, with narrow joint limits and with a given duration, and trailers, ball gears and
custom systems (seed {seed}; how they are drawn: `tests/benchmarks/stress_problems.py`). The order
mixes them, so that what is done is a fair sample; `make stress` goes on. Records: `now.txt`, and
`before.txt` of the version before.

Method: collocation with its defaults. Every case should end verified, or refused with a proof
that there is no motion: **{verified} verified, {proven} refused with a proof, {failed} failed**,
after {mended} that failed were mended (at the end of this page).
Times are of the search alone, in CPU s of one thread; on a busy machine those of one case scatter
by a factor of two. "Motion" is the duration
in s where it is free, the effort in rad²/s (or what the inputs have) where it is given.
Percentages are of the cases ordered: half, or 95 % of them, stay below.

Versions: {versions}. Each case is of one of them, and the counts add up all.
"""


KNOWN = """Each is run again by `python tests/benchmarks/stress.py --failed`. A given duration is so
many times the free answer of the version that was first asked: a motion that takes it exists, also
where a later version refuses it.
"""


def page(
    now: Records, before: Records, failed: Sequence[Record], few: Sequence[Record] = ()
) -> str:
    """All that is known, as Markdown; `few` are the records of samples."""
    cases = [r for r in now.values() if r.case.kind != "random"]
    count = Counter(r.outcome for r in cases)
    head = HEAD.format(
        done=len(cases),
        asked=sum(3 * len(families) * many for families, many, _ in GROUPS.values()),
        seed=SEED,
        verified=count["verified"],
        proven=count["infeasible"],
        failed=len(cases) - count["verified"] - count["infeasible"],
        mended=len({r.case for r in failed if now[r.case].outcome in ANSWERS}),
        versions=", ".join(
            f"{name} ({many} cases)"
            for name, many in Counter(r.version for r in [*cases, *before.values()]).items()
        ),
    )
    parts = [head, _sample(few), _compared(cases, before), _random(now), _stages(cases)]
    parts.append(_families(cases))
    if failed:
        each = (
            f"- {_name(r.case)}: {r.outcome} by {r.version}, {now[r.case].outcome} by"
            f" {now[r.case].version}. {r.why}"
            for r in failed
        )
        title = f"## Failed, by any version of the campaign\n\n{KNOWN}\n"
        parts.append(title + "\n".join(each) + "\n")
    return "\n".join(part for part in parts if part)


def _sample(few: Sequence[Record]) -> str:
    """What the version that ran the sample last found, alone."""
    if not few:
        return ""
    version = few[-1].version
    ran = {r.case: r for r in few if r.version == version and r.case.kind != "random"}.values()
    groups = Counter(r.case.group for r in ran)
    names = {"n2": "two joints", "n3": "three", "n4": "four", "systems": "other systems"}
    of = ", ".join(f"{many} of {names[group]}" for group, many in sorted(groups.items()))
    verified = sum(r.outcome == "verified" for r in ran)
    rest = [f"- {_name(r.case)}: {r.outcome}. {r.why}" for r in ran if r.outcome != "verified"]
    return (
        "## By one version\n\n`python tests/benchmarks/stress.py --sample` runs the first problems"
        f" of the same order anew ({of}): **{verified} of {len(ran)} verified** by {version}, in"
        f" {sum(r.cpu for r in ran):.0f} CPU s of search.\n"
        + "\n".join(["", *rest])
        + "\n" * bool(rest)
    )


def _compared(cases: Sequence[Record], before: Records) -> str:
    """Both versions on the same problems."""
    columns = (
        "system|family|compared|motion 50 %, before → now|95 %|ratio 50 %|largest"
        "|CPU s 50 %, before → now|95 %|all CPU, ratio|claim"
    )
    rows, worst, broken = [], [], 0
    for name, group in _grouped(cases, lambda c: (c.group, c.family)):
        both = [(before[r.case], r) for r in group if r.case in before]
        both = [p for p in both if p[0].outcome == p[1].outcome == "verified"]
        if not both:
            continue
        ratio = np.array([new.motion / old.motion for old, new in both])
        spent = sum(new.cpu for _, new in both) / sum(old.cpu for old, _ in both)
        motion, cpu = (
            [np.percentile([getattr(p[k], what) for p in both], [50, 95]) for k in (0, 1)]
            for what in ("motion", "cpu")
        )
        middle = float(np.median(ratio))
        said = ["longer"] if middle > WORSE else []
        said += ["slower"] if spent > SLOWER and middle > SHORTER else []
        verdict, broken = " and ".join(said) or "kept", broken + bool(said)
        figures = [
            *(f"{motion[0][k]:.3g} → {motion[1][k]:.3g}" for k in (0, 1)),
            *(f"{middle:.3f}", f"{ratio.max():.3f}"),
            *(f"{cpu[0][k]:.3g} → {cpu[1][k]:.3g}" for k in (0, 1)),
            *(f"{spent:.2f}", verdict),
        ]
        rows.append([*name, len(both), *figures])
        worst += [(r, *p) for r, p in zip(ratio, both, strict=True) if r > WORSE]
    if not rows:
        return ""
    lost = [r for r in cases if r.case in before and r.outcome not in ANSWERS]
    won = [r for r in cases if r.case in before and before[r.case].outcome not in ANSWERS]
    total = sum(int(row[2]) for row in rows)
    text = (
        f"## Beside the version before\n\n{total} problems verified by both. {len(won)} that failed"
        f" before, {len(lost)} that fail now. Claim: in no family motions are more than 10 %"
        " longer in the median, and none takes more than 1.3 times as long without being 10 %"
        f" shorter. Broken in {broken} of {len(rows)}.\n\n"
    )
    each = [
        f"- {_name(new.case)}: {old.motion:.4g} → {new.motion:.4g} ({ratio:.3f}) in"
        f" {old.cpu:.3g} → {new.cpu:.3g} CPU s, by {new.stage}"
        for ratio, old, new in sorted(worst, key=lambda each: -each[0])
    ]
    more = f"\n{len(each)} of {total} more than 10 % longer or of more effort:\n\n"
    return text + _table(columns, rows) + more + "\n".join(each) + "\n"


def _random(now: Records) -> str:
    """Beside the best of the random starts."""
    columns = "system|family|compared|no worse than 2 %|ratio 50 %|largest|CPU s, ratio"
    rows, good, total = [], 0, 0
    drawn = [r for r in now.values() if r.case.kind == "random" and r.outcome == "verified"]
    for name, group in _grouped(drawn, lambda c: (c.group, c.family)):
        plain = [Case(r.case.group, r.case.family, "plain", r.case.number) for r in group]
        both = [(now[c], r) for c, r in zip(plain, group, strict=True) if c in now]
        ratio = np.array([a.objective / r.objective for a, r in both if a.outcome == "verified"])
        if not len(ratio):
            continue
        within = int(np.sum(ratio <= WITHIN))
        good, total = good + within, total + len(ratio)
        spent = sum(a.cpu for a, _ in both) / sum(r.cpu for _, r in both)
        figures = [f"{np.median(ratio):.3f}", f"{ratio.max():.3f}", f"{spent:.2f}"]
        rows.append([*name, len(ratio), within, *figures])
    if not rows:
        return ""
    text = f"{good} of {total} no worse than 2 % (ratio: the search's motion over their best).\n\n"
    return f"## Against the best of {RANDOM_STARTS} random starts\n\n{text}{_table(columns, rows)}"


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
