"""The loop of episodes: its shared state, its restores and its reports."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import rtamt_envs  # noqa: F401 - registers the scenarios
from gymnasium import spaces

import rtamt
from rtamt import Specification, Verdict, parse
from rtamt_gym import Runner, Space
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.history import Stop
from rtamt_gym.play.loop import PlayBatch, SideBySide, Task, play
from rtamt_gym.results.outcome import Moment
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.falsification.search import OfflineRunner, prefers_offline
from rtamt_gym.systems.policies import Model

TASKS = [Task(i, Case({}), i) for i in range(5)]


class Counting:
    """An episode with one step more than its number."""

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
    """A batch of two entries."""

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


TRANSMISSION, CARS = "rtamt/AutomaticTransmission-v0", "rtamt/ChasingCars-v0"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("always[0:2](x > 0 implies eventually[0:1] x < 0)", True),
        ("eventually[0:2](x > 0 and not always[0:1] x < 0)", True),
        ("always[0:1] eventually[0:1](x > 0 or always[0:1] x > 1)", True),
        ("x < 3 and always[0:1]((eventually[0:1] x > 0) until[0:1] x > 1)", True),
        ("always[0:1] eventually[0:1] always[0:1] x > 0", False),
        ("always[0:3] x > 0 implies always[0:2] x > 1", False),
        ("always[0:3](x > 0 implies x > 1)", False),
        ("always[0:2](x > 0 implies eventually[0:1.5] x < 0)", False),  # later than the end
        ("always(x > 0 implies eventually[0:1] x < 0)", False),  # as late as any end
        ("always[0:2s](x > 0 implies eventually[0:1] x < 0)", True),
    ],
)
def test_windows_over_combinations_of_windows_are_judged_at_the_end(
    text: str, *, expected: bool
) -> None:
    def system(top: float) -> Iterator[Mapping[str, float]]:
        while True:
            yield {"x": top}

    with Runner(system, text, period=0.5, duration=3) as runner:
        assert prefers_offline(runner.requirements, runner) is expected
    for options in ({"view": "step"}, {"semantics": "output-robustness"}, {"duration": None}):
        with Runner(system, text, period=0.5, **{"duration": 3, **options}) as runner:  # type: ignore[arg-type]
            assert not prefers_offline(runner.requirements, runner)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("system", "names", "count"),
    [(TRANSMISSION, ["AT52", "AT54"], 16), (CARS, ["CC5"], 50)],
    ids=["AT", "CC"],
)
def test_rows_are_those_of_monitored_runs(system: str, names: list[str], count: int) -> None:
    def make(specs: Mapping[str, Specification], stop: Stop) -> Runner:
        return Runner(system, specs, stop=stop, batch=count)

    with Runner(system, names, batch=count, stop="violation") as runner:
        space = Space(runner.inputs, duration=runner.duration)
        points = np.random.default_rng(1).random((count, space.dimension))
        cases = [space.case(point) for point in points]
        seeds = range(count)
        expected = dict(runner.run(cases, seeds))
        whole = OfflineRunner(make(runner.requirements, "known"))
        assert prefers_offline(runner.requirements, runner)
        result = dict(whole.run(cases, seeds))
        whole.close()
    assert sorted(result) == list(range(count))
    verdicts = set()
    for index, row in expected.items():
        violated = any(item.verdict is Verdict.VIOLATED for item in row.outcomes.values())
        verdicts.add(violated)
        if violated:
            assert result[index] == row
        else:
            assert result[index] == _decided_at_the_end(row)
    assert verdicts == {True, False}


def _decided_at_the_end(row: Trial) -> Trial:
    at_end = {}
    for name, outcome in row.outcomes.items():
        at = outcome.decided
        assert at is not None
        assert at.sample
        assert at.seconds is not None
        last = round(row.simulated * at.sample / at.seconds)
        at_end[name] = replace(outcome, decided=Moment(last, row.simulated))
    return replace(row, outcomes=at_end)


TEXT = "always[0:2](x > 0 implies eventually[0:1] x < 0)"


def test_what_fails_or_ends_early_is_left_to_monitors() -> None:
    def system(steps: float) -> Iterator[Mapping[str, float]]:
        for step in range(int(abs(steps))):
            yield {"x": (-1.0) ** step}
        if steps < 0:
            raise ValueError("out of steps")

    def make(specs: Mapping[str, Specification], stop: Stop) -> Runner:
        return Runner(system, specs, stop=stop, period=0.5, duration=3)

    cases = [{"steps": steps} for steps in (20.0, 7.0, 6.0, 1.0, -20.0, -7.0, -6.0, -1.0)]
    specs = {"spec": rtamt.parse(TEXT)}
    whole, monitored = OfflineRunner(make(specs, "known")), make(specs, "known")
    result, expected = dict(whole.run(cases)), dict(monitored.run(cases))
    assert [result[index] for index in (2, 3, 6, 7)] == [expected[index] for index in (2, 3, 6, 7)]
    assert [result[index].error != "" for index in range(8)] == [False] * 6 + [True] * 2
    for index in (0, 1, 4, 5):
        outcome = result[index].outcomes["spec"]
        height = rtamt.evaluate(TEXT, {"x": [(-1.0) ** i for i in range(7)]}, Fraction(1, 2))[0]
        assert (outcome.robustness, outcome.lower, outcome.upper) == (height,) * 3
        assert (outcome.verdict, outcome.decided_at) == (Verdict.SATISFIED, 3.0)
