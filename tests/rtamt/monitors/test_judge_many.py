"""Many traces in one call: each row is the judgement of its trace."""

import os
import pickle
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from choices import ENDS, Backend
from hypothesis import given, settings
from hypothesis import strategies as st
from implying import aware, requirements
from interface_cases import Case
from profiles import examples
from strategies import VARIABLES, Trace, formulas, length, traces

from rtamt import (
    BACKEND,
    Formula,
    InputError,
    InputTypeError,
    Judgement,
    ParseError,
    Specification,
    SpecificationError,
    judge,
    judge_many,
)
from rtamt.language.parser import as_specification
from rtamt.machines.protocols import TraceSet
from rtamt.monitors import Judgements
from rtamt.program.lowering import compile_program

NAN = float("nan")


def rows_of(result: Judgements) -> list[tuple[object, ...]]:
    """Return the rows as `row_of` gives them; a robustness by its bits."""
    numbers = np.stack([result.robustness, result.lower, result.upper], axis=1)
    return [
        (
            numbers[i].tobytes(),
            int(result.verdict[i]),
            int(result.complete[i]),
            int(result.decided_at[i]),
            bool(result.vacuous[i]),
            bool(result.never_triggered[i]),
            [
                (t.text, int(t.samples[i]), int(t.count[i]), int(t.first[i]), bool(t.vacuous[i]))
                for t in result.triggers
            ],
        )
        for i in range(len(result))
    ]


def row_of(judged: Judgement) -> tuple[object, ...]:
    decided = judged.decided_at
    return (
        np.array([judged.robustness, judged.lower, judged.upper]).tobytes(),
        int(judged.verdict),
        int(judged.complete),
        -1 if decided is None else decided,
        judged.vacuous,
        judged.never_triggered,
        [
            (t.text, t.samples, t.count, -1 if t.first is None else t.first, t.vacuous)
            for t in judged.triggers
        ],
    )


def joined(batch: Sequence[Trace]) -> dict[str, list[float]]:
    return {name: [x for trace in batch for x in trace[name]] for name in VARIABLES}


def agrees(
    formula: Formula | Specification,
    batch: Sequence[Trace],
    **options: Any,  # noqa: ANN401
) -> None:
    """Check the three forms of traces against `judge`, in all end modes."""
    if not as_specification(formula).variables:
        return  # a trace of such a formula is an array
    sizes = [length(trace) for trace in batch]
    objects = {**joined(batch), "object": np.repeat(np.arange(len(batch)), sizes)}
    shuffled = np.argsort(np.arange(sum(sizes)) * 7919 % 101, kind="stable")
    shuffled = shuffled[
        np.argsort(np.concatenate([np.arange(n) for n in sizes])[shuffled], kind="stable")
    ]
    mixed = {name: np.array(column)[shuffled] for name, column in objects.items()}
    for end in ENDS:
        expected = [row_of(judge(formula, trace, end=end, **options)) for trace in batch]
        assert rows_of(judge_many(formula, batch, end=end, **options)) == expected
        ragged = judge_many(formula, joined(batch), end=end, lengths=sizes, threads=2, **options)
        assert rows_of(ragged) == expected
        assert ragged.samples.tolist() == sizes
        grouped = judge_many(formula, mixed, end=end, by="object", **options)
        order = grouped.keys["object"].tolist()
        assert rows_of(grouped) == [expected[i] for i in order]


batches = st.lists(traces(), min_size=1, max_size=5)


@settings(max_examples=examples(120))
@given(formulas(), batches, st.sampled_from(("native", "python")))
def test_rows_equal_judge(formula: Formula, batch: list[Trace], backend: Backend) -> None:
    agrees(formula, batch, backend=backend)


@settings(max_examples=examples(80))
@given(requirements(), batches)
def test_triggers_equal_judge(formula: Formula, batch: list[Trace]) -> None:
    agrees(formula, batch)


@settings(max_examples=examples(60))
@given(aware(requirements()), batches)
def test_interface_semantics_equal_judge(case: Case, batch: list[Trace]) -> None:
    spec, semantics = case
    agrees(spec, batch, semantics=semantics)


