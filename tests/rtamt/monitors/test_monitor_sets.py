"""Several monitors that are updated in one call, and the log of their verdicts."""

from __future__ import annotations

import copy
import gc
import math
import pickle
import sys
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import pytest
from bits import bits, identical
from choices import Backend
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples
from strategies import VARIABLES, Trace, formulas, length, sample, traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    InputTypeError,
    StateError,
    UncertainValue,
    VectorEpisodeMonitor,
)
from rtamt.internal import JointFeed, VerdictLog, joint_feed
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
    """Return the minimum of numbers, with -0.0 below 0.0."""
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
        joint_of([EpisodeMonitor("always(x > 0)")], ["x"]).feed([UncertainValue(0.0, 1.0)])


class Cell:
    joint: JointFeed


def reader(cell: Cell, view: memoryview) -> Callable[..., float]:
    """Return a reader of a view that dies with the cell."""
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
    native: Any = rtamt.internal.joint_feed
    monitor = EpisodeMonitor("always(x > y)")
    for names, reads in ((["x", "y"], [0]), (["x", "y"], [0, (np.zeros(1), 1)])):
        with pytest.raises(ValueError, match="expected"):
            native([monitor], names, reads)


NAMES = "xy"


VALUES: tuple[Literal["robustness", "lower", "upper"], ...] = ("robustness", "lower", "upper")


TEXTS = (
    "always(x > 0)",
    "always(y > -1)",
    "eventually(x > 1)",
    "always[0:4](y <= 1)",
    "always((x > 0) implies eventually[0:3](y > 0))",
    "eventually always[0:2](x > 0)",
    "(x > 0) until[0:5] (y > 0)",
    "always(x + y > -2) and eventually[1:3](y == 0)",
    "true",
)


class Ledger:
    """The verdict log of one entry, kept by hand."""

    def __init__(self, texts: list[str]) -> None:
        self.monitors = [EpisodeMonitor(text, backend="python") for text in texts]
        self.begin()

    def begin(self) -> None:
        for monitor in self.monitors:
            monitor.reset()
        self.samples = 0
        self.settled_at = [-1] * len(self.monitors)
        self.ended = [False] * len(self.monitors)
        self.violated = [False] * len(self.monitors)
        self.failed = [False] * len(self.monitors)
        self.first = self.violated_at = -1

    def take(self, sample: dict[str, float]) -> None:
        for monitor in self.monitors:
            monitor.update(*[sample[name] for name in monitor.variables])
        self.samples += 1
        self.look()

    def fail(self) -> None:
        if self.samples:
            self.failed = [f or at < 0 for f, at in zip(self.failed, self.settled_at, strict=True)]
            self.look(ended=True)

    def finish(self, end: Any) -> None:  # noqa: ANN401 - a name
        for monitor in self.monitors:
            monitor.finish(end)
        self.look(ended=True)

    def verdict(self, k: int) -> int:
        return -1 if self.failed[k] else int(self.monitors[k].verdict)

    @property
    def decided_at(self) -> list[int]:
        return [-1 if e else at for e, at in zip(self.ended, self.settled_at, strict=True)]

    def look(self, *, ended: bool = False) -> None:
        for k in range(len(self.monitors)):
            if self.settled_at[k] < 0 and self.verdict(k) != 0:
                self.settled_at[k], self.ended[k] = self.samples - 1, ended
                self.violated[k] = self.verdict(k) < 0
                if self.violated[k] and self.violated_at < 0:
                    self.first, self.violated_at = k, self.samples - 1

    def least(self, name: str) -> float:
        values: list[float] = [getattr(monitor, name) for monitor in self.monitors]
        if name == "upper":
            values = [-0.0 if f else v for f, v in zip(self.failed, values, strict=True)]
        if any(map(math.isnan, values)):
            return math.nan
        return min(values, key=lambda value: (value, math.copysign(1.0, value)))


