"""The properties of the scenario of `ros_scenario`, on ROS 1 and on ROS 2.

To add a claim about nodes on real ROS, add a test to `LiveScenario`, which runs on ROS 1 and ROS 2.
``ros_scenario.py`` creates the events that the tests check.
"""

from __future__ import annotations

import cmath
import csv
import json
import math
from collections.abc import Iterable
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from models.unicycle import move
from ros_messages import Heard, write_mcap
from ros_scenario import (
    ALL,
    CMD,
    DIAGNOSTICS,
    EVENTS,
    FOLLOWS,
    GAP,
    KEEPS,
    MOVED,
    MOVES,
    ODOM,
    PERIOD,
    Run,
    dips,
    numbers,
    statuses,
)

import rtamt
from rtamt_gym.__main__ import main

MULTICAST = "239.255.0.1"
"""The addresses on which DDS participants find each other, on the loopback interface only."""

COMMAND, SPEED = "cmd.linear.x", "odom.twist.twist.linear.x"
STALE = 3
"""The level of a status."""
OFFLINE = {
    FOLLOWS: f"historically[0:0.3s]({GAP})",
    KEEPS: f"historically({GAP})",
    MOVES: f"once({MOVED})",
}
"""The requirements up to now, in past operators only."""


def stamps(heard: list[Heard]) -> list[int]:
    """Return the times in headers, in nanoseconds."""
    found = [each.message.header.stamp for each in heard]
    return [1_000_000_000 * stamp.sec + stamp.nanosec for stamp in found]


def speeds(heard: list[Heard]) -> list[float]:
    """Return the forward speeds in commands or odometry."""
    messages = [each.message for each in heard]
    return [(m if hasattr(m, "linear") else m.twist.twist).linear.x for m in messages]


def pose(odometry: Heard) -> tuple[complex, complex]:
    """Return the position and the direction of the robot as complex numbers."""
    found = odometry.message.pose.pose
    half = complex(found.orientation.w, found.orientation.z)
    return complex(found.position.x, found.position.y), half**2


def in_order(some: Iterable[float], of: Iterable[float]) -> bool:
    """Return whether numbers are among others, in the same order."""
    rest = iter(of)
    return all(value in rest for value in some)


def rows_of(path: Path) -> tuple[list[float], list[dict[str, str]]]:
    """Return the rows of a record, and their times in seconds since the first."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    times = np.array([row.pop("time").removesuffix("Z") for row in rows], "datetime64[ns]")
    return list((times - times[0]) / np.timedelta64(1, "s")), rows


def record_of(run: Run, topic: str) -> dict[str, list[float]]:
    """Return the columns in the record of the requirement of a topic."""
    (path,) = run.folder.glob(f"sampled-{topic.removeprefix('rtamt/')}*.csv")
    times, rows = rows_of(path)
    return {"time": times, **{name: [float(row[name]) for row in rows] for name in rows[0]}}


def told(run: Run, topic: str) -> list[Any]:
    """Return the diagnostics of the requirement of a topic, in order."""
    name = topic.removeprefix("rtamt/")
    found = statuses(run.heard[DIAGNOSTICS])
    return [each for each in found if each.name.split(": ")[1].startswith(name)]


def inputs_of(run: Run) -> list[Heard]:
    """Return the inputs of the monitors, in order of arrival."""
    messages = [each for topic in (ODOM, CMD) for each in run.heard[topic]]
    return sorted(messages, key=lambda each: each.time)


def judge(run: Run, bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Judge a bag with `rtamt monitor`; its verdicts must equal the run."""
    line = ["monitor", str(run.folder / "whole.stl"), str(bag), "--period", "100ms", "--json"]
    assert main(line) == 1
    (judged,) = json.loads(capsys.readouterr().out)["trials"]
    words = {-1: "VIOLATED", 0: "UNDECIDED", 1: "SATISFIED"}
    end = run.heard[ODOM][-1].time
    for topic, verdict in ((KEEPS, "VIOLATED"), (MOVES, "SATISFIED")):
        live = [each for each in run.heard[f"{topic}/verdict"] if each.time <= end]
        assert words[live[-1].message.data] == verdict
        assert judged["outcomes"][topic.removeprefix("rtamt/")]["verdict"] == verdict


