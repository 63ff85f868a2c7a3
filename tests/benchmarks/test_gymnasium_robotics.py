"""Unmodified environments of gymnasium-robotics: their success flags, and repeatable seeds."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import gymnasium_robotics
import pytest

from rtamt_gym import compare, evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.success import readings

gym.register_envs(gymnasium_robotics)

Output = pytest.CaptureFixture[str]

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:gymnasium")


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("FetchReach-v4", "is_success"),
        ("HandReach-v3", "is_success"),
        ("AdroitHandDoor-v1", "success"),
    ],
)
def test_the_flag_of_an_environment_is_found(name: str, key: str, capsys: Output) -> None:
    command = f"evaluate gymnasium_robotics:{name} --policy random --success --episodes 2"
    assert main(command.split()) == 0
    out = capsys.readouterr().out
    assert all(f"success.{each}" in out for each in readings())
    assert ("is_success of the environment itself" in out) == (key == "is_success")


def test_last_is_what_fetch_calls_success() -> None:
    signals: Any = {"success": ("info['is_success']", 0.0)}
    env = gym.make("FetchReach-v4")
    found = evaluate_policy("zero", env, readings(hold=0.4), signals, episodes=30)
    own = [row.reported for row in found.record]
    last = [row.outcomes["last"].verdict > 0 for row in found.record]
    assert own == last
    assert found.reported == (own.count(True), 30)
    assert found.repeats is True
    assert len(compare("zero", "random", env, readings(hold=0.4), signals, episodes=3).seeds) == 3


def test_the_kitchen_has_no_flag_and_the_error_says_what_it_has(capsys: Output) -> None:
    command = "evaluate gymnasium_robotics:FrankaKitchen-v1 --policy random --success"
    assert main(command.split()) == 2
    assert "episode_task_completions" in capsys.readouterr().err