@settings(max_examples=examples(60))
@given(requirements(), batches, st.data())
def test_unknown_samples_equal_judge(
    formula: Formula, batch: list[Trace], data: st.DataObject
) -> None:
    for trace in batch:
        for name in VARIABLES:
            if data.draw(st.booleans()):
                trace[name][data.draw(st.integers(0, len(trace[name]) - 1))] = NAN
    agrees(formula, batch, nan="unknown")


RESPONSE = "always(a > 1 implies eventually[0:2](b > 0))"
FRAME: dict[str, list[Any]] = {
    "car": ["x", "x", "y", "x", "y", "z"],
    "lane": [1, 1, 1, 2, 1, 1],
    "a": [2.0, 0.0, 2.0, 0.0, 0.0, 2.0],
    "b": [1.0, 0.0, -1.0, 0.0, 0.0, 1.0],
}


@pytest.mark.parametrize(
    "text",
    [
        f"reply = {RESPONSE}",
        "raised = eventually[0:1](a > 1)\nalways(b > 0) implies raised",
        "calm = always(a < 3)\nsent = once(a > 1)\ncalm and always(sent implies eventually(b > 0))",
    ],
)
def test_named_formulas(text: str) -> None:
    batch = [{"a": [2.0, 0.0, 2.0], "b": [1.0, 0.0, -1.0]}, {"a": [0.0, 2.0], "b": [1.0, -1.0]}]
    result = judge_many(text, batch)
    assert rows_of(result) == [row_of(judge(text, trace)) for trace in batch]


@pytest.mark.parametrize("frame", [dict, pd.DataFrame, pl.DataFrame, pa.table])
def test_frames_of_groups(frame: Callable[[object], Any]) -> None:
    result = judge_many(RESPONSE, frame(FRAME), end="complete", by=["car", "lane"])
    assert result.keys["car"].tolist() == ["x", "y", "x", "z"]
    assert result.keys["lane"].tolist() == [1, 1, 2, 1]
    assert result.samples.tolist() == [2, 2, 1, 1]
    assert result.verdict.tolist() == [1, -1, 1, 1]
    (triggers,) = result.triggers
    assert triggers.count.tolist() == [1, 1, 0, 1]
    assert triggers.first.tolist() == [0, 0, -1, 0]
    assert result.never_triggered.tolist() == [False, False, True, False]


def test_each_group_has_its_period() -> None:
    spec = "always(a > 1 implies eventually[0:0.2 s](b > 0))"
    rows: dict[str, list[float]] = {
        "o": [1, 1, 1, 1, 2, 2, 2],
        "t": [0, 0.1, 0.2, 0.3, 0, 0.2, 0.4],
        "a": [2, 0, 0, 0, 2, 0, 0],
    }
    rows["b"] = [-1, -1, -1, 1, -1, 1, -1]
    result = judge_many(spec, rows, by="o", time="t", end="complete")
    expected = [
        judge(spec, {n: rows[n][:4] for n in "ab"}, period=0.1, end="complete"),
        judge(spec, {n: rows[n][4:] for n in "ab"}, period=0.2, end="complete"),
    ]
    assert [found.verdict for found in expected] == [-1, 1]
    assert rows_of(result) == [*map(row_of, expected)]


@pytest.mark.parametrize(
    ("times", "error"),
    [
        ([0, 0], "expected times that increase, got 0 s after 0 s; sort the rows by time"),
        ([0, 1, 3], "expected times at even distances, got samples up to 0.5 s off a step of 1.5"),
    ],
)
def test_bad_times_are_an_error_of_their_group(times: list[float], error: str) -> None:
    rows: dict[str, list[float]] = {"o": [1.0] * len(times) + [2.0, 2.0], "t": [*times, 0, 1]}
    rows["a"] = [1] * len(rows["o"])
    with pytest.raises(InputError, match=f"group o=1.0: {error}"):
        judge_many("always[0:1 s](a > 0)", rows, by="o", time="t")
    result = judge_many("always[0:1 s](a > 0)", rows, by="o", time="t", errors="keep")
    assert result.verdict.tolist() == [0, 1]
    assert [*result.errors] == [0]
    assert str(result.errors[0]).startswith(error)
    assert np.isnan(result.robustness[0])


