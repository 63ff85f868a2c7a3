"""A machine that runs in another thread shows nothing, because it changes meanwhile."""

import threading
from collections.abc import Sequence
from typing import Protocol, cast

import numpy as np
import pytest

import rtamt
from rtamt import Monitor, StateError

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SPEC = "always[0:3](x > 1) and eventually[0:100](x > 0)"
RUNNING = "the monitor is running in another thread; wait until that call returns, "
VALUES = np.random.default_rng(0).random(1_000_000)
EVENTS = np.arange(1e6), VALUES


class Runs(Protocol):
    """A machine that takes a complete trace."""

    def run(self, *trace: object) -> object: ...


@pytest.mark.parametrize(
    ("kind", "trace"),
    [
        (Monitor, ([VALUES], len(VALUES))),
        (rtamt.dense.Monitor, ([EVENTS],)),
        (rtamt.dense.EpisodeMonitor, ([EVENTS],)),
    ],
)
def test_no_attribute_is_read_while_another_thread_changes_it(
    kind: type[Monitor] | type[rtamt.dense.Monitor] | type[rtamt.dense.EpisodeMonitor],
    trace: Sequence[object],
) -> None:
    def make() -> Runs:
        return cast("Runs", kind(SPEC, backend="native")._machine)

    shown = {name for name, member in vars(type(make())).items() if isinstance(member, property)}
    assert shown
    refused: set[str] = set()
    while refused != shown:
        machine = make()
        thread = threading.Thread(target=machine.run, args=trace)
        thread.start()
        while thread.is_alive():
            for name in shown:
                try:
                    getattr(machine, name)
                except StateError as error:
                    assert str(error).startswith(RUNNING)  # noqa: PT017
                    refused.add(name)
        thread.join()
