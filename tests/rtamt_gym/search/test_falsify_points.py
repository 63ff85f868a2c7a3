"""The first points of a search, and its report on the covered space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby, islice, pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import qmc

import rtamt
from rtamt_gym import Parameter, falsify
from rtamt_gym.play.history import SimulatedTrace
from rtamt_gym.search.falsification.optimizers import Climb
from rtamt_gym.search.falsification.points import (
    Evaluate,
    Pieces,
    coverage_of,
    extremes,
    quasi_random,
    spread,
    take,
)
from rtamt_gym.search.falsification.scales import checked_scales, in_scales, spreads

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


SPEC = rtamt.parse("slow = always(rpm < 3000); slow implies always(v < 35 and v > -5)")

SPACE = [Parameter("a", 0, 1), Parameter("b", 0, 1)]


def car(a: float, b: float) -> Iterator[Mapping[str, float]]:
    for share in (0.0, 0.5, 1.0):
        yield {"rpm": 1000 + 4000 * a * share, "v": 60 * b * share - 2}


def test_scales_are_the_ranges_over_all_traces_one_for_the_same_variables() -> None:
    traces = [
        SimulatedTrace({"rpm": np.array([1000.0, 2000.0]), "v": np.array([0.0, 10.0])}, None),
        SimulatedTrace({"rpm": np.array([500.0, 600.0]), "v": np.array([-2.0, 4.0])}, None),
    ]
    assert spreads({"a": SPEC}, traces) == {"rpm < 3000": 1500, "v < 35": 12, "v > -5": 12}


def test_a_predicate_that_never_changes_has_no_scale() -> None:
    traces = [SimulatedTrace({"rpm": np.array([1000.0, 1000.0]), "v": np.array([0.0, 10.0])}, None)]
    assert spreads({"a": SPEC}, traces) == {"v < 35": 10, "v > -5": 10}


def test_one_unit_needs_no_scales() -> None:
    assert checked_scales(None, {"a": SPEC}) is None
    assert checked_scales(None, {"a": rtamt.parse("always(x < 1) and eventually(x > 3)")}) == {}
    two = {"a": rtamt.parse("always(x < 1)"), "b": rtamt.parse("always(y < 1)")}
    assert checked_scales(None, two) is None


@given(st.lists(st.tuples(st.floats(0, 6000), st.floats(-20, 80)), min_size=1, max_size=5))
def test_scaled_requirements_have_the_same_verdicts(samples: list[tuple[float, float]]) -> None:
    scales = {"rpm < 3000": 1500.0, "v < 35": 12.0, "v > -5": 12.0}
    scaled = in_scales({"a": SPEC}, scales)["a"]
    rpm, v = np.array(samples).T
    own = rtamt.evaluate(SPEC, {"rpm": rpm, "v": v})[0]
    other = rtamt.evaluate(scaled, {"rpm": rpm, "v": v})[0]
    assert np.signbit(own) == np.signbit(other)
    expected = max((rpm / 1500 - 2).max(), min((35 - v).min(), (v + 5).min()) / 12)
    assert other == pytest.approx(expected)


@pytest.mark.parametrize("batch", [1, 8, 30])
def test_an_optimizer_gets_the_robustness_in_scales_also_of_the_first_runs(batch: int) -> None:
    asked, got = [], []

    def watches(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
        while True:
            points = rng.random((batch, dimension))
            values = evaluate(points)
            asked.extend(points.tolist())
            got.extend(values.tolist())

    slow = [Parameter("a", 0, 1), Parameter("b", 0, 0.5)]
    found = falsify(car, SPEC, slow, period=1, optimizer=watches, budget=60)
    assert not found.falsified
    rpm, v, low = found.scales.values()
    assert list(found.scales) == ["rpm < 3000", "v < 35", "v > -5"]
    assert v == low
    for (a, half), value in zip(asked, got, strict=True):
        b = half / 2
        assert value == pytest.approx(
            max((4000 * a - 2000) / rpm, min(37 - 60 * b, 3) / v), abs=1e-9
        )
    # The report is in the requirement's own units.
    a, b = found.input["a"], found.input["b"]
    assert isinstance(a, float)
    assert isinstance(b, float)
    assert found.robustness == pytest.approx(max(4000 * a - 2000, min(37 - 60 * b, 3)))


def test_given_scales_are_used_and_plain_are_none() -> None:
    given_scales = {"rpm < 3000": 500, "v<35": 7}
    found = falsify(car, SPEC, SPACE, period=1, scales=given_scales, budget=20)
    assert found.scales == {"rpm < 3000": 500, "v < 35": 7}
    assert falsify(car, SPEC, SPACE, period=1, scales="plain", budget=20).scales == {}


def test_the_first_violated_of_several_requirements_ends_the_search() -> None:
    both = {"fast": "always(v < 50)", "high": "always(rpm < 4900)"}
    found = falsify(car, both, SPACE, period=1)
    assert found.falsified
    row = found.record[-1]
    violated = [name for name in both if row.outcomes[name].verdict is rtamt.Verdict.VIOLATED]
    assert found.requirement in violated
    assert all(len(each.outcomes) == 2 for each in found.record)
    assert not any(
        outcome.verdict is rtamt.Verdict.VIOLATED
        for each in found.record[:-1]
        for outcome in each.outcomes.values()
    )