def test_single_row_has_no_period() -> None:
    rows: dict[str, list[float]] = {"o": [1, 1, 2], "t": [0, 0.5, 9], "a": [1, 1, 1]}
    error = "expected two rows or more to read the period from their times"
    with pytest.raises(InputError, match=f"group o=2: {error}"):
        judge_many("always[0:1 s](a > 0)", rows, by="o", time="t")
    result = judge_many("always[0:1 s](a > 0)", rows, by="o", time="t", errors="keep")
    assert rows_of(result)[0] == row_of(judge("always[0:1 s](a > 0)", {"a": [1, 1]}, period=0.5))
    assert [*result.errors] == [1]
    untimed = judge_many("always(a > 0)", rows, by="o", time="t")
    assert untimed.verdict.tolist() == [1, 1]


def test_bound_off_the_period_names_its_group() -> None:
    rows: dict[str, list[float]] = {"o": [1, 1, 2, 2], "t": [0, 0.5, 0, 1], "a": [1, 1, 1, 1]}
    with pytest.raises(ParseError, match=r"^group o=2: STL:1:7: bound 1\.5 s .*") as caught:
        judge_many("always[0:1.5 s](a > 0)", rows, by="o", time="t")
    assert (caught.value.place, caught.value.line) == ("group o=2", 1)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    result = judge_many("always[0:1.5 s](a > 0)", rows, by="o", time="t", errors="keep")
    assert [*result.errors] == [1]


NAMES_OF_ROLES = (
    *("time", "clk", "A", "dt", "date", "agent", "vehicle_id", "run", "step", "terminated"),
    *("is_first", "note", "case", "stamp", "speed"),
)
CELLS = st.one_of(
    *(st.lists(st.integers(0, 2), min_size=12, max_size=12) for _ in range(2)),
    st.lists(st.sampled_from([0.0, 0.25, 0.5, 1.0, NAN]), min_size=12, max_size=12),
    st.lists(st.sampled_from(["a", "b"]), min_size=12, max_size=12),
    st.lists(st.booleans(), min_size=12, max_size=12),
    st.sampled_from(
        [
            [*range(6)] * 2,
            [0, 1, 2] * 4,
            [i * 0.25 for i in range(6)] * 2,
            [0.1] * 12,
            [0, 0, 1, 1, 2, 2] * 2,
            [False, False, True] * 4,
            [True, False, False] * 4,
            ["2024-05-01", "2024-05-02", "2024-05-03"] * 4,
            [20240501, 20240502, 20240503] * 4,
            [*range(5, -1, -1)] * 2,
        ]
    ),
)
SPLITS = ([12], [6, 6], [3, 3, 3, 3], [1, 5, 0, 6], [2, 4, 6])


def outcome(judged: Callable[[], Judgement]) -> object:
    try:
        return row_of(judged())
    except InputError as error:
        return str(error)


