"""Ctrl-C and SIGTERM: not swallowed by compiled code, and held back where steps belong together.

Lines of solvers that tell a user nothing, kept from standard output and standard error.
"""

from __future__ import annotations

import contextlib
import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from types import FrameType
from typing import Any, Literal, TextIO, cast

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals that end a command: Ctrl-C, what `kill` and batch systems send, a closed terminal."""


RAISE_AGAIN_S = 0.01
"""Until a signal is raised again whose exception Python dropped, and again until it is not."""


class Terminated(BaseException):
    """SIGTERM or SIGHUP: end at once, but clean up. Not an `Exception`, which handlers swallow."""


class SignalListener:
    """What the command line has heard of `SIGNALS`.

    Attributes:
        signals: Numbers of the signals since `hear_signals` began.
        is_over: Whether the outcome is decided; what is heard from then on changes nothing.
        substitute: What the first Ctrl-C does in place of raising, where it finds something to do.
        was_substituted: Whether it did.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget earlier signals."""
        self.signals: list[int] = []
        self.is_over = False
        self.substitute: Callable[[], bool] | None = None
        self.was_substituted = False
        self._holders: set[object] = set()
        self._is_pending = False
        self._dropped = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """The handler: raises, unless the outcome is decided or `hold_signals` holds it back."""
        if self.is_over:
            return
        unanswered = number == signal.SIGINT and not self.was_substituted
        if unanswered and self.substitute and self.substitute():
            self.was_substituted = True
            return
        self.signals.append(number)
        if self._holders:
            self._is_pending = True
            return
        while frame is not None:
            if frame.f_code is SignalListener.take_dropped.__code__:
                return  # from there it would be dropped too
            frame = frame.f_back
        self._dropped = False
        raise self.exception

    def take_dropped(
        self, what: sys.UnraisableHookArgs, otherwise: Callable[[sys.UnraisableHookArgs], object]
    ) -> None:
        """Take what Python drops, as what a weak reference's callback or `__del__` raises.

        A signal's exception is raised again a moment later; `otherwise` takes what is none.
        """
        if not isinstance(what.exc_value, KeyboardInterrupt | Terminated) or self.is_over:
            otherwise(what)
            return
        self._dropped = True
        threading.Thread(target=self._raise_again, daemon=True).start()

    def _raise_again(self) -> None:
        while True:
            time.sleep(RAISE_AGAIN_S)
            if self.is_over or not self._dropped:
                return
            _to_main_thread(self.status - 128)

    @property
    def exception(self) -> BaseException:
        """What a signal raises; the strongest of those heard decides."""
        return KeyboardInterrupt() if self.status == 128 + signal.SIGINT else Terminated()

    @property
    def status(self) -> int:
        """The exit status that says which signal ended the command."""
        return 128 + next((n for n in self.signals if n != signal.SIGINT), signal.SIGINT)

    @contextmanager
    def hold_signals(self) -> Iterator[Callable[[], bool]]:
        """Hold signals back until the block has ended: for steps that belong together, and short.

        Yields:
            Whether a signal waits. It raises when the block ends.
        """
        if threading.current_thread() is not threading.main_thread():  # it hears no signals
            yield lambda: False
            return
        token = object()
        try:
            self._holders.add(token)
            yield lambda: self._is_pending
        finally:
            self._holders.discard(token)
            if self._is_pending and not self._holders:
                self._is_pending = False
                raise self.exception


signal_listener = SignalListener()
"""There is one main thread, and so one."""

hold_signals = signal_listener.hold_signals


@contextmanager
def hear_signals(last: bool = False) -> Iterator[None]:
    """Have `signal_listener` take the signals.

    Where one is ignored it stays so: a script's jobs in the background begin like that, and Ctrl-C
    is for what runs before them.

    Args:
        last: Whether the process ends after the block: signals are ignored from there on, so that
            the interpreter shuts down in peace.
    """
    signal_listener.begin()
    before = {number: signal.getsignal(number) for number in SIGNALS}
    mine = [number for number in SIGNALS if before[number] not in (signal.SIG_IGN, None)]
    if threading.current_thread() is not threading.main_thread():
        mine = []
    for number in mine:
        signal.signal(number, signal_listener)
    otherwise = sys.unraisablehook
    sys.unraisablehook = partial(signal_listener.take_dropped, otherwise=otherwise)
    try:
        yield
    finally:
        signal_listener.is_over = True
        sys.unraisablehook = otherwise
        for number in mine:
            signal.signal(number, signal.SIG_IGN if last else before[number])


@contextmanager
def heed_interrupts() -> Iterator[None]:
    """Raise after the block what a signal raised in it.

    CasADi catches the exception inside its solvers and returns as if the solver had failed; a
    caller would then try the next start instead of stopping.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed.
        Terminated: If the command line has heard SIGTERM.
    """
    before = {number: signal.getsignal(number) for number in SIGNALS}
    mine = {number: handler for number, handler in before.items() if callable(handler)}
    if threading.current_thread() is not threading.main_thread():
        mine = {}
    raised: list[BaseException] = []

    def note(number: int, frame: FrameType | None) -> None:
        try:
            mine[number](number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    for number in mine:
        signal.signal(number, note)
    try:
        with mute_lines("stderr", "KeyboardInterruptException"):  # CasADi's warning of it
            yield
    except SystemError:  # Python 3.13 finds the exception that CasADi has left set, and says so
        if not raised:
            raise
    finally:
        for number, handler in mine.items():
            signal.signal(number, handler)
    if raised:
        raise raised[-1]


HANDOVER_S = 0.05
"""Time for the main thread to take a signal before OSQP takes signals again."""

_osqp_lock = threading.RLock()
"""OSQP puts back the handler of Ctrl-C that it found: where two threads solve at once, the first to
end brings back the second's own, which stays for good, and the process never hears Ctrl-C again."""


