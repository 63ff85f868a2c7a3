"""Logs of PX4: names of fields, times, and notes on damage."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyulog import ULog
from ulogs import Topic, Ulog

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.recording import Wanted
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

Output = pytest.CaptureFixture[str]

POSITION = Topic("vehicle_local_position", (("float", "x"), ("float", "z"), ("bool", "z_valid")))
ATTITUDE = Topic("vehicle_attitude", (("float[4]", "q"), ("uint8_t", "quat_reset_counter")))
FIRST = Topic("sensor_accel", (("float", "x"), ("uint32_t", "error_count")))
SECOND = Topic("sensor_accel", FIRST.fields, instance=1)


def flight() -> Ulog:
    """Positions every 100 ms, attitudes every 50 ms, two accelerometers; from 5 s on."""
    log = Ulog(start=4_000_000)
    log.text(4_500_000, "logging started")
    for step in range(20):
        now = 5_000_000 + step * 50_000
        log.data(ATTITUDE, now, [1.0, 0.0, 0.0, step / 20, step])
        if step % 2 == 0:
            log.data(POSITION, now, [step, -1.5, 1])
            log.data(FIRST, now + 7, [step, 0])
            log.data(SECOND, now + 9, [-step, 3])
    return log


def events(
    path: Path, text: str, **signals: str
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return times and values of the events of every variable, without equal neighbours."""
    found, _ = read_ruled(
        str(path), {"": rtamt.parse(text)}, EvaluationOptions(dense=True), Columns(signals=signals)
    )
    assert isinstance(found, EventTrace)
    ends = {
        name: -1 if values[-1] == values[-2] else None
        for name, (_, values) in found.signals.items()
    }
    return {name: (at[: ends[name]], v[: ends[name]]) for name, (at, v) in found.signals.items()}


def names_of(path: Path) -> list[str]:
    with open_recording(str(path)) as recording:
        return list(recording.names)


def test_field_names_state_topic_and_instance(tmp_path: Path) -> None:
    path = flight().save(tmp_path / "flight.ulg")
    accelerometers = {f"sensor_accel.{n}.{name}" for n in (0, 1) for name in ("x", "error_count")}
    positions = {f"vehicle_local_position.{name}" for name in ("x", "z", "z_valid")}
    attitudes = {f"vehicle_attitude.q[{n}]" for n in range(4)}
    attitudes.add("vehicle_attitude.quat_reset_counter")
    single = positions | attitudes
    with_number = {each.replace(".", ".0.", 1) for each in single}
    names = names_of(path)
    assert names[0] == "time"
    assert {*names[1:]} == accelerometers | single | with_number
    assert len(names) == len({*names})


def test_times_in_seconds_and_exact_values(tmp_path: Path) -> None:
    path = flight().save(tmp_path / "flight.ulg")
    found = events(
        path,
        "vehicle_local_position.x > a + b + vehicle_attitude.q[3]",
        a="sensor_accel.0.x",
        b="sensor_accel.1.x",
    )
    times = [5 + step / 20 for step in range(0, 20, 2)]
    at, x = found["vehicle_local_position.x"]
    assert at.tolist() == pytest.approx(times, abs=1e-12)
    assert x.tolist() == list(range(0, 20, 2))
    at, a = found["a"]
    assert at.tolist() == pytest.approx([time + 7e-6 for time in times], abs=1e-12)
    assert a.tolist() == x.tolist()
    assert found["b"][1].tolist() == [-each for each in x.tolist()]
    at, q = found["vehicle_attitude.q[3]"]
    assert len(at) == 20
    assert q.tolist() == [float(np.float32(step / 20)) for step in range(20)]


