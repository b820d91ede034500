"""Recommend a plan of a comparison: why to take it, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from planner.comparison.rows import Row
from planner.machine.feedforward.legs import compensable
from planner.machine.machine import Machine
from planner.plan.measures import effort_unit
from planner.support.statistics import Difference, differences
from planner.support.tables import number

LEAST_SHARE = 1.05
"""Ratio of two plans' durations or efforts above which the headline mentions the larger one."""

LEAST_SWING_DEG = 5.0
"""Smallest swing of joint 1 that needs a warning, in degrees."""

MOST_BEYOND_PERCENT = 1.0
"""Largest percentage of machines on which a recommended plan may break a physical limit."""

LEAST_RUN_UP_S = 0.5
"""Longest motion of the arm beyond the plan's duration, in seconds, that needs no warning."""


By = Literal["way", "end", "effort", "time"]
FIGURES: dict[By, str] = {
    "way": "E_median_deg",
    "end": "end_median_deg",
    "effort": "effort",
    "time": "duration_s",
}
"""The figure of a row that decides, by what was asked."""


def compare_pairs(
    rows: Sequence[Row], which: Literal["E", "end"], threshold_deg: float
) -> tuple[Difference, ...]:
    """Compare every pair of replayed plans machine by machine; see `planner.support.statistics`.

    The p-values of the tests by E and by the error at the end are corrected together.

    Args:
        rows: The rows of a comparison.
        which: Whether to compare E or the largest joint error at the end.
        threshold_deg: A smaller difference does not matter, degrees.
    """
    kept = {row.label: row.machine_errors_deg for row in rows}
    by_E, by_end = ({k: each[i] for k, each in kept.items() if each is not None} for i in (0, 1))
    errors, others = (by_E, by_end) if which == "E" else (by_end, by_E)
    return differences(errors, threshold_deg, others)


def recommend(rows: Sequence[Row], threshold_deg: float, by: By = "way") -> Row | None:
    """Return the plan to take without feedback; None if no method has a verified plan that breaks
    a physical limit on at most `MOST_BEYOND_PERCENT` of the machines.

    The best plan is the plan with the smallest median E, or error at the end. Among the plans that
    the paired test does not find worse than the best, the plan with the least effort is taken. If
    no plan has an E, effort alone decides. By effort or time there is no test.

    Args:
        rows: The rows of a comparison.
        threshold_deg: A smaller difference of E does not matter, degrees.
        by: What to choose by. E of a plan with `end = "machine"` is from another motion than that
            of the others, so that such a plan is not chosen by the way if there are others.
    """
    solved = [row for row in _solved(rows, by) if not _breaks_limits(row)]
    if not solved:
        return None
    finite = [row for row in solved if np.isfinite(row.E_median_deg)]
    if finite and by in ("way", "end"):
        best = min(finite, key=lambda row: _figure(row, by))
        worse = _worse_than(best, rows, threshold_deg, *_tested(by))
        solved, by = [row for row in finite if row.label not in worse], "effort"
    return min(solved, key=lambda row: (_figure(row, by), _figure(row, "effort")))


def _solved(rows: Sequence[Row], by: By) -> list[Row]:
    solved = [row for row in rows if row.solved and not row.feedback]
    alike = [row for row in solved if row.plan is None or not row.plan.ends_on_machine]
    return alike or solved if by == "way" else solved


def _tested(by: By) -> tuple[Literal["end"], ...]:
    return ("end",) if by == "end" else ()


def _figure(row: Row, by: By) -> float:
    return float(np.nan_to_num(getattr(row, FIGURES[by]), nan=np.inf))


def _breaks_limits(row: Row) -> bool:
    return row.beyond_physical > MOST_BEYOND_PERCENT


def _worse_than(
    row: Row, rows: Sequence[Row], threshold_deg: float, *which: Literal["E", "end"]
) -> set[str]:
    """Return labels of plans that paired tests find worse than a row's plan, in one of the errors
    `which` (default: both)."""
    out = set()
    for d in (
        d for name in which or ("E", "end") for d in compare_pairs(rows, name, threshold_deg)
    ):
        if row.label in (d.first, d.second) and d.is_clear:
            out.add(d.second if d.median_deg < 0 else d.first)
    return out - {row.label}


