"""`RobustnessOverlay` draws the state of the monitors, and changes nothing else."""

from __future__ import annotations

import copy
import math
import pickle
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, equal, rollout
from gymnasium.wrappers import RenderCollection
from painted import Painted, Picture, numbers
from replay import X

from rtamt_gym import RobustnessOverlay, StlMonitor, StlReward
from rtamt_gym.wrappers.overlay import Gauge, OverlayPanel, PanelPlace, Sight

VALUES = [3.0, 2.0, 4.0, 0.5, 3.0, 3.0]
SPECS = {"high": "always(x > 1)", "rises": "eventually[0:2](x > 3)"}


def made(env: gym.Env[Any, Any], **options: Any) -> RobustnessOverlay[Any, Any]:
    monitored = StlMonitor(env, SPECS, X, period=0.5, on_violation="report")
    return RobustnessOverlay(monitored, **options)


def frames(env: gym.Env[Any, Any]) -> list[Picture]:
    """Return the frames of an episode, rendered one by one."""
    env.reset(seed=0)
    shown: list[Any] = [env.render()]
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = env.step(np.zeros(1))
        ended = terminated or truncated
        shown.append(env.render())
    return shown


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("case", CASES[:1] + CASES[-2:-1], ids=lambda case: case.env_id)
def test_an_episode_is_the_same_with_an_overlay(case: Any) -> None:
    def monitored() -> gym.Env[Any, Any]:
        env = gym.make(case.env_id, render_mode="rgb_array")
        return StlMonitor(env, case.specs, case.signals, on_violation="report", details=True)

    assert equal(rollout(RobustnessOverlay(monitored())), rollout(monitored()))


@pytest.mark.parametrize("size", [(40, 320), (41, 320), (150, 600), (480, 480), (210, 160)])
def test_the_panel_stands_below_the_picture_and_the_height_is_even(size: tuple[int, int]) -> None:
    env = made(Painted(VALUES, size=size))
    for bare, drawn in zip(frames(Painted(VALUES, size=size)), frames(env), strict=True):
        assert drawn.shape[1:] == bare.shape[1:]
        assert drawn.shape[0] > bare.shape[0]
        assert drawn.shape[0] % 2 == 0
        assert np.array_equal(drawn[: size[0]], bare)


@pytest.mark.parametrize("size", [(40, 320), (150, 600), (480, 480)])
def test_the_panel_over_a_picture_keeps_its_size_and_what_is_above(size: tuple[int, int]) -> None:
    env = made(Painted(VALUES, size=size), place="over")
    for bare, drawn in zip(frames(Painted(VALUES, size=size)), frames(env), strict=True):
        assert drawn.shape == bare.shape
        changed = np.flatnonzero((drawn != bare).any(axis=(1, 2)))
        assert changed[-1] == size[0] - 1
        assert size[0] < 100 or changed[0] > size[0] // 4


def test_the_picture_of_the_environment_is_not_drawn_on() -> None:
    canvas = np.zeros((100, 320, 3), np.uint8)

    class Kept(Painted):
        def render(self) -> Any:
            return canvas

    frames(made(Kept(VALUES), place="over"))
    assert not canvas.any()


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("place", ["below", "over"])
@pytest.mark.parametrize("pop", [True, False])
@pytest.mark.parametrize("clean", [True, False])
def test_every_frame_of_a_list_shows_its_own_sample(
    place: PanelPlace,
    pop: bool,  # noqa: FBT001 - a case
    clean: bool,  # noqa: FBT001 - a case
) -> None:
    first = frames(made(Painted(VALUES), place=place))
    # The scales of the bars only grow, so from the second episode on they are at their end.
    env = made(Painted(VALUES), place=place)
    expected = [frames(env), frames(env)]
    assert all(map(np.array_equal, first, expected[0]))

    inside = RenderCollection(Painted(VALUES), pop_frames=pop, reset_clean=clean)
    env = made(inside, place=place)
    assert env.render_mode == "rgb_array_list"
    for episode in range(2):
        env.reset(seed=0)
        shown: list[Picture] = []
        for step in range(5):
            env.step(np.zeros(1))
            if step in {1, 4}:
                shown = shown + env.render() if pop else env.render()
        wanted = (
            expected[0] + expected[1] if not pop and not clean and episode else expected[episode]
        )
        assert numbers(shown) == numbers(wanted)
        assert all(map(np.array_equal, shown, wanted))


@pytest.mark.parametrize("place", ["below", "over"])
def test_gymnasiums_collection_goes_around_it(place: PanelPlace) -> None:
    expected = frames(made(Painted(VALUES), place=place))
    env = RenderCollection(made(Painted(VALUES), place=place))
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.zeros(1))
    assert all(map(np.array_equal, env.render(), expected))


