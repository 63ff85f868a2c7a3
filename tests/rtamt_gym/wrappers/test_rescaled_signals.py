"""Inner wrappers that rescale observations are recognized; signals can be read below them."""

from __future__ import annotations

import copy
import functools
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import NormalizeObservation, RescaleObservation
from gymnasium.wrappers.vector import NormalizeObservation as NormalizeObservations
from gymnasium.wrappers.vector import RescaleObservation as RescaleObservations
from vector_environments import difference, sync, trajectory

from rtamt import InputError
from rtamt_gym import (
    Step,
    StlMonitor,
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
    evaluate_policy,
    simulate,
)
from rtamt_gym.wrappers import batched

pytestmark = [
    pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning"),
    pytest.mark.filterwarnings(  # the statistics of a NormalizeObservation continue
        "ignore::rtamt_gym.evaluation.replays.UnrepeatedSeedWarning"
    ),
]

SPEC = "always(abs(x) < 0.3)"
X: dict[str, Any] = {"x": "obs[0]"}


def pole() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=12)


def normalized() -> gym.Env[Any, Any]:
    return NormalizeObservation(pole())


def place(step: Step) -> float:
    return float(step.obs[0])


@pytest.mark.parametrize(
    ("signal", "reads"), [("obs[0]", "obs[0] reads"), (place, "place is given")]
)
def test_an_observation_that_was_rescaled_is_refused(signal: Any, reads: str) -> None:
    for run in (
        lambda: StlMonitor(normalized(), SPEC, {"x": signal}),
        lambda: simulate(normalized(), SPEC, {"x": signal}, policy=lambda _: 0),
        lambda: StlReward(
            gym.wrappers.TransformReward(normalized(), float), SPEC, {"x": signal}, mode="add"
        ),
    ):
        with pytest.raises(InputError) as caught:
            run()
        assert str(caught.value) == (
            f"signal 'x': {reads} observations that a NormalizeObservation inside the monitor "
            "has rescaled, so formulas would compare other numbers; pass below=True to read below "
            "it, rescaled=True to use the rescaled numbers, or put the monitor inside it"
        )


def test_an_evaluation_and_vectors_refuse_it_too() -> None:
    with pytest.raises(InputError, match="inside the monitor has rescaled"):
        evaluate_policy("zero", normalized(), SPEC, X, episodes=2)
    for envs, name in (
        (NormalizeObservations(sync([pole] * 2, AutoresetMode.NEXT_STEP)), "NormalizeObservation"),
        (RescaleObservations(_bounded(), np.float32(-1), np.float32(1)), "RescaleObservation"),
    ):
        with pytest.raises(InputError, match=f"observations that a {name} inside"):
            VectorStlMonitor(envs, "always(abs(x) < 9)", X)
        with pytest.raises(InputError, match=f"observations that a {name} inside"):
            VectorStlReward(envs, "always(abs(x) < 9)", X, mode="add")
    with pytest.raises(InputError, match="wrap each environment inside it with StlMonitor, or"):
        VectorStlMonitor(sync([normalized] * 2, AutoresetMode.NEXT_STEP), SPEC, X)


def _bounded() -> Any:
    return gym.make_vec("Pendulum-v1", 2, vectorization_mode="sync")


def test_what_reads_no_observation_is_not_refused() -> None:
    StlMonitor(normalized(), "always(r > 0)", {"r": ("reward", 1.0)}).reset()
    reacher = NormalizeObservation(gym.make("Reacher-v5"))
    StlMonitor(reacher, "always(x < 9)", {"x": "qpos[0]"}, substeps=True).reset()


def shown(env: Any, steps: int = 20) -> list[dict[str, Any]]:
    """Return the infos of a run without an effect of the monitor."""
    infos, ended = [env.reset(seed=3)[1]], False
    for step in range(steps):
        if ended:
            infos.append(env.reset()[1])
        *_, terminated, truncated, info = env.step(step % 2)
        ended = terminated or truncated
        infos.append(info)
    return infos


WRAPPED: list[Callable[[Any], Any]] = [
    NormalizeObservation,
    lambda env: gym.wrappers.TransformReward(NormalizeObservation(env), lambda r: 5 * float(r)),
    lambda env: NormalizeObservation(
        gym.wrappers.DtypeObservation(NormalizeObservation(env), np.float64)
    ),
]


