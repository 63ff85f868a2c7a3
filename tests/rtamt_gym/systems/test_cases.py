"""A run of a case equals a loop written by hand: environments and functions."""

from __future__ import annotations

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
    with pytest.raises(InputError, match="needs a policy"):  # it has other actions
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


LEFT, RIGHT = Waveform([0], [1]), Waveform([0, 1], [1, 3], "linear")

SCENARIO_ERRORS: list[tuple[dict[str, Any], str]] = [
    (
        {"lefft": LEFT},
        (
            "Plant takes no 'lefft' of a case; it takes 'left', 'right', 'gain', 'from'; "
            "did you mean 'left'?"
        ),
    ),
    ({"env.dt": 1}, "Plant takes no 'env.dt' of a case; it takes 'left', 'right', 'gain', 'from'"),
    (
        {"gain": RIGHT},
        (
            "expected 'gain' of the case as a number, which does not change during a run, got a "
            "waveform; waveforms drive 'left', 'right'"
        ),
    ),
    (
        {"right": RIGHT},
        (
            "expected 'right' of the case from -2 to 2, the bounds of the action, "
            "got values from 1 to 3"
        ),
    ),
    ({"left": -3}, "expected 'left' of the case from -2 to 2, the bounds of the action, got -3"),
    ({"left": math.inf}, "expected 'left' of the case as a waveform or a finite number, got inf"),
    ({"gain": math.nan}, "expected 'gain' of a case as a number, got nan"),
]


@pytest.mark.parametrize(("case", "message"), SCENARIO_ERRORS)
def test_a_scenario_says_what_it_takes(case: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(Plant(), LOW, case=case, duration=1)
    assert str(caught.value) == message


PUSH = {"action[0]": 0.0}

ENVIRONMENT_ERRORS: list[tuple[dict[str, Any], str]] = [
    (
        {"wind": 1, **PUSH},
        (
            "Windy takes no 'wind' of a case; it takes 'action[0]' and numbers of its attributes, "
            "such as 'env.gravity'; did you mean 'env.wind'?"
        ),
    ),
    ({"env.wnd": 1, **PUSH}, "Windy has no 'env.wnd'; did you mean 'env.wind'?"),
    ({"env.sky.cluds": 1, **PUSH}, "Windy has no 'env.sky.cluds'; did you mean 'env.sky.clouds'?"),
    ({"env.wind": 1.5, **PUSH}, "expected 'env.wind' of the case as a whole number, as 3, got 1.5"),
    (
        {"env.label": 1, **PUSH},
        "expected a number as 'env.label' of Windy, which a case can set, got str 'windy'",
    ),
    (
        {"env.wind": LEFT, **PUSH},
        (
            "expected 'env.wind' of the case as a number, which does not change during a run, got "
            "a waveform; waveforms drive 'action[0]'"
        ),
    ),
]


@pytest.mark.parametrize(("case", "message"), ENVIRONMENT_ERRORS)
def test_an_environment_says_what_it_takes(case: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(Windy(), LOW, {"x": "obs[0]"}, case=case, duration=1, period=1)
    assert str(caught.value) == message


def test_an_environment_whose_actions_are_no_numbers_takes_its_attributes_alone() -> None:
    env = Windy()
    env.action_space = gym.spaces.Tuple([gym.spaces.Discrete(2)])
    with pytest.raises(InputError) as caught:
        simulate(env, LOW, {"x": "obs[0]"}, case=PUSH, duration=1, period=1)
    assert str(caught.value) == (
        "Windy takes no 'action[0]' of a case; it takes numbers of its attributes, such as "
        "'env.gravity'"
    )


def test_what_cannot_be_set_or_is_set_by_the_reset_is_refused() -> None:
    env = Windy()

    def message(name: str) -> str:
        case = {**PUSH, name: 2.0}
        with pytest.raises(InputError) as caught:
            simulate(env, LOW, {"x": "obs[0]"}, case=case, duration=1, period=1)
        return str(caught.value)

    assert message("env.fixed").startswith("cannot set 'env.fixed' of Windy: ")
    assert message("env.drawn") == "Windy has no 'env.drawn'; its numbers are 'env.wind'"
    env.reset()
    assert message("env.drawn") == (
        "'env.drawn' of the case is 2.0, but the reset of Windy sets it to 0.5: it cannot be chosen"
    )
    assert env.drawn == 0.5


def test_a_scenario_that_ignores_its_options_is_refused() -> None:
    class Deaf(Plant):
        def reset(
            self,
            *,
            seed: int | None = None,
            options: dict[str, Any] | None = None,  # noqa: ARG002 - that is the point
        ) -> tuple[Any, dict[str, Any]]:
            return super().reset(seed=seed)

    with pytest.raises(InputError) as caught:
        simulate(Deaf(), LOW, case={"gain": 2}, duration=1)
    assert str(caught.value) == (
        "'gain' of the case is 2, but after the reset of Deaf with this option it is 1.0"
    )


def test_nobody_and_two_at_one_action_are_refused() -> None:
    env = Plant()
    env.baseline = None  # type: ignore[assignment, method-assign]  # an environment without one
    with pytest.raises(InputError) as caught:
        simulate(env, LOW, case={"left": LEFT}, duration=1)
    assert str(caught.value) == (
        "the case drives 'left' of Plant, and nothing drives 'right'; add them to the case, or "
        "give policy= for them"
    )
    with pytest.raises(InputError) as caught:
        simulate(env, LOW, case={"left": 1, "right": 1}, policy=lambda _: [0, 0], duration=1)
    assert str(caught.value) == (
        "the case drives all actions of Plant, 'left', 'right', and leaves no action to the "
        "policy; remove the policy, or an action from the case"
    )


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            Waveform([0, 1], [0, 1], "linear"),
            (
                "expected 'action' of the case as whole numbers with interpolation='hold', for the "
                "actions Discrete(2), got Waveform(times=(0.0, 1.0), values=(0.0, 1.0), "
                "interpolation='linear')"
            ),
        ),
        (2, "expected 'action' of the case from 0 to 1, the bounds of the action, got 2"),
    ],
)
def test_choices_are_whole_numbers_of_the_space(entry: float | Waveform, message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(gym.make("CartPole-v1"), LOW, {"x": "obs[0]"}, case={"action": entry})
    assert str(caught.value) == message


FUNCTION_ERRORS: list[tuple[Any, str]] = [
    (
        lambda t, mass: {"x": t * mass},
        "function takes no 'mas' of a case; it takes 'mass'; did you mean 'mass'?",
    ),
    (lambda t: {"x": t}, "function takes no 'mas' of a case; it takes no keyword arguments"),
    (
        [{"x": 1.0}],
        (
            "a sequence of samples takes no case; give a generator function with the keyword "
            "arguments 'mas'"
        ),
    ),
]


@pytest.mark.parametrize(("system", "message"), FUNCTION_ERRORS)
def test_a_function_says_what_it_takes(system: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(system, LOW, case={"mas": 1}, period=1, duration=1)
    assert str(caught.value) == message
