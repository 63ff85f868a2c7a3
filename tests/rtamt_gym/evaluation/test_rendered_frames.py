"""The worst episodes of an evaluation have pictures if the environment renders."""

from __future__ import annotations

import io
import pickle
import warnings
from base64 import b64decode
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from painted import Painted
from PIL import Image
from profiles import examples

from rtamt_gym import StlMonitor, evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.evaluation.replays import Film, Frame
from rtamt_gym.play.history import Stop
from rtamt_gym.reports.evaluations import of_evaluation
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Report
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.results import Evaluation
from rtamt_gym.results.outcome import Moment

SPECS = {"low": "always(x < 1)"}
SIGNALS = {"x": "obs[0]"}


class Shown(Painted):
    """An environment whose pictures have the brightness 3 * step; it counts them."""

    control_timestep = 0.5

    def __init__(self, values: Any, render_mode: str | None = "rgb_array") -> None:  # noqa: ANN401
        super().__init__(values, render_mode=render_mode)
        self.rendered = 0

    def render(self) -> Any:  # noqa: ANN401
        self.rendered += 1
        return np.full((20, 40, 3), 3 * self.at, np.uint8)


def decoded(frame: Frame) -> Any:  # noqa: ANN401
    with Image.open(io.BytesIO(frame.webp)) as image:
        return np.asarray(image.convert("RGB"))


def step_of(frame: Frame) -> int:
    """Return the step of a picture."""
    return round(float(decoded(frame).mean()) / 3)


def evaluated(env: Any, specs: Any = SPECS, **options: Any) -> Evaluation:  # noqa: ANN401
    chosen: Any = {"episodes": 3, "seed": 5, "at_termination": "complete"} | options
    signals = None if specs is None else SIGNALS
    return evaluate_policy("zero", env, specs, signals, **chosen)


def values(steps: int, violation: int | None) -> list[float]:
    return [2.0 if i == violation else 0.0 for i in range(steps + 1)]


