"""The roles of columns: names and values of times, and ids of objects."""

import numpy as np
import pytest

import rtamt
from rtamt.columns import (
    looks_like_times,
    names_objects,
    objects_in,
    plausible_units,
    split_times,
)

TIMES = {
    # Plain names.
    "time": "",
    "Time [s]": "s",
    "timestamp_ns": "ns",
    "t": "",
    "tout": "",
    "Time [ticks]": "ticks",
    "time(UTC)": "",
    # PlotJuggler, rostopic, rosbag_to_csv, Foxglove.
    "__time": "",
    "%time": "",
    "rosbagTimestamp": "ns",
    "log_time": "",
    # PX4 and ArduPilot.
    "timestamp": "",
    "TimeUS": "us",
    "time_boot_ms": "ms",
    "time_usec": "us",
    "time_unix_usec": "us",
    # CANoe, asammdf, LabVIEW, DIAdem, dSPACE, CarMaker.
    "Time[s]": "s",
    "timestamps": "",
    "Time (s)": "s",
    "Time*": "",
    "#time": "",
    # MATLAB, Simulink.
    "Time_s": "s",
    "t_s": "s",
    "Time, s": "s",
    "t / s": "s",
    # SUMO, CARLA, esmini, Gazebo, Isaac.
    "timestep_time": "",
    "elapsed_seconds": "s",
    "platform_timestamp": "",
    " TimeStamp [s] ": "s",
    "sim_time": "",
    "simTime": "",
    "physics_time": "",
    # Data sets and others.
    "#timestamp [ns]": "ns",
    "timestamp_ms": "ms",
    "Global_Time": "",
    "elapsed_time": "",
    "Elapsed Time (ms)": "ms",
    "seconds": "s",
    "millis": "ms",
    "ms since boot": "ms",
    "unix_time_ms": "ms",
    "_time": "",
    "time_ms": "ms",
    "timems": "ms",
    "Time in s": "s",
    # German and French tables.
    "Zeit": "",
    "Zeit [s]": "s",
    "Zeit [ms]": "ms",
    "Zeitstempel": "",
    "Zeit in Sekunden": "s",
    "Temps (s)": "s",
    "Temps écoulé": "",
    "Horodatage": "",
}

OTHERS = (
    *("T", "ts", "T [K]", "T [°C]", "t [°C]", "timer", "time_zone", "y", "clock", "odometer"),
    *("time_to_collision", "response_time", "sample_time", "dt", "delta_seconds", "time_delta"),
    *("lead.t", "lap_time", "cpu_time", "runtime", "time_gap", "tempo [bpm]", "settling_time [s]"),
    *("s", "v", "speed_ms", "latency_ms", "header.stamp", "second", "minute", "abtastzeit"),
)


@pytest.mark.parametrize(("name", "unit"), TIMES.items())
def test_time_names_state_their_unit(name: str, unit: str) -> None:
    assert rtamt.columns.unit_of_times(name.strip()) == unit


@pytest.mark.parametrize("name", OTHERS)
def test_other_names_are_not_times(name: str) -> None:
    assert rtamt.columns.unit_of_times(name) is None


