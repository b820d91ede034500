"""Run the cases of a sweep that are not in its database, in parallel; save each one at once."""

from __future__ import annotations

import os
import time
import warnings
from collections import Counter
from collections.abc import Collection, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from planner.errors import InputError, InputWarning
from planner.problem.tables.kinds import local_only
from planner.support.interrupts import Terminated, hold_signals
from planner.support.progress import Tell, expect_listener
from planner.sweep.case import Case, Row, case_at, cases, possible_statuses
from planner.sweep.clients import Client
from planner.sweep.cluster import ClusterPool
from planner.sweep.description import Sweep
from planner.sweep.pools import LocalPool, Pool
from planner.sweep.store import Store
from planner.sweep.sweep_file import flatten

PROGRESS_INTERVAL_S = 1.0
"""Longest time between progress calls, in seconds, so that a bar shows before the first result."""


@dataclass(frozen=True)
class Outcome:
    """The result of running a sweep.

    Attributes:
        db: The database file.
        sweep: Number of the sweep in the file, for `planner.load_sweep`.
        points: Number of points of the sweep times number of methods.
        cases: Number of different cases among these points and methods.
        kept: Number of cases that were already in the file, or that another run added meanwhile.
        ran: Number of cases that this run added.
        statuses: How many of the sweep's cases ended in each status.
        elapsed_s: Duration of the run in seconds.
    """

    db: str
    sweep: int
    points: int
    cases: int
    kept: int
    ran: int
    statuses: Mapping[str, int]
    elapsed_s: float

    @property
    def bugs(self) -> int:
        """Number of cases that ended with an unexpected error, a bug of this program."""
        return self.statuses.get("bug", 0)


def run_sweep(
    sweep: Sweep | Mapping[str, Any] | str | Path,
    db: str | Path,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    retry: Collection[str] = (),
    progress: Tell | None = None,
) -> Outcome:
    """Run those cases of a sweep that are not yet in a database file.

    Each finished case is saved at once. After any interruption the same call runs the rest. Several
    runs may share one file at the same time: each case is run by one of them. A refusal is a result
    too: see the columns `status` and `why`.

    Args:
        sweep: A `Sweep`, a sweep file, or its tables.
        db: The database file, created if missing; it may contain other sweeps.
        workers: Number of processes on this computer, by default one per core; 0 runs the cases in
            this process.
        cluster: Address of a Dask scheduler to use instead.
        retry: Cases with these statuses are run again, for example ["bug"].
        progress: Called with the progress of the run.

    Raises:
        InputError: If the sweep or a status is wrong, the file or the cluster cannot be used, or a
            method or system is registered only in this process.
        KeyboardInterrupt: If interrupted; finished cases are saved.
    """
    tell = expect_listener(progress)
    expect_workers(workers, cluster)
    possible = possible_statuses()
    if isinstance(retry, str) or not possible.issuperset(retry):
        allowed = ", ".join(sorted(possible))
        raise InputError(f"retry = {retry!r:.60}: must be a list of statuses, which are {allowed}")
    if not isinstance(sweep, Sweep):
        sweep = Sweep.from_dict(sweep) if isinstance(sweep, Mapping) else Sweep.load(sweep)
    start = time.perf_counter()
    with Store(db, create=True) as store:
        index = store.register(sweep, cases(sweep))
        positions = store.positions(index)
        wanted = store.unfinished(index, retry, sweep.plans)
        run = _SweepRun(store, sweep, positions, wanted, len(wanted), tell)
        if run.total:
            if workers != 0:
                _refuse_local_plugins(sweep)
            with Client(store.path) as client:
                pool = _pool(workers, cluster, run.total)
                try:
                    run.drive(pool, client.name)
                finally:
                    with hold_signals():  # else a worker process may run on
                        pool.close()
        store.refuse_lost()
        statuses = store.statuses(index)
        if sum(statuses.values()) < len(positions):
            raise InputError(f"{db} has lost cases while the sweep ran; run the same command again")
    counts = len(sweep), len(positions), len(positions) - run.done, run.done
    return Outcome(str(db), index, *counts, statuses, time.perf_counter() - start)


def expect_workers(workers: int | None, cluster: str | None) -> None:
    """Refuse invalid settings of the pool, before anything is written.

    Raises:
        InputError: If both `workers` and `cluster` are given, or `workers` is no number ≥ 0.
    """
    if cluster is not None and workers is not None:
        raise InputError("give workers or cluster, not both: a cluster has its own workers")
    if workers is not None and (type(workers) is not int or workers < 0):
        raise InputError(f"workers = {workers}: must be a whole number, at least 0")


