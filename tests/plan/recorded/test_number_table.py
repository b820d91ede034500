"""Tables of numbers as other programs write them: one table in many hands, and what is refused."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from planner import InputError, InputWarning
from planner.plan.recorded.number_table import Blanks, read_table

NAMES = ["t_s", "count", "angle [deg]"]
TABLE = np.column_stack(
    [0.25 * np.arange(1, 9), 990.0 + 5 * np.arange(8), 1234.5 * (-1.0) ** np.arange(8)]
)


def read(path: Path, blanks: Blanks = "refused") -> np.ndarray:
    table = read_table(path, "a table is CSV", lambda name: name.strip() in NAMES)
    assert list(table.names) == NAMES
    return np.column_stack([*table.numbers(dict.fromkeys(range(3), blanks)).values()])


def grouped(value: float, group: str, decimal: str) -> str:
    text = f"{value:,.2f}" if value != round(value) else f"{value:,.0f}"
    return text.replace(",", "G").replace(".", decimal).replace("G", group)


def text_of(separator: str, group: str, decimal: str, quote: str = "") -> str:
    rows = [[grouped(x, group, decimal) for x in row] for row in TABLE]
    return "".join(
        separator.join(f"{quote}{cell}{quote}" for cell in row) + "\n" for row in [NAMES, *rows]
    )


POINTS = text_of(",", "", ".")


@pytest.mark.parametrize(
    "text",
    [
        POINTS,
        text_of(";", "", ","),
        text_of(";", ".", ","),
        text_of(";", "\u202f", ","),
        text_of(";", "'", "."),
        text_of("; ", "", "."),
        text_of("\t", "", "."),
        text_of("\t", "", ","),
        text_of("\t", " ", ","),
        text_of("|", ",", "."),
        text_of(",", ",", ".", '"'),
        text_of(",", "", ",", '"'),
        text_of(",", ".", ",", '"'),
        text_of(",", "", ",", "'"),
        text_of(",", "", ".").replace("angle [deg]", "'angle\r\n[deg]'"),
        text_of("   ", "", "."),
        text_of(" ", "", ","),
        "sep=;\n" + text_of(";", "", ","),
        "# " + POINTS,
        "% made by 7 hands, 3 of them left\n\n% " + POINTS,
        "// " + text_of(" ", "", "."),
        "Bench, 3\nDate: 1.2.2026, 12:30\n\n" + POINTS,
        POINTS.replace("deg]\n", "deg]\ns,,deg\n"),
        POINTS + "\0" * 512,
        POINTS.replace("\n0.5", "\n# a pause\n\n,,\n0.5"),
        POINTS.replace("\n", "\r\n"),
        POINTS.replace("\n", "\r"),
        POINTS.replace("\n", ",\n"),
        POINTS.replace("-", "\u2212"),
        POINTS.replace("1234.50", "1.2345E+03"),
    ],
    ids=range(30),
)
def test_one_table_in_many_hands(tmp_path: Path, text: str) -> None:
    for coding in ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"):
        (tmp_path / "a.csv").write_bytes(text.encode(coding))
        np.testing.assert_array_equal(read(tmp_path / "a.csv"), TABLE)


def test_numpy_separates_numbers_and_names_otherwise(tmp_path: Path) -> None:
    for separator in (" ", ";", "\t"):
        stream = io.StringIO()
        np.savetxt(stream, TABLE, delimiter=separator, header=",".join(NAMES))
        (tmp_path / "a.csv").write_text(stream.getvalue(), encoding="utf-8")
        np.testing.assert_array_equal(read(tmp_path / "a.csv"), TABLE)


def test_windows_own_encoding_is_read_and_no_picture(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("t;θ°\n1;2\n".replace("θ", "x").encode("cp1252"))
    assert read_table(tmp_path / "a.csv", "", lambda name: name == "t").names == ("t", "x°")
    (tmp_path / "a.csv").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0")
    with pytest.raises(InputError, match=r"a\.csv is not a text file; a log is CSV"):
        read_table(tmp_path / "a.csv", "a log is CSV", lambda name: False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (POINTS.replace("995", "1_0"), r"line 3: column 'count' is '1_0', which is not a number"),
        (POINTS.replace("995", "nan"), r"line 3: column 'count' is 'nan', which is not a number"),
        (POINTS.replace("995", "1e999"), r"line 3: .*'1e999': too large a number"),
        (POINTS.replace("995", "12,34,567"), r"line 3: 5 cells, but .* names 3 columns"),
        (POINTS.replace("995", ""), r"line 3: column 'count' is empty"),
        (POINTS.replace("0.50,995", "0.50"), r"line 3: 2 cells, but the header names 3 columns"),
        (text_of(",", "", ","), r"line 2: 5 cells, .*; is the decimal mark a comma, too\?"),
        (
            text_of(";", "", ",").replace("0,5", "0.5"),
            r"line 3: column 't_s' is '0\.50', with a decimal point, but line 2: .*'0,25', with a",
        ),
        (
            "t_s;count;angle [deg]\n1;2;3\n2;3;1,234\n3;4;5,678\n",
            r"line 3: column 'angle \[deg\]' is '1,234', which means 1\.234 or 1234, and no other",
        ),
        (
            "t_s;count;angle [deg]\n1;2;3\n2;3;1.234\n3;4;5.678\n",
            r"line 3: .* is '1\.234', which means 1\.234 or 1234",
        ),
        ('t_s,count,angle [deg]\n1,2,3\n2,3,"1,234"\n', r".*'1,234', which means 1\.234 or 1234"),
    ],
)
def test_what_is_left_open_is_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.csv, " + words):
        read(tmp_path / "a.csv")


def test_the_whole_file_decides_what_a_mark_means(tmp_path: Path) -> None:
    """The same cells, and a last row that tells."""
    for last, third in (("0,5", 1.234), ("1,234,567", 1234), ("7.5", 1234), ("0,123", 1.234)):
        (tmp_path / "a.csv").write_text(f"t_s;count;angle [deg]\n1;2;1,234\n2;3;{last}\n")
        assert read(tmp_path / "a.csv")[0, 2] == third


def test_blanks_are_held_or_are_no_numbers(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t_s;count;angle [deg]\n1;2;7\n;3;\n3;;\n", encoding="utf-8")
    np.testing.assert_array_equal(
        read(tmp_path / "a.csv", "held"), [[1, 2, 7], [1, 3, 7], [3, 3, 7]]
    )
    assert np.isnan(read(tmp_path / "a.csv", "nan")).sum() == 4


def test_a_line_that_does_not_end_may_be_left_out(tmp_path: Path) -> None:
    for end in ("3,4,1", "3,4,", "3,", "3"):
        (tmp_path / "a.csv").write_text("t_s,count,angle\n1,2,7\n2,3,7\n" + end, encoding="utf-8")
        with pytest.warns(InputWarning, match=r"line 4 "):
            table = read_table(tmp_path / "a.csv", "", NAMES.__contains__, may_be_cut=True)
        assert len(table.rows) == 2


def test_columns_at_the_end_may_have_no_unit(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;angle;note\ns;deg;\n1;2;3\n2;3;4\n", encoding="utf-8")
    table = read_table(tmp_path / "a.csv", "", ["t", "angle", "note"].__contains__)
    assert table.units == ("s", "deg", "")
