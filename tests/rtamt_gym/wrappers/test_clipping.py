"""Warnings after ten episodes about a clip that flattens the reward or the observation."""

from __future__ import annotations

import functools
import math
import pickle
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit
from replay import Replay, X
from vector_environments import MODES, sync

from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward
from rtamt_gym.judging.end_warnings import UnseenEndWarning
from rtamt_gym.shaping import Shaping

ACTION = np.array([0.5])
OPTIONS: dict[str, Any] = {"mode": "add", "on_violation": "report", "at_termination": "complete"}


class Tour(Replay):
    """Replays another series in every episode, in turn."""

    def __init__(self, tour: Sequence[Sequence[float]], end: str = "terminated") -> None:
        super().__init__(tour[0], end)
        self.tour = tour
        self.turn = -1

    def reset(self, **options: Any) -> Any:
        self.turn = (self.turn + 1) % len(self.tour)
        self.values = self.tour[self.turn]
        return super().reset(**options)


def warned(act: Callable[[], object]) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", UnseenEndWarning)
        act()
    assert all(item.category is UserWarning for item in caught)
    return [str(item.message) for item in caught]


def play(env: gym.Env[Any, Any], episodes: int) -> list[list[dict[str, Any]]]:
    """Return the infos of complete episodes."""
    played = []
    for _ in range(episodes):
        infos = [env.reset(seed=1)[1]]
        ended = False
        while not ended:
            _, _, terminated, truncated, info = env.step(ACTION)
            infos.append(info)
            ended = terminated or truncated
        played.append(infos)
    return played


def gather(env: gym.Env[Any, Any], played: list[list[dict[str, Any]]]) -> None:
    played += play(env, 10)


def text(clip: float, clipped: int, seen: int, low: float, high: float) -> str:
    return (
        f"clip={clip:g} flattens the reward: at {clipped} of {seen} samples of the first episodes "
        f"the robustness that decides it was outside of [-{clip:g}, {clip:g}]; it ranged from "
        f"{low:.3g} to {high:.3g}; take a clip= about that range, such as "
        f"clip={max(-low, high):.3g}, or weights= that bring the robustness inside"
    )


def raised(clip: float, below: int, seen: int, low: float, high: float) -> str:
    message = text(clip, below, seen, low, high)
    outside = f"outside of [-{clip:g}, {clip:g}]"
    return message.replace(outside, f"below -{clip:g}, where no step towards satisfaction shows")


def shaped(env: gym.Env[Any, Any], specs: Any = "always(x > 0)", **options: Any) -> Any:
    return StlReward(env, specs, X, **{**OPTIONS, **options})


def test_a_clip_that_flattens_is_warned_of_at_the_end_of_the_tenth_episode() -> None:
    env = shaped(Replay([48, 30, 3.5, 0.5]), clip=3.5)
    assert warned(functools.partial(play, env, 9)) == []
    assert warned(functools.partial(play, env, 30)) == []  # half of the samples
    env = shaped(Replay([48, 30, 3.5]), clip=3.25)
    assert warned(functools.partial(play, env, 9)) == []
    env.reset()
    env.step(ACTION)
    with pytest.warns(UserWarning, match="^clip=3.25 flattens the reward") as caught:
        env.step(ACTION)
    assert str(caught[0].message) == text(3.25, 30, 30, 3.5, 48)
    assert caught[0].filename == __file__
    assert warned(functools.partial(play, env, 30)) == []


@pytest.mark.parametrize(("length", "flat"), [(10, []), (11, [text(1, 100, 110, 0.5, 2)])])
def test_nine_of_ten_samples_are_not_yet_too_many(length: int, flat: list[str]) -> None:
    env = shaped(Replay([2.0] * (length - 1) + [0.5]))
    assert warned(functools.partial(play, env, 10)) == flat


def test_long_episodes_are_counted_in_full() -> None:
    env = shaped(Replay([2.0] * 1102 + [0.5]))
    assert warned(functools.partial(play, env, 10)) == [text(1, 11020, 11030, 0.5, 2)]


@pytest.mark.parametrize(("last", "flat"), [(-0.5, []), (-2.0, [raised(1, 30, 40, -2, -1.0)])])
def test_half_of_the_samples_below_are_not_yet_too_many(last: float, flat: list[str]) -> None:
    env = shaped(Replay([-2.0, -2.0, last, -1.0]), "x > 0", view="step")
    assert warned(functools.partial(play, env, 10)) == flat


SPECS = {
    "near": "always(abs(x) < 2)",
    "there": "eventually(x > 0.5)",
    "kept": "x > -1 or eventually[0:2](x > 0)",
}
PRIORITIES = {"near": "target", "there": "comfort", "kept": "safety"}
WEIGHTS = {"near": 3.0, "kept": 0.5}


def decided(states: dict[str, Any], mode: str) -> float:
    """Return the deciding part of the reward of a sample, from the states of the specifications."""
    values = {name: WEIGHTS.get(name, 1.0) * states[name]["robustness"] for name in SPECS}
    if mode != "hierarchical":
        return float(min(values.values()))
    for name in ("kept", "near"):
        if math.copysign(1, values[name]) < 0:
            return float(values[name])
    return float(values["there"])


