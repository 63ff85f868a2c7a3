"""What a node says of itself among others, and which topics it names."""

import pytest
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import send, started, until

import rtamt_ros.node
from rtamt_ros.middleware import Level

GONE = Level.WARN, "no master answers"
BACK = Level.OK, "registered again"


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nodes look around at once, and again and again."""
    monkeypatch.setattr(rtamt_ros.node, "SOON", 0.0)
    monkeypatch.setattr(rtamt_ros.node, "AROUND", 0.001)


def states(ros: MemoryMiddleware) -> list[list[tuple[str, int, str]]]:
    """The names, levels and texts of all diagnostics but those of requirements."""
    arrays = [each.status for each in ros.on("/diagnostics")]
    return [[(one.name, one.level, one.message) for one in array[1:]] for array in arrays]


def test_problems_with_others_are_logged_once() -> None:
    ros, node = started("out = x > 1")
    send(ros, "x", 2.0)
    ros.tick()
    assert states(ros)[-1] == []
    for level, text in (GONE, BACK):
        ros.standing = level, text
        until(lambda: ros.lines[-1] == ros.standing)
        for _ in range(3):
            ros.tick(ros.time + SECOND)
        assert states(ros)[-3:] == [[("monitor: ROS", int(level), text)]] * 3
    node.stop()
    assert [each for each in ros.lines if each in (GONE, BACK)] == [GONE, BACK]


def test_robustness_goes_on_without_a_master() -> None:
    ros, node = started("out = x > 1")
    ros.standing = GONE
    send(ros, "x", 2.0)
    ros.tick()
    until(lambda: GONE in ros.lines)
    send(ros, "x", 3.0)
    ros.tick(ros.time + SECOND // 10)
    node.stop()
    assert ros.data("rtamt/out") == [1.0, 2.0]
    assert node.reports == ()


@pytest.mark.parametrize("other", ["", "/rtamt/oats"])
def test_hint_excludes_own_topics(other: str) -> None:
    ros, node = started("input float64 x\n@ topic(x, rtamt/oat)\nout = x > 1")
    ros.known = {ros.resolve(each.topic) for each in ros.publishers} | {other} - {""}
    ros.tick()
    hint = other and f"; did you mean '{other}'?"
    until(lambda: (Level.WARN, f"nobody publishes /rtamt/oat{hint}") in ros.lines)
    node.stop()
