"""Neutral predicates neither hold nor fail: a value that depends on one stays undecided."""

import copy
import pickle
import re
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from bits import bits, identical
from choices import ENDS, Backend

from rtamt import (
    EpisodeMonitor,
    InputError,
    Monitor,
    StateError,
    UncertainValue,
    VectorEpisodeMonitor,
    VectorMonitor,
    Verdict,
)
from rtamt.typing import End

SPEC = "input float req; output float gnt; always(req >= 3 implies gnt >= 3)"
DUPLICATES: list[Callable[[Any], Any]] = [
    copy.copy,
    copy.deepcopy,
    lambda monitor: pickle.loads(pickle.dumps(monitor)),
]


def offered(monitor: EpisodeMonitor) -> tuple[list[int], Verdict]:
    values = bits([monitor.robustness, monitor.lower, monitor.upper])
    return values, monitor.verdict


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("semantics", ["input-vacuity", "output-vacuity"])
def test_no_reading_of_the_end_decides_what_hangs_on_a_neutral_predicate(
    semantics: Literal["input-vacuity", "output-vacuity"], end: End, backend: Backend
) -> None:
    monitor = EpisodeMonitor(SPEC, semantics=semantics, backend=backend)
    monitor.update(req=3.0, gnt=1.0)
    for _ in range(2):
        assert identical([monitor.finish(end)], [0.0])
        assert identical([monitor.lower], [-0.0])
        assert identical([monitor.upper], [0.0])
        assert monitor.verdict is Verdict.UNDECIDED
    with pytest.raises(StateError):
        monitor.update(req=0.0, gnt=0.0)
    monitor.reset()
    assert (monitor.samples, monitor.finished) == (0, False)


def test_what_does_not_hang_on_it_is_decided(backend: Backend) -> None:
    both = "input float req; output float gnt; always(req >= 3 and gnt >= 3)"
    always = EpisodeMonitor(both, semantics="input-vacuity", backend=backend)
    always.update(req=2.0, gnt=9.0)
    assert identical([always.lower, always.upper], [-np.inf, -1.0])
    assert always.verdict is Verdict.VIOLATED
    either = "input float req; output float gnt; eventually(req >= 3 or gnt >= 3)"
    monitor = EpisodeMonitor(either, semantics="input-vacuity", backend=backend)
    monitor.update(req=4.0, gnt=0.0)
    assert monitor.verdict is Verdict.SATISFIED
    assert monitor.finish() == 1.0
    assert identical([monitor.lower, monitor.upper], [1.0, 1.0])


def test_the_robustness_of_a_cut_trace_is_moved_to_both_bounds(backend: Backend) -> None:
    text = "input float req; output float gnt; next(prev(gnt >= 3) or req >= 3 and gnt > 9)"
    monitor = EpisodeMonitor(text, semantics="input-vacuity", backend=backend)
    entries = VectorEpisodeMonitor(text, 2, semantics="input-vacuity", backend=backend)
    monitor.update(req=0.0, gnt=0.0)
    entries.update([[0.0, 0.0]] * 2)
    assert identical([monitor.robustness, monitor.lower, monitor.upper], [np.inf, -0.0, np.inf])
    assert identical([monitor.finish("cut")], [0.0])
    assert identical([monitor.robustness, monitor.lower, monitor.upper], [0.0, -0.0, 0.0])
    entries.finish([True, False], end="cut")
    assert identical([*entries.robustness, *entries.lower], [0.0, np.inf, -0.0, -0.0])
    again = copy.deepcopy(entries)
    assert identical(again.robustness, entries.robustness)
    again.reset([True, False])
    assert np.isnan(again.robustness[0])


def test_the_robustness_of_a_cut_trace_is_below_what_only_one_reading_reaches(
    backend: Backend,
) -> None:
    text = "input float req; output float gnt; eventually[1:1](once[1:1](gnt >= 3) or req > 9)"
    monitor = EpisodeMonitor(text, semantics="input-vacuity", backend=backend)
    monitor.update(req=0.0, gnt=0.0)
    assert identical([monitor.robustness, monitor.lower], [-np.inf, -np.inf])
    monitor.finish("cut")
    assert identical([monitor.robustness, monitor.lower, monitor.upper], [-0.0, -0.0, np.inf])


def test_a_complete_end_gives_both_readings_of_the_robustness(backend: Backend) -> None:
    text = "input float req; output float gnt; always((req >= 3 or gnt >= 3) and req > -9)"
    monitor = EpisodeMonitor(text, semantics="input-vacuity", backend=backend)
    monitor.update(req=2.0, gnt=0.0)
    assert identical([monitor.robustness, monitor.lower, monitor.upper], [0.0, -np.inf, 0.0])
    monitor.finish()
    assert identical([monitor.robustness, monitor.lower, monitor.upper], [0.0, -0.0, 0.0])


@pytest.mark.parametrize("duplicate", DUPLICATES, ids=["copy", "deepcopy", "pickle"])
def test_duplicates_go_on_alike_and_apart(
    duplicate: Callable[[Any], Any], backend: Backend
) -> None:
    original = EpisodeMonitor(SPEC, semantics="input-vacuity", backend=backend)
    original.update(req=1.0, gnt=0.0)
    twin = duplicate(original)
    assert offered(twin) == offered(original)
    twin.update(req=3.0, gnt=0.0)
    assert original.samples == 1
    original.update(req=3.0, gnt=0.0)
    assert offered(twin) == offered(original)
    twin.finish()
    assert offered(duplicate(twin)) == offered(twin)
    assert not original.finished


