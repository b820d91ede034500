"""The database file of a sweep (SQLite): every finished case at once, in a transaction of its own.

`cases` holds one row a case, under its key; `points` says which cases make up each sweep that was
run into the file. Write-ahead logging makes a commit survive the end of the process, however it
ends. A file of another kind is told apart, and left as it is.
"""

from __future__ import annotations

import json
import os
import sqlite3
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from planner.errors import InputError
from planner.support.files import expect_path, parse_json, refuse_unwritable, written_paths
from planner.support.interrupts import hold_signals
from planner.sweep.case import RESULTS, Case, Row
from planner.sweep.description import Sweep
from planner.sweep.sweep_file import canonical_json, digest

SCHEMA_VERSION = 1
LOCK_WAIT_S = 30.0
"""How long to wait for another process that writes to the same file."""

ONE_PAGE = 4096
"""Bytes of SQLite's first page: a file with tables has more, each its own."""

_TABLES = f"""
CREATE TABLE schema_version (version INTEGER NOT NULL, format TEXT NOT NULL);
CREATE TABLE cases (
    key TEXT PRIMARY KEY,
    description TEXT NOT NULL,
    finished_at TEXT NOT NULL,
    {", ".join(f"{name} {kind}" for name, kind in RESULTS.items())}
);
CREATE TABLE sweeps (
    id INTEGER PRIMARY KEY,
    digest TEXT NOT NULL UNIQUE,
    description TEXT NOT NULL,
    keys TEXT NOT NULL,
    started_at TEXT NOT NULL
);
CREATE TABLE points (
    sweep INTEGER NOT NULL REFERENCES sweeps (id),
    position INTEGER NOT NULL,
    method TEXT NOT NULL,
    changes TEXT NOT NULL,
    key TEXT NOT NULL,
    PRIMARY KEY (sweep, position)
) WITHOUT ROWID;
"""
_FORMAT = "planner-sweep"


