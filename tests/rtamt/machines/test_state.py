"""Snapshots of the Python machines, and errors that leave their state unchanged."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rtamt
from rtamt import EpisodeMonitor, Monitor, VectorMonitor
from rtamt.machines.backend import Backend

TEXT = "always[0:3]((x > 0) implies ((y > 1) until[0:5] once[0:2](x > 2)))"
Machine = Any
MAKERS: dict[str, Callable[[], Any]] = {
    "discrete": lambda: Monitor(TEXT, backend="python"),
    "episode": lambda: EpisodeMonitor(f"always ({TEXT}) and eventually(y > 0)", backend="python"),
    "dense": lambda: rtamt.dense.Monitor(TEXT, backend="python"),
    "batch": lambda: VectorMonitor(TEXT, 2, backend="python"),
}


def feed(kind: str, machine: Machine, times: range) -> object:
    """Update with samples or events of some times; return the last result."""
    last = None
    for t in times:
        x, y = float(t % 5 - 2), float(t % 3)
        if kind == "dense":
            last = machine.update({"x": [(t, x)], "y": [(t + 0.5, y)]})
        else:
            last = machine.update([[x, y], [y, x]] if kind == "batch" else [x, y])
    return str(last)


@pytest.mark.parametrize("kind", MAKERS)
def test_a_snapshot_shares_no_list_with_its_machine_and_outlives_it(kind: str) -> None:
    machine = MAKERS[kind]()._machine
    feed(kind, machine, range(9))
    state = machine.state()
    before = str(state)
    expected = feed(kind, machine, range(9, 20))
    assert str(state) == before
    for _ in range(2):
        machine.restore(state)
        assert str(machine.state()) == before
        assert feed(kind, machine, range(9, 20)) == expected
        assert str(state) == before


@pytest.mark.parametrize("kind", MAKERS)
def test_a_machine_that_is_reset_is_as_new(kind: str) -> None:
    machine = MAKERS[kind]()._machine
    new = copy.deepcopy(machine.state())
    expected = feed(kind, machine, range(12))
    machine.reset()
    assert str(machine.state()) == str(new)
    assert feed(kind, machine, range(12)) == expected


def test_a_machine_that_evaluates_a_trace_goes_on_where_it_was(backend: Backend) -> None:
    machine: Machine = Monitor(TEXT, backend=backend)._machine
    other: Machine = Monitor(TEXT, backend=backend)._machine
    for each in (machine, other):
        feed("discrete", each, range(9))
    machine.evaluate([np.arange(5.0), np.ones(5)], 5)
    assert machine.samples == other.samples
    assert feed("discrete", machine, range(9, 20)) == feed("discrete", other, range(9, 20))
