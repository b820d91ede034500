"""Running: what is done once is not done again, and what fails is a result."""

from __future__ import annotations

import os
import signal
import sqlite3
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from databases import alive, column, finished, query

import planner
from planner import run_sweep
from planner.machine.friction.contact_load import contact_load
from planner.support.interrupts import hear_signals
from planner.sweep.results import export, load_case_plan

Tables = dict[str, Any]


@pytest.fixture
def db(tmp_path: Path) -> Path:
    return tmp_path / "x.sqlite"


def test_every_case_is_a_row_with_its_reason_and_runs_once(tables: Tables, db: Path) -> None:
    outcome = run_sweep(tables, db, workers=0)
    assert (outcome.ran, outcome.kept, outcome.cases) == (10, 0, 10)
    assert outcome.statuses == {"infeasible": 10}
    assert column(db, "goal.duration") == [round(0.01 * k, 2) for k in range(1, 11)]
    assert all(why.startswith("no plan of any kind exists") for why in column(db, "why"))
    assert not any(column(db, "solved"))
    first = query(db, "SELECT * FROM cases")
    outcome = run_sweep(tables, db, workers=0)
    assert (outcome.ran, outcome.kept) == (0, 10)
    assert query(db, "SELECT * FROM cases") == first


def test_a_changed_description_runs_only_what_is_new(tables: Tables, db: Path) -> None:
    run_sweep(tables, db, workers=0)
    grid = {"goal.duration": [0.01, 0.02, 0.5]}
    outcome = run_sweep({**tables, "title": "other", "grid": grid}, db, workers=0)
    assert (outcome.ran, outcome.kept, outcome.cases) == (1, 2, 3)
    assert column(db, "goal.duration") == [0.01, 0.02, 0.5]
    assert query(db, "SELECT count(*) FROM points WHERE sweep = 1") == [(10,)]
    assert finished(db) == 11


def test_points_that_come_to_the_same_run_once(tables: Tables, db: Path) -> None:
    # 80 is what the file says already, 5 and 5.0 are one number, and an option of its default
    # value is that option left out.
    rows = [
        {"goal.duration": 0.05},
        {"goal.duration": 0.05, "limits.joint_deg": 80},
        {"goal.duration": 0.05, "limits.joint_deg": 80.0},
        {"goal.duration": 0.05, "method.polynomial.travel": "auto"},
    ]
    more = {**tables, "grid": {}, "cases": rows, "methods": ["polynomial", "polynomial:offset=1"]}
    outcome = run_sweep(more, db, workers=0)
    assert (outcome.points, outcome.cases, outcome.ran) == (8, 2, 2)
    assert len(column(db, "key")) == 8
    assert len(set(column(db, "key"))) == 2


def test_options_of_other_methods_do_not_make_another_case(tables: Tables, db: Path) -> None:
    grid = {"method.piecewise.slots": [3, 4]}
    methods = ["polynomial", "piecewise"]
    changes = {"goal.duration": 0.05}
    outcome = run_sweep({**tables, "grid": grid, "set": changes, "methods": methods}, db, workers=0)
    assert outcome.points == 4
    assert outcome.cases == 3


def test_cases_are_the_same_where_all_that_matters_is(tables: Tables, db: Path) -> None:
    def key(**changes: Any) -> str:
        one = {**tables, "grid": {"goal.duration": [0.01]}, **changes}
        run_sweep(one, db, workers=0)
        return str(column(db, "key")[0])

    plain = key()
    assert key() == plain
    assert key(title="another name") == plain
    assert key(plans=True) == plain
    assert key(replay={"samples": 0, "seed": 5}) == plain
    others = [
        key(set={"limits.joint_deg": 79}),
        key(set={"method.polynomial.criterion": "margin"}),
        key(methods=["piecewise"]),
        key(replay={"samples": 5}),
        key(replay={"samples": 5, "seed": 1}),
        key(replay={"samples": 5}, set={"machine.backlash_deg": 3.0}),
        key(set={"compensation.on": True}),
        key(set={"compensation.on": True, "compensation.preparation": False}),
        key(set={"compensation.on": True, "machine.backlash_deg": 3.0}),  # the plan itself differs
    ]
    assert len({plain, *others}) == 10
    assert key(set={"compensation.lag": False}) == plain  # what is off makes no difference


