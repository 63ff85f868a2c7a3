"""PufferLib 2 below a vector monitor; the program is an example."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pufferlib.emulation
import pufferlib.vector
import pytest
from programs import run
from vector_environments import ANGLE, TEXT, difference, make_pole, sync

from rtamt_gym import StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.wrappers import SharedBuffers, as_vector_env

SAFE = "always(abs(theta) < 0.1)"
NEXT_STEP = gym.vector.AutoresetMode.NEXT_STEP


def emulated() -> Any:  # noqa: ANN401
    return pufferlib.emulation.GymnasiumPufferEnv(make_pole())


def make_rewarded_pole() -> gym.Env[Any, Any]:
    return StlReward(make_pole(), SAFE, ANGLE, mode="add")


def emulated_reward() -> Any:  # noqa: ANN401
    return pufferlib.emulation.GymnasiumPufferEnv(make_rewarded_pole())


def make(creator: Any, num: int, **options: Any) -> Any:  # noqa: ANN401
    options.setdefault("backend", pufferlib.vector.Serial)
    return pufferlib.vector.make(creator, num_envs=num, **options)


def actions(num: int, steps: int) -> Any:  # noqa: ANN401
    return np.random.default_rng(3).integers(0, 2, (steps, num))


def test_infos_are_those_of_gymnasiums_environments() -> None:
    envs, twin = (
        VectorStlMonitor(each, TEXT, ANGLE)
        for each in (make(emulated, 3), sync([make_pole] * 3, NEXT_STEP))
    )
    shown: Any = envs.reset(seed=7)
    expected: Any = twin.reset(seed=7)
    assert difference(list(shown), list(expected)) == ""
    for each in actions(3, 60):
        shown, expected = envs.step(each), twin.step(each)
        assert difference(shown[-1], expected[-1]) == ""
        assert all(np.array_equal(a, b) for a, b in zip(shown[:4], expected[:4], strict=True))
    assert len(envs.stl_episodes) > 5
    envs.close()


@pytest.mark.parametrize("backend", ["Serial", "Multiprocessing"])
def test_rewards_are_written_into_the_shared_array(backend: str) -> None:
    kind = getattr(pufferlib.vector, backend)
    more = {"num_workers": 1} if backend == "Multiprocessing" else {}
    shared = make(emulated, 3, backend=kind, **more)
    learner = SharedBuffers(VectorStlReward(shared, SAFE, ANGLE, mode="add"))
    twin = VectorStlReward(sync([make_pole] * 3, NEXT_STEP), SAFE, ANGLE, mode="add")
    twin.reset(seed=7)
    learner.async_reset(7)
    ends = 0
    for each in actions(3, 60):
        learner.send(each)
        obs, rewards, terminals, truncations, _, ids, masks = learner.recv()
        found = twin.step(each)
        assert np.shares_memory(obs, shared.buf.observations)
        assert np.shares_memory(rewards, shared.buf.rewards)
        assert np.array_equal(shared.buf.rewards.ravel(), found[1].astype(np.float32))
        assert np.array_equal(obs, found[0])
        assert np.array_equal(terminals, found[2])
        assert np.array_equal(truncations, found[3])
        assert (ids.tolist(), masks.tolist()) == ([0, 1, 2], [True] * 3)
        ends += int((found[2] | found[3]).sum())
    assert ends > 5
    learner.close()


def test_a_monitor_around_each_environment_ends_episodes_in_the_shared_arrays() -> None:
    shared, twin = make(emulated_reward, 3), sync([make_rewarded_pole] * 3, NEXT_STEP)
    shared.async_reset(7)
    shared.recv()
    twin.reset(seed=7)
    violated = 0
    for each in actions(3, 60):
        shared.send(each)
        obs, rewards, terminals, truncations, *_ = shared.recv()
        found = twin.step(each)
        assert np.array_equal(obs, found[0])
        assert np.array_equal(rewards, found[1].astype(np.float32))
        assert np.array_equal(terminals, found[2])
        assert np.array_equal(truncations, found[3])
        violated += int(np.sum(found[4]["stl_violated"]))
    assert violated > 5
    with pytest.raises(ValueError, match="StlMonitor around each of its environments"):
        VectorStlMonitor(shared, SAFE, ANGLE)


class Walkers(pufferlib.PufferEnv):  # type: ignore[misc]  # PufferLib is not annotated
    """A native environment: walkers on a line, reset in the step that takes them 3 from its middle.

    PufferLib's own environments in C do nothing in the wheel: their ``step`` is from the C library.
    """

    def __init__(self, num: int) -> None:
        self.single_observation_space = gym.spaces.Box(-9, 9, (2,), np.float32)
        self.single_action_space = gym.spaces.Discrete(3)
        self.num_agents = num
        super().__init__()
        self.shown: list[Any] = []

    def reset(self, seed: int | None = None) -> tuple[Any, list[Any]]:  # noqa: ARG002
        self.observations[:] = 0
        self.shown.append((self.observations.copy(), None, None))
        return self.observations, []

    def step(self, actions: Any) -> Any:  # noqa: ANN401
        self.observations[:, 0] += actions - 1
        self.observations[:, 1] += 1
        self.rewards[:] = -self.observations[:, 1] / 4
        self.terminals[:] = np.abs(self.observations[:, 0]) == 3
        self.observations[self.terminals] = 0
        copies = (each.copy() for each in (self.observations, self.rewards, self.terminals))
        self.shown.append(tuple(copies))
        return self.observations, self.rewards, self.terminals, self.truncations, []


def test_native_environments_hold_the_observation_before_the_last() -> None:
    native = Walkers(4)
    with pytest.raises(ValueError, match="final_obs='held'"):
        VectorStlMonitor(native, "always(paid > -2)", {"paid": ("reward", 0.0)})
    specs = {"paid": "always(paid > -2)", "left": "always(x > -1.5)"}
    signals: Any = {"paid": ("reward", 0.0), "x": "obs[0]"}
    held = as_vector_env(native, final_obs="held")
    envs = VectorStlMonitor(held, specs, signals, buffer_length=10_000)
    envs.reset(seed=1)
    for each in np.random.default_rng(1).integers(0, 3, (300, 4)):
        obs, rewards, terminals, *_ = envs.step(each)
        assert obs is native.observations
        assert rewards is native.rewards
        assert terminals is native.terminals
    samples: list[list[tuple[float, float]]] = [[(0.0, 0.0)] for _ in range(4)]
    expected = []
    for (before, *_), (obs, paid, ended) in zip(native.shown, native.shown[1:], strict=False):
        for entry in range(4):
            seen = before if ended[entry] else obs
            samples[entry].append((float(paid[entry]), float(seen[entry, 0])))
            if ended[entry]:
                least = [min(column) for column in zip(*samples[entry], strict=True)]
                expected.append((entry, least[0] + 2, least[1] + 1.5))
                samples[entry] = [(0.0, 0.0)]
    found = [
        (each["env"], *(spec["robustness"] for spec in each["specs"].values()))
        for each in envs.stl_episodes
    ]
    assert found == expected
    assert len(found) > 50
    assert len({each[1:] for each in found}) > 10


def test_the_loop_counts_what_a_hand_count_gives(tmp_path: Path) -> None:
    program, rides = run("PufferLib", tmp_path)
    steps = program["iterations"] * program["num_steps"] * program["num_envs"]
    ended = rides.ended(early=False)
    told = len(program["satisfied"])
    # Receive the result of the last send.
    assert len(ended) - program["num_envs"] <= told <= len(ended)
    assert program["satisfied"] == [float(ride.success) for ride in ended[:told]]
    assert program["robustness"] == pytest.approx([min(ride.margins) for ride in ended[:told]])
    assert rides.steps + told <= steps
    assert 0 < sum(program["satisfied"]) < told
