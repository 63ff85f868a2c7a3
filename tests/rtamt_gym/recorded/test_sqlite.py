"""Tables of SQLite: one table is read, several need a name, rows keep their order."""

import json
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import traces_in
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import read_ruled

Output = pytest.CaptureFixture[str]
Rows = Sequence[tuple[object, ...]]


def write(path: Path, table: str = "samples", rows: Rows = (), names: str = "time, speed") -> Path:
    """Add a table to a file."""
    with closing(sqlite3.connect(path)) as connection, connection:
        quoted, marks = table.replace('"', '""'), ", ".join("?" * len(names.split(",")))
        connection.execute(f'CREATE TABLE "{quoted}" ({names})')
        connection.executemany(f'INSERT INTO "{quoted}" VALUES ({marks})', rows)  # noqa: S608
    return path


def read(path: Path, columns: Columns | None = None) -> Trace:
    spec = rtamt.parse("always(speed < 9)")
    (name,) = traces_in(str(path), {} if columns is None else columns.where)
    trace, _ = read_ruled(name, {"": spec}, EvaluationOptions(), columns or Columns())
    assert isinstance(trace, Trace)
    return trace


@pytest.mark.parametrize("extension", [".sqlite", ".sqlite3", ".db"])
def test_table_of_pandas_comes_back(extension: str, tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    frame = pd.DataFrame({"time": np.arange(50) / 8, "speed": generator.normal(size=50)})
    path = tmp_path / f"log{extension}"
    with closing(sqlite3.connect(path)) as connection:
        frame.to_sql("samples", connection, index=False)
    trace = read(path)
    assert trace.columns["speed"].tolist() == frame.speed.tolist()
    assert (trace.period(), trace.source) == (Fraction(1, 8), f"{path}[table=samples]")


def test_several_tables_need_a_name(tmp_path: Path, capsys: Output) -> None:
    path = write(tmp_path / "log.db", "fast", [(0.0, 8.0), (1.0, 9.5)])
    write(path, "slow, 2", [(0.0, 1.0), (1.0, 2.0)])
    assert main(["monitor", "always(speed < 9)", str(path)]) == 2
    error = capsys.readouterr().err
    assert "expected a table, got the tables fast, slow, 2; give --where table=NAME" in error
    assert main(["monitor", "always(speed < 9)", "--where", "table=fast", str(path)]) == 1
    assert f"{path}[table=fast]: 2 samples" in capsys.readouterr().out
    assert main(["monitor", "always(speed < 9)", "--where", "table=slow, 2", str(path)]) == 0
    assert main(["monitor", "always(speed < 9)", "--where", "table=fsat", str(path)]) == 2
    assert "did you mean 'fast'?" in capsys.readouterr().err


def test_rows_of_several_objects_are_refused(tmp_path: Path, capsys: Output) -> None:
    rows = [(k / 2, name, k) for k in range(6) for name in ("a", "b")]
    path = write(tmp_path / "log.db", rows=rows, names="time, vehicle_id, speed")
    command = ["monitor", "always(speed < 9)", str(path)]
    assert main(command) == 2
    assert "expected one trace, got 2 values of 'vehicle_id'" in capsys.readouterr().err
    assert main([*command, "--where", "vehicle_id=a"]) == 0
    assert main([*command, "--where", "vehicle=a"]) == 2
    assert "no column 'vehicle', which --where names" in capsys.readouterr().err


def test_objects_of_a_table_are_traces(tmp_path: Path, capsys: Output) -> None:
    rows = [(k / 2, name, k + shift) for k in range(6) for shift, name in ((0, "a"), (9, "b"))]
    path = write(tmp_path / "log.db", rows=rows, names="time, vehicle_id, speed")
    write(path, "other", [(0.0, 1.0)])
    command = ["monitor", "always(speed < 9)", "--by", "vehicle_id", "--json"]
    assert main([*command, "--where", "table=samples", str(path)]) == 1
    trials = json.loads(capsys.readouterr().out)["trials"]
    names = [f"{path}[table=samples,vehicle_id={name}]" for name in "ab"]
    assert [trial["name"] for trial in trials] == names
    assert [trial["outcomes"]["spec"]["robustness"] for trial in trials] == [4, -5]
    assert trials[1]["group"] == {"table": "samples", "vehicle_id": "b"}
    assert main(["monitor", "always(speed < 9)", names[0]]) == 0
    assert main([*command, str(path)]) == 2
    assert "give --where table=NAME" in capsys.readouterr().out


def test_column_called_table_is_no_group(tmp_path: Path, capsys: Output) -> None:
    """The rows of one table are never read from another table."""
    rows = [(k / 2, name, speed) for k in range(4) for name, speed in (("b", 20.0), ("c", 1.0))]
    path = write(tmp_path / "log.db", "a", rows, "time, [table], speed")
    write(path, "b", [(0.0, 1.0), (0.5, 1.0)])
    command = ["monitor", "always(speed < 14.5)", "--by", "table"]
    for words in (["--where", "table=a", str(path)], [f"{path}[table=a]"]):
        assert main([*command, *words]) == 2
        assert "expected --by with another column than 'table'" in capsys.readouterr().err
    assert main([*command[:2], f"{path}[table=a,table=b]"]) == 2
    with sqlite3.connect(path) as connection:
        connection.execute('CREATE VIEW rows AS SELECT time, speed, "table" AS key FROM a')
    connection.close()
    command = ["monitor", "always(speed < 14.5)", "--by", "key", "--where", "table=rows", "--json"]
    capsys.readouterr()
    assert main([*command, str(path)]) == 1
    trials = json.loads(capsys.readouterr().out)["trials"]
    assert [trial["outcomes"]["spec"]["robustness"] for trial in trials] == [-5.5, 13.5]


def test_empty_cells_and_texts(tmp_path: Path) -> None:
    path = write(tmp_path / "log.db", rows=[(0, 1), (1, None), (2, 3)])
    with pytest.raises(
        rtamt.InputError, match=r"row 2, column 'speed': expected a number, got none"
    ):
        read(path)
    assert read(path, Columns(missing="hold")).columns["speed"].tolist() == [1, 1, 3]
    texts = write(
        tmp_path / "t.db", rows=[("2024-01-01T00:00:00", "1.5"), ("2024-01-01T00:00:01", "2.5")]
    )
    trace = read(texts)
    assert (trace.period(), trace.columns["speed"].tolist()) == (Fraction(1), [1.5, 2.5])
    mixed = write(tmp_path / "m.db", rows=[(0, 1), (1, "fast")])
    with pytest.raises(
        rtamt.InputError, match=r"row 2, column 'speed': expected a number, got 'fast'"
    ):
        read(mixed)
    blob = write(tmp_path / "b.db", rows=[(0, 1), (1, b"\0\1")])
    with pytest.raises(rtamt.InputError, match=r"column 'speed': expected numbers, got object"):
        read(blob)


def test_views_and_odd_names(tmp_path: Path) -> None:
    path = write(tmp_path / "log.db", 'a"b[c]', [(0.0, 8.0), (1.0, 9.5)])
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute('CREATE VIEW later AS SELECT * FROM "a""b[c]" WHERE time > 0')
    assert read(path, Columns(where={"table": 'a"b[c]'})).samples == 2
    assert read(path, Columns(where={"table": "later"})).columns["speed"].tolist() == [9.5]


def test_damaged_files_are_errors(tmp_path: Path, capsys: Output) -> None:
    path = write(tmp_path / "log.db", rows=[(k / 8, 1.0) for k in range(3000)])
    whole = path.read_bytes()
    command = ["monitor", "always(speed < 9)", "--", str(path)]
    for part in range(20):
        path.write_bytes(whole[: len(whole) * part // 20])
        assert main(command) == 2
        assert f"{path}: expected a whole SQLite file" in capsys.readouterr().err
    path.write_bytes(whole[:4096] + b"\xff" * 4096 + whole[8192:])
    assert main(command) == 2
    assert "expected a whole SQLite file" in capsys.readouterr().err
