"""Read tables of numbers that other programs wrote: `read_table`.

Spreadsheets, loggers and NumPy write numbers in many ways. The separator and the decimal mark are
decided from the whole file, never from one cell; an ambiguous file is refused. No library among our
dependencies does this: `csv.Sniffer` guesses from letters, and `float` and NumPy read "1_0" as 10.
"""

from __future__ import annotations

import codecs
import csv
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from planner.errors import InputError, InputWarning
from planner.support.arrays import Array
from planner.support.files import SAMPLES_BYTES, read_bytes
from planner.support.tables import line as one_line

Blanks = Literal["refused", "held", "nan"]
"""Meaning of a blank cell: an error, the value above the cell, or NaN."""

JUDGED_LINES = 1000
"""Number of lines from which the separator is decided; later lines must use the same."""

_END = re.compile(r"\r\n|\r|\n")
_COMMENT = re.compile(r"\s*(?:#+|%+|//)\s*")
_SEPARATOR_LINE = re.compile(r"sep=(.)\s*", re.I)  # a spreadsheet's first line
_QUOTED = re.compile(r"""(?<![^;,\t|\r\n ])(["'])([^"']{0,200})\1(?=[;,\t|\r\n ]|\Z)""")
_BINARY = re.compile("[\x00-\x08\x0e-\x1f]")
_PLAIN = str.maketrans({"\u2212": "-", "\u00a0": " ", "\u2009": " ", "\u202f": " ", "\u2019": "'"})
"""Replacements of typographic minus, spaces and apostrophe by those on a keyboard."""

_NAME_WITH_UNIT = re.compile(r"\S+(?:\s+[\[(][^\])]*[\])])?")  # "u1 [rad/s]" is one name

BLANK = " "
SEPARATORS = (";", "\t", "|")
"""Separators that are never part of a number; the one that most lines contain is chosen."""


def _number(decimal: str, other: str) -> re.Pattern[str]:
    """Return the pattern of numbers with a decimal mark, whose thousands `other` may separate.

    Groups of thousands begin with 1 to 9, so "0,123" is no number with a decimal point.
    """
    groups = rf"[1-9]\d{{0,2}}(?P<group>[{other}' ])\d{{3}}(?:(?P=group)\d{{3}})*"
    return re.compile(
        rf"[+-]?(?:(?:{groups}|\d+)(?:[{decimal}]\d*)?|[{decimal}]\d+)(?:e[+-]?\d+)?",
        re.I | re.ASCII,
    )


_NUMBERS = {".": _number(".", ","), ",": _number(",", ".")}


