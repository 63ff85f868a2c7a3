"""Tables of several objects: ``--by`` judges each as if its rows were a file of their own."""

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from object_tables import HABITS, OPTIONS, SPECS, group
from profiles import examples

from rtamt_gym.__main__ import main
from rtamt_gym.commands import group_judging
from rtamt_gym.commands.group_judging import judged_groups
from rtamt_gym.commands.judged import Judged
from rtamt_gym.commands.traces import TracesAsked
from rtamt_gym.recorded import groups as tables
from rtamt_gym.recorded.parts import group_name, part_of
from rtamt_gym.results.matrix import Matrix, worst_traces
from rtamt_gym.results.outcome import Failure
from rtamt_gym.results.trial import Trial

SPEC = "always(a > 1 implies eventually[0:0.2](b > 0))"
Row = Mapping[str, Any]

TABLE: list[Row] = [
    {"car": "f1", "time": 0.0, "a": 2.0, "b": -1.0},
    {"car": "f2", "time": 5.0, "a": 2.0, "b": 1.0},
    {"car": "f1", "time": 0.1, "a": 0.0, "b": 2.0},
    {"car": "f2", "time": 5.2, "a": 0.0, "b": 0.0},
    {"car": "f1", "time": 0.2, "a": 2.0, "b": 0.0},
    {"car": "f2", "time": 5.4, "a": 0.0, "b": 0.0},
]


def write(path: Path, rows: Sequence[Row]) -> Path:
    frame = pd.DataFrame(rows)
    writers: dict[str, Callable[[Path], object]] = {
        ".csv": lambda file: frame.to_csv(file, index=False),
        ".parquet": frame.to_parquet,
        ".feather": frame.to_feather,
        ".jsonl": lambda file: frame.to_json(file, orient="records", lines=True),
    }
    writers[path.suffix](path)
    return path