@pytest.mark.filterwarnings("ignore:period= leaves the times")
@settings(max_examples=examples(150))
@given(
    st.dictionaries(st.sampled_from(NAMES_OF_ROLES), CELLS, max_size=3),
    st.sampled_from(("always[0:1](a > 0)", "always(rate(a) < 1)", "always(a > 0)")),
    st.sampled_from(SPLITS),
    st.sampled_from((None, 1, 0.5)),
    st.sampled_from((pd.DataFrame, pl.DataFrame, pa.table)),
    st.permutations(range(12)),
)
def test_frames_are_refused_as_judge_refuses_each(
    columns: dict[str, list[Any]],
    spec: str,
    lengths: list[int],
    period: float | None,
    make: Callable[[object], Any],
    places: list[int],
) -> None:
    rows: dict[str, list[Any]] = {**columns, "a": [1.0, 3.0, -1.0] * 4}
    ends = np.cumsum(lengths)

    def part(i: int) -> dict[str, list[Any]]:
        return {n: c[ends[i] - lengths[i] : ends[i]] for n, c in rows.items()}

    options: dict[str, Any] = {"period": period, "errors": "keep"}
    result = judge_many(spec, make(rows), lengths=lengths, **options)
    judged = [
        outcome(lambda i=i: judge(spec, make(part(i)), period=period))  # type: ignore[misc]
        for i in range(len(lengths))
    ]
    assert [result.errors.get(i) and str(result.errors[i]) for i in range(len(lengths))] == [
        row if isinstance(row, str) else None for row in judged
    ]
    for i, row in enumerate(judged):
        assert isinstance(row, str) or rows_of(result)[i] == row
    # The rows of a group need not be adjacent.
    keys = np.repeat(np.arange(len(lengths)), lengths)
    slots = np.empty(12, int)  # shuffle the objects, but keep the rows of each in order
    slots[np.argsort(keys[places], kind="stable")] = range(12)
    mixed: dict[str, list[Any]] = {**rows, "o": keys.tolist()}
    mixed = {n: [c[i] for i in slots] for n, c in mixed.items()}
    grouped = judge_many(spec, make(mixed), by="o", **options)
    for i, key in enumerate(grouped.keys["o"].tolist()):
        mine = {
            n: [x for x, k in zip(c, mixed["o"], strict=True) if k == key] for n, c in mixed.items()
        }
        row = outcome(lambda mine=mine: judge(spec, make(mine), period=period))  # type: ignore[misc]
        if isinstance(row, str):
            assert str(grouped.errors[i]) == row
        else:
            assert i not in grouped.errors
            assert rows_of(grouped)[i] == row


@pytest.mark.parametrize("options", [{"time": "time"}, {"period": 1}, {"lengths": [4, 2]}])
def test_group_of_several_objects_is_an_error(options: dict[str, Any]) -> None:
    frame = pd.DataFrame(
        {
            "run": [1, 1, 1, 1, 2, 2],
            "time": [0.0, 1, 2, 3, 0, 1],
            "agent": ["a", "a", "b", "b", "a", "a"],
            "a": [1.0, 20, 20, 4, 1, 1],
        }
    )
    spec = "always(eventually[0:1](a < 13))"
    options = {**options, **({"period": 1} if "lengths" in options else {"by": "run"})}
    match = r"^(group run=1|trace 0): expected one trace, .* 'agent' with 2 values \(a, b\)"
    with pytest.raises(InputError, match=match):
        judge_many(spec, frame, **options)
    result = judge_many(spec, frame, **options, errors="keep")
    assert [*result.errors] == [0]
    assert np.isnan(result.robustness[0])
    assert result.verdict.tolist() == [0, 1]
    assert result.samples.tolist() == [4, 2]


def test_errors_are_kept_by_trace() -> None:
    batch: list[Any] = [{"a": [1.0, 2.0]}, {"a": [NAN]}, {"a": []}, {"b": [1.0]}, {"a": [-1.0]}]
    result = judge_many("always(a > 0)", batch, errors="keep")
    assert result.verdict.tolist() == [1, 0, 0, 0, -1]
    for place in (1, 2, 3):
        with pytest.raises(type(result.errors[place])) as error:
            judge("always(a > 0)", batch[place])
        assert str(error.value) == str(result.errors[place])
    with pytest.raises(InputError, match=r"^trace 1: variable 'a' is nan at sample 0"):
        judge_many("always(a > 0)", batch)
    ragged = judge_many("always(a > 0)", {"a": [1, NAN, -1]}, lengths=[1, 1, 0, 1], errors="keep")
    assert ragged.verdict.tolist() == [1, 0, 0, -1]
    assert [*ragged.errors] == [1, 2]


def test_held_values_stay_in_their_trace() -> None:
    values = {"a": [1.0, NAN, NAN, 1.0]}
    result = judge_many("always(a > 0)", values, lengths=[2, 2], nan="hold", errors="keep")
    assert result.verdict.tolist() == [1, 0]
    assert "the first sample has none" in str(result.errors[1])