@given(
    kinds=st.lists(
        st.sampled_from(["int8_t", "uint8_t", "int16_t", "uint32_t", "int64_t", "float", "double"]),
        min_size=1,
        max_size=4,
    ),
    steps=st.lists(st.integers(1, 10**7), min_size=1, max_size=12),
    numbers=st.integers(0, 127),
)
def test_reader_matches_pyulog(
    kinds: list[str], steps: list[int], numbers: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    topic = Topic("made", tuple((kind, f"field{at}") for at, kind in enumerate(kinds)))
    micros = np.cumsum(steps).tolist()
    rows = [(at, [(numbers + row) % 128] * len(kinds)) for row, at in enumerate(micros)]
    log = Ulog()
    log.records(topic, rows)
    path = log.save(tmp_path_factory.mktemp("ulog") / "made.ulg")
    (data,) = ULog(str(path)).data_list
    assert data.data["timestamp"].tolist() == micros
    wanted = [f"made.field{at}" for at in range(len(kinds))]
    with open_recording(str(path)) as recording:
        found = recording.read(Wanted(wanted, gaps=wanted, time="time"))
    assert found.times is not None
    assert found.times.tolist() == [at / 1e6 for at in micros]
    for name in wanted:
        assert found.numbers[name].tolist() == [values[0] for _, values in rows]
        assert data.data[name.removeprefix("made.")].tolist() == found.numbers[name].tolist()


def test_log_rewritten_by_pyulog_matches(tmp_path: Path) -> None:
    first = flight().save(tmp_path / "first.ulg")
    second = tmp_path / "second.ulg"
    ULog(str(first)).write_ulog(str(second))
    text = "vehicle_local_position.z < vehicle_attitude.q[0]"
    for (at, values), (other, others) in zip(
        events(first, text).values(), events(second, text).values(), strict=True
    ):
        assert at.tolist() == other.tolist()
        assert values.tolist() == others.tolist()


def test_samples_hold_slower_fields(tmp_path: Path, capsys: Output) -> None:
    path = str(flight().save(tmp_path / "flight.ulg"))
    spec = "always(vehicle_local_position.x >= 20 * vehicle_attitude.q[3] - 1.5)"
    assert main(["monitor", spec, path, "--missing", "hold"]) == 0
    assert "20 samples, one every 0.05 s, 5 s to 5.95 s" in capsys.readouterr().out
    assert main(["monitor", spec, path]) == 2
    assert (
        "give --missing unknown, or --missing hold if the value before holds"
        in capsys.readouterr().err
    )
    assert main(["monitor", "always(vehicle_local_position.z < 0)", path, "--dense"]) == 0


def test_a_field_that_is_nan_holds_no_number(tmp_path: Path, capsys: Output) -> None:
    log = Ulog()
    log.records(POSITION, [(10**6, [1, -1, 1]), (2 * 10**6, [1, np.nan, 0])])
    path = str(log.save(tmp_path / "nan.ulg"))
    for time in ([], ["--dense"]):
        assert main(["monitor", "always(vehicle_local_position.z < 0)", path, *time]) == 2
        said = capsys.readouterr().err
        assert "at 2 s, channel 'vehicle_local_position.z': expected a number, got" in said


def test_data_that_the_autopilot_lost_is_said(tmp_path: Path, capsys: Output) -> None:
    log = Ulog()
    rows = [(at * 100_000, [1, -1, 1]) for at in range(10, 20)]
    log.records(POSITION, rows[:4])
    log.dropout(50)
    path = log.save(tmp_path / "lost.ulg")
    spec = "always(vehicle_local_position.z < 0)"
    assert main(["monitor", spec, str(path), "--dense"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "note: the autopilot lost data: 0.05 s, after 1.3 s; values hold meanwhile" in said
    log.records(POSITION, rows[4:])
    log.dropout(70)
    log.save(path)
    assert main(["monitor", spec, str(path), "--dense"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "lost data: 2 times, 0.12 s in all, the longest 0.07 s after 1.9 s;" in said


def test_records_without_time_are_counted(tmp_path: Path) -> None:
    log = Ulog()
    rows: list[tuple[int, Sequence[float]]] = [
        (at, [x, 0, 0]) for at, x in [(0, 9), (900, 1), (1000, 2), (1000, 3), (1100, 4)]
    ]
    log.records(POSITION, rows)
    path = log.save(tmp_path / "twice.ulg")
    text = "vehicle_local_position.x > 0"
    trace, _ = read_ruled(str(path), {"": rtamt.parse(text)}, EvaluationOptions(), Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["vehicle_local_position.x"].tolist() == [1, 3, 4]
    assert [*trace.notes] == [
        "'vehicle_local_position.x': the last of 2 different records at 0.001 s counts",
        "left out: vehicle_local_position: 1 record without a time",
    ]
    log.data(POSITION, 1050, [0, 0, 0])
    log.save(path)
    with pytest.raises(rtamt.InputError) as caught:
        events(path, text)
    assert str(caught.value) == (
        f"{path}, vehicle_local_position: expected times that increase, got 0.00105 s after "
        "0.0011 s"
    )
    log = Ulog()
    log.records(POSITION, [(0, [1, 0, 0]), (0, [2, 0, 0])])
    log.save(path)
    with pytest.raises(rtamt.InputError) as caught:
        events(path, text)
    assert str(caught.value) == (
        f"{path}: expected records of vehicle_local_position with a time, got none"
    )


def test_truncated_log_is_read_with_note(
    tmp_path: Path,
) -> None:
    log = flight()
    whole = log.save(tmp_path / "whole.ulg").read_bytes()
    ends = np.cumsum([len(each) for each in (*log.definitions, *log.messages)]).tolist()
    begin = sum(map(len, log.definitions))
    path = tmp_path / "cut.ulg"
    text = "vehicle_attitude.q[3] < 2"
    _, complete = events(tmp_path / "whole.ulg", text)["vehicle_attitude.q[3]"]
    read, refused = 0, {}
    for size in range(0, len(whole), 7):
        path.write_bytes(whole[:size])
        try:
            trace, _ = read_ruled(
                str(path), {"": rtamt.parse(text)}, EvaluationOptions(dense=True), Columns()
            )
        except rtamt.InputError as error:
            refused[size] = str(error)
            continue
        read += 1
        assert isinstance(trace, EventTrace)
        _, values = trace.signals["vehicle_attitude.q[3]"]
        assert values[: trace.events].tolist() == complete[: trace.events].tolist()
        notes = [each for each in trace.notes if "ends within a message" in each]
        assert bool(notes) == (size not in ends), size
    assert read > 50
    assert max(refused) < begin + 200
    for said in refused.values():
        assert said.startswith((f"{path}: expected ", f"{path}: no column "))


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        ("header", "expected a ULog file; Failed to parse header"),
        ("short", "expected a ULog file; Header too short"),
        ("flags", "expected a ULog file; Unknown incompatible flag set: cannot parse the log"),
        ("zeros", "expected a complete ULog file; parts of it are not messages"),
        ("length", "expected a complete ULog file; parts of it are not messages"),
        ("subscription", "expected a complete ULog file; parts of it are not messages"),
        ("empty", "expected a ULog file with data; it holds none"),
    ],
)
def test_damaged_log_error(damage: str, why: str, tmp_path: Path, capsys: Output) -> None:
    log = flight()
    path = log.save(tmp_path / "bad.ulg")
    whole, begin = path.read_bytes(), sum(map(len, log.definitions))
    middle = begin + sum(map(len, log.messages[:30]))
    size = len(log.messages[30])
    damaged = {
        "header": b"X" + whole[1:],
        "short": whole[:9],
        "flags": whole[:27] + b"\x02" + whole[28:],
        "zeros": whole[:middle] + bytes(size) + whole[middle + size :],
        "length": whole[:middle] + bytes([whole[middle] - 4]) + whole[middle + 1 :],
        "subscription": whole.replace(log.messages[1], b""),
        "empty": whole[:begin],
    }
    path.write_bytes(damaged[damage])
    with pytest.raises(rtamt.InputError) as caught:
        names_of(path)
    assert str(caught.value) == f"{path}: {why}"
    assert not capsys.readouterr().out


def test_missing_log_column_error_lists_nearest(
    tmp_path: Path,
) -> None:
    log = flight()
    log.data(Topic("many", tuple(("float", f"field{at}") for at in range(60))), 10**7, [0.0] * 60)
    path = log.save(tmp_path / "flight.ulg")
    with pytest.raises(rtamt.InputError) as caught:
        events(path, "vehicle_local_position.z_vald > 0")
    assert str(caught.value) == (
        f"{path}: no column 'vehicle_local_position.z_vald', which the specification reads; the "
        "columns are vehicle_local_position.z_valid, vehicle_local_position.0.z_valid, "
        "vehicle_local_position.z, vehicle_local_position.0.z, vehicle_local_position.x and 136 "
        "more; did you mean 'vehicle_local_position.z_valid'?"
    )


def test_oversized_time_error_names_log(tmp_path: Path, capsys: Output) -> None:
    log = flight()
    log.data(ATTITUDE, 5_000_000_000_000_000, [1.0, 0.0, 0.0, 0.0, 0])
    path = log.save(tmp_path / "flight.ulg")
    (tmp_path / "a.stl").write_text("always[0:1s](vehicle_attitude.q[3] < 2)")
    assert main(["monitor", str(tmp_path / "a.stl"), str(path), "--dense"]) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {path}: expected a time of less than 2**62 ticks of 1ns at event 20 of "
        "'vehicle_attitude.q[3]', got 5000000000.0\n"
    )


def test_nothing_is_printed_while_a_log_is_read(tmp_path: Path) -> None:
    path = flight().save(tmp_path / "flight.ulg")
    printed = io.StringIO()
    with redirect_stdout(printed):
        names_of(path)
    assert not printed.getvalue()


def rates(seed: int) -> tuple[Ulog, dict[str, list[tuple[int, float]]]]:
    """Write a log of two topics with their own rates, which start and end at different times."""
    generator, log = np.random.default_rng(seed), Ulog(start=0)
    wanted: dict[str, list[tuple[int, float]]] = {}
    records: list[tuple[int, Topic, list[float]]] = []
    for topic, field, first, step, count in (
        (POSITION, "vehicle_local_position.x", 5_000_000, 100_000, 30),
        (ATTITUDE, "vehicle_attitude.q[3]", 5_330_000, 20_000, 80),
    ):
        times = first + np.arange(count) * step + generator.integers(0, step // 3, count)
        values = generator.normal(size=count)
        rounded = values.astype(np.float32)
        wanted[field] = [*zip(map(int, times), map(float, rounded), strict=True)]
        for time, value in zip(map(int, times), map(float, values), strict=True):
            row = [value, 0, 1] if topic is POSITION else [0, 0, 0, value, 0]
            records.append((time, topic, row))
    for time, topic, row in sorted(records, key=lambda record: record[0]):
        log.data(topic, time, row)
    return log, wanted


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("period", ["100ms", "30ms", "1/7"])
def test_two_topics_are_sampled_as_pandas_does(seed: int, period: str, tmp_path: Path) -> None:
    log, wanted = rates(seed)
    path = log.save(tmp_path / "two.ulg")
    spec = rtamt.parse("always(vehicle_local_position.x + vehicle_attitude.q[3] < 1)")
    reading = EvaluationOptions(period=period)
    trace, seconds = read_ruled(str(path), {"": spec}, reading, Columns())
    assert isinstance(trace, Trace)
    assert seconds is not None
    begin = min(rows[0][0] for rows in wanted.values())
    end = max(rows[-1][0] for rows in wanted.values())
    first = min(rows[0][0] for rows in wanted.values())
    places = [begin + 10**6 * seconds * k for k in range(int((end - begin) / 10**6 / seconds) + 1)]
    assert trace.samples == len(places)
    assert trace.start == pytest.approx(first / 1e6)
    for name, rows in wanted.items():
        series = pd.Series([v for _, v in rows], index=[t * 1000 for t, _ in rows])
        expected = series.reindex([int(place * 1000) for place in places], method="ffill")
        np.testing.assert_array_equal(trace.columns[name], expected.to_numpy())


def test_two_topics_on_the_command_line(tmp_path: Path, capsys: Output) -> None:
    path = rates(1)[0].save(tmp_path / "two.ulg")
    text = "always(vehicle_local_position.x < vehicle_attitude.q[3] + 9)"
    command = ["monitor", text, str(path), "--period", "100ms", "--missing", "hold"]
    assert main([*command, "--start", "known"]) == 0
    printed = capsys.readouterr().out
    assert "note: sampled every 0.1 s: a value holds until the next record" in printed
    assert "evaluated from 5.4" in printed
    assert main(command) == 3  # attitudes are unknown in the first 0.3 s
    assert "robustness over time starts at 5.4" in capsys.readouterr().out
    assert main(["monitor", text, str(path)]) == 2
    assert "give --period TIME to sample columns, or --dense" in capsys.readouterr().err
    assert main(["monitor", text, str(path), "--period", "100ms", "--jitter", "5%"]) == 2
    assert "--jitter" in capsys.readouterr().err


def test_silent_topic_is_unknown_after_max_gap(tmp_path: Path, capsys: Output) -> None:
    """Attitudes end a second before positions do."""
    path = rates(1)[0].save(tmp_path / "two.ulg")
    text = "always(vehicle_local_position.x < vehicle_attitude.q[3] + 9)"
    command = ["monitor", text, str(path), "--period", "100ms", "--start", "known"]
    assert main([*command, "--max-gap", "500ms"]) == 3
    assert "values are unknown where nothing was recorded for more than 0.5 s" in (
        capsys.readouterr().out
    )
    assert main(command) == 0


def test_spike_between_samples_counts_with_dense_only(tmp_path: Path) -> None:
    log = Ulog()
    for at in range(100):
        log.data(POSITION, 1_000_000 + at * 10_000, [9 if at == 55 else 0, 0, 1])
    path, text = str(log.save(tmp_path / "spike.ulg")), "always(vehicle_local_position.x < 5)"
    assert main(["monitor", text, path, "--period", "100ms"]) == 0
    assert main(["monitor", text, path, "--dense"]) == 1


def test_times_of_samples_are_microseconds(tmp_path: Path) -> None:
    sensor, log = Topic("sensor", (("uint64_t", "timestamp_sample"), ("float", "x"))), Ulog()
    for at in range(1_000_000, 1_500_000, 100_000):
        log.data(sensor, at, [at - 10_000, 1])
    path = log.save(tmp_path / "samples.ulg")
    columns = Columns(time="sensor.timestamp_sample", signals={"x": "sensor.x"})
    trace, _ = read_ruled(
        str(path), {"": rtamt.parse("always(x > 0)")}, EvaluationOptions(), columns
    )
    assert isinstance(trace, Trace)
    assert trace.times is not None
    np.testing.assert_allclose(trace.times.seconds, 0.99 + np.arange(5) / 10)
