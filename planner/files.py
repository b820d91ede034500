"""Writing that leaves either the whole file or nothing."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from planner.display import brief
from planner.errors import InputError
from planner.interrupts import undisturbed

written: list[Path] = []
"""Files and folders that were put in their places; the command line tells of them when ended."""


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole or not at all (temporary file, then rename).

    Halves of surrogate pairs (bytes of a file's name that are not UTF-8) are written as \\udc80,
    which is their escape in JSON. A link is followed; a device or pipe (/dev/stdout) is written to
    as it is.

    Raises:
        InputError: If the folder does not exist or cannot be written, or the disk is full.
    """
    return write_bytes(path, text.encode("utf-8", "backslashreplace"))


def write_bytes(path: str | Path, content: bytes) -> Path:
    """As `write_text`, for a binary file."""
    refuse_unwritable(path)
    target = Path(path).resolve()
    try:
        if target.exists() and not target.is_file():
            target.write_bytes(content)
            return target
        with undisturbed() as disturbed:
            handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=_STAGING)
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(content)
                os.chmod(temporary, 0o666 & ~_umask())
                if not disturbed():
                    os.replace(temporary, target)
                    written.append(target)
            finally:
                Path(temporary).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    return target


def refuse_unwritable(path: str | Path) -> None:
    """Refuse a file that `write_text` could not write, before the work that fills it.

    Raises:
        InputError: If the path is a folder, or its folder is missing, a file, or read-only.
    """
    target = _nameable(path)
    parent = target.resolve().parent
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; name a file in it")
    if not parent.exists():
        raise InputError(f"cannot write {target}: there is no folder {parent}; make it first")
    if not parent.is_dir():
        raise InputError(f"cannot write {target}: {parent} is a file, not a folder")
    if not os.access(target if target.exists() else parent, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write there")


def _nameable(path: str | Path) -> Path:
    """The path, if there can be one of this name.

    Raises:
        InputError: If a part is too long, holds a zero byte, or is a link to itself.
    """
    try:
        Path(path).resolve()
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # told better below
    except (OSError, RuntimeError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"cannot write {brief(str(path))}: {reason}; use another name") from None
    return Path(path)


def refuse_unwritable_folder(path: str | Path) -> None:
    """Refuse a folder that `folder` could not fill, before the work that fills it.

    Raises:
        InputError: If it holds something else than an earlier run, or cannot be made.
    """
    target = _nameable(path)
    if target.is_dir():
        if target.resolve() == Path.cwd():
            raise InputError(f"{target} is the current folder; name another folder")
        if any(target.iterdir()) and not (target / _MARKER).exists():
            raise InputError(
                f"{target} holds files that are not from an earlier run; name another folder"
            )
    elif target.exists():
        raise InputError(f"{target} is a file; name a folder")
    ground = next(p for p in target.resolve().parents if p.exists())
    if not ground.is_dir():
        raise InputError(f"cannot write {target}: {ground} is a file, not a folder")
    if not os.access(ground, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write in {ground}")


@contextmanager
def folder(path: str | Path) -> Iterator[Path]:
    """A folder to fill that takes the place of `path` when the block ends, and only then.

    An existing folder at `path` is replaced only if this function made it (it leaves a marker).

    Raises:
        InputError: If `path` cannot be written or holds something else.
    """
    refuse_unwritable_folder(path)
    target = Path(path).resolve()
    made = [p for p in target.parents if not p.exists()]
    staging = None
    try:
        with undisturbed():
            target.parent.mkdir(parents=True, exist_ok=True)
            staging = Path(tempfile.mkdtemp(dir=target.parent, prefix=_STAGING))
        yield staging
        with undisturbed() as disturbed:
            (staging / _MARKER).touch()
            os.chmod(staging, 0o777 & ~_umask())
            if not disturbed():
                _swap(staging, target)
                written.append(target)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with undisturbed():
            if staging is not None:
                shutil.rmtree(staging, ignore_errors=True)
            if not target.exists():
                _remove_empty(made)


_STAGING = ".planner."
"""How the names of what is not complete begin; not with the target's own, which may be too long."""

_MARKER = ".planner"


def _remove_empty(folders: list[Path]) -> None:
    """Remove the folders, innermost first, as far as they are there and empty."""
    with suppress(OSError):
        for path in folders:
            path.rmdir()


def _swap(staging: Path, target: Path) -> None:
    if not target.exists():
        os.replace(staging, target)
        return
    old = Path(tempfile.mkdtemp(dir=target.parent, prefix=f"{_STAGING}old."))
    os.replace(target, old)
    try:
        os.replace(staging, target)
    except BaseException:
        os.replace(old, target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
