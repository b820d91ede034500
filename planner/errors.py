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
from numbers import Integral, Real
from typing import Any, TypeVar


@dataclass(frozen=True)
class Part:
    """One value of a demand that must lie between `low` and `high`.

    Attributes:
        label: Name of the limited value, as in "input u2"; unique within a problem.
        unit: Unit of value and limits.
        low: Least value; may be −∞.
        high: Largest value; may be ∞.
        scale: Divisor that makes an excess comparable with those of other parts, in the unit.
        index: Index of the input or coordinate, from 0.
        key: Dotted key of the problem file that sets the limit; "" if there is none.
    """

    label: str
    unit: str = ""
    low: float = math.nan
    high: float = math.nan
    scale: float = 1.0
    index: int = 0
    key: str = ""


@dataclass(frozen=True)
class Violation:
    """One requirement that a motion breaks.

    Attributes:
        part: The broken part of the demand.
        value: The value reached.
        limit: The value allowed; NaN if there is no number, and the label is the whole text.
        time_s: Time of the largest violation, in seconds; None if it has no time.
        demand: The demand of the problem, or None for a flaw of the plan itself.
    """

    part: Part
    value: float = math.nan
    limit: float = math.nan
    time_s: float | None = None
    demand: Any = None

    @property
    def label(self) -> str:
        """What is broken, in words ("input u2", "joint theta3", "goal theta2")."""
        return self.part.label

    @property
    def unit(self) -> str:
        """Unit of `value` and `limit`."""
        return self.part.unit

    @property
    def exact(self) -> bool:
        """Whether the value must equal `limit`, as for a duration."""
        return self.part.low == self.part.high

    @property
    def misses_goal(self) -> bool:
        """Whether the goal is not reached."""
        return getattr(self.demand, "at_goal", False)

    @property
    def scaled(self) -> float:
        """Excess divided by the scale of the part, for sorting; infinite for a flaw."""
        is_flaw = math.isnan(self.limit)
        return math.inf if is_flaw else abs(self.value - self.limit) / self.part.scale

    def __str__(self) -> str:
        if math.isnan(self.limit):
            return self.label
        when = "" if self.time_s is None else f" at t = {self.time_s:.4g} s"
        value, limit, unit = self.shown(4)
        verb, allowed = self.verbs
        return f"{self.label} {verb} {value}{unit}{when}, {allowed} {limit}{unit}"

    @property
    def verbs(self) -> tuple[str, str]:
        """The words before the value and before the limit in a message."""
        return ("is", "must be") if self.exact else ("reaches", "allowed")

    def shown(self, digits: int) -> tuple[str, str, str]:
        """Return value, limit and unit as text; angles are in degrees, as in problem files.

        Args:
            digits: Significant digits; more are used if value and limit would look equal.
        """
        angle = self.unit == "rad"
        value, limit = (math.degrees(v) if angle else v for v in (self.value, self.limit))
        while f"{value:.{digits}g}" == f"{limit:.{digits}g}" and value != limit and digits < 17:
            digits += 1
        unit = " deg" if angle else f" {self.unit}" if self.unit else ""
        return f"{value:.{digits}g}", f"{limit:.{digits}g}", unit


class PlannerError(Exception):
    """Base class of all errors that this package raises on purpose."""

    exit_status = 1


LONGEST_LINE, LONGEST_TEXT = 1000, 5000
"""Most characters of one line and of a whole message; only quoted input needs shortening."""


class InputError(PlannerError, ValueError):
    """A file, key, value or option that cannot be used; the message says what is allowed.

    A message that is too long to read keeps its beginning and its end.

    Attributes:
        source: The file or other origin of the input, or ""; the message begins with it.
        body: The message without the source, one or more lines.
        sentence: The first line of `body`.
    """

    exit_status = 2

    def __init__(self, message: str = "", source: str = "") -> None:
        self.source, self.body = source, _shorten(message)
        self.sentence, *_ = self.body.splitlines() or [""]
        super().__init__(_shorten(f"{source}: {message}" if source else message))