def headline(
    rows: Sequence[Row], threshold_deg: float, machine: Machine, by: By = "way"
) -> tuple[str, str, tuple[str, ...]]:
    """Return as plain text which plan to take.

    The text has up to three lines: the plan and what it gains; what it costs, beside the next best;
    what to beware of. It is returned in three parts: what is before the first mention of the plan's
    label, that label, and the lines after it. The label is "" if no plan is recommended.

    Args:
        rows: The rows of a comparison.
        threshold_deg: A smaller difference of E does not matter, degrees.
        machine: The machines of the replays; the errors of an arm depend on their fidelity and on
            how they stood before the start.
        by: What to choose by, see `recommend`.
    """
    row, solved = recommend(rows, threshold_deg, by), _solved(rows, by)
    if row is None and solved:
        row = min(solved, key=lambda each: each.beyond_physical)
        fewest = ", the fewest of all plans" if len(solved) > 1 else ""
        words = _join("No plan is recommended.", _jumps(row), f"{_beyond(row)}{fewest}.")
        return words, "", ("",)
    if row is None:
        return "None of the methods found a plan that keeps every limit.", "", ("",)
    refused = _refusal(rows, row, threshold_deg)
    beware = _join(_swing(row), _caution(row), _follow_up(rows, row), refused)
    if len(solved) == 1:
        words = "reaches the goal and keeps every limit."
        if sum(not each.feedback for each in rows) == 1:
            return "", row.label, _lines(f" {words}", beware)
        return "Take ", row.label, _lines(f": the only plan that {words}", beware)
    if by in ("effort", "time") or not np.isfinite(row.E_median_deg):
        what = "time" if by == "time" else "effort"
        least = f": of {len(solved)} verified plans it has the least {what}."
        return "Take ", row.label, _lines(least, beware)
    others = [r for r in solved if r is not row]
    plain = next((r for r in others if r.spec == row.spec.plain), None)
    alike = (r for r in others if by == "end" or r.spec.compensated == row.spec.compensated)
    rival = min(alike, key=lambda r: _figure(r, by), default=None)
    other = plain or rival or min(others, key=lambda r: _figure(r, by))
    rival = other if _breaks_limits(other) else rival
    reason = f"E {_degrees(row.E_median_deg)} in the median instead of"
    reason += f" {_degrees(other.E_median_deg)} ({other.label}),"
    loses = row.end_median_deg > other.end_median_deg
    reason += " but" if loses and row.E_median_deg <= other.E_median_deg else ""
    reason += f" {_degrees(row.end_median_deg)} instead of {_degrees(other.end_median_deg)} at the"
    reason += " end"
    if by == "end":
        reason = f"{_degrees(row.end_median_deg)} in the median"
    reason += f"{_machines(row, machine)}."
    price = against = ""
    if by == "way" and other is not rival and (costs := _costs(row, other)):
        price = f"It takes {costs}."
    if rival is not None:
        worse = rival.label in _worse_than(row, rows, threshold_deg, *_tested(by))
        against = _against(row, rival, worse, threshold_deg, by)
    return "Take ", row.label, _lines(f" for the {by}: {reason}", _join(price, against), beware)


def _lines(*lines: str) -> tuple[str, ...]:
    """Return the lines that are not empty."""
    return tuple(filter(None, lines))


def _join(*sentences: str) -> str:
    """Return the sentences that are not empty as one line."""
    return " ".join(filter(None, sentences))


def _against(row: Row, rival: Row, worse: bool, threshold_deg: float, by: By) -> str:
    """Return a sentence that compares a plan with its rival: test result and costs.

    `worse` says whether the paired test finds the rival worse by `threshold_deg` or more.
    """
    name = f"{rival.label} ({'E ' * (by == 'way')}{_degrees(_figure(rival, by))})"
    if _breaks_limits(rival) and not _breaks_limits(row):
        return f"{name} breaks a limit on {number(rival.beyond_physical)} % of the machines."
    if worse:
        costs, kind = _costs(row, rival), "with" if row.spec.compensated else "without"
        kind = f" {kind} compensation" * (by == "way")
        best = f"The next best plan{kind} is {name}."
        return best + (f" {row.label} takes {costs}." if costs else "")
    costs = _costs(rival, row)
    more = f", which takes {costs}" if costs else ""
    least = f"no difference of {threshold_deg:g} deg or more"
    return f"The paired test finds {least} from {name}{more}."


def _machines(row: Row, machine: Machine) -> str:
    """Return words that say on which machines of an arm a figure holds: whether they have inertia,
    and how they stood before the start; "" for other systems."""
    if row.plan is None or not compensable(row.plan.problem.system):
        return ""
    inertia = "with" if machine.fidelity == "dynamic" else "without"
    return f", on machines {inertia} inertia ({machine.fidelity}), {machine.start_words}"


def _swing(row: Row) -> str:
    """Return a warning if joint 1 swings far before a compensated plan starts; else ""."""
    if row.plan is None or row.plan.lead_s == 0:
        return ""
    angles = np.rad2deg(row.plan.theta(np.linspace(0.0, row.plan.lead_s, 401))[:, 0])
    if np.ptp(angles) < LEAST_SWING_DEG:
        return ""
    known = np.isfinite(row.joint_1_range_deg[0])  # not in a folder of an earlier version
    words = f", and in all {_range_of_joint_1(row)}" if known else ""
    return f"Stand clear: joint 1 swings before the plan starts{words}."


def _range_of_joint_1(row: Row) -> str:
    """Return between which angles joint 1 moves on the machines, rounded to the safe side."""
    low, high = row.joint_1_range_deg
    return f"moves between {np.floor(low):.0f} and {np.ceil(high):.0f} deg"


