"""RLlib's env runners read the results of the wrappers; the program is an example."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from programs import Rides, counts_of, run, shares_of, watched

# RLlib registers its environment again for the runners of evaluations.
pytestmark = pytest.mark.filterwarnings("ignore:.*Overriding environment rllib:UserWarning")


@pytest.fixture(scope="module")
def program_and_rides() -> Iterator[tuple[dict[str, Any], Rides]]:
    # Ray writes to the home and to a folder of its own, which needs a short path for sockets.
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", folder)
        patch.setenv("RAY_TMPDIR", folder)
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        yield run("RLlib", Path(folder))


def test_the_metrics_of_training_are_those_of_a_hand_count(
    program_and_rides: tuple[dict[str, Any], Rides],
) -> None:
    import ray

    program, rides = program_and_rides
    assert not ray.is_initialized()
    result, ended = program["result"], rides.ended(early=False)
    training = result["env_runners"]["num_episodes"]
    trained, evaluated = ended[:training], ended[training:]
    assert not {ride.env for ride in trained} & {ride.env for ride in evaluated}
    assert result["stl"] == pytest.approx({**shares_of(trained), **counts_of(trained)})
    assert result["evaluation"]["stl"] == pytest.approx(shares_of(evaluated))
    assert len(evaluated) == 20
    assert 0 < result["stl"]["satisfied"] < 1
    costs = [ride.outside for ride in trained]
    assert result["env_runners"]["cost"] == pytest.approx(sum(costs) / len(costs))


def test_the_infos_of_an_episode_are_those_of_the_wrapper(
    program_and_rides: tuple[dict[str, Any], Rides],
) -> None:
    from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
    from ray.tune.registry import register_env

    program, _ = program_and_rides
    register_env("monitored-cart", program["make_env"])
    with watched() as rides:
        runner = SingleAgentEnvRunner(config=program["config"])
        episodes: list[Any] = runner.sample(num_episodes=12, random_actions=True)
        runner.stop()
    ended = rides.ended(early=False)
    for episode, ride in zip(episodes, ended, strict=True):
        infos = episode.get_infos()
        assert [info["robustness"] for info in infos] == [
            min(ride.margins[: sample + 1]) for sample in range(ride.steps + 1)
        ]
        assert sum(info["cost"] for info in infos[1:]) == ride.outside
        assert "cost" not in infos[0]
        assert infos[-1]["is_success"] == ride.success
        assert not any("is_success" in info for info in infos[:-1])
