"""Data frames of pandas and polars and tables of Arrow are read like mappings."""

import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from numpy.typing import NDArray

import rtamt
from rtamt.inputs.frames import named_columns

SPEC = "always[0:2](x > 1 implies y < 3)"

Make = Callable[[Mapping[str, Any]], Any]
FRAMES: Mapping[str, Make] = {
    "pandas": lambda data: pd.DataFrame(dict(data)),
    "pandas nullable": lambda data: pd.DataFrame(dict(data)).convert_dtypes(),
    "pandas on arrow": lambda data: pd.DataFrame(dict(data)).convert_dtypes(
        dtype_backend="pyarrow"
    ),
    "polars": lambda data: pl.DataFrame(dict(data)),
    "arrow": lambda data: pa.table(dict(data)),
    "arrow batch": lambda data: pa.RecordBatch.from_pydict(dict(data)),
}


@pytest.fixture(params=[*FRAMES])
def make(request: pytest.FixtureRequest) -> Make:
    return FRAMES[request.param]


@pytest.fixture
def columns() -> dict[str, NDArray[Any]]:
    rng = np.random.default_rng(1)
    return {"y": rng.integers(0, 5, 40), "note": np.array(["a"] * 40), "x": rng.normal(size=40)}


def test_a_frame_is_judged_as_a_mapping_is(make: Make, columns: dict[str, NDArray[Any]]) -> None:
    frame = make(columns)
    assert rtamt.evaluate(SPEC, frame).tolist() == rtamt.evaluate(SPEC, columns).tolist()
    assert str(rtamt.judge(SPEC, frame)) == str(rtamt.judge(SPEC, columns))
    assert str(rtamt.explain(SPEC, frame, "10ms")) == str(rtamt.explain(SPEC, columns, "10ms"))


def test_a_missing_number_is_nan(make: Make) -> None:
    frame = make({"x": [5, None, 3]})
    assert rtamt.evaluate("x > 1", frame, nan="hold").tolist() == [4.0, 4.0, 2.0]
    with pytest.raises(rtamt.InputError, match="variable 'x' is nan at sample 1"):
        rtamt.evaluate("x > 1", frame)


def test_missing_columns_and_text_are_refused(make: Make) -> None:
    with pytest.raises(rtamt.InputError, match=r"No column 'x'\. The columns are 'y', 'z'\."):
        rtamt.evaluate(SPEC, make({"y": [1.0], "z": [2.0]}))
    with pytest.raises(rtamt.InputTypeError, match="expected an array of numbers for 'x'"):
        rtamt.evaluate("x > 1", make({"x": ["1.5", "2"]}))


STAMPS = pd.date_range("2024-05-01", periods=4, freq="10ms").to_numpy()


@pytest.mark.parametrize(
    ("name", "times", "begin"),
    [
        ("time", [0.0, 0.1, 0.2, 0.3], ("0.0", "0.1")),
        ("Time [s]", [0.0, 0.1, 0.2, 0.3], ("0.0", "0.1")),
        ("timestamp_ns", [5, 10, 15, 20], ("5", "10")),
        ("recorded", STAMPS, ("2024-05-01 00:00:00", "2024-05-01 00:00:00.010000")),
    ],
)
def test_times_of_a_frame_are_never_ignored_in_silence(
    make: Make, name: str, times: object, begin: tuple[str, str]
) -> None:
    frame = make({"x": [5.0, 4.0, 3.0, 0.0], name: times})
    for call in (rtamt.evaluate, rtamt.judge, rtamt.explain):
        with pytest.raises(rtamt.InputError) as caught:
            call("always[0:1](x > 1)", frame)
        assert str(caught.value) == (
            f"expected a period, because the data frame has a column of times '{name}', which "
            f"begins with {begin[0]} and {begin[1]}; pass period=, the time between two samples, "
            "or drop it to count bounds in samples"
        )
    # A formula without bounds needs no period.
    assert rtamt.evaluate("always(x > 1)", frame).tolist() == [-1.0] * 4


@pytest.mark.parametrize(
    ("name", "times", "period", "distances"),
    [
        ("time", [0.0, 0.1, 0.2, 0.3], 1, "0.1 apart, not 1 s"),
        ("time", [0.0, 0.1, 0.2, 0.5], "100ms", "0.1 to 0.3 apart, not 0.1 s"),
        ("time_ms", [0, 100, 200, 300], 1, "0.1 s apart, not 1 s"),
        ("recorded", STAMPS, 1, "0.01 s apart, not 1 s"),
    ],
)
def test_times_that_contradict_the_period(
    make: Make, name: str, times: object, period: float | str, distances: str
) -> None:
    frame = make({"x": [5.0, 4.0, 3.0, 0.0], name: times})
    message = f"^period= leaves the times in '{name}' unread, which are {distances}"
    for call in (rtamt.evaluate, rtamt.judge, rtamt.explain):
        with pytest.warns(UserWarning, match=message):
            call("always[0:1](x > 1)", frame, period=period, align="outward")
    with pytest.warns(UserWarning, match=message):
        rtamt.judge_many("always[0:1](x > 1)", [frame], period=period, align="outward")
    rtamt.judge("always(x > 1)", frame, period=period)  # counts nothing