def expected(numbers: list[float], clip: float) -> list[str]:
    numbers = [number for number in numbers if math.isfinite(number)]
    clipped = sum(not -clip <= number <= clip for number in numbers)
    below = sum(number < -clip for number in numbers)
    if clipped * 10 <= len(numbers) * 9:
        figures = clip, below, len(numbers), min(numbers), max(numbers)
        return [raised(*figures)] if below * 2 > len(numbers) else []
    return [text(clip, clipped, len(numbers), min(numbers), max(numbers))]


def drawn(seed: int) -> list[list[float]]:
    rng = np.random.default_rng(seed)
    return [rng.normal(rng.normal(), 1.0, rng.integers(2, 9)).round(1).tolist() for _ in range(7)]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("mode", ["add", "potential", "terminal", "hierarchical"])
def test_the_figures_are_those_of_a_count_by_hand(mode: str) -> None:
    message = 0
    for seed in range(12):
        options: Any = {"mode": mode, "weights": WEIGHTS, "details": True, "period": 1}
        if mode == "hierarchical":
            options["priorities"] = PRIORITIES
        clip = 0.05 * (1 + seed % 4)
        env = shaped(Tour(drawn(seed)), SPECS, clip=clip, **options)
        played: list[list[dict[str, Any]]] = []
        result = warned(functools.partial(gather, env, played))
        samples = [infos[-1:] if mode == "terminal" else infos for infos in played]
        numbers = [decided(info["stl"], mode) for infos in samples for info in infos]
        assert result == expected(numbers, clip)
        message += len(result)
    assert 2 <= message <= 11


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("autoreset", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("mode", ["add", "terminal"])
def test_many_environments_are_watched_as_one(mode: str, autoreset: AutoresetMode) -> None:
    tours = [drawn(seed) for seed in range(3)]
    message = 0
    for num in (1, 3):
        for clip in (0.05, 0.1, 0.3):
            options: Any = {**OPTIONS, "mode": mode, "details": True, "period": 1, "clip": clip}
            options["weights"] = WEIGHTS
            makes = [functools.partial(Tour, tour) for tour in tours[:num]]
            envs = VectorStlReward(sync(makes, autoreset), SPECS, X, **options)
            numbers: list[float] = []
            result = warned(functools.partial(watch, envs, numbers, mode))
            assert result == expected(numbers, clip)
            if num == 1:
                alone = shaped(Tour(tours[0]), SPECS, **options)
                assert warned(functools.partial(play, alone, 10)) == result
            message += len(result)
    assert 0 < message < 6


def watch(envs: Any, numbers: list[float], mode: str) -> None:
    """Step until ten episodes have ended; list the deciding parts of the rewards."""
    num, episodes = envs.num_envs, 0

    def note(infos: dict[str, Any], entries: Any, *, last: bool) -> None:
        if last is (mode == "terminal"):
            for entry in np.flatnonzero(entries):
                states = {
                    name: {"robustness": infos["stl"][name]["robustness"][entry]} for name in SPECS
                }
                numbers.append(decided(states, mode))

    infos = envs.reset(seed=1)[1]
    note(infos, np.ones(num, bool), last=False)
    while True:
        _, _, terminated, truncated, infos = envs.step(np.full((num, 1), 0.5))
        ended = terminated | truncated
        episodes += int(ended.sum())
        same = envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
        final = infos["final_info"] if same and ended.any() else infos
        note(final, ended, last=False)
        note(final, ended, last=True)
        note(infos, ~ended, last=False)
        if episodes >= 10:
            return
        if same:
            note(infos, ended, last=False)
        elif ended.any() and envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            note(envs.reset(options={"reset_mask": ended})[1], ended, last=False)


def test_an_infinite_robustness_is_at_every_clip_and_does_not_count() -> None:
    # The window opens at sample 4: -inf before, 2 or less after.
    env = shaped(Replay([2.0] * 6), "eventually[4:9](x > 0)", period=1)
    assert warned(functools.partial(play, env, 10)) == [text(1, 20, 20, 2, 2)]
    env = shaped(Replay([2.0] * 3), "eventually[4:9](x > 0)", period=1)
    assert warned(functools.partial(play, env, 10)) == []
    env = shaped(Replay([2.0] * 6), semantics="boolean")
    assert warned(functools.partial(play, env, 10)) == []


def test_a_terminal_reward_is_judged_by_what_it_pays() -> None:
    flat_before, flat_at_end = [9.0, 9.0, 9.0, 0.5], [0.5, 0.4, 0.3, -9.0]
    for values, mode, result in [
        (flat_before * 9, "add", []),
        (flat_before, "terminal", []),
        (flat_at_end, "terminal", [text(1, 10, 10, -9, -9)]),
        (flat_at_end, "add", []),
    ]:
        env = shaped(Replay(values), mode=mode)
        assert warned(functools.partial(play, env, 10)) == result


def test_an_episode_that_a_time_limit_outside_cuts_is_an_episode() -> None:
    env = TimeLimit(shaped(Replay([9.0] * 99)), 5)
    assert warned(functools.partial(play, env, 10)) == []
    assert warned(env.reset) == [text(1, 60, 60, 9, 9)]
    assert warned(functools.partial(play, env, 20)) == []
    envs = VectorStlReward(
        sync([lambda: Replay([9.0] * 99)] * 2, AutoresetMode.DISABLED),
        "always(x > 0)",
        X,
        mode="add",
    )
    envs.reset()
    for _ in range(4):
        assert warned(envs.reset) == []
    assert warned(envs.reset) == [text(1, 10, 10, 9, 9)]


def test_a_copy_goes_on_counting() -> None:
    env = shaped(Replay([9.0] * 3))
    play(env, 4)
    env.reset()
    copy = pickle.loads(pickle.dumps(env))

    def go_on() -> None:
        for _ in range(2):
            copy.step(ACTION)
        play(copy, 5)

    assert warned(go_on) == [text(1, 30, 30, 9, 9)]


def test_after_the_tenth_episode_nothing_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    whole = Shaping.deciding

    def counting(shaping: Shaping, values: Any) -> Any:
        seen.extend(values[0])
        return whole(shaping, values)

    monkeypatch.setattr(Shaping, "deciding", counting)
    env = shaped(Replay([0.5] * 3))
    envs = VectorStlReward(
        sync([lambda: Replay([0.5] * 3)], AutoresetMode.NEXT_STEP), "always(x > 0)", X, **OPTIONS
    )
    play(env, 10)
    assert len(seen) == 30
    play(env, 5)
    envs.reset()
    for _ in range(29):
        envs.step(ACTION[None])
    assert len(seen) == 60
    for _ in range(9):
        envs.step(ACTION[None])
    assert len(seen) == 60


# ---- what is observed ----


OBSERVED = {"near": "always(x < 10)", "far": "eventually(x > 3)"}
VALUES = [0.5, 1.0, 8.5, 9.5, 2.0, 0.0]
"""Robustness of near: 9.5, 9, 1.5, 0.5, 0.5, 0.5; of far: -2.5, -2, 5.5, 6.5, 6.5, 6.5."""

SAYS = (
    "clip=1 flattens the values of observe='state': at 60 of 60 samples of the first episodes the "
    "robustness of 'far' was outside of [-1, 1], where the observation is the same; it ranged from "
    "-2.5 to 6.5; take a clip= about that range, such as clip=6.5"
)
WATCHES: dict[str, Any] = {
    "period": 1,
    "observe": "state",
    "on_violation": "report",
    "at_termination": "complete",
}


def observe(env: Any, episodes: int) -> list[str]:
    """Return the warnings of a number of episodes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(episodes):
            env.reset()
            for _ in VALUES[1:]:
                env.step(np.zeros(1))
    return [str(item.message) for item in caught]


def test_a_monitor_warns_once_at_the_end_of_the_tenth_episode() -> None:
    env = StlMonitor(Replay(VALUES), OBSERVED, X, **WATCHES)
    assert observe(env, 9) == []
    assert observe(env, 1) == [SAYS]
    assert observe(env, 30) == []


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"clip": 6.5}, []),
        ({"clip": 5.5}, []),  # at 30 of 60: not at most
        ({"observe": None}, []),
        (
            {"observe": "obligations", "clip": 2.25},
            ["clip=2.25 flattens the values of observe='obligat"],
        ),
    ],
)
def test_half_of_the_samples_is_not_most(options: dict[str, Any], says: list[str]) -> None:
    env = StlMonitor(Replay(VALUES), OBSERVED, X, **{**WATCHES, **options})
    message = observe(env, 12)
    assert len(message) == len(says)
    assert all(item.startswith(begin) for item, begin in zip(message, says, strict=True))


def test_a_reward_says_it_of_what_it_shows_unless_it_says_it_of_what_it_pays() -> None:
    env = StlReward(Replay(VALUES), OBSERVED, X, mode="terminal", clip=1.0, **WATCHES)
    assert observe(env, 12) == [SAYS]
    env = StlReward(Replay(VALUES), {"far": OBSERVED["far"]}, X, mode="add", clip=1.0, **WATCHES)
    (message,) = observe(env, 12)
    assert message.startswith("clip=1 flattens the reward")
    weighed = StlReward(
        Replay(VALUES), OBSERVED, X, mode="terminal", weights={"near": 0.1, "far": 0.1}, **WATCHES
    )
    assert observe(weighed, 12) == []


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize(
    "kind", [VectorStlMonitor, functools.partial(VectorStlReward, mode="terminal")]
)
def test_many_environments_count_together(mode: AutoresetMode, kind: Any) -> None:
    envs = kind(sync([functools.partial(Replay, VALUES)] * 2, mode), OBSERVED, X, **WATCHES)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        envs.reset()
        for _ in range(60):
            _, _, terminated, truncated, _ = envs.step(np.zeros((2, 1)))
            ended = terminated | truncated
            if mode is AutoresetMode.DISABLED and ended.any():
                envs.reset(options={"reset_mask": ended})
    (message,) = [str(item.message) for item in caught]
    assert message == SAYS
