"""Writing that leaves either the whole file or nothing."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from planner.errors import InputError


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole or not at all (temporary file, then rename).

    A link is followed; a device or pipe (/dev/stdout) is written to as it is.

    Raises:
        InputError: If the folder does not exist or cannot be written, or the disk is full.
    """
    return write_bytes(path, text.encode())


def write_bytes(path: str | Path, content: bytes) -> Path:
    """As `write_text`, for a binary file."""
    refuse_unwritable(path)
    target = Path(path).resolve()
    temporary = None
    try:
        if target.exists() and not target.is_file():
            target.write_bytes(content)
            return target
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return target


def refuse_unwritable(path: str | Path) -> None:
    """Refuse a file that `write_text` could not write, before the work that fills it.

    Raises:
        InputError: If the path is a folder, or its folder is missing, a file, or read-only.
    """
    target = Path(path)
    parent = target.resolve().parent
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; name a file in it")
    if not parent.exists():
        raise InputError(f"cannot write {target}: there is no folder {parent}; make it first")
    if not parent.is_dir():
        raise InputError(f"cannot write {target}: {parent} is a file, not a folder")
    if not os.access(target if target.exists() else parent, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write there")


def refuse_unwritable_folder(path: str | Path) -> None:
    """Refuse a folder that `folder` could not fill, before the work that fills it.

    Raises:
        InputError: If it holds something else than an earlier run, or cannot be made.
    """
    target = Path(path)
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
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
        yield staging
        (staging / _MARKER).touch()
        os.chmod(staging, 0o777 & ~_umask())
        _swap(staging, target)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)
        if not target.exists():
            _remove_empty(made)


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
    old = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.old."))
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
