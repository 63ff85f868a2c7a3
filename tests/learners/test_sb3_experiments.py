"""The experiments on learning train, evaluate and report, with a very small budget."""

import csv
import dataclasses
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import script
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv

RUNS = [
    ("train_corridor", ["progress-state", "dqn-progress-state", "progress-lstm"], 1024),
    ("train_speed_limit", ["naive", "terminate"], 2048),
    ("train_patrol", ["step-obligations", "penalty-obligations"], 2048),
    ("train_contact", ["plain", "observed", "substeps"], 210),
]


@pytest.mark.parametrize(("name", "variants", "steps"), RUNS)
def test_an_experiment_runs_and_gives_the_same_rows_again(
    name: str, variants: list[str], steps: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = dataclasses.replace(script(name).TASK, points=1, episodes=2)
    files = [tmp_path / "first.csv", tmp_path / "second.csv"]
    for file in files:
        options = ["--seeds", "1", "--steps", str(steps), "--output", str(file)]
        script("training").main(task, "About.", [*options, "--variants", *variants])
    first, second = (
        [
            {field: text for field, text in row.items() if field != "seconds"}
            for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines())
        ]
        for file in files
    )
    assert first == second
    assert [row["variant"] for row in first] == variants
    assert {row["steps"] for row in first} == {str(steps)}
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


METHODS = [("corridor", method) for method in ("ours", "plain", "naive", "control")]


@pytest.mark.parametrize(("task", "method"), [*METHODS, ("patrol", "ours"), ("patrol", "control")])
def test_a_run_of_the_study_gives_the_same_row_again_and_is_not_run_twice(
    task: str,
    method: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    study = script("study")
    short = dataclasses.replace(study.TASKS[task], steps=2000, every=2000)
    monkeypatch.setitem(study.TASKS, task, short)
    files = [tmp_path / "first.jsonl", tmp_path / "second.jsonl"]
    for file in files:
        options = [task, "--methods", method, "--seeds", "1", "--output", str(file)]
        study.main(options)
        said, *rows = capsys.readouterr().out.splitlines()
        assert said.startswith(f"{task}, {method}, seed {short.first_seed}: ")
        study.main(options)
        assert capsys.readouterr().out.splitlines() == rows
        assert rows[-1].split()[:2] == [method, "1"]
    first, second = (
        {key: value for key, value in row.items() if key != "seconds"}
        for file in files
        for row in study.rows_of(file)
    )
    assert first == second
    assert first["steps"] == [2000]
    assert first["episodes"] == 100
    assert first["satisfied"] == first["last"]  # the only candidate is the last policy


def test_a_run_of_the_study_is_judged_by_its_best_policy_and_by_its_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    study = script("study")
    short = dataclasses.replace(study.TASKS["corridor"], steps=4000, every=2000)
    monkeypatch.setitem(study.TASKS, "corridor", short)
    rates = iter([0.7, 0.2, 0.6, 0.1])  # two candidates, the best and the last on other episodes
    seeds = []

    def evaluate_policy(*arguments: Any, episodes: int, seed: int, **options: Any) -> Any:  # noqa: ANN401, ARG001
        seeds.append(seed)
        found = types.SimpleNamespace(episodes=episodes, returns=np.zeros(1), requirements={})
        rate = next(rates)
        found.success = types.SimpleNamespace(
            rate=rate, satisfied=round(100 * rate), interval=(0.0, 1.0)
        )
        return found

    monkeypatch.setattr(study, "evaluate_policy", evaluate_policy)
    monkeypatch.setattr("rtamt_gym.learners.sb3.evaluate_policy", evaluate_policy)
    monkeypatch.setattr("rtamt_gym.learners.sb3.evaluation_metrics", lambda _: {})
    row = study.run("corridor", "ours", 1999)
    assert row["steps"] == [2000, 4000]
    assert row["chosen_by"] == [70, 20]
    assert (row["satisfied"], row["last"], row["stopped"]) == (60, 10, False)
    assert seeds == [study.FIRST_CHOSEN] * 2 + [1_000_000] * 2


class Counting(VectorEnv[Any, Any, Any]):
    """Two environments that show their step; the second one ends at its second step."""

    def __init__(self) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.num_envs = 2
        self.single_observation_space = Box(0.0, 9.0, (1,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (1,), np.float32)
        self.steps = np.zeros(2)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ANN401, ARG002
        mask = np.ones(2, np.bool_) if options is None else options["reset_mask"]
        self.steps[mask] = 0.0
        return self.steps[:, None].astype(np.float32), {}

    def step(self, actions: Any) -> Any:  # noqa: ANN401, ARG002
        self.steps += 1.0
        terminated = np.array([self.steps[0] == 3.0, False])
        truncated = np.array([self.steps[0] == 3.0, self.steps[1] == 2.0])
        obs = self.steps[:, None].astype(np.float32)
        return obs, self.steps * 10.0, terminated, truncated, {}


def test_a_learner_sees_the_last_observation_and_the_next_episode() -> None:
    envs = script("vec_env").GymnasiumVecEnv(Counting(), seed=1)
    assert envs.reset().tolist() == [[0.0], [0.0]]
    found = [envs.step(np.zeros((2, 1), np.float32)) for _ in range(3)]
    assert [obs[:, 0].tolist() for obs, *_ in found] == [[1.0, 1.0], [2.0, 0.0], [0.0, 1.0]]
    assert [rewards.tolist() for _, rewards, *_ in found] == [[10, 10], [20, 20], [30, 10]]
    assert [ended.tolist() for *_, ended, _ in found] == [
        [False, False],
        [False, True],
        [True, False],
    ]
    assert found[0][3] == [{}, {}]
    assert found[1][3] == [{}, {"terminal_observation": [2.0], "TimeLimit.truncated": True}]
    # An episode that ends for both reasons is over: no value of the future is added.
    assert found[2][3] == [{"terminal_observation": [3.0], "TimeLimit.truncated": False}, {}]


def test_environments_that_reset_themselves_are_refused() -> None:
    envs = Counting()
    envs.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
    with pytest.raises(ValueError, match=r"expected environments of AutoresetMode\.DISABLED, got"):
        script("vec_env").GymnasiumVecEnv(envs)
