"""Which plan of a comparison to take, because of what, and at what price."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.comparison.rows import FEEDBACK, Row, plain_label
from planner.plan.measures import effort_unit
from planner.support.tables import number

LEAST_SHARE = 1.05
"""A price that is higher by less than this is not worth a word."""


def recommended(rows: Sequence[Row], threshold_deg: float) -> Row | None:
    """The plan to take without sensors; None where no method has one.

    Of the plans whose median E is above the least by no more than what matters, that of the least
    effort; where machines have no E, the least effort decides alone.

    Args:
        rows: Of a comparison.
        threshold_deg: A difference of E that does not matter, degrees.
    """
    solved = [row for row in rows if row.solved and not row.feedback]
    if not solved:
        return None
    known = [row for row in solved if np.isfinite(row.E_median_deg)]
    if known:
        best = min(known, key=lambda row: row.E_median_deg)
        most = best.E_median_deg + threshold_deg
        solved = [row for row in known if row.E_median_deg <= most]
    return min(solved, key=lambda row: row.effort if np.isfinite(row.effort) else np.inf)


def headline(rows: Sequence[Row], threshold_deg: float) -> str:
    """Which plan to take, because of what, at what price; plain text."""
    row = recommended(rows, threshold_deg)
    if row is None:
        return "None of the methods found a plan that keeps every limit."
    solved = [each for each in rows if each.solved and not each.feedback]
    refused = _refused(rows, row, threshold_deg)
    if len(solved) == 1:
        tail = f"{_caution(row)}{_follow_up(rows, row)}{refused}"
        if sum(not each.feedback for each in rows) == 1:
            return f"{row.label} reaches the goal and keeps every limit.{tail}"
        reason = "the only one that reaches the goal and keeps every limit."
        return f"Take {row.label}: {reason}{tail}"
    other = _rival(row, solved)
    if not np.isfinite(row.E_median_deg):
        least = f"of {len(solved)} verified plans it has the least effort."
        return f"Take {row.label}: {least}{refused}"
    reason = f"E {_degrees(row.E_median_deg)} in the median instead of"
    reason += f" {_degrees(other.E_median_deg)} ({other.label}),"
    reason += " but" if row.end_median_deg > other.end_median_deg else ""
    reason += f" {_degrees(row.end_median_deg)} instead of {_degrees(other.end_median_deg)} at the"
    more = f"{_price(row, other)}{_caution(row)}{_what_decides(solved)}{_follow_up(rows, row)}"
    return f"Take {row.label}: {reason} end.{more}{refused}"


def _rival(row: Row, solved: list[Row]) -> Row:
    """What the plan is set beside: itself uncompensated, else the least error of the others."""
    for each in solved:
        if each.label == plain_label(row.label) and each is not row:
            return each
    others = [each for each in solved if each is not row]
    return min(others, key=lambda each: np.nan_to_num(each.E_median_deg, nan=np.inf))


def _refused(rows: Sequence[Row], row: Row, threshold_deg: float) -> str:
    """Which compensated plan would be nearer by more than what matters, why it is refused, and what
    to change, as sentences; "" where none is."""

    def gain(each: Row) -> float:
        gains = (row.E_median_deg - each.E_median_deg, row.end_median_deg - each.end_median_deg)
        return max(gains)

    refused = [each for each in rows if not (each.solved or each.feedback) and each.plan]
    nearer = [r for r in refused if plain_label(r.label) != r.label and gain(r) > threshold_deg]
    if not nearer:
        return ""
    best = max(nearer, key=gain)
    first = best.advice.partition("; or ")[0]
    return (
        f" Nearer but refused is {best.label} ({best.why}):"
        f" E {_degrees(best.E_median_deg)} instead of {_degrees(row.E_median_deg)},"
        f" {_degrees(best.end_median_deg)} instead of {_degrees(row.end_median_deg)} at the end."
    ) + f" Try: {first}." * bool(first)


def _what_decides(solved: Sequence[Row]) -> str:
    """That compensation decides the accuracy and the method the effort; "" where it does not.

    With it every plan has to be nearer, at 95 %, than every plan is without.
    """
    rows = {row.label: row for row in solved}
    pairs = [(rows[was], row) for row in solved if (was := plain_label(row.label)) in rows]
    before, better = ([pair[k] for pair in pairs if pair[0] is not pair[1]] for k in (0, 1))
    errors = [[row.E_p95_deg for row in group] for group in (before, better)]
    if len(better) < 2 or not max(errors[1]) < min(errors[0]):
        return ""
    was, now = (_range(values, "deg") for values in errors)
    words = (
        f" Compensation decides the accuracy, whichever method planned: E 95 % {now}, not {was}."
    )
    efforts = [row.effort for row in before]
    if max(efforts) > LEAST_SHARE * min(efforts):
        assert before[0].plan is not None
        unit = effort_unit(before[0].plan.problem.system)
        words += f" The methods differ in effort: {_range(efforts, unit)}."
    return words


def _range(values: Sequence[float], unit: str) -> str:
    ends = dict.fromkeys(number(end) for end in (min(values), max(values)))
    return f"{' to '.join(ends)} {unit}"


def _price(row: Row, other: Row) -> str:
    """What it takes more of than the other plan, as a sentence."""
    assert row.plan is not None
    unit = effort_unit(row.plan.problem.system)
    prices = [
        f"{number(mine)} {unit} instead of {number(theirs)}"
        for mine, theirs, unit in (
            (row.duration_s, other.duration_s, "s"),
            (row.effort, other.effort, unit),
        )
        if mine > LEAST_SHARE * theirs
    ]
    return f" The price: {' and '.join(prices)}." if prices else ""


def _caution(row: Row) -> str:
    """That machines break limits which the plan keeps, as a sentence."""
    if not row.beyond_limits > 0:
        return ""
    return f" On {number(row.beyond_limits)} % of the machines it breaks a limit."


def _follow_up(rows: Sequence[Row], row: Row) -> str:
    """What feedback makes of it, if that was asked."""
    closed = [each for each in rows if each.label == row.label + FEEDBACK]
    if not closed or not np.isfinite(closed[0].E_median_deg):
        return ""
    return f" With feedback E is {_degrees(closed[0].E_median_deg)}."


def _degrees(value: float) -> str:
    return f"{number(value)} deg"
