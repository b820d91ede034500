"""Handle Ctrl-C and SIGTERM, and hide useless lines that solvers print.

Compiled code must not swallow a signal, and some short steps must not be interrupted.
"""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from functools import cache, partial
from types import FrameType
from typing import Any, TextIO, cast

SIGNALS = tuple(getattr(signal, s) for s in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, s))
"""Signals that end a command: Ctrl-C, `kill` and batch systems, a closed terminal."""


class Terminated(BaseException):
    """SIGTERM or SIGHUP arrived: clean up and end. `except Exception` lets this exception pass."""


class SignalListener:
    """The command line's handler of `SIGNALS`, which raises an exception at once.

    Python drops an exception raised in `__del__` or in a weak reference's callback; the next call
    of `check` then raises the exception again.

    Attributes:
        signals: Numbers of the signals received since `hear_signals` began.
        is_over: Whether the outcome is decided; later signals are ignored.
        substitute: Called at the first Ctrl-C; if it returns true, no exception is raised.
        was_substituted: Whether `substitute` returned true.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget received signals and `substitute` before a new command."""
        self.signals: list[int] = []
        self.is_over = False
        self.substitute: Callable[[], bool] | None = None
        self.was_substituted = False
        self._is_dropped = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Raise the exception of a received signal, unless the outcome is decided.

        A first Ctrl-C raises nothing if `substitute` returns true.
        """
        if self.is_over:
            return
        unanswered = number == signal.SIGINT and not self.was_substituted
        if unanswered and self.substitute and self.substitute():
            self.was_substituted = True
            return
        self.signals.append(number)
        raise self.exception

    def note_dropped(
        self, what: sys.UnraisableHookArgs, otherwise: Callable[[sys.UnraisableHookArgs], object]
    ) -> None:
        """Note that Python dropped a signal's exception; let `otherwise` handle any other one."""
        if isinstance(what.exc_value, KeyboardInterrupt | Terminated):
            self._is_dropped = True
        else:
            otherwise(what)

    def check(self) -> None:
        """Raise a signal's exception again if Python has dropped it."""
        if self._is_dropped:
            self._is_dropped = False
            raise self.exception

    @property
    def exception(self) -> BaseException:
        """The exception for the received signals; signals other than Ctrl-C take precedence."""
        return KeyboardInterrupt() if self.status == 128 + signal.SIGINT else Terminated()

    @property
    def status(self) -> int:
        """Exit status of a command that the received signals ended."""
        return 128 + next((n for n in self.signals if n != signal.SIGINT), signal.SIGINT)


signal_listener = SignalListener()
"""The listener of this process, in which only the main thread receives signals."""

_waiting: list[int] = []
"""Numbers of the signals that arrived inside `hold_signals` and wait to be handled."""

_handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
"""The handlers that `hold_signals` replaced."""


def _note(number: int, frame: FrameType | None) -> None:
    _waiting.append(number)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def handle_signals() -> None:
    """Handle the signals that `hold_signals` holds back; every check of the time limit does so.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed.
        Terminated: If the command line received SIGTERM or SIGHUP.
    """
    if not _in_main_thread():  # other threads get no signals
        return
    waiting = sorted(_waiting, key=lambda number: number == signal.SIGINT)
    _waiting.clear()
    for number in waiting:
        _handlers[number](number, None)
    signal_listener.check()


@contextmanager
def hold_signals() -> Iterator[None]:
    """Hold signals back until the block ends or calls `handle_signals`.

    This is for short steps that must not be separated, and for compiled code that may swallow the
    exception of a handler: CasADi then returns as if its solver had failed.

    Raises:
        KeyboardInterrupt: As for `handle_signals`.
    """
    handlers = {n: signal.getsignal(n) for n in SIGNALS} if _in_main_thread() else {}
    mine = {n: each for n, each in handlers.items() if callable(each) and each is not _note}
    try:
        for number in mine:
            _handlers[number] = mine[number]
            signal.signal(number, _note)
        yield
    finally:
        for number, handler in mine.items():
            signal.signal(number, handler)
        if mine:
            handle_signals()


