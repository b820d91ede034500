"""The exceptions of `planner`.

There are two kinds: the input is wrong (`InputError`), or the input is right and no plan can be
returned for it (`NoPlanError`). Both carry the data that explain them.
"""

from __future__ import annotations

import inspect
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar


@dataclass(frozen=True)
class Violation:
    """One requirement that a motion breaks.

    Attributes:
        label: What is broken, in words ("input u2", "joint theta3", "goal theta2").
        time_s: Time of the largest violation, in seconds; None if it belongs to no time.
        value: The value reached.
        limit: The value allowed; NaN where no number is allowed, and `label` says all.
        unit: Unit of `value` and `limit`.
        scaled: Violation divided by the scale of the requirement, for sorting (dimensionless).
        exact: Whether the value must be `limit` itself, as a duration must.
    """

    label: str
    time_s: float | None
    value: float
    limit: float
    unit: str
    scaled: float
    exact: bool = False

    def __str__(self) -> str:
        if math.isnan(self.limit):
            return self.label
        when = "" if self.time_s is None else f" at t = {self.time_s:.4g} s"
        value, limit, unit = self.shown(4)
        verb, allowed = self.verbs
        return f"{self.label} {verb} {value}{unit}{when}, {allowed} {limit}{unit}"

    @property
    def verbs(self) -> tuple[str, str]:
        """The words before value and limit."""
        return ("is", "must be") if self.exact else ("reaches", "allowed")

    def shown(self, digits: int) -> tuple[str, str, str]:
        """Value, limit and unit as text; angles in degrees, as problem files give them.

        Args:
            digits: Significant digits; more are used where value and limit would look equal.
        """
        angle = self.unit == "rad"
        value, limit = (math.degrees(v) if angle else v for v in (self.value, self.limit))
        while f"{value:.{digits}g}" == f"{limit:.{digits}g}" and value != limit and digits < 12:
            digits += 1
        unit = " deg" if angle else f" {self.unit}" if self.unit else ""
        return f"{value:.{digits}g}", f"{limit:.{digits}g}", unit


class PlannerError(Exception):
    """Base class of all errors that this package raises on purpose."""

    exit_status = 1


LONGEST_LINE, LONGEST_TEXT = 1000, 5000
"""Characters of a message. Longer is only what it quotes; a terminal shows 5000 at once."""


class InputError(PlannerError, ValueError):
    """A file, key, value or option that cannot be used; the message says what is allowed.

    Of what is too long to be read it keeps the beginning and the end.
    """

    exit_status = 2

    def __init__(self, message: str = "") -> None:
        lines = (_shortened(line, LONGEST_LINE) for line in message.split("\n"))
        super().__init__(_shortened("\n".join(lines), LONGEST_TEXT))


