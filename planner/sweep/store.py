"""The database file of a sweep (SQLite): every finished case at once, in a transaction of its own.

`cases` holds one row a case, under its key; `points` says which cases make up each sweep that was
run into the file. Write-ahead logging makes a commit survive the end of the process, however it
ends.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator
from datetime import UTC, datetime
from typing import Any

from planner.errors import InputError
from planner.reading import parse_json
from planner.sweep.canonical import canonical, digest
from planner.sweep.case import RESULTS, Case, Row
from planner.sweep.database import Database
from planner.sweep.description import Sweep


class Store(Database):
    """What a database file of sweeps holds; use it in a `with` block."""

    # -- writing -------------------------------------------------------------------------------

    def register(self, sweep: Sweep, cases: Iterable[Case]) -> int:
        """Note which cases make up a sweep, as the last one started.

        Returns:
            The sweep's number in this file.
        """
        data = sweep.to_dict()
        own = digest(data)
        rows = [(c.label, canonical(c.changes), c.key) for c in cases]  # slow: before the lock
        with self.transaction():
            self.db.execute(
                "INSERT INTO sweeps (digest, description, keys, started_at) VALUES (?, ?, ?, ?)"
                " ON CONFLICT (digest) DO UPDATE SET started_at = excluded.started_at",
                (own, canonical(data), json.dumps(sweep.keys), _now()),
            )
            (number,) = self.db.execute("SELECT id FROM sweeps WHERE digest = ?", (own,)).fetchone()
            # A later version of the program may give the same points other keys.
            self.db.execute("DELETE FROM points WHERE sweep = ?", (number,))
            self.db.executemany(
                "INSERT INTO points VALUES (?, ?, ?, ?, ?)",
                ((number, position, *row) for position, row in enumerate(rows)),
            )
        return int(number)

    def add(self, case: Case, row: Row) -> None:
        """Keep a finished case; in place of what was there under its key."""
        names = ["key", "description", "finished_at", *RESULTS]
        values = [case.key, case.description, _now(), *(row[name] for name in RESULTS)]
        marks = ", ".join("?" * len(names))
        with self.transaction():
            self.db.execute(
                f"INSERT OR REPLACE INTO cases ({', '.join(names)}) VALUES ({marks})", values
            )

    # -- reading -------------------------------------------------------------------------------

    def positions(self, sweep: int) -> dict[str, int]:
        """Keys of the different cases of a sweep, finished or not, and where each comes first."""
        with self.explained():
            return dict(
                self.db.execute(
                    "SELECT key, min(position) AS first FROM points WHERE sweep = ?"
                    " GROUP BY key ORDER BY first",
                    (sweep,),
                )
            )

    def finished(self, retry: Collection[str] = (), plans: bool = False) -> set[str]:
        """Keys of the finished cases.

        Args:
            retry: Statuses that do not count as finished.
            plans: Whether a solved case without its plan does not count either.
        """
        marks = ", ".join("?" * len(retry))
        return self._set(
            "SELECT key FROM cases WHERE NOT (? AND solved AND plan IS NULL)"
            f" AND status NOT IN ({marks})",
            plans,
            *retry,
        )

    def _set(self, query: str, *values: Any) -> set[str]:
        with self.explained():
            return {key for (key,) in self.db.execute(query, values)}

    def statuses(self, sweep: int) -> dict[str, int]:
        """How many different cases of a sweep ended in each status."""
        with self.explained():
            return dict(
                self.db.execute(
                    "SELECT status, count(*) FROM cases WHERE key IN"
                    " (SELECT key FROM points WHERE sweep = ?) GROUP BY status ORDER BY status",
                    (sweep,),
                )
            )

    def sweeps(self) -> list[dict[str, Any]]:
        """The sweeps run into this file, the last one started last: id, description, keys."""
        with self.explained():
            found = self.db.execute(
                "SELECT id, description, keys FROM sweeps ORDER BY started_at, id"
            ).fetchall()
        return [
            {
                "id": i,
                "description": self._parsed(d, "a description", dict),
                "keys": self._parsed(keys, "the keys of a sweep", list),
            }
            for i, d, keys in found
        ]

    def rows(self, sweep: int) -> Iterator[dict[str, Any]]:
        """The finished cases of a sweep in its order: changes, method, results but the plan."""
        results = [name for name in RESULTS if name != "plan"]
        columns = ", ".join(f"cases.{name}" for name in results)
        with self.explained():
            found = self.db.execute(
                f"SELECT changes, method, cases.key, {columns}, finished_at FROM points"
                " JOIN cases ON cases.key = points.key WHERE sweep = ? ORDER BY position",
                (sweep,),
            )
            for changes, method, key, *values, finished in found:
                yield {
                    "changes": self._parsed(changes, "the changes of a case", dict),
                    "method": method,
                    "case": key,
                    **dict(zip(results, values, strict=True)),
                    "finished_at": finished,
                }

    def _parsed(self, text: Any, what: str, kind: type) -> Any:
        """The value of a column that holds JSON."""
        try:
            value = parse_json(text)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path} is damaged: {what} is not JSON: {error}") from None
        if not isinstance(value, kind):
            raise InputError(f"{self.path} is damaged: {what} is {value!r:.60}")
        return value

    def plan(self, key: str) -> str | None:
        """The text of a stored plan, by its case's key or a beginning of it that is unique."""
        with self.explained():
            found = self.db.execute(
                "SELECT plan FROM cases WHERE substr(key, 1, ?) = ?", (len(key), key)
            ).fetchall()
        if len(found) != 1:
            raise InputError(f"{self.path}: {len(found) or 'no'} cases have a key '{key}...'")
        return None if found[0][0] is None else str(found[0][0])


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")