def test_period_warning_names_the_caller() -> None:
    data = {"x": [5.0, 4.0], "time": [0.0, 1.0]}
    for call in (rtamt.evaluate, rtamt.judge, rtamt.explain):
        with pytest.warns(UserWarning, match="unread") as caught:
            call("always[0:1](x > 1)", data, period="100ms")
        assert [warning.filename for warning in caught] == [__file__]


def test_time_zones_do_not_hide_the_period_warning() -> None:
    index = pd.date_range("2020", periods=2, freq="10s", tz="Europe/Vienna")
    with pytest.warns(UserWarning, match="which are 10 s apart, not 1 s"):
        rtamt.judge("always[0:1](x > 1)", pd.DataFrame({"x": [5.0, 4.0]}, index=index), period=1)


@pytest.mark.parametrize(
    "times",
    [[0.0, float("nan"), 9.0], [[0.0], [1.0, 2.0], 3.0], np.array(["NaT", 1, 2], "M8[s]")],
    ids=["nan", "ragged", "NaT"],
)
def test_times_without_distances_are_no_contradiction(times: object) -> None:
    data = {"x": [5.0, 4.0, 3.0], "time": times}
    assert rtamt.judge("always[0:1](x > 1)", data, period=1).verdict


@pytest.mark.parametrize(
    ("times", "period"),
    [([0, 100, 200, 300], "100ms"), ([0.0, 0.1, 0.2, 0.304], 0.1), ([0, 1000, 2000, 3000], "1ms")],
)
def test_times_that_fit_the_period_in_some_unit(
    make: Make, times: Sequence[float], period: float | str
) -> None:
    frame = make({"x": [5.0, 4.0, 3.0, 0.0], "time": times})
    assert rtamt.judge("always[0:1](x > 1)", frame, period=period, align="outward").verdict


def test_joined_times_that_contradict_the_period() -> None:
    trace = {"time": [0, 1, 2, 0, 1], "x": [1, 2, 3, 4, 5]}
    rtamt.judge_many("always[0:1](x > 1)", trace, lengths=[3, 2], period=1)
    with pytest.warns(UserWarning, match="1 apart, not 0.1 s"):
        rtamt.judge_many("always[0:1](x > 1)", trace, lengths=[3, 2], period=0.1)


def test_a_column_that_the_formula_reads_is_not_ignored(make: Make) -> None:
    frame = make({"t": [21.0, 22.0, 25.0]})
    assert rtamt.evaluate("always[0:1](t > 20)", frame).tolist() == [1.0, 2.0, 5.0]


@pytest.mark.parametrize(
    "index",
    [
        pd.DatetimeIndex(STAMPS),
        pd.to_timedelta([0, 1, 2, 3], unit="s"),
        pd.Index([0.0, 0.1, 0.2, 0.3], name="time"),
    ],
)
def test_an_index_of_times_is_not_ignored(index: pd.Index) -> None:
    frame = pd.DataFrame({"x": [5.0, 4.0, 3.0, 0.0]}, index=index)
    with pytest.raises(rtamt.InputError) as caught:
        rtamt.evaluate("always[0:1](x > 1)", frame)
    begin = "expected a period, because the data frame has an index of times, which begins with "
    end = "; pass period=, the time between two samples, or reset_index(drop=True) to count bounds"
    assert str(caught.value).startswith(begin)
    assert str(caught.value).endswith(f"{end} in samples")
    counted = rtamt.evaluate("always[0:1](x > 1)", frame.reset_index(drop=True))
    assert counted.tolist() == [3.0, 2.0, -1.0, -1.0]


def test_names_of_columns_may_be_no_text() -> None:
    frame = pd.DataFrame({0: [1, 2], "x": [2.0, 3.0], ("x", 1): [3, 4]})
    assert rtamt.evaluate("always[0:1](x > 1)", frame).tolist() == [1, 2]
    frame[7] = pd.date_range("2024", periods=2, freq="s")
    with pytest.raises(rtamt.InputError, match=r"^expected a period, .* a column of times '7', "):
        rtamt.evaluate("always[0:1](x > 1)", frame)