def _shortened(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    end = longest // 3
    return f"{text[: longest - end - 5]} ... {text[-end:]}"


NO_MEMORY = (
    "there is not enough memory for this ({}); ask for less at a time: fewer machines or cases,"
    " fewer workers, a coarser step or mesh"
)
"""What a user is told in place of a bug."""


def lacks_memory(error: BaseException) -> bool:
    """Whether an error says that memory ran out; compiled code has its own word for it."""
    return isinstance(error, MemoryError) or "std::bad_alloc" in str(error)


class InputWarning(UserWarning):
    """Input that can be used but looks like a mistake."""


def expect(kind: type, value: object, how: str) -> None:
    """Refuse an argument of another kind, such as the name of a file or a problem for a plan.

    Args:
        kind: What it must be.
        value: The argument.
        how: How to get one, for the message.

    Raises:
        InputError: If it is something else.
    """
    if not isinstance(value, kind):
        shown = textwrap.shorten(repr(value), 60, placeholder="...")
        raise InputError(f"{shown} is not a {kind.__name__}; {how}")


Class = TypeVar("Class", bound=type)


def made_by(how: str) -> Callable[[Class], Class]:
    """For a class that nobody fills in by hand: calling it with too little says how it is made.

    Args:
        how: What to write instead, for the message.
    """

    def wrapped(cls: Class) -> Class:
        fill: Any = vars(cls)["__init__"]
        signature = inspect.signature(fill)

        @wraps(fill)
        def checked(*given: Any, **by_name: Any) -> None:
            try:
                fill(*given, **by_name)
            except TypeError:
                try:
                    signature.bind(*given, **by_name)
                except TypeError as error:
                    name = cls.__name__
                    raise InputError(f"planner.{name}(...): {error}; {how} makes one") from None
                raise

        setattr(cls, "__init__", checked)  # noqa: B010
        return cls

    return wrapped


class UntrackableError(InputError):
    """A plan that feedback cannot follow, because the motors would exceed their speed limit.

    Attributes:
        why: Which one and how fast, in few words.
    """

    def __init__(self, message: str, *, why: str) -> None:
        self.why = why
        super().__init__(message)


class NoPlanError(PlannerError):
    """No plan exists, or none was found, or the one found failed its verification.

    Attributes:
        plan: The last iterate, for study, or None. Do not execute it.
        violations: Requirements that the iterate breaks, the worst first (by scaled violation).
        changes: Changes of the problem that may help, as data (`planner.methods.refusal.Change`).
        otherwise: Other advice in words, or None.
        advice: Both in words, or None. Once the changes have been tried, only those that work.
        blamed: The requirement that was left out to find `plan`, in words, or "".
    """

    exit_status = 3
    status = "no_plan"
    blamed = ""

    def __init__(
        self,
        message: str,
        *,
        plan: Any = None,
        violations: Sequence[Violation] = (),
        advice: str | None = None,
        changes: Sequence[Any] = (),
    ) -> None:
        self.reason = message
        self.plan = plan
        self.violations = tuple(sorted(violations, key=lambda v: -v.scaled))
        self.changes = tuple(changes)
        self.otherwise = advice
        super().__init__()
        self.advise(*(str(change) for change in changes if not change.method), advice)

    def advise(self, *words: str | None) -> None:
        """Set the advice, followed by the other methods among the changes."""
        others = (str(change) for change in self.changes if change.method)
        self.advice = "; or ".join(each for each in (*words, *others) if each) or None
        self.args = (self._text(),)

    def blame(self, requirement: str, plan: Any, broken: Sequence[Violation]) -> None:
        """Name the requirement without which there is this plan, and how that breaks it."""
        self.reason += f"; without {requirement} there is one, which breaks:"
        self.plan, self.violations, self.blamed = plan, tuple(broken), requirement
        self.args = (self._text(),)

    def _text(self) -> str:
        lines = [self.reason, *(f"  - {v}" for v in self.violations[:8])]
        if len(self.violations) > 8:
            lines.append(f"  - and {len(self.violations) - 8} more")
        if self.advice:
            lines.append(f"Try: {self.advice}")
        return "\n".join(lines)


class SingularError(NoPlanError):
    """The path leaves the domain of the chained-form chart: a part of it has no real joint angles.

    Attributes:
        times_s: Times at which the path leaves or re-enters the domain, in seconds.
    """

    status = "singular"

    def __init__(
        self,
        message: str,
        *,
        times_s: Sequence[float] = (),
        plan: Any = None,
        violations: Sequence[Violation] = (),
        advice: str | None = None,
        changes: Sequence[Any] = (),
    ) -> None:
        self.times_s = tuple(times_s)
        super().__init__(message, plan=plan, violations=violations, advice=advice, changes=changes)


class InfeasibleError(NoPlanError):
    """It is proven that no plan of the requested kind exists; the message contains the proof.

    Attributes:
        certificate: Numbers that prove it, if the method provides them, or None.
    """

    status = "infeasible"
    certificate: Mapping[str, Any] | None = None


class MethodError(NoPlanError):
    """A method or a limit of another package failed, or a method returned no plan. Names both.

    Attributes:
        traceback: Where it failed, for the author of that package, or "".
    """

    status = "method_failed"

    def __init__(self, message: str, *, traceback: str = "") -> None:
        self.traceback = traceback
        super().__init__(message)


class NotConvergedError(NoPlanError):
    """The solver stopped without a plan. This does not prove that none exists."""

    status = "not_converged"


class TimeLimitError(NoPlanError):
    """The time limit ended before there was a verified plan; the message says how far the search
    got."""

    status = "time_limit"


class VerificationError(NoPlanError):
    """A motion was found, but the independent verification found a broken requirement.

    Attributes:
        check: The complete result of the verification, or None.
    """

    status = "verification_failed"
    check: Any = None