@dataclass(frozen=True, eq=False)
class NumberTable:
    """The cells of a table of numbers, as text.

    Attributes:
        source: The file.
        names: Names of the columns, from the header; empty without a header.
        units: Units from the line below or above the header; "" without such a line.
        rows: The rows, each with one cell per name.
        lines: Line number of each row in the file, from 1.
        separator: The separator of cells; a blank stands for any number of blanks.
        item: What messages call a row ("line", "message").
    """

    source: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    lines: Sequence[int]
    separator: str
    item: str = "line"

    def numbers(self, blanks: Mapping[int, Blanks]) -> dict[int, Array]:
        """Return some columns as numbers, each (R,), by column index.

        Args:
            blanks: Maps the index of each wanted column to the meaning of a blank cell.

        Raises:
            InputError: If a cell is not a number, or is ambiguous; the message names file, line,
                column and cell.
        """
        cells = {k: [row[k].strip().translate(_PLAIN) for row in self.rows] for k in blanks}
        for place, meaning in blanks.items():
            if meaning == "held":
                cells[place] = _fill_blanks(cells[place])
        decimal = self._decimal_mark(cells, {p for p, each in blanks.items() if each == "nan"})
        dropped = str.maketrans("", "", "' " + ("," if decimal == "." else "."))
        out = {}
        for place, texts in cells.items():
            plain = (text.translate(dropped).replace(",", ".") for text in texts)
            out[place] = np.array([float(text or "nan") for text in plain])
            if np.any(large := np.isinf(out[place])):
                raise InputError(f"{self.cell(int(np.argmax(large)), place)}: too large a number")
        return out

    def line(self, row: int) -> str:
        """Return the location of a row for messages: file and line."""
        return f"{self.source}, {self.item} {self.lines[row]}"

    def cell(self, row: int, place: int) -> str:
        """Return the location and content of a cell for messages: file, line, column and text."""
        text = one_line(self.rows[row][place], 60)
        name = one_line(self.names[place])
        return f"{self.line(row)}: column '{name}' is " + (f"'{text}'" if text else "empty")

    def _decimal_mark(self, cells: Mapping[int, Sequence[str]], may_be_blank: set[int]) -> str:
        """Return the decimal mark with which every cell is a number.

        Raises:
            InputError: If no mark fits, or both marks fit and give different numbers.
        """
        first: dict[str, tuple[int, int]] = {}  # first cell for each set of marks that fit
        for place, texts in cells.items():
            for k, text in enumerate(texts):
                if (text.isdecimal() and text.isascii()) or (not text and place in may_be_blank):
                    continue
                marks = "".join(m for m, number in _NUMBERS.items() if number.fullmatch(text))
                if not marks:
                    why = ", which is not a number" if text else ""
                    raise InputError(f"{self.cell(k, place)}{why}")
                if "." in text or "," in text:
                    first.setdefault(marks, (k, place))
        if "." in first and "," in first:
            point, comma = (self.cell(*first[mark]) for mark in ".,")
            raise InputError(
                f"{point}, with a decimal point, but {comma.removeprefix(self.source)[2:]},"
                " with a decimal comma"
            )
        if "," in first:
            return ","
        if "." in first or ".," not in first:
            return "."
        k, place = first[".,"]
        text = cells[place][k]
        if self.separator == "," and "," not in text:
            return "."  # a file that separates cells by commas uses decimal points
        raise InputError(
            f"{self.cell(k, place)}, which means {text.replace(',', '.')} or"
            f" {re.sub('[.,]', '', text)}, and no other cell shows which of the two; write another"
            " number of decimals, or no thousands separator"
        )


def _fill_blanks(cells: Sequence[str]) -> list[str]:
    """Return cells with each blank replaced by the last cell above; leading blanks stay."""
    out, last = [], ""
    for cell in cells:
        last = cell or last
        out.append(last)
    return out


def read_table(
    path: str | Path, what: str, known: Callable[[str], bool], *, may_be_cut: bool = False
) -> NumberTable:
    """Return the table of numbers in a file of any program.

    Cells are separated by semicolons, tabs, bars, commas or blanks and may be quoted, in the header
    over several lines. Comments begin with #, % or //; the header may be a comment. Lines above the
    header, a line of units below or above it and empty lines are allowed, as are UTF-8, UTF-16 and
    Windows-1252.

    Args:
        path: The file.
        what: What the file should be, for the message ("a log is CSV").
        known: Whether a cell is the name of a column; the line with most such cells is the header.
        may_be_cut: Whether writing may have been interrupted. A last line without a line end is
            then dropped with a warning, since its last number may lack digits.

    Raises:
        InputError: If the file cannot be read or is not text, a quotation mark has no end, or a row
            has another number of cells than the header.
    """
    try:
        return _read_table(path, what, known, may_be_cut)
    except csv.Error as error:
        raise InputError(
            f"{path} has a quoted cell that cannot be read ({error}): does its quotation mark have"
            " an end?"
        ) from None


