"""Read and write files safely.

A file is written whole or not at all. Only regular files up to a size limit are read.

All code that reads a file named by a user uses this module. If a file cannot be read, an
`InputError` names it at once: the program neither waits for a pipe nor fills the memory from a
device.
"""

from __future__ import annotations

import io
import json
import os
import re
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from planner.errors import InputError
from planner.support.interrupts import handle_signals, hold_signals
from planner.support.tables import shorten

written_paths: list[Path] = []
"""Files and folders written so far; the command line lists them when it is interrupted."""


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole or not at all (temporary file, then rename); create its folder.

    Halves of surrogate pairs (bytes of file names that are not UTF-8) are written as \\udc80, their
    escape in JSON. A link is followed. A device or pipe (/dev/stdout) is written to directly.

    Raises:
        InputError: If the folder cannot be created or written to, or the disk is full.
    """
    return write_bytes(path, text.encode("utf-8", "backslashreplace"))


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a binary file in the same way as `write_text`."""
    refuse_unwritable(path)
    target = expect_path(path)
    try:
        # The resolved name of a pipe, as behind /dev/stdout, is none that can be opened.
        if target.exists() and not target.is_file():
            target.write_bytes(content)
            return target
        target = target.resolve()
        with hold_signals():
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=STAGING)
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(content)
                os.chmod(temporary, 0o666 & ~creation_mask())
                handle_signals()
                os.replace(temporary, target)
                written_paths.append(target)
            finally:
                Path(temporary).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    return target