def osqp_result(solver: Any) -> Any:
    """Run a set-up OSQP solver, and return its result whatever that is.

    While it runs OSQP takes Ctrl-C for itself, says so on standard output and returns as if it had
    failed; a caller would then try the next solver, or count it as late, instead of stopping. In
    its last iteration it takes it and says nothing at all. With no limit active it tells standard
    output that it need not polish, however quiet it was asked to be.
    Here whoever would have had Ctrl-C without OSQP gets it; if that does not raise, as in a thread
    beside the main one, OSQP goes on from where it was.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed, and Python's own handler is in place.
    """
    from osqp import SolverStatus

    with _osqp_lock:
        while True:
            with mute_lines("stdout", "Solver interrupted", "Polishing not needed"):
                result = solver.solve(raise_error=False)
            stopped = result.info.status_val == SolverStatus.OSQP_SIGINT
            if stopped or _osqp_interrupt_query()():
                _pass_on_interrupt()
            if not stopped:
                return result


@cache
def _osqp_interrupt_query() -> Callable[[], int]:
    """OSQP's own mark of a Ctrl-C since its last solve began, where its library shows that."""
    try:
        from osqp import ext_builtin

        mark: Callable[[], int] = ctypes.CDLL(ext_builtin.__file__).osqp_is_interrupted
    except (ImportError, OSError, AttributeError):
        return lambda: 0
    return mark


def _pass_on_interrupt() -> None:
    """Give Ctrl-C to the main thread, which may be asleep; only while OSQP does not run."""
    _to_main_thread(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread():
        time.sleep(HANDOVER_S)


def _to_main_thread(number: int) -> None:
    """A signal to the process does not wake the main thread where another thread takes it."""
    main = threading.main_thread().ident
    if main is None or sys.platform == "win32":
        signal.raise_signal(number)
    else:
        signal.pthread_kill(main, number)


@contextmanager
def mute_lines(stream: Literal["stdout", "stderr"], *words: str) -> Iterator[None]:
    """Keep lines with any of these words from a stream of the main thread, to which it belongs."""
    target = getattr(sys, stream)
    if threading.current_thread() is not threading.main_thread() or target is None:
        yield
        return
    redirect = contextlib.redirect_stdout if stream == "stdout" else contextlib.redirect_stderr
    sieve = _LineFilter(target, words)
    with redirect(cast(TextIO, sieve)):
        try:
            yield
        finally:
            sieve.end()


class _LineFilter:
    """A stream that passes on line by line, and some lines not at all."""

    def __init__(self, stream: TextIO, words: tuple[str, ...]) -> None:
        self._stream, self._words, self._begun = stream, words, ""

    def write(self, text: str) -> int:
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            if not any(word in line for word in self._words):
                self._stream.write(f"{line}\n")
        return len(text)

    def end(self) -> None:
        """Pass on a line that has not ended."""
        if self._begun:
            self._stream.write(self._begun)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
