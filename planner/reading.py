"""Reading files that others wrote: regular files of a sane size, and text that can be parsed.

Everything that reads a file a user names goes through here. What cannot be read is an `InputError`
that names the file, at once: not a wait for a pipe, and not a device read until the memory is full.
"""

from __future__ import annotations

import json
import os
import re
import stat
import tomllib
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from planner.errors import InputError

Value = TypeVar("Value")

MB = 1_000_000
TOML_BYTES = 4 * MB
"""A problem is a few kB; a sweep of 50,000 cases, each in a line of its own, is 4 MB."""
JSON_BYTES = 200 * MB
"""A plan is below 1 MB; the motions of thousands of machines are some tens."""
SAMPLES_BYTES = 2000 * MB
"""Two million rows, the most that is exported, with fifty columns."""

DEEPEST = 50
"""Levels of tables and lists; a problem has six, a plan of a plan of a plan twice as many."""

LONGEST = 1023
"""Bits of a whole number; a float holds no larger one."""

# tomllib takes time with the square of a key's parts: a thousand take a second.
_DEEP_KEY = re.compile(r"(?<![\w.\"'-])(?:[\w\"'-]++[ \t]*\.[ \t]*){100}")


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))  # Windows has neither


def read_bytes(path: str | Path, largest: int) -> bytes:
    """The content of a regular file.

    Raises:
        InputError: If it cannot be read, is a folder, pipe or device, or holds more bytes.
    """
    try:
        # A pipe without a writer is opened at once, to be refused; a file is read as ever.
        with open(path, "rb", opener=_open_at_once) as stream:
            found = os.fstat(stream.fileno())
            regular = stat.S_ISREG(found.st_mode)
            unread = not regular or found.st_size > largest
            content = b"" if unread else stream.read(largest + 1)
    except ValueError as error:  # a zero byte in the name
        raise InputError(f"cannot read {path}: {error}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if not regular:
        raise InputError(f"cannot read {path}: it is a pipe or a device, not a file")
    size = max(found.st_size, len(content))
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
    try:
        return _shallow(tomllib.loads(text))
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise _shorter(error) from None


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
    try:
        return _shallow(json.loads(text, object_pairs_hook=_once))
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None
    except json.JSONDecodeError:
        raise
    except ValueError as error:
        raise _shorter(error) from None


def _shallow(data: Value) -> Value:
    """The data, if those who walk through it level by level can."""
    depth = 0
    level: list[Any] = [data] if isinstance(data, dict | list) else []
    while level:
        depth += 1
        if depth > DEEPEST:
            raise RecursionError
        inner = (v.values() if isinstance(v, dict) else v for v in level)
        level = []
        for v in chain.from_iterable(inner):
            if isinstance(v, dict | list):
                level.append(v)
            elif isinstance(v, int) and v.bit_length() > LONGEST:
                raise ValueError("a whole number has hundreds of digits")
    return data


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {twice!r:.60} is there twice in one object")
    return out


def _shorter(error: ValueError) -> ValueError:
    """Python's advice on numbers of thousands of digits is not for users."""
    if "integer string conversion" in str(error):
        return ValueError("a whole number has thousands of digits")
    return error


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
