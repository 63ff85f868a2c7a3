"""The contract of every middleware of `rtamt_ros.middleware`, on real ROS 1 and ROS 2 processes.

The tests of a generation subclass `MiddlewareContract` and pass it a `World`.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from ros_peer import Peer
from ros_processes import PATIENCE
from ros_world import World

__all__ = ["MiddlewareContract", "meet"]

MS = 1_000_000
SECOND = 1_000_000_000
FLOAT = ("std_msgs", "Float64")
PROBE = -1.0


def meet(talker: Peer, publisher: str, listener: Peer, subscription: str, field: str) -> None:
    """Publish probes until messages arrive; `heard` leaves them out."""
    before = len(listener.ask("kept", subscription))
    for _ in range(round(PATIENCE / 0.05)):
        talker.ask("publish", publisher, {field: PROBE})
        if len(listener.ask("kept", subscription, before + 1, 0.05)) > before:
            return
    raise AssertionError(f"nothing arrives; the logs:\n{talker.log()}\n{listener.log()}")


def heard(listener: Peer, key: str, count: int, patience: float = PATIENCE) -> list[Any]:
    """Return the first field of messages without probes, once there are enough."""
    probes = sum(value == PROBE for _, value, *_ in listener.ask("kept", key))
    for extra in range(1000):  # more probes may arrive
        kept = listener.ask("kept", key, count + probes + extra, patience)
        found = [value for _, value, *_ in kept if value != PROBE]
        if len(found) >= count or len(kept) < count + probes + extra:
            return found
    raise AssertionError("too many probes")


def of_runs(calls: Sequence[int], ticks: Sequence[int]) -> list[tuple[list[int], list[int]]]:
    """Return the runs of ticks without jumps, with the calls at those times."""
    runs: list[list[int]] = [[ticks[0]]]
    for before, tick in pairwise(ticks):
        if 0 < tick - before < SECOND:
            runs[-1].append(tick)
        else:
            runs.append([tick])
    return [([call for call in calls if call in run], run) for run in runs]


def apart(one: int, other: int, period: int) -> int:
    """Return the shorter distance between two phases."""
    ahead = (one - other) % period
    return min(ahead, period - ahead)


class MiddlewareContract:
    """The properties; a subclass has a fixture `world`."""

    @pytest.fixture
    def talker(self, world: World) -> Peer:
        """Return a node that exists for all tests."""
        return world.talker

    @pytest.fixture
    def listener(self, world: World) -> Peer:
        """Return another node."""
        return world.listener

    @pytest.fixture
    def topic(self, request: pytest.FixtureRequest) -> str:
        """Return a topic for this test only."""
        return f"/contract/{request.node.originalname}"

    def test_classes_of_messages_have_their_fields(self, talker: Peer) -> None:
        twist = talker.ask("fields", "geometry_msgs", "Twist", ["linear.x", "angular.z"])
        assert twist == [0.0, 0.0]

    def test_a_message_that_is_not_there_is_an_input_error_that_names_it(
        self, talker: Peer
    ) -> None:
        missing = talker.ask("refusal", "absent_msgs", "Twist")
        assert missing.startswith("InputError: the messages of absent_msgs are not installed: ")
        assert talker.ask("refusal", "geometry_msgs", "Twst") == (
            "InputError: geometry_msgs has no message Twst; did you mean 'Twist'?"
        )
        assert talker.ask("refusal", "geometri_msgs", "Twist").startswith(
            "InputError: the messages of geometri_msgs are not installed; did you mean "
            "'geometry_msgs'? If not, "
        )

    def test_the_clock_counts_nanoseconds_since_1970(self, talker: Peer, tmp_path: Path) -> None:
        (tmp_path / "before").touch()
        assert not talker.ask("simulated")
        now = talker.ask("now")
        (tmp_path / "after").touch()
        before, after = ((tmp_path / n).stat().st_mtime_ns for n in ("before", "after"))
        assert before <= now <= after + 20 * MS  # files have the time of the last tick of Linux

    @pytest.mark.parametrize("time", [1, 999_999_999, SECOND, 1_790_000_000_123_456_789])
    def test_a_stamp_is_what_was_set(self, talker: Peer, time: int) -> None:
        assert talker.ask("stamped", "nav_msgs", "Odometry", time) == time

    def test_a_stamp_of_0_is_none_and_so_is_that_without_a_header(self, talker: Peer) -> None:
        assert talker.ask("stamped", "nav_msgs", "Odometry", None) is None
        assert talker.ask("stamped", "nav_msgs", "Odometry", 0) is None
        assert talker.ask("stamped", "geometry_msgs", "Twist", 5) is None

    def test_messages_arrive_as_they_were_sent_and_in_order(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        field, lateral = "twist.twist.linear.x", "pose.pose.position.y"
        listener.ask("subscribe", topic, topic, "nav_msgs", "Odometry", [field, lateral])
        talker.ask("publisher", topic, topic, "nav_msgs", "Odometry")
        meet(talker, topic, listener, topic, field)
        sent = [(1_790_000_000_000_000_001 + i, i / 3, -i / 7) for i in range(50)]
        for time, x, y in sent:
            talker.ask("publish", topic, {field: x, lateral: y}, time)
        heard(listener, topic, 50)
        assert [tuple(m) for m in listener.ask("kept", topic) if m[1] != PROBE] == sent

    def test_who_comes_late_gets_the_last_message_of_a_latched_topic(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        talker.ask("publisher", topic, topic, *FLOAT, latched=True)
        for value in (1.0, 2.0, 3.0):
            talker.ask("publish", topic, {"data": value})
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"])
        assert heard(listener, topic, 1) == [3.0]
        talker.ask("publish", topic, {"data": 4.0})
        assert heard(listener, topic, 2) == [3.0, 4.0]

    @pytest.mark.parametrize("latched", [True, False])
    @pytest.mark.parametrize(
        ("message", "fields"),
        [
            (("nav_msgs", "Odometry"), ["twist.twist.linear.x", "pose.pose.position.y"]),
            (("geometry_msgs", "PointStamped"), ["point.z"]),
            (FLOAT, ["data"]),
            (("std_msgs", "Float32"), ["data"]),  # half as many bits
        ],
    )
    def test_numbers_arrive_to_the_bit_with_their_stamp_beside_whole_messages(
        self,
        talker: Peer,
        listener: Peer,
        topic: str,
        message: tuple[str, str],
        fields: list[str],
        *,
        latched: bool,
    ) -> None:
        topic = f"{topic}_{message[1]}_{latched}"
        listener.ask("subscribe", topic, topic, *message, fields)
        talker.ask("publisher", topic, topic, *message, latched=latched, numbers=fields)
        meet(talker, topic, listener, topic, fields[0])
        has_stamp = message[0] != "std_msgs"
        sent = []
        for count, number in enumerate((0.0, -0.0, 0.375, -(2.0**100), float("inf"), 2.0**-126)):
            numbers = [number, -3.5 - count][: len(fields)]
            stamp = 1_790_000_000_999_999_999 + count
            talker.ask("publish_numbers", topic, numbers, stamp)
            talker.ask("publish", topic, {fields[0]: 7.0}, 1)
            sent += [(stamp, *numbers), (1, 7.0, 0.0)[: len(fields) + 1]]
        heard(listener, topic, len(sent))
        kept = [tuple(each) for each in listener.ask("kept", topic) if each[1] != PROBE]
        wanted = [(stamp if has_stamp else None, *values) for stamp, *values in sent]
        assert list(map(repr, kept)) == list(map(repr, wanted))  # repr distinguishes -0.0 and 0.0

    def test_who_comes_late_gets_the_last_numbers_of_a_latched_topic(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        point = "geometry_msgs", "PointStamped"
        talker.ask("publisher", topic, topic, *point, latched=True, numbers=["point.y"])
        for value in (1.0, 2.0, 3.0):
            talker.ask("publish_numbers", topic, [value], SECOND)
        listener.ask("subscribe", topic, topic, *point, ["point.y"])
        assert heard(listener, topic, 1) == [3.0]
        talker.ask("publish_numbers", topic, [4.0], SECOND)
        assert heard(listener, topic, 2) == [3.0, 4.0]

    @pytest.mark.parametrize("plain_first", [True, False])
    def test_beside_a_latched_publisher_another_is_heard_and_all_once(
        self, world: World, talker: Peer, listener: Peer, topic: str, *, plain_first: bool
    ) -> None:
        topic += str(plain_first)
        keeper = world.peer("keeper")
        keeper.ask("publisher", topic, topic, *FLOAT, latched=True)
        keeper.ask("publish", topic, {"data": 1.0})
        if plain_first:
            talker.ask("publisher", topic, topic, *FLOAT)
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"])
        assert heard(listener, topic, 1) == [1.0]
        if not plain_first:
            talker.ask("publisher", topic, topic, *FLOAT)
        meet(talker, topic, listener, topic, "data")
        talker.ask("publish", topic, {"data": 2.0})
        assert heard(listener, topic, 2) == [1.0, 2.0]
        meet(keeper, topic, listener, topic, "data")
        keeper.ask("publish", topic, {"data": 3.0})
        assert heard(listener, topic, 3) == [1.0, 2.0, 3.0]

    def test_a_latched_publisher_that_begins_anew_is_heard(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"])
        for value in (1.0, 2.0, 3.0):
            talker.ask("publisher", topic, topic, *FLOAT, latched=True)
            talker.ask("publish", topic, {"data": value})
            assert heard(listener, topic, round(value))[-1] == value
            talker.ask("close", topic)

    def test_who_comes_late_gets_nothing_old_of_another_topic(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        talker.ask("publisher", topic, topic, *FLOAT)
        talker.ask("publish", topic, {"data": 1.0})
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"])
        meet(talker, topic, listener, topic, "data")
        talker.ask("publish", topic, {"data": 2.0})
        assert heard(listener, topic, 1) == [2.0]

    def test_a_closed_subscription_hears_nothing_more_and_another_does(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        talker.ask("publisher", topic, topic, *FLOAT)
        for key in ("closed", "open"):
            listener.ask("subscribe", key, topic, *FLOAT, ["data"])
            meet(talker, topic, listener, key, "data")
        talker.ask("publish", topic, {"data": 1.0})
        assert heard(listener, "closed", 1) == heard(listener, "open", 1) == [1.0]
        listener.ask("close", "closed")
        talker.ask("publish", topic, {"data": 2.0})
        assert heard(listener, "open", 2) == [1.0, 2.0]
        assert heard(listener, "closed", 2, 0.05) == [1.0]

    def test_a_closed_publisher_may_be_made_again(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        talker.ask("publisher", topic, topic, *FLOAT, latched=True)
        talker.ask("publish", topic, {"data": 1.0})
        talker.ask("close", topic)
        talker.ask("publisher", topic, topic, *FLOAT, latched=True)
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"])
        talker.ask("publish", topic, {"data": 2.0})
        assert heard(listener, topic, 1) == [2.0]

    def test_an_error_of_a_callback_is_logged_and_the_next_message_comes(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        talker.ask("publisher", topic, topic, *FLOAT)
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"], 5.0)
        meet(talker, topic, listener, topic, "data")
        for value in (5.0, 6.0):
            talker.ask("publish", topic, {"data": value})
        assert heard(listener, topic, 1) == [6.0]
        assert "ArithmeticError: a callback that fails" in listener.log()

    def test_relative_topics_follow_the_namespace_and_remappings(
        self, world: World, listener: Peer, topic: str
    ) -> None:
        robot = world.peer("robot", {"__ns": "/robot7", "odom": "wheels"})
        assert robot.ask("name").startswith("/robot7/robot")
        for key, at in {"x": "/robot7/x", "odom": "/robot7/wheels", topic: topic}.items():
            assert robot.ask("resolve", key) == at
            robot.ask("publisher", key, key, *FLOAT, latched=True)
            robot.ask("publish", key, {"data": 3.0})
            listener.ask("subscribe", at, at, *FLOAT, ["data"])
            assert heard(listener, at, 1) == [3.0]

    def test_topics_that_somebody_publishes_are_known(
        self, talker: Peer, listener: Peer, topic: str
    ) -> None:
        listener.ask("subscribe", topic, topic, *FLOAT, ["data"])
        assert topic not in listener.ask("published_topics")
        talker.ask("publisher", topic, topic, *FLOAT)
        meet(talker, topic, listener, topic, "data")
        for _ in range(round(PATIENCE / 0.05)):
            if topic in listener.ask("published_topics"):
                return
            threading.Event().wait(0.05)
        raise AssertionError(f"nobody is known to publish {topic}")

    def test_nodes_of_one_name_live_together(self, world: World, listener: Peer) -> None:
        twin = world.peer("listener")
        assert twin.ask("name").startswith("/listener")
        assert listener.process.poll() is None
        assert listener.ask("name").startswith("/listener")

    @pytest.mark.parametrize("wrong", ["a b", "a.b", "1st", "wärme"])
    def test_a_topic_that_ros_cannot_have_is_an_input_error(self, talker: Peer, wrong: str) -> None:
        for method in ("publisher", "subscribe"):
            fields = [["data"]] if method == "subscribe" else []
            with pytest.raises(AssertionError) as refused:
                talker.ask(method, wrong, wrong, *FLOAT, *fields)
            assert f"InputError: topic {wrong!r}: " in str(refused.value)

    def test_a_service_of_a_node_answers_and_says_what_went_wrong(self, world: World) -> None:
        server = world.peer("server", {"__ns": "/of"})
        name = server.ask("name")
        server.ask("trigger", "reset", "reset", "done\nand said")
        assert world.talker.ask("call", f"{name}/reset") == (True, "done\nand said")
        server.ask("trigger", "cannot", "cannot", "expected a run", error="InputError")
        assert world.talker.ask("call", f"{name}/cannot") == (False, "expected a run")
        server.ask("trigger", "fails", "fails", "no", error="ArithmeticError")
        assert world.talker.ask("call", f"{name}/fails") == (False, "ArithmeticError: no")
        assert "ArithmeticError: no" in server.log()
        assert world.talker.ask("call", f"{name}/reset")[0]  # the node continues
        server.ask("close", "reset")
        server.ask("trigger", "reset", "reset", "again")
        assert world.talker.ask("call", f"{name}/reset") == (True, "again")

    def test_lines_of_the_log_are_written(self, talker: Peer) -> None:
        for level in range(4):
            talker.ask("log", level, f"100% of level {level}")
        talker.ask("name")
        for level in range(4):
            assert f"100% of level {level}" in talker.log()

    def test_a_timer_keeps_its_grid_and_survives_errors_and_long_calls(
        self, listener: Peer
    ) -> None:
        period, count = 150 * MS, 16
        listener.ask("every", "long", period, lasts=0.4 * period / SECOND)
        listener.ask("every", "short", period)
        for key in ("long", "short"):
            calls = listener.ask("kept", key, count)
            assert {inside for _, inside, _ in calls} == {1}
            assert min(time - due for time, _, due in calls) >= 0
            assert {(due - calls[0][2]) % period for _, _, due in calls} == {0}
            times = [time for time, _, _ in calls[:count]]
            assert times[-1] - times[0] > (count - 2) * period
            near = [  # for each phase, the number of others near it
                sum((time - one + period // 6) % period < period // 3 for time in times)
                for one in times
            ]
            assert max(near) > count // 2
        assert listener.log().count("ArithmeticError: a timer that fails") == 2
        listener.ask("close", "short")
        kept = len(listener.ask("kept", "short"))
        assert len(listener.ask("kept", "short", kept + 1, 3 * period / SECOND)) == kept

    def test_a_sample_is_published_after_its_stamp_with_what_was_sent_before_it(
        self, world: World, talker: Peer, listener: Peer, topic: str
    ) -> None:
        """A value is the time at which it was published, in seconds."""
        period, count = 5 * MS, 200
        text = f"""
        from geometry_msgs.msg import PointStamped
        input float64 sent
        output PointStamped out
        @ topic(sent, {topic})
        @ topic(out, {topic}/out)
        out.point.x = sent >= 0
        """
        kept = "out", f"{topic}/out", "geometry_msgs", "PointStamped", ["point.x"]
        listener.ask("subscribe", *kept, arrival=True)
        talker.ask("publisher", topic, topic, *FLOAT)
        command = "-m", "rtamt_ros", "--spec", text, "--period", "5", "--unit", "ms"
        monitor = world.ros.start(*command, name="stamps")
        begin = talker.ask("now")
        for _ in range(round(PATIENCE / 0.1)):
            talker.ask("publish_times", topic, "data", begin, 20)
            if listener.ask("kept", "out", 1, 0.1):
                break
        sent = talker.ask("publish_times", topic, "data", begin, count)
        found = [each for each in listener.ask("kept", "out") if sent[0] <= each[1] < sent[-1]]
        monitor.ask_to_end()
        assert monitor.ended() == 0
        assert len(found) > count // 4, monitor.output
        assert {(stamp - found[0][0]) % period for stamp, *_ in found} == {0}
        for stamp, value, arrival in found:
            assert stamp <= arrival
            assert begin + round(value * SECOND) <= stamp
        # Messages from just before a stamp may arrive later.
        since = [(stamp - begin) / SECOND - 0.004 for stamp, *_ in found]
        newest = [
            value >= max((each for each in sent if each <= time), default=0.0)
            for (_, value, _), time in zip(found, since, strict=True)
        ]
        assert sum(newest) > len(newest) // 2

    def test_a_simulated_clock_is_0_and_then_what_it_is_told(self, world: World) -> None:
        clock, node = world.clock, world.simulated
        assert node.ask("now") == 0
        assert node.ask("simulated")
        for time in (5 * SECOND + 1, 6 * SECOND, 2 * SECOND):
            self.tick(clock, node, time)
            assert node.ask("now") == time

    def test_a_timer_follows_the_simulated_clock_over_its_jumps(self, world: World) -> None:
        clock, node = world.clock, world.simulated
        period, step = 100 * MS, 25 * MS
        begin = 100 * SECOND
        self.tick(clock, node, begin)
        node.ask("every", "jumps", period)
        ticks = [
            start + i * step for start in (begin, 9000 * SECOND, 50 * SECOND) for i in range(17)
        ]
        for time in ticks:
            self.tick(clock, node, time)
            threading.Event().wait(0.02)
        kept = node.ask("kept", "jumps")
        assert min(time - due for time, _, due in kept) >= 0
        assert {(due - kept[0][2]) % period for _, _, due in kept} == {0}
        calls = [time for time, _, _ in kept]
        assert set(calls) <= set(ticks), "a call between two ticks"
        for inside, run in of_runs(calls, ticks):
            assert 3 <= len(inside) <= 5
            assert inside[0] <= run[0] + period + step
            for before, after in pairwise(inside[1:]):
                assert period - step <= after - before <= period + step
        node.ask("close", "jumps")

    def test_a_simulated_clock_that_stands_calls_no_timer(self, world: World) -> None:
        clock, node = world.clock, world.simulated
        self.tick(clock, node, 200 * SECOND)
        node.ask("every", "stands", 10 * MS)
        assert len(node.ask("kept", "stands", 2, 0.1)) <= 1

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_a_signal_ends_spin_and_the_process_in_good_order(
        self, world: World, number: signal.Signals
    ) -> None:
        node = world.peer("ending")
        node.ask("every", "timer", 10 * MS)
        node.ask("kept", "timer", 2)
        node.process.send_signal(number)
        assert node.process.wait(PATIENCE) == 0
        assert node.log().endswith("closed\n")

    def test_close_from_another_thread_ends_spin(self, world: World) -> None:
        node = world.peer("ending")
        node.ask("end")
        assert node.process.wait(PATIENCE) == 0
        assert node.log().endswith("closed\n")

    def tick(self, clock: Peer, node: Peer, time: int) -> None:
        """Set the simulated clock; publish until the node has received it."""
        for _ in range(round(PATIENCE / 0.2)):
            clock.ask("tick", "clock", time)
            if node.ask("wait_until", time, 0.2):
                return
        raise AssertionError(f"the clock never shows {time}; the log:\n{node.log()}")
