"""The progress of requirements in stages, in infos and in results."""

import itertools
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from rtamt_gym import StlMonitor, VectorStlMonitor, evaluate_policy
from rtamt_gym.reports.model import Facts
from rtamt_gym.reports.requirements import with_trials
from rtamt_gym.reports.write import section_of
from rtamt_gym.results.codec import outcome_of, plain_outcome
from rtamt_gym.results.statistics import mean_progress, progress_text

SPECS = {
    "task": "eventually(angle <= -0.05 and eventually(angle >= 0.05 and eventually(x >= 0.1)))",
    "sway": "eventually[0:1](angle > 0.02 and eventually[0:400ms](angle < 0))",
    "calm": "always(abs(x) < 2)",
}
SIGNALS = {"angle": "obs[2]", "x": "obs[0]"}
AT: Any = {"at_termination": "failure", "at_truncation": "cut"}


def steered(obs: Any, early: bool) -> int:  # noqa: FBT001 - an observation
    return int(obs[2] + 0.3 * obs[3] > (-0.06 if early else 0.06))


STAGES = {"calm": ["x > -0.01", "x > 0.03"]}
"""Of a requirement that is not in order; the ordered ones keep theirs."""


def pole(**options: Any) -> StlMonitor[Any, Any]:
    env = gym.make("CartPole-v1", max_episode_steps=60)
    return StlMonitor(env, SPECS, SIGNALS, on_violation="report", **AT, **options)


def test_every_info_has_the_least_progress() -> None:
    env = pole(details=True)
    for seed in range(6):
        obs, info = env.reset(seed=seed)
        result, ended = [info], False
        while not ended:
            obs, _, terminated, truncated, info = env.step(
                steered(obs, info["stl"]["task"]["progress"] < 1 / 3)
            )
            result.append(info)
            ended = terminated or truncated
        for item in result:
            states = {name: item["stl"][name].get("progress") for name in SPECS}
            assert states["calm"] is None
            assert item["stl_progress"] == min(states["task"], states["sway"])
            assert type(item["stl_progress"]) is np.float64
            for name in ("task", "sway"):
                satisfied = item["stl"][name]["verdict"] == "SATISFIED"
                assert bool(states[name] == 1) is satisfied
        for before, after in itertools.pairwise(result):
            assert before["stl_progress"] <= after["stl_progress"]
        last = result[-1]["stl_episode"]
        assert {name: last[name].get("progress") for name in SPECS} == states


@pytest.mark.parametrize("options", [{}, {"stages": STAGES}])
def test_many_environments_have_the_infos_of_one(options: Any) -> None:
    num, steps = 3, 90
    alone = [pole(**options) for _ in range(num)]
    made = [lambda: gym.make("CartPole-v1", max_episode_steps=60)] * num
    envs = VectorStlMonitor(
        SyncVectorEnv(made, autoreset_mode=AutoresetMode.NEXT_STEP), SPECS, SIGNALS, **AT, **options
    )
    obs, infos = envs.reset(seed=[0, 1, 2])
    singles = [env.reset(seed=seed)[1] for seed, env in enumerate(alone)]
    over = [False] * num
    for _ in range(steps):
        assert infos["stl_progress"].tolist() == [item["stl_progress"] for item in singles]
        actions = [
            steered(item, info["stl_progress"] < 1 / 3)
            for item, info in zip(obs, singles, strict=True)
        ]
        obs, _, terminated, truncated, infos = envs.step(np.array(actions))
        for entry, env in enumerate(alone):
            if over[entry]:
                singles[entry] = env.reset()[1]
                over[entry] = False
                continue
            *_, ended, cut, singles[entry] = env.step(actions[entry])
            over[entry] = ended or cut
            assert over[entry] == (terminated | truncated)[entry]
            if over[entry]:
                for name in ("task", "sway", *options.get("stages", ())):
                    column = infos["stl_episode"][name]["progress"]
                    assert column[entry] == singles[entry]["stl_episode"][name]["progress"]


def test_named_stages_are_kept_with_what_judged() -> None:
    env = StlMonitor(
        gym.make("CartPole-v1"), "always(abs(x) < 2)", {"x": "obs[0]"}, stages=["x > 0", "x > 1"]
    )
    assert env.reset(seed=0)[1]["stl_progress"] < 1
    again = gym.make(type(env.spec).from_json(env.spec.to_json()))  # type: ignore[union-attr]
    assert again.reset(seed=0)[1]["stl_progress"] == env.reset(seed=0)[1]["stl_progress"]
    result = evaluate_policy(
        _policy, "CartPole-v1", SPECS, SIGNALS, episodes=2, seed=0, stages=STAGES
    )
    kept = json.loads(result.to_json())
    assert kept["reading"]["stages"] == STAGES
    assert kept["trials"][0]["outcomes"]["calm"]["progress"] > 0


def test_an_environment_without_stages_has_no_progress() -> None:
    env = StlMonitor(gym.make("CartPole-v1"), SPECS["calm"], {"x": "obs[0]"}, details=True)
    _, info = env.reset(seed=0)
    assert "stl_progress" not in info
    assert "progress" not in info["stl"]["spec"]


def _policy(obs: Any) -> int:
    return steered(obs, early=False)


@pytest.fixture(scope="module")
def evaluations() -> list[Any]:
    options: Any = {"seed": 0, "duration": 1.2, **AT}
    return [
        evaluate_policy(_policy, "CartPole-v1", SPECS, SIGNALS, episodes=6, n_envs=n, **options)
        for n in (1, 3)
    ]


def test_results_have_progress_and_its_mean(evaluations: list[Any], tmp_path: Path) -> None:
    one, many = evaluations
    for name in SPECS:
        result = [trial.outcomes[name].progress for trial in one.record]
        assert result == [trial.outcomes[name].progress for trial in many.record]
        if name == "calm":
            assert result == [None] * 6
            assert one.requirements[name].progress is None
        else:
            assert one.requirements[name].progress == pytest.approx(np.mean(result))
    assert "progress" in str(one)
    one.save(tmp_path / "one.json")
    again = type(one).load(tmp_path / "one.json")
    assert [t.outcomes["task"].progress for t in again.record] == [
        t.outcomes["task"].progress for t in one.record
    ]
    kept = json.loads(one.to_json())
    assert kept["results"]["task"]["progress"] == one.requirements["task"].progress
    assert "progress" not in kept["trials"][0]["outcomes"]["calm"]


def test_an_outcome_keeps_its_progress(evaluations: list[Any]) -> None:
    outcome = evaluations[0].record[0].outcomes["task"]
    assert outcome.progress is not None
    assert outcome_of(plain_outcome(outcome)) == outcome


def test_the_page_shows_progress(evaluations: list[Any]) -> None:
    section = section_of(evaluations[0], 1000)
    task, _, calm = section.requirements[:3]
    assert [item.progress for item in calm.trials] == [None] * 6
    shown = sorted(item.progress for item in task.trials if item.progress is not None)
    assert shown == sorted(trial.outcomes["task"].progress for trial in evaluations[0].record)
    blocks = with_trials(task, section).blocks
    (statistics,) = (block for block in blocks if isinstance(block, Facts))
    facts = {name: text for name, text, _ in statistics.rows}
    assert facts["mean progress"] == progress_text(evaluations[0].requirements["task"].progress)


def test_a_mean_is_one_only_if_all_are() -> None:
    almost = float(np.nextafter(1.0, 0.0))
    assert mean_progress([1.0, 1.0]) == 1
    assert mean_progress([1.0] * 9 + [almost]) == almost
    assert mean_progress([]) is None
    assert progress_text(almost) == "0.99"
