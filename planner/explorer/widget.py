"""The explorer as a notebook widget: messages in, messages out; all logic is in `Screen`."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from concurrent.futures import Future
from typing import Any

import anywidget

from planner.errors import InputError
from planner.explorer.screen import Screen
from planner.explorer.state import State
from planner.explorer.worker import worker
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.report.charts.scripts import script, stylesheet

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
            return {**screen.texts(), "todo": self._next_steps(errors=False)}
        if what == "mechanism":
            return {**screen.mechanism(), "todo": self._next_steps(errors=False)}
        if what == "judge":
            screen.judge()
            return {**screen.words(), "todo": []}
        if what == "errors":
            return {"error": self._errors(), "todo": self._next_steps(errors=False)}
        if what == "change":
            try:
                others = screen.set([(name, value) for name, value in content["changes"]])
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
        quick = self._errors_s < INLINE_ERRORS_S
        errors = {"error": self._errors()} if quick else {}
        return {**self._screen.picture(), **errors, "todo": self._next_steps(errors=not quick)}

    def _errors(self) -> dict[str, Any] | None:
        start = time.perf_counter()
        panel = self._screen.errors()
        self._errors_s = time.perf_counter() - start if panel else self._errors_s
        return panel

    def _next_steps(self, *, errors: bool) -> list[str]:
        judge = [] if self._screen.outcome.judged else ["judge"]
        return (["errors"] if errors else []) + judge