def _shorten(text: str) -> str:
    return _cut("\n".join(_cut(line, LONGEST_LINE) for line in text.split("\n")), LONGEST_TEXT)


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    end = longest // 3
    return f"{text[: longest - end - 5]} ... {text[-end:]}"


NO_MEMORY = (
    "there is not enough memory for this ({}); use fewer machines, cases or workers, or a coarser"
    " step or mesh"
)
"""Message when memory runs out, in place of a bug report; {} stands for Python's own message."""


def lacks_memory(error: BaseException) -> bool:
    """Return whether an error says that memory ran out, in Python or in compiled code."""
    return isinstance(error, MemoryError) or "std::bad_alloc" in str(error)


Answer = TypeVar("Answer")


def solver_answer(call: Callable[[], Answer], otherwise: Callable[[str], Answer]) -> Answer:
    """Return the answer of a solver call, or a substitute if the solver fails with an error.

    Args:
        call: Calls a solver of CasADi, OSQP or SciPy, and does nothing else.
        otherwise: Makes the substitute from the last line of the solver's error message.

    Raises:
        Exception: Any error from elsewhere: time is up, memory ran out, or an error of this
            package.
    """
    try:
        return call()
    except Exception as error:
        kinds = {kind.__name__ for kind in type(error).__mro__}
        of_solver = kinds & {"RuntimeError", "ArithmeticError", "ValueError", "OSQPException"}
        if not of_solver or isinstance(error, PlannerError) or lacks_memory(error):
            raise
        return otherwise(str(error).strip().rpartition("\n")[2][:80])


class InputWarning(UserWarning):
    """Input that can be used but looks like a mistake."""


def expect(kind: type, value: object, how: str) -> None:
    """Refuse an argument of the wrong type, such as a file name in place of a problem.

    Args:
        kind: The type that the argument must have.
        value: The argument.
        how: How to get a value of this type, for the message.

    Raises:
        InputError: If the argument has another type.
    """
    if not isinstance(value, kind):
        shown = textwrap.shorten(repr(value), 60, placeholder="...")
        raise InputError(f"{shown} is not a {kind.__name__}; {how}")


ABOVE_ZERO = math.ulp(0.0)
"""The least number above zero."""


def expect_number(
    name: str, value: Any, what: str, low: float, high: float = math.inf, whole: bool = False
) -> None:
    """Refuse an argument that is not a finite number from `low` to `high`.

    Args:
        name: Name of the argument.
        value: The argument.
        what: What it must be, for the message.
        low: Least number allowed.
        high: Largest number allowed.
        whole: Whether the number must be whole.

    Raises:
        InputError: If the argument is anything else.
    """
    is_number = isinstance(value, Integral if whole else Real) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not low <= value <= high:
        raise InputError(f"{name} = {value!r:.40}: must be {what}")


Class = TypeVar("Class", bound=type)