def log_of(texts: list[str], num: int, backend: Any, **options: Any) -> VerdictLog:  # noqa: ANN401
    return VerdictLog(VectorEpisodeMonitor(text, num, backend=backend, **options) for text in texts)


def columns_of(log: VerdictLog) -> list[tuple[int, ...]]:
    return [tuple(NAMES.index(name) for name in each.variables) for each in log.monitors]


@settings(max_examples=examples(60))
@given(
    texts=st.lists(st.sampled_from(TEXTS), min_size=1, max_size=4),
    num=st.integers(1, 5),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_log_is_that_of_single_entries_bit_for_bit(
    texts: list[str], num: int, seed: int, backend: Backend
) -> None:
    log = log_of(texts, num, backend)
    ledgers = [Ledger(texts) for _ in range(num)]
    random = np.random.default_rng(seed)
    for _ in range(random.integers(1, 30)):
        act(log, ledgers, random)
        compare(log, ledgers)
        if random.random() < 0.1:
            log = pickle.loads(pickle.dumps(log)) if random.random() < 0.5 else copy.deepcopy(log)


def act(log: VerdictLog, ledgers: list[Ledger], random: np.random.Generator) -> None:
    """Update, end or reset some entries of a verdict log, and their ledgers."""
    num, what = len(ledgers), random.random()
    mask = None if random.random() < 0.5 else random.random(num) < 0.5
    chosen = [i for i in range(num) if mask is None or mask[i]]
    over = [any(monitor.finished for monitor in ledgers[i].monitors) for i in chosen]
    if what < 0.15:
        log.reset(mask)
        for i in chosen:
            ledgers[i].begin()
    elif what < 0.3 and all(ledgers[i].samples for i in chosen):
        end = random.choice(["complete", "cut", "open"])
        log.finish(mask, end=end)
        for i in chosen:
            ledgers[i].finish(end)
    elif what < 0.4:
        log.fail(mask)
        for i in chosen:
            ledgers[i].fail()
    elif not any(over):
        table = random.integers(-2, 4, (num, len(NAMES))) / 2.0
        given = np.asfortranarray(table) if random.random() < 0.5 else table
        fed = log.feed(given, columns_of(log), mask)
        for i in chosen:
            ledgers[i].take(dict(zip(NAMES, table[i].tolist(), strict=True)))
        assert bits(fed) == bits([ledger.least("robustness") for ledger in ledgers])


def compare(log: VerdictLog, ledgers: list[Ledger]) -> None:
    for name in ("decided_at", "settled_at", "violated", "failed"):
        expected = np.array([getattr(ledger, name) for ledger in ledgers]).T
        np.testing.assert_array_equal(getattr(log, name), expected, name)
    for name in ("first", "violated_at"):
        assert getattr(log, name).tolist() == [getattr(each, name) for each in ledgers], name
    for value in VALUES:
        assert bits(log.least(value)) == bits([each.least(value) for each in ledgers]), value
    begun = [each.samples > 0 for each in ledgers]
    found = log.outcomes()
    robustness, verdicts = found.robustness, found.verdicts
    assert found.settled_at.tolist() == log.settled_at.tolist()
    assert not np.shares_memory(found.settled_at, log.settled_at)
    assert found.settled.tolist() == (log.settled_at >= 0).tolist()
    assert found.satisfied.tolist() == (verdicts == 1).tolist()
    held = [[not math.copysign(1.0, each) < 0 for each in row] for row in robustness.tolist()]
    assert found.by_end.tolist() == ((verdicts == -1) & held).tolist()
    assert found.success.tolist() == [set(column) == {1} for column in verdicts.T.tolist()]
    assert found.undecided.tolist() == [0 in column for column in verdicts.T.tolist()]
    for entry, (ledger, has) in enumerate(zip(ledgers, begun, strict=True)):
        places = range(len(ledger.monitors))
        assert verdicts[:, entry].tolist() == [ledger.verdict(k) if has else 0 for k in places]
        expected_values = [each.robustness if has else 0.0 for each in ledger.monitors]
        assert bits(robustness[:, entry]) == bits(expected_values)
    entries = np.flatnonzero(begun)[::-1]
    some = log.outcomes(entries)
    assert bits(some.robustness) == bits(robustness[:, entries])
    for name in ("verdicts", "settled_at", "settled", "satisfied", "by_end"):
        assert getattr(some, name).tolist() == getattr(found, name)[:, entries].tolist()
    for name in ("success", "undecided"):
        assert getattr(some, name).tolist() == getattr(found, name)[entries].tolist()


@pytest.mark.parametrize("nan", ["hold", "unknown"])
def test_samples_that_are_missing_are_read_as_the_monitors_do(nan: Any, backend: Backend) -> None:  # noqa: ANN401
    texts = ["always(x > 0)", "always(y > -1)", "eventually(x + y > 3)"]
    log, apart = log_of(texts, 3, backend, nan=nan), log_of(texts, 3, backend, nan=nan)
    random = np.random.default_rng(7)
    for step in range(12):
        table = np.asfortranarray(random.integers(-1, 4, (3, 2)).astype(float))
        if step:
            table[random.random((3, 2)) < 0.3] = np.nan
        log.feed(table, columns_of(log))
        for monitor, columns in zip(apart.monitors, columns_of(apart), strict=True):
            monitor.update(table[:, list(columns)])
        apart.note()
        for name in ("decided_at", "settled_at", "violated", "first", "violated_at"):
            assert getattr(log, name).tolist() == getattr(apart, name).tolist()
        for value in VALUES:
            assert bits(log.least(value)) == bits(apart.least(value))


def test_a_nan_is_refused_with_its_entry_and_the_monitors_in_front_are_fed(
    backend: Backend,
) -> None:
    log = log_of(["always(x > 0)", "always(y > 0)", "always(x > 1)"], 2, backend)
    with pytest.raises(InputError, match=r"y.*nan.*batch entry 1"):
        log.feed(np.array([[1.0, 1.0], [1.0, np.nan]]), columns_of(log))
    assert [each.samples.tolist() for each in log.monitors] == [[1, 1], [0, 0], [0, 0]]


def test_a_finished_entry_takes_no_sample_and_a_fresh_one_does_not_end(backend: Backend) -> None:
    log = log_of(["always(x > 0)", "always(y > 0)"], 2, backend)
    with pytest.raises(StateError):
        log.finish()
    log.feed(np.ones((2, 2)), columns_of(log), [True, False])
    with pytest.raises(StateError):
        log.finish()
    log.finish([True, False])
    with pytest.raises(StateError):
        log.feed(np.ones((2, 2)), columns_of(log))
    assert [each.samples.tolist() for each in log.monitors] == [[1, 0], [1, 0]]
    assert log.settled_at.tolist() == [[0, -1], [0, -1]]
    assert log.decided_at.tolist() == [[-1, -1], [-1, -1]]


def test_nothing_is_said_of_entries_without_samples(backend: Backend) -> None:
    log = log_of(["true", "false", "always(x > 0)"], 2, backend)
    log.note()
    log.fail()
    assert (log.decided_at == -1).all()
    assert not log.violated.any()
    assert not log.failed.any()
    robustness, verdicts, *_ = log.outcomes()
    assert not robustness.any()
    assert not verdicts.any()
    log.feed(np.ones((2, 2)), columns_of(log), [False, True])
    assert log.decided_at.tolist() == [[-1, 0], [-1, 0], [-1, -1]]
    assert log.first.tolist() == [-1, 1]


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda backend: log_of([], 2, backend), InputError, "got no monitor"),
        (
            lambda backend: VerdictLog(
                VectorEpisodeMonitor("always(x > 0)", num, backend=backend) for num in (2, 3)
            ),
            InputError,
            "got monitors of 2 and 3",
        ),
        (
            lambda backend: VerdictLog([EpisodeMonitor("always(x > 0)", backend=backend)]),  # type: ignore[list-item]
            InputTypeError,
            "expected monitors of the class VectorEpisodeMonitor",
        ),
    ],
)
def test_what_is_no_list_of_monitors_of_as_many_entries_is_refused(
    make: Callable[[Backend], object], error: type[Exception], words: str, backend: Backend
) -> None:
    with pytest.raises(error, match=words):
        make(backend)


