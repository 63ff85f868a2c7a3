"""A run of a case equals a loop written by hand: environments and functions."""

import math
import pickle
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import rtamt_envs  # noqa: F401 - registers scenarios
from driven_environments import Plant, Windy
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from input_cases import of_step, waveforms

from rtamt import InputError
from rtamt_gym import Case, Waveform, simulate
from rtamt_gym.results import Run

LOW = "always(abs(x) < 1e9)"


ENTRIES = {
    "left": waveforms(-2, 2) | st.floats(-2, 2),
    "right": waveforms(-2, 2),
    "gain": st.floats(-3, 3),
    "from": st.floats(0, 2) | st.just(math.inf),
}


@given(st.fixed_dictionaries({}, optional=ENTRIES), st.integers(0, 99))
def test_a_scenario_gets_options_and_actions_and_its_baseline_the_rest(
    case: dict[str, float | Waveform], seed: int
) -> None:
    run = simulate(Plant(), LOW, {"y": "obs[1]"}, case=case, seed=seed, duration=2, stop="end")
    env = Plant()
    options: dict[str, Any] = {name: case[name] for name in ("gain", "from") if name in case}
    obs, _ = env.reset(seed=seed, options=options)
    seen = [obs]
    for i in range(20):
        action = env.baseline(obs)
        for place, name in enumerate(env.action_names):
            if name in case:
                action[place] = of_step(case[name], i, 0.1)
        obs, *_ = env.step(action)
        seen.append(obs)
    assert np.array_equal(np.array([run.signals["x"], run.signals["y"]]).T, np.array(seen))
    assert run.case == Case(case)
    assert pickle.loads(pickle.dumps(run)) == run


def test_a_policy_gives_what_the_case_does_not_drive() -> None:
    env = Plant()
    case = {"right": Waveform([0, 0.2], [1, 2])}
    simulate(env, LOW, case=case, policy=lambda _: [0.5, 9.0], seed=0, duration=0.4)
    assert env.taken == [[0.5, 1.0], [0.5, 1.0], [0.5, 2.0], [0.5, 2.0]]


def test_a_baseline_acts_where_nobody_else_does() -> None:
    run = simulate(Plant(), LOW, seed=3, duration=1, stop="end")
    policy = Plant().baseline
    assert run == simulate(Plant(), LOW, seed=3, duration=1, stop="end", policy=policy)
    other = simulate(Plant(), LOW, seed=3, duration=1, stop="end", policy=lambda _: [1.0, 1.0])
    assert run != other
    scaled = gym.wrappers.RescaleAction(Plant(), np.float64(0), np.float64(1))
    with pytest.raises(InputError, match="needs a policy"):  # its actions are others
        simulate(scaled, LOW, seed=3, duration=1)


def test_a_scenario_runs_by_its_names() -> None:
    case = Case({"throttle": Waveform([0, 0.5], [100, 0]), "brake": 0.0, "drag": 0.05})
    env = gym.make("rtamt/AutomaticTransmission-v0")
    run = simulate(env, "always(speed < 120)", case=case, duration=1)
    obs, _ = env.reset(options={"drag": 0.05})
    speeds = [obs[0]]
    for i in range(100):
        obs, *_ = env.step(np.array([100.0 if i < 50 else 0.0, 0.0]))
        speeds.append(obs[0])
    assert run.signals["speed"].tolist() == speeds
    assert simulate(env, "always(speed < 120)", duration=1).signals["speed"].tolist() != speeds


@given(
    case=st.fixed_dictionaries(
        {}, optional={"env.g": st.floats(1, 20), "env.m": st.floats(0.5, 2)}
    ),
    torque=waveforms(-2, 2),
)
def test_an_action_by_its_place_and_attributes(case: dict[str, float], torque: Waveform) -> None:
    env = gym.make("Pendulum-v1")
    signals = {"x": "obs[2]", "u": ("action[0]", 0.0)}
    run = simulate(env, LOW, signals, case={**case, "action[0]": torque}, seed=1, duration=1)
    assert (vars(env.unwrapped)["g"], vars(env.unwrapped)["m"]) == (10.0, 1.0)
    simulation: Any = env.unwrapped
    for name, value in case.items():
        setattr(simulation, name.removeprefix("env."), value)
    env.reset(seed=1)
    seen, actions = [run.signals["x"][0]], [np.float32(0)]
    for i in range(20):
        actions.append(np.float32(of_step(torque, i, 0.05)))
        obs, *_ = env.step(np.array([actions[-1]]))
        seen.append(float(obs[2]))
    assert run.signals["x"].tolist() == seen
    assert run.signals["u"].tolist() == [float(action) for action in actions]


@given(waveforms(0, 1, whole=True))
def test_choices_are_driven_by_whole_numbers(push: Waveform) -> None:
    env = gym.make("CartPole-v1")
    run = simulate(
        env, LOW, {"x": "obs[2]", "u": ("action", 0)}, case={"action": push}, seed=0, duration=0.2
    )
    expected = [of_step(push, i, 0.02) for i in range(run.steps)]
    assert run.signals["u"][1:].tolist() == expected


