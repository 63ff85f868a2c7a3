"""Forged states of native machines are refused, and later calls are safe."""

from __future__ import annotations

import contextlib
import math
import pickle
import random
import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import rtamt
from rtamt import EpisodeMonitor, Monitor, VectorEpisodeMonitor, VectorMonitor
from rtamt.machines.clocks import OperatorClock

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

ENTRIES = 3
PAST = "prev(historically[0:7](x > 0))"
FUTURE = f"always[5:inf]({PAST})"
DAMAGED = r"^expected a whole state, got a damaged one$"
SAMPLES = 61
LIMIT = 2**62

MAKERS: dict[str, Callable[[], Any]] = {
    "discrete": lambda: Monitor(PAST, backend="native"),
    "episode": lambda: EpisodeMonitor(FUTURE, backend="native"),
    "discrete batch": lambda: VectorMonitor(PAST, ENTRIES, backend="native"),
    "episode batch": lambda: VectorEpisodeMonitor(FUTURE, ENTRIES, backend="native"),
}

kinds = pytest.mark.parametrize("kind", MAKERS)


def feed(kind: str, monitor: Any, n: int) -> None:  # noqa: ANN401 - any monitor of samples
    for _ in range(n):
        monitor.update(np.ones((ENTRIES, 1)) if "batch" in kind else 1.0)


def counting(state: bytes, samples: int) -> bytes:
    """Return the state with another number of samples."""
    held, forged = (struct.pack("=q", n) for n in (SAMPLES, samples))
    assert held in state
    return state.replace(held, forged)


@kinds
@pytest.mark.parametrize("samples", [LIMIT, 2**63 - 32, -1])
def test_a_count_of_samples_that_no_machine_reaches_is_refused(kind: str, samples: int) -> None:
    monitor = MAKERS[kind]()
    feed(kind, monitor, SAMPLES)
    state = monitor._machine.state()
    with pytest.raises(ValueError, match=DAMAGED):
        monitor._machine.restore(counting(state, samples))
    assert monitor._machine.state() == state


@kinds
def test_the_greatest_count_of_samples_is_counted_on(kind: str) -> None:
    monitor = MAKERS[kind]()
    feed(kind, monitor, SAMPLES)
    monitor._machine.restore(counting(monitor._machine.state(), LIMIT - 1))
    feed(kind, monitor, 60)
    assert np.all(monitor.samples == LIMIT + 59)


def test_a_window_holds_no_more_than_its_state(monkeypatch: pytest.MonkeyPatch) -> None:
    many = 2**31  # numbers of 8 bytes each, for which there may be no memory
    monkeypatch.setattr(rtamt.limits, "window_bytes", 2**40)
    monitor = EpisodeMonitor(f"always(x > 0 or eventually[{many}:{many}](x > 1))", backend="native")
    feed("episode", monitor, SAMPLES)
    state = monitor._machine.state()
    with pytest.raises(ValueError, match=DAMAGED):
        monitor._machine.restore(counting(state, many))
    assert monitor._machine.state() == state


def test_the_place_in_a_window_lies_within_its_block_in_a_state() -> None:
    """A window of 8 has two blocks of 4; each sample advances one place."""
    monitor = Monitor("once[0:7](x > 0)", backend="native")
    monitor.update(1.0)
    monitor.update(1.0)
    machine = monitor._machine
    state, place = machine.state(), struct.pack("=QQ", 2, 4)
    assert state.count(place) == 1
    for other, limit in ((4, 4), (5, 4), (2, 5), (2, 2)):
        refused(machine, state.replace(place, struct.pack("=QQ", other, limit)))


CHANGED: dict[str, Callable[[], Any]] = {
    "discrete": lambda: Monitor("y = once[0:40](x > 2); next(historically[3:9](x > 1)) and y"),
    "discrete pairs": lambda: Monitor("(x > 0) until[2:30] (x > 1)"),
    "episode": lambda: EpisodeMonitor("always((x > 0) implies eventually[0:5](x > 1))"),
    "episode pairs": lambda: EpisodeMonitor("always((x > 0) until[3:9] (once[2:8](x > 1)))"),
    "dense": lambda: rtamt.dense.Monitor("(x > 0) until[1:3] (once[0:2](x > 1))"),
    "discrete batch": lambda: VectorMonitor("always[0:9](x > 1) or prev(x > 2)", ENTRIES),
    "episode batch": lambda: VectorEpisodeMonitor("always(eventually[0:5](x > 1))", ENTRIES),
    "episode batch of machines": lambda: VectorEpisodeMonitor(
        "always((x > 0) until[3:9] (once[2:8](x > 1)))", ENTRIES
    ),
    "dense episode": lambda: rtamt.dense.EpisodeMonitor(
        "always((x > 0) until[1:3] (once[0:2](x > 1)) or eventually(x > 3))", backend="native"
    ),
}


