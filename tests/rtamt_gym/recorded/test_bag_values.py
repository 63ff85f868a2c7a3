"""What is judged of a bag is what its messages say at each time, found a second time by hand."""

from __future__ import annotations

import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from bags import START, Said, twist, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import judge
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import EventTrace, Trace

SPEC = rtamt.parse("""
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry
    input Twist cmd
    input Odometry odom
    @ topic(cmd, robot0/cmd_vel)
    @ topic(odom, /robot0/odom)
    follows = always(cmd.linear.x > 0.5 implies eventually[0:2](odom.twist.twist.linear.x > 0.4))
""")
SPEED = "odom.twist.twist.linear.x"

Events = list[tuple[int, float]]


def odometry(time: int, speed: float, stamp: int) -> Said:
    header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
    fields = {"header": header, "twist": {"twist": {"linear": {"x": speed}}}}
    return Said(time, "/robot0/odom", "nav_msgs/Odometry", fields)


def events() -> st.SearchStrategy[Events]:
    """Times of recording in nanoseconds since the start, which rise, and values."""
    gaps = st.lists(st.integers(1, 2_000_000_000), min_size=1, max_size=12)
    return gaps.flatmap(
        lambda steps: st.lists(st.floats(-2, 2), min_size=len(steps), max_size=len(steps)).map(
            lambda values: list(zip(np.cumsum(steps).tolist(), values, strict=True))
        )
    )


def held(found: Events, time: Fraction) -> float:
    """The value of the last event at a time or before."""
    return [value for at, value in found if at <= time][-1]


def written(folder: str, extension: str, commands: Events, speeds: Events, delay: int = 0) -> str:
    """A bag; what the odometry says was so `delay` before it was recorded."""
    said = [twist(START + t, x) for t, x in commands]
    said += [odometry(START + t, x, START + t - delay) for t, x in speeds]
    path = Path(folder) / f"run{extension}"
    return str(write_bag(path, sorted(said, key=lambda each: each.time)))


@pytest.mark.parametrize("extension", [".mcap", ".db3", ".bag", ""])
@settings(max_examples=examples(6), deadline=None)
@given(commands=events(), speeds=events(), period=st.sampled_from(["1/10", "1/3", "7/10"]))
def test_samples_hold_last_message(
    extension: str, commands: Events, speeds: Events, period: str
) -> None:
    step = Fraction(period)
    begin = min(commands[0][0], speeds[0][0])
    first, end = max(commands[0][0], speeds[0][0]), max(commands[-1][0], speeds[-1][0])
    places, place = [], Fraction(begin)
    while place <= end:
        places.append(place)
        place += step * 10**9
    known = [place for place in places if place >= first]
    with tempfile.TemporaryDirectory() as folder:
        path = written(folder, extension, commands, speeds)
        known_columns = Columns(start="known")
        trace, used = read_ruled(path, {"": SPEC}, EvaluationOptions(period=step), known_columns)
    assert isinstance(trace, Trace)
    if not known:
        with pytest.raises(rtamt.InputError, match="expected a sample with a value of"):
            judge(SPEC, trace, used, EvaluationOptions(period=step, align="nearest"))
        return
    expected = {
        "cmd.linear.x": [held(commands, place) for place in known],
        SPEED: [held(speeds, place) for place in known],
    }
    columns = {name: column[-len(known) :] for name, column in trace.columns.items()}
    assert {name: column.tolist() for name, column in columns.items()} == expected
    assert trace.samples == len(places)
    assert (used, trace.period()) == (step, step if len(places) > 1 else None)
    assert (trace.start, trace.epoch) == (0.0, START + begin)
    found = judge(SPEC, trace, used, EvaluationOptions(period=step, align="nearest"))
    judged = rtamt.judge(SPEC, expected, step, "cut", align="nearest")
    assert (found.verdict, found.found.robustness) == (judged.verdict, judged.robustness)
    robustness = rtamt.evaluate(SPEC, expected, step, align="nearest")
    assert found.series["follows"].values.tolist() == robustness.tolist()


@pytest.mark.parametrize("extension", [".mcap", ".bag"])
@settings(max_examples=examples(6), deadline=None)
@given(commands=events(), speeds=events())
def test_events_hold_to_bag_end(extension: str, commands: Events, speeds: Events) -> None:
    rules = EvaluationOptions(dense=True)
    with tempfile.TemporaryDirectory() as folder:
        path = written(folder, extension, commands, speeds)
        trace, _ = read_ruled(path, {"": SPEC}, rules, Columns(start="known"))
    assert isinstance(trace, EventTrace)
    begin = min(commands[0][0], speeds[0][0])
    end = max(commands[-1][0], speeds[-1][0])
    signals = {}
    for name, found in (("cmd.linear.x", commands), (SPEED, speeds)):
        rows = found + ([(end, found[-1][1])] if found[-1][0] < end else [])
        signals[name] = [((at - begin) / 1e9, value) for at, value in rows]
    assert {
        n: list(zip(*map(np.ndarray.tolist, e), strict=True)) for n, e in trace.signals.items()
    } == signals
    whole = judge(SPEC, trace, None, rules)
    expected = rtamt.dense.judge(SPEC, signals, "cut")
    assert (whole.verdict, whole.found.robustness) == (expected.verdict, expected.robustness)


