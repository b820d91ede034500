"""The database file of sweeps (SQLite). Each finished case is saved at once in its own transaction.

`cases` has one row per case, by its key; `points` lists the cases of each sweep in the file, and
`claims` those that a client is running (see `clients`). With write-ahead logging a commit survives
any end of the process. A file of another kind is refused and not changed.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sqlite3
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, Self

from planner.comparison.rows import EARLIER_NAMES
from planner.errors import InputError
from planner.problem.tables.kinds import parse_file, system_of
from planner.support.files import expect_path, parse_json, refuse_unwritable, written_paths
from planner.support.interrupts import hold_signals
from planner.sweep.case import RESULTS, Case, Row
from planner.sweep.clients import is_alive
from planner.sweep.description import Sweep
from planner.sweep.sweep_file import canonical_json, digest
from planner.systems.triangular_system import TriangularSystem

SCHEMA_VERSION = 1
_ORDER = {"started": "INTEGER"}
"""Columns of the starts' order in the file: 1 for the first start, and so on; no clock is asked."""

LOCK_WAIT_S = 30.0
"""Longest wait for another process that writes to the same file, in seconds."""

ONE_PAGE = 4096
"""Size of a page of SQLite in bytes; a database file with tables has several pages."""

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
    started_at TEXT NOT NULL,
    {", ".join(f"{name} {kind}" for name, kind in _ORDER.items())}
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
_CLAIMS = """
CREATE TABLE IF NOT EXISTS claims (key TEXT PRIMARY KEY, client TEXT NOT NULL) WITHOUT ROWID
"""
_FORMAT = "planner-sweep"


def _end_process(_signal: int) -> None:
    """Tell in one line that the index of the log (-shm) of the last opened file cannot be written.

    SQLite has the index in its memory and writes to it without a check: where it has become
    read-only (`chattr +i`, a file system with errors), the system sends SIGBUS. The write cannot be
    undone, so that nothing else can go on.
    """
    try:
        says = f"planner: cannot use the database {Store._last_path}: its index cannot be written\n"
        os.write(2, os.fsencode(says))
    finally:
        os._exit(2)


_BUS_HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int)(_end_process)