def _pool(workers: int | None, cluster: str | None, total: int) -> Pool:
    if cluster is not None:
        return ClusterPool(cluster)
    if workers == 0:
        return Pool()
    # This counts only cores that this process may use, where the system can tell.
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return LocalPool(min(workers or cores or 1, total))


def _refuse_local_plugins(sweep: Sweep) -> None:
    """Refuse methods, systems and limits that are registered only in this process."""
    base, points = sweep.base.to_dict(), [flatten(point) for point in sweep.points]
    kinds = {base["system"]["kind"], *(point.get("system.kind") for point in points)}
    keys = {k.split(".")[1] for point in points for k in point if k.startswith("limits.")}
    limits = (f"requirement '{key}'" for key in sorted({*base.get("limits", {}), *keys}))
    methods = dict.fromkeys(f"method '{spec.method}'" for spec in sweep.methods)
    if unknown := local_only(*methods, *(f"system '{kind}'" for kind in kinds), *limits):
        raise InputError(
            f"{' and '.join(unknown)}: registered only in this process, so other processes cannot"
            " run the cases; name the function that registers it under the entry point"
            " planner.plugins of an installed package, or run the cases here (workers = 0)"
        )


@dataclass
class _SweepRun:
    """State of a sweep that runs.

    Attributes:
        wanted: Keys of the cases that are neither finished nor run by this client, each with the
            number of its row; see `Store.unfinished`.
        total: Number of unfinished cases at the start.
        done: Number of cases that this client has finished.
        running: Number of cases that it has submitted.
        is_idle: Whether it waits, because other clients run all cases that are left.
        trouble: Why the pool stands still; or "".
        statuses: How many of them ended in each status.
        finished: Finished cases that are not saved yet.
    """

    store: Store
    sweep: Sweep
    positions: Mapping[str, int]
    wanted: dict[str, int]
    total: int
    tell: Tell
    done: int = 0
    running: int = 0
    is_idle: bool = False
    trouble: str = ""
    statuses: Counter[str] = field(default_factory=Counter)
    finished: SimpleQueue[tuple[Case, Future[Row]]] = field(default_factory=SimpleQueue)

    def drive(self, pool: Pool, client: str) -> None:
        """Submit cases as earlier cases finish, and save each finished case at once."""
        self._report(pool)
        self._launch(pool, client)
        try:
            while self.running or self.wanted:
                with suppress(Empty):
                    self._keep(*self.finished.get(timeout=PROGRESS_INTERVAL_S))
                    self.running -= 1
                self._report(pool)
                self._launch(pool, client)
        except (KeyboardInterrupt, Terminated):
            while not self.finished.empty():
                self._keep(*self.finished.get())
            raise

    def _keep(self, case: Case, future: Future[Row]) -> None:
        try:
            self.store.add(case, future.result())
        except (KeyboardInterrupt, Terminated):
            self.finished.put((case, future))
            raise
        self.done += 1
        self.statuses[future.result()["status"]] += 1

    def _launch(self, pool: Pool, client: str) -> None:
        room = max(0, pool.window - self.running)  # workers may have left a cluster
        claimed, finished = self.store.claim(self.wanted, self.sweep.plans, client, room)
        for key in (*claimed, *finished):
            del self.wanted[key]
        for key in claimed:
            self._submit(pool, case_at(self.sweep, self.positions[key]))
        self.is_idle = bool(self.wanted) and not self.running

    def _submit(self, pool: Pool, case: Case) -> None:
        self.running += 1
        future = pool.submit(case.request)
        future.add_done_callback(lambda future: self.finished.put((case, future)))

    def _report(self, pool: Pool) -> None:
        trouble = pool.trouble()
        if trouble and trouble != self.trouble:
            warnings.warn(trouble, InputWarning, stacklevel=4)
        self.trouble = trouble
        counts = ", ".join(f"{n} {status.replace('_', ' ')}" for status, n in self.statuses.items())
        over = self.total - len(self.wanted) - self.running
        doing = f"{over} of {self.total} cases" + (f" ({counts})" if counts else "")
        if self.is_idle:
            doing += "; waiting for those of another run"
        if trouble:
            doing += "; the cluster stands still"
        self.tell(doing, over / self.total)
