"""An SQLite file of sweeps: opened, told apart from others, written in whole transactions."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from planner.errors import InputError
from planner.files import refuse_unwritable
from planner.sweep.case import RESULTS

SCHEMA_VERSION = 1
WAIT_S = 30.0
"""How long to wait for another process that writes to the same file."""

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


class Database:
    """An open database file; use it in a `with` block.

    Args:
        path: The file; made when it is missing and `create` is True.
        create: Whether it may be made and written to.

    Raises:
        InputError: If it cannot be read or written, is something else, or has another schema.
    """

    def __init__(self, path: str | Path, create: bool = False) -> None:
        self.path = Path(path)
        if create:
            refuse_unwritable(path)
        new = not os.path.exists(path)
        if not new and not os.path.isfile(path):
            raise InputError(f"cannot use {path}: it is a folder, a pipe or a device")
        if new and not create:
            raise InputError(f"cannot read {path}: no such file; `planner sweep` makes it")
        with self.explained():
            self.db = sqlite3.connect(self.path, timeout=WAIT_S, isolation_level=None)
            found = os.stat(self.path)
            self._file = (found.st_dev, found.st_ino)
        try:
            with self.explained():
                self._prepare(create)
        except BaseException:
            self.db.close()
            if new and self.path.exists() and not self.path.stat().st_size:
                self.path.unlink()  # nothing of it could be written: a full disk
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.db.close()

    def _prepare(self, create: bool) -> None:
        (tables,) = self.db.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if create and tables == 0:
            self.db.execute("PRAGMA journal_mode = WAL")
            with self.transaction():
                # Another process may have been faster.
                if not self._has_version():
                    for statement in filter(str.strip, _TABLES.split(";")):
                        self.db.execute(statement)
                    self.db.execute(
                        "INSERT INTO schema_version VALUES (?, ?)", (SCHEMA_VERSION, _FORMAT)
                    )
        self._refuse_foreign()
        # A commit survives the end of the process; to survive a power cut as well costs 10 ms each.
        self.db.execute("PRAGMA synchronous = NORMAL")

    def _has_version(self) -> bool:
        return bool(
            self.db.execute("SELECT 1 FROM sqlite_master WHERE name = 'schema_version'").fetchone()
        )

    def _refuse_foreign(self) -> None:
        found = None
        if self._has_version():
            found = self.db.execute("SELECT * FROM schema_version").fetchone()
        if found is None or found[-1] != _FORMAT:
            raise InputError(
                f"{self.path} is a database of something else, not of a sweep; name another file"
            )
        if found[0] != SCHEMA_VERSION:
            raise InputError(
                f"{self.path} has schema version {found[0]}; this planner reads and writes version"
                f" {SCHEMA_VERSION}; use the planner that made it, or name a new file"
            )

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All of the block's changes or none."""
        with self.explained():
            self.db.execute("BEGIN IMMEDIATE")
            try:
                yield
            except BaseException:
                with suppress(sqlite3.Error):  # it may be over already
                    self.db.execute("ROLLBACK")
                raise
            self.refuse_lost()
            self.db.execute("COMMIT")

    @contextmanager
    def explained(self) -> Iterator[None]:
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
