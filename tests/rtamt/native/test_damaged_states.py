"""States of native machines that no machine gave: they are refused, and nothing breaks later."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rtamt import EpisodeMonitor, Monitor, VectorEpisodeMonitor, VectorMonitor

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

LANES = 3
PAST = "prev(historically[0:7](x > 0))"
FUTURE = f"always[5:inf]({PAST})"
DAMAGED = r"^expected a whole state, got a damaged one$"
SAMPLES = 61
LIMIT = 2**62

MAKERS: dict[str, Callable[[], Any]] = {
    "discrete": lambda: Monitor(PAST, backend="native"),
    "episode": lambda: EpisodeMonitor(FUTURE, backend="native"),
    "discrete bank": lambda: VectorMonitor(PAST, LANES, backend="native"),
    "episode bank": lambda: VectorEpisodeMonitor(FUTURE, LANES, backend="native"),
}

kinds = pytest.mark.parametrize("kind", MAKERS)


def feed(kind: str, monitor: Any, n: int) -> None:  # noqa: ANN401 - any monitor of samples
    for _ in range(n):
        monitor.update(np.ones((LANES, 1)) if "bank" in kind else 1.0)


def counting(state: bytes, samples: int) -> bytes:
    """The state with another number of samples."""
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
    assert np.all(monitor.samples == 0)
    monitor._machine.restore(state)
    assert monitor._machine.state() == state


@kinds
def test_the_greatest_count_of_samples_is_counted_on(kind: str) -> None:
    monitor = MAKERS[kind]()
    feed(kind, monitor, SAMPLES)
    monitor._machine.restore(counting(monitor._machine.state(), LIMIT - 1))
    feed(kind, monitor, 60)
    assert np.all(monitor.samples == LIMIT + 59)
