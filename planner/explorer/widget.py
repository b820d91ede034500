"""The explorer as a notebook widget, which exchanges messages with the browser.

The logic is in `Screen`. Planning runs in its own thread, so that the kernel can receive "stop"
meanwhile.
"""

from __future__ import annotations

import atexit
import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextvars import Context, copy_context
from functools import cache
from queue import SimpleQueue
from typing import Any, TypeVar

import anywidget

from planner.errors import InputError
from planner.explorer.screen import Screen
from planner.explorer.state import State
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.charts.scripts import script, stylesheet
from planner.support import deadline

Value = TypeVar("Value")

Job = tuple[Callable[[], Any], Context, Future[Any]]

STOP_BUTTON = "the Stop button"

CLOSE_S = 5.0
"""Longest wait for the planning thread when Python ends, in seconds."""


class PlanningThread:
    """A thread that runs one task after the other.

    All tasks share one thread, because compiled functions allocate buffers for each new thread.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[Job | None] = SimpleQueue()
        self._current: Job | None = None
        self._stopped: set[Future[Any]] = set()
        self._thread = threading.Thread(target=self._run, name="explorer", daemon=True)
        self._thread.start()
        atexit.register(self._close)

    def do(self, work: Callable[[], Value]) -> Future[Value]:
        """Queue a task behind all earlier tasks, and return its future."""
        future: Future[Value] = Future()
        self._queue.put((work, copy_context(), future))
        return future

    def stop(self, future: Future[Any], at_once: bool) -> None:
        """Stop a task; unless `at_once`, a search may still refine the answer that it has."""
        self._stopped.add(future)
        if self._current is not None and self._current[2] is future:
            self._end(self._current[1], at_once)

    def _end(self, context: Context, at_once: bool) -> None:
        if at_once or not deadline.stop(context, STOP_BUTTON):
            deadline.end(context, STOP_BUTTON)

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            work, context, future = self._current = job
            try:
                future.set_result(context.run(self._run_limited, work, future))
            except BaseException as error:
                future.set_exception(error)
            self._current = None
            self._stopped.discard(future)

    def _run_limited(self, work: Callable[[], Value], future: Future[Value]) -> Value:
        """Run a task that `stop` can end; a task stopped while queued ends at its first check."""
        with deadline.time_limit(None):
            if future in self._stopped:
                deadline.end(copy_context(), STOP_BUTTON)
            return work()

    def _close(self) -> None:
        """Stop the thread before Python ends, so that no compiled code runs during shutdown."""
        self._queue.put(None)
        until = time.monotonic() + CLOSE_S
        while self._thread.is_alive() and time.monotonic() < until:
            if (doing := self._current) is not None:  # waiting tasks follow
                self._end(doing[1], at_once=True)
            self._thread.join(0.05)


@cache
def worker() -> PlanningThread:
    """Return the only planning thread of this process; two plans at a time would be slower."""
    return PlanningThread()


logger = logging.getLogger("planner")

PACKAGE = "planner.explorer"
SCRIPTS = ("static/controls.js", "static/explorer.js")


class Explorer(anywidget.AnyWidget):
    """A widget with sliders for a problem and figures of its plan; `planner.explore` returns it."""

    _esm = script(PACKAGE, SCRIPTS)
    _css = stylesheet(PACKAGE, "static/explorer.css")

    def __init__(
        self, problem: Problem, method: str, samples: int, time_limit_s: float | None
    ) -> None:
        super().__init__()
        self._state = State.from_problem(problem, method, samples, time_limit_s)
        self._shown_screen: Screen | None = None
        self._answer_in_work: Future[None] | None = None
        self.on_msg(self._hear)

    def __repr__(self) -> str:
        return f"Explorer({self._state.base.name!r}: sliders, where Jupyter is running)"

    @property
    def problem(self) -> Problem:
        """The problem on the screen.

        Raises:
            InputError: If the settings contradict each other.
        """
        return worker().do(lambda: self._screen.state.problem()).result()

    @property
    def plan(self) -> Plan:
        """The verified plan on the screen.

        Raises:
            PlannerError: The refusal on the screen, if the plan is refused.
        """
        return worker().do(lambda: self._screen.plan()).result()

    @property
    def code(self) -> str:
        """Python code that makes the plan on the screen."""
        return worker().do(lambda: self._screen.texts()).result()["code"]

    @property
    def problem_file(self) -> str:
        """The problem on the screen as a problem file (TOML)."""
        return worker().do(lambda: self._screen.texts()).result()["file"]

    @property
    def _screen(self) -> Screen:
        """The screen; the planning thread creates it on first use and makes the first plan."""
        if self._shown_screen is None:
            self._shown_screen = Screen(self._state)
        return self._shown_screen

    def _hear(self, _: Any, content: Mapping[str, Any], buffers: Any) -> None:
        """Handle a message from the browser: stop the current answer, or queue the next answer.

        Each request is confirmed at once: a page whose kernel was restarted would wait for ever.
        """
        if content.get("ask") == "stop":
            if self._answer_in_work is not None:
                worker().stop(self._answer_in_work, at_once=bool(content.get("at_once")))
        else:
            self.send({"number": content.get("number"), "heard": True})
            self._answer_in_work = worker().do(lambda: self._reply(content))

    def _reply(self, content: Mapping[str, Any]) -> None:
        try:
            answer = self._answer(content)
            answer.setdefault("todo", self._open)
        except Exception as error:
            logger.exception("the explorer could not answer")
            answer = {"kind": "a bug", "text": f"{type(error).__name__}: {error}", "todo": []}
        try:
            self.send({"number": content.get("number"), "facts": "", **answer})
        except Exception:  # nothing else reports an error in this thread
            logger.exception("the explorer could not send its answer")

    def _answer(self, content: Mapping[str, Any]) -> dict[str, Any]:
        screen, what = self._screen, content.get("ask")
        parts = {"texts": screen.texts, "mechanism": screen.mechanism}
        parts |= {"errors": screen.errors, "second": screen.second}
        if what in parts:
            return parts[what]()
        if what == "judge":
            screen.judge()
            return screen.words()
        if what not in ("picture", "change", "reset"):
            raise ValueError(f"the page asks for {what!r:.40}, which the explorer does not know")
        if what == "change":
            try:
                others = screen.set(content["changes"])
            except InputError as error:  # a control that no longer exists
                return {**screen.picture(), "text": str(error), "todo": []}
            if others:  # show them before planning ends
                now = {"controls": screen.shown_controls(), "more": True}
                self.send({"number": content["number"], **now})
            screen.plan_anew()
        if what == "reset":
            screen.reset()
        return {**screen.picture(), "todo": ["errors", *self._open]}

    @property
    def _open(self) -> list[str]:
        """The steps that the browser requests once the user stops moving sliders."""
        return [] if self._screen.outcome.judged else ["judge"]