def test_entries_are_single_episodes_through_masks_ends_and_resets(backend: Backend) -> None:
    entries = VectorEpisodeMonitor(SPEC, 3, semantics="input-vacuity", backend=backend)
    single = [EpisodeMonitor(SPEC, semantics="input-vacuity", backend=backend) for _ in range(3)]

    def agree() -> None:
        for name in ("robustness", "lower", "upper"):
            assert bits(getattr(entries, name)) == bits([getattr(m, name) for m in single])
        assert entries.verdict.tolist() == [m.verdict for m in single]
        assert entries.finished.tolist() == [m.finished for m in single]
        assert entries.samples.tolist() == [m.samples for m in single]

    rng = np.random.default_rng(1)
    for step in range(12):
        table = rng.integers(0, 5, size=(3, 2)).astype(float)
        mask = ~entries.finished & rng.integers(0, 2, size=3).astype(bool)
        entries.update(table, mask)
        for entry in np.flatnonzero(mask):
            single[entry].update(*table[entry])
        agree()
        if step in {5, 9}:
            entries = pickle.loads(pickle.dumps(entries))
            mask = (entries.samples > 0) & np.array([True, step == 9, True])
            entries.finish(mask)
            for entry in np.flatnonzero(mask):
                single[entry].finish()
            agree()
        if step == 7:
            entries.reset([True, False, False])
            single[0].reset()
            agree()


DAMAGED = {
    "native": "expected a whole state, got a damaged one",
    "python": "zip() argument 2 is shorter than argument 1",
}
FOREIGN = {
    "native": (
        "expected a state that a native machine with this program gave; those of other programs, "
        "back-ends or processors do not fit"
    ),
    "python": "zip() argument 2 is shorter than argument 1",
}


def test_a_state_of_another_program_changes_nothing(backend: Backend) -> None:
    monitor = EpisodeMonitor(SPEC, semantics="input-vacuity", backend=backend)
    monitor.update(req=3.0, gnt=0.0)
    monitor.finish()
    before = offered(monitor)
    own: Any = monitor.__reduce__()[2]
    other: Any = EpisodeMonitor(SPEC, backend=backend).__reduce__()[2]
    for state, error in ((own[:-1], DAMAGED[backend]), (other, FOREIGN[backend])):
        with pytest.raises(ValueError, match=f"^{re.escape(error)}"):
            monitor.__setstate__(state)
        assert offered(monitor) == before
        assert str(monitor.__reduce__()[2]) == str(own)


def test_what_is_not_known_is_that_of_the_last_sample(backend: Backend) -> None:
    monitor = EpisodeMonitor(SPEC, semantics="input-vacuity", nan="unknown", backend=backend)
    entries = VectorEpisodeMonitor(
        SPEC, 2, semantics="input-vacuity", nan="unknown", backend=backend
    )
    assert (monitor.unknown, entries.unknown.tolist()) == ((), [[False, False]] * 2)
    for req, gnt in ((np.nan, 1.0), (1.0, np.nan), (1.0, 1.0)):
        monitor.update(req=req, gnt=gnt)
        entries.update([[req, gnt], [1.0, 1.0]])
        nan = np.isnan([req, gnt])
        assert monitor.unknown == tuple(np.array(monitor.variables)[nan])
        assert entries.unknown.tolist() == [nan.tolist(), [False, False]]


def test_an_update_from_before_another_init_is_refused(backend: Backend) -> None:
    monitor: Any = EpisodeMonitor(SPEC, semantics="input-vacuity", backend=backend)
    update = monitor.update
    update(req=1.0, gnt=0.0)
    monitor.__init__(SPEC, semantics="input-vacuity", backend=backend)
    with pytest.raises(StateError, match="__init__ has run again since"):
        update(req=1.0, gnt=0.0)
    assert monitor.samples == 0


@pytest.mark.parametrize("make", [Monitor, VectorMonitor, EpisodeMonitor, VectorEpisodeMonitor])
@pytest.mark.parametrize(("semantics", "row"), [("input-vacuity", 1), ("output-vacuity", 0)])
def test_a_nan_of_a_variable_that_no_term_reads_is_refused_or_held(
    make: Any,  # noqa: ANN401
    semantics: str,
    row: int,
    backend: Backend,
) -> None:
    text = "input float req; output float gnt; once(req >= 3 implies gnt >= 3)"
    entries = {"num": 2} if make in {VectorMonitor, VectorEpisodeMonitor} else {}
    wrong = [1.0, 1.0]
    wrong[row] = np.nan
    name = ("req", "gnt")[row]
    for nan in ("raise", "hold"):
        monitor = make(text, **entries, semantics=semantics, nan=nan, backend=backend)
        monitor.update([[2.0, 5.0]] * 2 if entries else [2.0, 5.0])
        sample = [[1.0, 1.0], wrong] if entries else wrong
        if nan == "hold":
            monitor.update(sample)
            continue
        where = "sample 1 of batch entry 1" if entries else "sample 1"
        with pytest.raises(InputError, match=f"^variable '{name}' is nan at {where}; "):
            monitor.update(sample)
        assert np.all(monitor.samples == 1)


def test_a_nan_after_what_was_not_known_is_refused(backend: Backend) -> None:
    monitor = EpisodeMonitor(SPEC, semantics="input-vacuity", backend=backend)
    monitor.update(UncertainValue(0.0, 5.0), 1.0)
    with pytest.raises(InputError, match=r"^variable 'gnt' is nan at sample 1; "):
        monitor.update(1.0, np.nan)
    assert monitor.samples == 1