def test_rates_start_again_in_each_trace() -> None:
    spec = "always(rate(a) < 5)"
    values = [0.0, 1.0, 50.0, 51.0, NAN, 60.0]
    result = judge_many(
        spec, {"a": values}, lengths=[2, 2, 2], period=1, nan="unknown", errors="keep"
    )
    expected = [judge(spec, {"a": values[i : i + 2]}, period=1, nan="unknown") for i in (0, 2, 4)]
    assert rows_of(result) == [*map(row_of, expected)]
    assert result.verdict.tolist() == [1, 1, 0]


def test_long_traces_equal_judge() -> None:
    rng = np.random.default_rng(1)
    sizes = [9000, 3, 8192, 8193]
    columns = {name: rng.normal(size=sum(sizes)) for name in "ab"}
    ends = np.cumsum(sizes)
    expected = [
        row_of(judge(RESPONSE, {n: c[end - size : end] for n, c in columns.items()}))
        for size, end in zip(sizes, ends, strict=True)
    ]
    assert rows_of(judge_many(RESPONSE, columns, lengths=sizes)) == expected


def test_left_sides_that_look_ahead_equal_judge() -> None:
    spec = "always(eventually[1:2](a > 1) implies b > 0)"
    batch = [{"a": FRAME["a"][i:], "b": FRAME["b"][i:]} for i in range(5)]
    assert rows_of(judge_many(spec, batch)) == [row_of(judge(spec, trace)) for trace in batch]


def test_named_formulas_equal_judge() -> None:
    spec = "answer = eventually[0:1](b > 0)\nanswered = always(a > 1 implies answer)"
    batch = [{"a": FRAME["a"][i:], "b": FRAME["b"][i:]} for i in range(5)]
    for end in ENDS:
        expected = [row_of(judge(spec, trace, end=end)) for trace in batch]
        assert rows_of(judge_many(spec, batch, end=end)) == expected


def test_an_iterator_is_read_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtamt.monitors.many._CHUNK", 5)
    alive = 0

    def runs() -> Iterator[dict[str, object]]:
        nonlocal alive
        for i in range(9):
            alive = i
            yield {"a": np.arange(i, i + 2.0), "name": f"run {i}"}

    result = judge_many("always(a > 3)", runs())
    assert alive == 8
    assert result.robustness.tolist() == [i - 3.0 for i in range(9)]


def test_no_traces() -> None:
    for result in (
        judge_many(RESPONSE, []),
        judge_many(RESPONSE, {"a": [], "b": []}, lengths=[]),
        judge_many(RESPONSE, {"o": [], "a": [], "b": []}, by="o"),
        judge_many(RESPONSE, {"o": [], "t": [], "a": [], "b": []}, by="o", time="t"),
    ):
        assert len(result) == len(result.triggers[0].count) == 0


def test_formulas_without_variables_count_samples() -> None:
    result = judge_many("eventually[0:2](true) and next true", np.zeros((4, 0)), lengths=[1, 3])
    expected = [judge("eventually[0:2](true) and next true", np.zeros((n, 0))) for n in (1, 3)]
    assert rows_of(result) == [*map(row_of, expected)]


@pytest.mark.parametrize(
    ("traces_", "options", "error"),
    [
        ({"a": [1, 2]}, {}, "expected an iterable of traces, got dict"),
        (pd.DataFrame({"a": [1]}), {}, "pass by= for a table of several objects"),
        (
            {"a": [1, 2]},
            {"lengths": [1]},
            "lengths with the sum 2, the samples of the columns, got 1",
        ),
        ({"a": [1, 2]}, {"lengths": [3, -1]}, "expected lengths of 0 or more, got -1"),
        ({"a": [1, 2]}, {"lengths": [1.0, 1.0]}, "a whole number of samples per trace"),
        ({"a": [1, 2]}, {"lengths": [2], "by": "a"}, "expected by= or lengths=, got both"),
        ({"a": [1, 2]}, {"by": "car"}, "No column 'car'"),
        ({"a": [1], "o": [None]}, {"by": "o"}, "a value of the key column 'o' in every row"),
        ({"a": [1], "o": [1]}, {"by": "o", "time": "t"}, "No column 't'"),
        ({"a": [1]}, {"lengths": [1], "time": "t"}, "expected by=, the columns that identify"),
        ([], {"threads": 0}, "expected a positive number of threads, got 0"),
        ([], {"errors": "ignore"}, "expected errors='raise' or 'keep'"),
    ],
)
def test_arguments_are_checked(traces_: object, options: dict[str, Any], error: str) -> None:
    with pytest.raises((InputError, InputTypeError), match=error):
        judge_many("always(a > 0)", cast("Any", traces_), **options)


