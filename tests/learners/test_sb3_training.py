"""The training log of the callback of Stable-Baselines3, against counts by hand."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib as mpl
import pytest
from programs import (
    LIMIT,
    Ride,
    Rides,
    cost_of,
    counts_of,
    recipes,
    run_program,
    shares_of,
    watched,
)
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from rtamt import InputError
from rtamt_gym import StlMonitor, StlReward
from rtamt_gym.__main__ import main
from rtamt_gym.learners.logs import training_logs
from rtamt_gym.learners.sb3 import SatisfactionCallback

WINDOW = 20

REQUIREMENT: dict[str, Any] = {
    "specs": "always(abs(x) < 0.12)",
    "signals": {"x": "obs[0]"},
    "at_termination": "failure",
}


def monitored(count: int, wrapper: type | None = StlMonitor, **arguments: Any) -> VecEnv:  # noqa: ANN401
    return make_vec_env(
        "CartPole-v1",
        n_envs=count,
        seed=1,
        env_kwargs={"max_episode_steps": LIMIT},
        wrapper_class=wrapper,
        wrapper_kwargs={**REQUIREMENT, **arguments} if wrapper else None,
    )


def learner(kind: str, envs: VecEnv, folder: Path, *formats: str) -> Any:  # noqa: ANN401
    options: dict[str, Any] = {"seed": 1, "device": "cpu"}
    if kind == "PPO":
        model: Any = PPO("MlpPolicy", envs, n_steps=64, n_epochs=1, **options)
    else:
        options |= {"learning_starts": 50, "buffer_size": 1000, "exploration_final_eps": 0.9}
        model = DQN("MlpPolicy", envs, **options)
    model.set_logger(configure(str(folder), [*formats]))
    return model


def rows(folder: Path) -> list[dict[str, float]]:
    """Return the rows of the logger's CSV file, without empty cells."""
    with (folder / "progress.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    return [{key: float(cell) for key, cell in row.items() if cell} for row in table]


def stl(row: dict[str, float]) -> dict[str, float]:
    return {key.removeprefix("stl/"): cell for key, cell in row.items() if key.startswith("stl/")}


def by_hand(rides: list[Ride], steps: float) -> dict[str, float]:
    """Return the expected log after a number of steps of all environments."""
    ended = [ride for ride in rides if ride.last_step <= steps]
    return {**shares_of(ended[-WINDOW:]), **counts_of(ended)}


CASES = {
    "PPO": ("PPO", StlMonitor, lambda envs: envs),
    "a reward of robustness": ("PPO", StlReward, lambda envs: envs),
    "normalised": ("PPO", StlMonitor, VecNormalize),
    "stacked": ("PPO", StlMonitor, lambda envs: VecFrameStack(VecNormalize(envs), 3)),
    "DQN": ("DQN", StlMonitor, lambda envs: envs),
}


def trained(case: str, folder: Path) -> tuple[Rides, VecEnv]:
    kind, wrapper, around = CASES[case]
    more = {"mode": "add"} if wrapper is StlReward else {}
    with watched() as rides:
        inner = monitored(2, wrapper, **more)
        model = learner(kind, around(inner), folder, "csv", "tensorboard")
        model.learn(700, callback=SatisfactionCallback(window=WINDOW))
        model.logger.close()
    return rides, inner


@pytest.mark.parametrize("case", CASES)
def test_every_row_that_is_logged_is_that_of_a_count_by_hand(case: str, tmp_path: Path) -> None:
    rides, inner = trained(case, tmp_path)
    ended = rides.ended(early=True, within=inner)
    assert len(ended) > 2 * WINDOW
    table = rows(tmp_path)
    assert len(table) >= 5
    for row in table:
        assert stl(row) == pytest.approx(by_hand(ended, row["time/total_timesteps"]))
    assert 0 < table[-1]["stl/satisfied"] < 1


def test_cost_that_is_logged_is_the_mean_of_sums_by_hand(tmp_path: Path) -> None:
    with watched() as rides:
        inner = monitored(2, cost="violation", on_violation="report")
        model = learner("PPO", inner, tmp_path, "csv")
        callback = SatisfactionCallback(window=WINDOW)
        model.learn(256, callback=callback)
        model.learn(256, callback=callback, reset_num_timesteps=False)
        late = SatisfactionCallback(window=WINDOW)
        model.learn(256, callback=late, reset_num_timesteps=False)
        model.logger.close()
    ended = rides.ended(early=False, within=inner)
    table = rows(tmp_path)
    for row in table:
        seen = [ride for ride in ended if ride.last_step <= row["time/total_timesteps"]]
        if row["time/total_timesteps"] <= 512:
            assert stl(row)["cost"] == pytest.approx(cost_of(seen[-WINDOW:])["cost"])
    assert table[-1]["stl/cost"] > 0
    assert late.training.metrics()["cost"] > 0
    assert "cost" not in SatisfactionCallback().training.metrics()


def test_event_files_of_tensorboard_hold_the_same(tmp_path: Path) -> None:
    trained("PPO", tmp_path)
    events = EventAccumulator(str(tmp_path)).Reload()
    table = rows(tmp_path)
    tags = [tag for tag in events.Tags()["scalars"] if tag.startswith("stl/")]
    assert len(tags) == len(stl(table[-1])) == 14
    for tag in tags:
        points = [(event.step, event.value) for event in events.Scalars(tag)]
        cells = [(row["time/total_timesteps"], row[tag]) for row in table if tag in row]
        assert points == [(step, pytest.approx(cell, rel=1e-6)) for step, cell in cells]


def test_the_table_in_the_terminal_takes_names_of_any_length(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["the_cart_stays_near_the_middle_of_its_track_" + end for end in ("left", "right")]
    specs = dict.fromkeys([*names, "near"], "always(abs(x) < 0.12)")
    model = learner("PPO", monitored(2, specs=specs), tmp_path, "stdout", "csv")
    model.learn(128, callback=SatisfactionCallback())
    printed = capsys.readouterr().out
    assert "near/satisfied" in printed
    assert "robustness" not in printed
    assert names[0][:30] not in printed
    assert max(map(len, printed.splitlines())) <= 80
    model.logger.close()
    (row,) = rows(tmp_path)
    assert {f"stl/{name}/satisfied" for name in names} < row.keys()


@pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.UnseenEndWarning")
def test_episodes_without_outcomes_are_refused_unless_others_are_evaluated(tmp_path: Path) -> None:
    reason = (
        "expected 'stl_episode' in the last info of an episode, which StlMonitor and StlReward "
        "add, got the keys 'episode', 'TimeLimit.truncated', 'terminal_observation'; wrap the "
        "environment in a monitor, and place time limits inside it"
    )
    model = learner("PPO", monitored(2, None), tmp_path)
    with pytest.raises(InputError) as caught:
        model.learn(64, callback=SatisfactionCallback())
    assert str(caught.value) == reason

    def late(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        return gym.wrappers.TimeLimit(StlMonitor(env, **REQUIREMENT), 12)

    envs = make_vec_env("CartPole-v1", 2, seed=1, wrapper_class=late)
    model = learner("PPO", envs, tmp_path)
    with pytest.raises(InputError, match=r"^expected 'stl_episode' in the last info"):
        model.learn(64, callback=SatisfactionCallback())


def test_the_complete_example_writes_a_log_for_each_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = recipes()["A complete example"].replace("12_000", "1_024").replace("1_000", "100")
    run_program(program, tmp_path)
    monkeypatch.chdir(tmp_path)
    logs = [*training_logs(Path("runs/ppo")), *training_logs(Path("runs/dqn"))]
    assert len(logs) == 6
    for log in logs:
        evaluated, rates = log.curves["eval_stl/rate"]
        assert len(evaluated) >= 5
        assert ((rates >= 0) & (rates <= 1)).all()
        assert {"stl/upright/satisfied", "stl/centred/robustness_median"} <= log.curves.keys()
    mpl.use("Agg")
    assert main(["plot", "ppo=runs/ppo", "dqn=runs/dqn", "-o", "training.png"]) == 0
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert ["ppo", "3"] in rows
    assert ["dqn", "3"] in rows
