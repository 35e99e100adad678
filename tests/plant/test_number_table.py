"""Tables of numbers in CSV files: which lines are the header and the rows, and how they are counted."""

from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.number_table import NumberTable, read_number_table
from flexbeams.plant.text import is_decimal


def read(path: Path, text: str) -> NumberTable:
    path.write_text(text, encoding="utf-8")
    return read_number_table(path)


@pytest.mark.parametrize(
    ("text", "header", "header_row", "rows"),
    [
        ("time,u\n0,1\n2,3\n", ["time", "u"], 1, [2, 3]),
        ('\ufeff"time" ,"der(x,1) ""a"""\r\n0,1\r\n\r\n2,3\r\n', ["time", 'der(x,1) "a"'], 1, [2, 4]),
        ("# a rig\n\ntime,u\n0,1\n2,3", ["time", "u"], 3, [4, 5]),
        ("# a rig\n# time, u\n0,1\n2,3\n", ["time", "u"], 2, [3, 4]),
        ("#time,u\n0,1\n2,3\n", ["time", "u"], 1, [2, 3]),
        ('time,u\n"0", 1\n+2.,.3e1\n', ["time", "u"], 1, [2, 3]),
    ],
)
def test_headers_and_rows(text: str, header: list[str], header_row: int, rows: list[int], tmp_path: Path) -> None:
    table = read(tmp_path / "a.csv", text)
    assert (table.header, table.header_row, table.rows) == (header, header_row, rows)
    np.testing.assert_array_equal(table.values, [[0, 1], [2, 3]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must have a header row"),
        ("\n# nothing\n", "must have at least one row below the header"),
        ("a;b\n1;2\n", "row 1 has columns separated by semicolons"),
        ("a,b\n1,2\n\n3\n", "row 4 must have 2 values as the header, got 1"),
        ("a,b\n1,2\n3,inf\n", "row 3, column 'b' must be a finite number, got 'inf'"),
        ("a,b\n1,1_000\n", "row 2, column 'b' must be a finite number, got '1_000'"),
        ("a,b\n1,0x10\n", "row 2, column 'b' must be a finite number, got '0x10'"),
        ('a,b\n1,"2,5"\n', "row 2, column 'b' has a decimal comma"),
    ],
)
def test_faults_are_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path / "a.csv", text)
    assert str(error.value).startswith(f"{tmp_path}/a.csv: {message}")
    assert read(tmp_path / "a.csv", "a,b\n1,2\n").values.tolist() == [[1.0, 2.0]]


def test_decimal_numbers() -> None:
    assert all(map(is_decimal, ("1", "-1.5e-3", ".5", "5.", "+0")))
    assert not any(map(is_decimal, ("", "1_000", "\u0663", "nan", "inf", "0x1", "1,5", " 1")))
