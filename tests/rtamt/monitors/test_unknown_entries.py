"""Entries with unknown values are a list of single monitors, each with its own time."""

import copy
import pickle
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bits import bits, identical
from catalogue import check, entries
from choices import ENDS, Backend
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from strategies import formulas
from uncertain_traces import UNKNOWN, some_value

from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    StateError,
    UncertainValue,
    VectorEpisodeMonitor,
    VectorMonitor,
)
from rtamt.machines.backend import BACKENDS

NAN, INF = float("nan"), float("inf")


def ends(rows: list[list[float | UncertainValue]]) -> list[NDArray[np.float64]]:
    """Return the minima and the maxima."""
    both = [
        [(x.lower, x.upper) if isinstance(x, UncertainValue) else (x, x) for x in row]
        for row in rows
    ]
    shape = (len(rows), len(rows[0]), 2)
    table = np.array(both, dtype=np.float64).reshape(shape)
    return [np.ascontiguousarray(table[..., i]) for i in (0, 1)]


def offered(vector: VectorEpisodeMonitor) -> list[list[int]]:
    values = (vector.robustness, vector.lower, vector.upper)
    return [*map(bits, values), vector.verdict.tolist(), vector.samples.tolist()]


def expected(entries: list[EpisodeMonitor]) -> list[list[int]]:
    values = ([getattr(m, name) for m in entries] for name in ("robustness", "lower", "upper"))
    return [*map(bits, values), [int(m.verdict) for m in entries], [m.samples for m in entries]]


@given(formulas(3, endless=True), st.integers(0, 2**32))
@settings(max_examples=examples(60))
def test_each_entry_is_a_monitor_of_its_own(formula: Formula, seed: int) -> None:
    for backend in BACKENDS:
        rng, num = random.Random(seed), 3
        vector = VectorEpisodeMonitor(formula, num, backend=backend, nan="unknown")
        entries = [EpisodeMonitor(formula, backend=backend, nan="unknown") for _ in range(num)]
        for _ in range(6):
            mask = np.array([rng.random() < 0.8 for _ in range(num)])
            fresh = np.array([rng.random() < 0.2 for _ in range(num)])
            rows = [[some_value(rng, 0.15) for _ in vector.variables] for _ in range(num)]
            lower, upper = ends(rows)
            if all(x is UNKNOWN or not isinstance(x, UncertainValue) for row in rows for x in row):
                vector.update(np.where(np.isinf(lower), NAN, lower), mask)
            else:
                vector.update(lower, mask, upper=upper)
            for entry, row in zip(
                np.array(entries)[mask], np.array(rows, object)[mask], strict=True
            ):
                entry.update(list(row))
            assert offered(vector) == expected(entries)
            if rng.random() < 0.3:
                vector.reset(fresh)
                for entry in np.array(entries)[fresh]:
                    entry.reset()
                assert offered(vector) == expected(entries)
        end, begun = rng.choice(ENDS), vector.samples > 0
        vector.finish(begun, end=end)
        for entry in np.array(entries)[begun]:
            entry.finish(end)
        assert offered(vector) == expected(entries)


DUPLICATES: list[Callable[[Any], Any]] = [copy.copy, lambda m: pickle.loads(pickle.dumps(m))]


@pytest.mark.parametrize("duplicate", DUPLICATES, ids=["copy", "pickle"])
@pytest.mark.parametrize("text", ["always[0:3](x > 1)", "always(x > 1 implies once[0:2](y > 0))"])
def test_duplicates_go_on_alike_and_apart(
    text: str, duplicate: Callable[[Any], Any], backend: Backend
) -> None:
    vector = VectorEpisodeMonitor(text, 2, backend=backend)
    width = len(vector.variables)
    twins = [duplicate(vector)]
    vector.update(np.ones((2, width)), upper=np.full((2, width), 3.0))
    twins.append(duplicate(vector))
    before = offered(vector)
    assert offered(twins[1]) == before
    for twin in twins:
        twin.update(np.zeros((2, width)), upper=np.ones((2, width)))
    assert offered(vector) == before
    vector.update(np.zeros((2, width)), upper=np.ones((2, width)))
    assert offered(vector) == offered(twins[1])
    vector.reset()
    assert offered(vector) == offered(VectorEpisodeMonitor(text, 2, backend=backend))


