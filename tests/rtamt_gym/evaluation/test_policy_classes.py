"""A class of policies has a new object for each episode, with an empty memory."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from rtamt import InputError
from rtamt_gym import evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.systems.policies import policy_of

SPEC, SIGNALS = "always(abs(x) < 0.2)", {"x": "obs[0]"}

pytestmark = pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning")


class Alternating:
    """A policy that acts by its number of calls."""

    made = 0

    def __init__(self) -> None:
        type(self).made += 1
        self.asked = 0

    def __call__(self, _obs: Any) -> int:  # noqa: ANN401
        self.asked += 1
        return self.asked % 2


class Drawing:
    """A policy that draws its actions from the seed of the episode."""

    def __init__(self, seed: int = 0) -> None:
        self.random = random.Random(seed)

    def __call__(self, _obs: Any) -> int:  # noqa: ANN401
        return self.random.randrange(2)


class Needy:
    def __init__(self, gain: float, *, bias: float) -> None:
        self.gain, self.bias = gain, bias

    def __call__(self, _obs: Any) -> int:  # noqa: ANN401
        return 0


class Model:
    def predict(self, _obs: Any) -> Any:  # noqa: ANN401
        return 0, None


@pytest.mark.parametrize("n_envs", [1, 3])
def test_each_episode_has_its_own(n_envs: int) -> None:
    Alternating.made = 0
    found = evaluate_policy(
        Alternating,
        "CartPole-v1",
        SPEC,
        SIGNALS,
        episodes=4,
        n_envs=n_envs,
        keep=0,
        at_termination="complete",  # otherwise some episodes are repeated to explain their ends
    )
    assert Alternating.made == 4
    assert found.policy == "Alternating"
    alone = [
        evaluate_policy(Alternating(), "CartPole-v1", SPEC, SIGNALS, episodes=1, seed=i, keep=0)
        for i in range(4)
    ]
    assert [row.simulated for row in found.record] == [each.record[0].simulated for each in alone]


def test_one_that_takes_a_seed_has_that_of_the_episode() -> None:
    first, second = (
        evaluate_policy(Drawing, "CartPole-v1", SPEC, SIGNALS, episodes=3, seed=seed, keep=0)
        for seed in (5, 6)
    )
    lengths = [[row.simulated for row in each.record] for each in (first, second)]
    assert lengths[0][1:] == lengths[1][:2]
    named = evaluate_policy(
        Drawing, "CartPole-v1", SPEC, SIGNALS, episodes=1, keep=0, name="by chance"
    )
    assert named.policy == "by chance"


def test_the_command_takes_one_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "acting_of_mine.py").write_text(
        "class Mine:\n"
        "    def __init__(self):\n"
        "        self.asked = 0\n"
        "    def __call__(self, obs):\n"
        "        self.asked += 1\n"
        "        return self.asked % 2\n"
    )
    monkeypatch.chdir(tmp_path)
    arguments = ["evaluate", "CartPole-v1", "--policy", "acting_of_mine:Mine", "--episodes", "3"]
    arguments += ["--spec", SPEC, "--signal", "x=obs[0]", "--at-termination", "complete"]
    assert main(arguments) == 0
    assert "acting_of_mine:Mine" in capsys.readouterr().out
    assert main([*arguments, "--name", "the alternating one"]) == 0
    assert "the alternating one" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            Needy,
            (
                "the policy Needy: expected a class with a constructor without arguments, or with "
                "seed= only, got a constructor that needs 'gain', 'bias'; write a function in the "
                "module that constructs it and returns the action"
            ),
        ),
        (
            Model,
            (
                "the policy Model: expected a class with a method __call__(observation), got none; "
                "add __call__, which returns the action, or save a model and write sb3:FILE.zip"
            ),
        ),
    ],
)
def test_a_class_that_cannot_be_made_or_called_is_refused(kind: type, message: str) -> None:
    with pytest.raises(InputError) as caught:
        evaluate_policy(kind, "CartPole-v1", SPEC, SIGNALS, episodes=1)
    assert str(caught.value) == message
    with pytest.raises(InputError, match=r"^--policy fractions:Fraction: expected a class"):
        policy_of("fractions:Fraction", gym.make("CartPole-v1"))


def test_one_on_a_builtin_type_that_does_not_tell_its_arguments_is_one_too() -> None:
    class Counter(dict[str, int]):
        """A policy that acts by its number of calls."""

        def __call__(self, _obs: Any) -> int:  # noqa: ANN401
            self["asked"] = self.get("asked", 0) + 1
            return self["asked"] % 2

    counted, known = (
        evaluate_policy(
            kind, "CartPole-v1", SPEC, SIGNALS, episodes=2, keep=0, at_termination="complete"
        )
        for kind in (Counter, Alternating)
    )
    assert [row.simulated for row in counted.record] == [row.simulated for row in known.record]
