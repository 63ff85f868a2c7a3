"""Long episodes are thinned, and their important samples stay."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtamt_gym.reports.numbers import MOST, ROOM, evenly, points_of, shown


@given(st.integers(0, 10_000), st.integers(1, 3000), st.integers(1, 4), st.integers(2, 300))
def test_required_samples_stay(seed: int, count: int, width: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    series = [rng.normal(size=count) for _ in range(width)]
    series[0][rng.integers(count)] = np.inf
    keep = [int(rng.integers(count))]
    places = shown(series, count, keep, most)
    assert (np.diff(places) > 0).all()
    assert {0, count - 1, *keep} <= set(places.tolist())
    for each in series:
        finite = np.where(np.isfinite(each), each, np.sign(each) * 1e300)
        assert finite[places].max() == finite.max()
        assert finite[places].min() == finite.min()
    assert len(places) == count if count <= most else len(places) <= most + 5 + 2 * width


def test_spikes_stay_visible() -> None:
    flat, spiky = np.zeros(10_000), np.zeros(10_000)
    spikes = list(range(500, 10_000, 1000))
    spiky[spikes] = 1.0
    places = shown([spiky, flat], 10_000, [], 600)
    assert sum(spike in places for spike in spikes) >= len(spikes) // 2


def test_episodes_share_the_room() -> None:
    for episodes in (1, 5, 20):
        assert points_of(ROOM, episodes, 12) * episodes * 12 <= max(ROOM, episodes * 12 * 60)
    assert points_of(ROOM, 1, 3) == MOST


@pytest.mark.parametrize("count", [1, 7, 1000, 1001, 5000])
def test_even_ranks(count: int) -> None:
    numbers = [float(i) for i in range(count)]
    kept = evenly(numbers, 1000)
    assert len(kept) == min(count, 1000)
    assert (kept[0], kept[-1]) == (numbers[0], numbers[-1])
    gaps = np.diff(kept)
    assert gaps.size == 0 or gaps.max() - gaps.min() <= 1