@settings(max_examples=examples(25), deadline=None)
@given(st.integers(1, 80), st.data(), st.sampled_from(["end", "violation"]))
def test_pictures_are_spread_and_show_the_violation_and_the_end(
    steps: int, data: st.DataObject, stop: Stop
) -> None:
    violation = data.draw(st.none() | st.integers(0, steps))
    env = Shown(values(steps, violation))
    (frames,) = evaluated(env, stop=stop).frames.values()
    shown = [step_of(frame) for frame in frames]
    assert [frame.time for frame in frames] == [0.5 * step for step in shown]
    wanted = {steps} if violation is None else {violation, steps}
    # An episode of known length has the maximum number of pictures, and every other at least half.
    gap = -(-(steps + 1) // 22)
    gaps = [gap] if stop == "end" else range(1, 2 * gap + 1)
    assert shown in [sorted({*range(0, steps + 1, gap), *wanted}) for gap in gaps]
    assert len(shown) <= 24


def test_a_film_of_any_length_is_short() -> None:
    now = iter(range(10**6))
    film = Film(lambda: str(next(now)).encode(), [7, 4999], expected=1)
    most = 0
    for _ in range(20_000):
        film.look()
        most = max(most, len(film.pictures))
    film.look(last=True)
    assert most <= 24
    assert next(now) < 200  # as many pictures were taken
    steps = list(film.pictures)
    assert {0, 7, 4999, 20_000} < set(steps)
    assert {step % 1024 for step in steps} == {0, 7, 4999 % 1024, 20_000 % 1024}


def test_pictures_are_small_and_those_of_what_was_rendered() -> None:
    class Half(Shown):
        def render(self) -> Any:  # noqa: ANN401
            picture = np.zeros((300, 640, 4), np.uint8)
            picture[:, :320, 0] = 255
            return picture

    (frames,) = evaluated(Half(values(3, None))).frames.values()
    picture = decoded(frames[0]).astype(int)
    assert picture.shape == (150, 320, 3)
    assert abs(picture[:, :150] - [255, 0, 0]).max() < 12
    assert abs(picture[:, 170:]).max() < 12


def test_an_environment_that_does_not_render_is_not_asked_to() -> None:
    class Blind(Shown):
        def render(self) -> Any:  # noqa: ANN401
            raise AssertionError("nobody asked")

    assert evaluated(Blind(values(9, 4), None)).frames == {}
    assert evaluated(Blind(values(9, 4), "ansi")).frames == {}
    assert evaluated(Blind(values(9, 4)), keep=0).frames == {}


def test_only_the_worst_episodes_are_rendered_and_numbers_are_as_without() -> None:
    env = Shown(values(9, 4))
    found = evaluated(env, episodes=6, keep=2)
    assert env.rendered == 20
    assert list(found.frames) == [run.seed for run in found.worst_runs["low"]] == [5, 6]
    plain = evaluated(Shown(values(9, 4), None), episodes=6, keep=2)
    assert plain.record == found.record
    assert plain.worst_runs == found.worst_runs


@pytest.mark.parametrize("n_envs", [1, 2])
def test_a_function_that_makes_environments_and_a_monitor_have_the_same_pictures(
    n_envs: int,
) -> None:
    expected = evaluated(Shown(values(9, 4))).frames
    assert expected
    assert evaluated(lambda: Shown(values(9, 4)), n_envs=n_envs).frames == expected

    def monitored() -> gym.Env[Any, Any]:
        return StlMonitor(Shown(values(9, 4)), SPECS, SIGNALS, at_termination="complete")

    assert evaluated(monitored, None, n_envs=n_envs).frames == expected


def test_the_policy_of_the_environment_acts_as_without_pictures() -> None:
    class Driven(Shown):
        def baseline(self, _obs: Any) -> Any:  # noqa: ANN401
            return np.array([0.25])

        def step(self, action: Any) -> Any:  # noqa: ANN401
            assert action == [0.25]
            return super().step(action)

    found = evaluate_policy("baseline", Driven(values(9, 4)), SPECS, SIGNALS, episodes=1)
    assert [step_of(frame) for frame in found.frames[0]] == list(range(10))


def test_with_substeps_a_picture_has_the_time_of_its_step() -> None:
    class Counted(gym.Wrapper[Any, Any, Any, Any]):
        def reset(self, **options: Any) -> Any:  # noqa: ANN401
            self.count = 0
            return self.env.reset(**options)

        def step(self, action: Any) -> Any:  # noqa: ANN401
            self.count += 1
            return self.env.step(action)

        def render(self) -> Any:  # noqa: ANN401
            return np.full((20, 20, 3), 3 * self.count, np.uint8)

    made = gym.make("InvertedPendulum-v5", render_mode="rgb_array", max_episode_steps=12)
    specs = {"slow": "always(v < 0.01)"}
    env = StlMonitor(Counted(made), specs, {"v": "qvel[0]"}, substeps=True)
    found = evaluate_policy("random", env, episodes=1)
    (frames,) = found.frames.values()
    assert len(frames) >= 5
    assert [frame.time for frame in frames] == pytest.approx([0.04 * step_of(f) for f in frames])
    made.close()


class Failing(Shown):
    """An environment that cannot be rendered from a step on."""

    until = 3

    def render(self) -> Any:  # noqa: ANN401
        if self.at >= self.until:
            raise RuntimeError("no display")
        return super().render()


def test_an_error_of_rendering_is_told_once_and_nothing_else_is_lost() -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = evaluated(Failing(values(9, 4)), keep=3)
    (told,) = caught
    assert str(told.message) == (
        "pictures of the worst episodes are missing, since Failing could not be rendered: "
        "RuntimeError: no display"
    )
    assert told.category is RuntimeWarning
    assert told.filename == __file__
    plain = evaluated(Shown(values(9, 4), None), keep=3)
    assert found.record.rows == plain.record.rows
    assert [run.histories for run in found.worst_runs["low"]] == [
        run.histories for run in plain.worst_runs["low"]
    ]
    assert [step_of(frame) for frame in found.frames[5]] == [0, 1, 2]
    assert list(found.frames) == [5]


@pytest.mark.parametrize(
    ("picture", "said"),
    [
        (None, "a NoneType"),
        (np.zeros((4, 4, 3)), "float64 of the shape (4, 4, 3)"),
        (np.zeros((4, 4), np.uint8), "uint8 of the shape (4, 4)"),
    ],
)
def test_what_is_no_picture_is_told(picture: Any, said: str) -> None:  # noqa: ANN401
    class Odd(Shown):
        def render(self) -> Any:  # noqa: ANN401
            return picture

    with pytest.warns(RuntimeWarning) as caught:
        assert evaluated(Odd(values(3, 1))).frames == {}
    assert str(caught[0].message) == (
        "pictures of the worst episodes are missing, since Odd could not be rendered: "
        f"InputTypeError: expected an array of height x width x 3 bytes from render(), got {said}"
    )


def test_pictures_survive_a_file_and_a_pickle(tmp_path: Path) -> None:
    found = evaluated(Shown(values(9, 4)), keep=2)
    found.save(tmp_path / "kept.json")
    loaded = Evaluation.load(tmp_path / "kept.json")
    assert loaded.frames == found.frames
    assert loaded == found
    assert loaded.to_json() == found.to_json()
    assert pickle.loads(pickle.dumps(found)) == found
    plain = evaluated(Shown(values(9, 4), None), keep=2)
    assert plain != found


def test_a_report_shows_the_pictures_of_its_episodes() -> None:
    found = evaluated(Shown(values(9, 4)))
    section = of_evaluation(found, ROOM)
    (episode,) = section.requirements[0].worst
    assert [frame.time for frame in episode.frames] == [0.5 * i for i in range(10)]
    assert episode.decided_at == Moment(4, 2.0)
    assert episode.frames[4].words == "The episode of seed 5 at 2 s"
    sources = [frame.source.partition("data:image/webp;base64,") for frame in episode.frames]
    assert [(before, b64decode(code)) for before, _, code in sources] == [
        ("", frame.webp) for frame in found.frames[5]
    ]
    page = render(Report("shown", "rtamt", (section,)))
    assert all(page.count(frame.source) == 1 for frame in episode.frames)


def test_the_command_line_keeps_pictures_where_it_asks_for_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(render_mode: str | None = None) -> Shown:
        return Shown(values(9, 4), render_mode)

    spec = gym.envs.registration.EnvSpec("Shown-v0", cast("Any", made))
    monkeypatch.setitem(gym.registry, spec.id, spec)
    monkeypatch.chdir(tmp_path)
    command = ["evaluate", "Shown-v0", "--policy", "zero", "--spec", f"low = {SPECS['low']}"]
    command += ["--signal", "x=obs[0]", "--episodes", "3", "--seed", "5", "--save", "kept.json"]
    assert main([*command, "--env-kwarg", "render_mode=rgb_array"]) == 0
    expected = evaluated(Shown(values(9, 4))).frames
    assert Evaluation.load("kept.json").frames == expected
    assert main(["report", "kept.json", "-o", "shown.html"]) == 0
    page = Path("shown.html").read_text(encoding="utf-8")
    assert page.count('"source":"data:image/webp') == 10  # Plotly has pictures of its own
    assert main(command) == 0
    assert Evaluation.load("kept.json").frames == {}


@pytest.mark.slow
def test_a_hundred_episodes_with_pictures_stay_below_six_megabytes() -> None:
    class Noisy(Shown):
        def render(self) -> Any:  # noqa: ANN401
            return np.random.default_rng(self.at).integers(0, 255, (320, 160, 3), np.uint8)

    found = evaluated(Noisy(values(70, 37)), episodes=100, keep=3)
    section = of_evaluation(found, ROOM)
    worst = section.requirements[0].worst
    letters = [sum(len(frame.source) for frame in episode.frames) for episode in worst]
    assert len(letters) == 3
    assert 0 < sum(letters) <= 480_000
    for episode in worst:
        times = [frame.time for frame in episode.frames]
        assert episode.decided_at == Moment(37, 18.5)
        assert 18.5 in times
        assert times == sorted(set(times))
    assert len(render(Report("shown", "rtamt", (section,))).encode()) < 6_000_000
