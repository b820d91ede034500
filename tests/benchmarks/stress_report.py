"""The page of a stress campaign."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Record = dict[str, Any]

WITHIN = 1.02
"""Durations up to this many times the best of the random starts count as no worse."""

HEAD = """# Random pairs of start and goal

{count} pairs: five families for each number of joints (seed {seed}), duration free, joint limits of
80 degrees, inputs up to 0.5 rad/s, proportions of the prototype.
Method: collocation with its defaults. "Solved" is a verified plan; "certificate" a refusal with a
proof that there is none; "failed" everything else. Times are of the whole case, verification
included, with as many cases side by side as there are cores. Made by

    python tests/benchmarks/stress.py {options}

"""


def page(found: Sequence[Record], seed: int, options: str) -> str:
    """The tables, as Markdown; `options` are what the campaign was asked for."""
    head = HEAD.format(count=len(found), seed=seed, options=options)
    return head + _outcomes(found) + _against_random(found) + _failures(found)


def _outcomes(found: Sequence[Record]) -> str:
    columns = (
        "joints|family|solved|certificate|failed|time 50 %, s|time 95 %, s|longest, s|plan 50 %, s"
        "|plan 95 %, s"
    )
    rows = []
    for joints, family, group in _groups(found):
        solved = [r for r in group if r["solved"]]
        proven = [r for r in group if r["status"] == "infeasible"]
        seconds = [r["case_time_s"] for r in group]
        plans = [r["duration_s"] for r in solved]
        failed = len(group) - len(solved) - len(proven)
        counts = [f"{len(solved)}/{len(group)}", len(proven), failed]
        figures = [*_percentiles(seconds), f"{max(seconds):.3g}", *_percentiles(plans)]
        rows.append([joints, family, *counts, *figures])
    return _table(columns, rows)


def _against_random(found: Sequence[Record]) -> str:
    """Durations beside those of the best of 50 random starts."""
    columns = "joints|family|compared|no worse than 2 %|median ratio|largest ratio"
    rows, good, total = [], 0, 0
    for joints, family, group in _groups(found):
        both = [r for r in group if r["random"] and r["solved"] and r["random"]["solved"]]
        if not both:
            continue
        ratio = np.array([r["objective"] / r["random"]["objective"] for r in both])
        within = int(np.sum(ratio <= WITHIN))
        good, total = good + within, total + len(both)
        rows.append(
            [joints, family, len(both), within, f"{np.median(ratio):.3f}", f"{ratio.max():.3f}"]
        )
    if not rows:
        return ""
    text = f"\n## Against the best of 50 random starts\n\n{good} of {total} no worse than 2 %.\n\n"
    return text + _table(columns, rows)


def _failures(found: Sequence[Record]) -> str:
    failed = [r for r in found if not r["solved"] and r["status"] != "infeasible"]
    if not failed:
        return "\nNo case failed.\n"
    lines = [
        f"- {r['joints']} joints, {r['family']}, {r['start.theta_deg']} to {r['goal.theta_deg']}:"
        f" {r['status']}: {str(r['why'])[:200]}"
        for r in failed
    ]
    return "\n## Failed\n\n" + "\n".join(lines) + "\n"


def _groups(found: Sequence[Record]) -> list[tuple[int, str, list[Record]]]:
    keys = dict.fromkeys((r["joints"], r["family"]) for r in found)
    return [
        (n, name, [r for r in found if (r["joints"], r["family"]) == (n, name)]) for n, name in keys
    ]


def _percentiles(values: Sequence[float]) -> list[str]:
    if not values:
        return ["", ""]
    return [f"{value:.3g}" for value in np.percentile(values, [50, 95])]


def _table(columns: str, rows: Sequence[Sequence[object]]) -> str:
    names = columns.split("|")
    lines = [names, ["---"] * len(names), *([str(c) for c in row] for row in rows)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
