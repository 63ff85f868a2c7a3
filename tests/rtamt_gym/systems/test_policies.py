"""Policies by name: functions of modules, also in the working directory."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from rtamt import InputError
from rtamt_gym import simulate
from rtamt_gym.systems.policies import policy_of

EXPECTED = "--policy: expected random, zero, baseline, sb3:FILE.zip or module:function, got "

FILES = {
    "rtamt_driver.py": """\
import numpy as np

def act(obs):
    return int(obs[2] > 0)

def raises(obs):
    return lookup({}, obs)

def lookup(table, obs):
    return table["left"]

def outside(obs):
    return np.linalg.inv(np.zeros((2, 2)))

def word(obs):
    return "left"

def truth(obs):
    return obs[2] > 0

def no_argument():
    return 0

class Driver:
    def act(self, obs):
        return 1

    def predict(self, obs, deterministic):
        return 1, None

driver = Driver()

def refused(obs):
    from rtamt import InputError
    raise InputError("expected four numbers")
""",
    "rtamt_package/__init__.py": "",
    "rtamt_package/inner.py": "act = lambda obs: 1 if obs[3] > 0 else 0\n",
    "rtamt_needs.py": "import rtamt_absent\n",
    "rtamt_fails.py": "x = 0\ny = 1 / x\n",
    "rtamt_broken.py": "x = (\n",
}


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with modules, and undo their changes of the imports."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "modules", {**sys.modules})


def cart_pole() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1")


def refusal(text: str, env: gym.Env[Any, Any] | None = None) -> str:
    with pytest.raises(InputError) as refused:
        policy_of(text, env or cart_pole())(0)(np.array([0.0, 0.0, 1.0, 0.0]))
    return str(refused.value)


@pytest.mark.parametrize(
    ("text", "act"),
    [
        ("rtamt_driver:act", lambda obs: int(obs[2] > 0)),
        ("rtamt_driver:driver.act", lambda _obs: 1),
        ("rtamt_package.inner:act", lambda obs: int(obs[3] > 0)),
    ],
)
def test_a_function_of_a_module_in_the_working_directory_acts(
    text: str,
    act: Any,  # noqa: ANN401
) -> None:
    def run(policy: Any) -> Any:  # noqa: ANN401
        signals = {"angle": "obs[2]", "u": ("action", 0.0)}
        return simulate(cart_pole(), "always(abs(angle) < 0.2)", signals, policy=policy, seed=4)

    assert run(policy_of(text, cart_pole())(4)) == run(act)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("randm", f"{EXPECTED}'randm'; did you mean 'random'?"),
        *(
            (text, f"{EXPECTED}{text!r}; write rtamt_driver:FUNCTION for a function of a module")
            for text in ("rtamt_driver", "rtamt_driver:")
        ),
        *((text, f"{EXPECTED}{text!r}") for text in ("", ":", ":act", "sb3:", "sb3", "a b")),
        ("best.zip", f"{EXPECTED}'best.zip'; write sb3:best.zip"),
        (
            "src/rtamt_driver.py:act",
            (
                "--policy: expected module:function, got the name of a file; write "
                "src.rtamt_driver:act"
            ),
        ),
        (
            "/home/me/rtamt_driver.py:act",
            "--policy: expected module:function, got the name of a file; write rtamt_driver:act",
        ),
        (
            "rtamt_drive:act",
            (
                "cannot find the module 'rtamt_drive' in the working directory or on the search "
                "path of Python"
            ),
        ),
        (
            "rtamt_package.iner:act",
            (
                "cannot find the module 'rtamt_package.iner' in the working directory or on the "
                "search path of Python"
            ),
        ),
        (
            "rtamt_needs:act",
            "cannot import rtamt_needs: No module named 'rtamt_absent' (rtamt_needs.py, line 1)",
        ),
        (
            "rtamt_fails:act",
            (
                "cannot import rtamt_fails: ZeroDivisionError: division by zero "
                "(rtamt_fails.py, line 2)"
            ),
        ),
        (
            "rtamt_broken:act",
            (
                "cannot import rtamt_broken: SyntaxError: '(' was never closed "
                "(rtamt_broken.py, line 1)"
            ),
        ),
        ("rtamt_driver:acct", "the module rtamt_driver has no 'acct'; did you mean 'act'?"),
        (
            "rtamt_driver:Driver",
            (
                "--policy rtamt_driver:Driver: expected a class with a method "
                "__call__(observation), got none; add __call__, which returns the action, or save "
                "a model and write sb3:FILE.zip"
            ),
        ),
        (
            "rtamt_driver:__name__",
            (
                "--policy rtamt_driver:__name__: expected a function from observation to action, "
                "got 'rtamt_driver'"
            ),
        ),
        (
            "rtamt_driver:raises",
            "the policy rtamt_driver:raises raised KeyError: 'left' (rtamt_driver.py, line 10)",
        ),
        (
            "rtamt_driver:outside",
            (
                "the policy rtamt_driver:outside raised LinAlgError: Singular matrix "
                "(rtamt_driver.py, line 13)"
            ),
        ),
        (
            "rtamt_driver:no_argument",
            (
                "the policy rtamt_driver:no_argument raised TypeError: no_argument() takes 0 "
                "positional arguments but 1 was given; it is called with the observation"
            ),
        ),
        (
            "rtamt_driver:word",
            "the policy rtamt_driver:word gave 'left'; expected an action of Discrete(2)",
        ),
        (
            "rtamt_driver:truth",
            f"the policy rtamt_driver:truth gave {np.True_!r}; expected an action of Discrete(2)",
        ),
    ],
)
def test_what_is_no_policy_is_refused_with_the_way_out(text: str, message: str) -> None:
    assert refusal(text) == message


def test_a_model_of_a_module_is_refused_with_a_function_that_would_do() -> None:
    said = refusal("rtamt_driver:driver")
    assert said.startswith(
        "--policy rtamt_driver:driver: expected a function from observation to action, got "
        "<rtamt_driver.Driver object"
    )
    assert said.endswith(
        "; write a function that returns model.predict(obs, deterministic=True)[0]"
    )
    assert refusal("rtamt_driver:refused") == "expected four numbers"  # in its own words


def test_an_action_of_numbers_is_checked_by_its_shape_alone() -> None:
    env = gym.make("Pendulum-v1")
    assert refusal("rtamt_driver:act", env) == (
        "the policy rtamt_driver:act gave 1; expected an action of Box(shape=(1,), dtype=float32)"
    )
    Path("rtamt_list.py").write_text("def act(obs): return [99.0]\ndef word(obs): return ['a']\n")
    assert policy_of("rtamt_list:act", env)(0)(None) == [99.0]
    assert refusal("rtamt_list:word", env).startswith("the policy rtamt_list:word gave ['a']; ")


def test_random_actions_follow_the_seed_and_zero_is_an_action_of_every_space_of_numbers() -> None:
    env = gym.make("Pendulum-v1")
    draws = [
        [policy(None).item() for _ in range(3)]
        for policy in (policy_of("random", env)(seed) for seed in (1, 2, 1))
    ]
    assert draws[0] == draws[2] != draws[1]
    env.action_space = spaces.Box(np.float32(1), np.float32(2), (2,))
    assert policy_of("zero", env)(0)(None).tolist() == [1.0, 1.0]
    for space in (spaces.MultiDiscrete([3, 2]), spaces.MultiBinary(2)):
        env.action_space = space
        action = policy_of("zero", env)(0)(None)
        assert space.contains(action)
        assert action.tolist() == [0, 0]
    env.action_space = spaces.Text(3)
    assert refusal("zero", env).startswith("--policy zero: expected a space of numbers, got Text(")