def test_days_are_times(make: Make) -> None:
    days = np.array(["2024-02-28", "2024-02-29"], "M8[D]").tolist()
    if isinstance(frame := make({"x": [1.0, 2.0], "begun": days}), pd.DataFrame):
        frame["begun"] = frame["begun"].astype("datetime64[s]")
    with pytest.raises(rtamt.InputError, match=r"^expected a period, .* 'begun', .* 2024-02-28"):
        rtamt.evaluate("always[0:1](x > 1)", frame)


def test_a_frame_that_is_not_read_yet_is_refused() -> None:
    with pytest.raises(rtamt.InputTypeError) as caught:
        rtamt.evaluate("always(x > 1)", pl.LazyFrame({"x": [1.0]}))  # type: ignore[arg-type]
    assert str(caught.value) == (
        "expected a data frame, got a LazyFrame, which is not read yet; pass its collect()"
    )


def test_no_library_of_frames_is_imported() -> None:
    code = (
        "import sys, rtamt; rtamt.evaluate('x > 1', {'x': [1.0]});"
        "print(sorted({'pandas', 'polars', 'pyarrow', 'narwhals'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_what_has_columns_that_are_no_names_is_no_frame() -> None:
    class Table:
        columns = 3

        def __getitem__(self, name: str) -> list[float]:
            return [1.0, 2.0]

    with pytest.raises(rtamt.InputTypeError, match=r"^expected an array of numbers for the block,"):
        rtamt.evaluate("x > 0", Table())  # type: ignore[arg-type]


def test_a_table_is_the_mapping_of_its_columns() -> None:
    table = named_columns(pl.DataFrame({"x": [1.0], "y": [2.0]}))
    assert isinstance(table, Mapping)
    assert (len(table), [*table]) == (2, ["x", "y"])
    assert {name: [*column] for name, column in table.items()} == {"x": [1.0], "y": [2.0]}


@pytest.mark.parametrize("name", ["sim_time", "clk", "TimeUS", "Abszisse"])
def test_times_of_other_names_are_not_ignored(make: Make, name: str) -> None:
    columns = {name: [0.0, 0.25, 0.5, 0.75], "x": [5.0, 4.0, 3.0, 0.0]}
    with pytest.raises(
        rtamt.InputError, match=f"^expected a period, .* a column of times '{name}'"
    ):
        rtamt.evaluate("always[0:1](x > 1)", make(columns))
    columns["odometer"] = columns.pop(name)
    assert rtamt.evaluate("always[0:1](x > 1)", make(columns)).tolist() == [3.0, 2.0, -1.0, -1.0]


def test_a_tidy_frame_is_several_traces(make: Make) -> None:
    x = [5.0, 4.0, 3.0, -1.0]
    one_after_another = {"vehicle_id": [0, 0, 1, 1], "t": [0.0, 1.0, 2.0, 3.0], "x": x}
    interleaved = {"lane": [7, 8, 7, 8], "t": [0.0, 0.0, 1.0, 1.0], "x": x}
    for columns, name, values in (
        (one_after_another, "vehicle_id", "0, 1"),
        (interleaved, "lane", "7, 8"),
    ):
        for call in (rtamt.evaluate, rtamt.judge, rtamt.explain):
            with pytest.raises(rtamt.InputError) as caught:
                call("always(x > 1)", make(columns))
            assert str(caught.value) == (
                f"expected one trace, got a data frame that has a column '{name}' with 2 values "
                f"({values}), as with several objects or episodes; pass the rows of one, or only "
                "the columns of the formula if all rows are one trace"
            )
        assert rtamt.judge("always(x > 1)", make({"x": x})).robustness == -2
    named = make({**one_after_another, "vehicle_id": [0, 0, 0, 0]})
    assert rtamt.judge("always(x > 1)", named).robustness == -2


def test_an_index_of_episodes_is_several_traces() -> None:
    frame = pd.DataFrame(
        {"episode": [0, 0, 1, 1], "time": [0, 1, 0, 1], "x": [5.0, 4.0, 3.0, -1.0]}
    )
    with pytest.raises(rtamt.InputError, match=r"a column 'episode' with 2 values \(0, 1\)"):
        rtamt.judge("always(x > 1)", frame.set_index(["episode", "time"]))
    assert rtamt.judge("always(x > 1)", frame.set_index(["episode"]).loc[0]).robustness == 3


@pytest.mark.parametrize(
    "other",
    [
        {"step": [0, 1, 2] * 2},
        {"terminated": [False, False, True] * 2},
        {"topic": ["a"] * 3 + ["b"] * 3},
    ],
)
def test_runs_one_after_another_are_several_traces(make: Make, other: Mapping[str, Any]) -> None:
    frame = make({**other, "x": [0.0, 0.0, 0.0, 9.0, 9.0, 9.0]})
    with pytest.raises(rtamt.InputError, match=f"'{next(iter(other))}'.*several objects or ep"):
        rtamt.judge("eventually(x > 5)", frame)


def test_an_index_that_starts_again_is_several_traces() -> None:
    run = pd.DataFrame({"x": [0.0, 9.0, 0.0]})
    with pytest.raises(rtamt.InputError, match="'index' by which another trace starts in row 3"):
        rtamt.judge("eventually(x > 5)", pd.concat([run, run]))
    joined = pd.concat([run, run], ignore_index=True)
    assert rtamt.judge("eventually(x > 5)", joined).robustness == 4


@pytest.mark.parametrize(
    "index",
    [
        [0.0, 0.1, 0.2, 0.3],
        pd.Index([0, 10, 20, 30], name="foo"),
        ["2024-05-01 12:00", "2024-05-01 12:01", "2024-05-01 12:02", "2024-05-01 12:03"],
        pd.period_range("2024", periods=4, freq="h"),
    ],
)
def test_more_indices_of_times_are_not_ignored(index: pd.Index | list[Any]) -> None:
    frame = pd.DataFrame({"x": [2.0, 3.0, 1.0, 0.0]}, index=index)
    with pytest.raises(rtamt.InputError, match=r"an index of times, .*reset_index\(drop=True\)"):
        rtamt.judge("always[0:2](x > 1)", frame)
    assert rtamt.judge("always[0:2](x > 1)", frame.reset_index(drop=True)).robustness == 0
    assert rtamt.judge("always[0:2](x > 1)", frame, period=2).robustness == 1


def test_an_index_of_selected_rows_is_not_one_of_times() -> None:
    frame = pd.DataFrame({"x": np.arange(40.0)}).iloc[::10]
    assert rtamt.judge("always[0:2](x >= 0)", frame).robustness == 0


@pytest.mark.parametrize(
    "times",
    [
        {"when": ["01.05.2024 12:00:00", "01.05.2024 12:00:01", "01.05.2024 12:00:02"]},
        {"clock": ["12:00:00", "12:00:01", "12:00:02"]},
        {"sec": [7, 7, 8], "nanosec": [0, 500_000_000, 0]},
        {"s": [7, 7, 8], "ns": [0, 500_000_000, 0]},
        {"hour": [22, 23, 0]},
        {"dt": [0.5, 0.5, 0.5]},
    ],
)
def test_more_columns_of_times_are_not_ignored(make: Make, times: Mapping[str, Any]) -> None:
    frame = make({"x": [2.0, 3.0, 1.0], **times})
    with pytest.raises(rtamt.InputError, match=f"a column of times '{next(iter(times))}'"):
        rtamt.judge("always[0:2](x > 1)", frame)
    assert rtamt.judge("always(x > 1)", frame).robustness == 0


def test_the_newest_first_and_levels_of_rows_are_refused(make: Make) -> None:
    with pytest.raises(rtamt.InputError, match=r"got the newest first, 2(\.0)? before 1"):
        rtamt.judge("always(x > 1)", make({"t": [2.0, 1.0, 0.0], "x": [2.0, 3.0, 1.0]}))
    levels = pd.MultiIndex.from_product([[0, 1], range(3)], names=["a", "b"])
    with pytest.raises(rtamt.InputError, match="another trace starts in row 3"):
        rtamt.judge("always(x > 1)", pd.DataFrame({"x": np.arange(6.0)}, index=levels))


@pytest.mark.parametrize("name", ["time", "t", "Time [s]"])
def test_times_of_a_mapping_error(name: str) -> None:
    trace = {name: [0.0, 0.5, 1.0], "x": [5.0, 4.0, 0.0]}
    message = rf"^expected a period, because the mapping has a column of times '{re.escape(name)}'"
    for call in (rtamt.evaluate, rtamt.judge, rtamt.explain, rtamt.occurrences):
        with pytest.raises(rtamt.InputError, match=message):
            call("always[0:1](x > 1)", trace)
    with pytest.raises(rtamt.InputError, match=r"^trace 0: expected a period, because the mapping"):
        rtamt.judge_many("always[0:1](x > 1)", [trace])
    assert rtamt.judge("always[0:1](x > 1)", trace, period=0.5).verdict.name == "VIOLATED"
    assert rtamt.judge("always(x > 1)", trace).verdict.name == "VIOLATED"


def test_joined_times_of_a_mapping_error() -> None:
    trace = {"time": [0.0, 0.5, 1.0, 0.0], "x": [5.0, 4.0, 0.0, 3.0]}
    with pytest.raises(rtamt.InputError, match="expected a period, because the mapping"):
        rtamt.judge_many("always[0:1](x > 1)", trace, lengths=[3, 1])