@pytest.mark.parametrize("mask", [[True], np.ones(3, np.bool_), np.ones((2, 1), np.bool_)])
def test_a_mask_of_another_shape_is_refused_and_changes_nothing(
    mask: Any,  # noqa: ANN401
    backend: Backend,
) -> None:
    log = log_of(["always(x > 0)"], 2, backend)
    log.feed(np.zeros((2, 2)), columns_of(log))
    before = pickle.dumps(log)
    for call in (log.reset, log.fail, log.finish):
        with pytest.raises(InputError, match="expected a mask of 2 booleans"):
            call(mask)
    with pytest.raises(InputTypeError, match="expected a mask of 2 booleans"):
        log.reset([1, 0])
    assert pickle.dumps(log) == before


def test_functions_in_native_code_refuse_arrays_that_do_not_fit() -> None:
    native: Any = pytest.importorskip("rtamt._native")
    log = log_of(["always(x > 0)", "always(y > 0)"], 3, "native")
    batches = log._batches()[0]
    good = list(log._arrays())
    wrong = [
        np.zeros(6),
        np.zeros((2, 4), np.int64),
        np.zeros((4, 3), np.int64)[::2],
        [[0] * 3] * 2,
    ]
    for array in (*wrong, good[0].T, good[0].byteswap().view(good[0].dtype.newbyteorder())):
        with pytest.raises(ValueError, match="expected contiguous arrays"):
            native.note_verdicts(batches, None, array, *good[1:])
        with pytest.raises(ValueError, match="expected contiguous arrays"):
            native.forget_verdicts(None, 2, 3, array, *good[1:])
    for mask in (np.ones(2, np.bool_), np.ones(6, np.bool_)[::2], [True] * 3):
        with pytest.raises(ValueError, match="expected contiguous arrays"):
            native.reset_batches(batches, mask)
    with pytest.raises(ValueError, match="expected a batch"):
        native.note_verdicts((), None, *good)
    with pytest.raises(ValueError, match="of as many entries"):
        native.least_of_batches(
            (*batches, *log_of(["true"], 2, "native")._batches()[0]), "lower", None
        )
    for columns in (((0,),), ((0,), (2,)), ((0,), (0, 1))):
        with pytest.raises(ValueError, match=r"expected (a column|columns)"):
            native.feed_batches(batches, columns, np.ones((3, 2)), None)