@settings(max_examples=examples(6), deadline=None)
@given(commands=events(), speeds=events(), delay=st.integers(0, 3_000_000_000))
def test_header_stamps_option(commands: Events, speeds: Events, delay: int) -> None:
    columns = Columns(time="header")
    with tempfile.TemporaryDirectory() as folder:
        path = written(folder, ".mcap", commands, speeds, delay)
        trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(dense=True), columns)
    assert isinstance(trace, EventTrace)
    earlier = [(at - delay, value) for at, value in speeds]
    begin = min(commands[0][0], earlier[0][0])
    end = max(commands[-1][0], earlier[-1][0])
    times = [(at - begin) / 1e9 for at, _ in earlier]
    times += [(end - begin) / 1e9] * (earlier[-1][0] < end)
    assert trace.signals[SPEED][0].tolist() == times
    assert trace.notes[0] == "/robot0/cmd_vel has no stamps: its times are when it was recorded"


def test_requirements_start_with_their_topics(tmp_path: Path) -> None:
    said = [twist(START + i * 10**8, 1.0 if i else 3.0) for i in range(40)]
    said += [odometry(START + i * 10**8 + 7, 2.0, START) for i in range(20, 40)]
    path = str(write_bag(tmp_path / "run.mcap", sorted(said, key=lambda each: each.time)))
    text = SPEC.text.rpartition("follows")[0]
    specs = {
        "early": rtamt.parse(f"{text} always(cmd.linear.x < 2)"),
        "late": rtamt.parse(f"{text} always({SPEED} > cmd.linear.x)"),
        "never": rtamt.parse(f"{text} always({SPEED} > 0)"),
    }
    rules = EvaluationOptions(period=Fraction(1, 10))
    trace, period = read_ruled(path, specs, rules, Columns())
    assert isinstance(trace, Trace)
    assert (trace.samples, trace.start, trace.known_from) == (40, 0.0, {SPEED: 21})
    found = {name: judge(spec, trace, period, rules) for name, spec in specs.items()}
    assert {name: each.verdict.name for name, each in found.items()} == {
        "early": "VIOLATED",  # by its first sample, before the odometry began
        "late": "UNDECIDED",  # the odometry is unknown before
        "never": "SATISFIED",
    }
    assert [each.start for each in found.values()] == [0.0, 0.0, 2.1]
    assert [len(each.series["(result)"].values) for each in found.values()] == [40, 19, 19]
    alone, _ = read_ruled(path, {"late": specs["late"]}, rules, Columns())
    assert isinstance(alone, Trace)
    assert (alone.start, alone.samples, alone.known_from) == (0.0, 40, {SPEED: 21})
    dense, _ = read_ruled(path, specs, EvaluationOptions(dense=True), Columns())
    assert isinstance(dense, EventTrace)
    events = {name: judge(spec, dense, None, rules).verdict for name, spec in specs.items()}
    assert events == {name: each.verdict for name, each in found.items()}
    coarse = EvaluationOptions(period=Fraction(3))
    trace, period = read_ruled(path, specs, coarse, Columns())
    assert isinstance(trace, Trace)
    assert trace.samples == 2
    coarse = EvaluationOptions(period=Fraction(5))
    trace, period = read_ruled(path, specs, coarse, Columns())
    assert isinstance(trace, Trace)
    with pytest.raises(rtamt.InputError) as caught:
        judge(specs["late"], trace, period, coarse)
    assert str(caught.value) == (
        f"{path}: expected a sample with a value of '{SPEED}', got none: its first comes after "
        "the last sample"
    )


def test_of_messages_at_one_time_the_last_counts(tmp_path: Path) -> None:
    said = [twist(START, 1.0), twist(START + 10**9, 2.0), twist(START + 10**9, 3.0)]
    path = str(write_bag(tmp_path / "run.mcap", [*said, twist(START + 2 * 10**9, 4.0)]))
    spec = rtamt.parse(
        "from geometry_msgs.msg import Twist; input Twist cmd; @ topic(cmd, robot0/cmd_vel);"
        "cmd.linear.x > 0"
    )
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1)), Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["cmd.linear.x"].tolist() == [1.0, 3.0, 4.0]
    dense, _ = read_ruled(path, {"": spec}, EvaluationOptions(dense=True), Columns())
    assert isinstance(dense, EventTrace)
    assert dense.tables["cmd.linear.x"].tolist() == [[0.0, 1.0], [1.0, 3.0], [2.0, 4.0]]