class LiveScenario:
    """The properties; a subclass has a fixture `run`."""

    def test_the_robot_moves_ten_times_a_second_as_its_twist_says(self, run: Run) -> None:
        odometry = run.heard[ODOM]
        assert np.median(np.diff(stamps(odometry))) == pytest.approx(1e8, rel=0.02)
        for before, after in pairwise(odometry):
            (place, looks), twist = pose(before), after.message.twist.twist
            there = place.real, place.imag, cmath.phase(looks)
            x, y, heading = move(there, twist.linear.x, twist.angular.z, 0.1)
            assert pose(after)[0] == pytest.approx(complex(x, y), abs=1e-9)
            assert pose(after)[1] == pytest.approx(cmath.exp(1j * heading), abs=1e-9)

    def test_a_monitor_publishes_once_a_period(self, run: Run) -> None:
        end = run.heard[ODOM][-1].time
        for topic in OFFLINE:
            begin = run.heard[topic][0].time
            published = sum(begin <= each.time <= end for each in run.heard[topic])
            missed = max(
                int(pair.value)
                for each in told(run, topic)
                for pair in each.values
                if pair.key == "late samples"
            )
            assert published <= (end - begin) / PERIOD + 2, topic
            assert published + missed >= (end - begin) / PERIOD - 2, topic
        known = [
            stamp
            for each, stamp in zip(run.heard[FOLLOWS], stamps(run.heard[FOLLOWS]), strict=True)
            if each.time <= end
        ]
        assert not [gap for gap in np.diff(known) if gap <= 0 or gap % PERIOD]

    def test_robustness_is_that_of_the_offline_core_on_the_samples(self, run: Run) -> None:
        end = run.heard[ODOM][-1].time
        for topic, formula in OFFLINE.items():
            record = record_of(run, topic)
            assert set(np.diff(record.pop("time")).round(6)) == {PERIOD / 1e9}
            robustness = record.pop("robustness")
            offline = rtamt.evaluate(formula, record, period=PERIOD / 1e9)
            np.testing.assert_array_equal(robustness, offline)
            published = numbers([each for each in run.heard[topic] if each.time <= end])
            assert in_order(published, robustness), topic

    def test_dense_robustness_is_that_of_the_offline_core_on_the_events(self, run: Run) -> None:
        times, rows = rows_of(run.folder / "dense.csv")
        events: dict[str, list[tuple[float, float]]] = {COMMAND: [], SPEED: []}
        for time, row in zip(times, rows, strict=True):
            events[row["variable"]].append((time, float(row["value"])))
        for course in events.values():
            if course[-1][0] < times[-1]:  # it was silent, and its value stayed
                course.append((times[-1], course[-1][1]))
        offline = [value for _, value in rtamt.dense.evaluate(OFFLINE[FOLLOWS], events)]
        published = [value for value in numbers(run.heard[EVENTS]) if math.isfinite(value)]
        assert in_order(published, offline)
        assert len(published) >= len(offline) - 3

    def test_a_combined_message_has_what_is_published_of_all_at_its_stamp(self, run: Run) -> None:
        combined = run.heard[ALL]
        known = stamps(combined)
        assert not [gap for gap in np.diff(known) if gap <= 0 or gap % PERIOD]
        assert all(each.time >= stamp for each, stamp in zip(combined, known, strict=True))
        said = [
            {
                row.name.partition(".")[0]: {pair.key: pair.value for pair in row.values}
                for row in each.message.status
            }
            for each in combined
        ]
        assert {frozenset(each) for each in said} == {frozenset(("follows", "keeps", "moves"))}
        about = {each["follows"]["at"]: each["follows"]["robustness"] for each in said}
        heard = run.heard[FOLLOWS]
        compared = 0
        for value, stamp in zip(numbers(heard), stamps(heard), strict=True):
            at = f"{stamp // 10**9}.{stamp % 10**9:09d}"
            if math.isfinite(value) and stamp > known[0]:
                assert float(about[at]).hex() == value.hex()
                compared += 1
        assert compared > 50
        verdicts = [each["keeps"]["verdict"] for each in said]
        assert {*verdicts[: verdicts.index("VIOLATED")]} <= {"", "UNDECIDED"}
        assert verdicts[-1] == "UNDECIDED"  # the robot has ended

    def test_samples_are_what_came_last(self, run: Run) -> None:
        record = record_of(run, FOLLOWS)
        for name, topic in (
            (COMMAND, CMD),
            (SPEED, ODOM),
        ):
            came = speeds(run.heard[topic])
            changes = [value for value, _ in groupby(record[name])]
            while not in_order(changes, came):  # the monitor may have received more than the probe
                changes = changes[1:]  # before it, and nothing else
            assert len(changes) > 20, name

    def test_each_fault_drives_robustness_below_0_and_back(self, run: Run) -> None:
        for topic in (FOLLOWS, EVENTS):
            assert dips(numbers(run.heard[topic])) == 2, topic
        for topic, at_most in ((FOLLOWS, -0.2), (KEEPS, -0.2), (EVENTS, -0.5)):  # every message
            assert min(filter(math.isfinite, numbers(run.heard[topic]))) < at_most, topic
        assert speeds(run.heard[ODOM]).count(0.0) >= 5  # while its wheels were blocked
        assert speeds(run.heard[CMD]).count(-0.5) == 3
        assert -1 in [each.message.data for each in run.heard[f"{KEEPS}/verdict"]]

    def test_before_every_input_came_nothing_is_published(self, run: Run) -> None:
        assert run.early[ODOM]
        assert not run.early[CMD]
        for topic in (FOLLOWS, KEEPS, EVENTS, f"{KEEPS}/verdict"):
            assert not run.early[topic], topic
            assert run.heard[topic], topic
        for topic in (*OFFLINE, EVENTS):
            waits = "waiting for odom" if topic == MOVES else "waiting for cmd, odom"
            assert told(run, topic)[0].message == waits

    def test_without_the_robot_nothing_stays_positive(self, run: Run) -> None:
        for topic in (*OFFLINE, EVENTS):
            assert math.isnan(numbers(run.heard[topic])[-1]), topic
        for topic in (KEEPS, MOVES, EVENTS):
            assert run.heard[f"{topic}/verdict"][-1].message.data == 0, topic
        for topic, heard in run.late.items():
            assert heard, topic
            assert all(map(math.isnan, numbers(heard))), topic

    def test_diagnostics_say_which_input_is_stale(self, run: Run) -> None:
        for topic in (*OFFLINE, EVENTS):
            assert told(run, topic)[-1].level == STALE, topic
            first = next(each for each in told(run, topic) if each.level == STALE)
            assert "odom stale 1." in first.message, topic
            assert {pair.key: pair.value for pair in first.values}["stale inputs"] == "odom"

    def test_the_recorded_topics_get_the_same_verdicts_from_rtamt_monitor(
        self, run: Run, capsys: pytest.CaptureFixture[str]
    ) -> None:
        bag = write_mcap(inputs_of(run), run.folder / "bag")
        judge(run, bag, capsys)

    def test_everything_listens_on_the_loopback_interface_alone(self, run: Run) -> None:
        assert len(run.addresses) > 5
        assert {each.host for each in run.addresses} <= {"127.0.0.1", MULTICAST}

    def test_processes_end_when_they_are_asked_to(self, run: Run) -> None:
        assert set(run.codes.values()) == {0}
