"""The blocks of a stream do not matter: a pipe delivers its lines one by one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from played import play

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns, Missing
from rtamt_gym.watching.states import StreamStop
from rtamt_gym.watching.watch import WatchOptions

Output = pytest.CaptureFixture[str]
SPEC = "always(x < 5)"


def streamed(
    text: str,
    size: int,
    columns: Columns,
    reading: EvaluationOptions,
    **options: Any,  # noqa: ANN401
) -> tuple[list[str], list[str], int]:
    """The lines of a stream in blocks of some bytes, its messages, and the exit code."""
    stream = play(WatchOptions({"it": rtamt.parse(SPEC)}, reading, columns, **options), text, size)
    errors = [*filter(None, [stream.error]), *stream.watch.failures, *stream.watch.messages()]
    return [line.to_json() for line in stream.lines], errors, stream.code


def table(names: str, *rows: str) -> str:
    return "\n".join([names, *rows]) + "\n"


DATES = {
    "the month first": (["01/04/2024", "02/04/2024", "13/04/2024"], 2),
    "certain": (["13/04/2024", "14/04/2024", "15/04/2024"], 0),
    "certain at first": (["30/04/2024", "01/05/2024", "02/05/2024"], 0),
    "one day": (["01/04/2024 10:00:00", "01/04/2024 10:00:01", "01/04/2024 10:00:02"], 0),
    "a zone later": (["2024-05-01T00:00:00", "2024-05-01T00:00:01", "2024-05-01T00:00:02Z"], 2),
    "zones": (["2024-05-01T02:00:00+02:00", "2024-05-01T00:00:01Z", "2024-05-01T00:00:02Z"], 0),
    "another form": (["2024-05-01", "2024-05-02", "03.05.2024"], 2),
}


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("name", DATES)
def test_dates_are_read_alike(name: str, dense: bool, size: int, tmp_path: Path) -> None:  # noqa: FBT001
    dates, code = DATES[name]
    text = table("time,x", *(f"{date},1" for date in dates))
    _, errors, got = streamed(text, size, Columns(), EvaluationOptions(dense=dense))
    assert got == code, errors
    path = tmp_path / "dates.csv"
    path.write_text(text)
    if name != "the month first":  # a file shows it in a later row
        assert main(["monitor", SPEC, str(path), *(["--dense"] if dense else [])]) == code
    elif code:
        assert "line 3: column 'time': the date '02/04/2024' may have the day or" in errors[0]
        order = Columns(date_order="dmy")
        assert not streamed(text, size, order, EvaluationOptions(dense=True))[2]


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize("times", [[0, "1", 2], ["0", 1, "2"]])
def test_times_of_two_kinds(times: Sequence[object], size: int) -> None:
    text = "".join(json.dumps({"time": time, "x": 1}) + "\n" for time in times)
    _, errors, code = streamed(text, size, Columns(), EvaluationOptions())
    assert code == 2
    assert errors[0].startswith("stream, line 2: column 'time': expected a ")


EMPTY = table("time,x", *(f"{i},{cell}" for i, cell in enumerate(["1", "", "9", "", "1", "8"])))
DROPPED = table("time,x", "0,1", "1,2", "2,9", "3,", "4,1")
READINGS = [EvaluationOptions(), EvaluationOptions(dense=True), EvaluationOptions(period=1)]


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize("cell", ["1s", "00:00:01", "2024-05-01", "abc"])
@pytest.mark.parametrize("line", [1, 2])
def test_other_times_than_the_first(line: int, cell: str, size: int) -> None:
    times = ["0", "1", "2", "3"]
    times[line] = cell
    text = table("time;x", *(f"{time};1" for time in times))
    _, errors, code = streamed(text, size, Columns(), EvaluationOptions())
    assert code == 2
    assert errors[0].startswith(f"stream, line {line + 2}: ")
    skipped = streamed(text, size, Columns(), EvaluationOptions(), skip_bad=True)
    assert skipped[2] == (2 if line == 1 else 3)  # the first two rows give the period


@pytest.mark.parametrize("stop", ["violation", "decided"])
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize(
    ("missing", "text"), [("hold", EMPTY), ("unknown", EMPTY), ("drop", DROPPED)]
)
def test_rows_after_a_stop_do_not_count(
    missing: Missing, text: str, reading: EvaluationOptions, stop: StreamStop
) -> None:
    columns = Columns(missing=missing)
    first, *others = (streamed(text, n, columns, reading, stop=stop) for n in (1, 7, 10_000))
    assert first[2] == 1
    assert others == [first, first]
