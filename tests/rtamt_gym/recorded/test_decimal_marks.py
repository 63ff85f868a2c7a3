"""Decimal marks, words for numbers, and layouts of text: one reading, or none."""

import math
from pathlib import Path

import pytest

import rtamt
from rtamt_gym.recorded import csv_reader
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.trace import read_trace

COMMA = "numbers are read with a decimal comma"
TWO = "expected numbers that can be read in one way"
MIXED = "expected one decimal mark in the file"


def reading(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    text: str | bytes,
    columns: Columns | None = None,
    variable: str = "x",
) -> tuple[list[float], list[str]] | str:
    """Return values and notes, or the error, which rows and pyarrow give alike."""
    path = folder / "t.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    results: list[tuple[list[float], list[str]] | str] = []
    for long in (1 << 40, 0):
        monkeypatch.setattr(csv_reader, "_LONG", long)
        try:
            with open_recording(str(path), columns) as recording:
                trace = read_trace(recording, [variable], columns)
            values = [None if math.isnan(v) else v for v in trace.columns[variable].tolist()]
            period = None if trace.times is None else trace.times.since.tolist()
            results.append((values, [*trace.notes], period, trace.where(0)))
        except rtamt.InputError as error:
            results.append(str(error).removeprefix(str(path)))
    assert results[0] == results[1], text
    return results[0] if isinstance(results[0], str) else results[0][:2]


def groups(cell: str, value: str) -> str:
    return f"marks between groups of three digits are left out: '{cell}' is {value}"


