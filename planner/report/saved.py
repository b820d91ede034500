"""Read a comparison back from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from csv import DictReader
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.comparison.comparison import FORMAT, VERSION, Comparison
from planner.comparison.rows import EARLIER_NAMES, KEPT_IN_FILES, Row
from planner.errors import InputError
from planner.machine.machine import Machine, sample_numbers
from planner.plan.spec import Spec
from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.support.files import JSON_BYTES, expect_path, read_json, read_text
from planner.support.statistics import LEAST_DIFFERENCE_DEG
from planner.support.tables import line
from planner.verification.summary import without_unit_keys
from planner.verification.verdict import load_plan


def load_comparison(folder: str | Path, *, strict: bool = False) -> Comparison:
    """Read the folder that `Comparison.save` wrote, and verify its plans again.

    Rows, plans and the errors on each machine are restored; replays are not. A
    row that is marked as solved, but whose file has no valid plan of this problem, becomes
    unsolved: its `why` says what is wrong, and its numbers, which belong to another motion, are
    dropped.

    Args:
        folder: The folder.
        strict: Whether to refuse a folder with such a row.

    Raises:
        InputError: If the folder is missing, not that of a comparison, or damaged; or, if `strict`,
            a row is wrongly marked as solved.
    """
    place = expect_path(folder)
    try:
        data = read_json(place / "comparison.json")
    except InputError as error:
        raise InputError(f"{folder} is not the folder of a comparison: {error}") from None
    if data.get("format") != FORMAT or data.get("version") != VERSION:
        raise InputError(
            f"{place / 'comparison.json'} is not a comparison that this planner reads: format"
            f" {data.get('format')!r:.60}, version {data.get('version')!r:.60}; compare again"
        )
    try:
        problem = Problem.from_dict(data["problem"], data["source"])
        errors = _machine_errors(place / "machines.csv")
        read = [_row(row, place, problem, errors.get(row["label"])) for row in data["rows"]]
        fallen = [row.why for row, has_fallen in read if has_fallen]
        if fallen and strict:
            raise InputError("\n".join(f"{folder}: {why}" for why in fallen))
        source, machine = line(data.get("machine_file") or ""), Machine.from_table(data["machine"])
        numbers = {key: data[key] for key in ("samples", "seed", "complete")}
        chosen = data.get("chosen")  # files before version 1.0.0 lack it and the threshold
        return Comparison(
            problem,
            tuple(row for row, _ in read),
            replace(machine, source=source),
            **numbers,
            chosen=None if chosen is None else tuple(sample_numbers(chosen).tolist()),
            threshold_deg=1.0 * data.get("threshold_deg", LEAST_DIFFERENCE_DEG),
            by=data.get("by", "way"),
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{place / 'comparison.json'} is damaged: {error!r}; compare again"
        ) from None


def _task_tables(problem: Problem) -> dict[str, Any]:
    """Return a problem as tables, without the title."""
    return {key: value for key, value in problem.to_dict().items() if key != "title"}


def _machine_errors(path: Path) -> dict[str, Array]:
    """Return E and end error of each machine, (2, S), degrees, by label; {} without a file."""
    if not path.exists():
        return {}
    pairs: dict[str, list[list[float]]] = {}
    try:
        for row in DictReader(read_text(path, JSON_BYTES, "it should be CSV").splitlines()):
            pairs.setdefault(row["plan"], []).append([float(row["E_deg"]), float(row["end_deg"])])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged: {error!r}; compare again") from None
    return {label: np.array(each).T for label, each in pairs.items()}


def _row(
    data: Mapping[str, Any], place: Path, problem: Problem, errors: Array | None
) -> tuple[Row, bool]:
    """Return a row, and whether it fell: its plan is no longer what the folder says."""
    file, spec = data.get("plan_file"), Spec.of_label(_read_back(data["label"]))
    plan = None if file is None else load_plan(place / file)
    fault = "" if plan is None else plan.violation
    if plan is not None and _task_tables(plan.problem) != _task_tables(problem):
        fault = "its problem differs from the folder's"
    elif data["solved"] and not (plan and plan.verified):
        fault = fault or "no verified plan is there"
    if fault:
        why = f"{file or 'comparison.json'} was changed after it was made: {fault}; compare again"
        return Row(spec, False, why, plan=plan), True
    names = {field.name for field in fields(Row)} - KEPT_IN_FILES
    # Earlier versions had neither of these.
    ways, beyond = [data["advice"]] if data["advice"] else [], data.get("beyond_limits")
    values: dict[str, Any] = {"ways": ways, "beyond_physical": beyond, **data}
    if "terminal_error_max_deg" in data:
        values |= without_unit_keys(data, problem.system)
    else:  # earlier versions lacked the length of the path, too
        values |= {name: data[EARLIER_NAMES[name]] for name in names & EARLIER_NAMES.keys()}
        values["path_length"] = None if plan is None else plan.path_length
    values = values_of({k: v for k, v in values.items() if k in names})
    values["domain_ok"] = data["domain_ok"]
    return Row(spec, **values, plan=plan, machine_errors_deg=errors), False


def values_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of a JSON object with NaN for null, tuples for lists, and clean texts."""
    return {key: _read_back(value) for key, value in data.items()}


def _read_back(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_read_back(item) for item in value)
    if isinstance(value, str):
        return line(value, 2000)
    return float("nan") if value is None else value
