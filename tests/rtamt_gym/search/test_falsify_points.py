"""The points that a search begins with, and what it says of the space that it has seen."""

from itertools import groupby, islice, pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import qmc

from rtamt_gym.search.falsification.optimizers import Climb
from rtamt_gym.search.falsification.points import (
    Pieces,
    coverage_of,
    extremes,
    quasi_random,
    spread,
    take,
)

SIZES = st.lists(st.integers(1, 7), min_size=1, max_size=4)


def groups_of(sizes: list[int]) -> list[slice]:
    ends = np.cumsum(sizes).tolist()
    return [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]


@given(SIZES)
def test_extremes_are_all_corners_of_constant_inputs_once(sizes: list[int]) -> None:
    found = [tuple(point.tolist()) for point in extremes(groups_of(sizes))]
    corners = product((0.0, 1.0), repeat=len(sizes))
    assert sorted(found) == sorted(tuple(np.repeat(corner, sizes).tolist()) for corner in corners)
    assert found[0] == (0.0,) * sum(sizes)
    assert found[1] == (1.0,) * sum(sizes)


@pytest.mark.parametrize("count", [5, 9, 15])
def test_sixteen_corners_of_many_inputs_hold_every_pair_of_ends(count: int) -> None:
    points = take(extremes(groups_of([1] * count)), 16, count)
    assert points.shape == (16, count)
    for one in range(count):
        for other in range(one):
            assert len({tuple(point) for point in points[:, [one, other]].tolist()}) == 4


def test_more_columns_than_a_sequence_has_are_drawn() -> None:
    many = qmc.Sobol.MAXDIM + 1
    points = [*islice(quasi_random(many, np.random.default_rng(5)), 2)]
    rng = np.random.default_rng(5)
    assert [point.tolist() for point in points] == [rng.random(many).tolist() for _ in range(2)]


@given(SIZES, st.integers(0, 99))
def test_spread_points_have_the_pieces_that_are_said(sizes: list[int], seed: int) -> None:
    groups = groups_of(sizes)
    points = list(islice(spread(groups, np.random.default_rng(seed)), 24))
    half = (max(sizes) + 1) // 2
    for number, point in enumerate(points):
        assert ((point >= 0) & (point <= 1)).all()
        most = {0: max(sizes), 1: half, 2: max(sizes), 3: max(min(3, half), 1)}[number % 4]
        for group in groups:
            assert np.count_nonzero(np.diff(point[group])) < most


@given(SIZES, st.integers(1, 8), st.integers(0, 99))
def test_stretched_points_keep_each_value_about_equally_long(
    sizes: list[int], count: int, seed: int
) -> None:
    shape = Pieces(groups_of(sizes), count)
    assert shape.dimension == sum(min(size, count) for size in sizes)
    values = np.random.default_rng(seed).random((3, shape.dimension))
    points = shape.stretched(values)
    assert points.shape == (3, sum(sizes))
    for point, value in zip(points, values, strict=True):
        pieces = [list(each) for group in groups_of(sizes) for _, each in groupby(point[group])]
        assert [piece[0] for piece in pieces] == value.tolist()
        for size in sizes:
            lengths = [len(pieces.pop(0)) for _ in range(min(size, count))]
            assert sum(lengths) == size
            assert max(lengths) - min(lengths) <= 1


@pytest.mark.parametrize("dimension", [1, 2, 6])
def test_a_climb_comes_to_an_optimum_at_a_corner_and_ends(dimension: int) -> None:
    climb = Climb(np.full(dimension, 0.5), np.random.default_rng(1), sigma=0.3, population=8)
    best = np.inf
    for _ in range(200):
        points = climb.ask()
        assert points.shape == (8, dimension)
        values = 1.0 + (1.0 - points).sum(axis=1)
        best = min(best, float(values.min()))
        climb.tell(values)
        if climb.over:
            break
    assert climb.over
    assert best == 1.0
    assert climb.level == np.median(values)


@given(st.integers(1, 4), st.integers(1, 30), st.integers(0, 99))
def test_coverage_is_what_it_says(dimension: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.random((count, dimension))
    coverage = coverage_of(points)
    assert (coverage.simulations, coverage.columns) == (count, dimension)
    gaps = []
    for column in points.T:
        ends = [0.0, *sorted(column.tolist()), 1.0]
        gaps += [b - a for a, b in pairwise(ends)]
    assert coverage.gap == pytest.approx(max(gaps))
    others = rng.random((2000, dimension))
    distances = np.abs(others[:, None] - points).max(axis=2).min(axis=1)
    assert coverage.distance == pytest.approx(np.median(distances), rel=0.15, abs=0.02)
