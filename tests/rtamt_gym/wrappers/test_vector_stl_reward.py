"""`VectorStlReward` pays and shows each environment what `StlReward` does, in every mode."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DtypeObservation
from replay import Replay, X, shaping_options
from vector_environments import MODES, Make, both, difference, native, sync, trajectory

from rtamt.errors import InputError
from rtamt_gym import StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.shaping import Mode

pytestmark = [
    pytest.mark.filterwarnings("ignore:clip=.* flattens the values of"),  # it is narrow here
    pytest.mark.filterwarnings("ignore:expected samples"),  # the period fits only the bounds
]

modes = pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)


SPECS = {"high": "always(x > 1)", "calm": "eventually[0:3](x + u > 3.5)"}
SIGNALS = {**X, "u": ("action[0]", 0.25)}


def compare(
    makes: Sequence[Make],
    autoreset: AutoresetMode,
    specs: Any,
    signals: dict[str, Any],
    **options: Any,
) -> str:
    """Return the difference between environments shaped together and one by one."""
    options = {"on_violation": "report", **options}
    together, singles = both(
        StlReward, VectorStlReward, makes, autoreset, specs, signals, **options
    )
    assert together.observation_space == singles.observation_space
    assert together.single_observation_space == singles.single_observation_space
    return difference(trajectory(together, 16), trajectory(singles, 16))


@pytest.mark.slow(keep=6)
@modes
@pytest.mark.parametrize("mode", ["potential", "terminal"])
@pytest.mark.parametrize("case", CASES[:2] + CASES[-1:], ids=lambda case: case.env_id[-12:])
def test_the_state_of_the_monitor_is_observed_as_in_single_environments(
    case: Any, mode: Mode, autoreset: AutoresetMode
) -> None:
    makes: list[Make] = [
        functools.partial(gym.make, case.env_id, max_episode_steps=n) for n in (5, 30)
    ]
    options: Any = {"mode": mode, "observe": "state", "period": 0.1}
    if "parking" in case.env_id:
        makes = [functools.partial(Still, make) for make in makes]
    assert compare(makes, autoreset, case.specs, case.signals, **options) == ""


class Still(gym.Wrapper[Any, Any, Any, Any]):
    """Removes the action in the info of highway-env's reset, which no seed repeats."""

    def __init__(self, make: Make) -> None:
        super().__init__(make())

    def reset(self, **options: Any) -> Any:
        return self.env.reset(**options)[0], {}


def test_rewards_rank_a_level_that_fails_by_no_margin_as_violated() -> None:
    specs = {"safe": "always(x > 0)", "calm": "always(x < 9)"}
    options: Any = {
        "clip": 10.0,
        "on_violation": "report",
        **shaping_options("hierarchical", *specs),
    }
    env = StlReward(Replay([1, 0.5, 0]), specs, X, **options)
    many = VectorStlReward(
        sync([lambda: Replay([1, 0.5, 0])] * 2, AutoresetMode.NEXT_STEP), specs, X, **options
    )
    env.reset(seed=1)
    many.reset(seed=1)
    action = np.zeros(1)
    rewards = [env.step(action)[1] for _ in range(2)]
    assert rewards == [10.0 + 8.0, 0.0]
    assert [many.step(np.zeros((2, 1)))[1].tolist() for _ in range(2)] == [[r] * 2 for r in rewards]


def test_a_smooth_minimum_is_that_of_single_environments() -> None:
    options: Any = {"mode": "replace", "temperature": 0.5, "period": 1}
    make = functools.partial(Replay, [3, 2, 4])
    single = StlReward(make(), SPECS, SIGNALS, **options)
    together = VectorStlReward(sync([make], AutoresetMode.NEXT_STEP), SPECS, SIGNALS, **options)
    single.reset()
    together.reset()
    for _ in range(2):
        expected = single.step(np.array([0.5]))[1]
        assert together.step(np.array([[0.5]]))[1] == pytest.approx(expected)


def test_a_pickle_continues_as_the_original() -> None:
    envs = VectorStlReward(
        native(3), "always(abs(a) < 0.2)", {"a": "obs[2]"}, mode="potential", observe="state"
    )
    trajectory(envs, 12)
    copy = pickle.loads(pickle.dumps(envs))
    actions = np.ones(3, np.int64)
    ahead = [envs.step(actions) for _ in range(9)]
    assert difference([copy.step(actions) for _ in range(9)], ahead) == ""


def test_a_monitor_that_is_there_is_used() -> None:
    monitored = VectorStlMonitor(native(3), "always(abs(a) < 0.2)", {"a": "obs[2]"})
    envs = VectorStlReward(DtypeObservation(monitored, np.float64), mode="replace")
    _, infos = envs.reset(seed=1)
    _, rewards, _, _, infos = envs.step(np.ones(3, np.int64))
    assert rewards.tolist() == infos["robustness"].tolist()
    assert infos["reward"].tolist() == [1.0, 1.0, 1.0]
    assert envs.samples.tolist() == [2, 2, 2]
    with pytest.raises(InputError) as caught:
        VectorStlReward(monitored, "always(x > 0)", mode="add", period=1)
    assert str(caught.value) == (
        "specs=, period= would describe a second monitor, but the environment has a "
        "VectorStlMonitor; give them to that one"
    )
