"""The explorer as a notebook widget: messages in, messages out; all logic is in `Screen`.

One thread plans, so that the kernel can hear "stop" while it does.
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
"""Longest wait for the thread when Python ends."""


class PlanningThread:
    """A thread that does one thing after the other.

    It stays: compiled functions have buffers of their own in each thread.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[Job | None] = SimpleQueue()
        self._current: Job | None = None
        self._stopped: set[Future[Any]] = set()
        self._thread = threading.Thread(target=self._run, name="explorer", daemon=True)
        self._thread.start()
        atexit.register(self._close)

    def do(self, work: Callable[[], Value]) -> Future[Value]:
        """Do this, after all that was asked for before."""
        future: Future[Value] = Future()
        self._queue.put((work, copy_context(), future))
        return future

    def stop(self, future: Future[Any], at_once: bool) -> None:
        """End what was asked for, unless at once with what it has found so far, if anything."""
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
        """Work in a block of its own; what was stopped before it began ends where time is asked."""
        with deadline.time_limit(None):
            if future in self._stopped:
                deadline.end(copy_context(), STOP_BUTTON)
            return work()

    def _close(self) -> None:
        """End the thread before Python ends: compiled code must not find it gone."""
        self._queue.put(None)
        until = time.monotonic() + CLOSE_S
        while self._thread.is_alive() and time.monotonic() < until:
            if (doing := self._current) is not None:  # and then what was waiting
                self._end(doing[1], at_once=True)
            self._thread.join(0.05)


@cache
def worker() -> PlanningThread:
    """The one of this process: two plans at a time would only be slower."""
    return PlanningThread()


INLINE_ERRORS_S = 0.05
"""Errors on the machine that took less than this come with the picture; others follow it."""

logger = logging.getLogger("planner")

PACKAGE = "planner.explorer"
SCRIPTS = ("static/controls.js", "static/explorer.js")


class Explorer(anywidget.AnyWidget):
    """A picture of one problem whose sliders plan it anew; made by `planner.explore`."""

    _esm = script(PACKAGE, SCRIPTS)
    _css = stylesheet(PACKAGE, "static/explorer.css")

    def __init__(
        self, problem: Problem, method: str, samples: int, time_limit_s: float | None
    ) -> None:
        super().__init__()
        self._state = State.from_problem(problem, method, samples, time_limit_s)
        self._shown_screen: Screen | None = None
        self._errors_s = 0.0
        self._answer_in_work: Future[None] | None = None
        self.on_msg(self._hear)

    def __repr__(self) -> str:
        return f"Explorer({self._state.base.name!r}: sliders, where Jupyter is running)"

    @property
    def problem(self) -> Problem:
        """The problem on the screen.

        Raises:
            InputError: If the settings are impossible together.
        """
        return worker().do(lambda: self._screen.state.problem()).result()

    @property
    def plan(self) -> Plan:
        """The verified plan on the screen.

        Raises:
            PlannerError: The refusal on the screen, if there is no plan.
        """
        return worker().do(lambda: self._screen.plan()).result()

    @property
    def code(self) -> str:
        """Python code that makes the plan on the screen."""
        return worker().do(self._texts).result()["code"]

    @property
    def problem_file(self) -> str:
        """The problem on the screen as a problem file (TOML)."""
        return worker().do(self._texts).result()["file"]

    @property
    def _screen(self) -> Screen:
        """What is shown; planned in the worker, when it is first asked for."""
        if self._shown_screen is None:
            self._shown_screen = Screen(self._state)
        return self._shown_screen

    def _texts(self) -> dict[str, str]:
        return self._screen.texts()

    def _hear(self, _: Any, content: Mapping[str, Any], buffers: Any) -> None:
        """Hear one message of the browser, which waits for the answer, come what may."""
        if content.get("ask") == "stop":
            if self._answer_in_work is not None:
                worker().stop(self._answer_in_work, at_once=bool(content.get("at_once")))
        else:
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
        except Exception:  # nobody else would hear of it in this thread
            logger.exception("the explorer could not send its answer")

    def _answer(self, content: Mapping[str, Any]) -> dict[str, Any]:
        screen, what = self._screen, content.get("ask")
        if what == "texts":
            return screen.texts()
        if what == "mechanism":
            return screen.mechanism()
        if what == "judge":
            screen.judge()
            return screen.words()
        if what == "errors":
            return {"error": self._errors()}
        if what == "change":
            try:
                others = screen.set(content["changes"])
            except InputError as error:  # a control of an older picture
                return {**screen.picture(), "text": str(error), "todo": []}
            if others:  # they are there before the plan is
                now = {"controls": screen.shown_controls(), "more": True}
                self.send({"number": content["number"], **now})
            screen.plan_anew()
        if what == "reset":
            screen.reset()
        return self._picture()

    def _picture(self) -> dict[str, Any]:
        if self._errors_s < INLINE_ERRORS_S:
            return {**self._screen.picture(), "error": self._errors()}
        return {**self._screen.picture(), "todo": ["errors", *self._open]}

    def _errors(self) -> dict[str, Any] | None:
        start = time.perf_counter()
        panel = self._screen.errors()
        self._errors_s = time.perf_counter() - start if panel else self._errors_s
        return panel

    @property
    def _open(self) -> list[str]:
        """What the browser is to ask for once the sliders rest."""
        return [] if self._screen.outcome.judged else ["judge"]
