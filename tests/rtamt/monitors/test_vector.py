"""Vector monitors are a list of single monitors, each with its own time."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bits import bits
from choices import ENDS, Backend
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from profiles import examples
from strategies import INFINITIES, INTEGERS, QUARTERS, formulas

from rtamt import EpisodeMonitor, Formula, Monitor, VectorEpisodeMonitor, VectorMonitor
from rtamt.inputs.batch import BatchReader
from rtamt.machines.backend import BACKENDS
from rtamt.typing import End

Masks = NDArray[np.bool_] | None


Vector = VectorMonitor | VectorEpisodeMonitor


NAN = math.nan


class Singles:
    """The definition of `VectorMonitor`."""

    def __init__(self, formula: Formula, num: int, backend: Backend) -> None:
        self.entries = [Monitor(formula, backend=backend) for _ in range(num)]
        self.last = [NAN] * num

    def chosen(self, mask: Masks) -> list[int]:
        return [i for i in range(len(self.entries)) if mask is None or mask[i]]

    def update(self, rows: NDArray[np.float64], mask: Masks) -> list[float]:
        for i in self.chosen(mask):
            self.last[i] = self.entries[i].update(rows[i])
        return self.last

    def reset(self, mask: Masks) -> None:
        for i in self.chosen(mask):
            self.entries[i].reset()
            self.last[i] = NAN

    @property
    def samples(self) -> list[int]:
        return [entry.samples for entry in self.entries]


class SingleEpisodes:
    """The definition of `VectorEpisodeMonitor`."""

    def __init__(self, formula: Formula, num: int, backend: Backend) -> None:
        self.entries = [EpisodeMonitor(formula, backend=backend) for _ in range(num)]

    def chosen(self, mask: Masks) -> list[EpisodeMonitor]:
        return [entry for i, entry in enumerate(self.entries) if mask is None or mask[i]]

    def update(self, rows: NDArray[np.float64], mask: Masks) -> list[float]:
        for row, entry in zip(rows, self.entries, strict=True):
            if entry in self.chosen(mask):
                entry.update(row)
        return self.each("robustness")

    def reset(self, mask: Masks) -> None:
        for entry in self.chosen(mask):
            entry.reset()

    def finish(self, mask: Masks, end: End) -> list[float]:
        for entry in self.chosen(mask):
            entry.finish(end)
        return self.each("robustness")

    def each(self, name: str) -> list[Any]:
        return [getattr(entry, name) for entry in self.entries]


@st.composite
def masks(draw: st.DrawFn, num: int) -> Masks:
    """Some entries, none, all, or no mask."""
    if draw(st.booleans()):
        return None
    return np.array(draw(st.lists(st.booleans(), min_size=num, max_size=num)))


@st.composite
def tables(
    draw: st.DrawFn, num: int, width: int, values: tuple[float, ...] = QUARTERS + INTEGERS
) -> NDArray[np.float64]:
    """A sample for each entry."""
    drawn = draw(st.binary(min_size=num * width, max_size=num * width))
    return np.array([values[b % len(values)] for b in drawn]).reshape(num, width)


def spoilt(rows: NDArray[np.float64], mask: Masks) -> NDArray[np.float64]:
    """Return the rows, with nan in the entries that the mask omits."""
    return rows if mask is None else np.where(mask[:, None], rows, NAN)


def same(found: ArrayLike, expected: ArrayLike) -> bool:
    """Whether arrays are the same bit for bit."""
    return bits(np.asarray(found, float)) == bits(np.asarray(expected, float))


# Vector equals list of singles. ------------------------------------------------------------------
@given(formula=formulas(depth=2), num=st.integers(1, 5), data=st.data())
def test_a_vector_monitor_is_a_list_of_monitors(
    formula: Formula, num: int, data: st.DataObject, backend: Backend
) -> None:
    vector, singles = VectorMonitor(formula, num, backend=backend), Singles(formula, num, backend)
    assert (vector.num, vector.latency) == (num, singles.entries[0].latency)
    assert vector.variables == singles.entries[0].variables
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
        elif what == 1 and all(entry.samples for entry in chosen):
            end = data.draw(st.sampled_from(ENDS))
            assert same(vector.finish(mask, end=end), singles.finish(mask, end))
        elif not any(entry.finished for entry in chosen):
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
def test_nan_is_held_in_each_entry_by_itself(
    formula: Formula, num: int, data: st.DataObject, backend: Backend
) -> None:
    vector = VectorMonitor(formula, num, backend=backend, nan="hold")
    entries = [Monitor(formula, backend=backend, nan="hold") for _ in range(num)]
    width = len(vector.variables)
    for i in range(data.draw(st.integers(1, 6))):
        rows = data.draw(tables(num, width, INFINITIES if i == 0 else (*INFINITIES, *[NAN] * 20)))
        expected = [entry.update(row) for entry, row in zip(entries, rows, strict=True)]
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
    reader = BatchReader(VectorMonitor("x > y", 3).program, 3, "raise")
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
    assert repr(twin) == "<VectorEpisodeMonitor of 2 batch entries of always[0:1s](x > 0)>"
    assert (
        repr(VectorMonitor("x > 0", 4, backend=backend))
        == "<VectorMonitor of 4 batch entries of x > 0, latency 0>"
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


VALUES = ("robustness", "lower", "upper", "verdict", "finished", "samples")


# Values are halves, so that predicates are 0 often.
_words = st.sampled_from(("and", "or", "implies", "xor"))


_atoms = st.sampled_from(
    [f"({x} {sign} {c})" for x in "xyz" for sign in (">", ">=", "<", "==") for c in (0, 0.5)]
    + ["true", "false"]
)


@st.composite
def trees(draw: st.DrawFn, depth: int, leaf: Callable[[st.DrawFn], str]) -> str:
    if depth == 0 or draw(st.integers(0, 2)) == 0:
        return leaf(draw)
    left, right = draw(trees(depth - 1, leaf)), draw(trees(depth - 1, leaf))
    return f"({left} {draw(_words)} {right})"


def atom(draw: st.DrawFn) -> str:
    return draw(_atoms)


def window(draw: st.DrawFn) -> str:
    """A window that starts now, or one that does not and is not a column."""
    begin = draw(st.sampled_from((0,) * 9 + (1,)))
    end = draw(st.sampled_from((1, 2, 3, 4, 5, 7, 8, 12)))
    name = draw(st.sampled_from(("always", "eventually")))
    return f"{name}[{begin}:{end}]{draw(trees(1, atom))}"


def operand(draw: st.DrawFn) -> str:
    """Predicates and one window or two, joined; the same window may be read twice."""
    windows = [window(draw) for _ in range(draw(st.sampled_from((0, 1, 1, 1, 2))))]

    def leaf(draw: st.DrawFn) -> str:
        return draw(st.sampled_from([*windows, draw(_atoms)]))

    return draw(trees(3, leaf))


def fold(draw: st.DrawFn) -> str:
    name = draw(st.sampled_from(("always", "eventually")))
    bounds = draw(st.sampled_from(("", "", "", "[0:3]", "[0:8]", "[2:6]", "[1:20]", "[4:inf]")))
    return f"{name}{bounds}({operand(draw)})"


@st.composite
def texts(draw: st.DrawFn) -> str:
    """A fold over times, or several joined with predicates of the first sample."""
    if draw(st.integers(0, 3)):
        return fold(draw)
    return draw(trees(2, lambda draw: fold(draw) if draw(st.booleans()) else atom(draw)))


@pytest.mark.parametrize("single", list(BACKENDS))
@settings(max_examples=examples(40))
@given(text=texts(), num=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
def test_entries_in_columns_are_episode_monitors_bit_for_bit(
    text: str, num: int, seed: int, single: Backend, backend: Backend
) -> None:
    vector = VectorEpisodeMonitor(text, num, backend=backend)
    entries = [EpisodeMonitor(text, backend=single) for _ in range(num)]
    random = np.random.default_rng(seed)
    for _ in range(random.integers(1, 40)):
        act(vector, entries, random)
        for name in VALUES:
            expected = [getattr(entry, name) for entry in entries]
            assert bits(getattr(vector, name)) == bits(expected), name
        if random.random() < 0.1:
            vector = pickle.loads(pickle.dumps(vector))


def act(
    vector: VectorEpisodeMonitor, entries: list[EpisodeMonitor], random: np.random.Generator
) -> None:
    """Reset, finish or update some entries, and their twins."""
    num, what = len(entries), random.random()
    mask = None if random.random() < 0.6 else random.random(num) < random.choice([0.1, 0.6])
    chosen = [i for i in range(num) if mask is None or mask[i]]
    if what < 0.1:
        vector.reset(mask)
        for i in chosen:
            entries[i].reset()
    elif what < 0.2 and all(entries[i].samples for i in chosen):
        end = random.choice(["complete", "cut", "open"])
        vector.finish(mask, end=end)
        for i in chosen:
            entries[i].finish(end)
    elif not any(entries[i].finished for i in chosen):
        rows = random.integers(-2, 4, (num, len(vector.variables))) / 2.0
        vector.update(rows if random.random() < 0.5 else np.asfortranarray(rows), mask)
        for i in chosen:
            entries[i].update(rows[i])


LONG = (
    "always(x > 0)",
    "always(x > 0 implies eventually[0:{k}](y > 0))",
    "always(eventually[0:{k}](x > 0))",
    "eventually(always[0:{k}](x > 0))",
    "always((x > 0 implies always[0:{k}](y > 0)) and (x > 1 or eventually[0:{k}](y < x)))",
    "always[1:inf](eventually[0:{k}](x > 0))",
    "eventually[1:inf](always[0:{k}](x > 0))",
    "always[{k}:200]((x > 0 or eventually[0:{k}](y > 0)) and y < 1)",
)


@pytest.mark.slow(keep=12)
@pytest.mark.parametrize("k", [1, 2, 7, 16])
@pytest.mark.parametrize("text", LONG)
def test_long_episodes_of_entries_that_fall_out_of_step(
    text: str, k: int, backend: Backend
) -> None:
    text = text.format(k=k)
    vector = VectorEpisodeMonitor(text, 5, backend=backend)
    entries = [EpisodeMonitor(text, backend=backend) for _ in range(5)]
    random = np.random.default_rng(k)
    for step in range(200):
        mask = random.random(5) < 0.9 if 100 < step < 130 else np.ones(5, bool)
        again = random.random(5) < 0.01
        vector.reset(again)
        rows = random.normal(size=(5, len(vector.variables)))
        vector.update(rows, mask)
        for entry, row, fed, begins in zip(entries, rows, mask, again, strict=True):
            if begins:
                entry.reset()
            if fed:
                entry.update(row)
        if step % 7 == 0:
            for name in VALUES:
                assert bits(getattr(vector, name)) == bits([getattr(e, name) for e in entries]), (
                    name
                )


@pytest.mark.parametrize("k", [1, 2, 5])
@pytest.mark.parametrize("left_out", [1, 2])
@pytest.mark.parametrize("before", [5.0, -5.0])
def test_an_entry_that_waits_after_its_first_sample_keeps_it(
    before: float, k: int, left_out: int, backend: Backend
) -> None:
    text = f"always(eventually[0:{k}](x > 0))"
    vector = VectorEpisodeMonitor(text, 2, backend=backend)
    single = EpisodeMonitor(text, backend=backend)
    for _ in range(9):  # samples of the previous episode, which the entry must not read again
        vector.update([[-1.0], [before]])
    vector.reset([False, True])
    values = [3.0, *[-2.0] * k, *[4.0] * (k + 1)]
    for step, value in enumerate(values):
        vector.update([[-1.0], [value]])
        single.update(value)
        for name in VALUES:
            assert bits(getattr(vector, name)[1:]) == bits([getattr(single, name)]), name
        for _ in range(left_out if step == 0 else 0):
            vector.update([[-1.0], [0.0]], [True, False])


@pytest.mark.parametrize(
    "text",
    [
        "always(x > 0 and 2 > 1)",
        "eventually(x > 0 or 2 > 1)",
        "eventually[0:9](x > 0 or 2 > 1)",
        "always[3:9](x > 0 and 2 > 1)",
        "always(x > 0 implies eventually[0:3](y > 0 or 2 > 1))",
    ],
)
def test_the_first_sample_will_be_there(text: str, backend: Backend) -> None:
    vector, single = VectorEpisodeMonitor(text, 2, backend=backend), EpisodeMonitor(text)
    for _ in range(3):
        for name in VALUES:
            assert bits(getattr(vector, name)) == bits([getattr(single, name)] * 2), name
        vector.update(np.full((2, len(vector.variables)), 5.0))
        single.update(*[5.0] * len(vector.variables))


def test_a_column_of_an_entry_that_begins_anew_keeps_nothing(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(eventually[0:3](x > 0))", 2, backend=backend)
    fresh = VectorEpisodeMonitor("always(eventually[0:3](x > 0))", 2, backend=backend)
    rows = np.array([[-1.0], [2.0]])
    for _ in range(9):
        vector.update(rows)
    vector.reset()
    for _ in range(9):
        vector.update(-rows)
        fresh.update(-rows)
        assert [bits(getattr(vector, name)) for name in VALUES] == [
            bits(getattr(fresh, name)) for name in VALUES
        ]