class Store:
    """An open database file of sweeps; use it in a `with` block.

    Args:
        path: The file; made when it is missing and `create` is True.
        create: Whether it may be made and written to.

    Raises:
        InputError: If it cannot be read or written, is something else, or has another schema.
    """

    def __init__(self, path: str | Path, create: bool = False) -> None:
        self.path = expect_path(path)
        if create:
            refuse_unwritable(path)
        new = not os.path.exists(path)
        if not new and not os.path.isfile(path):
            raise InputError(f"cannot use {path}: it is a folder, a pipe or a device")
        if new and not create:
            raise InputError(f"cannot read {path}: no such file; `planner sweep` makes it")
        with self.explain_errors():
            if create:
                self.path.parent.mkdir(parents=True, exist_ok=True)
            self.db = sqlite3.connect(self.path, timeout=LOCK_WAIT_S, isolation_level=None)
            file = os.stat(self.path)
            self._file = (file.st_dev, file.st_ino)
        if create:
            written_paths.append(self.path)  # from here on whoever ends this run says so
        try:
            with self.explain_errors():
                self._prepare(create)
        except BaseException:
            empty = new and self._is_empty()
            self.db.close()
            if empty:  # a full disk
                for end in ("", "-wal", "-shm"):
                    Path(f"{self.path}{end}").unlink(missing_ok=True)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.db.close()

    def _prepare(self, create: bool) -> None:
        (tables,) = self.db.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if create and tables == 0:
            self._enable_write_ahead()
            with self.transaction():
                # Another process may have been faster.
                if not self._has_version():
                    for statement in filter(str.strip, _TABLES.split(";")):
                        self.db.execute(statement)
                    self.db.execute(
                        "INSERT INTO schema_version VALUES (?, ?)", (SCHEMA_VERSION, _FORMAT)
                    )
        self._refuse_foreign()
        self._add_columns()
        # A commit survives the end of the process; to survive a power cut as well costs 10 ms each.
        self.db.execute("PRAGMA synchronous = NORMAL")

    def _enable_write_ahead(self) -> None:
        """Turn write-ahead logging on; for this SQLite itself waits for no other process."""
        end = time.monotonic() + LOCK_WAIT_S
        while True:
            try:
                self.db.execute("PRAGMA journal_mode = WAL")
            except sqlite3.OperationalError as error:
                if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > end:
                    raise
                time.sleep(0.01)
            else:
                return

    def _is_empty(self) -> bool:
        """Whether nothing has been kept in it, by another process either."""
        try:
            return self.db.execute("SELECT 1 FROM sqlite_master").fetchone() is None
        except sqlite3.Error:  # not even room to look
            sizes = [
                p.stat().st_size if (p := Path(f"{self.path}{end}")).exists() else 0
                for end in ("", "-wal")
            ]
            return sizes[0] <= ONE_PAGE and not sizes[1]

    def _has_version(self) -> bool:
        return bool(
            self.db.execute("SELECT 1 FROM sqlite_master WHERE name = 'schema_version'").fetchone()
        )

    def _refuse_foreign(self) -> None:
        version = None
        if self._has_version():
            version = self.db.execute("SELECT * FROM schema_version").fetchone()
        if version is None or version[-1] != _FORMAT:
            raise InputError(
                f"{self.path} is a database of something else, not of a sweep; name another file"
            )
        if version[0] != SCHEMA_VERSION:
            raise InputError(
                f"{self.path} has schema version {version[0]}; this planner reads and writes"
                f" version {SCHEMA_VERSION}; use the planner that made it, or name a new file"
            )

    def _add_columns(self) -> None:
        """Add the results that an older planner, which made the file, did not know."""
        if not self._missing_columns():
            return
        with self.transaction():
            for name in self._missing_columns():  # another process may have been faster
                self.db.execute(f"ALTER TABLE cases ADD COLUMN {name} {RESULTS[name]}")

    def _missing_columns(self) -> list[str]:
        there = {row[1] for row in self.db.execute("PRAGMA table_info(cases)")}
        return [name for name in RESULTS if name not in there]

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All of the block's changes or none.

        A signal waits until its end: between two steps it would leave the transaction open, and
        what is finished could not be kept any more.
        """
        with hold_signals(), self.explain_errors():
            try:
                self.db.execute("BEGIN IMMEDIATE")
                yield
                self.refuse_lost()
                self.db.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):  # it may be over already
                    self.db.execute("ROLLBACK")
                raise

    @contextmanager
    def explain_errors(self) -> Iterator[None]:
        """SQLite's errors as an `InputError` that names the file."""
        try:
            yield
        except (sqlite3.Error, UnicodeDecodeError, OSError) as error:
            raise InputError(f"cannot use the database {self.path}: {error}") from None

    def refuse_lost(self) -> None:
        """Refuse to go on with a file that has been deleted or replaced: SQLite would not notice.

        Raises:
            InputError: If the path leads to another file than the one that is open.
        """
        try:
            now = os.stat(self.path)
        except OSError:
            now = None
        if now is None or (now.st_dev, now.st_ino) != self._file:
            raise InputError(
                f"{self.path} was deleted or replaced while the sweep ran; its results are lost,"
                " and the same command runs them again"
            )

    # -- writing -------------------------------------------------------------------------------

    def register(self, sweep: Sweep, cases: Iterable[Case]) -> int:
        """Note which cases make up a sweep, as the last one started.

        Returns:
            The sweep's number in this file.
        """
        data = sweep.to_dict()
        sweep_digest = digest(data)
        rows = [(c.label, canonical_json(c.changes), c.key) for c in cases]  # slow: before the lock
        with self.transaction():
            self.db.execute(
                "INSERT INTO sweeps (digest, description, keys, started_at) VALUES (?, ?, ?, ?)"
                " ON CONFLICT (digest) DO UPDATE SET started_at = excluded.started_at",
                (sweep_digest, canonical_json(data), json.dumps(sweep.keys), _now()),
            )
            (number,) = self.db.execute(
                "SELECT id FROM sweeps WHERE digest = ?", (sweep_digest,)
            ).fetchone()
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
        with self.explain_errors():
            return dict(
                self.db.execute(
                    "SELECT key, min(position) AS first FROM points WHERE sweep = ?"
                    " GROUP BY key ORDER BY first",
                    (sweep,),
                )
            )

    def finished_keys(self, retry: Collection[str], plans: bool) -> set[str]:
        """Keys of the finished cases.

        Args:
            retry: Statuses that do not count as finished.
            plans: Whether a solved case without its plan does not count either.
        """
        marks = ", ".join("?" * len(retry))
        with self.explain_errors():
            rows = self.db.execute(
                "SELECT key FROM cases WHERE NOT (? AND solved AND plan IS NULL)"
                f" AND status NOT IN ({marks})",
                (plans, *retry),
            )
            return {key for (key,) in rows}

    def statuses(self, sweep: int) -> dict[str, int]:
        """How many different cases of a sweep ended in each status."""
        with self.explain_errors():
            return dict(
                self.db.execute(
                    "SELECT status, count(*) FROM cases WHERE key IN"
                    " (SELECT key FROM points WHERE sweep = ?) GROUP BY status ORDER BY status",
                    (sweep,),
                )
            )

    def sweeps(self) -> list[dict[str, Any]]:
        """The sweeps run into this file, the last one started last: id, description, keys."""
        with self.explain_errors():
            rows = self.db.execute(
                "SELECT id, description, keys FROM sweeps ORDER BY started_at, id"
            ).fetchall()
        return [
            {
                "id": i,
                "description": self._parse(d, "a description", dict),
                "keys": self._parse(keys, "the keys of a sweep", list),
            }
            for i, d, keys in rows
        ]

    def rows(self, sweep: int) -> Iterator[dict[str, Any]]:
        """The finished cases of a sweep in its order: changes, method, results but the plan."""
        results = [name for name in RESULTS if name != "plan"]
        columns = ", ".join(f"cases.{name}" for name in results)
        with self.explain_errors():
            rows = self.db.execute(
                f"SELECT changes, method, cases.key, {columns}, finished_at FROM points"
                " JOIN cases ON cases.key = points.key WHERE sweep = ? ORDER BY position",
                (sweep,),
            )
            for changes, method, key, *values, finished in rows:
                yield {
                    "changes": self._parse(changes, "the changes of a case", dict),
                    "method": method,
                    "case": key,
                    **dict(zip(results, values, strict=True)),
                    "finished_at": finished,
                }

    def _parse(self, text: Any, what: str, kind: type) -> Any:
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
        with self.explain_errors():
            rows = self.db.execute(
                "SELECT plan FROM cases WHERE substr(key, 1, ?) = ?", (len(key), key)
            ).fetchall()
        if len(rows) != 1:
            raise InputError(f"{self.path}: {len(rows) or 'no'} cases have a key '{key}...'")
        return None if rows[0][0] is None else str(rows[0][0])


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")
