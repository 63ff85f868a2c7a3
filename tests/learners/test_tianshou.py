"""Tianshou's collector reads the results of the wrappers; the program is an example."""

from typing import Any

import pytest
from programs import BOUND, Rides, run


@pytest.fixture(scope="module")
def program_and_rides(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Rides]:
    return run("Tianshou", tmp_path_factory.mktemp("program"))


def test_statistics_and_buffer_of_the_collector_are_those_of_a_hand_count(
    program_and_rides: tuple[dict[str, Any], Rides],
) -> None:
    program, rides = program_and_rides
    statistics = program["statistics"]
    ended = rides.ended(early=False)[-40:]
    assert list(statistics.successes) == [ride.success for ride in ended]
    assert list(statistics.costs) == [ride.outside for ride in ended]
    assert statistics.returns.tolist() == [ride.steps for ride in ended]
    assert 0 < sum(statistics.successes) < 40
    assert max(statistics.costs) > 1
    kept = program["training"].buffer.sample(0)[0]
    outside = abs(kept.obs_next[:, 0].astype(float)) >= BOUND
    assert kept.info.cost.tolist() == outside.astype(float).tolist()
    assert kept.info.is_success.sum() == sum(statistics.successes)
    assert not kept.info.is_success[~kept.done].any()


def test_a_buffer_with_texts_still_counts_as_one_with_nan(
    program_and_rides: tuple[dict[str, Any], Rides],
) -> None:
    from tianshou.data import Collector, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv

    program, _ = program_and_rides
    assert not program["training"].buffer.hasnull()
    envs = DummyVectorEnv([program["make_env"]])
    collector = Collector(program["algorithm"], envs, VectorReplayBuffer(100, 1))
    collector.reset()
    collector.collect(n_episode=2, random=True)
    assert collector.buffer.hasnull()
    envs.close()
