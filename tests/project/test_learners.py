"""The page on learners: tests run its programs, and check its claims."""

from pathlib import Path
from textwrap import dedent
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from paths import ROOT
from programs import excerpts, programs, run, watched

GROUPS = ROOT / "tests" / "learners"


def test_every_program_of_the_page_is_run_by_a_test() -> None:
    texts = [path.read_text(encoding="utf-8") for path in GROUPS.glob("test_*.py")]
    texts.append(Path(__file__).read_text(encoding="utf-8"))
    run_by = {heading: sum(f'run("{heading}"' in text for text in texts) for heading in programs()}
    assert len(run_by) > 5
    assert set(run_by.values()) == {1}


def test_excerpts_are_lines_of_their_programs() -> None:
    shown = excerpts()
    files = {path.relative_to(ROOT).as_posix() for path in ROOT.glob("examples/learners/*.py")}
    assert {*shown} == files
    for path, listed in shown.items():
        lines = (ROOT / path).read_text(encoding="utf-8").splitlines(keepends=True)
        assert listed, path
        for block in listed:
            size = block.count("\n")
            parts = (dedent("".join(lines[at : at + size])) for at in range(len(lines)))
            assert block in parts, f"{path} does not have these lines:\n{block}"


def test_pages_say_how_torch_comes_without_a_gpu() -> None:
    command = "pip install torch --index-url https://download.pytorch.org/whl/cpu"
    for page in ("learners", "installation"):
        assert command in (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")


def test_the_order_of_wrappers_counts_episodes_and_rewards_as_the_learner_gets_them(
    tmp_path: Path,
) -> None:
    program, _ = run("The order of wrappers", tmp_path)
    env: gym.Env[Any, Any] = program["env"]
    env.action_space.seed(1)
    found = []
    with watched() as rides:
        for seed in range(40):
            assert env.observation_space.contains(env.reset(seed=seed)[0])
            done, total, cost = False, 0.0, 0.0
            while not done:
                _, reward, terminated, truncated, info = env.step(env.action_space.sample())
                done = terminated or truncated
                total += float(reward)
                cost += info["cost"]
            assert info["episode"]["r"] == pytest.approx(total)
            found.append((info["episode"]["l"], info["is_success"], cost))
    ended = rides.ended(early=True)
    assert found == [(ride.steps, ride.success, ride.outside) for ride in ended]
    assert {ride.success for ride in ended} == {False, True}
    assert max(cost for _, _, cost in found) == 1


def test_the_safe_learner_finds_costs_and_successes_of_a_hand_count(tmp_path: Path) -> None:
    program, rides = run("Safe reinforcement learning", tmp_path)
    ended = rides.ended(early=False)
    assert len(ended) == 31 * 5
    for weights, batch in ((program["tried"], ended[-5:]), (np.zeros(4), ended[:5])):
        with watched() as again:
            total, cost, success = program["evaluate"](weights)
        assert [ride.positions for ride in again.ended(early=False)] == [
            ride.positions for ride in batch
        ]
        assert total == np.mean([ride.steps for ride in batch])
        assert cost == np.mean([ride.outside for ride in batch])
        assert success == np.mean([ride.success for ride in batch])
    assert sum(ride.outside > 1 for ride in ended) > 20
    assert (program["cost"], program["success"]) == (0.0, 1.0)