def test_an_attribute_that_is_the_period_is_that_of_the_run() -> None:
    env = gym.make("CartPole-v1")
    case = {"env.tau": 0.05, "action": 1}
    run = simulate(env, "always[0:0.1](x < 9)", {"x": "obs[0]"}, case=case, seed=0)
    assert (run.period, vars(env.unwrapped)["tau"]) == (Fraction(1, 20), 0.02)


@pytest.mark.parametrize("push", [0.0, 2.0])
def test_attributes_are_as_before_after_a_run_and_after_an_error(push: float) -> None:
    env = Windy()
    case = {"env.wind": 7, "env.calm": 1, "env.sky.clouds": 0.25, "action[0]": push}
    try:
        simulate(env, LOW, {"x": "obs[0]"}, case=case, duration=2, period=1)
    except ZeroDivisionError:
        assert push == 2.0
    assert env.seen == [7, True, 0.25]
    assert [type(value) for value in env.seen] == [int, bool, float]
    assert (env.wind, env.calm, env.sky.clouds) == (3, False, 0.5)
    assert set(vars(env)) & {"wind", "calm", "clouds"} == set()
    assert vars(env.sky) == {}


@pytest.mark.parametrize(
    ("space", "case", "action"),
    [
        (spaces.Box(0.0, 1.0, (), np.float64), {"action": 0.5}, 0.5),
        (spaces.Box(0.0, 1.0, (1, 2), np.float32), {"action[0][0]": 0.25}, [[0.25, 0.5]]),
        (spaces.MultiDiscrete([3, 4], start=[1, 5]), {"action[0]": 3, "action[1]": 8}, [3, 8]),
        (spaces.MultiBinary(2), {"action[0]": 1, "action[1]": 0}, [1, 0]),
        (spaces.Discrete(2, start=5), {"action": 6}, 6),
    ],
)
def test_actions_of_every_form(
    space: spaces.Space[Any],
    case: dict[str, float],
    action: Any,  # noqa: ANN401
) -> None:
    taken: list[Any] = []

    class Taking(Windy):
        def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ANN401
            taken.append(action)
            return np.zeros(1), 0.0, False, False, {}

    env = Taking()
    env.action_space = space
    policy = (lambda _: np.full(space.shape or (), 0.5)) if len(case) < np.size(action) else None
    simulate(env, LOW, {"x": "obs[0]"}, case=case, policy=policy, duration=1, period=1)
    assert np.array_equal(taken[0], action)
    assert space.contains(taken[0])


@given(rate=st.floats(-5, 5), push=waveforms(-1, 1) | st.just(None))
def test_functions_get_keyword_arguments(rate: float, push: Waveform | None) -> None:
    case: dict[str, Any] = {"rate": rate} | ({} if push is None else {"push": push})

    def of_time(t: float, rate: float, push: Any = abs) -> Mapping[str, float]:  # noqa: ANN401
        return {"x": rate * t + push(t)}

    def of_steps(*, rate: float, push: Any = abs) -> Iterator[Mapping[str, float]]:  # noqa: ANN401
        for i in range(11):
            yield of_time(i * Fraction(1, 10), rate, push)  # type: ignore[arg-type]

    times = [float(i * Fraction(1, 10)) for i in range(11)]
    expected = [of_time(t, **case)["x"] for t in times]
    run = simulate(of_time, LOW, case=case, period=0.1, duration=1)
    assert (run.system, run.signals["x"].tolist()) == ("of_time", expected)
    run = simulate(of_steps, LOW, case=case, period=0.1)
    assert (run.system, run.ended, len(run.signals["x"])) == ("of_steps", "terminated", 11)
    anything = simulate(
        lambda t, **given: of_time(t, *given.values()), LOW, case=case, period=0.1, duration=1
    )
    assert anything.signals["x"].tolist() == expected


def test_a_run_is_saved_with_its_case(tmp_path: Any) -> None:  # noqa: ANN401
    case = Case({"left": Waveform([0], [1]), "right": 0.0, "from": math.inf})
    run = simulate(Plant(), LOW, case=case, duration=1, seed=0)
    run.save(tmp_path / "run.parquet")
    assert Run.load(tmp_path / "run.parquet") == run
    again = simulate(Plant(), LOW, case=run.case, duration=1, seed=0)
    assert again == run
    assert simulate(Plant(), LOW, case={**case, "right": 1}, duration=1, seed=0) != run


@pytest.mark.parametrize("substeps", [False, True])
def test_a_step_is_that_of_the_environment(substeps: bool) -> None:  # noqa: FBT001
    env = gym.make("InvertedPendulum-v5")
    drive = Waveform([0, 0.08], [0.5, -0.5])
    run = simulate(
        env,
        "always(abs(x) < 9)",
        {"x": "qpos[1]", "u": "ctrl[0]"},
        case={"action[0]": drive},
        seed=0,
        substeps=substeps,
        duration=0.16,
        stop="end",
    )
    item = 2 if substeps else 1
    assert run.signals["u"][1:].tolist() == [0.5] * 2 * item + [-0.5] * 2 * item
