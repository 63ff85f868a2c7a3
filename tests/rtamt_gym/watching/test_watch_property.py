"""For any pieces, the lines of a stream equal a monitor, and its end equals the complete file."""

import json
import math
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from fractions import Fraction
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import strategies
from hypothesis import given, settings
from hypothesis import strategies as st
from played import play
from profiles import examples

import rtamt
from rtamt.typing import End
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns, Missing
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.watch import WatchOptions

Kind = Literal["csv", "ndjson"]
Trace = strategies.Trace

PERIODS = {"0.5": Fraction(1, 2), "1": Fraction(1), "100ms": Fraction(1, 10)}

times = st.lists(st.integers(1, 5), min_size=12, max_size=12)
cuts = st.lists(st.integers(0, 400), max_size=8)
ends = st.sampled_from(("cut", "complete", "open"))


def text_of(kind: Kind, rows: Sequence[dict[str, float]]) -> bytes:
    if kind == "ndjson":
        return "".join(json.dumps(row) + "\n" for row in rows).encode()
    lines = [",".join(rows[0]), *(",".join(map(repr, row.values())) for row in rows)]
    return "\n".join(lines).encode()


def played(options: WatchOptions, text: bytes, places: Sequence[int]) -> tuple[list[Line], int]:
    """The lines of a stream in pieces, some of them empty, and its exit code."""
    stream = play(options, text, places)
    assert (stream.error, stream.watch.failures) == ("", [])
    return stream.lines, stream.code


