"""`joint_feed`: several monitors fed by one call are those fed by an ``update`` each."""

from __future__ import annotations

import copy
import gc
import math
import pickle
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from bits import identical
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import VARIABLES, Trace, formulas, length, sample, traces

import rtamt
from rtamt import Between, EpisodeMonitor, Formula, InputError, JointFeed, StateError, joint_feed
from rtamt.program.interface import SemanticsName

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SEVERAL = st.lists(formulas(depth=2, endless=True), min_size=1, max_size=4)


def joint_of(monitors: Sequence[EpisodeMonitor], names: Sequence[str], **options: Any) -> JointFeed:  # noqa: ANN401
    reads = options.pop("reads", list(range(len(names))))
    joint = joint_feed(monitors, names, reads, **options)
    assert joint is not None
    return joint


def numbers(monitor: EpisodeMonitor) -> tuple[float, float, float]:
    return monitor.robustness, monitor.lower, monitor.upper


def least(values: Sequence[float]) -> float:
    """The least of numbers among which -0.0 is below 0.0."""
    return min(values, key=lambda value: (value, math.copysign(1.0, value)))


@settings(max_examples=examples(150))
@given(
    specs=SEVERAL,
    trace=traces(),
    form=st.sampled_from(["list", "tuple", "array", "held"]),
    semantics=st.sampled_from(["standard", "input-vacuity"]),
)
def test_monitors_fed_together_are_those_fed_alone(
    specs: list[Formula], trace: Trace, form: str, semantics: SemanticsName
) -> None:
    def made_of(spec: Formula) -> EpisodeMonitor:
        inputs = EpisodeMonitor(spec).variables[:1]
        return EpisodeMonitor(spec, semantics=semantics if inputs else "standard", inputs=inputs)

    alone = [made_of(spec) for spec in specs]
    fed = [made_of(spec) for spec in specs]
    held = np.zeros(len(VARIABLES))
    reads = [(held, i) for i in range(len(held))] if form == "held" else [0, 1, 2]
    told: list[int] = []
    seen: list[list[float]] = []
    joint = joint_of(fed, VARIABLES, reads=reads, decided=told.append, seen=seen.append)
    made: dict[str, Callable[[list[float]], object]]
    made = {"list": list, "tuple": tuple, "array": np.array}
    for i in range(length(trace)):
        values = list(sample(trace, i).values())
        for monitor in alone:
            monitor.update({n: sample(trace, i)[n] for n in monitor.variables})
        if form == "held":
            held[:] = values
            given_back = joint.feed()
        else:
            given_back = joint.feed(made[form](values), "of no matter")
        expected = [numbers(monitor) for monitor in alone]
        assert all(identical(numbers(a), b) for a, b in zip(fed, expected, strict=True))
        assert [m.verdict for m in fed] == [m.verdict for m in alone]
        assert identical(given_back, [least(column) for column in zip(*expected, strict=True)])
        assert identical(joint.look(), given_back)
        decided = sum(monitor.verdict != 0 for monitor in alone)
        assert told[-1:] == ([decided] if decided else [])
        assert identical(seen[-1], values)
    assert len(seen) == length(trace) == fed[0].samples


@settings(max_examples=examples(50))
@given(specs=SEVERAL, trace=traces())
def test_a_sample_taken_without_its_numbers_is_a_sample_fed(
    specs: list[Formula], trace: Trace
) -> None:
    decided: dict[str, list[int]] = {"fed": [], "taken": []}
    seen: dict[str, list[list[float]]] = {"fed": [], "taken": []}
    joints = {
        name: joint_of(
            [EpisodeMonitor(spec) for spec in specs],
            VARIABLES,
            decided=decided[name].append,
            seen=seen[name].append,
        )
        for name in decided
    }
    for i in range(length(trace)):
        values = list(sample(trace, i).values())
        expected = joints["fed"].feed(values)
        joints["taken"].take(values)
        assert identical(joints["taken"].look(), expected)
        assert decided["taken"] == decided["fed"]
        assert identical(seen["taken"][i], values)


@settings(max_examples=examples(50))
@given(specs=SEVERAL, trace=traces(least=4))
def test_monitors_that_are_reset_restored_and_copied_are_fed_on(
    specs: list[Formula], trace: Trace
) -> None:
    fed = [EpisodeMonitor(spec) for spec in specs]
    joint = joint_of(fed, VARIABLES)
    rows = [list(sample(trace, i).values()) for i in range(length(trace))]
    found = [joint.feed(row) for row in rows]
    for monitor in fed:
        monitor.reset()
    assert all(identical(joint.feed(row), was) for row, was in zip(rows[:2], found, strict=False))
    states = [monitor.__reduce__()[2] for monitor in fed]
    copies = pickle.loads(pickle.dumps(copy.deepcopy(fed)))
    for row in rows:
        joint.feed(row)
    for monitor, state in zip(fed, states, strict=True):
        monitor.__setstate__(state)
    twin = joint_of(copies, VARIABLES)
    for row, was in zip(rows[2:], found[2:], strict=True):
        assert identical(joint.feed(row), was)
        assert identical(twin.feed(row), was)


