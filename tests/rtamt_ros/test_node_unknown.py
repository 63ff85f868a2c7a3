"""Runs that continue during a silence: stale inputs as unknown samples, `stale_as="unknown"`."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from memory_middleware import SECOND
from memory_nodes import MS, send, started
from profiles import examples

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym.__main__ import main
from rtamt_ros.middleware import Level
from rtamt_ros.node import Settings
from rtamt_ros.parameters import PARAMETERS, read

START = 1000 * SECOND
STALE = 500 * MS  # five periods of 100 ms
TEXTS = [
    "always(x > 0 and y > 0)",
    "eventually(x > 0 and y > 0)",
    "always(x > 0 implies eventually[0:0.2](y > 0))",
    "eventually(x > 1 and always(y > 0))",
]

Step = tuple[float | None, float | None]


@settings(max_examples=examples(40), deadline=None)
@given(
    st.sampled_from(TEXTS),
    st.lists(
        st.tuples(*[st.sampled_from([None, None, None, -1.0, 0.5, 2.0])] * 2),
        min_size=8,
        max_size=24,
    ),
)
def test_stale_as_unknown_equals_unknown_samples(text: str, steps: list[Step]) -> None:
    ros, node = started(text, stale_as="unknown")
    rows: list[Step] = []
    held: dict[str, tuple[float, int]] = {}
    for n, values in enumerate([(1.0, 1.0), *steps]):
        ros.time = START + n * 100 * MS
        for name, value in zip("xy", values, strict=True):
            if value is not None:
                send(ros, name, value)
                held[name] = value, ros.time
        ros.tick()
        late = [ros.time - held[name][1] > STALE for name in "xy"]
        x, y = (math.nan if gone else held[name][0] for name, gone in zip("xy", late, strict=True))
        rows.append((x, y))
        columns = dict(zip("xy", map(list, zip(*rows, strict=True)), strict=True))
        whole = rtamt.judge(text, columns, "100ms", end="open", nan="unknown")
        (report,) = node.reports
        assert (report.lower, report.upper) == (whole.lower, whole.upper)
        assert report.verdict is whole.verdict
        assert ros.latched("rtamt/spec/verdict") == int(whole.verdict)
        assert report.stale == tuple(name for name, gone in zip("xy", late, strict=True) if gone)
        assert report.restarts == 0
        assert (report.level is Level.STALE) == any(late)
        if any(late):
            assert math.isnan(ros.latched("rtamt/spec"))
        elif text in TEXTS[:2]:
            assert report.robustness is not None
            assert whole.lower <= report.robustness <= whole.upper


def test_stale_as_unknown_continues_the_run() -> None:
    ros, node = started("slow = x < 3; out = always(slow and y > 0)", stale_as="unknown")
    said = []
    for n in range(16):
        ros.time = START + n * 100 * MS
        if n < 3 or n > 12:
            send(ros, "x", 1.0)
        send(ros, "y", -2.0 if n == 10 else 5.0)
        ros.tick()
        (report,) = node.reports
        said.append((report.verdict, report.level, str(ros.latched("rtamt/slow"))))
    undecided, violated = Verdict.UNDECIDED, Verdict.VIOLATED
    assert said[7] == (undecided, Level.OK, "2.0")
    assert said[8] == (undecided, Level.STALE, "nan")
    assert said[10] == (violated, Level.STALE, "nan")
    assert said[15] == (violated, Level.ERROR, "2.0")
    assert ros.latched("rtamt/out") == report.robustness == report.upper == -2.0
    assert report.lower == -math.inf
    assert (
        report.text == "violated, robustness -2; violated 1 time since start, first at 1001.000 s"
    )


def test_a_run_begins_when_every_input_has_come() -> None:
    ros, node = started("always(x > 0 and y > 0)", stale_as="unknown")
    for n in range(10):
        ros.time = START + n * 100 * MS
        send(ros, "x", 1.0)
        ros.tick()
    assert node.reports[0].waiting == ("y",)
    assert not ros.on("rtamt/spec/verdict")


def test_a_record_is_judged_as_the_node_has_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.csv"
    text = "always(x > 0 or y > 0)"
    ros, node = started(text, stale_as="unknown", record=path)
    for n in range(12):
        ros.time = START + n * 100 * MS
        if not n:
            send(ros, "x", 1.0)
        send(ros, "y", 2.0)
        ros.tick()
    (report,) = node.reports
    node.stop()
    assert [path] == list(tmp_path.iterdir())
    assert main(["monitor", text, str(path), "--missing", "unknown"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert out.startswith("SATISFIED, robustness 2, ")
    assert "note: empty cells are unknown samples (x: 6, the first in " in out
    assert (report.lower, report.upper, report.verdict) == (-math.inf, 2.0, Verdict.UNDECIDED)
    assert main(["monitor", text, str(path), "--missing", "unknown", "--end", "open"]) == 3
    assert capsys.readouterr().out.startswith("UNDECIDED, robustness between -inf and 2\n")


class _Sent:
    """The events of two topics, unknown while they are stale."""

    def __init__(self) -> None:
        self.events: dict[str, list[tuple[int, float]]] = {"x": [], "y": []}

    def add(self, name: str, time: int, value: float) -> None:
        its = self._with_silence(name, time)
        self.events[name] = [*its, (time, value)]

    def until(self, now: int) -> tuple[dict[str, list[tuple[int, float]]], list[bool]]:
        """Return the events that a look knows, and the stale topics."""
        whole: dict[str, list[tuple[int, float]]] = {}
        for name in self.events:
            its = self._with_silence(name, now)
            if its[-1][0] < now - 1:
                its = [*its, (now - 1, its[-1][1])]
            whole[name] = [(time - START, value) for time, value in its]
        return whole, [math.isnan(its[-1][1]) for its in whole.values()]

    def _with_silence(self, name: str, now: int) -> list[tuple[int, float]]:
        its = self.events[name]
        if its and now - its[-1][0] > STALE:
            return [*its, (its[-1][0] + STALE + 1, math.nan)]
        return its


@settings(max_examples=examples(25), deadline=None)
@given(
    st.sampled_from(TEXTS),
    st.lists(
        st.tuples(*[st.sampled_from([None, None, None, -1.0, 0.5, 2.0])] * 2),
        min_size=8,
        max_size=24,
    ),
)
def test_dense_value_is_unknown_while_stale(text: str, steps: list[Step]) -> None:
    ros, node = started(text, stale_as="unknown", dense=True)
    sent = _Sent()
    for n, values in enumerate([(1.0, 1.0), *steps]):
        ros.time = START + n * 100 * MS
        for name, value in zip("xy", values, strict=True):
            ros.time += 1000  # topics with separate events
            if value is not None:
                send(ros, name, value)
                sent.add(name, ros.time, value)
        ros.time += 1 * MS
        ros.tick()
        whole, late = sent.until(ros.time)
        spec = rtamt.parse(text.replace("0.2", "0.2 s"), unit="ns")
        found = rtamt.dense.judge(spec, whole, "open", nan="unknown")
        (report,) = node.reports
        assert (report.lower, report.upper) == (found.lower, found.upper)
        assert report.verdict is found.verdict
        assert report.stale == tuple(name for name, gone in zip("xy", late, strict=True) if gone)
        assert report.restarts == 0
        assert (report.level is Level.STALE) == any(late)
        if any(late):
            assert math.isnan(ros.latched("rtamt/spec"))
        elif text in TEXTS[:2] and report.robustness is not None:
            assert found.lower <= report.robustness <= found.upper


def test_dense_robustness_restarts_after_silence(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.csv"
    ros, node = started(
        "slow = x < 3; out = always(slow and y > 0)", stale_as="unknown", dense=True, record=path
    )
    said = []
    for n in range(20):
        ros.time = START + n * 100 * MS
        if n < 3 or n > 12:
            send(ros, "x", 1.0)
        send(ros, "y", -2.0 if n == 10 else 5.0)
        ros.time += 1 * MS
        ros.tick()
        (report,) = node.reports
        said.append((report.verdict, report.level))
    undecided, violated = Verdict.UNDECIDED, Verdict.VIOLATED
    assert said[6] == (undecided, Level.OK)
    assert said[8] == (undecided, Level.STALE)
    assert said[10] == (violated, Level.STALE)
    assert said[19] == (violated, Level.ERROR)
    assert (report.robustness, report.upper, report.lower) == (-2, -2, -math.inf)
    assert report.violated_at == START + 1000 * MS
    node.stop()
    rows = [line.split(",")[1:] for line in path.read_text("utf-8").splitlines()]
    assert rows.count(["x", "nan"]) == 1


def test_other_words_are_refused() -> None:
    assert Settings(dense=True, stale_as="unknown").dense
    values = {name: default for name, (default, _) in PARAMETERS.items()}
    assert read(values)[1].stale_as == "restart"
    assert read({**values, "stale_as": "unknown"})[1].stale_as == "unknown"
    with pytest.raises(InputError, match="stale_as: expected"):
        read({**values, "stale_as": "hold"})