def stamped(tmp_path: Path, stamps: list[float], since: int = START) -> str:
    """A bag of odometry whose speeds are 0, 1, 2 ... with such stamps, in seconds."""
    said = [
        odometry(START + i * 10**8, float(i), since + round(stamp * 1e9))
        for i, stamp in enumerate(stamps)
    ]
    return str(write_bag(tmp_path / "run.mcap", said))


ODOM = rtamt.parse(
    "from nav_msgs.msg import Odometry; input Odometry odom; @ topic(odom, /robot0/odom);"
    "odom.twist.twist.linear.x >= 0"
)


def test_late_messages_are_counted(tmp_path: Path) -> None:
    path = stamped(tmp_path, [0.0, 0.2, 0.1, 0.3, 0.25, 0.4])
    trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert isinstance(trace, EventTrace)
    assert trace.tables[SPEED].tolist() == [[0.0, 0.0], [0.2, 1.0], [0.3, 3.0], [0.4, 5.0]]
    assert [*trace.notes] == ["/robot0/odom: 2 messages older than the one before left out"]


def test_a_clock_that_begins_anew_is_refused(tmp_path: Path) -> None:
    path = stamped(tmp_path, [5.0, 5.1, 5.2, 0.0, 0.1])
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert str(caught.value) == (
        f"{path}: expected stamps of /robot0/odom that increase, got one that is 5.2 s older than "
        "the one before it, in message 4 of 5: the clock restarted; cut the bag there, or give "
        "--time log"
    )


def test_a_stray_stamp_is_left_out_with_a_note(tmp_path: Path) -> None:
    for stray in (7.0, 3600.0, -5.0):
        path = stamped(tmp_path, [0.0, 0.1, stray, 0.3, 0.4])
        columns = Columns(time="header")
        trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), columns)
        assert isinstance(trace, EventTrace)
        assert trace.tables[SPEED].tolist() == [[0.0, 0.0], [0.1, 1.0], [0.3, 3.0], [0.4, 4.0]]
        (note,) = trace.notes
        assert note.startswith("/robot0/odom: 1 message left out, more than 1 s out of line")
        Path(path).unlink()


def test_clock_jump_error_and_ahead_note(tmp_path: Path) -> None:
    path = stamped(tmp_path, [0.0, 0.1, 7.2, 7.3, 7.4])
    with pytest.raises(rtamt.InputError, match="jumps ahead of the recording by 7 s, in message 3"):
        read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    Path(path).unlink()
    path = stamped(tmp_path, [0.3, 0.4, 0.5])
    trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert [*trace.notes] == ["/robot0/odom: 3 stamps up to 0.3 s ahead of the recording"]


def test_stamps_of_a_faster_clock_are_refused(tmp_path: Path) -> None:
    path = stamped(tmp_path, [2.0 * n for n in range(8)])
    with pytest.raises(rtamt.InputError, match="7 messages of 8 out of line; give --time log"):
        read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))


def test_simulated_stamps_do_not_mix_with_log_times(
    tmp_path: Path,
) -> None:
    path = stamped(tmp_path, [i / 8 for i in range(9)], since=0)
    trace, _ = read_ruled(path, {"": ODOM}, EvaluationOptions(dense=True), Columns(time="header"))
    assert isinstance(trace, EventTrace)
    assert trace.tables[SPEED].tolist()[:3] == [[0.0, 0.0], [0.125, 1.0], [0.25, 2.0]]
    assert abs(trace.epoch - START) < 10**9
    both = write_bag(
        tmp_path / "both.mcap",
        [twist(START, 1.0), odometry(START + 1, 1.0, 10**9), odometry(START + 2, 1.0, 2 * 10**9)],
    )
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(str(both), {"": SPEC}, EvaluationOptions(dense=True), Columns(time="header"))
    assert str(caught.value) == (
        f"{both}: expected times of one clock, got /robot0/cmd_vel and /robot0/odom, which are "
        "1.7e+09 s apart; give --time log"
    )


def test_what_was_held_for_long_is_said(tmp_path: Path) -> None:
    said = [twist(START + i * 10**8, 1.0) for i in range(10, 100)]
    said += [odometry(START + i * 10**8, 1.0, START) for i in [*range(20), *range(50, 60)]]
    path = str(write_bag(tmp_path / "run.bag", sorted(said, key=lambda each: each.time)))
    trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(period=Fraction(1, 10)), Columns())
    assert [*trace.notes] == [
        "/robot0/odom: the message at 5.9 s is held for 4 s, to the end",
    ]
    path = str(write_bag(tmp_path / "gap.bag", [*said[:90], odometry(START + 10**9, 1.0, START)]))
    trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(period=Fraction(1, 10)), Columns())
    assert [*trace.notes] == ["/robot0/odom: the message at 0 s is held for 8.9 s, to the end"]
