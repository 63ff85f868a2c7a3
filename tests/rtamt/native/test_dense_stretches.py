"""Dense time on traces that are long compared with their windows: C++ against Python.

The traces of the property tests are a few steps long, so that the definition is fast. In long
traces, queues wrap around, memory before them is freed, and folds of settled values stand next to
folds of open ones.
"""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import astuple
from typing import get_args

import pytest
from dense_signals import Breakpoints, Signals

import rtamt
from rtamt.machines.protocols import End
from rtamt.typing import SemanticsName

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

NAMES = ("x", "y", "z")
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
EVENTS = 50
"""For each variable, at most three times as many ticks of half a second."""

RESOLUTIONS = ("1ns", "500ms")
ROOTS = ("", "always", "eventually", "always[0:20]", "not eventually")


def formula(rng: random.Random, depth: int, *, endless: bool) -> str:
    """A formula of every operator, with windows up to 12 s; some are points."""
    if not depth or rng.random() < 0.1:
        return f"({rng.choice(NAMES)} {rng.choice(COMPARISONS)} {rng.randint(-1, 1)})"
    p, q = (formula(rng, depth - 1, endless=endless) for _ in range(2))
    begin = rng.choice((0, 0, 0.5, 2, 5))
    end = begin + rng.choice((0, 0.5, 1, 3.5, 12))
    past = f"[{begin}:{rng.choice((end, end, 'inf'))}]"
    ahead = f"[{begin}:{rng.choice((end, end, 'inf')) if endless else end}]"
    return rng.choice(
        [
            f"not({p})",
            f"({p} {rng.choice(('and', 'or', 'implies', 'iff', 'xor'))} {q})",
            f"(historically{past} {p})",
            f"(once{past} {p})",
            f"(always{ahead} {p})",
            f"(eventually{ahead} {p})",
            f"({p} since{past} {q})",
            f"({p} until{ahead} {q})",
            f"({p} unless{ahead} {q})",
        ]
    )


