"""Run a design study: a sweep that plans every task on every mechanism, then a comparison."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping
from contextlib import nullcontext
from itertools import chain
from pathlib import Path
from typing import Any

from planner.problem.feasibility import travel_window
from planner.support.files import make_folder
from planner.support.progress import Tell, expect_listener
from planner.sweep.case import cases
from planner.sweep.description import Sweep
from planner.sweep.design.design_file import read_design
from planner.sweep.design.figures import DesignRow, outcome, recommend
from planner.sweep.design.result import DesignStudy
from planner.sweep.results import read
from planner.sweep.run import expect_workers, run_sweep

CASES_FILE = "cases.sqlite"
"""File name of the database of finished cases in a study's folder."""


def design_study(
    design: Mapping[str, Any] | str | Path,
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Tell | None = None,
) -> DesignStudy:
    """Compare designs of the mechanism on a set of tasks.

    Every task is planned on every design, verified, replayed on emulated machines and, if
    requested, compensated for them. Each finished case is saved in the folder at once, so the same
    call continues an interrupted study.

    Args:
        design: A design file (TOML), or its tables; `problem` may be a `Problem`. See
            `planner.sweep.design.design_file.DesignFile` for the keys.
        folder: Folder for finished cases, which by default are not kept. `DesignStudy.save` writes
            the results.
        workers: Number of processes on this computer. By default one per core; 0 plans in this
            process.
        cluster: Address of a Dask scheduler to use instead.
        progress: Called with the current step and the completed share.

    Returns:
        The study with all designs; a design that cannot be built has the violated inequality.

    Raises:
        InputError: If the file is wrong, no design can be built, or the folder cannot be used.
        KeyboardInterrupt: If interrupted; finished cases are kept.
    """
    tell = expect_listener(progress)
    expect_workers(workers, cluster)
    tell("reading", 0.0)
    study = read_design(design)
    # This refuses an impossible task before anything is planned.
    windows = iter([travel_window(study.problem_of(*pair)) for pair in study.pairs])
    place = tempfile.TemporaryDirectory() if folder is None else nullcontext(make_folder(folder))
    with place as kept_folder:
        db = Path(kept_folder) / CASES_FILE
        task = Sweep.from_dict(study.sweep())
        run = run_sweep(task, db, workers=workers, cluster=cluster, progress=progress)
        tell("comparing", 1.0)
        results = {record["case"]: record for record in read(db, run.sweep)[1]}
    found = (results[case.key] for case in cases(task))
    rows, seconds = [], dict.fromkeys(study.methods, 0.0)
    for each in study.designs:
        if each.refused:
            rows.append(DesignRow(each, {}))
            continue
        of_tasks = [{m: next(found) for m in study.methods} for _ in study.tasks[each.joints]]
        outcomes = [outcome(each, next(windows), of_methods) for of_methods in of_tasks]
        for method, case in chain.from_iterable(task.items() for task in of_tasks):
            seconds[method] += case["case_time_s"] or 0.0
        first = [of_methods[study.reaching] for of_methods in of_tasks]
        whys = Counter(case["why"] for case in first if not case["solved"]).most_common(1)
        values = {figure.key: figure.value(outcomes) for figure in study.figures}
        rows.append(DesignRow(each, values, why=whys[0][0] if whys else ""))
    tasks = len(next(iter(study.tasks.values())))
    marked, choice, reason = recommend(rows, study.front_by, study.reaching, tasks)
    return DesignStudy(
        study, marked, study.figures, study.front_by, choice, reason, run.bugs, seconds
    )
