"""Plan for the settings on the screen, verify the plan, and replay it on random machines.

These are three steps: `path`, `judge` and `errors`. Planning is quick; the other steps run when the
user stops moving sliders.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from planner.compensation import compensate_in_time
from planner.errors import InputError, NoPlanError, PlannerError, TimeLimitError
from planner.explorer.control import travel_range
from planner.explorer.state import State
from planner.machine.replay import RECORD_S, Replay, replay
from planner.methods.judgement import judge_plan
from planner.methods.registry import Method, find_method, merged_options
from planner.plan.plan import Plan
from planner.problem.feasibility import refuse_too_short
from planner.problem.problem import Problem
from planner.support import deadline
from planner.support.deadline import TimeUpError, time_limit


@dataclass(frozen=True)
class ScreenOutcome:
    """The result of planning for the settings on the screen.

    Attributes:
        state: The settings.
        problem: The problem that the settings make; None if they make no valid problem.
        plan: The motion to draw, which after a refusal is only a path for study; None if there is
            no path.
        error: Why there is no plan, or None.
        judged: Whether the plan has been verified or refused.
    """

    state: State
    problem: Problem | None
    plan: Plan | None
    error: PlannerError | None = None
    judged: bool = False

    @property
    def kind(self) -> str:
        """The result in a word: "verified", "not judged yet", "stopped", or the kind of refusal."""
        if isinstance(self.error, NoPlanError):
            return self.error.status.replace("_", " ")
        if self.error is not None:
            return "bad input"
        return "verified" if self.judged else "not judged yet"


def path(state: State) -> ScreenOutcome:
    """Plan for the settings within their time limit; only a compensated plan is verified."""
    try:
        problem = state.problem()
        method = find_method(state.method)
        options = merged_options(problem, method, {})
    except InputError as error:
        return ScreenOutcome(state, None, None, error, judged=True)
    with time_limit(getattr(options, "time_limit_s", None) or state.time_limit_s) as span:
        try:
            refuse_too_short(problem)
            compensates = problem.compensation.on
            part = deadline.SEARCH_SHARE if compensates else 1.0
            with deadline.time_share(part, condition=deadline.holds_answer):
                plan = method.plan(problem, options)
            if compensates and plan.status != "singular":
                plan = compensate_in_time(*judge_plan(plan), None, problem.compensation)[0]
            return ScreenOutcome(state, problem, plan, judged=plan.verified)
        except InputError as error:
            return ScreenOutcome(state, problem, None, error, judged=True)
        except TimeUpError:
            reason = f"{span.why} ended the method '{method.name}' before it had a plan"
            refusal: NoPlanError = TimeLimitError(
                reason, source=problem.source, advice=deadline.time_advice()
            )
        except NoPlanError as error:
            refusal = error
        if span.ended_by or refusal.status == "interrupted":
            refusal.status = "stopped"
        motion = refusal.plan
        if motion is None and not isinstance(refusal, TimeLimitError):
            with suppress(TimeUpError):
                motion = _study_path(problem, method, options)
        motion = None if motion is None else replace(motion, status=refusal.status)
        return ScreenOutcome(state, problem, motion, refusal, judged=True)


def judge(outcome: ScreenOutcome) -> ScreenOutcome:
    """Return an outcome with its plan verified, unless the plan is already verified or refused."""
    if outcome.judged or outcome.plan is None:
        return outcome
    try:
        plan, _ = judge_plan(outcome.plan)
    except TimeUpError:
        ended = TimeLimitError(
            "the Stop button ended the verification",
            source=outcome.plan.problem.source,
            advice="change any setting; this starts planning and verification again",
        )
        ended.status = "stopped"
        return replace(outcome, error=ended, judged=True)
    except NoPlanError as error:
        if error.status == "interrupted":
            error.status = "stopped"
        return replace(outcome, plan=error.plan, error=error, judged=True)
    return replace(outcome, plan=plan, judged=True)


def errors(outcome: ScreenOutcome) -> Replay | None:
    """Return the plan's replay on random machines; None if not executable or time is up."""
    plan, state = outcome.plan, outcome.state
    if plan is None or not plan.executable or not state.samples:
        return None
    record = max(2 * RECORD_S, plan.duration / 200)
    with time_limit(state.time_limit_s), suppress(TimeUpError):
        return replay(
            plan, None, state.samples, 0, state.feedback, record_s=record,
            progress=lambda *_: deadline.check(),
        )  # fmt: skip
    return None


def _study_path(problem: Problem, method: Method, options: Any) -> Plan | None:
    """Return a path, perhaps outside the domain, to show after a refusal; None if none is found."""
    if "allow_singular" in method.options.model_fields:
        options = options.model_copy(update={"allow_singular": True})
    tasks = [problem]
    if problem.travel is None and problem.travel_key:
        # A law that finds no travel gets the middle of the slider.
        tasks.append(problem.with_travel(travel_range(problem)[2]))
    for task in tasks:
        try:
            return method.plan(task, options)
        except NoPlanError as error:
            if error.plan is not None:
                plan: Plan = error.plan
                return plan
        except InputError:
            pass
    return None
