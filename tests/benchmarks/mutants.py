"""Do the tests see it when the code is wrong? Mutants of the parts that trust rests on.

    python tests/benchmarks/mutants.py [--count N] [--seed S] [--groups judge,machine] [--again]

cosmic-ray changes one operator, comparison or number at a time in a clone of the last commit (under
out/, so that nothing here is touched) and runs the tests of that part. A seeded sample of all
mutants is run, as many from each part; about five seconds each where the tests see it, half a
minute to two where they do not. After each part README.md is written to the folder, with every
survivor and the reasons that mutants.toml gives for it.

A run that was ended goes on where it was: delete out/mutants to begin anew. `--again` runs the
survivors without a reason against the tests of the commit that is the last one now, whose code must
be the same.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import resource
import shutil
import sqlite3
import subprocess
import sys
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.progress import track

ROOT = Path(__file__).parents[2]
WORK = ROOT / "out" / "mutants"
CLONE = WORK / "clone"
REASONS = Path(__file__).with_suffix(".toml")

ENDED = "ended: too much computing time"
MOST = 4
"""So many times the computing time of the unchanged code, and the tests of a mutant are ended.

Computing time, since what else the machine does must not decide. It counts as seen: whoever runs
the tests sees that they do not end."""
MOST_S = 1800
"""The same on the clock, for mutants that wait without computing."""
MOST_KB = 8_000_000
"""Of address space, twenty times what the tests need: a mutant must not fill the memory."""

EQUIVALENT = "core/ReplaceBinaryOperator_BitOr_"
"""Changes `X | None` in annotations, which nothing reads while the program runs."""

GROUPS = {
    "judge": (
        [
            "verification/verify.py",
            "verification/verdict.py",
            "plan/quadrature.py",
        ],
        "tests/verification/test_verify.py tests/plan/test_quadrature.py"
        " tests/verification/test_judging.py tests/verification/test_certificate_attacks.py"
        " tests/verification/test_verdict.py tests/verification/test_loading.py"
        " tests/verification/test_sampled.py",
    ),
    "certificate": (
        [
            f"verification/{name}.py"
            for name in [
                "balls",
                "certify",
                "enclosure",
                "functions",
                "input_models",
                "models",
                "place_proofs",
            ]
        ],
        "tests/verification/test_certificate_arithmetic.py"
        " tests/verification/test_certificate_models.py"
        " tests/verification/test_certificate_limits.py"
        " tests/verification/test_certificate_plans.py"
        " tests/verification/test_certificate_attacks.py"
        " tests/methods/collocation/test_places.py tests/verification/test_verdict.py",
    ),
    "requirements": (
        ["problem/requirements/motion_limits.py", "problem/requirements/places.py"],
        "tests/problem/test_requirements.py tests/problem/test_doubts.py"
        " tests/verification/test_verify.py tests/methods/collocation/test_places.py",
    ),
    "chained form": (["systems/chained_form.py"], "tests/systems"),
    "systems": (
        [
            f"systems/{name}.py"
            for name in ["manipulator", "ball_gear", "vehicles", "custom", "triangular_system"]
        ],
        "tests/systems tests/problem/test_problem_files.py tests/problem/test_problem.py"
        " tests/report/test_mechanism.py tests/machine/test_links.py",
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
        "tests/machine/test_machine_draw.py tests/machine/test_machine_settings.py"
        " tests/machine/test_servo.py tests/machine/test_play.py tests/machine/test_chain.py"
        " tests/machine/test_command.py tests/machine/test_simulate.py tests/machine/test_loop.py"
        " tests/machine/test_direct.py tests/machine/test_dynamic.py tests/machine/test_kernel.py"
        " tests/machine/test_replay.py tests/machine/test_dynamic_energy.py"
        " tests/machine/test_memory.py tests/machine/test_dynamic_kernel.py"
        " tests/machine/test_start_state.py",
    ),
    "compensation": (
        [
            "plan/clock.py",
            *(
                f"machine/feedforward/{name}.py"
                for name in ["correction", "follow", "legs", "prediction", "shaping"]
            ),
        ],
        "tests/plan/test_clock.py tests/verification/test_verdict.py"
        " tests/machine/test_feedforward.py tests/machine/test_take_ups.py",
    ),
    "search": (
        [f"methods/collocation/{name}.py" for name in ["path", "pipeline", "route_paths"]],
        "tests/methods/collocation/test_path_search.py tests/methods/collocation/test_curve.py"
        " tests/methods/collocation/test_slower_motions.py"
        " tests/methods/collocation/test_collocation.py",
    ),
}
"""For each part its files, and the tests that are to see a mutant of them, the quickest first."""


@dataclass(frozen=True)
class Mutant:
    """One change and what became of it.

    Attributes:
        group: The part.
        job: Its number in the session of its file.
        outcome: "killed", "incompetent" (no tests ran), "ended" (took too long) or "survived".
        place: File and line.
        diff: The changed lines.
        again: The outcome with later tests.
    """

    group: str
    job: str
    outcome: str
    place: str
    diff: str
    again: str = ""

    @property
    def seen(self) -> bool:
        """By the tests as they were."""
        return self.outcome != "survived"

    @property
    def open(self) -> bool:
        """Not seen by later tests either."""
        return not self.seen and self.again in ("", "survived")


def main() -> int:
    """Sample, run, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300, help="mutants in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--groups", default=",".join(GROUPS))
    parser.add_argument("--again", action="store_true", help="the survivors, with the tests of now")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "mutants")
    given = parser.parse_args()
    if shutil.which("cosmic-ray", path=str(Path(sys.executable).parent)) is None:
        print("cosmic-ray is missing; install the extra 'mutants'", file=sys.stderr)
        return 2
    if not CLONE.exists():
        WORK.mkdir(parents=True, exist_ok=True)
        run(["git", "clone", "-q", str(ROOT), str(CLONE)], ROOT)
        for kernel in (ROOT / "planner" / "machine").glob("_kernel.*"):
            shutil.copy(kernel, CLONE / "planner" / "machine")
    run(["git", "checkout", "-q", "--", "planner"], CLONE)  # a mutant may have been left behind
    run(["git", "fetch", "-q", "origin", "HEAD"], CLONE)
    if given.again:
        run(["git", "checkout", "-q", "FETCH_HEAD", "--", "tests"], CLONE)
    # By content: a mutant may be as long as the file was and written within the same second.
    words = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash"]
    run([*words, "planner"], CLONE)
    names = given.groups.split(",")
    found: list[Mutant] = []
    given.out.mkdir(parents=True, exist_ok=True)
    for name in names:
        found += of_group(name, given.count // len(names), given.seed, given.again)
        (given.out / "README.md").write_text(page(found, given), encoding="utf-8")
    print(f"{sum(m.seen for m in found)} of {len(found)} seen; {given.out / 'README.md'}")
    return 0


def of_group(name: str, count: int, seed: int, again: bool) -> list[Mutant]:
    """A sample of one part's mutants, run."""
    files, tests = GROUPS[name]
    folder = WORK / name.replace(" ", "-")
    if not folder.exists():
        sample(files, folder, count, seed)
    sessions = [s for s in sorted(folder.glob("*.sqlite")) if not s.stem.endswith("again")]
    later = {session: session.with_name(f"{session.stem}-again.sqlite") for session in sessions}
    if again:
        for session in sessions:
            unknown = [(m.job,) for m in outcomes(name, session) if not m.seen and not reason_of(m)]
            shutil.copy(session, later[session])
            with sqlite3.connect(later[session]) as base:
                base.executemany("delete from work_results where job_id = ?", unknown)
    asked = list(later.values()) if again else sessions
    left = [session for session in asked if any(None in pair for pair in dumped(session))]
    command = test_command(tests) if left else ""
    for session in track(left, name):
        execute(session, command)
    found: list[Mutant] = []
    for session in sessions:
        known = outcomes(name, later[session]) if later[session].exists() else []
        now = {m.job: m.outcome for m in known}
        found += [replace(m, again=now.get(m.job, "")) for m in outcomes(name, session)]
    return found


def sample(files: list[str], folder: Path, count: int, seed: int) -> None:
    """Sessions of cosmic-ray, one a file, with `count` mutants in all."""
    making = folder.with_name("making")
    shutil.rmtree(making, ignore_errors=True)
    making.mkdir()
    jobs: list[tuple[Path, str]] = []
    for file in files:
        session = making / f"{Path(file).stem}.sqlite"
        config = making / "config.toml"
        config.write_text(settings(f"planner/{file}", "true"), encoding="utf-8")
        cosmic_ray("init", str(config), str(session), "--force")
        with sqlite3.connect(session) as base:
            rows = base.execute("select job_id, operator_name, occurrence from mutation_specs")
            own = sorted((op, at, job) for job, op, at in rows if not op.startswith(EQUIVALENT))
            jobs += [(session, job) for _, _, job in own]
    chosen = random.Random(seed).sample(jobs, min(count, len(jobs)))
    for session in {of for of, _ in jobs}:
        keep = [job for of, job in chosen if of == session]
        with sqlite3.connect(session) as base:
            marks = ",".join("?" * len(keep))
            for table in ("mutation_specs", "work_items"):
                base.execute(f"delete from {table} where job_id not in ({marks})", keep)
    making.rename(folder)


def test_command(tests: str) -> str:
    """Runs a part's tests, the first named first. They must pass while nothing is changed."""
    files: list[str] = []
    for word in tests.split():
        below = sorted((CLONE / word).rglob("test_*.py"), key=lambda p: (len(p.parts), p))
        for path in below or [CLONE / word]:
            file = str(path.relative_to(CLONE))
            if file not in files:
                files.append(file)
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # a fifth of what the quickest take
    run([*words, *files], CLONE)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    most = MOST * math.ceil(after.ru_utime - before.ru_utime)
    limits = f"ulimit -S -t {most}; ulimit -v {MOST_KB}"
    # 128 and more: ended by a signal, and of those only the limit's comes here.
    ends = f"s=$?; [ $s -lt 128 ] || echo {ENDED}; exit $s"
    return f"sh -c '{limits}; {' '.join([*words, *files])}; {ends}'"


def settings(file: str, command: str) -> str:
    """cosmic-ray's, for one file."""
    return (
        f'[cosmic-ray]\nmodule-path = "{file}"\ntimeout = {MOST_S}.0\n'
        f"excluded-modules = []\ntest-command = {json.dumps(command)}\n"
        '[cosmic-ray.distributor]\nname = "local"\n'
    )


def execute(session: Path, command: str) -> None:
    """Whatever mutants of a session have no result yet."""
    config = session.with_suffix(".toml")
    config.write_text(settings("planner", command), encoding="utf-8")
    cosmic_ray("exec", str(config), str(session))


def cosmic_ray(*words: str) -> str:
    """Run it in the clone; what it prints."""
    return run([str(Path(sys.executable).parent / "cosmic-ray"), *words], CLONE)


def run(words: list[str], folder: Path) -> str:
    """Run a program; what it prints."""
    return subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True).stdout


