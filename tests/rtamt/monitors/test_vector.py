"""Monitors in lockstep are a list of single ones, with a time each."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from strategies import INFINITIES, QUARTERS, formulas

from rtamt import (
    EpisodeMonitor,
    Formula,
    Monitor,
    VectorEpisodeMonitor,
    VectorMonitor,
)
from rtamt.inputs.lanes import LaneReader

Backend = Literal["native", "python"]
End = Literal["complete", "cut", "open"]
ENDS: tuple[End, ...] = ("complete", "cut", "open")
Masks = NDArray[np.bool_] | None
Vector = VectorMonitor | VectorEpisodeMonitor
NAN = math.nan


class Singles:
    """What `VectorMonitor` is defined to be."""

    def __init__(self, formula: Formula, num: int, backend: Backend) -> None:
        self.lanes = [Monitor(formula, backend=backend) for _ in range(num)]
        self.last = [NAN] * num

    def chosen(self, mask: Masks) -> list[int]:
        return [i for i in range(len(self.lanes)) if mask is None or mask[i]]

    def update(self, rows: NDArray[np.float64], mask: Masks) -> list[float]:
        for i in self.chosen(mask):
            self.last[i] = self.lanes[i].update(rows[i])
        return self.last

    def reset(self, mask: Masks) -> None:
        for i in self.chosen(mask):
            self.lanes[i].reset()
            self.last[i] = NAN

    @property
    def samples(self) -> list[int]:
        return [lane.samples for lane in self.lanes]


class SingleEpisodes:
    """What `VectorEpisodeMonitor` is defined to be."""

    def __init__(self, formula: Formula, num: int, backend: Backend) -> None:
        self.lanes = [EpisodeMonitor(formula, backend=backend) for _ in range(num)]

    def chosen(self, mask: Masks) -> list[EpisodeMonitor]:
        return [lane for i, lane in enumerate(self.lanes) if mask is None or mask[i]]

    def update(self, rows: NDArray[np.float64], mask: Masks) -> list[float]:
        for row, lane in zip(rows, self.lanes, strict=True):
            if lane in self.chosen(mask):
                lane.update(row)
        return self.each("robustness")

    def reset(self, mask: Masks) -> None:
        for lane in self.chosen(mask):
            lane.reset()

    def finish(self, mask: Masks, end: End) -> list[float]:
        for lane in self.chosen(mask):
            lane.finish(end)
        return self.each("robustness")

    def each(self, name: str) -> list[Any]:
        return [getattr(lane, name) for lane in self.lanes]


@st.composite
def masks(draw: st.DrawFn, num: int) -> Masks:
    """Some lanes, none, all, or no mask."""
    if draw(st.booleans()):
        return None
    return np.array(draw(st.lists(st.booleans(), min_size=num, max_size=num)))


@st.composite
def tables(
    draw: st.DrawFn, num: int, width: int, values: tuple[float, ...] = QUARTERS
) -> NDArray[np.float64]:
    """A sample for each lane."""
    drawn = draw(st.binary(min_size=num * width, max_size=num * width))
    return np.array([values[b % len(values)] for b in drawn]).reshape(num, width)


def spoilt(rows: NDArray[np.float64], mask: Masks) -> NDArray[np.float64]:
    """The rows, nan in the lanes that the mask leaves out."""
    return rows if mask is None else np.where(mask[:, None], rows, NAN)


def same(found: object, expected: object) -> bool:
    return np.array_equal(np.asarray(found), np.asarray(expected), equal_nan=True)


# Vector equals list of singles. ------------------------------------------------------------------


@given(formula=formulas(depth=2), num=st.integers(1, 5), data=st.data())
def test_a_vector_monitor_is_a_list_of_monitors(
    formula: Formula, num: int, data: st.DataObject, backend: Backend
) -> None:
    vector, singles = VectorMonitor(formula, num, backend=backend), Singles(formula, num, backend)
    assert (vector.num, vector.latency) == (num, singles.lanes[0].latency)
    assert vector.variables == singles.lanes[0].variables
    for _ in range(data.draw(st.integers(1, 9))):
        mask = data.draw(masks(num))
        if data.draw(st.integers(0, 4)) == 0:
            vector.reset(mask)
            singles.reset(mask)
        else:
            rows = data.draw(tables(num, len(vector.variables)))
            assert same(vector.update(spoilt(rows, mask), mask), singles.update(rows, mask))
        assert same(vector.samples, singles.samples)
        if data.draw(st.integers(0, 4)) == 0:
            vector = pickle.loads(pickle.dumps(vector))


@given(formula=formulas(depth=2, endless=True), num=st.integers(1, 4), data=st.data())
def test_a_vector_episode_monitor_is_a_list_of_episode_monitors(
    formula: Formula, num: int, data: st.DataObject, backend: Backend
) -> None:
    vector = VectorEpisodeMonitor(formula, num, backend=backend)
    singles = SingleEpisodes(formula, num, backend)
    for _ in range(data.draw(st.integers(1, 9))):
        mask, what = data.draw(masks(num)), data.draw(st.integers(0, 5))
        chosen = singles.chosen(mask)
        if what == 0:
            vector.reset(mask)
            singles.reset(mask)
        elif what == 1 and all(lane.samples for lane in chosen):
            end = data.draw(st.sampled_from(ENDS))
            assert same(vector.finish(mask, end=end), singles.finish(mask, end))
        elif not any(lane.finished for lane in chosen):
            rows = data.draw(tables(num, len(vector.variables)))
            assert same(vector.update(spoilt(rows, mask), mask), singles.update(rows, mask))
        for name in ("robustness", "lower", "upper", "verdict", "finished", "samples"):
            assert same(getattr(vector, name), singles.each(name)), name
        if data.draw(st.integers(0, 4)) == 0:
            vector = pickle.loads(pickle.dumps(vector))


@given(
    formula=formulas(depth=2, total=False).filter(lambda f: bool(f.variables)),
    num=st.integers(1, 4),
    data=st.data(),
)
def test_nan_is_held_in_each_lane_by_itself(
    formula: Formula, num: int, data: st.DataObject, backend: Backend
) -> None:
    vector = VectorMonitor(formula, num, backend=backend, nan="hold")
    lanes = [Monitor(formula, backend=backend, nan="hold") for _ in range(num)]
    width = len(vector.variables)
    for i in range(data.draw(st.integers(1, 6))):
        rows = data.draw(tables(num, width, INFINITIES if i == 0 else (*INFINITIES, *[NAN] * 20)))
        expected = [lane.update(row) for lane, row in zip(lanes, rows, strict=True)]
        assert same(vector.update(rows), expected)


# Arrays. -----------------------------------------------------------------------------------------

CLASSES = (VectorMonitor, VectorEpisodeMonitor)


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(
    "convert",
    [
        np.asfortranarray,
        lambda rows: rows.astype(np.float32),
        lambda rows: rows.astype(np.int8),
        lambda rows: rows.astype(">f8"),
        lambda rows: np.repeat(rows, 2, axis=1)[:, ::2],
        lambda rows: rows[::-1].copy()[::-1],
        lambda rows: (
            np.concatenate([np.zeros(1, np.int8), rows.ravel().view(np.int8)])[1:]
            .view(np.float64)
            .reshape(rows.shape)
        ),
        lambda rows: rows.tolist(),
        lambda rows: rows.view(np.matrix),
    ],
)
def test_arrays_of_every_layout_and_type_are_converted(
    kind: type[Vector], convert: Callable[[Any], Any], backend: Backend
) -> None:
    vector = kind("always[0:3](x - 2 * y > 0)", 3, backend=backend)
    rows = np.array([[5.0, 1.0], [4.0, 3.0], [0.0, 7.0]])
    twin = kind("always[0:3](x - 2 * y > 0)", 3, backend=backend)
    frozen = rows.copy()
    frozen.flags.writeable = False
    for _ in range(5):
        assert same(vector.update(convert(rows)), twin.update(frozen))


@pytest.mark.parametrize("kind", CLASSES)
def test_masks_of_every_layout_are_taken(kind: type[Vector], backend: Backend) -> None:
    for mask in ([True, False, True], np.array([1, 1, 0, 0, 1, 0], dtype=bool)[::2]):
        vector = kind("x > 0", 3, backend=backend)
        vector.update(np.ones((3, 1)), mask)
        assert vector.samples.tolist() == [1, 0, 1]
        vector.reset([True, False, False])
        assert vector.samples.tolist() == [0, 0, 1]


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize("step", [1, 2])
def test_bytes_of_a_mask_that_are_not_0_or_1_are_true(
    kind: type[Vector], step: int, backend: Backend
) -> None:
    mask = np.repeat(np.array([2, 0, 255], np.uint8), step).view(bool)[::step]
    vector = kind("x > 0", 3, backend=backend, nan="hold")
    vector.update(np.ones((3, 1)))
    vector.update([[NAN], [NAN], [2.0]], mask)
    assert vector.samples.tolist() == [2, 1, 2]
    if isinstance(vector, VectorEpisodeMonitor):
        vector.finish(mask)
        assert vector.finished.tolist() == [True, False, True]
    vector.reset(mask)
    assert vector.samples.tolist() == [0, 1, 0]


def test_a_table_that_is_not_aligned_is_copied() -> None:
    held = np.frombuffer(bytes(8 * 6 + 1), np.uint8)[1:].view(np.float64).reshape(3, 2)
    reader = LaneReader(VectorMonitor("x > y", 3).program, 3, "raise")
    assert not held.flags.aligned
    assert reader.values(held).flags.aligned


@pytest.mark.parametrize("kind", CLASSES)
def test_a_formula_without_variables_takes_rows_without_columns(
    kind: type[Vector], backend: Backend
) -> None:
    vector = kind("2 > 1", 3, backend=backend)
    mask = np.array([True, False, True])
    assert same(vector.update(np.empty((3, 0)), mask)[mask], [1.0, 1.0])
    assert vector.samples.tolist() == [1, 0, 1]


def test_types_of_what_is_handed_out(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(x > 0)", 2, backend=backend)
    found = [vector.update([[1], [2]]), vector.robustness, vector.lower, vector.upper]
    found += [vector.finish(), VectorMonitor("x > 0", 2, backend=backend).update([[1], [2]])]
    assert {array.dtype.str for array in found} == {"<f8"}
    assert [a.dtype for a in (vector.verdict, vector.finished, vector.samples)] == [
        np.int8,
        np.bool_,
        np.int64,
    ]


@pytest.mark.parametrize("kind", CLASSES)
def test_arrays_handed_out_are_the_callers_own(kind: type[Vector], backend: Backend) -> None:
    vector = kind("x > 0", 2, backend=backend)
    rows = np.array([[1.0], [2.0]])
    first = vector.update(rows)
    rows[:] = 9
    names = ["samples"]
    if isinstance(vector, VectorEpisodeMonitor):
        names += ["robustness", "lower", "upper", "verdict", "finished"]
    taken = [first, *(getattr(vector, name) for name in names)]
    copies = [array.copy() for array in taken]
    vector.reset()
    vector.update([[-1], [-2]])
    assert all(same(array, copied) for array, copied in zip(taken, copies, strict=True))
    for array in taken:
        array[:] = 7
    assert vector.samples.tolist() == [1, 1]
    assert vector.update([[0], [0]], [False, False]).tolist() == [-1.0, -2.0]


# Snapshots. --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(
    "twin_of", [copy.copy, copy.deepcopy, lambda v: pickle.loads(pickle.dumps(v))]
)
def test_a_copy_in_the_middle_goes_on_alike_and_alone(
    kind: type[Vector], twin_of: Callable[[Vector], Vector], backend: Backend
) -> None:
    text = "always[0:5]((x > 3) implies eventually[0:2](y > 1)) and (x > 0) since y > 0"
    vector = kind(text, np.int64(3), backend=backend, nan="hold")
    rng = np.random.default_rng(0)
    for _ in range(9):
        vector.update(rng.normal(size=(3, 2)), rng.random(3) < 0.7)
    twin = twin_of(vector)
    assert (repr(twin), twin.num, twin.period) == (repr(vector), 3, None)
    vector.reset([True, False, False])
    assert twin.samples[0] > 0 == vector.samples[0]
    twin.reset([True, False, False])
    for _ in range(9):
        rows = rng.normal(size=(3, 2))
        rows[1:][rng.random((2, 2)) < 0.2] = NAN
        assert same(vector.update(rows), twin.update(rows))
    assert same(vector.samples, twin.samples)


def test_a_copy_keeps_the_period_and_what_is_finished(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always[0:1s](x > 0)", 2, "500ms", backend=backend)
    vector.update([[1], [2]])
    vector.finish([True, False])
    twin = copy.copy(vector)
    assert (twin.period, twin.finished.tolist()) == (vector.period, [True, False])
    assert repr(twin) == "<VectorEpisodeMonitor of 2 lanes of always[0:1s](x > 0)>"
    assert (
        repr(VectorMonitor("x > 0", 4, backend=backend))
        == "<VectorMonitor of 4 lanes of x > 0, latency 0>"
    )


@pytest.mark.parametrize(
    ("kind", "text"),
    [(VectorMonitor, "historically(x > 1)"), (VectorEpisodeMonitor, "always(x > 1)")],
)
def test_what_nan_holds_is_part_of_the_state(
    kind: type[Vector], text: str, backend: Backend
) -> None:
    vector = kind(text, 2, backend=backend, nan="hold")
    vector.update([[2.0], [4.0]])
    copied = pickle.loads(pickle.dumps(vector))
    assert copied.update([[NAN], [NAN]]).tolist() == [1.0, 3.0]