def write_json(path: str | Path, data: Mapping[str, Any]) -> Path:
    """Write JSON-ready data as one JSON object, in the same way as `write_text`."""
    return write_text(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n")


PICTURES = (".png", ".svg", ".pdf")
"""Endings of pictures' names."""


def refuse_picture(path: str | Path | None) -> None:
    """Refuse a path that `write_figure` could not write to, as `refuse_unwritable`.

    Raises:
        InputError: As for `refuse_unwritable`, or if the name has another ending.
    """
    if path is not None and Path(path).suffix not in PICTURES:
        raise InputError(f"cannot draw {path}: its name must end in {', '.join(PICTURES)}")
    refuse_unwritable(path)


def write_figure(path: str | Path, figure: Any) -> Path:
    """Write a Matplotlib figure in the format of the path's ending, whole or not at all."""
    content = io.BytesIO()
    figure.savefig(content, format=Path(path).suffix[1:], dpi=110)
    return write_bytes(path, content.getvalue())


def refuse_unwritable(path: str | Path | None) -> None:
    """Refuse a path that `write_text` could not write to, unless None; call it before long work.

    Raises:
        InputError: If the path is a folder, or its folder is a file, read-only, or not creatable.
    """
    if path is None:
        return
    target = possible_path(path)
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; name a file in it")
    if not target.exists():
        refuse_ground(target)
    elif not os.access(target, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write there")


def refuse_ground(target: Path) -> None:
    """Refuse a path whose nearest existing parent is a file or is not writable."""
    ground = next(p for p in target.resolve().parents if p.exists())
    if not ground.is_dir():
        raise InputError(f"cannot write {target}: {ground} is a file, not a folder")
    if not os.access(ground, os.W_OK):
        raise InputError(f"cannot write {target}: no permission to write in {ground}")


def expect_path(path: object) -> Path:
    """Return the path of a file or folder that a caller names.

    Raises:
        InputError: If the argument is not a path.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{shorten(repr(path))} is not the name of a file or folder")
    return Path(path)


def possible_path(path: str | Path) -> Path:
    """Return the path if the file system allows its name.

    Raises:
        InputError: If the name is too long, contains a zero byte, or is a link to itself.
    """
    target = expect_path(path)
    try:
        os.stat(target)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # `refuse_unwritable` reports these with better words
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"cannot write {shorten(str(path))}: {reason}; use another name") from None
    return target


def make_folder(path: str | Path) -> Path:
    """Return a folder to which several runs add files; create it if it is missing.

    Raises:
        InputError: If the path is a file or the folder cannot be created.
    """
    place = expect_path(path)
    if place.exists() and not place.is_dir():
        raise InputError(f"{place} is a file; name a folder")
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {place}: {error.strerror or error}") from None
    return place


STAGING = ".planner."
"""Prefix of temporary names; the target's own name is left out because it may be too long."""


def creation_mask() -> int:
    """Return the permissions that new files lack."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


Value = TypeVar("Value")

MB = 1_000_000
TOML_BYTES = 4 * MB
"""Largest TOML file in bytes. A problem has a few kB; a sweep with 50,000 lines of cases, 4 MB."""
JSON_BYTES = 200 * MB
"""Largest JSON file in bytes. A plan has less than 1 MB; motions of thousands of machines have
some tens of MB."""
SAMPLES_BYTES = 2000 * MB
"""Largest file of samples in bytes: two million rows, the most of an export, of fifty columns."""

MOST_LEVELS = 50
"""Most levels of nested tables and lists; a problem has six, nested plans about twice as many."""

MOST_BITS = 1023
"""Most bits of a whole number; a float holds no larger number."""

# tomllib's time grows with the square of the parts of a key: a thousand parts take a second.
_DEEP_KEY = re.compile(r"(?<![\w.\"'-])(?:[\w\"'-]++[ \t]*\.[ \t]*){100}")


def _open_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # Windows lacks this flag


def read_bytes(path: str | Path, largest: int) -> bytes:
    """Read the content of a regular file.

    Raises:
        InputError: If the path cannot be read, is no regular file, or exceeds `largest` bytes.
    """
    try:
        # Without O_NONBLOCK, opening a pipe would wait for its writer; files read as usual.
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
            f"cannot read {path}: it has {size / MB:.4g} MB, allowed {largest / MB:g} MB"
        )
    return content


def read_text(path: str | Path, largest: int, what: str) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Args:
        path: The file.
        largest: Most bytes that are read.
        what: What the file should be, for the message ("a problem file is TOML").

    Raises:
        InputError: As for `read_bytes`, or if the file is not UTF-8.
    """
    try:
        return read_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file; {what} in UTF-8") from None


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """Read a TOML file; `what` names its kind in messages ("a problem file").

    Raises:
        InputError: If the file cannot be read or is not TOML.
    """
    text = read_text(path, TOML_BYTES, f"{what} is TOML")
    try:
        return parse_toml(text)
    except ValueError as error:
        if text.lstrip().startswith("{"):
            raise InputError(f"{path} is JSON, such as a plan; {what} is TOML") from None
        raise InputError(f"{path} is not valid TOML: {error}") from None


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text.

    Raises:
        ValueError: If the text cannot be parsed; the message says why.
    """
    if _DEEP_KEY.search(text):
        raise ValueError("a key has more than 100 parts")
    return _parse(tomllib.loads, text)


def toml_value(text: str) -> Any:
    """Parse one TOML value; a plain word may be unquoted.

    Raises:
        ValueError: If the text is neither a value nor a word.
    """
    with suppress(ValueError):
        table = parse_toml(f"value = {text}")
        if table.keys() == {"value"}:
            return table["value"]
    if re.fullmatch(r"[A-Za-z_][\w.+-]*", text):
        return text
    raise ValueError("is not a value")


def read_json(path: str | Path, otherwise: str = "") -> dict[str, Any]:
    """Read the object in a JSON file.

    Args:
        path: The file.
        otherwise: Advice for the error message: how to get such a file.

    Raises:
        InputError: If the file cannot be read, is not JSON, or holds anything but one object.
    """
    text = read_text(path, JSON_BYTES, "it should be JSON")
    try:
        data = parse_json(text)
    except ValueError as error:
        raise InputError(f"{path} is not JSON: {error}{otherwise and '; '}{otherwise}") from None
    if not isinstance(data, dict):
        raise InputError(f"{path} must hold one JSON object{otherwise and '; '}{otherwise}")
    return data


def parse_json(text: str) -> Any:
    """Parse JSON text; a key that appears twice in an object is an error.

    Raises:
        ValueError: If the text cannot be parsed; the message says why.
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
    """Return the data if it has at most `MOST_LEVELS` levels and no number above `MOST_BITS`."""
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
    """Format a value as TOML, so that a user can paste it into a command line."""
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
    """Yield the lines of a table in TOML, one value a line; nested tables follow plain values.

    Args:
        table: The table.
        path: Dotted name of the table, with a final dot; "" for the top level.
    """
    inner = {key: value for key, value in table.items() if _holds_tables(value)}
    yield from (f"{_key(key)} = {toml(table[key])}" for key in table if key not in inner)
    for key, value in inner.items():
        name = f"{path}{_key(key)}"
        head = f"[{name}]" if isinstance(value, Mapping) else f"[[{name}]]"
        for each in [value] if isinstance(value, Mapping) else value:
            yield from ("", head, *toml_lines(each, f"{name}."))


def _holds_tables(value: Any) -> bool:
    """Return whether the value is a table or a list of tables."""
    listed = value if isinstance(value, list) and value else [value]
    return all(isinstance(each, Mapping) for each in listed)