def _refusal(rows: Sequence[Row], row: Row, threshold_deg: float) -> str:
    """Return a sentence on a refused compensated plan that is more accurate than the row's plan.

    Return "" if no refused plan is more accurate by more than the threshold.
    """

    def gain(each: Row) -> float:
        return max(row.E_median_deg - each.E_median_deg, row.end_median_deg - each.end_median_deg)

    refused = [each for each in rows if not (each.solved or each.feedback) and each.plan]
    nearer = [r for r in refused if r.spec.compensated and gain(r) > threshold_deg]
    if not nearer:
        return ""
    best = max(nearer, key=gain)
    first = next(iter(best.ways), "")
    return (
        f"More accurate, but refused: {best.label} ({best.why}):"
        f" E {_degrees(best.E_median_deg)} instead of {_degrees(row.E_median_deg)},"
        f" {_degrees(best.end_median_deg)} instead of {_degrees(row.end_median_deg)} at the end."
    ) + f" Try: {first}." * bool(first)


def what_decides(rows: Sequence[Row], threshold_deg: float) -> str:
    """Return sentences on what compensation does for the accuracy, and how efforts differ.

    Return "" unless at least two plans are compensated, and by the paired test and by the 95th
    percentile every compensated plan has a smaller E than every original plan. Compensation decides
    the accuracy if the test finds no compensated plan better than another, in E or at the end.
    """
    solved = [row for row in rows if row.solved and not row.feedback]
    kept = {row.spec: row for row in solved}
    pairs = [(kept[row.spec.plain], row) for row in solved if row.spec.plain in kept]
    before, better = ([pair[k] for pair in pairs if pair[0] is not pair[1]] for k in (0, 1))
    errors = [[row.E_p95_deg for row in group] for group in (before, better)]
    if len(better) < 2 or not max(errors[1]) < min(errors[0]):
        return ""
    others = {row.label for row in before}
    if not all(others <= _worse_than(row, solved, threshold_deg, "E") for row in better):
        return ""
    labels = {row.label for row in better}
    same = not any(labels & _worse_than(row, solved, threshold_deg) for row in better)
    was, now = (_range(values, "deg") for values in errors)
    words = "decides the accuracy, whichever method planned" if same else "makes every plan better"
    words = f" Compensation {words}: E 95 % {now}, not {was}."
    efforts = [row.effort for row in before]
    if max(efforts) > LEAST_SHARE * min(efforts):
        assert before[0].plan is not None
        unit = effort_unit(before[0].plan.problem.system)
        words += f" The methods differ in effort: {_range(efforts, unit)}."
    return words


def _range(values: Sequence[float], unit: str) -> str:
    ends = dict.fromkeys(number(end) for end in (min(values), max(values)))
    return f"{' to '.join(ends)} {unit}"


def _costs(row: Row, other: Row) -> str:
    """Return in words the duration and effort by which a plan clearly exceeds another, or ""."""
    assert row.plan is not None
    unit = effort_unit(row.plan.problem.system)
    return " and ".join(
        f"{number(mine)} {unit} instead of {number(theirs)}"
        for mine, theirs, unit in (
            (row.duration_s, other.duration_s, "s"),
            (row.effort, other.effort, f"{unit} of effort"),
        )
        if mine > LEAST_SHARE * theirs
    )


def _caution(row: Row) -> str:
    """Warn of a plan that jumps at an end, and of machines that break physical limits, or many
    that break others."""
    warns = row.beyond_physical > 0 or row.beyond_limits > MOST_BEYOND_PERCENT
    return _join(_jumps(row), f"{_beyond(row)}." * warns)


def _jumps(row: Row) -> str:
    return f"{row.label} {row.plan.jump_words}." if row.plan and row.plan.jump_words else ""


def _beyond(row: Row) -> str:
    """Return words that say on how many machines a plan breaks limits, without a full stop."""
    words = f"On {number(row.beyond_limits)} % of the machines {row.label} breaks a limit"
    if row.beyond_physical != row.beyond_limits:
        words += f", on {number(row.beyond_physical)} % a physical one"
        words += " (breaking one of chained coordinates harms nothing)"
    return words


def _follow_up(rows: Sequence[Row], row: Row) -> str:
    """Return sentences on E with feedback, and on how much longer feedback moves the arm.

    Return "" if the plan was not replayed with feedback.
    """
    closed = [each for each in rows if each.spec == replace(row.spec, feedback=True)]
    if not closed or not np.isfinite(closed[0].E_median_deg):
        return ""
    words = f"With feedback E is {_degrees(closed[0].E_median_deg)}."
    more = closed[0].duration_s - row.duration_s
    if more > LEAST_RUN_UP_S:
        words += f" The controller moves the arm {more:.1f} s longer, also before the plan starts"
        swings = f"; stand clear: joint 1 then {_range_of_joint_1(closed[0])}"
        words += f"{swings * bool(np.ptp(closed[0].joint_1_range_deg) > LEAST_SWING_DEG)}."
    return _join(words, _caution(closed[0]))


def _degrees(value: float) -> str:
    return f"{number(value)} deg"
