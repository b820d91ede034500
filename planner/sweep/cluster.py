"""Run the cases of a sweep on the workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import time
import warnings
from collections.abc import Mapping
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from functools import partial
from typing import Any

from planner.errors import InputError, InputWarning
from planner.support.package import how_to_install, versions
from planner.support.tables import shorten
from planner.sweep.case import Request, Row, run_case
from planner.sweep.pools import Pool, death_row

CASES_A_THREAD = 2
"""Cases submitted for each thread of the workers: one runs and the next is there when it ends. More
would be lost to other clients of the database, which leave a claimed case alone."""

CONNECTION_WAIT_S = 4.0
"""Longest wait for a connection to the scheduler, in seconds."""

PATIENCE_S = 30.0
"""Seconds without an answer of the scheduler, or without workers, until the user is told."""

ASK_INTERVAL_S = 0.5
"""Least time between an answer of the scheduler and the next question, in seconds."""

SAME = ("planner", "casadi")
"""Packages whose versions must be the same here and on every worker."""


class ClusterPool(Pool):
    """A pool that runs cases on Dask's workers, each started with `dask worker --nthreads 1`.

    If a worker dies, Dask moves its case to another worker, at most three times. If the scheduler
    stands still or has no workers, cases wait.

    Args:
        address: Address of the scheduler, as in "tcp://host:8786".

    Raises:
        InputError: If Dask is not installed, or nothing takes connections at the address.
    """

    def __init__(self, address: str) -> None:
        self.window = CASES_A_THREAD  # until a worker is known: an adaptive cluster starts one then
        try:
            import distributed
        except ImportError:
            raise InputError(
                f"--cluster needs Dask; install it with: {how_to_install('cluster')}"
            ) from None
        # We report a lost connection in one message; silence the pages that Dask logs about it.
        for part in ("batched", "client", "core", "utils"):
            logging.getLogger(f"distributed.{part}").setLevel(logging.CRITICAL)
        logging.getLogger("tornado.application").addFilter(_is_no_cancellation)
        self._name = f"the Dask scheduler at {shorten(address)}"
        self._failure = (
            f"the Dask cluster at {shorten(address)} has failed; finished cases are saved, and the"
            " same command runs the rest"
        )
        self._advice = f"start some with 'dask worker {shorten(address)} --nthreads 1'"
        while not _greets(address):
            warnings.warn(self._standstill, InputWarning, stacklevel=5)
        try:
            self._client = distributed.Client(
                address, timeout=CONNECTION_WAIT_S, set_as_default=False
            )
        # Dask documents no exception for a failed connection.
        except Exception as error:
            raise InputError(
                f"no Dask scheduler answers at {shorten(address)}: {shorten(str(error), 200)}"
            ) from None
        self._executor = self._client.get_executor(pure=False)
        self._killed: type[Exception] = distributed.scheduler.KilledWorker
        self._answered = self._manned = time.monotonic()
        self._answer = self._ask()
        self._probed: set[str] = set()
        self._refusal = ""

    @property
    def _standstill(self) -> str:
        return f"{self._name} has not answered for {PATIENCE_S:g} s; waiting for it"

    def _ask(self) -> Future[dict[str, Any]]:
        """Ask the scheduler for its workers, without waiting for the answer."""
        question = self._client.scheduler.identity()
        return asyncio.run_coroutine_threadsafe(question, self._client.loop.asyncio_loop)

    def trouble(self) -> str:
        """Return in a sentence why no case gets on, after `PATIENCE_S`; else ""."""
        if self._refusal:
            raise InputError(self._refusal)
        now = time.monotonic()
        if self._answer.done() and now - self._answered > ASK_INTERVAL_S:
            if self._answer.exception() is None:
                workers = self._answer.result()["workers"]
                self._answered, self._manned = now, now if workers else self._manned
                threads = sum(worker["nthreads"] for worker in workers.values())
                self.window = CASES_A_THREAD * max(1, threads)
                for worker in workers.keys() - self._probed:
                    self._probe(worker)
            self._answer = self._ask()
        if now - self._answered > PATIENCE_S:
            return self._standstill
        if now - self._manned > PATIENCE_S:
            return f"{self._name} has no workers; {self._advice}; waiting for them"
        return ""

    def _probe(self, worker: str) -> None:
        """Ask a worker for its versions before it runs cases, without waiting for the answer."""
        self._probed.add(worker)
        future = self._client.submit(versions, workers=[worker], pure=False, priority=1)
        future.add_done_callback(partial(self._judge, worker))

    def _judge(self, worker: str, future: Any) -> None:
        if future.status == "finished":
            self._compare(f"the worker {worker}", future.result())
        elif future.status == "error":
            error = future.exception()
            if not isinstance(error, self._killed):
                self._refusal = (
                    f"the worker {worker} cannot run this package ({type(error).__name__}:"
                    f" {error}); install the same planner there"
                )

    def _compare(self, who: str, there: Mapping[str, str]) -> None:
        """Note a refusal if a worker has other versions than this computer."""
        here = versions()
        if other := [name for name in SAME if there.get(name) != here[name]]:
            told = (f"{name} {there.get(name)} (here {here[name]})" for name in other)
            self._refusal = (
                f"{who} has {' and '.join(told)}, so its results may differ; install the same"
                " version there, and start the worker again"
            )

    def submit(self, request: Request) -> Future[Row]:
        """Submit a case to the cluster."""
        answer: Future[Row] = Future()

        def done(future: Future[Row]) -> None:
            if future.cancelled():
                answer.set_exception(InputError(self._failure))
                return
            error = future.exception()
            if error is None:
                row = future.result()
                self._compare("a worker", json.loads(row["versions"]))
                if self._refusal:
                    answer.set_exception(InputError(self._refusal))
                else:
                    answer.set_result(row)
            elif isinstance(error, self._killed):
                answer.set_result(death_row("every worker that ran the case died"))
            else:
                words = f"{self._failure} ({type(error).__name__}: {error})"
                answer.set_exception(InputError(words))

        self._executor.submit(run_case, request).add_done_callback(done)
        return answer

    def close(self) -> None:
        """Cancel running and waiting cases, and disconnect from the cluster."""
        self._executor.shutdown(wait=False)
        self._client.close()


def _is_no_cancellation(record: logging.LogRecord) -> bool:
    """Return whether a log entry is of anything but a case that `close` has cancelled."""
    return not (record.exc_info and isinstance(record.exc_info[1], CancelledError))


def _greets(address: str) -> bool:
    """Wait until a scheduler sends its greeting; return whether that takes at most `PATIENCE_S`.

    A Dask client would not do: one whose scheduler stands still blocks again when it is deleted.

    Raises:
        InputError: If no program takes connections at the address.
    """
    scheme, _, place = address.rpartition("://")
    host, _, port = place.rpartition(":")
    try:
        at = host.strip("[]"), int(port)
        with socket.create_connection(at, CONNECTION_WAIT_S) as connection:
            connection.settimeout(PATIENCE_S)
            if scheme not in ("", "tcp"):  # there the client speaks first
                return True
            with suppress(TimeoutError):
                if not connection.recv(1):
                    raise OSError("it closes the connection")
                return True
            return False
    except (OSError, ValueError, OverflowError) as error:
        raise InputError(
            f"no Dask scheduler answers at {shorten(address)}: {error} (an address is, for example,"
            " tcp://host:8786)"
        ) from None
