"""An update costs the same in any window and at any time; a trace costs its length."""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Iterator
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from steps import StepCounter, counting_machines

import rtamt
from rtamt.machines.discrete import PythonDiscreteMachine
from rtamt.machines.protocols import End

pytestmark = pytest.mark.slow

Backend = Literal["native", "python"]
Columns = list[NDArray[np.float64]]

# The Python machines read each window completely.
NATIVE = [b for b in ("native",) if b == rtamt.BACKEND]

FORMULAS = (
    "always((a > 1) implies eventually[0:5](b > 0))",
    "always((a > 1) implies ((a > -1) until[2:20] (b > 1)))",
    "eventually always[0:20](a + b > -2) or (a > -1) since (b > 1)",
)
DENSE = (
    "always((a > 1) implies eventually[0:20](b < 0))",
    "(a > -1) until[5:20] (b > 1)",
    "(a > -1) since (b > 1)",
    "eventually[3:inf] always (a > -1)",
)


@pytest.fixture(scope="module")
def count(backend: Backend) -> Iterator[StepCounter]:
    """Return a counter of the back-end's steps."""
    if backend == "python":
        yield StepCounter()
        return
    machines = counting_machines()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rtamt.machines.native._native", machines)
        yield StepCounter(machines)


def noise(n: int) -> NDArray[np.float64]:
    return np.random.default_rng(7).standard_normal((n, 2))


def events(n: int) -> dict[str, rtamt.dense.Events]:
    """Return events at irregular times, on average one per unit of time."""
    times = np.cumsum(np.random.default_rng(5).uniform(0.5, 1.5, n))
    return {name: rtamt.dense.Events(times, v) for name, v in zip("ab", noise(n).T, strict=True)}


def pairs(column: rtamt.dense.Events) -> list[tuple[float, float]]:
    return list(zip(column.times.tolist(), column.values.tolist(), strict=True))


def test_the_machines_of_the_back_end_are_counted(count: StepCounter, backend: Backend) -> None:
    monitors = [rtamt.Monitor(text, backend=backend) for text in ("a > 0", "always[0:5](a > 0)")]
    short, long = (count(m.update, 1.0) for m in monitors)
    assert 0 < short < long


@pytest.mark.parametrize("text", ["historically[0:{}](a + b > -2)", "(a > -2) since[0:{}] (b > 1)"])
def test_the_worst_update_costs_the_same_in_any_window(
    text: str, count: StepCounter, backend: Backend
) -> None:
    rows = noise(2_200).tolist()

    def worst(window: int) -> int:
        monitor = rtamt.Monitor(text.format(window), backend=backend)
        monitor.update_many(rows[:1_100])
        return max(count(monitor.update, *row) for row in rows[1_100:])

    assert worst(999) <= 1.1 * worst(9)


@pytest.mark.parametrize("text", FORMULAS)
def test_an_episode_costs_and_holds_the_same_late_as_early(
    text: str, count: StepCounter, backend: Backend
) -> None:
    monitor = rtamt.EpisodeMonitor(text, backend=backend)

    def feed(rows: list[list[float]]) -> None:
        for row in rows:
            monitor.update(*row)

    rows = noise(1_000).tolist()
    feed(rows[:100])
    early, held = count(feed, rows[100:200]), len(pickle.dumps(monitor))
    feed(rows[200:900])
    assert count(feed, rows[900:]) <= 1.1 * early
    assert len(pickle.dumps(monitor)) <= 1.1 * held


@pytest.mark.parametrize(
    ("text", "drift"),
    [
        *itertools.product(
            (
                "always((a > 1) implies eventually[0:{}](b > 1))",
                "eventually((a > 1) and always[3:{}](b > 1))",
                "always((a > 1) implies always[0:{}](b > 1))",
            ),
            (0.0, 1.0, -1.0),
        ),
        ("always((a > 1) implies eventually[0:{}] always[0:50](b > -1))", 0.0),
        (
            "always((a < 1 or eventually[0:{0}](b > 1)) and (b < 2 or always[2:{0}](a > 1)))",
            0.0,
        ),
    ],
)
@pytest.mark.parametrize("backend", NATIVE, scope="session")
def test_a_sample_of_an_episode_costs_the_same_in_any_window(
    text: str, drift: float, count: StepCounter, backend: Backend
) -> None:
    ramp = np.arange(2_200.0)[:, np.newaxis]
    rows = np.where(ramp % 1_500 == 1_400, 0.0, noise(2_200) + drift * (ramp + 99)).tolist()

    def spent(window: int) -> tuple[int, int]:
        monitor = rtamt.EpisodeMonitor(text.format(window), backend=backend)
        for row in rows[:1_100]:
            monitor.update(*row)
        steps = [count(monitor.update, *row) for row in rows[1_100:]]
        return sum(steps), max(steps)

    (short, worst_of_short), (long, worst_of_long) = spent(99), spent(999)
    assert long <= 1.1 * short
    assert worst_of_long <= 3 * worst_of_short


@pytest.mark.parametrize("text", FORMULAS)
def test_a_whole_trace_costs_its_length(text: str, count: StepCounter, backend: Backend) -> None:
    spec = rtamt.parse(text)
    short, long = (count(rtamt.evaluate, spec, noise(n), backend=backend) for n in (500, 2_000))
    assert long <= 4 * 1.1 * short


