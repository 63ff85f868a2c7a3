"""A stream is one trace if `rtamt monitor` reads the same rows as one."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from played import play

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.states import StreamStop
from rtamt_gym.watching.watch import WatchOptions

Output = pytest.CaptureFixture[str]
SPEC = "always(x > 0)"


def refusal(text: str, size: int) -> str:
    """The error of a stream in pieces of some bytes; empty if it is one trace."""
    options = WatchOptions({"it": rtamt.parse(SPEC)}, EvaluationOptions(), Columns())
    return play(options, text, size).error


def table(names: str, rows: Sequence[Sequence[object]]) -> str:
    return f"{names}\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)


COLUMNS: dict[str, list[list[object]]] = {
    "terminated": [
        [0, 0, 1, 0, 0],
        [0, 0, 0, 0, 1],
        [0, 0, 0, 1, 1],
        [0, 2, 1, 0, 0],
        ["", "", 1, "", ""],
        ["", "", "", 1],
        ["", "a", 1, ""],
    ],
    "truncated": [["False", "True", "False"], ["False", "False", "True"]],
    "is_first": [[1, 0, 0, 1, 0], [1, 0, 0], [0, 0, 1]],
    "isLast": [[0, 1, 0], [0, 0, 1]],
    "done": [[0, 1, 0], [0, 0, 1]],
    "step": [[0, 1, 0, 1], [0, 1, 2, 3], [5, 6, 7, 0], [0, 1, 2, ""], [0, 1, 2, "sum"], [0, 1, 0]],
    "a": [[0, 1, 2, 3, 0, 1, 2, 3], [0, 1, 0, 1, 0], [0, 1, 2, ""]],
}


@pytest.mark.parametrize("size", [7, 1000])
@pytest.mark.parametrize("place", ["first", "last"])
@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize(("name", "values"), [(n, v) for n, rows in COLUMNS.items() for v in rows])
def test_a_stream_is_refused_where_its_file_is(
    name: str,
    values: list[object],
    timed: bool,  # noqa: FBT001
    place: str,
    size: int,
    tmp_path: Path,
) -> None:
    names = [name, "x"] if place == "first" else ["x", name]
    rows = [[value, 1] if place == "first" else [1, value] for value in values]
    if timed:
        names, rows = ["time", *names], [[i / 2, *row] for i, row in enumerate(rows)]
    text = table(",".join(names), rows)
    path = tmp_path / "trace.csv"
    path.write_text(text)
    refused = main(["monitor", SPEC, str(path)]) == 2
    assert bool(refusal(text, size)) == refused
    assert main(["monitor", SPEC, str(path), "--one-trace"]) == 0
    assert main(["watch", SPEC, str(path), "--one-trace"]) == 0


@pytest.mark.parametrize("size", [5, 64, 10_000])
def test_random_counts_are_refused_as_in_a_file(size: int, tmp_path: Path) -> None:
    draw = np.random.default_rng(6)
    path, several = tmp_path / "trace.csv", 0
    for _ in range(25):
        lengths = draw.integers(2, 90, draw.integers(1, 4)).tolist()
        steps = [step for length in lengths for step in range(length)]
        text = table("x,step", [[1, step] for step in steps])
        path.write_text(text)
        refused = main(["monitor", SPEC, str(path)]) == 2
        assert bool(refusal(text, size)) == refused
        several += refused
    assert several > 10


def test_the_line_of_another_episode(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.ndjson"
    rows = [{"time": i, "x": 1, "terminated": i == 2} for i in range(5)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert main(["watch", SPEC, str(path), "--stop", "violation"]) == 2
    captured = capsys.readouterr()
    assert "line 4: expected one trace, but 'terminated' shows that another" in captured.err
    assert json.loads(captured.out.splitlines()[-1])["end"] == "open"


@pytest.mark.parametrize("late", [0, 30])
@pytest.mark.parametrize("count", [9, 90, 300])
@pytest.mark.parametrize("options", [["--dense"], ["--period", "100ms"]])
@pytest.mark.parametrize("order", ["alternating", "sorted", "mostly one"])
def test_alternating_texts_are_refused_as_in_a_file(
    order: str, options: list[str], count: int, late: int, tmp_path: Path
) -> None:
    names = [("P3", "P7", "P12")[i % 3] for i in range(count)]
    if order == "sorted":
        names.sort()
    if order == "mostly one":
        names = [name if i % 9 == 0 else "P3" for i, name in enumerate(names)]
    times = [(100 * i + late * (i % 2)) / 1000 for i in range(count)]
    path = tmp_path / "trace.csv"
    path.write_text(table("time,plate,x", [[t, n, 1] for t, n in zip(times, names, strict=True)]))
    code = main(["monitor", SPEC, str(path), *options])
    assert code == (2 if late and order == "alternating" else 0)
    assert main(["watch", SPEC, str(path), *options]) == code
    assert main(["watch", SPEC, str(path), *options, "--one-trace"]) == 0
    assert main(["watch", SPEC, str(path), *options, "--by", "plate"]) == 0


@pytest.mark.parametrize("name", ["test", "case", "unit", "first_run"])
@pytest.mark.parametrize("values", [[1, 1, 2, 2], [1, 2, 1, 2], [0, 1, 0, 1], [3, 3, 3, 3]])
def test_numbered_objects_are_refused_as_in_a_file(
    name: str, values: list[int], tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(table(f"time,{name},x", [[i, value, 1] for i, value in enumerate(values)]))
    code = main(["monitor", SPEC, str(path)])
    assert code == (2 if {*values} == {1, 2} else 0)
    assert main(["watch", SPEC, str(path)]) == code


@pytest.mark.parametrize("count", [9, 90, 300])
@pytest.mark.parametrize("options", [["--dense"], ["--period", "100ms"]])
@pytest.mark.parametrize("ids", [(3, 7), (3, 7, 12), (0, 1), (0.5, 1.5), (3, 3)])
@pytest.mark.parametrize("name", ["zone", "gear"])
def test_numbers_in_turns_are_refused_as_in_a_file(
    name: str, ids: Sequence[float], options: list[str], count: int, tmp_path: Path
) -> None:
    turns = len(ids)
    times = [round(i // turns + 0.1 * (i % turns), 3) for i in range(count)]
    rows = [[time, ids[i % turns], 1] for i, time in enumerate(times)]
    path = tmp_path / "trace.csv"
    path.write_text(table(f"time,{name},x", rows))
    code = main(["monitor", SPEC, str(path), *options])
    assert code == (2 if ids[:2] == (3, 7) and name == "zone" else 0)
    assert main(["watch", SPEC, str(path), *options]) == code
    assert main(["watch", SPEC, str(path), *options, "--one-trace"]) == 0
    assert main(["watch", SPEC, str(path), *options, "--by", name]) == 0


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize(("objects", "column"), [(["P3", "P7"], "plate"), ([3, 7], "zone")])
@pytest.mark.parametrize(("stop", "stopping"), [("violation", -1), ("decided", 1)])
def test_objects_are_looked_for_at_a_stop(
    stop: StreamStop, stopping: int, objects: list[object], column: str, size: int
) -> None:
    """A stop after several rounds is an error; one in the first rows is not."""
    for last, refused in ((3, False), (13, True)):
        rows = [
            [i // 2 + 0.1 * (i % 2), objects[i % 2], stopping if i == last else 1]
            for i in range(20)
        ]
        spec = SPEC if stop == "violation" else f"always[0:{rows[last][0]}](x > 0)"
        reading = EvaluationOptions(dense=True)
        options = WatchOptions({"it": rtamt.parse(spec)}, reading, Columns(), stop=stop)
        stream = play(options, table(f"time,{column},x", rows), size)
        assert stream.watch.stopped
        assert bool(stream.watch.failures) == refused, last
        assert (stream.code == 2) == refused


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize("options", [[], ["--dense"], ["--by", "car"]])
@pytest.mark.parametrize("name", ["vehicle_id", "unit", "plate"])
@pytest.mark.parametrize("order", [(3, 7, 3), (3, 7, 3, 7, 3, 7), (3, 3, 7, 7), (3, 3, 3), (3, 7)])
def test_objects_are_noticed_row_by_row(
    order: Sequence[int], name: str, options: list[str], size: int, tmp_path: Path
) -> None:
    """Lines of a pipe arrive one by one, and rows of groups alternate."""
    letter = "P" if name == "plate" else ""
    rows = [[i, "a", f"{letter}{value}", 1] for i, value in enumerate(order)]
    text = table(f"time,car,{name},x", rows)
    path = tmp_path / "trace.csv"
    path.write_text(text)
    refused = main(["monitor", SPEC, str(path), *options]) == 2
    reading = EvaluationOptions(dense="--dense" in options)
    by = ("car",) if "--by" in options else ()
    settings = WatchOptions({"it": rtamt.parse(SPEC)}, reading, Columns(), by=by)
    assert (play(settings, text, size).code == 2) == refused


def test_variables_with_times_of_their_own(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(table("x_time,x,y_time,y", [[i, 1, 10 * i, 1] for i in range(5)]))
    spec = "always(x > 0 and y > 0)"
    assert main(["monitor", spec, str(path)]) == main(["watch", spec, str(path)]) == 2
    assert "'y' may have its own, 'y_time', next to 'x_time'" in capsys.readouterr().err
    assert main(["watch", spec, str(path), "--time", "x_time"]) == 0
    assert main(["watch", "always(x > 0)", str(path)]) == 0


def test_times_are_not_groups(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n0,1\n1,1\n")
    assert main(["watch", SPEC, str(path), "--by", "time"]) == 2
    assert "expected a column of objects for --by, got 'time'" in capsys.readouterr().err


@pytest.mark.parametrize("size", [1, 9, 10_000])
@pytest.mark.parametrize(
    ("texts", "totals"),
    [
        (["Rome", "Paris", "Rome", "Total"], True),
        (["", "", "", "max"], True),
        (["1", "2", "3", "mean"], True),
        (["low", "high", "low", "max"], False),
        (["Total", "a", "b", "Total"], False),
        (["Total", "mean", "a", "b"], False),
    ],
)
def test_a_row_of_totals_is_refused_as_in_a_file(
    texts: Sequence[str],
    totals: bool,  # noqa: FBT001
    size: int,
    tmp_path: Path,
) -> None:
    text = table("time,town,x", [[i, town, 1] for i, town in enumerate(texts)])
    path = tmp_path / "trace.csv"
    path.write_text(text)
    assert main(["monitor", SPEC, str(path)]) == (2 if totals else 0)
    assert bool(refusal(text, size)) == totals
    assert main(["watch", SPEC, str(path), "--one-trace"]) == 0


@pytest.mark.parametrize(
    ("names", "refused"),
    [(["7", "7.0"], True), (["7.0", "7"], True), (["7", "07"], False), (["a", "Total"], True)],
)
def test_groups_are_refused_as_in_a_file(
    names: Sequence[str],
    refused: bool,  # noqa: FBT001
    tmp_path: Path,
) -> None:
    rows = [[i, names[0], 1] for i in range(3)] + [[3, names[1], 1]]
    path = tmp_path / "trace.csv"
    path.write_text(table("time,car,x", rows))
    for command in ("monitor", "watch"):
        assert main([command, SPEC, str(path), "--by", "car"]) == (2 if refused else 0)


@pytest.mark.parametrize("values", [[None, True, None], [None, True, False], [None, None, True]])
def test_a_flag_that_is_not_written_is_not_set(values: Sequence[object], tmp_path: Path) -> None:
    path = tmp_path / "trace.ndjson"
    rows = [{"time": i, "x": 1, "terminated": value} for i, value in enumerate(values)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    code = 2 if values[1] else 0
    assert main(["monitor", SPEC, str(path)]) == main(["watch", SPEC, str(path)]) == code
