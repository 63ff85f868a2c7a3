"""An evaluation keeps its evaluation options; `compare` refuses different ones."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from rtamt import InputError
from rtamt_gym import StlMonitor, VectorStlMonitor, compare, evaluate_policy
from rtamt_gym.results import Evaluation

SPECS = {"upright": "always(abs(angle) < 0.2)"}
SIGNALS = {"angle": "obs[2]"}
DEFAULT = {
    "view": "episode",
    "nan": "raise",
    "align": None,
    "semantics": "standard",
    "at_termination": "complete",
    "at_truncation": "cut",
    "below": False,
    "rescaled": False,
    "inputs": None,
    "outputs": None,
    "signals": {"angle": "obs[2]"},
}


def evaluation(env: Any = "CartPole-v1", **options: Any) -> Evaluation:  # noqa: ANN401
    chosen: dict[str, Any] = {"specs": SPECS, "signals": SIGNALS, "episodes": 2, "keep": 0}
    chosen |= {"at_termination": "complete"} | options
    return evaluate_policy("zero", env, chosen.pop("specs"), **chosen)


def cart() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1")


def carts() -> Any:  # noqa: ANN401
    return gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")


class Naming(gym.Wrapper[Any, Any, Any, Any]):
    """An environment with signals of its own."""

    signals = SIGNALS

    @property
    def unwrapped(self) -> Any:  # noqa: ANN401
        return self


@pytest.mark.parametrize(
    ("env", "options"),
    [
        ("CartPole-v1", {}),
        ("CartPole-v1", {"view": "episode", "nan": "raise", "at_truncation": "cut"}),
        ("CartPole-v1", {"signals": {**SIGNALS, "unread": "obs[0]"}}),
        (cart, {"signals": {"angle": "obs[+2]"}, "stop": "violation"}),
        (lambda: Naming(cart()), {"signals": None}),
        (carts, {}),
        (
            lambda: StlMonitor(cart(), SPECS, SIGNALS, at_termination="complete"),
            {"specs": None, "signals": None},
        ),
        (
            lambda: VectorStlMonitor(carts(), SPECS, SIGNALS, at_termination="complete"),
            {"specs": None, "signals": None},
        ),
    ],
)
def test_the_reading_is_the_same_however_it_was_said(env: Any, options: Any) -> None:  # noqa: ANN401
    found = evaluation(env, **options)
    assert found.evaluation_options == DEFAULT
    assert compare(found, replace(evaluation(), system=found.system)).seeds == (0, 1)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"at_termination": "failure"}, "at_termination= is 'complete' of A and 'failure' of B"),
        ({"at_truncation": "open"}, "at_truncation= is 'cut' of A and 'open' of B"),
        ({"view": "step"}, "view= is 'episode' of A and 'step' of B"),
        ({"nan": "hold"}, "nan= is 'raise' of A and 'hold' of B"),
        (
            {"semantics": "output-robustness", "outputs": ["angle"]},
            (
                "semantics= is 'standard' of A and 'output-robustness' of B, outputs= is None of A "
                "and ['angle'] of B"
            ),
        ),
        ({"signals": {"angle": "obs[3]"}}, "the signal angle is 'obs[2]' of A and 'obs[3]' of B"),
        (
            {"signals": {"angle": ("action", 0.5)}},
            "the signal angle is 'obs[2]' of A and 'action, 0.5 at reset' of B",
        ),
    ],
)
def test_episodes_that_were_read_differently_are_not_compared(
    options: Any,  # noqa: ANN401
    told: str,
    tmp_path: Path,
) -> None:
    evaluation(**options).save(tmp_path / "b.json")
    with pytest.raises(InputError) as refused:
        compare(evaluation(), Evaluation.load(tmp_path / "b.json"))
    assert str(refused.value) == (
        f"cannot compare, because evaluation options differ: {told}; evaluate both with the same"
    )


def test_what_is_not_known_may_be_the_same(tmp_path: Path) -> None:
    known = evaluation()
    function = evaluation(signals={"angle": lambda step: step.obs[2]})
    assert function.evaluation_options == {**DEFAULT, "signals": {"angle": None}}
    assert compare(known, function).seeds == compare(function, known).seeds == (0, 1)
    known.save(tmp_path / "e.json")
    assert Evaluation.load(tmp_path / "e.json") == known
    old = json.loads((tmp_path / "e.json").read_text())
    del old["reading"]
    (tmp_path / "old.json").write_text(json.dumps(old))
    loaded = Evaluation.load(tmp_path / "old.json")
    assert loaded.evaluation_options is None
    assert loaded != known
    other = evaluation(at_termination="failure")
    assert compare(loaded, other).seeds == compare(other, loaded).seeds == (0, 1)