@pytest.mark.parametrize("text", DENSE)
def test_a_whole_trace_of_events_costs_their_number(
    text: str, count: StepCounter, backend: Backend
) -> None:
    spec = rtamt.parse(text)
    short, long = (
        count(rtamt.dense.evaluate, spec, events(n), backend=backend) for n in (500, 2_000)
    )
    assert long <= 4 * 1.1 * short


def test_an_event_costs_the_same_in_any_window(count: StepCounter, backend: Backend) -> None:
    rows = pairs(events(2_000)["a"])

    def spent(window: int) -> int:
        monitor = rtamt.dense.Monitor(f"always[0:{window}](a > -2)", backend=backend)
        monitor.update({"a": rows[:1_000]})
        return sum(count(monitor.update, {"a": [row]}) for row in rows[1_000:])

    assert spent(500) <= 1.1 * spent(20)


@pytest.mark.parametrize("backend", NATIVE, scope="module")
@pytest.mark.parametrize(
    "text",
    [
        "always(a > 1 implies eventually[0:{w}](b > 1))",
        "always(a > 1 implies always[0:{w}](b > -9))",
        "always(a > 1 implies once[0:{w}](b > 1))",
    ],
)
def test_an_event_of_an_episode_changes_few_open_values(
    text: str, count: StepCounter, backend: Backend
) -> None:
    trace = events(800)
    a, b = pairs(trace["a"]), pairs(trace["b"])

    def spent(window: int) -> int:
        monitor = rtamt.dense.EpisodeMonitor(text.format(w=window), backend=backend)
        monitor.update({"a": a[:700], "b": b[:700]})
        later = zip(a[700:], b[700:], strict=True)
        return sum(count(monitor.update, {"a": [x], "b": [y]}) for x, y in later)

    # A fold that is computed again at each event costs 25 times as much in the wider window.
    assert spent(500) <= 2.5 * spent(20)


def test_an_event_costs_the_same_while_a_variable_runs_ahead(
    count: StepCounter, backend: Backend
) -> None:
    trace = events(4_000)
    ahead, late = pairs(trace["a"]), pairs(trace["b"])[:100]

    def spent(lead: int) -> int:
        monitor = rtamt.dense.Monitor("always[0:1](a + b > -2)", backend=backend)
        monitor.update({"a": ahead[:lead]})
        return sum(count(monitor.update, {"b": [row]}) for row in late)

    assert spent(4_000) <= 1.1 * spent(200)


@pytest.mark.parametrize("backend", NATIVE)
@pytest.mark.parametrize("text", DENSE)
def test_python_reads_whole_arrays_of_events(text: str, backend: Backend) -> None:
    lines, spec = StepCounter(), rtamt.parse(text)

    def whole(n: int) -> dict[str, rtamt.dense.Events]:
        """Return events at whole milliseconds: exact arithmetic is for times between two ticks."""
        return {v: rtamt.dense.Events(np.round(e.times, 3), e.values) for v, e in events(n).items()}

    def judged(n: int) -> int:
        return lines(rtamt.dense.judge, spec, whole(n), "open", backend=backend)

    def taken(n: int) -> int:
        monitor = rtamt.dense.EpisodeMonitor("always(a + b > -99)", backend=backend)
        return lines(monitor.update, whole(n))

    for spent in (judged, taken):
        spent(200)  # the first call compiles
        assert 0 < spent(2_000) <= 1.1 * spent(200)


def test_an_episode_of_events_costs_the_same_while_a_variable_runs_ahead(
    count: StepCounter, backend: Backend
) -> None:
    trace = events(4_000)
    ahead, late = pairs(trace["a"]), pairs(trace["b"])[:100]

    def spent(lead: int) -> int:
        monitor = rtamt.dense.EpisodeMonitor("always[0:1](a + b > -99)", backend=backend)
        monitor.update({"a": ahead[:lead]})
        return sum(count(monitor.update, {"b": [row]}) for row in late)

    assert spent(4_000) <= 1.1 * spent(200)


@pytest.mark.parametrize("end", ["cut", "open", "complete"])
@pytest.mark.parametrize(
    "text",
    [
        "always((a > 1) implies ((a > -1) until (b > 1)))",
        "eventually always eventually (a > 0)",
        "always((once[0:5] (a > 1)) implies eventually (b > 0))",
        "always eventually[0:5] ((a > 0) since[0:3] (b > 0))",
        "always((a > -1) until[0:4] once[0:3] (b > 2))",
    ],
)
def test_a_judgement_reads_the_trace_once(
    text: str, end: End, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert samples_read(text, end, monkeypatch) == 500


def samples_read(text: str, end: End, monkeypatch: pytest.MonkeyPatch) -> int:
    """Return the number of samples that the machines read to judge a trace of 500."""
    evaluate, run, taken = PythonDiscreteMachine.evaluate, PythonDiscreteMachine.run, list[int]()

    def counted_run(self: PythonDiscreteMachine, columns: Columns, n: int) -> Columns:
        taken.append(n)
        return run(self, columns, n)

    def counted(
        self: PythonDiscreteMachine, columns: Columns, n: int, *, backwards: bool = False
    ) -> Columns:
        taken.append(n)
        return evaluate(self, columns, n, backwards=backwards)

    monkeypatch.setattr(PythonDiscreteMachine, "evaluate", counted)
    monkeypatch.setattr(PythonDiscreteMachine, "run", counted_run)
    a, b = noise(500).T
    rtamt.judge(text, {"a": a, "b": b}, end=end, backend="python")
    return sum(taken)
