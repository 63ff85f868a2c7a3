"""Values that run code when they are read, and monitors that are made anew: nothing goes astray."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from rtamt import (
    Between,
    DenseEpisodeMonitor,
    DenseMonitor,
    EpisodeMonitor,
    Monitor,
    StateError,
)
from rtamt.machines.backend import BackendName

BACKENDS: tuple[BackendName, ...] = ("native", "python")
Kind = Callable[..., Any]
Options = dict[str, Any]
NEUTRAL: Options = {"semantics": "output-robustness", "inputs": ["x"], "outputs": ["y"]}


class Running:
    """A number that runs something when it is read."""

    def __init__(self, run: Callable[[], object], value: float = 1.0) -> None:
        self.run, self.value = run, value

    def __float__(self) -> float:
        self.run()
        return self.value


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "options", [{}, {"history": True}, {"nan": "unknown"}, NEUTRAL], ids=["", "h", "u", "n"]
)
@pytest.mark.parametrize("form", ["position", "name", "mapping"])
def test_an_update_whose_value_ends_the_episode_is_refused(
    backend: BackendName, options: Options, form: str
) -> None:
    monitor = EpisodeMonitor("always(x > 0 or y > 3)", backend=backend, **options)
    monitor.update(1.0, 2.0)
    value: Any = Running(monitor.finish)
    positional, named = {
        "position": ((value, 2.0), {}),
        "name": ((), {"x": value, "y": 2.0}),
        "mapping": (({"x": value, "y": 2.0},), {}),
    }[form]
    with pytest.raises(StateError, match="the episode is finished"):
        monitor.update(*positional, **named)
    assert monitor.finished
    assert monitor.samples == 1
    assert monitor.lower == monitor.upper == monitor.robustness or options is NEUTRAL


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", [DenseMonitor, DenseEpisodeMonitor])
def test_an_update_whose_event_ends_the_trace_is_refused(backend: BackendName, kind: Kind) -> None:
    monitor = kind("always(x > 0)", backend=backend)
    monitor.update({"x": [(0.0, 1.0)]})
    with pytest.raises(StateError):
        monitor.update({"x": [(1.0, Running(monitor.finish))]})
    with pytest.raises(StateError):
        monitor.update({"x": [(2.0, 1.0)]})


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", [Monitor, EpisodeMonitor])
def test_an_update_inside_an_update_takes_its_turn_first(backend: BackendName, kind: Kind) -> None:
    monitor = kind("always(x > 0 and y > 3)", backend=backend)
    value: Any = Running(lambda: monitor.update(5.0, 9.0), 6.0)
    monitor.update(7.0, value)
    alone = kind("always(x > 0 and y > 3)", backend=backend)
    alone.update(5.0, 9.0)
    alone.update(7.0, 6.0)
    assert monitor.samples == 2
    assert repr(monitor.__reduce__()[2]) == repr(alone.__reduce__()[2])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "options", [{}, {"history": True}, {"nan": "unknown"}, NEUTRAL], ids=["", "h", "u", "n"]
)
def test_an_update_of_before_an_init_is_stale(backend: BackendName, options: Options) -> None:
    monitor = EpisodeMonitor("always(x > 0 or y > 3)", backend=backend, **options)
    update = monitor.update
    update(1.0, 2.0)
    monitor.__init__("always(x < 0 or y > 3)", backend=backend, **options)  # type: ignore[misc]
    shown = (monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)
    for values in ((1.0, 2.0), (Running(lambda: None), 2.0), (math.nan, 2.0)):
        with pytest.raises(StateError, match="__init__ has run again since"):
            update(*values)
    assert repr((monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)) == repr(shown)
    monitor.update(-1.0, 2.0)
    assert monitor.samples == 1
    again = monitor.update
    again(-1.0, 2.0)
    assert monitor.samples == 2


@pytest.mark.parametrize("backend", BACKENDS)
def test_updates_of_the_other_monitors_are_stale_too(backend: BackendName) -> None:
    one = Monitor("always[0:1](x > 0)", backend=backend)
    dense = DenseMonitor("always(x > 0)", backend=backend)
    whole = DenseEpisodeMonitor("always(x > 0)", backend=backend)
    unknown = DenseEpisodeMonitor("always(x > 0)", backend=backend, nan="unknown")
    for monitor, sample in (
        (one, 1.0),
        (dense, {"x": [(0.0, 1.0)]}),
        (whole, {"x": [(0.0, 1.0)]}),
        (unknown, {"x": [(0.0, Between(0.0, 1.0))]}),
    ):
        made: Any = monitor
        update = made.update
        update(sample)
        made.__init__("always(x > 0)", backend=backend)
        with pytest.raises(StateError, match="__init__ has run again since"):
            update(sample)


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_init_that_is_refused_leaves_the_update_as_it_was(backend: BackendName) -> None:
    monitor: Any = EpisodeMonitor("always(x > 0)", backend=backend)
    update = monitor.update
    with pytest.raises(ValueError, match="STL:1"):
        monitor.__init__("always(x >", backend=backend)
    assert update(2.0) == 2.0 == monitor.robustness


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_init_inside_an_update_makes_that_update_stale(backend: BackendName) -> None:
    monitor: Any = EpisodeMonitor("always(x > 0)", backend=backend)
    value = Running(lambda: monitor.__init__("always(x < 0)", backend=backend))
    with pytest.raises(StateError, match="__init__ has run again since"):
        monitor.update(value)
    assert monitor.samples == 0
