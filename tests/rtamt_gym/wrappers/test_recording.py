"""`RecordViolations` keeps violated episodes, and a ring of frames until then."""

from __future__ import annotations

import json
import math
import pickle
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import imageio_ffmpeg
import numpy as np
import pytest
from environments import equal, rollout
from gymnasium.utils import save_video
from hypothesis import given
from hypothesis import strategies as st
from painted import Painted, Picture, numbers
from replay import X

from rtamt.errors import InputError
from rtamt_gym import RecordViolations, RobustnessOverlay, StlMonitor

BAD = [3.0, 2.0, 4.0, 0.5, 3.0, 3.0, 3.0, 3.0]
GOOD = [3.0] * 8


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[int]]:
    """Return the numbers of the samples that would be written, by the name of the video."""
    shown: dict[str, list[int]] = {}

    def keep(frames: Sequence[Picture], folder: str, *_: object, **named: Any) -> None:
        *frames, last = frames  # the last one twice, see `RecordViolations`
        assert last is frames[-1]
        path = Path(folder) / f"{named['name_prefix']}-episode-{named['episode_index']}.mp4"
        shown[path.name] = numbers(frames)

    monkeypatch.setattr(save_video, "save_video", keep)
    return shown


def made(env: gym.Env[Any, Any], folder: Path, **options: Any) -> RecordViolations[Any, Any]:
    monitor = StlMonitor(
        env, {"x high": "always(x > 1)"}, X, period=0.5, on_violation="report", at_termination="cut"
    )
    return RecordViolations(monitor, str(folder), **options)


def run(env: gym.Env[Any, Any], steps: int = 7, seed: int | None = None) -> None:
    env.reset(seed=seed)
    for _ in range(steps):
        env.step(np.zeros(1))


def test_only_violated_episodes_are_kept(tmp_path: Path, written: dict[str, list[int]]) -> None:
    env = made(Painted(BAD), tmp_path)
    replay: Any = env.unwrapped
    for values in (GOOD, BAD, GOOD, GOOD, BAD):
        replay.values = values
        run(env, seed=5 if values is BAD else None)
    env.close()
    assert written == {
        "violation-seed-5-x_high-episode-1.mp4": list(range(6)),
        "violation-seed-5-x_high-episode-4.mp4": list(range(6)),
    }
    assert [path.name for path in env.videos] == list(written)


@given(
    values=st.lists(st.sampled_from([0.5, 3.0]), min_size=2, max_size=20),
    before=st.integers(0, 6),
    after=st.integers(0, 6),
    everything=st.booleans(),
    steps=st.integers(0, 19),
)
def test_the_ring_holds_the_frames_around_the_violation(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[float],
    before: int,
    after: int,
    everything: bool,  # noqa: FBT001 - a case
    steps: int,
) -> None:
    steps = min(steps, len(values) - 1)
    with pytest.MonkeyPatch.context() as patch:
        shown: list[int] = []
        patch.setattr(
            save_video, "save_video", lambda frames, *_, **__: shown.extend(numbers(frames[:-1]))
        )
        env = made(
            Painted(values),
            tmp_path_factory.mktemp("videos"),
            before=before / 2,
            after=after / 2,
            keep=(lambda _: True) if everything else "violation",
        )
        assert env.capacity == before + 1 + after
        run(env, steps)
        env.close()
    seen = values[: steps + 1]
    if 0.5 in seen:
        at = seen.index(0.5)
        wanted = [k for k in range(len(seen)) if at - before <= k <= at + after]
    else:
        wanted = list(range(len(seen)))[-env.capacity :] if everything else []
    assert shown == wanted
    assert not env._frames


def test_a_file_beside_the_video_says_what_happened(
    tmp_path: Path, written: dict[str, list[int]]
) -> None:
    env = made(Painted(BAD), tmp_path, before=1, after=0.5)
    run(env, 2, seed=3)
    run(env, 2)
    run(env)
    (path,) = env.videos
    assert path == tmp_path / "violation-seed-3-x_high-episode-2.mp4"
    assert written[path.name] == [1, 2, 3, 4]
    assert json.loads(path.with_suffix(".json").read_text()) == {
        "episode": 2,
        "seed": 3,
        "resets": 2,
        "violated_by": "x high",
        "violated_at": 1.5,
        "sample": 3,
        "robustness": {"x high": -0.5},
        "verdict": {"x high": "VIOLATED"},
        "ended": "terminated",
        "first_step": 1,
        "frames": 4,
        "fps": 2.0,
    }


