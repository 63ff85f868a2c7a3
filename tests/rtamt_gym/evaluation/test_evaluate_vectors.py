"""A vector environment plays the same episodes as its environments alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from walks import SIGNALS, SPECS, Model, Walk

from rtamt import InputError, StateError
from rtamt_gym import StlMonitor, VectorStlMonitor, VectorStlReward, evaluate_policy
from rtamt_gym.play.episodes import VectorEpisodes

MODES = list(AutoresetMode)


def vector(mode: AutoresetMode, num: int = 3, **options: Any) -> SyncVectorEnv:  # noqa: ANN401
    return SyncVectorEnv([lambda: Walk(**options)] * num, autoreset_mode=mode)


def plain(policy: Any = None, **options: Any) -> Any:  # noqa: ANN401
    chosen: Any = {"episodes": 11, "seed": 4, "at_termination": "complete"} | options
    return evaluate_policy(policy or Model(), Walk(), SPECS, SIGNALS, **chosen)


@pytest.mark.parametrize("stop", ["end", "violation", "decided", "known", "verdicts"])
@pytest.mark.parametrize("mode", MODES)
def test_rows_are_those_of_single_environments(mode: AutoresetMode, stop: Any) -> None:  # noqa: ANN401
    for policy in (Model(), "random", lambda obs: int(obs[0] < 0)):
        alone = plain(policy, stop=stop)
        found = evaluate_policy(
            policy,
            vector(mode),
            SPECS,
            SIGNALS,
            episodes=11,
            seed=4,
            stop=stop,
            at_termination="complete",
        )
        assert found.record.rows == alone.record.rows
        assert found.requirements["low"].worst == alone.requirements["low"].worst
        for name in SPECS:
            (run,), (expected,) = found.worst_runs[name], alone.worst_runs[name]
            assert run.histories == expected.histories
            assert np.array_equal(run.signals["x"], expected.signals["x"])


@pytest.mark.parametrize("mode", MODES)
def test_a_monitor_says_what_is_judged_and_shows_the_policy_its_state(mode: AutoresetMode) -> None:
    one = StlMonitor(Walk(), SPECS, SIGNALS, observe="state", at_termination="cut")
    seen: list[Any] = []

    def policy(obs: Any) -> int:  # noqa: ANN401
        seen.append(np.shape(obs))
        return int(obs[2] > 0.5)  # the robustness of the first requirement

    alone = evaluate_policy(policy, one, episodes=8)
    for made in (
        VectorStlMonitor(vector(mode), SPECS, SIGNALS, observe="state", at_termination="cut"),
        VectorStlReward(
            vector(mode), SPECS, SIGNALS, mode="replace", observe="state", at_termination="cut"
        ),
    ):
        found = evaluate_policy(policy, made, episodes=8)
        assert found.record.rows == alone.record.rows
    assert set(seen) == {(12,)}


def test_a_monitor_that_ends_episodes_ends_none_and_does_so_again_afterwards() -> None:
    env = VectorStlMonitor(
        vector(AutoresetMode.DISABLED),
        SPECS,
        SIGNALS,
        on_violation="terminate",
        at_termination="complete",
    )
    inside = env.env
    assert evaluate_policy(Model(), env, episodes=11, seed=4).record.rows == plain().record.rows
    assert env.env is inside
    env.reset(seed=4)
    ended = False
    while not ended:
        *_, terminated, _, infos = env.step(np.full(3, 2))
        ended = terminated.any()
    assert infos["stl_violated"][terminated].all()


@pytest.mark.parametrize("specs", [SPECS, None])
def test_monitors_inside_are_refused_for_they_might_end_episodes(specs: Any) -> None:  # noqa: ANN401
    envs = SyncVectorEnv([lambda: StlMonitor(Walk(), SPECS, SIGNALS)] * 3)
    with pytest.raises(InputError) as error:
        evaluate_policy("zero", envs, specs, SIGNALS, episodes=3)
    assert str(error.value) == (
        f"expected environments without monitors in {envs}, got some with; pass the function that "
        "makes one environment with n_envs=3, or put a VectorStlMonitor around all"
    )


@pytest.mark.parametrize("mode", MODES)
def test_an_episode_that_raises_has_its_error_in_its_row_and_the_others_none(
    mode: AutoresetMode,
) -> None:
    with pytest.warns(UserWarning, match="a cursed step"):
        found = evaluate_policy(
            Model(),
            vector(mode, cursed=6),
            SPECS,
            SIGNALS,
            episodes=11,
            seed=4,
            at_termination="complete",
        )
    expected = plain().record.rows
    for row, whole in zip(found.record, expected, strict=True):
        if row.seed == 6:
            assert row.error == "ValueError: a cursed step"
        else:
            assert row == whole
    assert found.requirements["low"].failed == 1


def test_short_episodes_do_not_come_more_often() -> None:
    # A successful episode is over after a step, a failed one after 12.
    class Coin(Walk):
        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
            _, info = super().reset(seed=seed, options=options)
            self._x = 5.0 if self._x > 0 else -0.5
            return self._shown(), info

        def step(self, _action: Any) -> Any:  # noqa: ANN401
            self._count += 1
            return self._shown(), 0.0, self._x > 0, self._count >= 12, {}

    rates = [
        evaluate_policy(
            "zero",
            env,
            "eventually(x > 1)",
            SIGNALS,
            episodes=40,
            at_termination="complete",
            at_truncation="complete",
        ).success.rate
        for env in (
            Coin(),
            *(SyncVectorEnv([Coin] * 4, autoreset_mode=mode) for mode in MODES),
        )
    ]
    assert len(set(rates)) == 1
    assert 0.3 < rates[0] < 0.7


def test_an_asynchronous_environment_is_a_vector_environment_too() -> None:
    env = AsyncVectorEnv([Walk] * 2)
    try:
        found = evaluate_policy(
            Model(), env, SPECS, SIGNALS, episodes=5, seed=4, at_termination="complete"
        )
    finally:
        env.close()
    assert found.record.rows == plain(episodes=5).record.rows


def test_what_a_vector_environment_cannot_do_is_told() -> None:
    native = gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="vector_entry_point")
    with pytest.raises(InputError) as refused:
        evaluate_policy("random", native, "always(x < 1)", SIGNALS)
    assert str(refused.value) == (
        "expected a vector environment that takes a seed for each of its environments, so that "
        f"every episode can be played again, got {native.unwrapped}, which takes one for all; "
        "give 'CartPole-v1' with n_envs=2, or gym.make_vec(..., vectorization_mode='sync')"
    )
    with pytest.raises(InputError) as refused:
        evaluate_policy("random", vector(AutoresetMode.DISABLED), SPECS, SIGNALS, n_envs=2)
    assert str(refused.value) == ("n_envs= comes from the vector environment, which has 3, got 2")
    with pytest.raises(InputError) as refused:
        evaluate_policy("baseline", vector(AutoresetMode.DISABLED), SPECS, SIGNALS)
    assert str(refused.value) == (
        "the policy baseline is for one environment; give the id of the environment with n_envs=3"
    )


def test_the_episodes_of_a_folder_are_not_played_again(tmp_path: Path) -> None:
    options: Any = {"episodes": 5, "seed": 4, "at_termination": "complete"}
    records = [
        evaluate_policy(
            Model(), vector(AutoresetMode.NEXT_STEP), SPECS, SIGNALS, folder=folder, **options
        ).record
        for folder in (tmp_path, tmp_path, None)
    ]
    assert records[0] == records[1] == records[2]


def test_an_episode_that_raises_when_it_is_played_again_is_told() -> None:
    episodes = VectorEpisodes(
        vector(AutoresetMode.DISABLED, cursed=6), SPECS, policy=Model(), signals=SIGNALS
    )
    assert episodes.simulate({}, 5).seed == 5
    with pytest.raises(StateError) as caught:
        episodes.simulate({}, 6)
    assert str(caught.value) == (
        "expected an episode as it was before, got ValueError: a cursed step"
    )


class Telling(Walk):
    """A walk with its place in the info too."""

    def reset(self, **options: Any) -> Any:  # noqa: ANN401
        obs, _ = super().reset(**options)
        return obs, {"x": self._x}

    def step(self, action: Any) -> Any:  # noqa: ANN401
        *others, _ = super().step(action)
        return *others, {"x": self._x}


@pytest.mark.parametrize("mode", MODES)
def test_infos_of_last_steps_are_those_of_the_episode(mode: AutoresetMode) -> None:
    signals = {name: "info['x']" if read == "obs[0]" else read for name, read in SIGNALS.items()}
    assert signals != SIGNALS
    alone = plain().record
    envs = SyncVectorEnv([Telling] * 3, autoreset_mode=mode)
    found = evaluate_policy(
        Model(), envs, SPECS, signals, episodes=11, seed=4, at_termination="complete"
    ).record
    for row, expected in zip(found, alone, strict=True):
        assert (row.ended, row.simulated) == (expected.ended, expected.simulated)
        for name in SPECS:
            assert row.outcomes[name].robustness == pytest.approx(
                expected.outcomes[name].robustness, abs=1e-5
            )