def judged(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict[str, Any]]:
    code = main(["monitor", *map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


def outcomes(found: Mapping[str, Any]) -> list[tuple[object, ...]]:
    """The outcome and the extent of each trace, without its name."""
    return [(row["outcomes"], row["verdict"], row["extent"]) for row in found["trials"]]


@pytest.mark.parametrize("end", [".csv", ".parquet", ".feather", ".jsonl"])
def test_groups_equal_files_of_their_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    file = write(tmp_path / f"cars{end}", TABLE)
    alone = [
        write(tmp_path / f"{car}{end}", [row for row in TABLE if row["car"] == car])
        for car in ("f1", "f2")
    ]
    code, found = judged(capsys, SPEC, "--by", "car", "--", file)
    expected_code, expected = judged(capsys, SPEC, "--", *alone)
    assert (code, outcomes(found)) == (expected_code, outcomes(expected))
    assert [row["name"] for row in found["trials"]] == [f"{file}[car=f1]", f"{file}[car=f2]"]
    assert [row["group"] for row in found["trials"]] == [{"car": "f1"}, {"car": "f2"}]
    assert [row["extent"]["period"] for row in found["trials"]] == ["1/10", "1/5"]
    assert {*found["files"]} == {str(file)}


groups = st.lists(
    st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=2, max_size=5),
    min_size=2,
    max_size=4,
)


@settings(max_examples=examples(25))
@given(groups, st.randoms(use_true_random=False), st.sampled_from((".csv", ".parquet")))
def test_mixed_rows_equal_files_of_their_own(
    tmp_path_factory: pytest.TempPathFactory,
    samples: list[list[tuple[int, int]]],
    random: Random,
    end: str,
) -> None:
    folder = tmp_path_factory.mktemp("groups")
    left = [
        [{"run": i, "time": 0.1 * k, "a": a, "b": b} for k, (a, b) in enumerate(rows)]
        for i, rows in enumerate(samples)
    ]
    alone = {rows[0]["run"]: [*rows] for rows in left}
    mixed = []
    while any(left):
        mixed.append(random.choice([rows for rows in left if rows]).pop(0))
    file = write(folder / f"all{end}", mixed)
    order = [*dict.fromkeys(row["run"] for row in mixed)]
    files = [write(folder / f"{run}{end}", alone[run]) for run in order]
    results = []
    for arguments in (["--by", "run", "--", str(file)], ["--", *map(str, files)]):
        junit = folder / "junit.xml"
        main(["monitor", SPEC, "--junit", str(junit), *arguments])
        root = ET.parse(junit).getroot()  # noqa: S314 - our own file
        results.append(
            [
                (case.attrib["name"], [(child.tag, child.attrib) for child in case])
                for case in root.iter("testcase")
            ]
        )
    assert results[0] == results[1]


def test_a_bad_group_is_an_error_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cars.csv"
    file.write_text("car,time,a\nx,0,1\ny,0,1\nx,1,1\ny,1,oops\nz,3,1\nz,2,1\nw,0,-1\nw,1,1\n")
    code = main(["monitor", "always(a > 0)", str(file), "--by", "car", "--json"])
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert code == 2
    words = ["SATISFIED", "ERROR", "ERROR", "VIOLATED"]
    assert [row["verdict"] for row in found["trials"]] == words
    assert f"{file}[car=y]: {file}, line 5, column 'a': expected a number, got 'oops'" in err
    assert f"{file}, line 7: expected times that increase" in err


def test_values_end_with_their_group(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A value holds to the last time of its own rows; later rows of others change nothing."""
    file = tmp_path / "cars.csv"
    file.write_text("car,time,a\nx,0,1\ny,0,1\nx,1,1\ny,1,1\ny,2,-1\ny,9,1\n")
    for option in ("--jitter=5%", "--dense"):
        _, found = judged(capsys, "always(a > 0)", file, "--by", "car", option)
        assert [row["verdict"] for row in found["trials"]] == ["SATISFIED", "VIOLATED"]
        assert [row["extent"]["end"] for row in found["trials"]] == [1.0, 9.0]


def test_several_keys_and_a_selection(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        {"run": run, "car": car, "time": t, "a": run - t}
        for run in (1, 2)
        for car in ("x,y", "=[z]")
        for t in (0, 1)
    ]
    file = write(tmp_path / "cars.parquet", rows)
    code, found = judged(
        capsys, "always(a > 0)", file, "--by", "run", "--by", "car", "--where", "run=2"
    )
    names = [row["name"] for row in found["trials"]]
    assert code == 0
    assert names == [f"{file}[run=2,car=x%2Cy]", f"{file}[run=2,car=%3D%5Bz%5D]"]
    assert [row["group"] for row in found["trials"]] == [
        {"run": 2, "car": "x,y"},
        {"run": 2, "car": "=[z]"},
    ]
    main(["monitor", "always(a > 0)", names[1], "--json"])
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    assert (trial["name"], trial["outcomes"]) == (names[1], found["trials"][1]["outcomes"])


def test_texts_of_a_file_are_keys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cars.csv"
    file.write_text("car,time,a\n007,0,1\n7,0,2\n007,1,1\n7,1,2\n")
    _, found = judged(capsys, "always(a > 0)", file, "--by", "car")
    assert [row["group"] for row in found["trials"]] == [{"car": "007"}, {"car": "7"}]


@pytest.mark.parametrize(
    ("text", "arguments", "error"),
    [
        ("car,a\nx,1\n", ["--by", "cars"], "No column 'cars'."),
        ("car,a\nx,1\n,2\n", ["--by", "car"], "line 3, column 'car': expected a value"),
        ("car,a\nx,1\n", ["--by", "car", "--where", "car=y"], "no row with 'y' in the column"),
        ("car,a\n", ["--by", "car"], "expected at least one row"),
    ],
)
def test_errors_name_the_column(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    arguments: list[str],
    error: str,
) -> None:
    file = tmp_path / "cars.csv"
    file.write_text(text)
    assert main(["monitor", "always(a > 0)", str(file), *arguments]) == 2
    assert error in capsys.readouterr().err


def test_formats_without_rows_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.mcap").write_bytes(b"")
    assert main(["monitor", "always(a > 0)", str(tmp_path / "run.mcap"), "--by", "car"]) == 2
    assert "expected a file of one table for --by, got rosbag2" in capsys.readouterr().err
    assert main(["monitor", "always(a > 0)", "-", "--by", "car"]) == 2
    assert "expected a file for --by" in capsys.readouterr().err


@given(st.dictionaries(st.text(min_size=1), st.text(), min_size=1, max_size=3))
def test_names_can_be_read_again(
    tmp_path_factory: pytest.TempPathFactory, values: dict[str, str]
) -> None:
    file = tmp_path_factory.mktemp("names") / "cars.csv"
    file.touch()
    part = part_of(group_name(str(file), values))
    assert part is not None
    assert part == (str(file), values)


def test_of_many_traces_the_worst_are_shown() -> None:
    rows = [Trial.of_trace(f"t{i}", "", {"spec": Failure("no")}) for i in range(10_000)]
    assert worst_traces(Matrix(rows, {"spec": "a > 0"})) == (Matrix(rows, {"spec": "a > 0"}), "")
    many = Matrix([*rows, Trial.of_trace("t10000", "", {})], {"spec": "a > 0"})
    few, note = worst_traces(many)
    assert [row.name for row in few.rows] == [f"t{i}" for i in range(100)]
    assert note == "the table shows the 100 worst of 10001 traces"


# Groups of a table judged together have the outcomes of groups judged one by one. ----------------


def table(random: Random, habits: Sequence[str]) -> pd.DataFrame:
    """Return a table of objects, whose rows are next to each other or mixed."""
    groups = [group(random, key, habit) for key, habit in enumerate(habits)]
    if random.random() < 0.5:
        return pd.DataFrame([row for rows in groups for row in rows])
    rows = []
    while any(groups):
        rows.append(random.choice([part for part in groups if part]).pop(0))
    return pd.DataFrame(rows)


def run_batch(arguments: Sequence[str]) -> tuple[int, str, str]:
    """Return the exit code, the output and the errors of a command."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["monitor", *arguments])
    return code, out.getvalue(), err.getvalue()


def none_together(_asked: TracesAsked, _paths: Sequence[str]) -> Iterator[tuple[int, Judged]]:
    """Judge no groups together."""
    return iter(())


@settings(max_examples=examples(40))
@given(
    st.lists(st.sampled_from(HABITS), min_size=2, max_size=7),
    st.sets(st.sampled_from(SPECS), min_size=1, max_size=3),
    st.sampled_from(OPTIONS),
    st.sampled_from((".parquet", ".csv", ".feather")),
    st.sampled_from((("car",), ("car", "kind"), ("kind", "car"))),
    st.sampled_from(("all", "few", "no times", "dates", "integers")),
    st.randoms(use_true_random=False),
)
def test_outcomes_equal_single_groups(
    tmp_path_factory: pytest.TempPathFactory,
    habits: list[str],
    specs: set[str],
    options: Sequence[str],
    end: str,
    by: Sequence[str],
    columns: str,
    random: Random,
) -> None:
    frame = table(random, habits)
    if columns in ("few", "no times"):
        frame = frame[["car", "kind", "time", "x", "a", "b"]]
    if columns == "no times":
        frame = frame.drop(columns="time")
    elif columns == "dates" and frame["time"].notna().all():
        frame["time"] = pd.to_datetime(frame["time"], unit="s")
    elif columns == "integers" and frame["time"].notna().all():
        frame = frame.rename(columns={"time": "time_ms"})
        frame["time_ms"] = (1000 * frame["time_ms"]).round().astype("int64")
    folder = tmp_path_factory.mktemp("table")
    file, junit = folder / f"cars{end}", folder / "cars.xml"
    ranged = folder / "ranged.stl"
    ranged.write_text("input float x in [-4, 4]\nranged = always(x + a > -8)\n")
    texts = [str(ranged) if spec == ranged.name else spec for spec in sorted(specs)]
    {
        ".parquet": frame.to_parquet,
        ".feather": frame.to_feather,
        ".csv": lambda path: frame.to_csv(path, index=False),
    }[end](file)
    where = random.choice([[], [], ["--where", "kind=a"], ["--where", "x=1"]])
    keys = [word for name in by for word in ("--by", name)]
    arguments = [*texts, *options, *keys, *where, "--", str(file)]
    for form in (["--json"], ["--junit", str(junit)]):
        results = []
        for judge in (group_judging.judged_groups, none_together):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(group_judging, "judged_groups", judge)
                printed = run_batch([*form, *arguments])
            results.append((printed, junit.read_bytes() if junit.exists() else b""))
        assert results[0] == results[1]


def test_plain_groups_are_judged_together(tmp_path: Path) -> None:
    """Only groups with a peculiarity are read by themselves, and one bad row costs no more."""
    random = Random(3)
    habits = ["plain", "empty", "one", "plain", "falling", "constant", "objects", "jitter", "two"]
    rows = [row for key, habit in enumerate(habits) for row in group(random, key, habit)]
    file = tmp_path / "cars.parquet"
    pd.DataFrame(rows).to_parquet(file)
    together: list[int] = []

    def recorded(asked: TracesAsked, paths: Sequence[str]) -> Iterator[tuple[int, Judged]]:
        for number, judged in judged_groups(asked, paths):
            together.append(number)
            yield number, judged

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(group_judging, "judged_groups", recorded)
        code, _, _ = run_batch([*SPECS[:2], "--by", "car", "--", str(file)])
    assert code == 2
    assert sorted(together) == [0, 2, 3, 5, 7, 8]


# Sorted Parquet files are read in parts, with the outcomes of files that are read whole. ---------


Output = pytest.CaptureFixture[str]


def run_sorted(arguments: Sequence[str]) -> tuple[int, dict[str, Any], str]:
    """Return the exit code, the JSON without the option itself, and the errors of a command."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["monitor", "--json", *arguments])
    stored = json.loads(out.getvalue() or "{}")
    if stored:
        stored["reading"]["columns"].pop("sorted", None)
    return code, stored, err.getvalue()


@settings(max_examples=examples(30))
@given(
    st.lists(st.sampled_from(sorted({*HABITS} - {"nan time"})), min_size=2, max_size=9),
    st.sets(st.sampled_from(SPECS[:6]), min_size=1, max_size=2),
    st.sampled_from(OPTIONS),
    st.sampled_from((("car",), ("car", "kind"))),
    st.sampled_from(([], ["--where", "kind=a"], ["--where", "x=1"], ["--where", "car=1"])),
    st.integers(1, 30),
    st.integers(1, 40),
    st.randoms(use_true_random=False),
)
def test_parts_equal_the_table_in_memory(
    tmp_path_factory: pytest.TempPathFactory,
    habits: list[str],
    specs: set[str],
    options: Sequence[str],
    by: Sequence[str],
    where: Sequence[str],
    rows_of_part: int,
    rows_of_group: int,
    random: Random,
) -> None:
    rows = [row for key, habit in enumerate(habits) for row in group(random, key, habit)]
    file = tmp_path_factory.mktemp("table") / "cars.parquet"
    table = pa.Table.from_pandas(pd.DataFrame(rows), preserve_index=False)
    pq.write_table(table, file, row_group_size=rows_of_group)
    keys = [word for name in by for word in ("--by", name)]
    arguments = [*sorted(specs), *options, *keys, *where, "--", str(file)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "PART_ROWS", rows_of_part)
        parts = run_sorted(["--sorted", *arguments])
    assert parts == run_sorted(arguments)


def test_a_group_that_comes_back_is_an_error(tmp_path: Path, capsys: Output) -> None:
    file = tmp_path / "cars.parquet"
    frame = pd.DataFrame({"car": [7, 7, 8, 8, 7], "time": [0.0, 1, 0, 1, 2], "x": [1.0] * 5})
    frame.to_parquet(file)
    words = ["monitor", "always(x > 0)", str(file), "--by", "car"]
    assert main([*words, "--sorted"]) == 2
    assert (
        f"{file}, row 5: expected the rows of car=7 to follow each other, as --sorted states, got "
        "one after other groups. Sort the file by car, or leave --sorted out"
    ) in capsys.readouterr().err
    assert main(words) == 0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["cars.csv", "--by", "car", "--sorted"], "expected a Parquet file for --sorted, got CSV"),
        (["cars.parquet", "--sorted"], "expected --by COLUMN with --sorted, got none"),
        (["cars.parquet", "--by", "cat", "--sorted"], "cars.parquet: No column 'cat'"),
        (["cars.parquet", "--by", "kind", "--sorted"], "row 2, column 'kind': expected a value"),
        (["cars.parquet[car=9]", "--by", "car", "--sorted"], "no row with 9 in car"),
    ],
)
def test_sorted_errors(capsys: Output, words: list[str], text: str) -> None:
    frame = pd.DataFrame({"car": [7, 7], "kind": ["a", None], "time": [0.0, 1], "x": [1.0, 2]})
    frame.to_parquet("cars.parquet")
    frame.to_csv("cars.csv", index=False)
    assert main(["monitor", "always(x > 0)", *words]) == 2
    assert text in capsys.readouterr().err


PEAK = """
import sys, tracemalloc
import pyarrow as pa
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import groups as tables
tables.PART_ROWS = 10_000
import rtamt_gym.commands.judging, rtamt_gym.recorded.arrow_reader, rtamt_gym.commands.group_judging
tracemalloc.start()
specs = ["always(x < 9)", "always(y > 0.99 implies eventually[0:1](x > 0))"]
code = main(["monitor", *specs, *sys.argv[1:]])
print(code, tracemalloc.get_traced_memory()[1] + pa.default_memory_pool().max_memory())
"""
"""Prints the exit code, and the most memory of NumPy and Arrow in bytes."""


def test_parts_need_the_memory_of_a_part(tmp_path: Path) -> None:
    rows, groups = 2_000, 500
    rng = np.random.default_rng(0)
    file = tmp_path / "cars.parquet"
    table = pa.table(
        {
            "car": np.repeat(np.arange(groups), rows),
            "time": np.tile(np.arange(rows) / 10, groups),
            "x": rng.normal(size=rows * groups),
            "y": rng.random(rows * groups),
        }
    )
    pq.write_table(table, file, row_group_size=4_000)
    peaks = {}
    for option in ("--sorted", "--one-trace"):  # the second changes nothing here
        done = subprocess.run(
            [sys.executable, "-c", PEAK, "--by", "car", option, "--", str(file)],
            capture_output=True,
            text=True,
            check=True,
        )
        *lines, last = done.stdout.splitlines()
        code, peaks[option] = map(int, last.split())
        assert code in (0, 1, 3)
        assert any(line.startswith(f"{groups} traces") for line in lines)
    whole = 3 * 8 * rows * groups  # the times and two variables
    assert peaks["--one-trace"] > whole
    assert peaks["--sorted"] < whole / 2