@pytest.mark.parametrize("wrap", WRAPPED)
@pytest.mark.parametrize("signals", [X, {"x": place}], ids=["selector", "function"])
def test_below_reads_what_a_monitor_inside_would(
    wrap: Callable[[Any], Any], signals: dict[str, Any]
) -> None:
    options: dict[str, Any] = {"on_violation": "report", "details": True}
    outside = StlMonitor(wrap(pole()), SPEC, signals, below=True, **options)
    inside = wrap(StlMonitor(pole(), SPEC, signals, **options))
    assert difference(shown(outside), shown(inside)) == ""
    with pytest.raises(AssertionError):
        assert (
            difference(
                shown(StlMonitor(wrap(pole()), SPEC, signals, rescaled=True, **options)),
                shown(inside),
            )
            == ""
        )
    run = simulate(wrap(pole()), SPEC, signals, policy=lambda _: 0, seed=1, below=True, stop="end")
    bare = simulate(pole(), SPEC, signals, policy=lambda _: 0, seed=1, stop="end")
    assert run.signals["x"].tolist() == bare.signals["x"].tolist()
    own = simulate(outside, policy=lambda _: 0, seed=1, stop="end")
    assert own.signals["x"].tolist() == bare.signals["x"].tolist()
    assert own.reward == run.reward


@pytest.mark.parametrize("signals", [X, {"x": batched(lambda step: step.obs[:, 0])}, {"x": place}])
def test_many_environments_are_read_beneath_too(signals: dict[str, Any]) -> None:
    mode = AutoresetMode.NEXT_STEP  # Gymnasium's wrapper accepts no other
    below = VectorStlMonitor(
        NormalizeObservations(sync([pole] * 3, mode)), SPEC, signals, below=True
    )
    plain = VectorStlMonitor(sync([pole] * 3, mode), SPEC, signals)
    infos = [[row[-1] for row in trajectory(envs, 30)] for envs in (below, plain)]
    for left, right in zip(*infos, strict=True):
        for key in ("robustness", "stl_violated", "stl_period", "stl_violated_at"):
            assert (key in left) == (key in right)
            assert np.array_equal(left.get(key), right.get(key)), key
    result = [
        evaluate_policy("zero", envs, SPEC, signals, episodes=4, below=below)
        for envs, below in (
            (NormalizeObservations(sync([pole] * 2, mode)), True),
            (sync([pole] * 2, mode), False),
        )
    ]
    rows = [[row.outcomes["spec"].robustness for row in item.record] for item in result]
    assert rows[0] == rows[1]


def test_a_monitor_that_reads_beneath_is_made_again_copied_and_pickled() -> None:
    env = StlMonitor(NormalizeObservation(pole()), SPEC, X, below=True)
    assert env.spec is not None
    again = gym.make(env.spec)
    assert difference(shown(again), shown(env)) == ""
    env.reset(seed=1)
    env.step(0)
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert difference(other.step(1), copy.deepcopy(env).step(1)) == ""


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (
            pole,
            {"below": True},
            (
                "expected a wrapper that rescales observations, such as NormalizeObservation, for "
                "below=True, got none in "
            ),
        ),
        (
            normalized,
            {"below": True, "rescaled": True},
            (
                "below=True reads signals below the wrappers that rescale observations, and "
                "rescaled=True reads the rescaled values; omit one"
            ),
        ),
    ],
)
def test_options_that_do_not_fit_are_refused(
    make: Callable[[], Any], options: dict[str, Any], message: str
) -> None:
    for run in (
        lambda: StlMonitor(make(), SPEC, X, **options),
        lambda: simulate(make(), SPEC, X, policy=lambda _: 0, **options),
    ):
        with pytest.raises(InputError) as caught:
            run()
        assert str(caught.value).startswith(message)
    with pytest.raises(InputError, match="is for environments, which have wrappers, got"):
        simulate(lambda t: {"x": t}, SPEC, period=1, duration=2, below=True)
    StlMonitor(pole(), SPEC, X, rescaled=True)
    box = functools.partial(RescaleObservation, min_obs=np.float32(-1), max_obs=np.float32(1))
    with pytest.raises(InputError, match="a RescaleObservation inside the monitor"):
        StlMonitor(box(gym.make("Pendulum-v1")), SPEC, X)