def factory(how: str) -> Callable[[Class], Class]:
    """Decorate a class so that a call with wrong arguments tells the user how to get an instance.

    Args:
        how: What to write instead of the call, for the message.
    """

    def wrapped(cls: Class) -> Class:
        fill: Any = vars(cls)["__init__"]
        signature = inspect.signature(fill)

        @wraps(fill)
        def checked(*args: Any, **kwargs: Any) -> None:
            try:
                fill(*args, **kwargs)
            except TypeError:
                try:
                    signature.bind(*args, **kwargs)
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
        why: Which motor and how fast, in few words.
    """

    def __init__(self, message: str, *, why: str = "") -> None:
        self.why = why
        super().__init__(message)


class UnknownRowError(InputError, KeyError):
    """A row or column that a result does not have."""

    __str__ = Exception.__str__  # `KeyError` would quote the message


class NoPlanError(PlannerError):
    """No plan exists, none was found, or the plan found failed its verification.

    Attributes:
        sentence: The reason, without the problem's file.
        source: The problem's file, or "".
        finding: For a proof that the duration is too short, what the sentence says beside that
            proof, or ""; otherwise None.
        list_head: Words that end the sentence and introduce the list of violations, or "".
        plan: The last iterate, only for study and never for execution, or None.
        violations: Requirements that the iterate breaks, largest scaled violation first.
        changes: Changes of the problem that may help, as data (`planner.methods.refusal.Change`).
        otherwise: Other advice in words, or None.
        ways: `changes` and `otherwise` in words. Once the changes have been tried, only the changes
            that work remain.
        advice: All `ways` in one text, or None.
        has_remedy: Whether one of the `ways` was tried and works.
        blamed: The requirement that had to be left out to find `plan`, in words, or "".
    """

    exit_status = 3
    status = "no_plan"
    blamed = ""
    finding: str | None = None
    has_remedy = False

    def __init__(
        self,
        sentence: str,
        *,
        source: str = "",
        list_head: str = "",
        plan: Any = None,
        violations: Sequence[Violation] = (),
        advice: str | Sequence[str] | None = None,
        changes: Sequence[Any] = (),
    ) -> None:
        self.sentence, self.source, self.list_head = sentence, source, list_head
        self.plan = plan
        self.violations = tuple(sorted(violations, key=lambda v: -v.scaled))
        self.changes = tuple(changes)
        others = (advice,) if isinstance(advice, str) else advice or ()
        self.otherwise = "; or ".join(others) or None
        super().__init__()
        named = (str(change) for change in changes if not (change.method or change.solid))
        self.advise(*named, *others)

    def advise(self, *words: str | None) -> None:
        """Set the advice: first `words`, then each of `changes` that uses another method."""
        others = (str(change) for change in self.changes if change.method)
        self.ways = tuple(each for each in (*words, *others) if each)
        self.advice = "; or ".join(self.ways) or None
        self.args = (self._text(),)

    def blame(self, requirement: str, plan: Any, violations: Sequence[Violation]) -> None:
        """Add to the message the requirement that prevents a plan, and what breaks without it.

        `plan` is a plan that ignores this requirement, and `violations` what it breaks.
        """
        self.sentence += f"; without {requirement} there is a plan"
        self.list_head = ", which breaks:"
        self.plan, self.violations, self.blamed = plan, tuple(violations), requirement
        self.args = (self._text(),)

    @property
    def reason(self) -> str:
        """The reason with the problem's file, and what introduces the list of violations."""
        whole = self.sentence + self.list_head
        return f"{self.source}: {whole}" if self.source else whole

    def _text(self) -> str:
        lines = [self.reason, *(f"  - {v}" for v in self.violations[:8])]
        if len(self.violations) > 8:
            lines.append(f"  - and {len(self.violations) - 8} more")
        if self.advice:
            lines.append(f"Try: {self.advice}")
        return "\n".join(lines)


class SingularError(NoPlanError):
    """The path leaves the domain of the chained-form chart: part of it has no real joint angles.

    Attributes:
        times_s: Times at which the path leaves or re-enters the domain, in seconds.
    """

    status = "singular"
    times_s: Sequence[float] = ()


class InfeasibleError(NoPlanError):
    """It is proven that no plan of the requested kind exists; the message contains the proof.

    Attributes:
        certificate: Numbers of the proof, or None if the method provides none.
    """

    status = "infeasible"
    certificate: Mapping[str, Any] | None = None


class MethodError(NoPlanError):
    """A method or a limit of another package failed; the message names it and its package.

    Attributes:
        traceback: The traceback, for the author of that package, or "".
    """

    status = "method_failed"

    def __init__(self, message: str, *, traceback: str = "") -> None:
        self.traceback = traceback
        super().__init__(message)


class NotConvergedError(NoPlanError):
    """The solver stopped without a plan, although a plan may exist."""

    status = "not_converged"


class TimeLimitError(NoPlanError):
    """The time limit ended before a plan was verified; the message says how far the search got."""

    status = "time_limit"


class VerificationError(NoPlanError):
    """A motion was found, but the independent verification found a broken requirement.

    Attributes:
        check: The complete result of the verification, or None.
    """

    status = "verification_failed"
    check: Any = None