def monitored(arguments: Sequence[str], text: bytes, kind: Kind) -> tuple[int, dict[str, Any]]:
    """Return the exit code of `rtamt monitor` on the complete input, and its outcome."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"trace.{kind}"
        path.write_bytes(text)
        output = StringIO()
        with redirect_stdout(output), redirect_stderr(StringIO()):
            code = main(["monitor", *arguments, str(path), "--json"])
    ((outcome,),) = [
        [*trial["outcomes"].values()] for trial in json.loads(output.getvalue())["trials"]
    ]
    return code, outcome


def spec_of(formula: rtamt.Formula) -> rtamt.Specification:
    """A requirement with future operators in every part that reads a variable."""
    spec = rtamt.parse(str(formula))
    text = str(formula) if spec.variables else f"({formula}) or a > 9"
    spec = rtamt.parse(text)
    try:
        return viewed(spec, "episode")
    except rtamt.SpecificationError:
        return rtamt.parse(f"always({text})")


def number(value: float | str | None) -> float:
    return math.nan if value is None else float(value)


def same(line: Line, robustness: float, lower: float, upper: float, verdict: rtamt.Verdict) -> None:
    got = [line.robustness, line.lower, line.upper]
    assert [*map(repr, got)] == [*map(repr, [robustness, lower, upper])]
    assert line.verdict is verdict


@settings(max_examples=examples(50))
@given(
    strategies.formulas(endless=True),
    strategies.traces(least=2),
    st.sampled_from(("csv", "ndjson")),
    st.sampled_from(sorted(PERIODS)),
    st.booleans(),
    ends,
    cuts,
)
def test_sampled_lines_equal_the_episode_monitor(
    formula: rtamt.Formula,
    trace: Trace,
    kind: Kind,
    period: str,
    stated: bool,  # noqa: FBT001 - drawn
    end: End,
    places: list[int],
) -> None:
    seconds = PERIODS[period]
    rows = [
        {"time": float(i * seconds), **strategies.sample(trace, i)}
        for i in range(strategies.length(trace))
    ]
    text = text_of(kind, rows)
    # Bounds of a parsed formula are in seconds; bounds that no period divides are rounded.
    spec = spec_of(formula)
    reading = EvaluationOptions(end=end, align="nearest", period=period if stated else None)
    options = WatchOptions({"it": spec}, reading, Columns(), every=True)
    try:
        monitor = rtamt.EpisodeMonitor(spec, seconds, align="nearest")
    except rtamt.SpecificationError:
        return
    lines, code = played(options, text, places)
    *live, final = lines
    for i, (row, line) in enumerate(zip(rows, live, strict=True)):
        monitor.update({name: row[name] for name in monitor.variables})
        same(line, monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)
        assert (line.sample, line.time, line.final) == (i, row["time"], False)
    monitor.finish(end)
    same(final, monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)
    assert (final.final, final.end) == (True, end)
    changes = WatchOptions({"it": spec}, reading, Columns())
    few, few_code = played(changes, text, places)
    assert few == [
        line
        for before, line in zip([None, *live], live, strict=False)
        if before is None or before.verdict is not line.verdict
    ] + [final]
    arguments = [f"it = {spec.formula}", "--end", end, "--align", "nearest"]
    monitor_code, outcome = monitored(
        [*arguments, *(["--period", period] if stated else [])], text, kind
    )
    assert code == few_code == monitor_code
    assert outcome["verdict"] == final.verdict.name
    values = [number(outcome[name]) for name in ("robustness", "lower", "upper")]
    assert values == [final.robustness, final.lower, final.upper]


@settings(max_examples=examples(40))
@given(
    strategies.formulas(endless=True, dense=True),
    strategies.traces(least=2),
    times,
    st.sampled_from(("csv", "ndjson")),
    ends,
    cuts,
)
def test_dense_lines_equal_the_episode_monitor(
    formula: rtamt.Formula,
    trace: Trace,
    steps: list[int],
    kind: Kind,
    end: End,
    places: list[int],
) -> None:
    rows = [
        {"time": sum(steps[:i]) / 4, **strategies.sample(trace, i)}
        for i in range(strategies.length(trace))
    ]
    text = text_of(kind, rows)
    spec = spec_of(formula)
    reading = EvaluationOptions(end=end, dense=True)
    lines, code = played(WatchOptions({"it": spec}, reading, Columns(), every=True), text, places)
    *live, final = lines
    monitor = rtamt.dense.EpisodeMonitor(spec)
    for row, line in zip(rows, live, strict=True):
        monitor.update({name: [(row["time"], row[name])] for name in monitor.variables})
        same(line, monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)
        assert line.time == row["time"]
        if line.verdict:
            assert line.decided_at == monitor.decided_at
    monitor.finish(end)
    same(final, monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)
    monitor_code, outcome = monitored([f"it = {spec.formula}", "--end", end, "--dense"], text, kind)
    assert code == monitor_code
    assert outcome["verdict"] == final.verdict.name
    values = [number(outcome[name]) for name in ("robustness", "lower", "upper")]
    assert values == [final.robustness, final.lower, final.upper]


CELLS = ("0.5", "1", "2.25", "-1", "", "x", "nan", "1e1", '"1"', '"1', "1,0", "True", "12.500")
lines_of_text = st.lists(
    st.one_of(
        st.tuples(st.integers(0, 9), st.sampled_from(CELLS), st.sampled_from(CELLS)).map(
            lambda row: f"{row[0]}.0,{row[1]},{row[2]}"
        ),
        st.sampled_from(("", "1.0", "a,b,c,d", "1.0,1,1,", "\ufeff", "# comment")),
    ),
    max_size=8,
)


@settings(max_examples=examples(200))
@given(
    lines_of_text,
    st.booleans(),
    st.sampled_from(("\n", "\r\n")),
    st.sampled_from(("raise", "hold", "drop", "unknown")),
    st.sampled_from((None, "1")),
    st.booleans(),
    st.booleans(),
    cuts,
)
def test_no_cut_changes_what_becomes_of_a_damaged_stream(
    tail: list[str],
    regular: bool,  # noqa: FBT001 - drawn
    end: str,
    missing: Missing,
    period: str | None,
    skip_bad: bool,  # noqa: FBT001 - drawn
    dense: bool,  # noqa: FBT001 - drawn
    places: list[int],
) -> None:
    begin = ["time,x,y", *(["0.0,1.5,1.5", "1.0,1,1"] if regular else [])]
    text = end.join([*begin, *tail]).encode()
    specs = {"it": rtamt.parse("always(x < 2 implies eventually[0:2](y < 2))")}
    reading = EvaluationOptions(dense=dense, period=None if dense else period)
    options = WatchOptions(specs, reading, Columns(missing=missing), every=True, skip_bad=skip_bad)

    def outcome(places: Sequence[int]) -> tuple[list[str], str, int]:
        stream = play(options, text, places)
        return [line.to_json() for line in stream.lines], stream.error, stream.code

    assert outcome(places) == outcome([])


@settings(max_examples=examples(60))
@given(
    st.sampled_from(
        (
            "always(a < 2 implies eventually[0:1](b > 1))",
            "eventually(b > 3) and always(a > -6)",
            "always[0:2](a + b > -8)",
            "historically(a > -9) or eventually(b > 2)",
            "always(a > 1) until b > 2",
        )
    ),
    st.lists(
        st.tuples(
            st.integers(0, 3),
            st.sampled_from((None, 0.5, 2.5, -5.0)),
            st.sampled_from((None, 1.5, 4.0, -3.0)),
        ),
        min_size=1,
        max_size=8,
    ),
    ends,
    st.sampled_from(("raise", "drop", "unknown")),
    cuts,
)
def test_events_at_their_own_pace_end_as_in_a_file(
    text: str,
    drawn: list[tuple[int, float | None, float | None]],
    end: End,
    missing: Missing,
    places: list[int],
) -> None:
    """Empty cells are not events, variables start late, and some rows share an instant."""
    time, rows = 0.0, ["time,a,b"]
    for step, a, b in drawn:
        time += step / 4
        rows.append(f"{time},{'' if a is None else a},{'' if b is None else b}")
    stream = "\n".join(rows).encode()
    spec = rtamt.parse(text)
    options = WatchOptions(
        {"it": spec if spec.looks_ahead else spec.always()},
        EvaluationOptions(end=end, dense=True),
        Columns(missing=missing),
    )
    played_stream = play(options, stream, places)
    requirement = f"it = {options.specs['it'].formula}"
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trace.csv"
        path.write_bytes(stream)
        output = StringIO()
        arguments = [requirement, "--end", end, "--dense", "--missing", missing, str(path)]
        with redirect_stdout(output), redirect_stderr(StringIO()):
            code = main(["monitor", *arguments, "--json"])
    if code == 2:
        assert played_stream.error or played_stream.watch.failures
        return
    assert not played_stream.error
    assert played_stream.code == code
    final = played_stream.lines[-1]
    (trial,) = json.loads(output.getvalue())["trials"]
    (outcome,) = trial["outcomes"].values()
    values = [number(outcome[name]) for name in ("robustness", "lower", "upper")]
    assert outcome["verdict"] == final.verdict.name
    assert [*map(repr, values)] == [*map(repr, [final.robustness, final.lower, final.upper])]
