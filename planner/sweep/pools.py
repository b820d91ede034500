"""Run cases in this process, in processes of this computer, or on a Dask cluster.

A process of this computer runs `serve`: prints `ready`, then reads one request per line from
standard input and prints one row per line on standard output, both JSON. The process ends when its
standard input closes, so that it never outlives its parent.
"""

from __future__ import annotations

import json
import logging
import os
import socket
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from typing import Protocol

from planner.errors import InputError
from planner.support.package import ROOT, how_to_install
from planner.support.tables import shorten
from planner.sweep.case import RESULTS, Request, Row, run_case

ONE_THREAD_ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""Environment that gives a worker process one thread: one process per core uses the cores best."""

START_CODE = """
import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec

found = PathFinder.find_spec("planner", [sys.argv[1]])
sys.modules["planner"] = module_from_spec(found)
found.loader.exec_module(sys.modules["planner"])
sys.path.append(sys.argv[1])
from planner.sweep.pools import serve

serve()
"""
"""Code of a worker process, which imports this copy of the package from the folder in its argument.

The folder comes last in the search path, because it may hold a module with the name of one in the
standard library."""

READY_LINE = "ready\n"
"""First line that a worker process prints."""

MAX_DEATHS = 2
"""Number of worker processes that may die on a case before the case counts as a bug."""


class Pool(Protocol):
    """One or more processes that run the cases of a sweep.

    Attributes:
        window: Largest number of submitted cases that are not finished.
    """

    window: int

    def submit(self, request: Request) -> Future[Row]:
        """Submit a case; the returned future raises only if the pool itself has failed."""

    def close(self) -> None:
        """Cancel running and waiting cases, and release processes and connections."""


class SerialPool:
    """A pool that runs cases in this process, one after the other; for debuggers and tests."""

    window = 1

    def submit(self, request: Request) -> Future[Row]:
        """Run a case at once, and return a finished future."""
        future: Future[Row] = Future()
        future.set_result(run_case(request))
        return future

    def close(self) -> None:
        """Do nothing, because no process or connection is open."""


class LocalPool:
    """A pool that runs cases in processes of this computer; a thread waits for each process.

    Other pools do not suffice: loky's processes survive their killed parent by over ten minutes,
    those of `concurrent.futures` run an unguarded script again, and neither pool reports which case
    killed a process.
    """

    def __init__(self, count: int) -> None:
        self.window = 2 * count
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="sweep")
        self._own = threading.local()
        self._workers: list[_WorkerProcess] = []
        self._lock = threading.Lock()
        self._closed = False

    def submit(self, request: Request) -> Future[Row]:
        """Submit a case to the next free worker process."""
        return self._threads.submit(self._run, request)

    def close(self) -> None:
        """Kill the worker processes at once, and cancel waiting cases."""
        with self._lock:
            self._closed = True
            for worker in self._workers:
                worker.end()
        self._threads.shutdown(cancel_futures=True)
        for worker in self._workers:
            worker.release()

    def _run(self, request: Request) -> Row:
        for _ in range(MAX_DEATHS):
            worker = self._worker()
            answer = worker.ask(request)
            if answer is not None:
                return answer
            if self._closed:
                break
        return death_row(f"the case's process died {MAX_DEATHS} times", *worker.last_words())

    def _worker(self) -> _WorkerProcess:
        """Return the worker process of this thread; start a process if none is alive."""
        worker: _WorkerProcess | None = getattr(self._own, "worker", None)
        if worker is None or not worker.alive:
            with self._lock:
                worker = self._own.worker = _WorkerProcess()
                self._workers.append(worker)
                if self._closed:
                    worker.end()
        return worker


class _WorkerProcess:
    """A worker process on this computer, which runs `serve`, and the pipes to it."""

    def __init__(self) -> None:
        self._ready = False
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed in `release`)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-X", "faulthandler", "-c", START_CODE, str(ROOT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, **ONE_THREAD_ENVIRONMENT},
            text=True,
            encoding="utf-8",
            process_group=0,  # only the parent receives Ctrl-C
        )

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def ask(self, request: Request) -> Row | None:
        """Run a case in the worker process and return its row; None if the process died.

        Raises:
            InputError: If the process cannot start.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        if not self._ready and self._process.stdout.readline() != READY_LINE:
            self.end()
            status, words = self.last_words()
            reason = words.strip().rpartition("\n")[2]
            raise InputError(
                f"no worker process can start with {sys.executable}: it ended with status"
                f" {status} ({reason})"
            )
        self._ready = True
        try:
            self._process.stdin.write(json.dumps(request, default=str) + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        except (OSError, ValueError):
            answer = ""
        if answer.endswith("\n"):
            return dict(json.loads(answer))
        self.end()
        return None

    def last_words(self) -> tuple[int, str]:
        """Return a dead worker's exit status, and the end of what it wrote to standard error."""
        self._errors.seek(0)
        return self._process.returncode, self._errors.read().decode(errors="replace")[-4000:]

    def end(self) -> None:
        """Kill the worker process; a call of `ask` that waits in another thread then ends."""
        self._process.kill()
        self._process.wait()

    def release(self) -> None:
        """Close the pipes and files of a worker process that has ended."""
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            with suppress(OSError):
                stream.close()  # type: ignore[union-attr]


def serve() -> None:
    """Run cases from standard input until it closes; the main function of a worker process."""
    # Compiled solvers print to standard output: send that to standard error, away from the rows.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    answers.write(READY_LINE)
    answers.flush()
    requests: SimpleQueue[str] = SimpleQueue()

    def listen() -> None:
        for line in sys.stdin:
            requests.put(line)
        os._exit(0)  # at once, even during a case: nobody waits for its row

    threading.Thread(target=listen, daemon=True).start()
    while True:
        print(json.dumps(run_case(json.loads(requests.get()))), file=answers, flush=True)


def death_row(what: str, status: int | None = None, words: str = "") -> Row:
    """Return the row of a case during which the process died."""
    signal = f" (signal {-status}; 9 is often a lack of memory)" if status and status < 0 else ""
    ended = "" if signal or status is None else f" (exit status {status})"
    return dict.fromkeys(RESULTS) | {
        "status": "bug",
        "solved": False,
        "why": f"{what}{signal}{ended}",
        "traceback": words or None,
    }


CLUSTER_WINDOW = 500
"""Number of cases submitted to the scheduler at once; the number of workers may change."""

SCHEDULER_WAIT_S = 4.0
"""Longest wait for an answer of the scheduler, in seconds."""

WORKER_WAIT_S = 15.0
"""Longest wait for the first worker, in seconds."""


class ClusterPool:
    """A pool that runs cases on Dask's workers, each started with `dask worker --nthreads 1`.

    If a worker dies, Dask moves its case to another worker, at most three times.

    Args:
        address: Address of the scheduler, as in "tcp://host:8786".

    Raises:
        InputError: If Dask is not installed, the scheduler does not answer or has no workers, or
            the workers lack this package.
    """

    window = CLUSTER_WINDOW

    def __init__(self, address: str) -> None:
        _refuse_junk(address)
        try:
            import distributed
        except ImportError:
            raise InputError(
                f"--cluster needs Dask; install it with: {how_to_install('cluster')}"
            ) from None
        # We report a lost connection in one message; silence the pages that Dask logs about it.
        for part in ("client", "core", "utils"):
            logging.getLogger(f"distributed.{part}").setLevel(logging.CRITICAL)
        try:
            self._client = distributed.Client(
                address, timeout=SCHEDULER_WAIT_S, set_as_default=False
            )
        # Dask documents no exception for a failed connection.
        except Exception as error:
            raise InputError(
                f"no Dask scheduler answers at {shorten(address)}: {shorten(str(error), 200)}"
            ) from None
        try:
            self._refuse_unable_workers(address)
        except BaseException:
            self._client.close()
            raise
        self._failure = (
            f"the Dask cluster at {address} has failed; finished cases are saved, and the same"
            " command runs the rest"
        )
        self._executor = self._client.get_executor(pure=False)
        self._killed: type[Exception] = distributed.scheduler.KilledWorker

    def _refuse_unable_workers(self, address: str) -> None:
        try:
            self._client.wait_for_workers(1, timeout=WORKER_WAIT_S)
        except TimeoutError:
            raise InputError(
                f"the Dask scheduler at {address} has no workers; start some with"
                f" 'dask worker {address} --nthreads 1'"
            ) from None
        try:
            self._client.submit(_probe_worker, pure=False).result(timeout=4 * WORKER_WAIT_S)
        except Exception as error:
            raise InputError(
                f"the workers of {address} cannot run this package ({type(error).__name__}:"
                f" {error}); install the same planner there"
            ) from None

    def submit(self, request: Request) -> Future[Row]:
        """Submit a case to the cluster."""
        answer: Future[Row] = Future()

        def done(future: Future[Row]) -> None:
            if future.cancelled():
                answer.set_exception(InputError(self._failure))
                return
            error = future.exception()
            if error is None:
                answer.set_result(future.result())
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


def _refuse_junk(address: str) -> None:
    """Refuse an invalid address of a scheduler at once; Dask would try until its timeout."""
    scheme, prefix, place = address.rpartition("://")
    host, colon, port = place.rpartition(":")
    numbered = colon and port.isascii() and port.isdigit() and 0 < int(port[:6]) < 65536
    is_scheme = not prefix or scheme in ("tcp", "tls", "ws", "wss", "ucx")
    if not (is_scheme and host and numbered and host.isprintable() and " " not in host):
        raise InputError(
            f"--cluster {shorten(address)!r} is not the address of a Dask scheduler, as in"
            " tcp://host:8786"
        )
    try:
        socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise InputError(f"no Dask scheduler answers at {shorten(address)}: {error}") from None


def _probe_worker() -> bool:
    """Return True on a worker that has this package; any other worker cannot load this function."""
    return True