def dumped(session: Path) -> list[Any]:
    """Pairs of a mutant and its result, None where it has none."""
    return [json.loads(line) for line in cosmic_ray("dump", str(session)).splitlines() if line]


def outcomes(group: str, session: Path) -> list[Mutant]:
    """What became of the mutants of a session, in the order of the lines."""
    found = []
    for job, result in dumped(session):
        assert result is not None, "a mutant was not run"
        (mutation,) = job["mutations"]
        lines = [x for x in (result["diff"] or "").split("\n") if x[:1] in "+-" and x[1:].strip()]
        diff = "\n".join(x for x in lines if not x.startswith(("+++", "---")))
        outcome = result["test_outcome"]
        if (result["output"] or "").rstrip().endswith((ENDED, "timeout")):
            outcome = "ended"
        row = mutation["start_pos"][0]
        place = f"{mutation['module_path']}:{row}"
        found.append((row, Mutant(group, job["job_id"], outcome, place, diff)))
    return [mutant for _, mutant in sorted(found, key=lambda pair: (pair[0], pair[1].diff))]


def page(found: list[Mutant], given: argparse.Namespace) -> str:
    """The table, and every survivor with what is known about it."""
    version, later = (
        run(["git", "rev-parse", "--short=7", name], CLONE).strip()
        for name in ("HEAD", "FETCH_HEAD")
    )
    again = any(m.again for m in found)
    still = [m for m in found if m.open]
    reasons = [(m, reason_of(m)) for m in still]
    lines = [
        "# Mutants",
        "",
        f"{sum(m.seen for m in found)} of {len(found)} mutants are seen by the tests of their part"
        f" (version {version}; a seeded sample). Made by",
        "",
        f"    python tests/benchmarks/mutants.py --count {given.count} --seed {given.seed}",
        "",
    ]
    if again:
        lines += [
            f"With the tests of version {later}, written since, {len(found) - len(still)} are seen"
            " (the survivors run again by `--again`; the code is the same).",
            "",
        ]
    lines += [
        f"{sum(bool(r) for _, r in reasons)} of the {len(still)} others are explained below.",
        f"Of those seen, {sum(m.outcome == 'ended' for m in found)} were ended after {MOST} times"
        " the computing time of the tests. They are listed last.",
        "",
        "| part | mutants | seen | of these ended | seen with later tests | others explained |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name in given.groups.split(","):
        own = [m for m in found if m.group == name]
        if not own:  # not run yet
            continue
        left = [r for m, r in reasons if m.group == name]
        counts = [len(own), sum(m.seen for m in own), sum(m.outcome == "ended" for m in own)]
        counts += [len(own) - len(left), sum(map(bool, left))]
        lines.append(f"| {name} | {' | '.join(map(str, counts))} |")
    lines += ["", "## Not seen", ""]
    for mutant, reason in reasons:
        lines += [*listed(mutant), *([f"  {reason}", ""] if reason else [])]
    lines += ["## Seen since", ""]
    lines += [x for m in found if not m.seen and m not in still for x in listed(m)]
    lines += ["## Ended", ""]
    lines += [x for m in found if m.outcome == "ended" for x in listed(m)]
    return "\n".join(lines).rstrip() + "\n"


def listed(mutant: Mutant) -> list[str]:
    """Where it is and what it changes."""
    code = mutant.diff.replace("\n", "\n      ")
    return [f"- {mutant.group}, `{mutant.place}`:", "", f"      {code}", ""]


def reason_of(mutant: Mutant) -> str:
    """Why no test sees it, from mutants.toml; empty where nothing is said."""
    known = tomllib.loads(REASONS.read_text(encoding="utf-8"))["mutant"]
    lines = [[x[0] + x[1:].strip() for x in d.splitlines()] for d in (m["diff"] for m in known)]
    own = [x[0] + x[1:].strip() for x in mutant.diff.splitlines()]
    return next((m["why"] for m, d in zip(known, lines, strict=True) if d == own), "")


if __name__ == "__main__":
    sys.exit(main())
