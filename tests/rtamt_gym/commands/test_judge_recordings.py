"""`judge_recordings`: the folder of the command from Python."""

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

import rtamt
from rtamt_gym import judge_recordings
from rtamt_gym.__main__ import main

LOW, ANSWERED = "always(x < 8)", "always(x > 4 implies eventually[0:0.2](x < 3))"
SPECS = {"low": LOW, "answered": ANSWERED}
TRACES = {"a": [3.0, 5.0, 2.0, 1.0], "b": [3.0, 9.0, 9.0], "c": [5.0, 5.0, 2.0]}


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    for name, values in TRACES.items():
        rows = (f"{100 * k},{value}" for k, value in enumerate(values))
        (tmp_path / f"{name}.csv").write_text("time,x\n" + "\n".join(rows) + "\n")
    return [tmp_path / f"{name}.csv" for name in TRACES]


@pytest.mark.parametrize("end", ["cut", "complete", "open"])
def test_rows_equal_judge(files: list[Path], tmp_path: Path, end: rtamt.typing.End) -> None:
    columns = {"time_unit": "ms"}
    table = judge_recordings(SPECS, files, tmp_path / "results", columns=columns, end=end)
    assert table["path"].to_pylist() == [*map(str, files)]
    for name, spec in SPECS.items():
        judged = [rtamt.judge(spec, {"x": x}, period=0.1, end=end) for x in TRACES.values()]
        assert table[f"verdict({name})"].to_pylist() == [each.verdict.name for each in judged]
        assert table[f"lower({name})"].to_pylist() == [each.lower for each in judged]
        assert table[f"upper({name})"].to_pylist() == [each.upper for each in judged]


def test_the_command_and_python_share_a_folder(files: list[Path], tmp_path: Path) -> None:
    results = tmp_path / "results"
    texts = [f"{name} = {spec}" for name, spec in SPECS.items()]
    options = ["--results", str(results), "--time-unit", "ms", "--end", "complete"]
    main(["monitor", *texts, *options, "--", *map(str, files[:2])])
    first = pq.read_table(results / "results.parquet").to_pylist()
    columns = {"time_unit": "ms"}
    table = judge_recordings(
        SPECS, files, results, columns=columns, workers=2, end="complete"
    ).to_pylist()
    assert table[:2] == first  # with the wall times: these files were not judged again
    assert len(table) == 3


def test_signals_of_other_columns(files: list[Path], tmp_path: Path) -> None:
    table = judge_recordings(
        {"low": "always(speed < 8)"},
        files,
        tmp_path / "results",
        columns={"signals": {"speed": "x"}},
        period="100ms",
    )
    assert table["verdict"].to_pylist() == ["satisfied", "violated", "satisfied"]


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"backend": "spark"}, "backend"),
        ({"workers": 0}, "expected workers of 1 or more, got 0"),
        ({"columns": {"signal": {}}}, "columns got an unexpected option 'signal'; .*signals"),
        ({"nan": "hold"}, r"judge_recordings\(\) got an unexpected option 'nan'"),
        (
            {"columns": {"signals": {"y": "x"}}},
            r"^columns\[.signals.\]: no specification reads 'y'",
        ),
        ({"columns": {"defaults": ("y",)}}, r"^columns\[.defaults.\]: no specification declares"),
        ({"columns": {"long": ("a", "b")}}, "expected dense=True with long="),
        ({"columns": {"start": "known"}}, "expected start='known' with dense=True"),
        ({"columns": {"jitter": 0.05}, "period": 1}, "expected period=, .* or jitter="),
        ({"scheduler": "a:1"}, "expected backend='dask' or backend='ray' with scheduler= a:1"),
        ({"dense": True, "period": 1}, "expected period= or dense=True"),
    ],
)
def test_wrong_options_are_refused(
    files: list[Path], tmp_path: Path, options: dict[str, Any], error: str
) -> None:
    with pytest.raises(rtamt.RtamtError, match=error):
        judge_recordings(SPECS, files, tmp_path / "results", **options)
    assert not (tmp_path / "results").exists()


def test_one_path_is_refused(tmp_path: Path) -> None:
    with pytest.raises(rtamt.InputTypeError, match=r"expected a list of files, got 'a\.csv'"):
        judge_recordings(LOW, "a.csv", tmp_path / "results")


def test_no_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(rtamt.InputError, match="expected one or more files, got none"):
        judge_recordings(LOW, [], tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_folders_and_patterns_are_searched(files: list[Path], tmp_path: Path) -> None:
    (tmp_path / "notes.md").touch()
    (tmp_path / "x").mkdir()
    columns = {"time_unit": "ms"}
    listed = judge_recordings(SPECS, files, tmp_path / "x/listed", columns=columns)
    searched: list[list[Path | str]] = [
        [tmp_path],
        [str(tmp_path / "[a-c].csv")],
        [*files, tmp_path],
    ]
    for number, words in enumerate(searched):
        results = tmp_path / f"x/{number}"
        table = judge_recordings(SPECS, words, results, columns=columns)
        left = ["wall", "worker"]
        assert table.drop_columns(left).equals(listed.drop_columns(left))
    with pytest.raises(rtamt.InputError, match="no file has a name like"):
        judge_recordings(SPECS, [str(tmp_path / "d*.csv")], tmp_path / "x/none")


def test_folder_errors_name_the_argument(files: list[Path], tmp_path: Path) -> None:
    with pytest.raises(rtamt.InputError, match=r"^expected results= as a new folder"):
        judge_recordings(LOW, files, tmp_path)
    with pytest.raises(rtamt.InputError, match=r"^expected results= as a folder, got the file"):
        judge_recordings(LOW, files, files[0])


def test_other_results_are_refused(files: list[Path], tmp_path: Path) -> None:
    judge_recordings(SPECS, files, tmp_path / "results", columns={"time_unit": "ms"})
    with pytest.raises(rtamt.InputError, match='their end is "cut", not "open"'):
        judge_recordings(
            SPECS, files, tmp_path / "results", columns={"time_unit": "ms"}, end="open"
        )