def test_a_frame_with_times_needs_a_period() -> None:
    frame = pd.DataFrame({"time": [0, 1], "o": [1, 1], "a": [1, 1]})
    with pytest.raises(InputError, match="expected a period"):
        judge_many("always[0:1](a > 0)", frame, by="o")
    with pytest.raises(SpecificationError):
        judge_many("always[0:1 s](a > 0)", frame, by="o")
    assert judge_many("always[0:1](a > 0)", frame, by="o", time="time").verdict.tolist() == [1]


def test_the_arrow_table_has_a_row_per_trace() -> None:
    rows = {"o": ["x", "y", "z"], "a": [2.0, NAN, 2.0], "b": [1.0, 1.0, -1.0]}
    result = judge_many(RESPONSE, rows, by="o", end="complete", errors="keep")
    table = pa.table(result)
    assert table.equals(result.table())
    assert table.column_names[:3] == ["o", "samples", "verdict"]
    assert table["verdict"].to_pylist() == ["SATISFIED", None, "VIOLATED"]
    assert table["robustness"].to_pylist() == [1.0, None, -1.0]
    assert table["decided_at"].to_pylist() == [None, None, None]
    assert table["triggers[0]"].to_pylist() == [1, None, 1]
    assert table["error"].to_pylist()[0] is None
    assert "variable 'a' is nan" in table["error"].to_pylist()[1]
    assert repr(result) == (
        "<Judgements of 3 traces: 1 violated, 1 satisfied, 0 undecided, 1 errors, end='complete'>"
    )


@pytest.mark.skipif(BACKEND == "python", reason="no compiler was at hand")
def test_other_threads_run_meanwhile() -> None:
    """Without a switch of threads by time, another one runs only if the call lets it."""
    from rtamt.machines.native import judge_traces

    n = 1_000_000
    spec, zeros = as_specification(RESPONSE), np.zeros(n)
    program = compile_program(spec, None)
    traces_ = TraceSet([zeros, zeros], np.arange(0, n, 1_000), np.full(n // 1_000, 1_000))
    turns, done, started = 0, threading.Event(), threading.Event()

    def count() -> None:
        nonlocal turns
        while not done.is_set():
            turns += 1
            started.set()
            os.sched_yield()

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=count)
    sys.setswitchinterval(1_000)
    try:
        thread.start()
        started.wait()
        before = turns
        judge_traces(program, traces_, "cut", 1)
        after = turns
    finally:
        done.set()
        sys.setswitchinterval(interval)
        thread.join()
    assert after > before


def test_two_rows_with_a_step_or_a_gap() -> None:
    times = [0.0, 5.0, 0.0, 1.0, 2.0, 0.0, 1.0]
    rows: dict[str, list[float]] = {"o": [1, 1, 2, 2, 2, 3, 3], "t": times, "a": [1.0] * 7}
    spec = "always[0:5 s](a > 0)"
    with pytest.raises(InputError, match="two rows 5 s apart, which may be a step or a gap"):
        judge_many(spec, rows, by="o", time="t")
    result = judge_many(spec, rows, by="o", time="t", end="complete", errors="keep")
    assert [*result.errors] == [0]
    alone = {name: column[:2] for name, column in rows.items()}
    assert judge_many(spec, alone, by="o", time="t", end="complete").verdict.tolist() == [1]