@pytest.mark.parametrize("nan", ["raise", "hold", "unknown"])
def test_nan_is_taken_as_by_update(nan: Any) -> None:  # noqa: ANN401
    texts = ("always(x > 0)", "eventually[0:2](y > x)")
    alone, fed = ([EpisodeMonitor(text, nan=nan) for text in texts] for _ in range(2))
    joint = joint_of(fed, ["x", "y"])
    for row in ([1.0, 2.0], [math.nan, 3.0], [2.0, math.nan]):
        errors = []
        for feed in (
            lambda row=row: [m.update(*(row["xy".index(v)] for v in m.variables)) for m in alone],
            lambda row=row: joint.feed(row),
        ):
            try:
                feed()
            except InputError as error:
                errors.append(str(error))
        assert len(errors) in {0, 2}
        assert len(set(errors)) <= 1
        assert [(numbers(m), m.samples, m.unknown) for m in fed] == [
            (numbers(m), m.samples, m.unknown) for m in alone
        ]


def test_what_cannot_be_fed_in_one_call_gives_none() -> None:
    native = EpisodeMonitor("always(x > 0)")
    for other in (
        EpisodeMonitor("always(x > 0)", backend="python"),
        EpisodeMonitor("always(x > 0)", history=True),
    ):
        assert joint_feed([native, other], ["x", "y"], [0, 1]) is None
    assert joint_feed([], ["x"], [0]) is None


def test_elements_are_read_as_float_reads_them() -> None:
    cases: list[tuple[Any, Any, float]] = [
        (1, np.array([1, 2], np.int32), 2.0),
        (1, np.array([1, 0.1], np.float32), float(np.float32(0.1))),
        (-1, np.array([1.0, 2.0])[::-1], 1.0),
        (1, np.arange(6.0)[::3], 3.0),
        ("y", {"y": np.float32(0.5)}, 0.5),
        ((0, 1), np.array([[1.0, 4.0]]), 4.0),
        (0, (True,), 1.0),
        (0, np.array(["0.25"]), 0.25),
    ]
    for key, observation, value in cases:
        monitor = EpisodeMonitor("always(x > 0)")
        assert joint_of([monitor], ["x"], reads=[key]).feed(observation)[0] == value
    for key, observation, error in (
        (2, np.zeros(2), IndexError),
        ("x", {}, KeyError),
        (0, [None], TypeError),
        (0, (), IndexError),
    ):
        monitor = EpisodeMonitor("always(x > 0)")
        with pytest.raises(error):
            joint_of([monitor], ["x"], reads=[key]).feed(observation)
        assert monitor.samples == 0


def test_numbers_are_of_the_class_that_is_asked_for() -> None:
    for kind in (float, np.float64):
        joint = joint_of([EpisodeMonitor("always(x > 0)")], ["x"], number=kind)
        assert {type(number) for number in (*joint.feed([2]), *joint.look())} == {kind}
        assert joint.look()[0] + 1 == 3.0
    with pytest.raises(TypeError, match="expected float or numpy"):
        joint_of([EpisodeMonitor("always(x > 0)")], ["x"], number=np.float32)


def test_a_monitor_that_has_ended_or_that_is_fed_already_refuses() -> None:
    monitor = EpisodeMonitor("always(x > 0)")

    def again(*_: object) -> float:
        joint.feed()
        return 1.0

    joint = joint_of([monitor], ["x"], reads=[again])
    with pytest.raises(StateError, match="running"):
        joint.feed()
    assert monitor.samples == 0
    joint = joint_of([monitor], ["x"])
    joint.feed([1.0])
    monitor.finish()
    with pytest.raises(StateError) as fed:
        joint.feed([1.0])
    with pytest.raises(StateError) as updated:
        monitor.update(1.0)
    assert str(fed.value) == str(updated.value)


def test_a_value_between_two_numbers_is_for_update_alone() -> None:
    with pytest.raises(TypeError):
        joint_of([EpisodeMonitor("always(x > 0)")], ["x"]).feed([Between(0.0, 1.0)])


class Cell:
    joint: JointFeed


def reader(cell: Cell, view: memoryview) -> Callable[..., float]:
    """Reads a view that dies with the cell."""
    return lambda *_: float(view[0]) + 0.0 * len(vars(cell))


@pytest.mark.slow
def test_a_cycle_through_what_is_read_is_collected_and_the_array_is_read_on() -> None:
    array: Any = np.array([1.0, 2.0])
    beneath = weakref.ref(array)
    cell = Cell()
    monitors = [EpisodeMonitor("always(x > 0)"), EpisodeMonitor("always(y > 0)")]
    reads = [(array, 1), reader(cell, memoryview(array))]
    cell.joint = joint_of(monitors, ["x", "y"], reads=reads, seen=reader(cell, memoryview(array)))
    kept = joint_of(monitors, ["x", "y"], reads=[(array, 0), (array, 1)])
    cell.joint.feed()
    gone = weakref.ref(cell)
    del cell, reads, array
    gc.collect()
    assert gone() is None
    held = beneath()
    assert held is not None
    held[0] = 0.5
    del held
    gc.collect()
    assert kept.feed()[0] == 0.5
    del kept
    gc.collect()
    assert beneath() is None


@pytest.mark.filterwarnings("ignore:nanobind. attempted to access an uninitialized instance")
def test_one_that_was_not_made_is_refused() -> None:
    kind = type(joint_of([EpisodeMonitor("always(x > 0)")], ["x"]))
    unmade = kind.__new__(kind)
    for method in (unmade.feed, unmade.look):
        with pytest.raises(TypeError):
            method()
    del unmade
    gc.collect()
    native: Any = rtamt.joint_feed
    monitor = EpisodeMonitor("always(x > y)")
    for names, reads in ((["x", "y"], [0]), (["x", "y"], [0, (np.zeros(1), 1)])):
        with pytest.raises(ValueError, match="expected"):
            native([monitor], names, reads)
