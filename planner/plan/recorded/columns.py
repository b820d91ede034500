"""Find the columns of a recorded run and their units: `find_columns`."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

import numpy as np

from planner.errors import InputError
from planner.plan.recorded.number_table import NumberTable
from planner.support.tables import line
from planner.support.user_tables import allowed_hint

UNITS: dict[str, dict[str, float]] = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "u": {"rad/s": 1.0, "deg/s": np.pi / 180, "rpm": np.pi / 30},
    "theta": {"rad": 1.0, "deg": np.pi / 180},
}
"""Allowed units of each kind of column, as factors to SI units."""

SPELLINGS = {
    "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "μs": "us", "°": "deg",
    "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
    "1/min": "rpm", "min-1": "rpm", "r/min": "rpm", "rev/min": "rpm",
}  # fmt: skip

_QUANTITY = re.compile(r"(?:(t|time|timestamp)|(u|theta|θ)[ _]?([1-9]))(?![^\W_])\s*(.*)", re.S)
_BEFORE_UNIT = re.compile(r"^(?:[_/,:]|in\b)?\s*")


def parse_name(name: str) -> tuple[str, str] | None:
    """Return the quantity and unit that a column's name states; None if no quantity of a log.

    `theta1_deg`, "theta1 (deg)", "θ₁ / °" and "Theta_1 in degrees" are all ("theta1", "deg").
    """
    match = _QUANTITY.fullmatch(_plain(name))
    if not match:
        return None
    time, kind, number, rest = match.groups()
    quantity = "t" if time else f"{'theta' if kind == 'θ' else kind}{number}"
    return quantity, parse_unit(_BEFORE_UNIT.sub("", rest))


def parse_unit(text: str) -> str:
    """Return a unit in the spelling of `UNITS`, if known; "" for no unit."""
    unit = re.sub(r"[\s·*^()\[\]{}]", "", _plain(text)).replace("_per_", "/").replace("_", "/")
    unit = SPELLINGS.get(unit, re.sub(r"(?<=\w|°)s-1$", "/s", unit))
    if unit in SPELLINGS.values():
        return unit
    return "/".join(SPELLINGS.get(part, part) for part in unit.split("/"))


def _plain(text: str) -> str:
    """Return the text in lower case, with plain digits for raised and lowered ones, and one degree
    sign."""
    text = unicodedata.normalize("NFKC", re.sub("[º˚∘]", "°", text)).casefold()
    return text.replace("\u2212", "-").strip()


def find_columns(table: NumberTable, given: Mapping[str, str]) -> dict[str, tuple[int, float]]:
    """Return each quantity's column index and its unit's factor to SI.

    Args:
        table: The table; its header and its line of units are read.
        given: Map from names of `read_log`, with units, to names of the table's columns.

    Raises:
        InputError: If a column or a unit is missing or unknown, or a quantity has two columns.
    """
    for ours, theirs in given.items():
        if theirs not in table.names:
            raise InputError(
                f"{table.source} has no column '{line(theirs)}' (for {ours});"
                f" {allowed_hint(theirs, table.names)}"
            )
        if not parse_name(ours):
            raise InputError(
                f"columns: '{line(ours)}' is not a quantity with a unit, such as t_s, u1_rad_s,"
                " theta1_deg"
            )
    places: dict[str, tuple[int, float]] = {}
    unfit: dict[str, str] = {}
    meant = {theirs: ours for ours, theirs in given.items()}
    named = {(parse_name(name) or ("", ""))[0] for name in given}
    for place, column in enumerate(table.names):
        quantity, unit = parse_name(meant.get(column, column)) or ("", "")
        if not quantity or (quantity in named and column not in meant):
            continue
        below = parse_unit(table.units[place])
        units = UNITS[quantity.rstrip("123456789")]
        if unit and below in units and unit in units and below != unit:
            raise InputError(
                f"{table.source}: column '{line(column)}' has the unit '{unit}', but '{below}' in"
                " the line of units"
            )
        unit = unit or below
        if unit not in units:
            said = f"has the unit '{unit}'" if unit else "has no unit"
            unfit.setdefault(quantity, f"column '{line(column)}' {said}")
        elif quantity in places:
            raise InputError(
                f"{table.source} has two columns for {quantity}: '{line(column)}' is the second"
            )
        else:
            places[quantity] = place, units[unit]
    _refuse_missing(table, places, unfit)
    return places


def _refuse_missing(
    table: NumberTable, places: Mapping[str, tuple[int, float]], unfit: Mapping[str, str]
) -> None:
    joints = sum(name.startswith("theta") for name in {**places, **unfit})
    names = ["t", "u1", "u2", *(f"theta{i + 1}" for i in range(max(2, joints)))]
    missing = [name for name in names if name not in places]
    for name in missing:
        if name in unfit:
            units = UNITS[name.rstrip("123456789")]
            allowed = ", ".join(f"{name}_{each.replace('/', '_')}" for each in units)
            raise InputError(
                f"{table.source}: {unfit[name]}; write one of {allowed}, or name the column in"
                " `columns`"
            )
    if missing:
        there = ", ".join(f"'{line(name)}'" for name in table.names) or "nothing"
        raise InputError(
            f"{table.source} has no column for {', '.join(missing)}; a log has t, u1, u2,"
            " theta1 ... thetan with units, as in t_s,u1_rad_s,u2_rad_s,theta1_deg (its header has"
            f" {there})"
        )