KINDS = ("float64", "int64", "bool", "object", "float32", "int8")


def drawn(random: np.random.Generator, kind: str, shape: tuple[int, ...]) -> Any:  # noqa: ANN401
    values = random.integers(0, 2 if kind == "bool" else 100, shape).astype(kind)
    if kind == "object":
        values[random.random(shape) < 0.2] = None
    if kind == "float64":
        values[random.random(shape) < 0.2] = random.choice([-0.0, np.nan, np.inf])
    if values.ndim == 2 and random.random() < 0.2:
        return np.asfortranarray(values)
    return values


@settings(max_examples=examples(100))
@given(num=st.integers(1, 7), seed=st.integers(0, 2**32 - 1))
def test_values_of_some_entries_are_spread_over_all(num: int, seed: int, backend: Backend) -> None:
    random = np.random.default_rng(seed)
    log = log_of(["true"], num, backend)
    entries = random.permutation(num)[: random.integers(0, num + 1)]
    columns: list[Any] = []
    info: dict[str, Any] = {}
    groups: list[dict[str, Any]] = [{}, {}, {}]
    for name, kind in zip("abcdefgh", random.choice(KINDS, 8), strict=True):
        place, shape = (info, ()) if random.random() < 0.5 else (groups, (3,))
        values = drawn(random, kind, (*shape, len(entries)))
        there = None if random.random() < 0.5 else drawn(random, "bool", values.shape)
        columns.append((place, name, f"_{name}", values, there))
    log.spread(columns, entries)
    named = 0
    for place, name, mask_name, values, there in columns:
        rows = [place] if isinstance(place, dict) else place
        for k, group in enumerate(rows):
            row = values if isinstance(place, dict) else values[k]
            known = [True] * len(entries)
            if there is not None:
                known = (there if isinstance(place, dict) else there[k]).tolist()
            assert (name in group) == (mask_name in group) == any(known)
            if not any(known):
                continue
            nothing = None if values.dtype == object else values.dtype.type(0)
            expected, marks = [nothing] * num, [False] * num
            for value, entry, has in zip(row, entries, known, strict=True):
                if has:
                    expected[entry], marks[entry] = value, True
            found, mask = group[name], group[mask_name]
            assert (found.dtype, found.shape) == (values.dtype, (num,))
            assert repr(found.tolist()) == repr(np.array(expected, values.dtype).tolist())
            assert (mask.dtype, mask.tolist()) == (np.bool_, marks)
            named += 1
    arrays = [array for group in (info, *groups) for array in group.values()]
    assert len(arrays) == 2 * named
    assert not any(
        np.shares_memory(one, other) for i, one in enumerate(arrays) for other in arrays[:i]
    )


