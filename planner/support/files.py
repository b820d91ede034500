"""Writing that leaves either the whole file or nothing.

Reading files that others wrote: regular files of a sane size, and text that can be parsed.

Everything that reads a file a user names goes through here. What cannot be read is an `InputError`
that names the file, at once: not a wait for a pipe, and not a device read until the memory is full.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from planner.errors import InputError
from planner.support.interrupts import hold_signals
from planner.support.tables import shorten

written_paths: list[Path] = []
"""Files and folders that were put in their places; the command line tells of them when ended."""


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole or not at all (temporary file, then rename); its folder is made.

    Halves of surrogate pairs (bytes of a file's name that are not UTF-8) are written as \\udc80,
    which is their escape in JSON. A link is followed; a device or pipe (/dev/stdout) is written to
    as it is.

    Raises:
        InputError: If the folder cannot be made or written, or the disk is full.
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
        with hold_signals() as disturbed:
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=_STAGING)
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(content)
                os.chmod(temporary, 0o666 & ~_umask())
                if not disturbed():
                    os.replace(temporary, target)
                    written_paths.append(target)
            finally:
                Path(temporary).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    return target


def refuse_unwritable(path: str | Path) -> None:
    """Refuse a file that `write_text` could not write, before the work that fills it.

    Raises:
        InputError: If the path is a folder, or its folder is a file, read-only, or cannot be made.
    """
    target = _possible_path(path)
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; name a file in it")
    if not target.exists():
        _refuse_ground(target)
    elif not os.access(target, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write there")


def _refuse_ground(target: Path) -> None:
    """Refuse a path where nothing can be made: the part of it that exists is a file, or closed."""
    ground = next(p for p in target.resolve().parents if p.exists())
    if not ground.is_dir():
        raise InputError(f"cannot write {target}: {ground} is a file, not a folder")
    if not os.access(ground, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write in {ground}")


def expect_path(path: object) -> Path:
    """The path of a file or folder that a caller names.

    Raises:
        InputError: If it is something else than a name.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{shorten(repr(path))} is not the name of a file or folder")
    return Path(path)


def _possible_path(path: str | Path) -> Path:
    """The path, if there can be one of this name.

    Raises:
        InputError: If a part is too long, holds a zero byte, or is a link to itself.
    """
    wanted = expect_path(path)
    try:
        os.stat(wanted)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # told better below
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"cannot write {shorten(str(path))}: {reason}; use another name") from None
    return wanted


def refuse_unwritable_folder(path: str | Path) -> None:
    """Refuse a folder that `folder` could not fill, before the work that fills it.

    Raises:
        InputError: If it holds something else than an earlier run, or cannot be made.
    """
    target = _possible_path(path)
    if target.is_dir():
        if target.resolve() == Path.cwd():
            raise InputError(f"{target} is the current folder; name another folder")
        if any(target.iterdir()) and not (target / _MARKER).exists():
            raise InputError(
                f"{target} holds files that are not from an earlier run; name another folder"
            )
    elif target.exists():
        raise InputError(f"{target} is a file; name a folder")
    _refuse_ground(target)


def make_folder(path: str | Path) -> Path:
    """The folder, made when missing, to which several runs add.

    Raises:
        InputError: If it is a file or cannot be made.
    """
    place = expect_path(path)
    if place.exists() and not place.is_dir():
        raise InputError(f"{place} is a file; name a folder")
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {place}: {error.strerror or error}") from None
    return place


@contextmanager
def folder(path: str | Path) -> Iterator[Path]:
    """A folder to fill that takes the place of `path` when the block ends, and only then.

    An existing folder at `path` is replaced only if this function made it (it leaves a marker).

    Raises:
        InputError: If `path` cannot be written or holds something else.
    """
    refuse_unwritable_folder(path)
    target = Path(path).resolve()
    new_parents = [p for p in target.parents if not p.exists()]
    staging = None
    try:
        with hold_signals():
            target.parent.mkdir(parents=True, exist_ok=True)
            staging = Path(tempfile.mkdtemp(dir=target.parent, prefix=_STAGING))
        yield staging
        with hold_signals() as disturbed:
            (staging / _MARKER).touch()
            os.chmod(staging, 0o777 & ~_umask())
            if not disturbed():
                _swap(staging, target)
                written_paths.append(target)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with hold_signals():
            if staging is not None:
                shutil.rmtree(staging, ignore_errors=True)
            if not target.exists():
                with suppress(OSError):
                    for (
                        folder
                    ) in new_parents:  # innermost first, as far as they are there and empty
                        folder.rmdir()


_STAGING = ".planner."
"""How the names of what is not complete begin; not with the target's own, which may be too long."""

_MARKER = ".planner"


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


Value = TypeVar("Value")

MB = 1_000_000
TOML_BYTES = 4 * MB
"""A problem is a few kB; a sweep of 50,000 cases, each in a line of its own, is 4 MB."""
JSON_BYTES = 200 * MB
"""A plan is below 1 MB; the motions of thousands of machines are some tens."""
SAMPLES_BYTES = 2000 * MB
"""Two million rows, the most that is exported, with fifty columns."""

MOST_LEVELS = 50
"""Levels of tables and lists; a problem has six, a plan of a plan of a plan twice as many."""

MOST_BITS = 1023
"""Bits of a whole number; a float holds no larger one."""

