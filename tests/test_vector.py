"""Monitors in lockstep are a list of single ones, with a time each."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any, Literal, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from strategies import INFINITIES, QUARTERS, formulas

from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    InputTypeError,
    Monitor,
    StateError,
    VectorEpisodeMonitor,
    VectorMonitor,
)

Backend = Literal["native", "python"]
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

    def finish(self, mask: Masks) -> list[float]:
        for lane in self.chosen(mask):
            lane.finish()
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


@settings(max_examples=150)
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


@settings(max_examples=150)
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
            assert same(vector.finish(mask), singles.finish(mask))
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


# Errors. -----------------------------------------------------------------------------------------

MASK = np.array([True, True, False])
NEEDED = "expected an array of shape (3, 2), a row for each lane and a column for each of x, y, "
REFUSED: list[tuple[Callable[[Vector], object], type[Exception], str]] = [
    (
        lambda v: v.update(np.zeros((2, 3))),
        InputError,
        NEEDED + "got shape (2, 3); lanes that a mask leaves out have rows too",
    ),
    (
        lambda v: v.update(np.zeros((2, 2)), MASK),
        InputError,
        NEEDED + "got shape (2, 2); lanes that a mask leaves out have rows too",
    ),
    (
        lambda v: v.update(np.zeros(6)),
        InputError,
        NEEDED + "got shape (6,); lanes that a mask leaves out have rows too",
    ),
    (
        lambda v: v.update(np.zeros((3, 2), dtype=complex)),
        InputTypeError,
        "expected an array of numbers for the lanes, got complex128",
    ),
    (
        lambda v: v.update([[1, 2], [3], [4, 5]]),
        InputTypeError,
        "expected an array of numbers for the lanes, got list [[1, 2], [3], [4, 5]]",
    ),
    (
        lambda v: v.update({"x": 1}),  # type: ignore[arg-type]
        InputTypeError,
        "expected an array of numbers for the lanes, got dict {'x': 1}",
    ),
    (
        lambda v: v.update(np.zeros((3, 2)), [0, 2]),
        InputTypeError,
        (
            "expected a mask of 3 booleans, got dtype int64; "
            "np.isin(range(3), [0, 2]) makes one of numbers of lanes"
        ),
    ),
    (
        lambda v: v.reset(np.array([1.0, 0.0, 1.0])),
        InputTypeError,
        (
            "expected a mask of 3 booleans, got dtype float64; "
            "np.isin(range(3), [0, 2]) makes one of numbers of lanes"
        ),
    ),
    (
        lambda v: v.update(np.zeros((3, 2)), [True, False]),
        InputError,
        (
            "expected a mask of 3 booleans, one for each lane, got shape (2,); "
            "without a mask all lanes are meant"
        ),
    ),
    (
        lambda v: v.reset(np.ones((3, 1), dtype=bool)),
        InputError,
        (
            "expected a mask of 3 booleans, one for each lane, got shape (3, 1); "
            "without a mask all lanes are meant"
        ),
    ),
    (
        lambda v: v.update([[1.0, 1.0], [1.0, NAN], [NAN, 1.0]]),
        InputError,
        "variable 'y' is nan at sample 2 of lane 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda v: v.update([[1.0, 1.0], [NAN, NAN], [1.0, 1.0]], MASK),
        InputError,
        "variable 'x' is nan at sample 2 of lane 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda v: v.update([[1, 1], [1, 1], [0, -1]]),
        InputError,
        "'sqrt(x + y)' is not a number at sample 1 of lane 2, where x = 0.0, y = -1.0",
    ),
    (
        lambda v: v.update([[-1.0, 0.0], [1.0, 1.0], [NAN, 1.0]]),
        InputError,
        "variable 'x' is nan at sample 1 of lane 2; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda v: v.update([[-1, 0], [-2, 0], [-3, 0]], ~MASK),
        InputError,
        "'sqrt(x + y)' is not a number at sample 1 of lane 2, where x = -3.0, y = 0.0",
    ),
]


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(("call", "error", "message"), REFUSED, ids=[r[2] for r in REFUSED])
def test_refused_input_says_why_and_changes_no_lane(
    kind: type[Vector],
    call: Callable[[Vector], object],
    error: type[Exception],
    message: str,
    backend: Backend,
) -> None:
    text = "historically[0:3](sqrt(x + y) > 1) and once[0:2](x > y)"
    vector, twin = (kind(text, 3, backend=backend) for _ in range(2))
    for monitor in (vector, twin):
        monitor.update([[1, 2], [3, 4], [5, 6]])
        monitor.update([[5.0, 0.0], [7.0, 2.0], [NAN, 6.0]], MASK)
    with pytest.raises(error) as caught:
        call(vector)
    assert str(caught.value) == message
    assert vector.samples.tolist() == [2, 2, 1]
    for rows in ([[9, 0], [8, 0], [7, 0]], [[1, 0], [2, 0], [3, 0]], [[1, 4], [2, 4], [3, 4]]):
        assert same(vector.update(rows), twin.update(rows))


def test_a_nan_that_cannot_be_held_is_refused(backend: Backend) -> None:
    vector = VectorMonitor("x + y > 0", 2, backend=backend, nan="hold")
    vector.update([[1, 2], [3, 4]], [True, False])
    with pytest.raises(InputError) as caught:
        vector.update([[NAN, 1.0], [NAN, 1.0]])
    assert str(caught.value) == (
        "variable 'x' is nan at sample 0 of lane 1; "
        "nan='hold' keeps the last value, which the first sample has not"
    )
    assert vector.update([[NAN, 1.0], [1.0, 1.0]]).tolist() == [2.0, 2.0]
    vector.reset([True, False])
    with pytest.raises(InputError, match="variable 'y' is nan at sample 0 of lane 0; "):
        vector.update([[1.0, NAN], [NAN, 1.0]])
    with pytest.raises(InputError) as caught:
        vector.update([[1.0, 1.0], [math.inf, -math.inf]])
    assert str(caught.value).startswith("'x + y' is not a number at sample 1 of lane 1, where ")


def test_a_finished_lane_takes_no_sample(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(x > 0)", 3, backend=backend)
    vector.update(np.ones((3, 1)))
    vector.finish([False, True, False])
    with pytest.raises(StateError) as caught:
        vector.update(np.full((3, 1), NAN))
    assert str(caught.value) == (
        "the episode of lane 1 is finished; "
        "reset it before its next update, or leave it out with a mask"
    )
    assert vector.samples.tolist() == [1, 1, 1]
    assert vector.update([[2.0], [NAN], [-1.0]], [True, False, True]).tolist() == [1.0, 1.0, -1.0]
    vector.reset([False, True, False])
    assert vector.update([[3], [3], [3]]).tolist() == [1.0, 3.0, -1.0]
    assert vector.finished.tolist() == [False, False, False]


def test_finish_needs_a_sample_in_every_lane_and_finishes_all_or_none(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(x > 0)", 3, backend=backend)
    vector.update(np.ones((3, 1)), [True, True, False])
    with pytest.raises(StateError) as caught:
        vector.finish()
    assert str(caught.value) == (
        "finish() needs at least one sample, lane 2 has got none since its reset; "
        "leave it out with a mask"
    )
    assert vector.finished.tolist() == [False, False, False]
    for _ in range(2):
        assert same(vector.finish([True, True, False]), [1.0, 1.0, NAN])
        assert vector.finished.tolist() == [True, True, False]
        assert vector.verdict.tolist() == [1, 1, 0]
    with pytest.raises(InputTypeError, match=r"^expected a mask of 3 booleans, got dtype int64; "):
        vector.finish([0, 1, 1])


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(
    ("num", "error", "message"),
    [
        (0, InputError, "expected 1 or more lanes, got 0"),
        (-3, InputError, "expected 1 or more lanes, got -3"),
        (
            cast("int", 2.5),
            InputTypeError,
            "expected a whole number of lanes, got 2.5; the period is the third argument",
        ),
        (
            cast("int", "100ms"),
            InputTypeError,
            "expected a whole number of lanes, got '100ms'; the period is the third argument",
        ),
        (
            True,
            InputTypeError,
            "expected a whole number of lanes, got True; the period is the third argument",
        ),
    ],
)
def test_the_number_of_lanes_is_checked(
    kind: type[Vector], num: int, error: type[Exception], message: str, backend: Backend
) -> None:
    with pytest.raises(error) as caught:
        kind("x > 0", num, backend=backend)
    assert str(caught.value) == message


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
