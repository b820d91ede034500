"""Do the tests see it when the code is wrong? Mutants of the parts that trust rests on.

    python tests/benchmarks/mutants.py [--count N] [--seed S] [--groups judge,machine]

cosmic-ray changes one operator, comparison or number at a time in a clone of the last commit (under
out/, so that nothing here is touched) and runs the tests of that part. A seeded sample of all
mutants is run, as many from each part; about five seconds each where the tests see it, half a
minute to two where they do not. Writes README.md with every survivor to the folder.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import sqlite3
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import track

ROOT = Path(__file__).parents[2]
WORK = ROOT / "out" / "mutants"
CLONE = WORK / "clone"
MOST_S = 300
"""Seconds after which the tests of a mutant are ended; it counts as seen, since it hangs."""

EQUIVALENT = "core/ReplaceBinaryOperator_BitOr_"
"""Changes `X | None` in annotations, which nothing reads while the program runs."""

GROUPS = {
    "judge": (
        ["verification/verify.py", "plan/quadrature.py"],
        "tests/verification/test_verify.py tests/verification/test_judging.py",
    ),
    "certificate": (
        [
            f"verification/{name}.py"
            for name in [
                "affine_models",
                "balls",
                "cells",
                "certify",
                "enclosure",
                "functions",
                "input_models",
                "requirements_proven",
            ]
        ],
        "tests/verification",
    ),
    "requirements": (
        ["problem/requirements/limits.py", "problem/requirements/places.py"],
        "tests/problem/test_requirements.py tests/verification/test_verify.py"
        " tests/methods/collocation/test_places.py",
    ),
    "chained form": (["systems/chained_form.py"], "tests/systems"),
    "systems": (
        [
            f"systems/{name}.py"
            for name in ["manipulator", "ball_gear", "vehicles", "custom", "triangular_system"]
        ],
        "tests/systems tests/problem/test_problem_files.py tests/problem/test_problem.py",
    ),
    "machine": (
        [
            f"machine/{name}.py"
            for name in [
                "bodies",
                "commands",
                "disk_chain",
                "machine",
                "march",
                "servos",
                "simulate",
                "stepwise",
            ]
        ],
        "tests/machine",
    ),
}
"""For each part its files, and the tests that are to see a mutant of them."""


@dataclass(frozen=True)
class Mutant:
    """One change and what became of it.

    Attributes:
        group: The part.
        seen: Whether a test failed.
        place: File and line.
        diff: The changed lines.
    """

    group: str
    seen: bool
    place: str
    diff: str


def main() -> int:
    """Sample, run, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="mutants in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--groups", default=",".join(GROUPS))
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "mutants")
    given = parser.parse_args()
    if shutil.which("cosmic-ray", path=str(Path(sys.executable).parent)) is None:
        print("cosmic-ray is missing; install the extra 'mutants'", file=sys.stderr)
        return 2
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    subprocess.run(["git", "clone", "-q", str(ROOT), str(CLONE)], check=True)
    for kernel in (ROOT / "planner" / "machine").glob("_kernel.*"):
        shutil.copy(kernel, CLONE / "planner" / "machine")
    names = given.groups.split(",")
    found: list[Mutant] = []
    for name in names:
        found += of_group(name, given.count // len(names), given.seed)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "README.md").write_text(page(found, given), encoding="utf-8")
    print(f"{sum(m.seen for m in found)} of {len(found)} seen; {given.out / 'README.md'}")
    return 0


def of_group(name: str, count: int, seed: int) -> list[Mutant]:
    """A sample of one part's mutants, run."""
    files, tests = GROUPS[name]
    jobs: list[tuple[int, str]] = []
    for k, file in enumerate(files):
        command = f"{sys.executable} -m pytest -x -q -n 0 -p no:cacheprovider {tests}"
        config(k).write_text(
            f'[cosmic-ray]\nmodule-path = "planner/{file}"\ntimeout = {MOST_S}.0\n'
            f'excluded-modules = []\ntest-command = "{command}"\n'
            '[cosmic-ray.distributor]\nname = "local"\n',
            encoding="utf-8",
        )
        cosmic_ray("init", str(config(k)), str(session(k)), "--force")
        with sqlite3.connect(session(k)) as base:
            rows = base.execute("select job_id, operator_name, occurrence from mutation_specs")
            own = sorted((op, at, job) for job, op, at in rows if not op.startswith(EQUIVALENT))
            jobs += [(k, job) for _, _, job in own]
    chosen = random.Random(seed).sample(jobs, min(count, len(jobs)))
    out = []
    for k in track(sorted({k for k, _ in chosen}), f"mutants of: {name}"):
        keep = [job for of, job in chosen if of == k]
        with sqlite3.connect(session(k)) as base:
            marks = ",".join("?" * len(keep))
            for table in ("mutation_specs", "work_items"):
                base.execute(f"delete from {table} where job_id not in ({marks})", keep)
        cosmic_ray("exec", str(config(k)), str(session(k)))
        said = cosmic_ray("dump", str(session(k)))
        out += [read(name, *json.loads(line)) for line in said.splitlines() if line]
    return out


def config(number: int) -> Path:
    """Of a file."""
    return WORK / f"{number}.toml"


def session(number: int) -> Path:
    """Of a file."""
    return WORK / f"{number}.sqlite"


def cosmic_ray(*words: str) -> str:
    """Run it in the clone; what it prints."""
    program = Path(sys.executable).parent / "cosmic-ray"
    done = subprocess.run([program, *words], cwd=CLONE, check=True, capture_output=True, text=True)
    return done.stdout


def read(group: str, job: dict[str, Any], result: dict[str, Any] | None) -> Mutant:
    """A finished job."""
    assert result is not None, "a mutant was not run"
    (mutation,) = job["mutations"]
    lines = [x for x in (result["diff"] or "").split("\n") if x[:1] in "+-"]
    diff = "\n".join(x for x in lines if not x.startswith(("+++", "---")))
    place = f"{mutation['module_path']}:{mutation['start_pos'][0]}"
    return Mutant(group, result["test_outcome"] != "survived", place, diff)


def page(found: list[Mutant], given: argparse.Namespace) -> str:
    """The table, and every survivor."""
    version = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=CLONE, capture_output=True, text=True
    ).stdout.strip()
    lines = [
        "# Mutants",
        "",
        f"{sum(m.seen for m in found)} of {len(found)} mutants are seen by the tests of their part"
        f" (version {version}; a seeded sample). Made by",
        "",
        f"    python tests/benchmarks/mutants.py --count {given.count} --seed {given.seed}",
        "",
        "| part | mutants | seen |",
        "| --- | ---: | ---: |",
    ]
    for name in given.groups.split(","):
        own = [m.seen for m in found if m.group == name]
        lines.append(f"| {name} | {len(own)} | {sum(own)} |")
    lines += ["", "## Survivors", ""]
    for mutant in found:
        if not mutant.seen:
            code = mutant.diff.replace("\n", "\n      ")
            lines += [f"- {mutant.group}, `{mutant.place}`:", "", f"      {code}", ""]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(main())
