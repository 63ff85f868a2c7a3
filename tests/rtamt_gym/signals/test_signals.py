"""Signals: every selector reads its value, and errors come at construction."""

from __future__ import annotations

import re
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import example, given
from hypothesis import strategies as st

from rtamt.errors import InputError
from rtamt_gym import Step
from rtamt_gym.signals.signals import ParsedSignal, Read, SignalLike, Source, parse_signals
from rtamt_gym.signals.sources import SOURCES


class Simulation(gym.Env[Any, Any]):
    """An environment of which only the spaces matter."""

    def __init__(
        self, observation: spaces.Space[Any], action: spaces.Space[Any] | None = None
    ) -> None:
        self.observation_space = observation
        self.action_space = action or spaces.Box(-1.0, 1.0, (2,))


VECTOR = spaces.Box(-1.0, 1.0, (4,))
GRID = spaces.Box(-1.0, 1.0, (2, 3))
NESTED = spaces.Dict(
    {
        "goal": VECTOR,
        "grid": GRID,
        "pair": spaces.Tuple((spaces.Discrete(5), GRID)),
        "word": spaces.Text(8),
    }
)

VECTOR_OBS = np.array([0.5, 1.5, 2.5, 3.5], np.float32)
GRID_OBS = np.array([[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]], np.float32)
NESTED_OBS = {"goal": VECTOR_OBS, "grid": GRID_OBS, "pair": (4, GRID_OBS), "word": "go"}
ACTION = np.array([-0.25, 0.75], np.float32)
INFO = {"speed": 25, "crashed": np.bool_(1), "rewards": {"lane": np.float32(0.5)}, "x": [1, 2]}


def read(
    value: SignalLike, env: gym.Env[Any, Any], obs: object, *, action: object = ACTION
) -> float:
    return ParsedSignal.parse("x", value, SOURCES).bind(env)(obs, action, -1.5, INFO)


@pytest.mark.parametrize(
    ("selector", "space", "obs", "expected"),
    [
        ("obs[2]", VECTOR, VECTOR_OBS, 2.5),
        ("obs[-1]", VECTOR, VECTOR_OBS, 3.5),
        (" obs [ 2 ] ", VECTOR, VECTOR_OBS, 2.5),
        ("obs[1][2]", GRID, GRID_OBS, 12.0),
        ("obs['goal'][1]", NESTED, NESTED_OBS, 1.5),
        ('obs["grid"][1][0]', NESTED, NESTED_OBS, 10.0),
        ("obs['pair'][0]", NESTED, NESTED_OBS, 4.0),
        ("obs['pair'][1][0][2]", NESTED, NESTED_OBS, 2.0),
        ("obs", spaces.Discrete(7), np.int64(6), 6.0),
        ("obs[1]", spaces.MultiDiscrete([3, 3]), np.array([0, 2]), 2.0),
        ("obs[0]", spaces.MultiBinary(2), np.array([1, 0], np.int8), 1.0),
        ("obs", spaces.Box(0.0, 1.0, ()), np.float32(0.5), 0.5),
    ],
)
def test_observation_selectors(
    selector: str, space: spaces.Space[Any], obs: object, expected: float
) -> None:
    value = read(selector, Simulation(space), obs)
    assert value == expected
    assert type(value) is float


@pytest.mark.parametrize(
    ("selector", "expected"),
    [
        ("action[1]", 0.75),
        ("reward", -1.5),
        ("info['speed']", 25.0),
        ("info['crashed']", 1.0),
        ("info['rewards']['lane']", 0.5),
        ("info['x'][1]", 2.0),
    ],
)
def test_default_at_reset(selector: str, expected: float) -> None:
    env = Simulation(VECTOR)
    signal = ParsedSignal.parse("x", (selector, 7), SOURCES)
    assert signal.bind_reset(env)(VECTOR_OBS, None, None, {}) == 7.0
    value = signal.bind(env)(VECTOR_OBS, ACTION, -1.5, INFO)
    assert value == expected
    assert type(value) is float


def test_discrete_action_needs_no_index() -> None:
    env = Simulation(VECTOR, spaces.Discrete(3))
    assert read(("action", 0), env, VECTOR_OBS, action=2) == 2.0


