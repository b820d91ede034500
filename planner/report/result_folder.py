"""Write folders of results whole or not at all, and keep what others put into them.

A folder has a list of the files that this program wrote in it, with their digests, in the form of
`sha256sum`. A later run replaces those files. All else in the folder was put there or changed by
others and stays: where a new file needs the name, the other one gets a `~` at its end.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from planner.errors import InputError
from planner.support.files import (
    STAGING,
    creation_mask,
    possible_path,
    refuse_ground,
    written_paths,
)
from planner.support.interrupts import handle_signals, hold_signals

MARKER = ".planner"
"""Name of the list of files that this program wrote in a folder; also marks a folder as ours."""

DIGEST_LENGTH = 66
"""Characters before the name in a line of the list: SHA-256 and two blanks."""


def refuse_unwritable_folder(path: str | Path | None) -> None:
    """Refuse a path that `folder` could not write to, unless None; call it before long work.

    Raises:
        InputError: If the folder holds anything but an earlier run, or cannot be created.
    """
    if path is None:
        return
    target = possible_path(path)
    found = None
    with suppress(OSError):  # asked once: another command may be replacing the folder
        found = target.stat()
    if found is not None and stat.S_ISDIR(found.st_mode):
        if target.resolve() == Path.cwd():
            raise InputError(f"{target} is the current folder; name another folder")
        with suppress(FileNotFoundError):
            names = {each.name for each in target.iterdir()}
            # One that was taken away while its names were read may have lost some.
            if names and MARKER not in names and os.path.samestat(found, target.stat()):
                raise InputError(
                    f"{target} holds files that are not from an earlier run; name another folder"
                )
    elif found is not None:
        raise InputError(f"{target} is a file; name a folder")
    refuse_ground(target)


@contextmanager
def folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary folder to fill; it replaces `path` when the block ends without an error.

    An existing folder at `path` is replaced only if this function made it; files in it that this
    program did not write move to the new folder. If several commands write the same folder at the
    same moment, the last one stays.

    Raises:
        InputError: If `path` cannot be written or holds something else.
    """
    refuse_unwritable_folder(path)
    target = Path(path).resolve()
    new_parents = [p for p in target.parents if not p.exists()]
    staging = None
    try:
        with hold_signals():
            staging = _staging_folder(target.parent)
        yield staging
        with hold_signals():
            files = sorted(each for each in staging.rglob("*") if each.is_file())
            (staging / MARKER).write_bytes(b"".join(_line(file, staging) for file in files))
            os.chmod(staging, 0o777 & ~creation_mask())
            handle_signals()
            _install(staging, target)
            written_paths.append(target)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with hold_signals():
            if staging is not None:
                shutil.rmtree(staging, ignore_errors=True)
            if not target.exists():
                with suppress(OSError):
                    for parent in new_parents:  # innermost first, as far as there and empty
                        parent.rmdir()


def list_file(file: Path) -> None:
    """List a file in a finished folder as it is now, if the folder has a list."""
    with suppress(FileNotFoundError), open(file.parent / MARKER, "r+b") as marker:
        name = _name(file, file.parent)
        others = [line for line in marker if line[DIGEST_LENGTH:] != name]
        marker.truncate(marker.seek(0))
        marker.writelines([*others, _line(file, file.parent)])


def _staging_folder(parent: Path) -> Path:
    """Return a new temporary folder; another command may remove the empty parent meanwhile."""
    while True:
        parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):
            return Path(tempfile.mkdtemp(dir=parent, prefix=STAGING))


def _install(staging: Path, target: Path) -> None:
    """Rename a folder to `target`, then move into it what others put into the earlier one.

    Other commands may take or make `target` between any two steps; then this one tries again.
    """
    earlier: list[Path] = []
    while True:
        old = Path(f"{staging}.old{len(earlier)}")
        with suppress(FileNotFoundError):
            os.replace(target, old)
            earlier.append(old)
        try:
            os.replace(staging, target)
            break
        except OSError as error:
            # Another's folder may have been there, and be gone by now.
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST) and not target.exists():
                for old in earlier[-1:]:
                    os.replace(old, target)
                raise
    for old in earlier:
        _remove_own(old)
        while old.exists():
            try:
                target.mkdir(exist_ok=True)
                (target / MARKER).touch()
                _move_into(old, target)
            except OSError as error:
                if error.errno not in (errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST):
                    raise InputError(
                        f"{target} is written, but some files that others put there are now in"
                        f" {old}: {error.strerror}"
                    ) from None


def _remove_own(old: Path) -> None:
    """Remove the files that this program wrote, unless they were changed, and emptied folders."""
    for marker in [*old.rglob(MARKER)]:
        top = marker.parent
        listed = set(marker.read_bytes().splitlines(keepends=True))
        names = {line[DIGEST_LENGTH:] for line in listed}
        # The names are those found, not those listed: anyone may have written a list.
        for file in [p for p in top.rglob("*") if _name(p, top) in names]:
            if file.is_file() and not file.is_symlink() and _line(file, top) in listed:
                _remove(file, old)
        _remove(marker, old)


def _remove(file: Path, top: Path) -> None:
    """Remove a file, and the folders below `top` that it leaves empty."""
    file.unlink()
    with suppress(OSError):
        for place in file.parents:
            if place == top:
                break
            place.rmdir()


def _move_into(old: Path, new: Path) -> None:
    """Move all of a folder into another one, and remove it; no file there is replaced."""
    for entry in [*old.iterdir()]:
        place = new / entry.name
        if all(each.is_dir() and not each.is_symlink() for each in (entry, place)):
            _move_into(entry, place)
            continue
        while os.path.lexists(place):
            place = place.with_name(f"{place.name}~")
        os.rename(entry, place)
    old.rmdir()


def _name(file: Path, top: Path) -> bytes:
    return os.fsencode(file.relative_to(top).as_posix()) + b"\n"


def _line(file: Path, top: Path) -> bytes:
    """Return the line of a file in the list of its folder: digest and name."""
    with open(file, "rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return f"{digest}  ".encode() + _name(file, top)
