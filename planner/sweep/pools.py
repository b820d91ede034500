"""Run cases in this process, or in processes of this computer; `cluster` has a third kind of pool.

A process of this computer runs `serve`: prints `ready`, then reads one request per line from
standard input and prints one row per line on standard output, both JSON. The process ends when its
standard input closes, so that it never outlives its parent.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue

from planner.errors import InputError
from planner.support.package import ROOT
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


class Pool:
    """What runs the cases of a sweep: here this process, one after the other, for debuggers.

    Attributes:
        window: Largest number of submitted cases that are not finished.
    """

    window = 1

    def submit(self, request: Request) -> Future[Row]:
        """Submit a case; the returned future raises only if the pool itself has failed."""
        future: Future[Row] = Future()
        future.set_result(run_case(request))
        return future

    def trouble(self) -> str:
        """Return in a sentence why the pool stands still; "" if it does not.

        Raises:
            InputError: If the pool cannot be used.
        """
        return ""

    def close(self) -> None:
        """Cancel running and waiting cases, and release processes and connections."""


class LocalPool(Pool):
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
