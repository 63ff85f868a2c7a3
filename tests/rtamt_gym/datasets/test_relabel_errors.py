"""Errors of `relabel`, with a fix."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rtamt.errors import InputError, InputTypeError, SpecificationError
from rtamt_gym import relabel

X = {"x": "obs[0]"}


def episode(steps: int = 2, **changes: Any) -> dict[str, Any]:  # noqa: ANN401
    made: dict[str, Any] = {
        "observations": np.ones((steps + 1, 2)),
        "actions": np.zeros((steps, 1)),
        "rewards": np.ones(steps),
        "terminations": np.zeros(steps, bool),
        "truncations": np.arange(steps) == steps - 1,
        "infos": {"speed": np.ones(steps + 1)},
    }
    made |= changes
    return {key: value for key, value in made.items() if value is not None}


def message(given: Any, spec: Any = "always(x > 0)", signals: Any = None, **options: Any) -> str:  # noqa: ANN401
    """Return the message and the notes of the error."""
    with pytest.raises(InputError) as error:
        relabel(given, spec, X if signals is None else signals, **options)
    return "\n".join([str(error.value), *getattr(error.value, "__notes__", [])])


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"terminations": None, "terminals": np.zeros(2)},
            (
                "episode 1 has no 'terminations'; its keys are 'observations', 'actions', "
                "'rewards', 'truncations', 'infos', 'terminals'; did you mean 'terminals'?"
            ),
        ),
        (
            {"observations": np.ones((2, 2))},
            "episode 1: expected 3 observations for 2 rewards, the first from the reset, got 2",
        ),
        (
            {"observations": {"a": np.ones((3, 2)), "b": np.ones((4, 2))}},
            "episode 1: expected 3 observations for 2 rewards, the first from the reset, got 4",
        ),
        ({"actions": np.ones((3, 1))}, "episode 1: expected 2 actions for 2 rewards, got 3"),
        (
            {"terminations": np.array([True, False])},
            "episode 1 ends at step 0 and has 2 steps; split it there",
        ),
        (
            {
                "observations": np.ones((1, 2)),
                **dict.fromkeys(("actions", "rewards", "terminations", "truncations"), np.zeros(0)),
            },
            "episode 1 has no steps; remove it",
        ),
    ],
)
def test_an_episode_that_is_not_whole_is_refused(changes: dict[str, Any], expected: str) -> None:
    assert message([episode(), episode(**changes)]) == expected


def test_what_is_no_episode_is_refused() -> None:
    with pytest.raises(InputTypeError) as error:
        relabel([3], "always(x > 0)", X)
    assert str(error.value) == (
        "expected episode 0 as Minari's EpisodeData, or as a mapping with 'observations', "
        "'actions', 'rewards', 'terminations', 'truncations', got int"
    )
    with pytest.raises(InputTypeError) as one:
        relabel(episode(), "always(x > 0)", X)
    assert str(one.value) == ("expected a dataset of Minari or an iterable of episodes, got dict")
    with pytest.raises(InputTypeError) as infos:
        relabel([episode(infos=[{"speed": 1.0}] * 3)], "always(x > 0)", X)
    assert str(infos.value) == (
        "episode 0: expected infos as a mapping from keys to arrays, got list"
    )
    assert relabel([SimpleNamespace(**episode())], "always(x > 0)", X)[0].satisfied


def test_missing_signal_error() -> None:
    speed = {"x": ("info['sped']", 0.0)}
    assert message([episode()], signals=speed) == (
        "signal 'x': the infos have no info['sped']; their keys are 'speed'\nin episode 0"
    )
    assert message([episode(infos=None)], signals=speed) == (
        "signal 'x': the infos have no info['sped']; their keys are none\nin episode 0"
    )
    other = episode(infos={"speed": np.ones(9)})
    with pytest.raises(InputTypeError) as length:
        relabel([episode(), other], "always(x > 0)", {"x": ("info['speed']", 0.0)})
    assert str(length.value) == (
        "signal 'x': expected 2 numbers from info['speed'], one for every environment, got shape "
        "(9,) and dtype float64"
    )
    flat = episode(observations=np.ones(3))
    assert message([episode(), flat]) == (
        "expected observations and actions of one form in all episodes, got others than in the "
        "first: IndexError: too many indices for array: array is 1-dimensional, but 2 were indexed"
        "\nin episode 1"
    )
    assert message([episode()], signals={"x": "obs[4]"}) == (
        "signal 'x': obs[4] does not fit: the observation space of one environment has 2 elements "
        "there, 0 to 1; it is Box(shape=(2,), dtype=float64)"
    )
    assert message([episode()], signals={"x": "qpos[0]"}) == (
        "signal 'x', column 1: expected one of obs, action, reward, info, got 'qpos'\n"
        "  qpos[0]\n  ^\n  hint: write obs[2], obs['key'][0], action[0], reward or info['key']"
    )
    assert message([episode()], signals={"y": "obs[0]"}) == (
        "variable 'x' has no signal; the signals are 'y'; pass signals={\"x\": \"obs[INDEX]\"}"
        ", or declare a constant: const float x = VALUE"
    )
    assert message([episode()], signals={"x": lambda step: step.obs[9]}).startswith(
        "signal 'x': test_missing_signal_error.<locals>."
        "<lambda> raised IndexError: index 9 is out of bounds"
    )


def test_nan_names_episode_signal_and_sample() -> None:
    late, first = episode(4), episode(4)
    late["observations"][3, 0] = first["observations"][0, 0] = np.nan
    assert message([episode(), late]) == (
        "signal 'x' is nan at sample 3; nan='hold' keeps the last value\nin episode 1"
    )
    for nan in ("raise", "hold"):
        assert message([first], nan=nan) == (
            "signal 'x' is nan at sample 0; nan='hold' keeps the last value, and the first sample "
            "has none\nin episode 0"
        )
    assert len(relabel([late], "always(x > 0)", X, nan="hold")) == 1


def test_wrong_option_error() -> None:
    for name, nearest in (("on_violation", ""), ("weigth", "; did you mean 'weight'?")):
        with pytest.raises(InputTypeError) as error:
            relabel([episode()], "always(x > 0)", X, mode="add", **{name: 1})  # type: ignore[call-overload]
        assert str(error.value) == (
            f"relabel() has no option {name!r}; the options are 'period', 'view', 'nan', "
            "'align', 'semantics', 'inputs', 'outputs', 'at_termination', 'at_truncation', "
            "'stages', 'weight', 'clip', 'gamma', 'temperature', 'weights', 'priorities', "
            f"'bonus', 'penalty', 'details', 'cost'{nearest}"
        )
    assert message([episode()], weight=2.0) == (
        'weight= belongs to shaped rewards; pass a mode, such as mode="add"'
    )
    assert message([episode()], keep="best") == (
        'expected keep="all", "satisfied" or a function of an episode, got \'best\''
    )
    assert message([episode()], mode="sum").startswith("expected mode='add', 'replace', ")


def test_a_bound_needs_a_period() -> None:
    with pytest.raises(SpecificationError) as error:
        relabel([episode()], "eventually[0:1](x > 0)", X)
    assert str(error.value) == (
        "specification 'spec' has bounds in time, but the dataset does not state the duration of a "
        "step: it names no environment; give period= in seconds, or period=1 if every bound counts "
        "steps"
    )
