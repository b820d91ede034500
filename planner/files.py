"""Writing that leaves either the whole file or nothing."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from planner.errors import InputError


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole or not at all (temporary file, then rename).

    Raises:
        InputError: If the folder does not exist or cannot be written, or the disk is full.
    """
    target = Path(path)
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return target


@contextmanager
def folder(path: str | Path) -> Iterator[Path]:
    """A folder to fill that takes the place of `path` when the block ends, and only then.

    An existing folder at `path` is replaced only if this function made it (it leaves a marker).

    Raises:
        InputError: If `path` cannot be written or holds something else.
    """
    target = Path(path)
    _refuse_foreign(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    try:
        yield staging
        (staging / _MARKER).touch()
        os.chmod(staging, 0o777 & ~_umask())
        _swap(staging, target)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


_MARKER = ".planner"


def _refuse_foreign(target: Path) -> None:
    if target.is_dir():
        if any(target.iterdir()) and not (target / _MARKER).exists():
            raise InputError(
                f"{target} holds files that are not from an earlier run; name another folder"
            )
    elif target.exists():
        raise InputError(f"{target} is a file; name a folder")


def _swap(staging: Path, target: Path) -> None:
    if not target.exists():
        os.replace(staging, target)
        return
    old = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.old."))
    os.replace(target, old)
    try:
        os.replace(staging, target)
    except OSError:
        os.replace(old, target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
