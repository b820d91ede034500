"""What a sweep's database holds, asked by SQL as a user would."""

from __future__ import annotations

import json
import sqlite3
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

LAST = "(SELECT id FROM sweeps ORDER BY started DESC LIMIT 1)"


def query(db: Path, statement: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(db)) as connection, connection:
        return connection.execute(statement).fetchall()


def column(db: Path, name: str) -> list[Any]:
    """A result or a varied key of the cases of the sweep that was started last, in its order."""
    cases = f"points JOIN cases ON cases.key = points.key WHERE sweep = {LAST} ORDER BY position"
    if "." in name:
        return [json.loads(text)[name] for (text,) in query(db, f"SELECT changes FROM {cases}")]
    return [value for (value,) in query(db, f"SELECT cases.{name} FROM {cases}")]


def finished(db: Path) -> int:
    """How many cases a file holds that another process may be writing."""
    with suppress(sqlite3.OperationalError):
        if db.exists():
            return int(query(db, "SELECT count(*) FROM cases")[0][0])
    return 0


def until(db: Path, count: int) -> None:
    end = time.monotonic() + 60
    while finished(db) < count:
        assert time.monotonic() < end, "the sweep does not get on"
        time.sleep(0.005)


def alive() -> dict[int, int]:
    """Processes that run, and their parents; empty where there is no /proc."""
    out = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                out[int(stat.parent.name)] = int(parent)
    return out