def test_a_solved_case_has_its_figures(unlimited: planner.Problem, db: Path) -> None:
    tables = {
        "problem": unlimited,
        "methods": ["polynomial"],
        "grid": {"goal.travel": [0.82]},
        "replay": {"samples": 3, "seed": 4},
        "set": {"machine.control_period_s": 0.1, "machine.step_s": 0.01},
        "plans": True,
    }
    assert run_sweep(tables, db, workers=0).statuses == {"solved": 1}
    names = [name for _, name, *_ in query(db, "PRAGMA table_info(cases)")]
    record = dict(zip(names, query(db, "SELECT * FROM cases")[0], strict=True))
    problem = unlimited.changed({**tables["set"], "goal.travel": 0.82})  # type: ignore[dict-item]
    comparison = planner.compare(problem, "polynomial", samples=3, seed=4)
    row = comparison["polynomial"]
    assert record["travel"] == pytest.approx(0.82)
    assert record["effort"] == pytest.approx(row.effort, rel=1e-12)
    assert (record["peak_u1"], record["peak_u2"]) == pytest.approx(row.peak_u)
    assert record["domain_margin"] == pytest.approx(row.domain_margin)
    assert record["terminal_error_max_deg"] < 1e-6
    assert record["E_median_deg"] == pytest.approx(row.E_median_deg, rel=1e-12)
    assert record["E_p95_deg"] == pytest.approx(row.E_p95_deg, rel=1e-12)
    assert record["end_median_deg"] == pytest.approx(row.end_median_deg, rel=1e-12)
    ends = row.replay.terminal_error_deg  # type: ignore[union-attr]
    assert record["end_spread_deg"] == pytest.approx(np.max(np.std(ends, axis=0)), rel=1e-12)
    assert record["end_p95_deg"] == pytest.approx(row.end_p95_deg, rel=1e-12)
    load = contact_load(row.plan, samples=1000, seed=4)  # type: ignore[arg-type]
    assert record["contact_torque_nm"] == pytest.approx(np.median(load.torque_nm))
    assert record["contact_load"] == pytest.approx(np.percentile(load.share, 99))
    assert '"casadi"' in record["versions"]
    plan = load_case_plan(db, record["key"][:12])
    assert plan.verified
    assert plan.q(3.0) == pytest.approx(row.plan.q(3.0))  # type: ignore[union-attr]


def test_refusals_keep_status_reason_and_figures(paper: planner.Problem, db: Path) -> None:
    tables = {
        "problem": paper,
        "methods": ["polynomial"],
        "cases": [{"goal.travel": 0.825}, {"goal.travel": 0.79}, {"start.theta_deg": [85, 1, 1]}],
    }
    run_sweep(tables, db, workers=0)
    assert column(db, "status") == ["verification_failed", "singular", "bad_input"]
    limit, singular, bad = column(db, "why")
    assert "input u2 reaches 16.7" in limit
    assert singular.startswith("the polynomial plan leaves the domain")
    assert "theta1 = 85 deg lies outside its limit" in bad
    assert "goal.duration = " in column(db, "advice")[0]
    assert column(db, "peak_u2")[0] == pytest.approx(16.76, abs=0.01)
    assert column(db, "effort")[1] is None
    with pytest.raises(planner.InputError, match="has no plan of case"):
        load_case_plan(db, column(db, "key")[0])
    with pytest.raises(planner.InputError, match="3 cases have a key '"):
        load_case_plan(db, "")


@pytest.fixture
def fail(monkeypatch: pytest.MonkeyPatch) -> Callable[[Exception], None]:
    """Lets every case end with an error."""

    def failing(error: Exception) -> None:
        def broken(*_: Any, **__: Any) -> None:
            raise error

        monkeypatch.setattr("planner.sweep.case.solve_and_check", broken)

    return failing