def _read_table(
    path: str | Path, what: str, known: Callable[[str], bool], may_be_cut: bool
) -> NumberTable:
    given = _decode(read_bytes(path, SAMPLES_BYTES), path, what)
    text = _QUOTED.sub(lambda cell: f'"{_END.sub(" ", cell[2])}"', given)
    text = "\n" * (given.count("\n") - text.count("\n")) + text  # keeps the rows' numbers
    if not text.strip():
        raise InputError(f"{path} is empty; {what}")
    lines = [(k, each) for k, each in enumerate(_END.split(text), start=1) if each.strip()]
    line = _SEPARATOR_LINE.fullmatch(lines[0][1]) if lines else None
    lines = lines[1:] if line else lines
    plain = [each for _, each in lines[:JUDGED_LINES] if not _COMMENT.match(each)]
    separator = line[1] if line else _find_separator(plain)
    first, width = _find_rows([each for _, each in lines], separator, plain)
    above = [_split_head(each, separator, width) for _, each in lines[: first + 1]]
    head = _find_header(above, first, known)
    names = above[head] if head >= 0 else []
    units = above[head + 1] if head + 1 < first else above[head - 1] if head > 0 else []
    units = units if 2 * len(units) > len(names) else []
    units += [""] * (len(names) - len(units))  # columns at the end may have none
    below = [(k, each) for k, each in lines[max(first, head + 1) :] if not _COMMENT.match(each)]
    rows = ((k, _split(each, separator)) for k, each in below)
    cells = [(number, row) for number, row in rows if any(map(str.strip, row))]
    if cells and may_be_cut and text[-1] not in "\r\n":
        number, _ = cells.pop()
        warnings.warn(
            f"{path}, line {number} has no line end: it may be cut off, and is ignored",
            InputWarning,
            stacklevel=4,
        )
    for number, row in cells:
        if names and (len(row) < len(names) or any(map(str.strip, row[len(names) :]))):
            more = separator == "," and len(row) > len(names)
            marks = "; is the decimal mark a comma, too?" if more else ""
            raise InputError(
                f"{path}, line {number}: {len(row)} cells, but the header names {len(names)}"
                f" columns{marks}"
            )
    return NumberTable(
        source=str(path),
        names=tuple(names),
        units=tuple(units[: len(names)]),
        rows=[row for _, row in cells],
        lines=[number for number, _ in cells],
        separator=separator,
    )


def _find_rows(lines: Sequence[str], separator: str, judged: Sequence[str]) -> tuple[int, int]:
    """Return the index of the first row of numbers, and the row's number of cells."""
    counts = [_count_numbers(_split(each, separator)) for each in judged]
    usual = float(np.median([count for count in counts if count] or [1]))
    for k, each in enumerate(lines):
        cells = [] if _COMMENT.match(each) else _split(each, separator)
        if cells and _count_numbers(cells) >= usual / 2:
            return k, len(cells)
    return len(lines), 0


def _find_header(above: Sequence[Sequence[str]], first: int, known: Callable[[str], bool]) -> int:
    """Return the header's index among the lines up to the first row of numbers; −1 without header.

    A header whose names are numbers is taken for the first row.
    """
    most = [sum(map(known, cells)) for cells in above]
    if any(most):
        return int(np.argmax(most))
    return max(range(first), key=lambda k: len(above[k]), default=-1)


def _decode(content: bytes, path: str | Path, what: str) -> str:
    marks = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
    coding = marks.get(content[:2], "utf-8-sig")
    if coding == "utf-8-sig" and b"\0" in content[:2]:
        coding = "utf-16-be" if content[:1] == b"\0" else "utf-16-le"
    for each in (coding, "cp1252"):
        try:
            text = content.decode(each).rstrip("\0")  # a power cut leaves a file filled up with 0
        except UnicodeDecodeError:
            continue
        if not _BINARY.search(text):
            return text
    raise InputError(f"{path} is not a text file; {what}, best in UTF-8")


def _find_separator(lines: Sequence[str]) -> str:
    with_digits = [each for each in lines if any(map(str.isdigit, each))]
    for separator in SEPARATORS:
        if 2 * sum(separator in each for each in with_digits) > len(with_digits):
            return separator
    return max((",", BLANK), key=lambda s: sum(_count_numbers(_split(x, s)) for x in with_digits))


def _split(text: str, separator: str) -> list[str]:
    if separator == BLANK:
        return text.split()
    if '"' not in text:
        return text.split(separator)
    return next(csv.reader([text], delimiter=separator, skipinitialspace=True))


def _split_head(text: str, separator: str, width: int) -> list[str]:
    """Return the cells of a line above the rows.

    The separator is that of the rows if it gives `width` cells, as a row has; else another that
    does: NumPy separates numbers by blanks, but leaves the header as the user wrote it.
    """
    text = _COMMENT.sub("", text, count=1) if _COMMENT.match(text) else text
    ways = [_split(text, each) for each in (separator, *SEPARATORS, ",")]
    ways.append(_NAME_WITH_UNIT.findall(text))
    cells = next((cells for cells in ways if len(cells) == width), ways[0])
    cells = [cell.strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _count_numbers(cells: Sequence[str]) -> int:
    """Return the number of cells that look like numbers; 0 for a single cell, a line of text."""
    if len(cells) < 2:
        return 0
    plain = [cell.strip().translate(_PLAIN) for cell in cells]
    return sum(any(number.fullmatch(cell) for number in _NUMBERS.values()) for cell in plain)
