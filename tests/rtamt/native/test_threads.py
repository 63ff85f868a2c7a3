"""Threads that monitor at the same time: each has the results of a single thread, or an error.

`.ci/run threads` runs these tests with a module that ThreadSanitizer watches.
"""

from __future__ import annotations

import ctypes
import math
import pickle
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import pytest
from bits import bits
from fmu_calls import FIRST, OK, Version, dense, sampled, unit, versions, write
from numpy.typing import NDArray

import rtamt
from rtamt import (
    EpisodeMonitor,
    InputError,
    Monitor,
    StateError,
    VectorEpisodeMonitor,
    VectorMonitor,
)
from rtamt.inputs.batch import BatchReader
from rtamt.inputs.event_reader import EventReader

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

T = TypeVar("T")
TEXT = "near = once[0:9](x > y)\nalways[0:30](near or eventually[0:5](y > 1))"
LONG = 20_000  # samples; from 10,000 on a call lets other threads run
THREADS = 4
RUNNING = (
    "the monitor is running in another thread; wait until that call returns, "
    "or make a monitor for each thread"
)


def at_once(*calls: Callable[[], T]) -> list[T]:
    """Return the results of the calls, each in a thread, all started together."""
    ready = threading.Barrier(len(calls))

    def run(call: Callable[[], T]) -> T:
        ready.wait()
        return call()

    with ThreadPoolExecutor(len(calls)) as pool:
        return [each.result() for each in [pool.submit(run, call) for call in calls]]


def trace(seed: int, n: int = LONG) -> dict[str, Any]:
    random = np.random.default_rng(seed)
    return {"x": random.normal(size=n), "y": random.normal(size=n)}


def entries(seed: int) -> Any:  # noqa: ANN401 - of three dimensions
    return np.random.default_rng(seed).normal(size=(60, 50, 2))


def events(seed: int, n: int = LONG) -> dict[str, Any]:
    return {
        name: rtamt.dense.Events(np.arange(n) * 0.5, values)
        for name, values in trace(seed, n).items()
    }


# The calls of a thread on its own monitors; numbers to compare.


def offline(seed: int) -> list[float]:
    return list(rtamt.evaluate(TEXT, trace(seed)))


def block(seed: int) -> list[float]:
    monitor = Monitor(TEXT)
    found = list(monitor.update_many(trace(seed)))
    return [*found, pickle.loads(pickle.dumps(monitor)).update(0.5, 0.2)]


def single(seed: int) -> list[float]:
    monitor, episode = Monitor(TEXT), EpisodeMonitor(TEXT)
    columns = trace(seed, 300)
    found = []
    for x, y in zip(columns["x"], columns["y"], strict=True):
        found += [monitor.update(x, y), episode.update(x=x, y=y), episode.lower, episode.upper]
    return [*found, episode.finish()]


def batches(seed: int) -> list[float]:
    late, episodes = VectorMonitor(TEXT, 50), VectorEpisodeMonitor(TEXT, 50, nan="unknown")
    found: list[float] = []
    for step, values in enumerate(entries(seed)):
        found += [*late.update(values), *episodes.update(np.where(values > 2, math.nan, values))]
        found += [*episodes.lower, *episodes.verdict]
        episodes.reset(np.arange(50) % 7 == step % 7)
    return found


def over_time(seed: int) -> list[float]:
    found = rtamt.dense.evaluate(TEXT, events(seed))
    episode = rtamt.dense.EpisodeMonitor(TEXT).update(events(seed, 500))
    return [*found.times, *found.values, episode]


def stepwise(seed: int) -> list[float]:
    monitor = rtamt.dense.Monitor(TEXT)
    columns = trace(seed, 300)
    found: list[float] = []
    for i in range(300):
        given = {name: [(i * 0.5, float(values[i]))] for name, values in columns.items()}
        for pair in monitor.update(given):
            found += pair
    return found


def judged(seed: int) -> list[float]:
    judgement = rtamt.dense.judge("always(x > y implies eventually[0:5](y > 1))", events(seed))
    return [judgement.robustness, judgement.verdict]