def play(kind: str, monitor: Any, rng: random.Random, n: int) -> None:  # noqa: ANN401 - as feed
    for _ in range(n):
        if "dense" in kind:
            begin = max(0.0, monitor.settled) + 9.0
            monitor.update({"x": [(begin + rng.random(), rng.gauss(0, 2))]})
        else:
            x = rng.gauss(0, 2)
            monitor.update([[x], [1.0], [-x]] if "batch" in kind else x)


@pytest.mark.parametrize("kind", CHANGED)
def test_changed_bytes_are_refused_and_change_nothing_or_are_a_state(kind: str) -> None:
    rng, refused = random.Random(7), 0
    monitor = CHANGED[kind]()
    play(kind, monitor, rng, 50)
    machine = monitor._machine
    state = machine.state()
    for _ in range(500):
        damaged = bytearray(state)
        for _ in range(rng.choice((1, 1, 2, 8))):
            damaged[rng.randrange(8, len(state))] = rng.choice((0, 1, 0x7F, 0x80, 0xF0, 0xFF))
        whole = bytes(damaged[: len(state) - rng.choice((0, 0, 0, 8, 20))])
        try:
            machine.restore(whole)
        except ValueError:
            refused += 1
            assert machine.state() == state
            continue
        with contextlib.suppress(ValueError, RuntimeError):  # any result is accepted
            play(kind, monitor, rng, 3)
        machine.restore(state)
    assert refused > 100


def test_a_constant_in_a_state_must_be_that_of_the_program() -> None:
    monitor = Monitor("x > 17.25", backend="native")
    monitor.update(1.0)
    state = monitor._machine.state()
    constant = struct.pack("=d", 17.25)
    assert constant in state
    for other in (math.nan, 18.0):
        with pytest.raises(ValueError, match=DAMAGED):
            monitor._machine.restore(state.replace(constant, struct.pack("=d", other)))
        assert monitor._machine.state() == state


@pytest.mark.parametrize(
    "text", ["once[0:9](x > 0)", "next(x > 0)", "historically(x > 0)", "x > 0"]
)
def test_no_number_of_a_state_is_nan(text: str) -> None:
    monitor = Monitor(text, backend="native")
    monitor.update(0.1234567)
    state, nan = monitor._machine.state(), struct.pack("=d", math.nan)
    held = struct.pack("=d", 0.1234567)
    at = state.find(held)
    assert at > 0
    while at > 0:
        with pytest.raises(ValueError, match=DAMAGED):
            monitor._machine.restore(state[:at] + nan + state[at + 8 :])
        assert monitor._machine.state() == state
        at = state.find(held, at + 1)


@pytest.mark.parametrize("backend", ["native", "python"])
def test_a_refused_state_changes_neither_the_machine_nor_its_history(backend: Any) -> None:  # noqa: ANN401 - a name
    def made(*samples: float) -> EpisodeMonitor:
        monitor = EpisodeMonitor("always(x > 1)", history=True, backend=backend)
        for x in samples:
            monitor.update(x)
        return monitor

    monitor, other = made(5.0, 0.0, 3.0), made(2.0, 7.0)
    before = pickle.dumps(monitor)
    given: Any = other._state()
    state, history = given
    refusals = [
        ((state, history + bytes(8)), "expected a history of 2 samples of x, got 3 numbers"),
        ((state, history[:-8]), "expected a history of 2 samples of x, got 1 numbers"),
        ((state, history[:-1]), "bytes length not a multiple of item size"),
    ]
    if backend == "native":
        refusals.append(((state[:-1], history), "expected a whole state, got a damaged one"))
    for damaged, message in refusals:
        with pytest.raises(ValueError, match=f"^{message}$"):
            monitor.__setstate__(damaged)
        assert pickle.dumps(monitor) == before
        assert monitor.explain().causes[0].sample == 1
    monitor.__setstate__((state, history))
    assert monitor.explain().causes[0].sample == 0


def refused(machine: Any, state: bytes) -> None:  # noqa: ANN401 - any machine
    before = machine.state()
    with pytest.raises(ValueError, match=DAMAGED):
        machine.restore(state)
    assert machine.state() == before


@pytest.mark.parametrize("text", ["once(x > 0)", "x since y", "historically[2:inf](x > 0)"])
def test_a_window_that_no_step_leaves_holds_none_in_a_state(text: str) -> None:
    machine = rtamt.dense.Monitor(text, backend="native")._machine
    places = list(with_a_step_more(machine.state()))
    assert places
    for state in places:
        refused(machine, state)


@pytest.mark.parametrize("text", ["once[0:5](x > 0)", "(x > 0) since[1:5] (y > 0)"])
def test_a_window_holds_older_steps_only_beside_newer_ones_in_a_state(text: str) -> None:
    machine = rtamt.dense.Monitor(text, backend="native")._machine
    before, found = machine.state(), list[bool]()
    for state in with_a_step_more(before):
        try:
            machine.restore(state)
        except ValueError:
            found.append(False)
            assert machine.state() == before
        else:  # the first step of a window, which is a newer one
            found.append(True)
            assert machine.state() == state
            machine.restore(before)
    assert set(found) == {True, False}


