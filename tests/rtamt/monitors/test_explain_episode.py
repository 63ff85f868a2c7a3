"""`EpisodeMonitor.explain`: the robustness so far."""

import copy
import math
import pickle
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import Trace, formulas, length, traces

from rtamt import EpisodeMonitor, Formula, InputError, StateError, explain

Backend = Literal["native", "python"]


def fed(monitor: EpisodeMonitor, trace: Trace, samples: range) -> EpisodeMonitor:
    for i in samples:
        monitor.update({name: trace[name][i] for name in monitor.variables})
    return monitor


@settings(max_examples=examples(30))
@given(formula=formulas(endless=True), trace=traces(least=2), data=st.data())
def test_an_episode_is_explained_as_the_trace_of_its_samples(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    n = length(trace)
    cut = data.draw(st.integers(1, n))
    monitor = EpisodeMonitor(formula, 0.5, backend=backend, history=True)
    plain = EpisodeMonitor(formula, 0.5, backend=backend)
    fed(monitor, trace, range(cut))
    part = {name: values[:cut] for name, values in trace.items()}
    explanation = explain(formula, part, 0.5, n=cut, backend=backend)
    assert monitor.explain() == explanation
    assert explanation.robustness == monitor.robustness
    fed(plain, trace, range(cut))
    assert (monitor.lower, monitor.upper) == (plain.lower, plain.upper)
    for twin in (copy.copy(monitor), pickle.loads(pickle.dumps(monitor))):
        assert twin.explain() == explanation
        fed(twin, trace, range(cut, n))
        assert twin.explain() == explain(formula, trace, 0.5, n=n, backend=backend)
    assert monitor.explain() == explanation
    monitor.reset()
    fed(monitor, trace, range(1))
    monitor.finish()
    assert monitor.explain().robustness == monitor.robustness


def test_an_episode_without_history_says_how_to_be_explained() -> None:
    monitor = EpisodeMonitor("always(a)")
    monitor.update(a=1)
    with pytest.raises(StateError) as caught:
        monitor.explain()
    assert str(caught.value) == (
        "explain() needs the samples of the episode; make the monitor with history=True"
    )
    with pytest.raises(StateError) as caught:
        EpisodeMonitor("always(a)", history=True).explain()
    assert str(caught.value) == "explain() needs at least one sample, got none since reset"


def test_a_state_replaces_the_samples_that_were_kept(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(a)", history=True, backend=backend)
    monitor.update(a=3)
    *_, state = monitor.__reduce__()
    monitor.update(a=1)
    monitor.__setstate__(state)
    monitor.update(a=2)
    assert monitor.explain().causes == (("a", 1, 2.0),)


def test_a_refused_sample_is_not_kept(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(a)", history=True, backend=backend)
    monitor.update(a=3)
    with pytest.raises(InputError):
        monitor.update(a=math.nan)
    monitor.update(2.0)
    assert monitor.explain().causes == (("a", 1, 2.0),)


def test_without_history_update_is_the_method_of_the_machine(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(a)", backend=backend)
    assert monitor.update == monitor._machine.update
