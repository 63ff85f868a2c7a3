"""Samplers: their numbers of points, their properties, and errors."""

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt import InputError, InputTypeError
from rtamt_gym import Parameter, Signal, Space
from rtamt_gym.search.sweeps.samplers import Sampler, sample

FREE: tuple[Sampler, ...] = ("sobol", "lhs", "random")
ALL: tuple[Sampler, ...] = (*FREE, "grid", "morris", "saltelli")

SPACES = st.integers(1, 4).map(lambda n: Space([Parameter(f"p{i}", 0, 1) for i in range(n)]))


def mixed() -> Space:
    return Space(
        [
            Signal("u", 0, 10, points=2),
            Parameter("mass", 1, 2),
            Parameter("gear", values=(1, 2, 4)),
        ],
        duration=4,
    )


@settings(max_examples=examples(50))
@given(space=SPACES, sampler=st.sampled_from(ALL), power=st.integers(0, 3), seed=st.integers(0, 99))
def test_points_are_in_the_unit_cube_and_those_of_a_seed_are_the_same(
    space: Space, sampler: Sampler, power: int, seed: int
) -> None:
    points = sample(space, 2**power, sampler, seed)
    each = {
        "grid": 2 ** (power * space.dimension),
        "morris": 2**power * (space.dimension + 1),
        "saltelli": 2**power * (space.dimension + 2),
    }
    assert points.shape == (each.get(sampler, 2**power), space.dimension)
    assert ((points >= 0) & (points <= 1)).all()
    assert (points == sample(space, 2**power, sampler, seed)).all()


@pytest.mark.parametrize("sampler", [*FREE, "morris", "saltelli"])
def test_another_seed_gives_other_points(sampler: Sampler) -> None:
    first, second = (sample(mixed(), 8, sampler, seed) for seed in (1, 2))
    assert (first != second).any()


@given(space=SPACES, count=st.integers(1, 40), more=st.integers(0, 40))
def test_the_first_points_of_a_longer_sobol_sequence_are_those_of_a_shorter(
    space: Space, count: int, more: int
) -> None:
    assert (sample(space, count + more)[:count] == sample(space, count)).all()


@given(space=SPACES, count=st.integers(1, 30), seed=st.integers(0, 9))
def test_a_latin_hypercube_takes_each_share_of_a_column_once(
    space: Space, count: int, seed: int
) -> None:
    shares = np.floor(sample(space, count, "lhs", seed) * count).astype(int)
    for column in shares.T:
        assert sorted(column) == list(range(count))


def test_a_grid_has_all_combinations_in_order() -> None:
    space = mixed()
    cases = [tuple(space.case(p).columns().values()) for p in sample(space, 3, "grid")]
    assert cases == list(product((0, 5, 10), (0, 5, 10), (1, 1.5, 2), (1, 2, 4)))


def test_a_grid_takes_a_number_for_each() -> None:
    space = mixed()
    points = sample(space, {"u": 1, "mass": 2}, "grid")
    cases = [tuple(space.case(p).columns().values()) for p in points]
    assert cases == list(product((5,), (5,), (1, 2), (1, 2, 4)))


def test_a_grid_of_logarithms_is_even_in_them() -> None:
    space = Space([Parameter("rate", 1, 100, log=True)])
    cases = [space.case(p)["rate"] for p in sample(space, 3, "grid")]
    assert cases == pytest.approx([1, 10, 100], rel=1e-12)


def test_morris_changes_one_column_at_a_time_by_two_of_three_steps() -> None:
    points = sample(mixed(), 5, "morris", 3).reshape(5, 5, 4)
    moves = np.diff(points, axis=1)
    assert (np.count_nonzero(moves, axis=2) == 1).all()
    assert np.abs(moves).sum(axis=2) == pytest.approx(np.full((5, 4), 2 / 3))
    assert (np.count_nonzero(moves, axis=1) == 1).all()


def test_saltelli_changes_one_column_of_a_point_at_a_time() -> None:
    blocks = sample(mixed(), 4, "saltelli").reshape(4, 6, 4)
    for first, *between, last in blocks:
        for column, point in enumerate(between):
            expected = first.copy()
            expected[column] = last[column]
            assert (point == expected).all()


@pytest.mark.parametrize(
    ("samples", "sampler", "kind", "message"),
    [
        (
            0,
            "sobol",
            InputError,
            "expected samples= as 1 or more, got 0",
        ),
        (
            2.5,
            "lhs",
            InputTypeError,
            "expected samples= as a whole number, got 2.5",
        ),
        (
            100,
            "saltelli",
            InputError,
            ("expected samples= as a power of two with sampler='saltelli', got 100; use 64 or 128"),
        ),
        (
            4,
            "sobel",
            InputError,
            (
                "expected sampler='grid', 'sobol', 'lhs', 'random', 'morris' or "
                "'saltelli', got 'sobel'; did you mean 'sobol'?"
            ),
        ),
        (
            {"mass": 2},
            "random",
            InputError,
            "expected samples= as one number with sampler='random', got {'mass': 2}",
        ),
        (
            {"mas": 2},
            "grid",
            InputError,
            (
                "samples= names 'mas', which is not varied; the space has 'u', 'mass', 'gear'; "
                "did you mean 'mass'?"
            ),
        ),
        ({"mass": 2}, "grid", InputError, "samples= gives no number for 'u'"),
        (
            {"u": 2, "mass": 2, "gear": 2},
            "grid",
            InputError,
            "samples= gives a number for 'gear', which takes all of its values; omit it",
        ),
        (
            {"u": 0, "mass": 2},
            "grid",
            InputError,
            "expected samples= of 'u' as 1 or more, got 0",
        ),
        (
            1000,
            "grid",
            InputError,
            (
                "expected a smaller grid, got 3000000000 points in 4 columns; "
                "sampler='sobol' fills a space with any number of points"
            ),
        ),
        (10**9, "random", InputError, "expected fewer samples, got 1000000000 in 4 columns"),
    ],
)
def test_mistakes_are_told(samples: Any, sampler: Any, kind: type, message: str) -> None:  # noqa: ANN401
    with pytest.raises(kind) as caught:
        sample(mixed(), samples, sampler)
    assert str(caught.value) == message
    assert math.isfinite(sample(mixed(), 2).sum())
