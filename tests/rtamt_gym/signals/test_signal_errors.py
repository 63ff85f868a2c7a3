"""A signal that cannot be read says so at once, with the place, what there is, and the way out."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from rtamt.errors import InputError, InputTypeError
from rtamt_gym.signals.signals import ParsedSignal, SignalLike, parse_signals
from rtamt_gym.signals.sources import SOURCES


class Simulation(gym.Env[Any, Any]):
    """An environment of which only the spaces matter."""

    def __init__(self, observation: spaces.Space[Any]) -> None:
        self.observation_space = observation
        self.action_space = spaces.Box(-1.0, 1.0, (2,))


VECTOR = spaces.Box(-1.0, 1.0, (4,))
GRID = spaces.Box(-1.0, 1.0, (2, 3))

UNFIT: list[tuple[SignalLike, spaces.Space[Any], str]] = [
    (
        "obs[4]",
        VECTOR,
        (
            "signal 'x': obs[4] does not fit: the observation space has 4 elements there, 0 to 3; "
            "it is Box(shape=(4,), dtype=float32)"
        ),
    ),
    (
        "obs[-5]",
        VECTOR,
        (
            "signal 'x': obs[-5] does not fit: the observation space has 4 elements there, 0 to 3; "
            "it is Box(shape=(4,), dtype=float32)"
        ),
    ),
    (
        "obs",
        VECTOR,
        (
            "signal 'x': obs does not fit: the observation space needs 1 index there; "
            "it is Box(shape=(4,), dtype=float32)"
        ),
    ),
    (
        "obs[0]",
        GRID,
        (
            "signal 'x': obs[0] does not fit: the observation space needs 2 indices there; "
            "it is Box(shape=(2, 3), dtype=float32)"
        ),
    ),
    (
        "obs[0]",
        spaces.Discrete(3),
        (
            "signal 'x': obs[0] does not fit: the observation space needs no indices there; "
            "it is Discrete(3)"
        ),
    ),
    (
        "obs['goal']['x']",
        spaces.Dict(goal=VECTOR),
        (
            "signal 'x': obs['goal']['x'] does not fit: the observation space has no key 'x'; "
            "it is Dict('goal': Box(shape=(4,), dtype=float32))"
        ),
    ),
    (
        "obs['gaol'][0]",
        spaces.Dict(goal=VECTOR),
        (
            "signal 'x': obs['gaol'][0] does not fit: the observation space has no key 'gaol'; "
            "it is Dict('goal': Box(shape=(4,), dtype=float32)); did you mean 'goal'?"
        ),
    ),
    (
        "obs[2]",
        spaces.Tuple((spaces.Discrete(2), VECTOR)),
        (
            "signal 'x': obs[2] does not fit: the observation space has 2 elements there, 0 to 1; "
            "it is Tuple(Discrete(2), Box(shape=(4,), dtype=float32))"
        ),
    ),
    (
        "obs['word']",
        spaces.Dict(goal=spaces.Discrete(2), word=spaces.Sequence(VECTOR)),
        (
            "signal 'x': obs['word'] does not fit: the observation space has no number there; "
            "it is Dict('goal': Discrete(2), 'word': Sequence(Box(-1.0, 1.0, (4,), float32), "
            "stack=False))"
        ),
    ),
    (
        ("action[2]", 0.0),
        VECTOR,
        (
            "signal 'x': action[2] does not fit: the action space has 2 elements there, 0 to 1; "
            "it is Box(shape=(2,), dtype=float32)"
        ),
    ),
    (
        "qpos[0]",
        VECTOR,
        (
            "signal 'x': qpos[0] needs a MuJoCo environment, and Simulation has no MjData as its "
            "data; read obs[...] instead"
        ),
    ),
]


@pytest.mark.parametrize(("value", "space", "message"), UNFIT)
def test_selector_outside_space_error(
    value: SignalLike, space: spaces.Space[Any], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        ParsedSignal.parse("x", value, SOURCES).bind(Simulation(space))
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("selector", "message"),
    [
        ("qpos[9]", "signal 'x': qpos[9] does not fit: qpos has 9 elements, 0 to 8"),
        ("qvel", "signal 'x': expected one index, qvel[0], got qvel"),
        ("qpos['a']", "signal 'x': expected one index, qpos[0], got qpos['a']"),
    ],
)
def test_mujoco_selector_outside_model_error(selector: str, message: str) -> None:
    env = gym.make("HalfCheetah-v5")
    with pytest.raises(InputError) as caught:
        ParsedSignal.parse("x", selector, SOURCES).bind(env)
    assert str(caught.value) == message
    env.close()


HINT = (
    "  hint: write obs[2], obs['key'][0], action[0], reward, info['key'], qpos[0], "
    "body:torso.xpos[2], sensor:imu[0] or vehicle.speed"
)
WORDS = f"expected one of {', '.join(SOURCES)}"


@pytest.mark.parametrize(
    ("selector", "column", "wrong"),
    [
        ("", 1, f"{WORDS}, got the end of the selector"),
        ("ob[2]", 1, f"{WORDS}, got 'ob'"),
        ("[2]", 1, f"{WORDS}, got '['"),
        ("__import__('os')", 1, f"{WORDS}, got '__import__'"),
        ("obs.x", 4, "expected '[' or the end of the selector, got '.'"),
        ("obs[x]", 5, "expected an index or a key in quotes, got 'x'"),
        ("obs[", 5, "expected an index or a key in quotes, got the end of the selector"),
        ("obs[1:2]", 6, "expected ']', got ':'"),
        ("obs[0, 1]", 6, "expected ']', got ','"),
        ("obs[2", 6, "expected ']', got the end of the selector"),
        ("obs[2] + 1", 8, "expected '[' or the end of the selector, got '+'"),
        ("reward.x", 7, "expected '[' or the end of the selector, got '.'"),
        ("info", 5, "expected a key in quotes, info['key'], got the end of the selector"),
        ("info[0]", 6, "expected a key in quotes, info['key'], got '0'"),
        ("info['a", 6, 'expected an index or a key in quotes, got "\'"'),
    ],
)
def test_selector_syntax_errors(selector: str, column: int, wrong: str) -> None:
    with pytest.raises(InputError) as caught:
        ParsedSignal.parse("x", selector, SOURCES)
    caret = " " * (column - 1) + "^"
    expected = f"signal 'x', column {column}: {wrong}\n  {selector}\n  {caret}\n{HINT}"
    assert str(caught.value) == expected


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (
            "action[0]",
            InputError,
            (
                "signal 'x': action[0] has no value at reset; give a first value, "
                '"x": ("action[0]", VALUE), or "x": ("action[0]", None) if it is unknown: '
                "then no always over it can be satisfied"
            ),
        ),
        (
            "reward",
            InputError,
            (
                "signal 'x': reward has no value at reset; give a first value, "
                '"x": ("reward", VALUE), or "x": ("reward", None) if it is unknown: then '
                "no always over it can be satisfied"
            ),
        ),
        (
            ("obs[0]", 0.0),
            InputError,
            (
                "signal 'x': obs[0] has a value at reset, which 0.0 would hide; "
                'write "x": "obs[0]"'
            ),
        ),
        (
            ("reward", math.nan),
            InputError,
            "signal 'x': expected a number as the value at reset, got nan",
        ),
        (
            ("reward", "0"),
            InputTypeError,
            "signal 'x': expected a number as the value at reset, got '0'",
        ),
        (
            3,
            InputTypeError,
            (
                "signal 'x': expected a selector, a callable, or a pair of a selector or callable "
                "and its value at reset, got 3; a selector is obs[2], obs['key'][0], action[0], "
                "reward, info['key'], qpos[0], body:torso.xpos[2], sensor:imu[0] or vehicle.speed"
            ),
        ),
    ],
)
def test_wrong_signal_error(value: SignalLike, error: type[Exception], message: str) -> None:
    with pytest.raises(error) as caught:
        ParsedSignal.parse("x", value, SOURCES)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("selector", "info", "error", "message"),
    [
        (
            "info['sped']",
            {"speed": 1.0, "crashed": False},
            InputError,
            (
                "signal 'x': the info has no info['sped']; its keys are 'speed', 'crashed'; "
                "did you mean 'speed'?"
            ),
        ),
        (
            "info['speed'][0]",
            {"speed": 1.0},
            InputError,
            "signal 'x': the info has no info['speed'][0]; it has 1.0 before 0",
        ),
        (
            "info['speed']",
            {"speed": np.array([0.5, 1.0])},
            InputTypeError,
            (
                "signal 'x': expected a number from info['speed'], got array([0.5, 1. ]); "
                "choose an element, info['speed'][0]"
            ),
        ),
        (
            "info['speed']",
            {"speed": None},
            InputTypeError,
            "signal 'x': expected a number from info['speed'], got None",
        ),
        (
            "info['speed']",
            {"speed": "0.5"},
            InputTypeError,
            "signal 'x': expected a number from info['speed'], got '0.5'",
        ),
    ],
)
def test_missing_info_key_error(
    selector: str, info: dict[str, Any], error: type[Exception], message: str
) -> None:
    bound = ParsedSignal.parse("x", (selector, 0.0), SOURCES).bind(Simulation(VECTOR))
    with pytest.raises(error) as caught:
        bound(None, None, 0.0, info)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("signals", "variables", "message"),
    [
        (
            {"thta": "obs[0]"},
            ["theta"],
            "variable 'theta' has no signal; the signals are 'thta'; did you mean 'thta'?",
        ),
        (
            {},
            ["theta"],
            (
                'variable \'theta\' has no signal; pass signals={"theta": "obs[INDEX]"}'
                ", or declare a constant: const float theta = VALUE"
            ),
        ),
        (
            {"x": "obs[0]", "theta": "obs[1]"},
            ["theta", "u"],
            (
                "variable 'u' has no signal; the signals are 'x', 'theta'; "
                'pass signals={"u": "obs[INDEX]"}'
                ", or declare a constant: const float u = VALUE"
            ),
        ),
    ],
)
def test_signals_and_variables_must_match(
    signals: dict[str, SignalLike], variables: list[str], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        parse_signals(signals, variables, SOURCES)
    assert str(caught.value) == message


def test_signals_must_be_a_mapping() -> None:
    with pytest.raises(InputTypeError) as caught:
        parse_signals("obs[0]", ["x"], SOURCES)  # type: ignore[arg-type]
    assert str(caught.value) == 'expected a mapping such as signals={"x": "obs[0]"}, got \'obs[0]\''