class Store:
    """An open database file of sweeps; use it in a `with` block.

    Args:
        path: The file; created if it is missing and `create` is True.
        create: Whether the file may be created and written.

    Raises:
        InputError: If the file cannot be read or written, is no sweep database, or has another
            schema version.
    """

    _last_path: ClassVar[Path]

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
            self._file = os.stat(self.path)
            Store._last_path = self.path
            if create and hasattr(signal, "SIGBUS"):  # not on Windows
                ctypes.CDLL(None).signal(signal.SIGBUS, _BUS_HANDLER)
        if create:
            written_paths.append(self.path)  # an interruption message names this file
        try:
            with self.explain_errors():
                self._prepare(create)
        except BaseException:
            empty = new and self._is_empty()
            self.db.close()
            if empty:  # no table could be created (a full disk)
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
                # Another process may have created the tables meanwhile.
                if not self._has_version():
                    for statement in filter(str.strip, _TABLES.split(";")):
                        self.db.execute(statement)
                    self.db.execute(
                        "INSERT INTO schema_version VALUES (?, ?)", (SCHEMA_VERSION, _FORMAT)
                    )
        self._refuse_foreign()
        self._add_columns()
        if create:  # with the tables, or in a file of an older version of planner
            self.db.execute(_CLAIMS)
        # A commit survives the end of the process, not a power cut; that would cost 10 ms per case.
        self.db.execute("PRAGMA synchronous = NORMAL")

    def _enable_write_ahead(self) -> None:
        """Turn on write-ahead logging; retry while another process holds a lock on the file."""
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
        """Return whether the database file has no tables, neither ours nor another process's."""
        try:
            return self.db.execute("SELECT 1 FROM sqlite_master").fetchone() is None
        except sqlite3.Error:  # a full disk may prevent even reading
            sizes = [
                p.stat().st_size if (p := Path(f"{self.path}{end}")).exists() else 0
                for end in ("", "-wal")
            ]
            return sizes[0] <= ONE_PAGE and not sizes[1]

    def _has_version(self) -> bool:
        return bool(self._select("SELECT 1 FROM sqlite_master WHERE name = 'schema_version'"))

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
        """Add or rename columns in a file of an older version of planner."""
        if not self._missing_columns():
            return
        with self.transaction():
            for table, name, kind in self._missing_columns():  # another process may have added some
                change = f"ADD COLUMN {name} {kind}"
                if (earlier := EARLIER_NAMES.get(name)) in self._columns(table):
                    change = f"RENAME COLUMN {earlier} TO {name}"
                self.db.execute(f"ALTER TABLE {table} {change}")

    def _columns(self, table: str) -> set[str]:
        return {row[1] for row in self.db.execute(f"PRAGMA table_info({table})")}

    def _missing_columns(self) -> list[tuple[str, str, str]]:
        """Return table, name and kind of each missing column."""
        out = []
        for table, columns in {"cases": RESULTS, "sweeps": _ORDER}.items():
            there = self._columns(table)
            out += [(table, name, kind) for name, kind in columns.items() if name not in there]
        return out

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Apply all changes that the block makes to the database, or none.

        Signals wait until the end of the block: between two steps a signal would leave the
        transaction open, and finished cases could not be saved any more.
        """
        with hold_signals(), self.explain_errors():
            try:
                self.db.execute("BEGIN IMMEDIATE")
                yield
                self.refuse_lost()
                self.db.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):  # the transaction may have ended
                    self.db.execute("ROLLBACK")
                raise

    @contextmanager
    def explain_errors(self) -> Iterator[None]:
        """Convert errors of SQLite into an `InputError` that names the file."""
        try:
            yield
        except (sqlite3.Error, UnicodeDecodeError, OSError) as error:
            raise InputError(f"cannot use the database {self.path}: {error}") from None

    def refuse_lost(self) -> None:
        """Refuse to continue if the database file was deleted or replaced: SQLite does not notice.

        Raises:
            InputError: If the path no longer leads to the open file.
        """
        with suppress(OSError):
            if os.path.samestat(os.stat(self.path), self._file):
                return
        raise InputError(
            f"{self.path} was deleted or replaced while the sweep ran; its results are lost, and"
            " the same command runs the cases again"
        )

    # -- writing -------------------------------------------------------------------------------

    def register(self, sweep: Sweep, cases: Iterable[Case]) -> int:
        """Record the cases of a sweep, and that this sweep was started last.

        Tables or cases that differ, as those of another version of planner may, make another sweep;
        so the cases of a recorded sweep never change.

        Returns:
            The sweep's number in this file.
        """
        data = sweep.to_dict()
        rows = [(c.label, canonical_json(c.changes), c.key) for c in cases]  # slow: before the lock
        whole = digest([data, rows])
        with self.transaction():
            self.db.execute(
                "INSERT INTO sweeps (digest, description, keys, started_at, started)"
                " VALUES (?, ?, ?, ?, (SELECT coalesce(max(started), 0) + 1 FROM sweeps))"
                " ON CONFLICT (digest) DO UPDATE"
                " SET started_at = excluded.started_at, started = excluded.started",
                (whole, canonical_json(data), json.dumps(sweep.keys), _now()),
            )
            ((number,),) = self._select("SELECT id FROM sweeps WHERE digest = ?", whole)
            self.db.executemany(
                "INSERT OR IGNORE INTO points VALUES (?, ?, ?, ?, ?)",
                ((number, position, *row) for position, row in enumerate(rows)),
            )
        return int(number)

    def claim(
        self, wanted: Mapping[str, int], plans: bool, client: str, most: int
    ) -> tuple[list[str], list[str]]:
        """Claim cases for a client, except those that another living client has claimed.

        Args:
            wanted: Keys of the cases, each with the number of its row; see `unfinished`.
            plans: Whether a solved case without a saved plan counts as unfinished.
            client: Name of the client.
            most: Most cases to claim.

        Returns:
            The keys of the claimed cases, and of those that another client has finished meanwhile.
        """
        claimed, finished, alive = list[str](), list[str](), dict[str, bool]()
        with self.transaction():
            for key, before in wanted.items():
                if len(claimed) == most:
                    break
                ((holder, row),) = self._select(
                    "SELECT (SELECT client FROM claims WHERE key = ?), (SELECT rowid FROM cases"
                    " WHERE key = ? AND NOT (? AND solved AND plan IS NULL))",
                    *(key, key, plans),
                )
                if row not in (None, before):
                    finished.append(key)
                    continue
                if holder is not None and holder not in alive:
                    alive[holder] = is_alive(holder, self.path)
                if holder is None or not alive[holder]:
                    self.db.execute("INSERT OR REPLACE INTO claims VALUES (?, ?)", (key, client))
                    claimed.append(key)
        return claimed, finished

    def add(self, case: Case, row: Row) -> None:
        """Save a finished case in a new row, and end its claim.

        An earlier row of the same key is replaced, but a solved case keeps its saved plan.
        """
        names = ["key", "description", "finished_at", *RESULTS]
        marks = ", ".join("?" * len(names))
        with self.transaction():
            if row["solved"] and row["plan"] is None:
                saved = self._select("SELECT plan FROM cases WHERE key = ?", case.key)
                row = {**row, "plan": saved[0][0] if saved else None}
            values = [case.key, case.description, _now(), *(row[name] for name in RESULTS)]
            self.db.execute(
                f"INSERT OR REPLACE INTO cases ({', '.join(names)}) VALUES ({marks})", values
            )
            self.db.execute("DELETE FROM claims WHERE key = ?", (case.key,))

    # -- reading -------------------------------------------------------------------------------

    def _select(self, query: str, *values: Any) -> list[Any]:
        """Return the rows that an SQL query finds; `values` replace its question marks."""
        with self.explain_errors():
            return self.db.execute(query, values).fetchall()

    def positions(self, sweep: int) -> dict[str, int]:
        """Return the first position of each different case of a sweep, by key, finished or not."""
        return dict(
            self._select(
                "SELECT key, min(position) AS first FROM points WHERE sweep = ?"
                " GROUP BY key ORDER BY first",
                sweep,
            )
        )

    def unfinished(self, sweep: int, retry: Collection[str], plans: bool) -> dict[str, int]:
        """Return the unfinished cases of a sweep by key, each with the number of its row, or 0.

        A case that is run again gets a new row, so its number tells whether that has happened.

        Args:
            sweep: The sweep's number.
            retry: Statuses that do not count as finished.
            plans: Whether a solved case without a saved plan counts as unfinished.
        """
        marks = ", ".join("?" * len(retry))
        return dict(
            self._select(
                "SELECT points.key, coalesce(cases.rowid, 0) FROM points"
                " LEFT JOIN cases ON cases.key = points.key WHERE sweep = ? AND (cases.key IS NULL"
                f" OR (? AND solved AND plan IS NULL) OR status IN ({marks}))"
                " GROUP BY points.key ORDER BY min(position)",
                *(sweep, plans, *retry),
            )
        )

    def statuses(self, sweep: int) -> dict[str, int]:
        """Return the number of different cases of a sweep by status."""
        return dict(
            self._select(
                "SELECT status, count(*) FROM cases WHERE key IN"
                " (SELECT key FROM points WHERE sweep = ?) GROUP BY status ORDER BY status",
                sweep,
            )
        )

    def find_sweep(self, number: int | None = None) -> tuple[int, list[str]]:
        """Return number and varied keys of a sweep in the file; by default of that started last.

        Raises:
            InputError: If the file holds no sweep, or none of this number.
        """
        rows = self._select("SELECT id, keys FROM sweeps ORDER BY started, id")
        if not rows:
            raise InputError(f"{self.path} holds no sweep yet")
        last, _ = rows[-1]
        keys = dict(rows)
        if number is not None and number not in keys:
            listed = ", ".join(map(str, sorted(keys)))
            raise InputError(f"{self.path} holds no sweep {number}; there are: {listed}")
        found = last if number is None else number
        return found, self._parse(keys[found], "the keys of a sweep", list)

    def system(self, sweep: int) -> TriangularSystem | None:
        """Return the system of a sweep; None if this computer lacks the package that brings it."""
        ((text,),) = self._select("SELECT description FROM sweeps WHERE id = ?", sweep)
        tables = self._parse(text, "the description of a sweep", dict)["problem"]
        # other tables may have keys that only an older version knows
        tables = {name: tables[name] for name in ("system", "start", "goal") if name in tables}
        with suppress(InputError):
            return system_of(parse_file(tables, str(self.path)))
        return None

    def rows(self, sweep: int) -> Iterator[dict[str, Any]]:
        """Yield changes, method and results (without plan) of a sweep's finished cases in order."""
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
        """Parse JSON text from the database, and refuse a value that is not of the given kind."""
        try:
            value = parse_json(text)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path} is damaged: {what} is not JSON: {error}") from None
        if not isinstance(value, kind):
            raise InputError(f"{self.path} is damaged: {what} is {value!r:.60}")
        return value

    def plan(self, key: str) -> str | None:
        """Return the text of a saved plan, by the key of its case or a unique beginning of it."""
        rows = self._select("SELECT plan FROM cases WHERE substr(key, 1, ?) = ?", len(key), key)
        if len(rows) != 1:
            raise InputError(f"{self.path}: {len(rows) or 'no'} cases have a key '{key}...'")
        return None if rows[0][0] is None else str(rows[0][0])


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")