def with_a_step_more(state: bytes) -> Iterator[bytes]:
    """Return a state in which a count of 0 is 1, with an element after it."""
    for at in range(8, len(state) - 7):
        if state[at : at + 8] == bytes(8):
            for size in (16, 24):
                yield state[:at] + struct.pack("=Q", 1) + bytes(size) + state[at + 8 :]


def test_a_default_in_a_state_is_a_number() -> None:
    monitor = rtamt.dense.Monitor(
        "float x = 7.25\nfloat y\nonce(x > 0) and y > 0", backend="native"
    )
    monitor.update(y=[(0.0, 1.0)])
    machine = monitor._machine
    state, held = machine.state(), struct.pack("=d", 7.25)
    at = state.find(held)
    assert at > 0
    while at > 0:
        refused(machine, state[:at] + struct.pack("=d", math.nan) + state[at + 8 :])
        at = state.find(held, at + 1)


def test_a_signal_that_no_operator_reads_has_a_value_in_a_state() -> None:
    """Such signals are inside terms: nothing writes or reads their values."""
    monitor = rtamt.dense.Monitor("x - y > 3", backend="native")
    monitor.update(x=[(0, 1.0), (1, 2.0)], y=[(0, 1.0), (2, 9.0)])
    state = monitor._machine.state()
    before, nothing = struct.pack("=q", -(2**63)), struct.pack("=q", 0)
    value = struct.pack("=q", 1) + before + struct.pack("=d", math.nan)
    places = [i for i in range(len(state)) if state.startswith(value + before, i)]
    assert places
    for place in places:
        refused(monitor._machine, state[:place] + nothing + state[place + len(value) :])


def test_an_episode_over_dense_time_begins_where_it_can_have_begun() -> None:
    """A state is a mark of the program, whether it is finished, the times, and the start."""
    monitor = rtamt.dense.EpisodeMonitor("always(x > 0)", backend="native")
    machine = monitor._machine
    fresh = machine.state()
    refused(machine, fresh[:8] + b"\1" + fresh[9:])  # finished before it starts
    far = 4 * 10**18
    monitor.update(x=[(far / 1e9, 1.0)])
    state = machine.state()
    assert struct.unpack_from("=q", state, 10) == (far,)
    for begin in (-far, far - 1, far + 1):
        refused(machine, state[:10] + struct.pack("=q", begin) + state[18:])


def uncertain(entries: int) -> Any:  # noqa: ANN401 - of either kind
    """Return a monitor with two machines that took different samples."""
    if entries:
        many = VectorEpisodeMonitor("always(x > 0)", entries, nan="unknown", backend="native")
        many.update(np.array([[math.nan], [1.0]]))
        return many
    one = EpisodeMonitor("always(x > 0)", nan="unknown", backend="native")
    one.update(math.nan)
    return one


@pytest.mark.parametrize("entries", [0, 2])
def test_the_two_machines_of_what_is_uncertain_have_seen_the_same(entries: int) -> None:
    """Each byte of a state is changed alone; an accepted state continues equally."""
    made, other = uncertain(entries), uncertain(entries)
    other.finish()
    other._machine.restore(made._machine.state())
    machine, state = made._machine, made._machine.state()
    for at in range(8, len(state)):
        for byte in (0, 1, 2):
            if state[at] == byte:
                continue
            try:
                machine.restore(state[:at] + bytes([byte]) + state[at + 1 :])
            except ValueError:
                assert machine.state() == state
                continue
            assert np.all(machine.samples == np.ones(entries or 1)), at
            assert not np.any(machine.finished), at
            machine.restore(state)


def test_entries_that_are_cut_twice_stay_as_they_were_cut() -> None:
    monitor = uncertain(2)
    monitor.finish(np.array([True, False]), end="cut")
    before = np.stack([monitor.robustness, monitor.lower, monitor.upper])
    monitor.finish(end="cut")
    after = np.stack([monitor.robustness, monitor.lower, monitor.upper])
    assert np.array_equal(before[:, 0], after[:, 0])
    assert np.all(monitor.finished)


@pytest.mark.parametrize("count", [-1, 2**63 - 1, -(2**63)])
def test_clocks_of_operators_count_to_their_ends(count: int) -> None:
    native = pytest.importorskip("rtamt._native")
    row = OperatorClock("oldest", "holds", 0, 5, 0, ((0, 0),))
    batch = native.ClockBatch([row], 1, 3)
    batch.feed(np.array([-1.0, -1.0, -1.0]))
    batch.feed(np.array([-1.0, 1.0, -1.0]))
    state = batch.state()
    tried = 0
    for at in range(8, len(state) - 7, 8):
        if 0 < struct.unpack_from("=q", state, at)[0] < 9:
            refused(batch, state[:at] + struct.pack("=q", count) + state[at + 8 :])
            tried += 1
    assert tried >= 6