def test_a_bug_is_a_row_with_its_traceback(
    tables: Tables, db: Path, fail: Callable[[Exception], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    fail(ZeroDivisionError("made for this test"))
    outcome = run_sweep(tables, db, workers=0)
    assert outcome.bugs == 10
    assert column(db, "why")[0] == "ZeroDivisionError: made for this test"
    assert "in broken" in column(db, "traceback")[0]
    monkeypatch.undo()
    assert run_sweep(tables, db, workers=0).ran == 0
    outcome = run_sweep(tables, db, workers=0, retry=["bug"])
    assert (outcome.ran, outcome.bugs) == (10, 0)


def test_a_lack_of_memory_is_no_bug(
    tables: Tables, db: Path, fail: Callable[[Exception], None]
) -> None:
    fail(MemoryError("Unable to allocate 12 GiB"))
    assert run_sweep(tables, db, workers=0).bugs == 0
    assert "not enough memory" in column(db, "why")[0]
    assert column(db, "status")[0] == "bad_input"


def test_plans_wanted_later_are_made_for_solved_cases_only(
    tables: Tables, db: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_sweep(tables, db, workers=0)
    assert run_sweep({**tables, "plans": True}, db, workers=0).ran == 0
    query(db, "UPDATE cases SET status = 'solved', solved = 1")
    assert run_sweep({**tables, "plans": True}, db, workers=0).ran == 10


def test_processes_give_the_rows_this_process_gives_and_are_not_left_behind(
    tables: Tables, tmp_path: Path
) -> None:
    def children() -> set[int]:
        return {child for child, parent in alive().items() if parent == os.getpid()}

    here, there = tmp_path / "here.sqlite", tmp_path / "there.sqlite"
    run_sweep(tables, here, workers=0)
    threads, processes, seen = threading.active_count(), children(), set[int]()
    run_sweep(tables, there, workers=2, progress=lambda *_: seen.update(children() - processes))
    assert bool(seen) == bool(alive())
    assert children() == processes
    assert threading.active_count() == threads
    same = "SELECT key, description, status, why, versions FROM cases ORDER BY key"
    assert query(here, same) == query(there, same)


def test_a_case_that_kills_its_process_is_a_row(
    tables: Tables, db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Python runs a module of this name at start: the process dies of one duration, as it would of
    # a fault in compiled code.
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "if 'planner.sweep.pools' in ' '.join(sys.orig_argv):\n"
        "    import planner.sweep.case as case\n"
        "    run = case.run_case\n"
        "    def deadly(request):\n"
        "        if request['tables']['goal']['duration'] == 0.05:\n"
        "            os.kill(os.getpid(), signal.SIGSEGV)\n"
        "        return run(request)\n"
        "    case.run_case = deadly\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    outcome = run_sweep(tables, db, workers=1)
    assert outcome.statuses == {"bug": 1, "infeasible": 9}
    assert column(db, "status")[4] == "bug"
    assert "died 2 times (signal 11" in column(db, "why")[4]
    assert "Segmentation fault" in column(db, "traceback")[4]


def test_processes_that_cannot_start_are_told_and_make_no_rows(
    tables: Tables, db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['casadi'] = None")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    says = "no worker process can start with .* status 1 .*casadi"
    with pytest.raises(planner.InputError, match=says):
        run_sweep(tables, db, workers=1)
    assert finished(db) == 0


def test_two_runs_into_one_file_do_not_disturb_each_other(tables: Tables, db: Path) -> None:
    with ThreadPoolExecutor(2) as threads:
        runs = [threads.submit(run_sweep, tables, db, workers=0) for _ in range(2)]
    assert all(run.result().statuses == {"infeasible": 10} for run in runs)
    assert finished(db) == 10
    assert len(column(db, "key")) == 10


def test_a_run_waits_for_one_that_makes_the_same_file(tables: Tables, db: Path) -> None:
    maker = sqlite3.connect(db, isolation_level=None, check_same_thread=False)
    maker.execute("BEGIN IMMEDIATE")
    release = threading.Timer(0.3, maker.execute, ["COMMIT"])
    release.start()
    try:
        assert run_sweep(tables, db, workers=0).ran == 10
    finally:
        release.join()
        maker.close()


def test_an_interrupt_keeps_what_is_done_for_exports_too(
    tables: Tables, db: Path, tmp_path: Path
) -> None:
    def stop(doing: str, share: float) -> None:
        if share >= 0.4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(tables, db, workers=0, progress=stop)
    assert len(export(db, tmp_path / "out.csv").read_text().splitlines()) == 1 + finished(db) == 5
    assert run_sweep(tables, db, workers=0).ran == 6


@pytest.mark.parametrize("step", ["BEGIN IMMEDIATE", "INSERT OR REPLACE INTO cases", "COMMIT"])
@pytest.mark.parametrize("heard", [True, False], ids=["command", "library"])
def test_an_interrupt_between_two_steps_of_a_transaction_loses_nothing(
    tables: Tables, db: Path, monkeypatch: pytest.MonkeyPatch, step: str, heard: bool
) -> None:
    """When the database has just been locked, say: what is finished is kept, and Ctrl-C raised."""
    steps = []

    class Pressed(sqlite3.Connection):
        def execute(self, statement: str, *values: Any) -> sqlite3.Cursor:
            done = super().execute(statement, *values)
            if statement.startswith(step):
                steps.append(step)
                if len(steps) == (7 if "cases" in step else 12):
                    signal.raise_signal(signal.SIGINT)
            return done

    real = sqlite3.connect
    monkeypatch.setattr(
        sqlite3, "connect", lambda *words, **options: real(*words, **options, factory=Pressed)
    )
    with pytest.raises(KeyboardInterrupt), hear_signals() if heard else nullcontext():
        run_sweep(tables, db, workers=0)
    monkeypatch.undo()
    kept = finished(db)
    assert 4 <= kept < 10
    assert run_sweep(tables, db, workers=0).kept == kept


def test_workers_run_this_package_among_any_others(
    tables: Tables, db: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside it a module with the name of one of Python's own; another `planner` on the path."""
    beside, other = tmp_path / "site", tmp_path / "other"
    for folder in (beside, other / "planner"):
        folder.mkdir(parents=True)
    (beside / "planner").symlink_to(Path(planner.__file__).parent)
    for module in (beside / "queue.py", beside / "json.py", other / "planner/__init__.py"):
        module.write_text("raise ImportError('this is not the one')")
    monkeypatch.setattr("planner.sweep.pools.ROOT", beside)
    monkeypatch.setenv("PYTHONPATH", str(other), prepend=os.pathsep)
    assert run_sweep(tables, db, workers=1).statuses == {"infeasible": 10}


def test_progress_counts_and_names(tables: Tables, db: Path) -> None:
    told: list[tuple[str, float]] = []
    run_sweep(tables, db, workers=0, progress=lambda doing, share: told.append((doing, share)))
    assert told[0] == ("0 of 10 cases", 0.0)
    assert told[-1] == ("10 of 10 cases (10 infeasible)", 1.0)


@pytest.mark.parametrize("workers", [-1, True, 1.5, "2"])
def test_impossible_numbers_of_workers_are_refused(tables: Tables, db: Path, workers: Any) -> None:
    with pytest.raises(planner.InputError, match="workers = "):
        run_sweep(tables, db, workers=workers)
    with pytest.raises(planner.InputError, match="not both"):
        run_sweep(tables, db, workers=1, cluster="tcp://127.0.0.1:1")


def test_how_the_arm_stood_before_can_be_varied(unlimited: planner.Problem, db: Path) -> None:
    tables = {
        "problem": unlimited,
        "methods": ["collocation"],
        "grid": {"machine.start_state": ["forward", "backward"]},
        "replay": {"samples": 3},
    }
    assert run_sweep(tables, db, workers=0).statuses == {"solved": 2}
    forward, backward = column(db, "E_median_deg")
    assert 2 * forward < backward


@pytest.mark.parametrize("retry", ["bug", ["solvd"], ["bug", "verification failed"]])
def test_a_status_that_no_case_can_have_is_refused_before_anything_is_written(
    tables: Tables, db: Path, retry: Any
) -> None:
    with pytest.raises(planner.InputError, match="verification_failed"):
        run_sweep(tables, db, workers=0, retry=retry)
    assert not db.exists()