def test_it_is_made_again_from_its_specification_and_copied_mid_episode() -> None:
    env: Any = gym.make("CartPole-v1", render_mode="rgb_array")
    monitored = StlReward(env, "always(abs(a) < 0.1)", {"a": "obs[2]"}, mode="add")
    env = RobustnessOverlay(monitored, place="over", signals=["a"])
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(again, RobustnessOverlay)
    env.reset(seed=1)
    env.step(0)
    again.reset(seed=1)
    again.step(0)
    assert np.array_equal(env.render(), again.render())

    painted = made(Painted(VALUES))
    painted.reset()
    painted.step(np.zeros(1))
    copies = [copy.deepcopy(painted), pickle.loads(pickle.dumps(painted))]
    for item in [painted, *copies]:
        item.step(np.zeros(1))
    for item in copies:
        assert np.array_equal(item.render(), painted.render())


def test_a_callable_signal_is_called_once_a_sample() -> None:
    calls: list[float] = []

    def signal(step: Any) -> float:
        calls.append(float(step.obs[0]))
        return calls[-1]

    env = RobustnessOverlay(
        StlMonitor(Painted(VALUES), "always(x > 1)", {"x": signal}, on_violation="report")
    )
    frames(env)
    assert calls == VALUES


def test_the_monitor_tells_signals_as_it_reads_them() -> None:
    plain = StlMonitor(Painted(VALUES), SPECS, X, period=1, on_violation="report")
    recorded = StlMonitor(Painted(VALUES), SPECS, X, period=1, on_violation="report")
    newest = recorded.newest_signals()
    assert (newest, recorded.newest_signals() is newest) == ({}, True)
    assert equal(rollout(plain), rollout(recorded))
    assert newest == {"x": VALUES[-1]}


@pytest.mark.parametrize("value", [0.05, 0.4, 1.0, math.inf])
def test_a_bar_shows_sign_and_size_without_colour(value: float) -> None:
    def drawn(robustness: float) -> Picture:
        gauge = Gauge(robustness, -math.inf, math.inf, "UNDECIDED", 1.0)
        panel = OverlayPanel(["s"], [], 600, 100, "below")
        black = np.zeros((100, 600, 3), np.uint8)
        return panel.draw(black, [Sight(0, "", (gauge,), ())])[100:, :448]  # without the number

    zero, plus, minus = drawn(0.0), drawn(value), drawn(-value)
    right, left = (np.flatnonzero((item != zero).any(axis=(0, 2))) for item in (plus, minus))
    # The bars extend from the middle to opposite sides, equally far.
    assert abs(int(right.min()) - int(left.max())) <= 2
    assert abs(len(right) - len(left)) <= 3
    # A negative one is hatched: along it light and dark alternate.
    row = np.flatnonzero((plus != zero).any(axis=(1, 2)))[2]
    changes = [np.count_nonzero(np.diff(item[row].sum(axis=1))) for item in (plus, minus)]
    assert changes[1] - changes[0] >= 2 * (len(left) // 6)


def test_longer_bars_mean_more() -> None:
    panel = OverlayPanel(["s"], [], 600, 100, "below")
    black = np.zeros((100, 600, 3), np.uint8)
    heights = []
    for value in (0.1, 0.2, 0.5, 0.9):
        gauge = Gauge(value, -math.inf, math.inf, "UNDECIDED", 1.0)
        shown = panel.draw(black, [Sight(0, "", (gauge,), ())])[100:]
        green = (shown[..., 1].astype(int) - shown[..., 0] > 100).any(axis=0)
        heights.append(np.count_nonzero(green))
    assert all(more > less for less, more in pairwise(heights))
    assert heights[2] / heights[0] == pytest.approx(5.0, rel=0.1)


def test_a_long_name_keeps_its_two_ends_and_leaves_the_bar_its_place() -> None:
    def drawn(name: str) -> Picture:
        gauge = Gauge(0.5, -1.0, 1.0, "UNDECIDED", 1.0)
        panel = OverlayPanel([name], [], 600, 100, "below")
        black = np.zeros((100, 600, 3), np.uint8)
        return panel.draw(black, [Sight(0, "", (gauge,), ())])[100:]

    middle = "i" * 90
    shown = drawn(f"begin{middle}end")
    assert np.array_equal(drawn(f"begin{middle[:40]}W{middle[40:]}end"), shown)
    for other in (f"other{middle}end", f"begin{middle}one"):
        changed = np.flatnonzero((drawn(other) != shown).any(axis=(0, 2)))
        assert changed.size
        assert changed.max() < 0.35 * 600
    short = drawn("begin")[:, 210:]
    assert (short != shown[:, 210:]).any()  # a short name leaves more space for the bar


def test_signals_can_be_chosen() -> None:
    heights = [
        frames(made(Painted(VALUES), signals=signals))[0].shape[0] for signals in (None, ["x"], ())
    ]
    assert heights[0] == heights[1] > heights[2]
