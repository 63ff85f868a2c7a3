"""Simulations on the screen: the same runs, drawn while they continue."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from rich.console import Console

import rtamt
from rtamt import InputError
from rtamt_gym import simulate
from rtamt_gym.__main__ import main
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.screen import RunScreen, Screen

SPECS = {
    "upright": "always(abs(angle) < 0.1)",
    "right": "eventually(x > 0.1)",
    "back": "always(x > 0.05 implies eventually[0:0.1](x < 0.05))",
}
SIGNALS = {"angle": "obs[2]", "x": "obs[0]"}


class Recorded(Screen):
    """A screen that also keeps its lines."""

    def __init__(self) -> None:
        super().__init__("", Console(file=io.StringIO(), force_terminal=True, width=80))
        self.taken: list[tuple[int, list[Line]]] = []

    def update(self, lines: Iterable[Line], rows: int, bad: int = 0) -> None:
        listed = [*lines]
        self.taken.append((rows, listed))
        super().update(listed, rows, bad)


def policy(obs: Any) -> int:  # noqa: ANN401
    return int(obs[2] + 0.4 * obs[3] > -0.05)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("stop", ["violation", "decided", "end"])
def test_each_sample_is_shown_as_a_monitor_judges_it(seed: int, stop: Any) -> None:  # noqa: ANN401
    options: dict[str, Any] = {"policy": policy, "seed": seed, "stop": stop}
    options |= {"at_termination": "cut"}
    env = gym.make("CartPole-v1", max_episode_steps=60)
    plain = simulate(env, SPECS, SIGNALS, **options)
    screen = Recorded()
    run = RunScreen(screen).simulate("cart", env, SPECS, SIGNALS, **options)
    assert (run.ended, run.violated_by) == (plain.ended, plain.violated_by)
    for name, values in plain.signals.items():
        np.testing.assert_array_equal(run.signals[name], values)
    monitors = {name: rtamt.EpisodeMonitor(spec, "20ms") for name, spec in SPECS.items()}
    *live, (rows, finals) = screen.taken
    assert [count for count, _ in live] == [*range(1, rows)]
    for i, (_, lines) in enumerate(live):
        assert [line.requirement for line in lines] == [*SPECS]
        for line in lines:
            monitor = monitors[line.requirement]
            monitor.update({name: run.signals[name][i] for name in monitor.variables})
            bounds = monitor.robustness, monitor.lower, monitor.upper
            assert (line.robustness, line.lower, line.upper) == bounds
            assert line.verdict is monitor.verdict
            assert line.time == pytest.approx(i * 0.02)
            assert (line.decided_at is not None) == (monitor.verdict is not rtamt.Verdict.UNDECIDED)
    assert rows == len(run.signals["x"])
    for line in finals:
        history = plain.histories[line.requirement]
        assert (line.robustness, line.verdict) == (history.final, history.verdict)
        assert (line.lower, line.upper) == (history.lower[-1], history.upper[-1])


def test_samples_are_shown_when_they_are_due() -> None:
    now = [50.0]

    def pause(seconds: float) -> None:
        assert 0 < seconds <= 0.05
        now[0] += seconds

    env = gym.make("CartPole-v1", max_episode_steps=10)
    shown = RunScreen(Recorded(), 0.1, lambda: now[0], pause)
    run = shown.simulate("cart", env, SPECS, SIGNALS, policy=policy, seed=0, stop="end")
    assert now[0] - 50 == pytest.approx(run.last_sample * 0.02 / 0.1)


def test_a_pace_needs_a_period() -> None:
    env = gym.make("MountainCar-v0", max_episode_steps=10)
    shown = RunScreen(Recorded(), 1.0)
    with pytest.raises(InputError, match=r"--speed needs the time between samples\. Give --period"):
        shown.simulate("car", env, {"it": "always(x > -2)"}, {"x": "obs[0]"}, policy=lambda _: 1)


ARGUMENTS = ["run", "CartPole-v1", "--spec", "always(abs(x) < 0.05)", "--signal", "x=obs[0]"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--screen"], "--screen draws on a terminal, but standard error is not one"),
        (["--speed", "2"], "--speed paces the view of --screen"),
        (["--screen", "--speed", "0"], "expected a factor above 0"),
    ],
)
def test_screen_and_speed_errors(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*ARGUMENTS, *options]) == 2
    assert message in capsys.readouterr().err


def on_terminal(arguments: list[str]) -> tuple[str, str]:
    """Return standard output of the command, and the text on the terminal with its errors."""
    master, slave = pty.openpty()
    texts: list[bytes] = []

    def read() -> None:
        with suppress(OSError):  # the end of a terminal
            while text := os.read(master, 1 << 16):
                texts.append(text)

    reader = threading.Thread(target=read)
    reader.start()
    done = subprocess.run(
        [sys.executable, "-m", "rtamt_gym", *arguments],
        stdout=subprocess.PIPE,
        stderr=slave,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "80"},
        check=True,
        text=True,
    )
    os.close(slave)
    reader.join()
    os.close(master)
    return done.stdout, b"".join(texts).decode()


def test_the_command_draws_on_standard_error_and_prints_the_same_table(tmp_path: Path) -> None:
    path = tmp_path / "runs.json"
    arguments = [*ARGUMENTS, "--episodes", "3", "--json", str(path)]
    plain, picture = on_terminal(arguments)
    results = re.sub(r'"wall": [^,]*', "", path.read_text())
    assert picture == ""
    shown, picture = on_terminal([*arguments, "--screen"])
    assert shown == plain
    assert re.sub(r'"wall": [^,]*', "", path.read_text()) == results
    assert "CartPole-v1, episode 3 of 3" in picture
    assert "VIOLATED" in picture