@contextmanager
def hear_signals(last: bool = False) -> Iterator[None]:
    """Handle signals with `signal_listener` inside a block.

    Ignored signals stay ignored: a shell script starts its background jobs with Ctrl-C ignored,
    because Ctrl-C is meant for the foreground job.

    Args:
        last: Whether the process ends after the block; signals after the block are then ignored,
            so that nothing disturbs the interpreter's shutdown.
    """
    signal_listener.begin()
    before = {n: signal.getsignal(n) for n in SIGNALS} if _in_main_thread() else {}
    mine = [n for n, handler in before.items() if handler not in (signal.SIG_IGN, None)]
    for number in mine:
        signal.signal(number, signal_listener)
    otherwise = sys.unraisablehook
    sys.unraisablehook = partial(signal_listener.note_dropped, otherwise=otherwise)
    try:
        yield
    finally:
        signal_listener.is_over = True
        sys.unraisablehook = otherwise
        for number in mine:
            signal.signal(number, signal.SIG_IGN if last else before[number])


HANDOVER_S = 0.05
"""Seconds for the main thread to take a signal before OSQP runs and takes signals again."""

_osqp_lock = threading.RLock()
"""Lock that lets one thread at a time run OSQP, which restores the Ctrl-C handler it found. If two
threads ran at once, one would restore OSQP's own handler for good, and disable Ctrl-C."""


def osqp_result(solver: Any) -> Any:
    """Run a prepared OSQP solver and return its result, solved or not.

    A running OSQP catches Ctrl-C and returns as if it had failed, or normally in its last
    iteration; the caller would then try the next solver instead of stopping. This function
    therefore passes Ctrl-C on to the handler that was active before. If that handler does not
    raise, as in a thread other than the main one, OSQP continues where it was. The lines that OSQP
    prints on an interruption and on polishing are hidden.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed and Python's own handler is active.
    """
    from osqp import SolverStatus

    with _osqp_lock:
        while True:
            with mute_lines("Solver interrupted", "Polishing not needed"):
                result = solver.solve(raise_error=False)
            stopped = result.info.status_val == SolverStatus.OSQP_SIGINT
            if stopped or _osqp_interrupt_query()():
                _pass_on_interrupt()
            if not stopped:
                return result


@cache
def _osqp_interrupt_query() -> Callable[[], int]:
    """Return OSQP's function that tells whether Ctrl-C came in the last solve (1) or not (0).

    If OSQP lacks this function, return one that always says no.
    """
    try:
        from osqp import ext_builtin

        mark: Callable[[], int] = ctypes.CDLL(ext_builtin.__file__).osqp_is_interrupted
    except (ImportError, OSError, AttributeError):
        return lambda: 0
    return mark


def _pass_on_interrupt() -> None:
    """Send Ctrl-C to the main thread, which may be asleep; call this while OSQP is not running."""
    main = threading.main_thread().ident
    if main is None or sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)
    else:
        signal.pthread_kill(main, signal.SIGINT)
    if not _in_main_thread():
        time.sleep(HANDOVER_S)


@contextmanager
def mute_lines(*words: str) -> Iterator[None]:
    """Hide lines with any of the words from standard output; in the main thread only."""
    target = sys.stdout
    if not _in_main_thread() or target is None:
        yield
        return
    with redirect_stdout(cast(TextIO, _LineFilter(target, words))):
        yield


class _LineFilter:
    """A stream that passes on lines, except those with certain words."""

    def __init__(self, stream: TextIO, words: tuple[str, ...]) -> None:
        self._stream, self._words = stream, words

    def write(self, text: str) -> int:
        kept = [t for t in text.splitlines(keepends=True) if not any(w in t for w in self._words)]
        self._stream.write("".join(kept))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
