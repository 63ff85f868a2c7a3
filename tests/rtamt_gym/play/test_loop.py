"""The loop of episodes: what it shares, restores and reports."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from rtamt import parse
from rtamt_gym import Runner
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.history import Stop
from rtamt_gym.play.loop import PlayBatch, SideBySide, Task, play
from rtamt_gym.play.offline_runner import OfflineRunner
from rtamt_gym.results.trial import Trial
from rtamt_gym.systems.policies import Model

TASKS = [Task(i, Case({}), i) for i in range(5)]


class Counting:
    """An episode of as many steps as its number, plus one."""

    trace, wall, left, observation = None, 0.0, False, np.zeros(1)

    def __init__(self, task: Task) -> None:
        self.task, self.steps = task, 0

    def step(self) -> bool:
        self.steps += 1
        if self.task.number == 3:
            raise ZeroDivisionError("no step")
        return self.steps > self.task.number + 1

    def trial(self, case: Case, error: str = "") -> Trial:
        return Trial(case, None, {}, "error" if error else "terminated", 0.0, self.wall, error)

    def leave(self) -> None:
        self.left = True


class Pair(PlayBatch):
    """A batch of two places."""

    size = 2

    def __init__(self) -> None:
        self.episodes: list[Counting] = []
        self.closed = 0

    def begin(self, _place: int, task: Task) -> Counting:
        if task.number == 4:
            raise RuntimeError("no start")
        self.episodes.append(Counting(task))
        return self.episodes[-1]

    def step(self, running: Any) -> float:  # noqa: ANN401
        return float(len(running))

    def close(self) -> None:
        self.closed += 1


def test_all_tasks_are_played_with_seeds_and_errors() -> None:
    batch = Pair()
    played = list(play(batch, TASKS))
    assert {task.number: (trial.seed, trial.error) for task, trial, _ in played} == {
        0: (0, ""),
        1: (1, ""),
        2: (2, ""),
        3: (3, "ZeroDivisionError: no step"),
        4: (4, "RuntimeError: no start"),
    }
    assert [trial.wall for task, trial, _ in played if task.number < 3] == [1.0, 2.0, 3.0]
    assert batch.closed == 1
    assert not any(episode.left for episode in batch.episodes)


def test_early_end_leaves_running_episodes() -> None:
    batch = Pair()
    playing: Any = play(batch, TASKS)
    next(playing)
    playing.close()
    assert [episode.left for episode in batch.episodes] == [False, True]
    assert batch.closed == 1


def test_wall_time_includes_a_share_of_the_model() -> None:
    class Slow:
        def predict(self, obs: Any, *_: Any, **__: Any) -> Any:  # noqa: ANN401
            threading.Event().wait(0.02)
            return np.zeros(len(obs)), None

    def begin(_place: int, task: Task, _policy: Any) -> Any:  # noqa: ANN401
        return Counting(task)

    space: Any = spaces.Box(-1, 1, (1,))
    batch = SideBySide(2, begin, Model(Slow()), space)
    walls = [trial.wall for _, trial, _ in play(batch, TASKS[:2])]
    assert 0.01 <= walls[0] < walls[1]


@pytest.mark.parametrize("stop", ["violation", "decided", "end"])
def test_native_triggers_equal_those_of_single_runs(stop: Stop) -> None:
    spec = "always(x > 5 implies eventually[0:30](x < -1))"
    rows = []
    for batch in (1, 3):
        with Runner(
            "rtamt/ChasingCars-v0",
            {"near": "always(y2 - y1 < 12)", "asked": spec.replace("x", "y5 - y4")},
            stop=stop,
            batch=batch,
            duration=20,
        ) as runner:
            assert runner.vectorized == (batch > 1)
            cases = [{"throttle": 1.0, "brake": 0.0}, {"throttle": 0.2, "brake": 0.0}]
            rows.append(sorted(runner.run(cases, [0, 1]), key=lambda row: row[0]))
    assert rows[0] == rows[1]
    assert any(row.ended == stop for _, row in rows[0]) == (stop == "violation")


def test_error_after_the_horizon_is_in_the_row() -> None:
    def plant(x: float) -> Iterator[dict[str, float]]:
        yield from [{"x": x}] * 9
        raise ValueError("late")

    specs = {"low": parse("always[0:2](x < 1 implies eventually[0:3](x < 1))")}
    runner = Runner(plant, specs, period=1, duration=20, stop="known")
    (first,) = OfflineRunner(runner).run([{"x": 0.0}])
    (second,) = runner.run([{"x": 0.0}])
    assert first == second
