"""Cases on a Dask cluster."""

from __future__ import annotations

import logging
import socket
from concurrent.futures import Future
from typing import Any

from planner.display import brief
from planner.distribution import how_to_install
from planner.errors import InputError
from planner.sweep.case import Request, Row, run_case
from planner.sweep.pools import died

WINDOW = 500
"""Cases handed to the scheduler at once; workers may come and go meanwhile."""

ANSWER_S = 4.0
"""How long to wait for the scheduler, which is there or is not."""

PATIENCE_S = 15.0
"""How long to wait for the first worker."""


class ClusterPool:
    """The workers of a Dask scheduler; see `dask worker --nthreads 1`.

    A case whose worker dies goes to another one, by Dask's own rule at most three times.

    Args:
        address: The scheduler's, as in "tcp://host:8786".

    Raises:
        InputError: If Dask is not installed, the scheduler does not answer or has no workers, or
            they lack this package.
    """

    window = WINDOW

    def __init__(self, address: str) -> None:
        _refuse_junk(address)
        distributed = _distributed()
        # A lost connection is one message of ours, not pages from Dask's own threads.
        for part in ("client", "core", "utils"):
            logging.getLogger(f"distributed.{part}").setLevel(logging.CRITICAL)
        try:
            self._client = distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
        # Dask raises whatever the part of it that meets a strange answer raises.
        except Exception as error:
            raise InputError(
                f"no Dask scheduler answers at {brief(address)}: {brief(str(error), 200)}"
            ) from None
        try:
            self._refuse_unable(address)
        except BaseException:
            self._client.close()
            raise
        self._address = address
        self._executor = self._client.get_executor(pure=False)
        self._killed: type[Exception] = distributed.scheduler.KilledWorker

    def _refuse_unable(self, address: str) -> None:
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError:
            raise InputError(
                f"the Dask scheduler at {address} has no workers; start some with"
                f" 'dask worker {address} --nthreads 1'"
            ) from None
        try:
            self._client.submit(_able, pure=False).result(timeout=4 * PATIENCE_S)
        except Exception as error:
            raise InputError(
                f"the workers of {address} cannot run this package ({type(error).__name__}:"
                f" {error}); install the same planner there"
            ) from None

    def submit(self, request: Request) -> Future[Row]:
        """Hand over a case."""
        answer: Future[Row] = Future()

        def done(future: Future[Row]) -> None:
            if future.cancelled():
                answer.set_exception(InputError(self._lost))
                return
            error = future.exception()
            if error is None:
                answer.set_result(future.result())
            elif isinstance(error, self._killed):
                answer.set_result(died("every worker of the cluster that ran it died"))
            else:
                answer.set_exception(InputError(f"{self._lost} ({type(error).__name__}: {error})"))

        self._executor.submit(run_case, request).add_done_callback(done)
        return answer

    @property
    def _lost(self) -> str:
        return (
            f"the Dask cluster at {self._address} has failed; finished cases are kept, and the same"
            " command goes on with the rest"
        )

    def close(self) -> None:
        """Drop what runs and what waits, and leave the cluster as it was."""
        self._executor.shutdown(wait=False)
        self._client.close()


def _refuse_junk(address: str) -> None:
    """Refuse at once what is no address; Dask would look for it until its patience ends."""
    scheme, given, place = address.rpartition("://")
    host, colon, port = place.rpartition(":")
    numbered = colon and port.isascii() and port.isdigit() and 0 < int(port[:6]) < 65536
    known = not given or scheme in ("tcp", "tls", "ws", "wss", "ucx")
    if not (known and host and numbered and host.isprintable() and " " not in host):
        raise InputError(
            f"--cluster {brief(address)!r} is not the address of a Dask scheduler, as in"
            " tcp://host:8786"
        )
    try:
        socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise InputError(f"no Dask scheduler answers at {brief(address)}: {error}") from None


def _able() -> bool:
    """Runs on a worker; unpickling it there needs this package."""
    return True


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise InputError(
            f"--cluster needs Dask; install it with: {how_to_install('cluster')}"
        ) from None
    return distributed