def signals(rng: random.Random, count: int) -> Signals:
    """Integers with many differences of 0, in runs and alternating, including 0.0 and -0.0.

    Some rise or fall over time, so that minima and maxima so far do not help.
    """
    found: Signals = {}
    for name in NAMES:
        ticks = itertools.accumulate(rng.choice((1, 1, 2, 3)) for _ in range(count))
        most, slope = rng.choice((1, 2, 5)), rng.choice((0, 0, 1, -1))
        values = (0.0, -0.0, *map(float, range(-most, most + 1)))
        found[name] = [
            (tick / 2, rng.choice(values) + slope * (i // 3) if slope else rng.choice(values))
            for i, tick in enumerate(ticks)
        ]
    return found


SIZES = (0, 1, 2, 7, 20)


def calls(rng: random.Random, whole: Signals, sizes: tuple[int, ...] = SIZES) -> list[Signals]:
    """Return the events in chunks of these sizes, in which one variable lags behind the others."""
    waiting = {name: list(events) for name, events in whole.items()}
    found: list[Signals] = []
    while any(waiting.values()):
        call = {}
        for name, events in waiting.items():
            size = rng.choice(sizes)
            if events[:size]:
                call[name] = events[:size]
                del events[:size]
        found.append(call)
    return found


def bits(steps: Breakpoints) -> list[tuple[float, float, float]]:
    return [(time, value, math.copysign(1, value)) for time, value in steps]


@pytest.mark.slow(keep=10)
@pytest.mark.parametrize("seed", range(60))
def test_a_monitor(seed: int) -> None:
    rng = random.Random(seed)
    text, resolution = formula(rng, 3, endless=False), rng.choice(RESOLUTIONS)
    native, python, twin = (
        rtamt.dense.Monitor(text, resolution=resolution, backend=b)
        for b in ("native", "python", "native")
    )
    whole = {n: e for n, e in signals(rng, EVENTS).items() if n in native.variables}
    for call in calls(rng, whole):
        assert bits(native.update(call)) == bits(python.update(call)), text
        if rng.random() < 0.3:
            twin._machine.restore(native._machine.state())
            assert twin._machine.state() == native._machine.state()
            native, twin = twin, native
    assert bits(native.finish()) == bits(python.finish()), text


def agree(
    rng: random.Random,
    text: str,
    resolution: str,
    count: int = EVENTS,
    sizes: tuple[int, ...] = SIZES,
    restored: float = 0.3,
) -> None:
    """Compare an episode in both back-ends, after each call, each restored state, and each end."""
    native, python, twin = (
        rtamt.dense.EpisodeMonitor(text, resolution=resolution, backend=b)
        for b in ("native", "python", "native")
    )
    whole = {n: e for n, e in signals(rng, count).items() if n in native.variables}
    for call in calls(rng, whole, sizes):
        assert repr(native.update(call)) == repr(python.update(call)), text
        assert repr(native.bounds()) == repr(python.bounds()), text
        assert (native.decided_at, native.settled) == (python.decided_at, python.settled), text
        if rng.random() < restored:
            twin._machine.restore(native._machine.state())
            assert twin._machine.state() == native._machine.state()
            native, twin = twin, native
    end = rng.choice(get_args(End))
    assert repr(native.finish(end)) == repr(python.finish(end)), text
    assert repr(native.bounds()) == repr(python.bounds()), text
    for end in get_args(End):
        found, expected = (
            rtamt.dense.judge(text, whole, end, resolution=resolution, backend=b)
            for b in ("native", "python")
        )
        assert repr(found) == repr(expected), (text, end)
        assert list(map(astuple, found.triggers)) == list(map(astuple, expected.triggers)), (
            text,
            end,
        )
        assert (found.vacuous, found.unrecorded) == (expected.vacuous, expected.unrecorded)


@pytest.mark.slow(keep=10)
@pytest.mark.parametrize("seed", range(120))
def test_an_episode_and_what_its_verdict_stands_on(seed: int) -> None:
    rng = random.Random(seed)
    text = formula(rng, 2, endless=True)
    if rng.random() < 0.5:
        text = f"({formula(rng, 1, endless=True)} implies {text})"
    agree(rng, f"{rng.choice(ROOTS)} {text}", rng.choice(RESOLUTIONS))


NESTED = (
    "eventually(eventually[0.5:1]((x > 0) until[0.5:1.5] (y > 0)))",
    "always(eventually[0:9](x > 0))",
    "eventually((x > 1) and always[1:12](y > -1))",
    "always((x > 0) until (eventually[0:2](y > 0)))",
    "always(eventually(always(x > -2) or y > 0))",
    "always((x > 0) unless eventually[0.5:2](x > 0))",
    "always(eventually[0.5:2](x > 0) or always(x > 0))",
    "always(eventually[0:1](y > 0) unless eventually[0.5:2](x > 0))",
)


@pytest.mark.slow(keep=6)
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("text", NESTED)
def test_an_episode_of_windows_that_settle_late(text: str, seed: int) -> None:
    rng = random.Random(seed)
    agree(rng, text, "500ms", sizes=(0, 1, 2), restored=0.0)
    for _ in range(2):
        agree(rng, text, "500ms", count=7, sizes=(0, 1, 1), restored=1.0)
        agree(rng, text, "500ms", count=14, sizes=(0, 1, 2))


NEUTRAL = """
input float64 x
output float64 y
output float64 z
"""


@pytest.mark.slow(keep=6)
@pytest.mark.parametrize("semantics", ["output-robustness", "input-vacuity", "output-vacuity"])
@pytest.mark.parametrize("seed", range(12))
def test_an_episode_of_neutral_predicates_after_its_decision(
    seed: int, semantics: SemanticsName
) -> None:
    """Two programs, for the minimum and the maximum, each with its own terms."""
    rng = random.Random(seed)
    text = NEUTRAL + f"always[0:5]({formula(rng, 2, endless=False)} or x > y)"
    native, python = (
        rtamt.dense.EpisodeMonitor(text, semantics=semantics, backend=b)
        for b in ("native", "python")
    )
    whole = {n: e for n, e in signals(rng, 40).items() if n in native.variables}
    for call in calls(rng, whole, (0, 1, 1)):
        assert repr(native.update(call)) == repr(python.update(call)), text
        assert repr(native.bounds()) == repr(python.bounds()), text


ENDLESS = (
    "eventually[0.5:1](always(x > 0))",
    "always[0.5:1](eventually(x > 0))",
    "(y > 0) until[0.5:1] (always(x > 0))",
    "eventually(once[0:1](x > 0))",
)


@pytest.mark.slow(keep=20)
@pytest.mark.parametrize("seed", range(150))
def test_what_a_verdict_stands_on(seed: int) -> None:
    rng = random.Random(seed)
    left = rng.choice((formula(rng, 2, endless=True), rng.choice(ENDLESS)))
    right = formula(rng, 1, endless=True)
    text = f"{rng.choice(('', 'always', 'always[0:3]'))}({left} implies {right})"
    names = rtamt.parse(text).variables
    whole = {n: e for n, e in signals(rng, rng.randint(4, 12)).items() if n in names}
    for end in get_args(End):
        native, python = (
            rtamt.dense.judge(text, whole, end, resolution="500ms", backend=b)
            for b in ("native", "python")
        )
        assert repr(native) == repr(python), (text, end)
        assert list(map(astuple, native.triggers)) == list(map(astuple, python.triggers)), (
            text,
            end,
        )
        assert (native.vacuous, native.never_triggered) == (python.vacuous, python.never_triggered)


ENDS = (
    # A bounded window of the future reads its values even before its start; a part of an unbounded
    # operator is still open then.
    "always[1:2](historically[0:1](x > 0))",
    "eventually[1:2](once[0:2](x < 0))",
    "always(always[1:2](historically[0:1](x > 0)))",
    "(eventually(x > 0)) until[1:inf] (y > 0)",
    "always((eventually(x > 0)) until[1:inf] (y > 0))",
    # The best value exceeds the present one, also through a window of the whole past.
    "always(once(eventually[0:2](x > 0)))",
    "always(historically(eventually[0:2](x > 0)))",
    "eventually(historically(always[0:2](x < 0)))",
)


@pytest.mark.parametrize("end", get_args(End))
@pytest.mark.parametrize("text", ENDS)
def test_an_episode_that_ends_at_each_tick(text: str, end: End) -> None:
    """Before a window starts, on the tick before it, while it lasts, and after it."""
    for ticks in range(1, 8):
        native, python = (
            rtamt.dense.EpisodeMonitor(text, resolution="500ms", backend=b)
            for b in ("native", "python")
        )
        call = {name: [(k / 2, -1.0) for k in range(ticks)] for name in native.variables}
        assert repr(native.update(call)) == repr(python.update(call)), ticks
        assert repr(native.bounds()) == repr(python.bounds()), ticks
        assert repr(native.finish(end)) == repr(python.finish(end)), ticks
        assert repr(native.bounds()) == repr(python.bounds()), ticks


STAIRS = (
    "eventually[0:20](x > 0)",
    "once[0:20](x > 0)",
    "always(eventually[0:20](x > 0))",
    "eventually(always[0:20](x < 0))",
    "always(eventually[0:20](x > 0) or historically[2:19](x > -3))",
    "eventually[0:90](always[0:20](eventually[0:15](x > 0)))",
)


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize("way", [-1, 1])
@pytest.mark.parametrize("text", STAIRS)
def test_an_episode_of_values_that_fall_or_rise(text: str, way: int) -> None:
    """Each window of 20 s has a step of its fold for each of its 40 events, and all leave it."""
    native, python = (
        rtamt.dense.EpisodeMonitor(text, resolution="500ms", backend=b)
        for b in ("native", "python")
    )
    for i in range(150):
        value = way * (i - 100.0) if i % 29 else 0.0
        for each in (native, python):
            each.update(x=[(i / 2, value)])
        if i % 10 == 0:
            assert repr(native.bounds()) == repr(python.bounds()), i
            assert repr(native.robustness) == repr(python.robustness), i
    assert repr(native.finish()) == repr(python.finish())


def test_many_events_at_once_and_then_one_by_one() -> None:
    """The memory of a block that is much longer than others is freed."""
    text = "always((x > -2) or eventually[0:3](y > 1))"
    native, python = (
        rtamt.dense.EpisodeMonitor(text, resolution="500ms", backend=b)
        for b in ("native", "python")
    )
    rng = random.Random(7)
    for n in (3000, 1, 2, 2500, 1):
        begin = native.settled if native.settled > 0 else 0.0
        call = {
            name: [(begin + (k + 1) / 2, float(rng.randint(-1, 2))) for k in range(n)]
            for name in ("x", "y")
        }
        assert repr(native.update(call)) == repr(python.update(call)), n
        assert repr(native.bounds()) == repr(python.bounds()), n
    assert native.decided_at is None
    assert repr(native.finish("cut")) == repr(python.finish("cut"))


def test_a_trace_that_is_longer_than_its_clock_counts_is_refused() -> None:
    said = set()
    for backend in ("native", "python"):
        monitor = rtamt.dense.EpisodeMonitor("always(x > 0)", backend=backend)
        monitor.update(x=[(-4e9, 1.0), (4e8, 2.0)])
        for last in (5e8, 4e9, 4.6e9):
            at = monitor.settled
            events = [(last, 0.5)]
            if last - -4e9 < 2**62 / 1e9:
                monitor.update(x=events)
                continue
            with pytest.raises(ValueError, match=r"2\*\*62|2\^62") as refusal:
                monitor.update(x=events)
            said.add(str(refusal.value))
            assert (monitor.settled, monitor.robustness) == (at, 0.5)
    assert len(said) == 2