# (cells of x, cells of a column that is not read, option) -> values and notes, or an error.
CONTRACT = {
    # A cell without a mark, or with one reading.
    ("1 2", "", ""): ([1, 2], []),
    ("1e3 2", "", ""): ([1000, 2], []),
    ("0.125 3", "", ""): ([0.125, 3], []),
    ("3,5 4", "", ""): ([3.5, 4], [COMMA]),
    ("-1,5 2,50", "", ""): ([-1.5, 2.5], [COMMA]),
    ("1,5e3 2", "", ""): ([1500, 2], [COMMA]),
    ("0,125 2", "", ""): ([0.125, 2], [COMMA]),
    (",5 2", "", ""): ([0.5, 2], [COMMA]),
    (".5 5. 2", "", ""): ([0.5, 5, 2], []),
    ("1.000.000 2", "", ""): ([1e6, 2], [COMMA, groups("1.000.000", "1000000")]),
    ("1,000,000 2", "", ""): ([1e6, 2], [groups("1,000,000", "1000000")]),
    ("13.500,0 2", "", ""): ([13500, 2], [COMMA, groups("13.500,0", "13500")]),
    ("1.013,25 1.014", "", ""): ([1013.25, 1014], [COMMA, groups("1.013,25", "1013.25")]),
    ("1,013.25 1,014", "", ""): ([1013.25, 1014], [groups("1,013.25", "1013.25")]),
    ("1_234,5 2", "", ""): ([1234.5, 2], [COMMA, groups("1 234,5", "1234.5")]),
    ("1'234.5 2", "", ""): ([1234.5, 2], [groups("1'234.5", "1234.5")]),
    ("1_234 2", "", ""): ([1234, 2], [groups("1 234", "1234")]),
    # A point without evidence is a decimal point, unless the column looks like thousands.
    ("1.013 1.014", "", ""): ([1.013, 1.014], []),
    ("+1.250 2.5", "", ""): ([1.25, 2.5], []),
    ("+1.250 1.375", "", ""): ([1.25, 1.375], []),
    ("1.125 2", "", ""): ([1.125, 2], []),
    ("1.250 2.000 12.500", "", ""): TWO,
    ("500 1.125", "", ""): TWO,
    ("2 1.250", "", ""): TWO,
    ("1500 12.500", "", ""): TWO,
    ("12345 12.500", "", ""): ([12345, 12.5], []),
    ("2e3 12.500", "", ""): ([2000, 12.5], []),
    # A comma without evidence is refused.
    ("1,250", "", ""): TWO,
    ("2,900 1", "", ""): TWO,
    ("1,000 2,000 3,000", "", ""): TWO,
    ("1,013 1.014", "", ""): TWO,
    # Evidence in other columns decides.
    ("1.000 12.000 13.500", "3,5 3,6 3,7", ""): (
        [1000, 12000, 13500],
        [COMMA, groups("1.000", "1000")],
    ),
    ("1.000 12.000", "1 0.5", ""): ([1, 12], []),
    ("1,000 12,000", "1 0.5", ""): ([1000, 12000], [groups("1,000", "1000")]),
    ("1,000 2,000", "1.000.000 2", ""): ([1, 2], [COMMA]),
    ("1.013 1.014", "1,000 2,000", ""): TWO,
    ("1.013 1.014", "1.000.000 2", ""): ([1013, 1014], [COMMA, groups("1.013", "1013")]),
    # Columns that are not read, and that are text, decide nothing but raise doubts.
    ("0.5 1", "3,5 4", ""): ([0.5, 1], []),
    ("1.013 0.5", "3,5 4", ""): ([1.013, 0.5], []),
    ("1.013 1.014", "0.5 3,5", ""): MIXED,
    ("1.013 1.014", "1,2 1,2,3", ""): TWO,
    ("1 2", "1,250 3,5", ""): ([1, 2], []),
    ("1.013 1.014", "10.0.0.1 192.168.178.100", ""): ([1.013, 1.014], []),
    ("1.013 1.014", "a,b c.d", ""): ([1.013, 1.014], []),
    # The mark changes.
    ("0.5 3,5", "", ""): MIXED,
    ("1.000.000 3.5", "", ""): MIXED,
    # An option is obeyed, with a note where all numbers may be groups.
    ("1,000 2,000 3,000", "", "."): ([1000, 2000, 3000], [groups("1,000", "1000")]),
    ("1,000 2,000 3,000", "", ","): (
        [1, 2, 3],
        [
            "--decimal , reads '1,000' as 1: every number of 'x' has three digits after the mark, "
            "as numbers in groups of three digits have"
        ],
    ),
    ("1.250 2.000 12.500", "", "."): (
        [1.25, 2, 12.5],
        [
            "--decimal . reads '12.500' as 12.5: every number of 'x' has three digits after the "
            "mark, as numbers in groups of three digits have"
        ],
    ),
    ("1.250 2.000 12.500", "", ","): ([1250, 2000, 12500], [groups("1.250", "1250")]),
    ("0.125 3", "", "."): ([0.125, 3], []),
    ("1.250 12.500 3", "", "."): ([1.25, 12.5, 3], []),
    ("3,5 4", "", ","): ([3.5, 4], []),
    ("1,013 1.014", "", "."): ([1013, 1.014], [groups("1,013", "1013")]),
    ("0.125 3", "", ","): "expected a number, got '0.125'; leave out --decimal",
    ("3,5 4", "", "."): "expected a number, got '3,5'; leave out --decimal",
    # Not numbers.
    ("1.23,4 2", "", ""): "expected a number, got '1.23,4'",
    ("0.123.456 2", "", ""): "expected a number, got '0.123.456'",
    ("1,23,456 2", "", ""): "expected a number, got '1,23,456'",
    ("0x10 2", "", ""): "expected a number, got '0x10'",
    ("1_23 2", "", ""): "expected a number, got '1 23'",
}


@pytest.mark.parametrize("case", CONTRACT, ids=" | ".join)
@pytest.mark.parametrize("separator", [";", ",", "\t"])
def test_contract_of_decimal_marks(
    case: tuple[str, str, str], separator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells, others, option = case
    x = [cell.replace("_", " ") for cell in cells.split()]
    other = others.split() or [""] * len(x)
    rows = [*zip(x, other, strict=False)]
    if len(other) < len(x):
        rows += [(cell, "") for cell in x[len(other) :]]
    quote = '"' if separator == "," else ""
    lines = [
        f"x{separator}other",
        *(f"{quote}{a}{quote}{separator}{quote}{b}{quote}" for a, b in rows),
    ]
    result = reading(tmp_path, monkeypatch, "\n".join(lines), Columns(decimal=option or None))
    expected = CONTRACT[case]
    if isinstance(expected, str):
        assert isinstance(result, str)
        assert expected in result
    else:
        assert result == expected