# tomllib takes time with the square of a key's parts: a thousand take a second.
_DEEP_KEY = re.compile(r"(?<![\w.\"'-])(?:[\w\"'-]++[ \t]*\.[ \t]*){100}")


def _open_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # Windows has neither


def read_bytes(path: str | Path, largest: int) -> bytes:
    """The content of a regular file.

    Raises:
        InputError: If it cannot be read, is a folder, pipe or device, or holds more bytes.
    """
    try:
        # A pipe without a writer is opened at once, to be refused; a file is read as ever.
        with open(expect_path(path), "rb", opener=_open_without_waiting) as stream:
            status = os.fstat(stream.fileno())
            regular = stat.S_ISREG(status.st_mode)
            unread = not regular or status.st_size > largest
            content = b"" if unread else stream.read(largest + 1)
    except ValueError as error:  # a zero byte in the name
        raise InputError(f"cannot read {path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if not regular:
        raise InputError(f"cannot read {path}: it is a pipe or a device, not a file")
    size = max(status.st_size, len(content))
    if size > largest:
        raise InputError(
            f"cannot read {path}: it holds {size / MB:.4g} MB, and at most {largest / MB:g} MB are"
            " read of such a file"
        )
    return content


def read_text(path: str | Path, largest: int, what: str) -> str:
    """The text of a file in UTF-8, with a byte order mark or without.

    Args:
        path: The file.
        largest: See `read_bytes`.
        what: What the file should be, for the message ("a problem file is TOML").

    Raises:
        InputError: As for `read_bytes`, or if it is not UTF-8.
    """
    try:
        return read_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file; {what} in UTF-8") from None


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        InputError: If it cannot be read, or is not TOML.
    """
    text = read_text(path, TOML_BYTES, f"{what} is TOML")
    try:
        return parse_toml(text)
    except ValueError as error:
        if text.lstrip().startswith("{"):
            raise InputError(f"{path} is JSON, such as a plan; {what} is TOML") from None
        raise InputError(f"{path} is not valid TOML: {error}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: If it is none that can be read; says why.
    """
    if _DEEP_KEY.search(text):
        raise ValueError("a key of more than 100 parts")
    return _parse(tomllib.loads, text)


def toml_value(text: str) -> Any:
    """One value as in TOML; a plain word may go without quotes.

    Raises:
        ValueError: If it is neither.
    """
    try:
        table = parse_toml(f"value = {text}")
    except ValueError:
        table = {}
    if table.keys() == {"value"}:
        return table["value"]
    if re.fullmatch(r"[A-Za-z_][\w.+-]*", text):
        return text
    raise ValueError("is not a value")


def read_json(path: str | Path, otherwise: str = "") -> dict[str, Any]:
    """The object in a JSON file.

    Args:
        path: The file.
        otherwise: What to add where it is not JSON: how to get such a file.

    Raises:
        InputError: If it cannot be read, is not JSON, or holds something else than one object.
    """
    text = read_text(path, JSON_BYTES, "it should be JSON")
    try:
        data = parse_json(text)
    except ValueError as error:
        raise InputError(f"{path} is not JSON: {error}{otherwise and '; '}{otherwise}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path} does not hold one object{otherwise and '; '}{otherwise}")
    return data


def parse_json(text: str) -> Any:
    """The value of a JSON text; a key that is there twice is an error, not the last of its values.

    Raises:
        ValueError: If it is none that can be read; says why.
    """
    return _parse(partial(json.loads, object_pairs_hook=_check_unique_keys), text)


def _parse(loads: Callable[[str], Value], text: str) -> Value:
    try:
        return _check_depth(loads(text))
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None
    except ValueError as error:
        if "integer string conversion" in str(error):  # with Python's advice, not for users
            raise ValueError("a whole number has thousands of digits") from None
        raise


def _check_depth(data: Value) -> Value:
    """The data, if those who walk through it level by level can."""
    depth = 0
    level: list[Any] = [data] if isinstance(data, dict | list) else []
    while level:
        depth += 1
        if depth > MOST_LEVELS:
            raise RecursionError
        inner = (v.values() if isinstance(v, dict) else v for v in level)
        level = []
        for v in chain.from_iterable(inner):
            if isinstance(v, dict | list):
                level.append(v)
            elif isinstance(v, int) and v.bit_length() > MOST_BITS:
                raise ValueError("a whole number has hundreds of digits")
    return data


def _check_unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {twice!r:.60} appears twice in one object")
    return out


def toml(value: Any) -> str:
    """A value as TOML text, so that it can be given back on a command line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)} = {toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else toml(name)


def toml_lines(table: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """A table as TOML, each value on a line: its own values, then the tables in it.

    Args:
        table: The table.
        path: The dotted name of the table with a dot behind, or "" for that of the file.
    """
    inner = {key: value for key, value in table.items() if _holds_tables(value)}
    yield from (f"{_key(key)} = {toml(table[key])}" for key in table if key not in inner)
    for key, value in inner.items():
        name = f"{path}{_key(key)}"
        head = f"[{name}]" if isinstance(value, Mapping) else f"[[{name}]]"
        for each in [value] if isinstance(value, Mapping) else value:
            yield from ("", head, *toml_lines(each, f"{name}."))


def _holds_tables(value: Any) -> bool:
    """Whether it is a table, or a list of such."""
    listed = value if isinstance(value, list) and value else [value]
    return all(isinstance(each, Mapping) for each in listed)
