"""Decimal marks, words for numbers, and layouts of text: one reading, or none."""

import json
import math
import random
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

import rtamt
from rtamt_gym.recorded import csv_reader
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.recording import Wanted
from rtamt_gym.recorded.trace_files import read_trace

COMMA = "numbers are read with a decimal comma"
TWO = "expected numbers that can be read in one way"
MIXED = "expected one decimal mark in the file"


def reading(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    text: str | bytes,
    columns: Columns | None = None,
    variable: str = "x",
) -> Any:  # noqa: ANN401 - a pair or a text
    """Return values and notes, or the error, which rows and pyarrow share."""
    path = folder / "t.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    results: list[Any] = []
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


def thousands(option: str, cell: str, value: str) -> str:
    return (
        f"--decimal {option} reads '{cell}' as {value}: every number of 'x' has three digits after "
        "the mark, as numbers in groups of three digits have"
    )


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
    # An option counts, with a note if all numbers may be groups.
    ("1,000 2,000 3,000", "", "."): ([1000, 2000, 3000], [groups("1,000", "1000")]),
    ("1,000 2,000 3,000", "", ","): (
        [1, 2, 3],
        [thousands(",", "1,000", "1")],
    ),
    ("1.250 2.000 12.500", "", "."): (
        [1.25, 2, 12.5],
        [thousands(".", "12.500", "12.5")],
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


@pytest.mark.parametrize(
    ("separator", "time", "expected"),
    [
        (";", "0,5 1,0", ([1000, 12000], [COMMA, groups("1.000", "1000")])),
        (";", "0.5 1.0", ([1, 12], [])),
        ("\t", "2026-01-31T12:00:00 2026-01-31T12:00:01", TWO),
    ],
)
def test_times_are_evidence(
    separator: str,
    time: str,
    expected: object,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = zip(time.split(), ["1.000", "12.000"], strict=True)
    text = "\n".join([f"time{separator}x", *(separator.join(row) for row in rows)])
    result = reading(tmp_path, monkeypatch, text)
    assert expected in result if isinstance(expected, str) else result == expected


def test_evidence_far_below_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_reader, "_BLOCK", 50)
    rows = ["12.500;1"] * 300
    values, notes = reading(tmp_path, monkeypatch, "\n".join(["x;y", *rows, "1.000;3,5"]))
    assert (values[0], values[-1], notes[0]) == (12500, 1000, COMMA)
    values, notes = reading(tmp_path, monkeypatch, "\n".join(["x;y", *rows, "1.000;3.5"]))
    assert (values[0], values[-1], notes) == (12.5, 1, [])
    assert reading(tmp_path, monkeypatch, "\n".join(["x;y", *rows, "3,5;1", "0.25;1"])) == (
        ": expected one decimal mark in the file, got '3,5' with a decimal comma (line 302, column "
        "'x') and '0.25' with a decimal point (line 303, column 'x')"
    )
    assert reading(tmp_path, monkeypatch, "\n".join(["x;y", *rows])) == (
        ", line 2, column 'x': expected numbers that can be read in one way, got '12.500'; give "
        "--decimal . to read it as 12.5, or --decimal , to read it as 12500"
    )
    assert "--decimal . or --decimal , states" in reading(
        tmp_path, monkeypatch, "\n".join(["x;y;z", *(f"{row};1" for row in rows), "1;3,5;0.5"])
    )


def test_rows_and_pyarrow_agree_on_random_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = [
        "1",
        "0",
        "500",
        "12345",
        "15e-4",
        "1.250",
        "12.500",
        "0.125",
        "1.000.000",
        "1,250",
        "12,500",
        "3,5",
        "1.013,5",
        "1,013.5",
        "-1.250",
        " 2 ",
        "True",
        "",
        "N/A",
        "-",
        "inf",
        "1 234.5",
        "ERR",
        "10.0.0.1",
        "1.2.3",
        "1,2,3",
        "5.",
        ",5",
        "-0",
        "0x10",
        "1.#QNAN",
        "007",
    ]
    choice = random.Random(1)
    accepted = 0
    for _ in range(150):
        pool = choice.sample(cells, 3)
        columns = {name: choice.choices(pool[: choice.choice([1, 3])], k=4) for name in "xyz"}
        columns["time"] = choice.choice([["0", "1", "2", "3"], ["0,5", "1,0", "1,5", "2,0"]])
        rows = [";".join(row) for row in zip(*columns.values(), strict=True)]
        options = Columns(
            decimal=choice.choice([None, None, ".", ","]),
            missing=choice.choice(["raise", "hold", "drop"]),
            where=choice.choice([{}, {"z": columns["z"][0].strip()}]),
        )
        result = reading(tmp_path, monkeypatch, "\n".join([";".join(columns), *rows]), options)
        accepted += not isinstance(result, str)
    assert 25 < accepted < 125


# Words for numbers, encodings and layouts. -------------------------------------------------------


def test_truth_values_are_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "time,x\n0,True\n1,false\n2,TRUE\n3,3\n"
    assert reading(tmp_path, monkeypatch, text) == ([1, 0, 1, 3], [])


@pytest.mark.parametrize(
    "word", ["N/A", "null", "NaN", " ", "nan", "NA", "#N/A", "None", "<NA>", "-", "-nan", "n/a"]
)
def test_words_for_nothing_are_empty_cells(
    word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = f"time,x\n0,1.5\n1,{word}\n2,3\n"
    assert reading(tmp_path, monkeypatch, text) == (
        f", line 3, column 'x': expected a number, got {word.lstrip()!r}; give "
        "--missing unknown, or --missing hold if the value before holds"
    )
    assert reading(tmp_path, monkeypatch, text, Columns(missing="hold")) == (
        [1.5, 1.5, 3],
        ["empty cells hold the value before (x: 1)"],
    )


def test_encodings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "time,x °C,name\n0,3,Jürgen\n1,4,\n"
    columns = Columns({"x": "x °C"})
    latin = "the text is not UTF-8 and is read as Latin-1"
    for encoding, notes in {"utf-8": [], "utf-8-sig": [], "utf-16": [], "latin-1": [latin]}.items():
        result = reading(tmp_path, monkeypatch, text.encode(encoding), columns)
        assert result == ([3, 4], notes)
    assert reading(tmp_path, monkeypatch, b"\x00\x81\xff\nPK\n") == (
        ": expected text in UTF-8, UTF-16 or Latin-1"
    )


def test_both_splitters_select_the_same_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quoted = 'time, x, name\n0, 1, "a"\n1, 5, "b"\n2, 3, "a"\n'
    twice = "time,x,y,y\n0,1,3,a\n1,5,3,b\n2,3,3,a\n"
    for text, where in [(quoted, {"name": "a"}), (twice, {"y": "a"})]:
        for encoding in ("utf-8", "utf-16"):
            data = text.encode(encoding)
            values, _ = reading(tmp_path, monkeypatch, data, Columns(where=where))
            assert values == [1, 3]
            error = reading(tmp_path, monkeypatch, data, Columns(where=dict.fromkeys(where, "c")))
            assert "its values are a, b" in error
    assert "no column 'z', which --where names" in reading(
        tmp_path, monkeypatch, quoted, Columns(where={"z": "a"})
    )


def test_unread_columns_are_evidence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = ["12.500;2024-05-01T00:00:00.5;1"] * 300
    text = "\n".join(["x;time;y", *rows, "1.000;2024-05-01T00:00:01.5;3,5"])
    values, notes = reading(tmp_path, monkeypatch, text, Columns(same_time="first"))
    assert (values[0], values[-1], notes[0]) == (12500, 1000, COMMA)


def test_both_splitters_return_the_same_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "t.csv"
    for text, encoding in [
        ('time, name\n0, "a"\n1, "b"\n', "utf-8"),
        ("time,name\n0,a\n1,b", "utf-16"),
    ]:
        path.write_bytes(text.encode(encoding))
        for long in (1 << 40, 0):
            monkeypatch.setattr(csv_reader, "_LONG", long)
            with open_recording(str(path)) as recording:
                cells = recording.read(Wanted((), cells=["name"])).cells
            assert cells["name"].tolist() == ["a", "b"]


def test_rows_far_below_are_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_reader, "_BLOCK", 50)

    def result(*last: str, columns: Columns | None = None) -> Any:  # noqa: ANN401 - as `reading`
        lines = ["x;y;", *["12345;a;"] * 300, *last]
        return reading(tmp_path, monkeypatch, "\n".join(lines), columns)

    values, notes = result("12.500;a;")
    assert (values[0], values[-1], notes) == (12345, 12.5, [])
    assert result("1;a;7") == ", line 302: expected 2 values (x, y), got 3"
    assert result("0.5;b;", "1;b;", "bad;b;").startswith(", line 304, column 'x': expected a numb")
    where = Columns(where={"y": "b"})
    assert result("0.5;b;", "1;a;", "bad;b;", columns=where).startswith(", line 304, column 'x'")


SKIPPED = "lines 1 to 2 are skipped: the names of the columns are in line 3"
UNITS = "line 2 is a row of units: s, m"

LAYOUTS = {
    "time x\n0 1\n1  2\n": [],
    "  time   x  \n  0   1 \n 1   -2.5  \n".replace("-2.5", "2.0"): [],
    "time,x,\n0,1,\n1,2,\n": [],
    "time,x\n0,1,\n1,2,\n": [],
    "time;x;;;\n0;1;;;\n1;2;;;\n": [],
    "time,x,\n0,1\n1,2\n": [],
    "time,x,\n0,1,\n1,2,without a name\n": [],
    "# a\n# b, c\ntime,x\n0,1\n1,2\n": [SKIPPED],
    "% a\n\ntime,x\n0,1\n1,2\n": [SKIPPED],
    "// a\n// b\ntime x\n0 1\n1 2\n": [SKIPPED],
    "# time x\n0 1\n1 2\n": [],
    "# time,x\n0,1\n1,2\n": [],
    "# run 4\n# made today\n# time x\n0 1\n1 2\n": [SKIPPED],
    "Version: 4, Road: a.xodr, Model: b\nMade by a tool\ntime, x\n0, 1\n1, 2\n": [SKIPPED],
    "Operator: Bob\nDate: 2026-01-31\ntime;x\n0;1\n1;2\n": [SKIPPED],
    'Operator: "Bob\nStart: 12:00\ntime,x\n0,1\n1,2\n': [SKIPPED],
    "time,x\ns,m\n0,1\n1,2\n": [UNITS],
    "time;x\n[s];[m]\n0;1\n1;2\n": [UNITS],
    "time\tx\n s \t m \n0\t1\n1\t2\n": [UNITS],
    "time  x\ns  m\n0  1\n1  2\n": [UNITS],
}


def test_short_row_of_units_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    error = reading(tmp_path, monkeypatch, "time,x,y\ns,m\n0,1,2\n1,2,3\n")
    assert error == ", line 2: expected 3 values (time, x, y), got 2"


@pytest.mark.parametrize("text", LAYOUTS)
def test_layouts(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert reading(tmp_path, monkeypatch, text) == ([1, 2], LAYOUTS[text])


def test_units_of_times_below_the_names_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "t.csv"
    for names, unit, option, last in [
        ("time,x", "ms,V", None, 0.5),
        ("time,x", "s,V", None, 500),
        ("Time [ms],x", "ms,V", None, 0.5),
        ("time,x", "ticks,V", "us", 0.0005),
        ("Time [ms],x", "s,V", "s", 500),
    ]:
        path.write_text(f"{names}\n{unit}\n0,1\n500,2\n")
        columns = Columns(time_unit=option)
        with open_recording(str(path), columns) as recording:
            times = read_trace(recording, ["x"], columns).times
        assert times is not None
        assert times.since[-1] == last
    for names, unit in [("time,x", "ticks,V"), ("Time [ms],x", "s,V")]:
        assert "line 2, column 'Time" in reading(
            tmp_path, monkeypatch, f"{names}\n{unit}\n0,1\n500,2\n"
        ).replace("'time'", "'Time'")


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("time,x\n0,1\n1,2,3\n", ", line 3: expected 2 values (time, x), got 3"),
        ("time,x\n0,1,\n1,2\n", ", line 3: expected 2 values (time, x), got 2"),
        # Rows of a table are never skipped.
        ("time,x\n0,5\n1,-9\ntime,x,y\n0,1,2\n1,2,2\n", ", line 4: expected 2 values (time, x)"),
        ("x\n0,5\nb,c\n", "; give --skip N if the names are below the first N lines"),
        # Words in the first row are not units.
        ("time,x\n0,ERR\n1,2\n", ", line 2, column 'x': expected a number, got 'ERR'"),
        ("x,y\nERR,ERR\n1,2\n", ", line 2, column 'x': expected a number, got 'ERR'"),
        ("# log\n0,1\n1,2\n", "write a line of names first"),
    ],
)
def test_uncertain_layouts_are_refused(
    text: str, error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert error in reading(tmp_path, monkeypatch, text)


def test_lines_are_skipped_by_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "Operator,Bob\nunits,SI\ntime,x\n0,1\n1,2\n"
    assert "no column 'x'" in reading(tmp_path, monkeypatch, text)
    assert reading(tmp_path, monkeypatch, text, Columns(skip=2)) == ([1, 2], [])


# Numbers that are text in other formats. ---------------------------------------------------------


def written(path: Path, columns: dict[str, list[str]]) -> None:
    """Write columns of text in the format of the name."""
    if path.suffix == ".ndjson":
        rows = zip(*columns.values(), strict=True)
        path.write_text("\n".join(json.dumps(dict(zip(columns, r, strict=True))) for r in rows))
    elif path.suffix == ".npz":
        np.savez(path, allow_pickle=False, **{n: np.array(c) for n, c in columns.items()})
    elif path.suffix == ".mat":
        savemat(path, {name: np.array(cells, object) for name, cells in columns.items()})
    elif path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
    else:
        table = pa.table({name: pa.array(c).dictionary_encode() for name, c in columns.items()})
        pa.feather.write_feather(table, str(path))


@pytest.mark.parametrize("extension", [".ndjson", ".parquet", ".feather", ".npz", ".mat"])
def test_other_formats_read_texts_alike(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"t{extension}"

    def result(columns: Columns | None = None, **cells: str) -> Any:  # noqa: ANN401 - as `reading`
        written(path, {name: text.split(" ") for name, text in cells.items()})
        try:
            with open_recording(str(path), columns) as recording:
                trace = read_trace(recording, ["x"], columns)
        except rtamt.InputError as error:
            return str(error)
        assert trace.times is None or trace.period() == Fraction(1, 2)
        return trace.columns["x"].tolist(), [*trace.notes]

    assert result(x="1.5 -2", time="0 0.5") == ([1.5, -2], [])
    assert result(x="1,5 True", time="0 0,5") == ([1.5, 1], [COMMA])
    assert result(x="1.000 2.000", y="3,5 4") == ([1000, 2000], [COMMA, groups("1.000", "1000")])
    assert f"t{extension}, row 1, column 'x': {TWO}" in result(x="1,250 2,900")
    assert result(Columns(decimal="."), x="1,250 2,900") == (
        [1250, 2900],
        [groups("1,250", "1250")],
    )
    assert result(Columns(missing="hold"), x="1.5 N/A") == (
        [1.5, 1.5],
        ["empty cells hold the value before (x: 1)"],
    )
    assert result(x="1.5 N/A").endswith(
        "got 'N/A'; give --missing unknown, or --missing hold if the value before holds"
    )
    assert result(x="1.5 ERR").endswith("row 2, column 'x': expected a number, got 'ERR'")


def test_empty_cell_of_a_table_is_not_called_nan(tmp_path: Path) -> None:
    path = tmp_path / "t.ndjson"
    for variable, row in {"x": '{"time": 1, "x": null}', "time": '{"time": null, "x": 1}'}.items():
        path.write_text(f'{{"time": 0, "x": 1}}\n{row}\n')
        with (
            open_recording(str(path)) as recording,
            pytest.raises(rtamt.InputError, match=f"row 2, column '{variable}': .* got none"),
        ):
            read_trace(recording, ["x"])
