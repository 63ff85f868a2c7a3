"""The screen shows the combined topic of a node."""

from __future__ import annotations

import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send, started
from rich.console import Console

from rtamt import EpisodeMonitor, Verdict, parse
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.screen import Screen
from rtamt_ros.screen import CombinedView, main

START = 1000 * SECOND
PERIOD = 100 * MS
TEXTS = {"low": "always(x < 2)", "rises": "eventually[0:0.5](x > 2)", "ends": "eventually(x > 9)"}


class Shown(Screen):
    """A screen without a terminal that keeps its newest lines."""

    def __init__(self) -> None:
        self.now = 0.0
        console = Console(file=io.StringIO(), width=100, color_system=None)
        super().__init__("", console, lambda: self.now, unit="message")
        self.newest: list[Line] = []

    def update(self, lines: object, rows: int, bad: int = 0) -> None:
        listed = [line for line in lines if isinstance(line, Line)]  # type: ignore[attr-defined]
        self.newest = listed or self.newest
        super().update(listed, rows, bad)

    def text(self) -> str:
        console = Console(file=io.StringIO(), width=100, color_system=None)
        console.print(self.picture())
        return str(console.file.getvalue())  # type: ignore[attr-defined]


def forwarded(ros: MemoryMiddleware, view: CombinedView, since: int) -> int:
    """Pass new messages of the node to the view; return their number."""
    messages = ros.on("rtamt/all")
    for message in messages[since:]:
        view.show(message)
    return len(messages)


@given(st.lists(st.sampled_from([-1.0, 0.0, 1.0, 2.5, 9.5]), min_size=1, max_size=12))
def test_the_screen_shows_what_monitors_return(values: list[float]) -> None:
    ros, _ = started(*(f"{name} = {text}" for name, text in TEXTS.items()), combined="rtamt/all")
    screen = Shown()
    view = CombinedView(MemoryMiddleware(), "rtamt/all", screen)
    monitors = {
        name: EpisodeMonitor(parse(f"float64 x\n{text}"), "100ms") for name, text in TEXTS.items()
    }
    decided: dict[str, float] = {}
    count = 0
    for number, x in enumerate(values):
        ros.time = START + number * PERIOD
        send(ros, "x", x)
        ros.tick()
        count = forwarded(ros, view, count)
        assert count == number + 1
        assert [line.requirement for line in screen.newest] == [*TEXTS]
        for line in screen.newest:
            monitor = monitors[line.requirement]
            monitor.update(x=x)
            if monitor.verdict:
                decided.setdefault(line.requirement, number / 10)
            assert (line.lower, line.upper, line.verdict) == (*monitor.bounds(), monitor.verdict)
            assert line.time == pytest.approx(number / 10)
            assert line.decided_at == pytest.approx(decided.get(line.requirement))
    assert f"{count} message" in screen.text()


def test_a_stale_input_is_named() -> None:
    ros, _ = started("low = always(x < 2)", combined="rtamt/all", stale=0.5)
    screen = Shown()
    view = CombinedView(MemoryMiddleware(generation=2), "rtamt/all", screen)
    assert "none for 0.0 s" in screen.text()
    send(ros, "x", 3.0)
    ros.tick()
    count = forwarded(ros, view, 0)
    assert "VIOLATED" in screen.text()
    assert screen.notes == []
    ros.tick(START + 10 * SECOND)
    forwarded(ros, view, count)
    (note,) = screen.notes
    assert note.startswith("low: ")
    assert note in screen.text()
    (line,) = screen.newest
    assert (line.verdict, line.decided_at) == (Verdict.UNDECIDED, None)
    assert math.isnan(line.lower)
    screen.now += 3.0
    view.beat()
    assert "last message 3.0 s ago" in screen.text()


def test_a_simulation_that_starts_again_starts_the_view_again() -> None:
    first, _ = started("low = always(x < 2)", combined="rtamt/all")
    send(first, "x", 3.0)
    first.tick()
    again, _ = started("low = always(x < 2)", combined="rtamt/all")
    again.time = START - 900 * SECOND
    send(again, "x", 1.0)
    again.tick()
    screen = Shown()
    view = CombinedView(MemoryMiddleware(), "rtamt/all", screen)
    forwarded(first, view, 0)
    assert screen.newest[0].verdict is Verdict.VIOLATED
    (message,) = again.on("rtamt/all")[-1:]
    view.show(message)
    assert (screen.newest[0].verdict, screen.newest[0].time) == (Verdict.UNDECIDED, 0.0)
    assert "1 message" in screen.text()


def test_the_screen_of_a_node_needs_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 2
    assert "rtamt_ros.screen draws on a terminal" in capsys.readouterr().err