def test_an_entry_that_was_reset_has_no_twin(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("eventually(x > 1)", 2, backend=backend, nan="unknown")
    vector.update([[NAN], [0.0]])
    assert identical(vector.upper, [INF, INF])
    assert identical(vector.robustness, [-INF, -1.0])
    vector.reset(np.array([True, False]))
    # No entry has an unknown sample any more, so one machine runs alone again.
    plain = VectorEpisodeMonitor("eventually(x > 1)", 2, backend=backend)
    plain.update([[5.0], [0.0]])
    plain.reset(np.array([True, False]))
    assert len(pickle.dumps(vector._machine.state())) == len(pickle.dumps(plain._machine.state()))
    vector.update([[2.0], [3.0]])
    assert identical(vector.robustness, [1.0, 2.0])
    assert vector.verdict.tolist() == [1, 1]


@pytest.mark.parametrize("at_once", [True, False])
def test_a_cut_is_forgotten_by_a_reset(at_once: bool, backend: Backend) -> None:  # noqa: FBT001
    """Also if the other entry has unknown samples, and if no entry has any meanwhile."""
    vector = VectorEpisodeMonitor("eventually(x > 1)", 2, backend=backend, nan="unknown")
    vector.update([[NAN] if at_once else [0.0], [NAN]])
    vector.finish(end="cut")
    entries = [
        EpisodeMonitor("eventually(x > 1)", backend=backend, nan="unknown") for _ in range(2)
    ]
    for entry, value in zip(entries, (NAN if at_once else 0.0, NAN), strict=True):
        entry.update(value)
        entry.finish("cut")
    for chosen in (0,) if at_once else (1, 0):
        vector.reset(np.arange(2) == chosen)
        entries[chosen].reset()
        assert offered(vector) == expected(entries)
    begun = np.array([not entry.finished for entry in entries])
    vector.update([[NAN], [NAN]], begun)
    for entry in np.array(entries)[begun]:
        entry.update(NAN)
    assert offered(vector) == expected(entries)


@pytest.mark.parametrize("text", ["x > 0 or always[1:5](5 > 0)", "always[1:5](5 > 0) or x > 0"])
def test_a_cut_moves_what_an_entry_shows_into_the_bounds_of_both_ends(
    text: str, backend: Backend
) -> None:
    """The value without samples is 5, so the trace has 5 to 9, and its robustness was inf."""
    vector = VectorEpisodeMonitor(text, 3, backend=backend)
    entries = [EpisodeMonitor(text, backend=backend) for _ in range(3)]
    rows: list[list[float | UncertainValue]] = [
        [UncertainValue(2.0, 9.0)],
        [1.0],
        [UncertainValue(3.0, 7.0)],
    ]
    lower, upper = ends(rows)
    vector.update(lower, upper=upper)
    for entry, row in zip(entries, rows, strict=True):
        entry.update(row)
    for chosen in ([True, False, False], [False, True, True]):
        vector.finish(np.array(chosen), end="cut")
        for entry in np.array(entries)[chosen]:
            entry.finish("cut")
        assert offered(vector) == expected(entries)
    assert identical(vector.robustness, [9.0, 5.0, 7.0])


def test_neutral_predicates(backend: Backend) -> None:
    text = "input float req; output float gnt; always(req >= 3 implies gnt >= 3)"
    vector = VectorEpisodeMonitor(text, 2, semantics="input-vacuity", backend=backend)
    single = EpisodeMonitor(text, semantics="input-vacuity", backend=backend)
    vector.update([[2, 0], [2, 0]], upper=[[4, 0], [2, 5]])
    single.update(req=UncertainValue(2, 4), gnt=0.0)
    assert identical([vector.lower[0], vector.upper[0]], [single.lower, single.upper])
    vector.finish()
    single.finish()
    found = [each[0] for each in (vector.robustness, vector.lower, vector.upper)]
    assert identical(found, [single.robustness, single.lower, single.upper])


def test_hold_keeps_an_interval(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(x > 0)", 2, nan="hold", backend=backend)
    vector.update([[1.0], [5.0]], upper=[[2.0], [5.0]])
    vector.update([[NAN], [NAN]])
    vector.finish()
    assert identical(vector.lower, [1.0, 5.0])
    assert identical(vector.upper, [2.0, 5.0])


ERRORS = entries(Path(__file__).with_name("vector_errors.txt"))


@pytest.mark.parametrize(("call", "said"), [e for e in ERRORS if e[0].startswith("entries")])
def test_an_error_leaves_every_entry_as_it_was(call: str, said: str, backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(sqrt(x + y) > 1)", 2, nan="unknown", backend=backend)
    vector.update([[1, 1], [1, 1]])
    for _ in range(2):
        before = offered(vector)
        check(call, said, entries=vector, NAN=NAN)
        assert offered(vector) == before
        vector.reset()
        vector.update([[1.0, 1.0], [NAN, 1.0]])
    only = np.array([True, False])
    vector.finish(only)
    with pytest.raises(StateError, match="the episode of batch entry 0 is finished"):
        vector.update([[1, 1], [1, 1]], upper=[[1, 1], [2, 1]])
    vector.update([[5.0, NAN], [1.0, 1.0]], ~only, upper=[[1, 1], [2, 1]])  # that row is ignored
    assert vector.samples.tolist() == [1, 2]


def test_who_gives_no_bounds_refuses(backend: Backend) -> None:
    vector = VectorMonitor("x > 0", 2, backend=backend)
    with pytest.raises(InputError, match="an array and upper; the variables are x"):
        vector.update([[1], [2]], upper=[[1], [2]])
