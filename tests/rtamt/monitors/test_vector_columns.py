"""The episodes of many lanes in columns: formulas of the forms that are kept so."""

import pickle
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from bits import bits
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt import EpisodeMonitor, VectorEpisodeMonitor
from rtamt.machines.backend import BACKENDS

Backend = Literal["native", "python"]
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
    """A window that begins now, or one that does not and is no column."""
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
def test_lanes_in_columns_are_episode_monitors_bit_for_bit(
    text: str, num: int, seed: int, single: Backend, backend: Backend
) -> None:
    vector = VectorEpisodeMonitor(text, num, backend=backend)
    lanes = [EpisodeMonitor(text, backend=single) for _ in range(num)]
    random = np.random.default_rng(seed)
    for _ in range(random.integers(1, 40)):
        act(vector, lanes, random)
        for name in VALUES:
            expected = [getattr(lane, name) for lane in lanes]
            assert bits(getattr(vector, name)) == bits(expected), name
        if random.random() < 0.1:
            vector = pickle.loads(pickle.dumps(vector))


def act(
    vector: VectorEpisodeMonitor, lanes: list[EpisodeMonitor], random: np.random.Generator
) -> None:
    """Resets, finishes or updates some lanes, and their twins alike."""
    num, what = len(lanes), random.random()
    mask = None if random.random() < 0.6 else random.random(num) < random.choice([0.1, 0.6])
    chosen = [i for i in range(num) if mask is None or mask[i]]
    if what < 0.1:
        vector.reset(mask)
        for i in chosen:
            lanes[i].reset()
    elif what < 0.2 and all(lanes[i].samples for i in chosen):
        end = random.choice(["complete", "cut", "open"])
        vector.finish(mask, end=end)
        for i in chosen:
            lanes[i].finish(end)
    elif not any(lanes[i].finished for i in chosen):
        rows = random.integers(-2, 4, (num, len(vector.variables))) / 2.0
        vector.update(rows if random.random() < 0.5 else np.asfortranarray(rows), mask)
        for i in chosen:
            lanes[i].update(rows[i])


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
def test_long_episodes_of_lanes_that_fall_out_of_step(text: str, k: int, backend: Backend) -> None:
    text = text.format(k=k)
    vector = VectorEpisodeMonitor(text, 5, backend=backend)
    lanes = [EpisodeMonitor(text, backend=backend) for _ in range(5)]
    random = np.random.default_rng(k)
    for step in range(200):
        mask = random.random(5) < 0.9 if 100 < step < 130 else np.ones(5, bool)
        again = random.random(5) < 0.01
        vector.reset(again)
        rows = random.normal(size=(5, len(vector.variables)))
        vector.update(rows, mask)
        for lane, row, fed, begins in zip(lanes, rows, mask, again, strict=True):
            if begins:
                lane.reset()
            if fed:
                lane.update(row)
        if step % 7 == 0:
            for name in VALUES:
                assert bits(getattr(vector, name)) == bits([getattr(e, name) for e in lanes]), name


@pytest.mark.parametrize("k", [1, 2, 5])
@pytest.mark.parametrize("left_out", [1, 2])
@pytest.mark.parametrize("before", [5.0, -5.0])
def test_a_lane_that_waits_after_its_first_sample_keeps_it(
    before: float, k: int, left_out: int, backend: Backend
) -> None:
    text = f"always(eventually[0:{k}](x > 0))"
    vector = VectorEpisodeMonitor(text, 2, backend=backend)
    single = EpisodeMonitor(text, backend=backend)
    for _ in range(9):  # samples of the episode before, that the lane must not see again
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


def test_a_column_of_a_lane_that_begins_anew_keeps_nothing(backend: Backend) -> None:
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