def test_objects_that_are_spread_are_counted(backend: Backend) -> None:
    log, values = log_of(["true"], 4, backend), np.array([object(), object()])
    before = [sys.getrefcount(each) for each in values.tolist()]
    info: dict[str, Any] = {}
    for _ in range(10):
        log.spread([(info, "a", "_a", values, None)], np.array([2, 0]))
    assert [sys.getrefcount(each) for each in values.tolist()] == [each + 1 for each in before]
    assert info["a"].tolist() == [values[1], None, values[0], None]
    info.clear()
    assert [sys.getrefcount(each) for each in values.tolist()] == before


@pytest.mark.parametrize("entries", [[-1], [0, 3]])
def test_entries_that_are_not_there_are_refused(entries: list[int], backend: Backend) -> None:
    log, at = log_of(["true"], 3, backend), np.array(entries)
    info: dict[str, Any] = {}
    with pytest.raises(IndexError, match="numbers of entries"):
        log.spread([(info, "a", "_a", np.ones(len(at)), None)], at)
    with pytest.raises(IndexError, match="numbers of entries"):
        log.outcomes(at)
    assert info == {}


@pytest.mark.parametrize(
    ("values", "there"),
    [(np.ones(3), None), (np.ones((2, 2)), None), (np.ones(2), np.ones(3, np.bool_))],
)
def test_values_that_do_not_fit_the_entries_are_refused(
    values: NDArray[Any], there: NDArray[np.bool_] | None, backend: Backend
) -> None:
    log, info = log_of(["true"], 4, backend), dict[str, Any]()
    with pytest.raises(ValueError, match=r"reshape|shape"):
        log.spread([(info, "a", "_a", values, there)], np.array([1, 2]))
    assert info == {}


@pytest.mark.slow(backend="python")
def test_a_log_in_a_cycle_is_collected(backend: Backend) -> None:
    log = log_of(["always(x > 0)"], 2, backend)
    log.feed(np.ones((2, 2)), columns_of(log))
    held: dict[str, object] = {"verdict log": log}
    log.__dict__["held"] = held
    gone = weakref.ref(log)
    del log, held
    gc.collect()
    assert gone() is None
