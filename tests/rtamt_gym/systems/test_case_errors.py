"""Errors about names and values of cases: environments and functions."""

import math
from typing import Any

import gymnasium as gym
import pytest
from driven_environments import Plant, Windy

from rtamt import InputError
from rtamt_gym import Waveform, simulate

LOW = "always(abs(x) < 1e9)"

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