def test_units_are_plausible_by_step_and_date() -> None:
    second = 10**9
    for scale, unit in {second: "ns", 10**6: "us", 10**3: "ms", 1: "s"}.items():
        dates = 1_700_000_000 * scale + np.arange(4) * max(scale // 100, 1)
        assert plausible_units(dates) == [unit]
    assert plausible_units(np.array([0, 4000, 8000])) == ["ms", "us"]
    assert plausible_units(np.array([0, 20, 40])) == ["s", "ms"]
    assert plausible_units(np.array([0.0, 0.02, 0.04])) == ["s"]
    assert plausible_units(np.array([0, 10_000_000, 20_000_000])) == ["us", "ns"]


RISING = np.cumsum([0.0, 0.1, 0.1, 0.1, 0.101, 0.099, 0.1, 0.1])


@pytest.mark.parametrize(
    ("name", "values", "first", "expected"),
    [
        ("clk", RISING, False, True),
        ("recv_ms", 20 * np.arange(5), False, True),
        ("X_Value", RISING, True, True),  # LabVIEW
        ("x", RISING, True, False),
        ("xAxis", RISING, False, True),  # ControlDesk
        ("Abtastung", RISING, True, True),
        ("Abtastung", RISING, False, True),
        ("Abtastung", 20 * np.arange(5), False, True),
        ("Abtastung", np.array([0, 20, 41, 60, 80]), False, True),  # rounded
        ("Abtastung", np.array([0, 20, 43, 60, 80]), False, False),
        ("Abtastung", RISING[::-1], True, True),  # the newest first
        ("Abtastung", RISING[::-1], False, False),
        ("battery", RISING[::-1], True, False),
        ("A", np.arange(5)[::-1], True, False),
        ("frm", 10 * np.arange(5), False, False),
        ("Zähler", 10 * np.arange(5), False, False),
        ("step_count", 10 * np.arange(5), False, False),
        ("tick_frame", 10 * np.arange(5), False, False),
        ("Abtastung", RISING + 1.7e9, False, True),
        ("Abtastung", 20 * np.arange(5), True, True),
        ("odometer", RISING, True, False),
        ("Kilometerstand", RISING, True, False),
        ("ramp", RISING, True, False),
        ("setpoint_speed", RISING, True, False),
        ("counter", 3 * np.arange(5), True, False),
        ("A", np.arange(5), True, False),
        ("A", 7 + np.arange(5), True, False),
        ("A", np.array([0.0, 0.1, 0.5, 0.6, 1.4, 1.5]), True, False),
        ("A [m]", RISING, True, False),
        ("A [s]", RISING, False, True),
        ("latency_ms", np.array([3.0, 5.0, 4.0]), True, False),
        ("cpu_time", np.zeros(4), True, False),
        ("clk", RISING[:1], True, False),
        ("clk", np.array(["a", "b"]), True, False),
        ("clk", np.array([0.0, np.nan, 2.0]), True, False),
    ],
)
def test_times_by_values(name: str, values: np.ndarray, *, first: bool, expected: bool) -> None:
    assert looks_like_times(name, values, first=first) is expected


def test_split_times_need_one_name() -> None:
    assert split_times(["s", "nsec", "v"]) == [("s", "nsec", "ns")]
    assert split_times(["gps.sec", "gps.us"]) == [("gps.sec", "gps.us", "us")]
    assert split_times(["v_s", "w_ns", "s"]) == []


def test_names_of_objects() -> None:
    for name in ("id", "ID", "name", "vehicle", "agent", "actor", "episode", "run", "trial"):
        assert names_objects(name)
    for name in ("vehicle_id", "trackId", "TRACK_ID", "episode_index", "run no", "VehicleName"):
        assert names_objects(name)
    for name in ("frame_index", "index", "step", "frame_id", "gear", "mode", "speed", "runtime"):
        assert not names_objects(name)


IDS = np.array([0, 0, 1, 1, 2, 2])


def test_ids_tell_objects_apart() -> None:
    result = objects_in({"episode_index": IDS})
    assert result == ("episode_index", ("0", "1", "2"), None)
    assert objects_in({"name": np.array(list("aabbaa"))}) == ("name", ("a", "b"), None)
    assert objects_in({"id": IDS.astype(float)}) == ("id", ("0", "1", "2"), None)
    assert objects_in({"id": np.arange(6)}) is None  # a number for each row
    assert objects_in({"id": np.zeros(6)}) is None
    assert objects_in({"id": IDS + 0.5}) is None
    assert objects_in({"frame_index": IDS}) is None
    assert objects_in({"id": np.array(["", "", "a", "", "b", ""])}) is None


def test_times_that_repeat_tell_objects_apart() -> None:
    times = np.array([0.0, 0.0, 1.0, 1.0, 2.0, 2.0])
    cells = {"lane": np.array([3, 4, 3, 4, 3, 4]), "x": np.array([1.5, 2.5, 1.5, 2.5, 1.5, 2.5])}
    assert objects_in(cells, times) == ("lane", ("3", "4"), None)
    assert objects_in({"x": cells["x"]}, times) == ("", (), None)
    assert objects_in({"x": np.ones(6)}, times) is None
    assert objects_in({"row": np.arange(6)}, times) is None
    assert objects_in({"x": cells["x"]}, np.arange(6.0)) is None
    restart = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0])
    assert objects_in({"x": np.array([1.5, 1.5, 1.5, 2.5, 2.5, 2.5])}, restart) == ("", (), None)
    newest_first = restart[:3][::-1]
    assert objects_in({"x": np.array([1.5, 2.5, 3.5])}, newest_first) is None


def test_rows_of_different_variables_are_one_trace() -> None:
    sensor = np.array(["a", "b", "a", "b"])
    filled = [sensor == "a", sensor == "b"]
    times = np.array([0.0, 0.0, 1.0, 1.0])
    assert objects_in({"id": sensor}, times, filled) is None
    assert objects_in({"id": sensor}, times, [sensor != ""]) == ("id", ("a", "b"), None)