@pytest.mark.parametrize(("ended", "steps"), [("reset", 4), ("closed", 4), ("truncated", 7)])
def test_an_episode_that_somebody_else_ends_is_judged_as_it_is(
    tmp_path: Path, written: dict[str, list[int]], ended: str, steps: int
) -> None:
    env = made(Painted(BAD, end="truncated"), tmp_path)
    run(env, steps, seed=0)
    if ended == "reset":
        env.reset()
    else:
        env.close()
    said = json.loads(env.videos[0].with_suffix(".json").read_text())
    assert (said["ended"], said["verdict"]) == (ended, {"x high": "VIOLATED"})
    assert written[env.videos[0].name] == list(range(min(steps, 5) + 1))


def test_any_function_of_the_last_info_keeps_episodes(
    tmp_path: Path, written: dict[str, list[int]]
) -> None:
    env = made(Painted(GOOD), tmp_path, keep=lambda info: info["robustness"] < 2.5)
    run(env)
    run(env)
    assert list(written) == ["violation-episode-0.mp4", "violation-episode-1.mp4"]
    said = json.loads(env.videos[0].with_suffix(".json").read_text())
    names = "seed", "violated_by", "violated_at", "sample"
    assert [said[name] for name in names] == [None] * 4


def test_infinite_robustness_is_strict_json(tmp_path: Path, written: dict[str, list[int]]) -> None:
    monitor = StlMonitor(Painted(BAD), "always(x > 1)", X, period=1, semantics="boolean")
    env = RecordViolations(monitor, str(tmp_path))
    run(env, 3)
    said = json.loads(env.videos[0].with_suffix(".json").read_text())
    assert said["robustness"] == {"spec": "-inf"}
    assert list(written.values()) == [[0, 1, 2, 3]]


def test_an_episode_is_the_same_when_it_is_recorded(tmp_path: Path) -> None:
    def monitored() -> gym.Env[Any, Any]:
        return StlMonitor(Painted(GOOD), "always(x > 1)", X)

    assert equal(rollout(RecordViolations(monitored(), str(tmp_path))), rollout(monitored()))


def test_it_is_made_again_from_its_specification(tmp_path: Path) -> None:
    env: Any = gym.make("CartPole-v1", render_mode="rgb_array")
    env = StlMonitor(env, "always(abs(a) < 0.1)", {"a": "obs[2]"})
    env = RecordViolations(env, str(tmp_path), before=2)
    assert env.capacity == 100 + 1 + 50
    again: Any = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert (type(again), again.capacity) == (RecordViolations, 151)
    assert pickle.loads(pickle.dumps(env)).capacity == 151


def test_a_video_shows_every_frame(tmp_path: Path) -> None:
    env: Any = gym.make("CartPole-v1", render_mode="rgb_array", max_episode_steps=12)
    env = StlMonitor(env, "always(abs(a) < 0.05)", {"a": "obs[2]"}, on_violation="report")
    env = RobustnessOverlay(env)
    recorded = RecordViolations(env, str(tmp_path), after=10)
    recorded.reset(seed=1)
    expected: list[Picture] = [env.render()]
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = recorded.step(0)
        expected.append(env.render())
        ended = terminated or truncated
    recorded.close()
    (path,) = recorded.videos
    decode = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo"]
    done = subprocess.run([*decode, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    assert b"600x470" in done.stderr
    assert b"50 fps" in done.stderr
    shown = np.frombuffer(done.stdout, np.uint8).reshape(-1, 470, 600, 3)
    assert len(expected) <= len(shown) <= len(expected) + 1
    for left, right in zip(shown, expected, strict=False):
        assert np.abs(left.astype(float) - right).mean() < 2.0


def test_what_cannot_be_recorded_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        InputError,
        match=r"^RecordViolations needs an StlMonitor or StlReward",
    ):
        RecordViolations(Painted(BAD), str(tmp_path))
    with pytest.raises(InputError, match=r"^RecordViolations needs pictures, got render_mode='r"):
        made(gym.wrappers.RenderCollection(Painted(BAD)), tmp_path)
    with pytest.raises(InputError) as keep:
        made(Painted(BAD), tmp_path, keep="violated")
    assert str(keep.value) == (
        "expected keep=\"violation\" or a function of the last info, got 'violated'"
    )
    for name in ("before", "after", "fps"):
        message = f"expected {name}= as a finite number above 0, got -1"
        with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
            made(Painted(BAD), tmp_path, **{name: -1})
    monkeypatch.setitem(sys.modules, "moviepy", None)
    with pytest.raises(ModuleNotFoundError) as extra:
        made(Painted(BAD), tmp_path)
    assert str(extra.value) == (
        "RecordViolations needs moviepy, which is not installed; from the checkout: "
        "pip install '.[video]'"
    )


def test_without_a_period_a_second_has_as_many_steps_as_frames(tmp_path: Path) -> None:
    env = RecordViolations(StlMonitor(Painted(BAD), "always(x > 1)", X), str(tmp_path))
    assert env.capacity == 5 * 10 + 1 + 10
    assert math.isclose(env._fps, 10.0)
