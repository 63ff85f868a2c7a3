"""Tables of several objects: ``--by`` judges each as if its rows were a file of their own."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Any
from xml.etree import ElementTree as ET

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt_gym.__main__ import main
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
