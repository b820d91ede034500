"""The results of a sweep as a table: pandas DataFrame, CSV or Parquet."""

from __future__ import annotations

import io
import json
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.comparison.rows import column_names
from planner.errors import InputError
from planner.plan.plan import Plan
from planner.plan.samples import import_library
from planner.support.files import refuse_unwritable, write_bytes, write_text
from planner.support.package import DataFrame
from planner.support.statistics import LEAST_DIFFERENCE_DEG
from planner.support.tables import csv_text, number
from planner.sweep.case import RESULTS
from planner.sweep.store import Store
from planner.sweep.sweep_file import canonical_json
from planner.verification.verdict import load_plan

RESULT_COLUMNS = ("method", *(name for name in RESULTS if name != "plan"), "case", "finished_at")
"""Columns of a sweep's results, after one column per varied key; some names get a unit, too."""

SUFFIXES = (".csv", ".parquet")

Record = dict[str, Any]


def load_sweep(db: str | Path, which: int | None = None) -> DataFrame:
    """Return the finished cases of a sweep, one row per point and method, in the sweep's order.

    Args:
        db: A database file of `planner sweep`.
        which: Number of the sweep in the file (`Outcome.sweep` of `run_sweep`). By default the
            sweep started last; other runs may have started one in the same file meanwhile.

    Returns:
        A DataFrame with one column per varied key (named by the dotted key), then `method`, the
        results (`planner.sweep.case.RESULTS`, with units in their names: travel_rad for an arm,
        travel_m for a car), `case` (the key for
        `load_case_plan`) and `finished_at`.

    Raises:
        InputError: If pandas is not installed, or the file is missing, is not a sweep database, or
            has no such sweep.
    """
    pandas = import_library("pandas")
    columns, records = read(db, which)
    return pandas.DataFrame.from_records(records, columns=columns)


def load_case_plan(db: str | Path, case: str) -> Plan:
    """Return the plan of a case of a sweep that saved its plans (`plans = true`).

    Args:
        db: A database file of `planner sweep`.
        case: The key of the case, or a unique beginning of it.

    Raises:
        InputError: If there is no such case, or the case has no saved plan.
    """
    with Store(db) as store:
        text = store.plan(case)
    if text is None:
        raise InputError(
            f"{db} has no plan of case {case}: no plan was found, or the sweep lacks plans = true"
        )
    with tempfile.TemporaryDirectory() as folder:
        return load_plan(write_text(Path(folder) / "plan.json", text))


def export(db: str | Path, path: str | Path, which: int | None = None) -> Path:
    """Write the finished cases of a sweep to a file; a failure leaves no partial file.

    Lists, tables and columns of mixed types become JSON text.

    Args:
        db: A database file of `planner sweep`.
        path: A name that ends in .csv or .parquet.
        which: As for `load_sweep`.

    Raises:
        InputError: If the name has another ending, pandas or pyarrow is missing (Parquet only), or
            a file cannot be read or written.
    """
    refuse_unexportable(path)
    columns, records = read(db, which)
    cells = _cells(columns, records)
    if Path(path).suffix == ".csv":
        return write_text(path, csv_text([columns, *zip(*cells.values(), strict=True)]))
    buffer = io.BytesIO()
    import_library("pandas").DataFrame(cells).to_parquet(buffer, engine="pyarrow", index=False)
    return write_bytes(path, buffer.getvalue())


def refuse_unexportable(path: str | Path) -> None:
    """Refuse a file that `export` could not write; call this before long work.

    Raises:
        InputError: As for `export`.
    """
    if Path(path).suffix not in SUFFIXES:
        raise InputError(f"cannot export to {path}: its name must end in {' or '.join(SUFFIXES)}")
    refuse_unwritable(path)
    if Path(path).suffix == ".parquet":
        import_library("pandas")
        import_library("pyarrow")


def read(db: str | Path, which: int | None = None) -> tuple[list[str], list[Record]]:
    """Return the column names of a sweep's results, and one record per point and method."""
    with Store(db) as store:
        number, keys = store.find_sweep(which)
        system = store.system(number)
        names = {} if system is None else column_names(system)
        columns = [*keys, *(names.get(name, name) for name in RESULT_COLUMNS)]
        records = []
        for row in store.rows(number):
            row |= {"solved": bool(row["solved"])}
            found = row.pop("changes") | {names.get(name, name): x for name, x in row.items()}
            records.append({**dict.fromkeys(columns), **found})
    return columns, records


def statuses_by_method(records: Iterable[Record]) -> dict[str, Counter[str]]:
    """Return for each method how many cases it "solved", and how many were refused, by status."""
    out: dict[str, Counter[str]] = {}
    for record in records:
        status = "solved" if record["solved"] else record["status"]
        out.setdefault(record["method"], Counter())[status] += 1
    return out


def recommend(columns: Sequence[str], records: Iterable[Record]) -> tuple[str | None, str]:
    """Return the method to take, or None, and the reason in sentences.

    Of the methods that solve most cases it is the one with the smallest median E on the cases that
    every method solves. If that hardly differs, or nothing was replayed, the effort decides.

    Args:
        columns: Names of the columns; those before `method` are the varied keys.
        records: The finished cases; `read` gives both.
    """
    keys, solved = columns[: columns.index("method")], dict[str, dict[str, Record]]()
    points = set()
    for record in records:
        point = canonical_json([record[key] for key in keys])
        points.add(point)
        if record["solved"]:
            solved.setdefault(record["method"], {})[point] = record
    if not solved:
        return None, "No method solves a case."
    shared = set.intersection(*map(set, solved.values()))

    def median(label: str, figure: str) -> float:
        values = [solved[label][point][figure] for point in shared]
        return float(np.median(values)) if values and None not in values else np.nan

    most = max(map(len, solved.values()))
    able = [label for label, mine in solved.items() if len(mine) == most]
    errors, efforts = ({k: median(k, key) for k in solved} for key in ("E_median_deg", "effort"))
    least = min(errors[label] for label in able)
    near = [k for k in able if errors[k] <= least + LEAST_DIFFERENCE_DEG] or able
    take = min(near, key=lambda label: efforts[label])
    others = [label for label in solved if label != take]

    def beside(figures: Mapping[str, float], unit: str = "") -> str:
        rest = ", ".join(f"{label} {number(figures[label])}" for label in others)
        return f"{number(figures[take])}{unit}" + f" ({rest})" * bool(rest)

    counts = {label: len(mine) for label, mine in solved.items()}
    text = f"Take {take}: of {len(points)} cases it solves {beside(counts)}."
    if not np.isnan(efforts[take]):
        cases = "case" if len(shared) == 1 else "cases"
        text += f" On the {len(shared)} {cases} that all of these solve, in the median: "
        text += "" if np.isnan(least) else f"E {beside(errors, ' deg')}; "
        text += f"effort {beside(efforts)}."
    return take, text


def _cells(columns: Iterable[str], records: list[Record]) -> Mapping[str, list[Any]]:
    """Return the values of each column, converted to one type per column."""
    out = {}
    for column in columns:
        values = [record[column] for record in records]
        kinds = {float if type(v) is int else type(v) for v in values if v is not None}
        if len(kinds) > 1 or kinds & {list, dict}:
            values = [v if v is None or type(v) is str else json.dumps(v) for v in values]
        out[column] = values
    return out