def test_pair_may_be_a_list() -> None:
    assert ParsedSignal.parse("x", ["action[0]", 0.5], SOURCES) == ParsedSignal.parse(
        "x", ("action[0]", 0.5), SOURCES
    )


def test_callable_gets_step() -> None:
    env = Simulation(VECTOR)
    seen: list[Step] = []

    def look(step: Step) -> float:
        seen.append(step)
        return 3.0

    assert read(look, env, VECTOR_OBS) == 3.0
    (step,) = seen
    assert step.obs is VECTOR_OBS
    assert step.action is ACTION
    assert step.reward == -1.5
    assert step.info is INFO
    assert step.env is env


def test_callable_with_default_at_reset() -> None:
    def fail(_: Step) -> float:
        raise AssertionError

    assert (
        ParsedSignal.parse("x", (fail, 2), SOURCES).bind_reset(Simulation(VECTOR))(
            0, None, None, {}
        )
        == 2.0
    )


def test_mujoco_selectors_read_state() -> None:
    env = gym.make("HalfCheetah-v5")
    env.reset(seed=1)
    env.step(env.action_space.sample())
    simulation: Any = env.unwrapped
    assert read("qpos[1]", env, None) == simulation.data.qpos[1]
    assert read("qvel[-1]", env, None) == simulation.data.qvel[-1]
    env.close()


def test_mujoco_selectors_follow_rebuilt_simulation() -> None:
    env = gym.make("InvertedPendulum-v5")
    simulation: Any = env.unwrapped
    position = ParsedSignal.parse("x", "qpos[0]", SOURCES).bind(env)
    simulation.model, simulation.data = simulation._initialize_simulation()
    simulation.data.qpos[0] = 0.125
    assert position(None, None, None, {}) == 0.125
    env.close()


def test_vehicle_selectors_follow_reset() -> None:
    env = gym.make("highway_env:parking-v0")
    signals = [
        ParsedSignal.parse("x", text, SOURCES).bind(env)
        for text in ("vehicle.speed", "vehicle.position[1]", "vehicle.crashed")
    ]
    simulation: Any = env.unwrapped
    seen = set()
    for seed in range(3):
        env.reset(seed=seed)
        env.action_space.seed(seed)
        env.step(env.action_space.sample())
        vehicle = simulation.vehicle
        expected = [vehicle.speed, float(vehicle.position[1]), float(vehicle.crashed)]
        assert [read(None, None, None, {}) for read in signals] == expected
        seen.add(id(vehicle))
    assert len(seen) > 1
    env.close()


def test_new_kind_of_selector() -> None:
    def bind(signal: ParsedSignal, env: gym.Env[Any, Any]) -> Read:
        depths = {"bow": 2.0, "stern": 3.0}
        return lambda *_: depths[str(signal.path[0])] + len(env.observation_space.shape or ())

    sources = SOURCES | {"sonar": Source(example="sonar['bow']", brackets="key", bind=bind)}
    signal = ParsedSignal.parse("x", "sonar['stern']", sources)
    assert signal.bind(Simulation(VECTOR))(VECTOR_OBS, None, None, {}) == 4.0
    with pytest.raises(InputError, match=re.escape("expected a key in quotes, sonar['bow']")):
        ParsedSignal.parse("x", "sonar", sources)


def test_order_of_signals() -> None:
    signals = parse_signals({"b": "obs[1]", "a": "obs[0]"}, ["a", "b", "a"], SOURCES)
    assert [signal.name for signal in signals] == ["a", "b"]


@given(st.text(alphabet="obsinfreward[]0123456789'\"kx -+.,:", max_size=20))
@example("obs[0][1]")
@example("info['a'][0]")
def test_any_text_parses_or_raises(text: str) -> None:
    default = () if not text.lstrip().startswith(("action", "reward", "info")) else (0.0,)
    try:
        signal = ParsedSignal.parse("x", (text, *default) if default else text, SOURCES)
    except InputError:
        return
    again = (str(signal), *default) if default else str(signal)
    assert ParsedSignal.parse("x", again, SOURCES) == signal