def many(seed: int) -> list[float]:
    """Return the outcomes of many traces, which C++ judges in threads of its own."""
    spec, lengths = "always(x > y implies eventually[0:5](y > 1))", [1, 7, 12, 180] * (LONG // 200)
    result = rtamt.judge_many(spec, trace(seed), lengths=lengths, threads=THREADS)
    (triggers,) = result.triggers
    return [*result.robustness, *result.lower, *result.verdict, *triggers.samples]


OWN = (offline, block, single, batches, over_time, stepwise, judged, many)


@pytest.mark.parametrize("work", OWN)
def test_monitors_of_threads_find_what_one_thread_finds(work: Callable[[int], list[float]]) -> None:
    alone = [bits(work(seed)) for seed in range(THREADS)]
    beside = at_once(*(partial(work, seed) for seed in range(THREADS)))
    assert list(map(bits, beside)) == alone


def test_monitors_of_all_kinds_run_beside_each_other() -> None:
    alone = [bits(work(1)) for work in OWN]
    assert list(map(bits, at_once(*(partial(work, 1) for work in OWN)))) == alone


# One monitor in two threads.


def test_threads_that_feed_one_monitor_damage_nothing() -> None:
    monitor, episode = Monitor("once(x)"), EpisodeMonitor("eventually(x > 0)")

    def feed(value: float) -> None:
        for _ in range(500):
            monitor.update(value)
            episode.update({"x": value})
            monitor.values  # noqa: B018 - read beside the other's updates
            pickle.dumps(episode)

    at_once(partial(feed, 1.0), partial(feed, 2.0))
    assert (monitor.samples, monitor.update(0.0)) == (1_000, 2.0)
    assert (episode.samples, episode.robustness) == (1_000, 2.0)


def test_blocks_of_threads_are_taken_whole_or_refused() -> None:
    monitor = Monitor("once(x)")

    def feed(value: float) -> int:
        taken = 0
        for _ in range(30):
            try:
                monitor.update_many({"x": np.full(LONG, value)})
            except StateError as error:
                assert str(error) == RUNNING  # noqa: PT017
            else:
                taken += 1
        return taken

    taken = at_once(partial(feed, 1.0), partial(feed, 2.0))
    assert monitor.samples == LONG * sum(taken)


def test_nothing_of_a_monitor_is_seen_while_a_block_runs() -> None:
    monitor = Monitor(TEXT)
    looks: list[Callable[[], object]] = [
        lambda: monitor.samples,
        lambda: monitor.values,
        lambda: monitor.update(1.0, 2.0),
        lambda: pickle.dumps(monitor),
        monitor.reset,
    ]
    done = threading.Event()

    def look() -> set[int]:
        refused: set[int] = set()
        while not done.is_set():
            for i, each in enumerate(looks):
                try:
                    each()
                except StateError as error:
                    assert str(error) == RUNNING  # noqa: PT017
                    refused.add(i)
        return refused

    def feed() -> set[int]:
        try:
            for seed in range(20):
                monitor.update_many(trace(seed))
        finally:
            done.set()
        return set()

    at_once(look, feed)


def test_entries_that_threads_feed_are_all_counted() -> None:
    late, episodes = VectorMonitor("once(x)", 6), VectorEpisodeMonitor("eventually(x > 0)", 6)

    def feed(first: int) -> None:
        mask = np.arange(6) % 2 == first
        for i in range(300):
            late.update([[i]] * 6, mask)
            episodes.update(np.full((6, 1), float(i)), mask)
            episodes.verdict  # noqa: B018 - read beside the other's updates
            pickle.dumps(late)

    at_once(partial(feed, 0), partial(feed, 1))
    assert late.samples.tolist() == episodes.samples.tolist() == [300] * 6
    assert late.update([[0]] * 6).tolist() == episodes.robustness.tolist() == [299.0] * 6


def test_an_episode_that_another_thread_ends_while_values_are_read_takes_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    episodes = VectorEpisodeMonitor("always(x > 0)", 2, nan="hold")
    episodes.update([[1.0], [2.0]])
    ends = BatchReader.ends

    def late(*args: Any) -> object:  # noqa: ANN401
        found = ends(*args)
        at_once(episodes.finish)
        return found

    monkeypatch.setattr(BatchReader, "ends", late)
    with pytest.raises(
        StateError, match=r"^the episode of batch entry 0 is finished; reset it before"
    ):
        episodes.update([[math.nan], [3.0]])
    assert episodes.samples.tolist() == [1, 1]


@pytest.mark.parametrize("kind", [rtamt.dense.Monitor, rtamt.dense.EpisodeMonitor])
def test_a_trace_is_refused_that_another_thread_ran_while_times_were_read(
    kind: type[rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = cast("Any", kind("always[0:3](x > 1)", backend="native")._machine)
    given = [(np.arange(3).astype("datetime64[s]"), np.ones(3))]
    counted = EventReader.counted

    def late(*args: Any) -> object:  # noqa: ANN401
        monkeypatch.setattr(EventReader, "counted", counted)
        at_once(lambda: machine.run(given))
        return counted(*args)

    monkeypatch.setattr(EventReader, "counted", late)
    with pytest.raises(ValueError, match=r"^expected a new machine$"):
        machine.run(given)


# Arrays that another thread writes to.


@pytest.mark.parametrize("text", ["x", "always[0:5](x)", "once(x)"])
def test_results_lie_between_those_of_the_values_that_an_array_had(text: str) -> None:
    x = np.zeros(LONG)
    done = threading.Event()

    def write_to_it() -> list[float]:
        while not done.is_set():
            x[:] = 1.0
            x[:] = 0.0
        return []

    def read() -> list[float]:
        try:
            return [v for _ in range(20) for v in rtamt.evaluate(text, {"x": x})]
        finally:
            done.set()

    found = at_once(read, write_to_it)[0]
    assert len(found) == 20 * LONG
    assert set(found) <= {0.0, 1.0}


Array = NDArray[np.float64]


def of_whole(x: Array) -> Array:
    return rtamt.evaluate("always[0:5](sqrt(x))", {"x": x})


def of_block(x: Array) -> Array:
    return rtamt.Monitor("historically[0:5](sqrt(x))").update_many({"x": x})


@pytest.mark.parametrize("values_of", [of_whole, of_block])
def test_a_term_that_loses_its_value_meanwhile_is_refused(
    values_of: Callable[[Array], Array],
) -> None:
    x = np.ones(LONG)
    done = threading.Event()

    def write_to_it() -> set[str]:
        while not done.is_set():
            x[:] = -1.0
            x[:] = 1.0
        return set()

    def read() -> set[str]:
        said: set[str] = set()
        try:
            for _ in range(1_000):
                try:
                    values = values_of(x)
                except InputError as error:
                    said.add(str(error).split(" at sample")[0])
                else:
                    assert set(values) == {1.0}
        finally:
            done.set()
        return said

    assert at_once(read, write_to_it)[0] <= {"'sqrt(x)' is not a number", "a term was not a number"}


@pytest.mark.parametrize("at", [600, 601, 1023])
def test_the_sample_is_named_that_lost_its_value_between_two_looks(
    at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every value is read first; then the results of the samples before it overwrite it."""
    monitor = Monitor("next(x > 0)", backend="native")
    machine = cast("Any", monitor._machine)
    memory = np.ones(2_500)
    monkeypatch.setattr(np, "empty", lambda n: memory[at : at + n])
    x = memory[:1_400]
    with pytest.raises(InputError, match=rf"^variable 'x' is nan at sample {at};"):
        machine.run([x], len(x))
    assert machine.samples == at // 256 * 256


# Units, which tools call from threads of their own.


@versions
@pytest.mark.parametrize("over", [sampled, dense])
def test_units_in_threads_give_what_they_give_alone(
    version: Version, over: Callable[[str], Any], tmp_path: Path
) -> None:
    folder = write(tmp_path, over(TEXT))

    def simulate(values: Mapping[str, Any]) -> list[int]:
        found: list[int] = []
        with unit(version, folder, logging=True) as made:
            made.begin()
            for i in range(200):
                assert made.set([FIRST, FIRST + 1], [values["x"][i], values["y"][i]]) == OK
                assert made.step(float(i), 1.0) == OK
                found += made.outputs()
            state = made.take()
            status, read = made.read(made.written(state))
            assert (status, made.restore(read)) == (OK, OK)
            found += made.outputs()
            for each in (state, read):
                assert made.call("FreeFMUState", ctypes.byref(each)) == OK
        return found

    traces = [trace(seed, 200) for seed in range(THREADS)]
    alone = [simulate(values) for values in traces]
    assert at_once(*(partial(simulate, values) for values in traces)) == alone
