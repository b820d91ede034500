"""Clients of one database: each claims a case before it runs it.

A claim holds as long as its client lives. Each client locks a file of its own beside the database;
the operating system unlocks it when the process ends, however it ends. So neither clocks nor
process numbers are compared, and a dead client's cases come free at once. All clients of a database
run on one computer, as SQLite's write-ahead log requires anyway.
"""

from __future__ import annotations

import os
import sqlite3
import tempfile
from pathlib import Path
from typing import Self

from planner.support.files import STAGING, creation_mask

_PREFIX = f"{STAGING}client."


class Client:
    """The lock of this client of a database, from now to the end of the `with` block.

    Attributes:
        name: Name of the lock's file, which claims refer to.
    """

    def __init__(self, db: Path) -> None:
        handle, path = tempfile.mkstemp(dir=db.resolve().parent, prefix=_PREFIX)
        os.close(handle)
        os.chmod(path, 0o666 & ~creation_mask())
        self._path = Path(path)
        self.name = self._path.name
        # SQLite has the one lock for files that is the same on every system.
        self._lock = sqlite3.connect(path, isolation_level=None)
        self._lock.execute("PRAGMA journal_mode = MEMORY")  # else a second file is left
        self._lock.execute("BEGIN EXCLUSIVE")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._lock.close()
        self._path.unlink(missing_ok=True)


def is_alive(name: str, db: Path) -> bool:
    """Return whether a client of a database still holds its lock; remove a dead client's file."""
    path = db.resolve().parent / name
    # Names come from the database, and a database may come from anyone.
    if path.name != name or not name.startswith(_PREFIX) or not path.exists():
        return False
    lock = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True, timeout=0)
    try:
        lock.execute("SELECT 1 FROM sqlite_master")
    except sqlite3.OperationalError:  # it is locked, or gone at this moment
        return path.exists()
    finally:
        lock.close()
    path.unlink(missing_ok=True)
    return False
