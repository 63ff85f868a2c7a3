"""The experiments on learning: their tasks, their variants, their statistics."""

import dataclasses
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from experiments import script
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st

ACTIONS = st.lists(st.floats(-2.0, 2.0, width=32), min_size=1, max_size=60)


@given(ACTIONS, st.integers(0, 1000), st.sampled_from([0.1, 0.2]))
def test_a_point_moves_by_its_action_and_stops_at_the_walls(
    actions: list[float], seed: int, stride: float
) -> None:
    env = script("corridor").Corridor(stride)
    obs, info = env.reset(seed=seed)
    (x,) = np.random.default_rng(seed).uniform(-1.0, 1.0, 1)
    assert obs == pytest.approx([x])
    for action in actions:
        x = np.clip(x + stride * np.clip(action, -1.0, 1.0), -1.0, 1.0)
        obs, *others, info = env.step(np.array([action], np.float32))
        assert obs == pytest.approx([x], abs=1e-6)
        assert others == [0.0, False, False]
        assert info == {"x": obs[0]}


def test_the_corridor_is_an_environment_as_gymnasium_wants_it() -> None:
    check_env(script("corridor").Corridor(), skip_render_check=True)


def test_the_clocks_made_by_hand_count_the_steps_since_each_end() -> None:
    env = script("train_patrol").make_env("step-clocks")
    x = float(env.reset(seed=3)[0][0])
    since = [0, 0]
    places = [x]
    for step in range(200):
        obs, *_ = env.step(np.array([-0.9 if step // 15 % 2 else 0.9], np.float32))
        places.append(float(obs[0]))
        for end, there in enumerate((places[-1] < -0.8, places[-1] > 0.8)):
            since[end] = 0 if there else since[end] + 1
        assert obs[1:] == pytest.approx([min(count / 40, 1.0) for count in since], abs=1e-5)
    assert min(places) < -0.8
    assert max(places) > 0.8


def played(env: gym.Env[Any, Any], actions: Any) -> tuple[list[float], dict[str, Any]]:  # noqa: ANN401
    """Return the rewards of an episode, and its last info."""
    env.reset(seed=5)
    rewards, done = [], False
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(float(reward))
        done = terminated or truncated
        if done:
            break
    assert done
    return rewards, info


def there_and_back(steps: int) -> list[Any]:
    """Return actions that visit both ends of the corridor, in 40 steps of 0.2 or 25 of 0.1."""
    return [np.array([1.0 if step // 25 % 2 else -1.0], np.float32) for step in range(steps)]


@pytest.mark.parametrize(("name", "steps"), [("train_corridor", 50), ("train_patrol", 200)])
def test_variants_of_the_corridor_see_what_they_are_judged_in(name: str, steps: int) -> None:
    module = script(name)
    for variant in module.TASK.variants:
        if variant.startswith("dqn"):
            continue
        seen, trained = module.policy_env(variant), module.training_env(variant)
        assert seen.observation_space == trained.observation_space
        assert seen.reset(seed=1)[0].tolist() == trained.reset(seed=1)[0].tolist()
        rewards, _ = played(trained, there_and_back(steps))
        assert (variant == "plain") == (not any(rewards))
        _, info = played(seen, there_and_back(steps))
        assert not info["stl_violated"]


def test_variants_without_a_memory_see_x_alone() -> None:
    for name, alone in (
        ("train_corridor", {"plain", "sparse", "naive", "progress"}),
        ("train_patrol", {"plain", "sparse", "naive", "step"}),
    ):
        module = script(name)
        found = {
            v for v in module.TASK.variants if module.policy_env(v).observation_space.shape == (1,)
        }
        assert {v for v in found if not v.startswith("dqn") and not v.endswith("lstm")} == alone


def test_variants_of_the_speed_limit_pay_as_they_say() -> None:
    still = [np.zeros(6, np.float32)] * 500
    module = script("train_speed_limit")
    plain, _ = played(module.make_env(), still)
    for variant in module.TASK.variants:
        rewards, _ = played(module.training_env(variant), still)
        match variant:
            case "sparse":
                assert rewards == [0.0] * 500
            case "naive" | "naive-wide":  # 10 m are missing: 0.1 * (x - 10), clipped
                assert rewards[-1] == pytest.approx(-1.0, abs=0.05)
            case "add" | "add-step":
                assert len(rewards) == 500
                assert all(mine > theirs for mine, theirs in zip(rewards, plain, strict=True))
            case _:  # never beyond the limit
                assert rewards == plain


def test_a_finger_is_an_environment_as_gymnasium_wants_it() -> None:
    check_env(script("train_contact").Finger(), skip_render_check=True)


def hard(obs: Any) -> Any:  # noqa: ANN401
    """Push all the way."""
    return np.ones((*obs.shape[:-1], 1), np.float32)


def soft(obs: Any) -> Any:  # noqa: ANN401
    """Brake before the plate: the closer, the slower."""
    x, v = obs[..., :1], obs[..., 1:]
    return np.clip((0.25 + 1.6 * np.maximum(-0.1 - x, 0.0) - v) / 0.2, -1.0, 1.0).astype(np.float32)


def forces(policy: Any, seed: int) -> tuple[list[float], list[float]]:  # noqa: ANN401
    """Return forces on the plate after each environment step, and after each physics step.

    The physics is stepped here, and a force is a sum over the contacts.
    """
    env = script("train_contact").make_env()
    obs, _ = env.reset(seed=seed)
    model, data = env.unwrapped.model, env.unwrapped.data
    inside, force = [], np.zeros(6)
    for _ in range(15):
        data.ctrl[:] = policy(obs)
        for _ in range(50):
            mujoco.mj_step(model, data)
            inside.append(0.0)
            for contact in range(data.ncon):
                mujoco.mj_contactForce(model, data, contact, force)
                inside[-1] += float(force[0])
        obs = np.concatenate([data.qpos, data.qvel])
    assert obs[0] > -0.01
    return inside[49::50], inside


def test_a_hard_contact_is_over_before_the_next_observation_and_a_soft_one_keeps_the_limit() -> (
    None
):
    for seed in range(20):
        ends, inside = forces(hard, seed)
        assert max(ends) < 50 < max(inside)
        ends, inside = forces(soft, seed)
        assert 1 < max(inside) < 50


def test_sub_steps_judge_what_happens_between_two_observations() -> None:
    training, task = script("training"), script("train_contact").TASK
    task = dataclasses.replace(task, episodes=4)
    counts = {
        (policy, substeps): training.evaluate(task, policy, "plain", substeps=substeps)[0]
        for policy in (hard, soft)
        for substeps in (True, False)
    }
    assert counts == {(hard, True): 0, (hard, False): 4, (soft, True): 4, (soft, False): 4}


@pytest.mark.parametrize(("variant", "steps"), [("plain", 15), ("observed", 15), ("substeps", 8)])
def test_an_end_comes_at_what_the_monitor_sees(variant: str, steps: int) -> None:
    env = script("train_contact").training_env(variant)
    obs, _ = env.reset(seed=3)
    count, terminated, truncated = 0, False, False
    while not (terminated or truncated):
        obs, _, terminated, truncated, _ = env.step(hard(obs))
        count += 1
    assert (count, terminated) == (steps, variant == "substeps")


def test_many_corridors_do_what_each_does() -> None:
    corridor = script("corridor")
    many = corridor.VectorCorridor(3, stride=0.2, steps=7)
    singles = [gym.wrappers.TimeLimit(corridor.Corridor(0.2), 7) for _ in range(3)]
    rng = np.random.default_rng(4)
    seeds: Any = [5, 6, 7]
    obs, infos = many.reset(seed=seeds)
    shown: list[Any] = [env.reset(seed=seed) for env, seed in zip(singles, seeds, strict=True)]
    resets = 0
    for step in range(30):
        assert obs.tolist() == [one.tolist() for one, *_ in shown]
        assert infos["x"].tolist() == [each[-1]["x"] for each in shown]
        assert many.observation_space.contains(obs)
        actions = rng.uniform(-2.0, 2.0, (3, 1)).astype(np.float32)
        obs, rewards, terminated, truncated, infos = many.step(actions)
        shown = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        assert rewards.tolist() == [each[1] for each in shown]
        assert terminated.tolist() == [each[2] for each in shown]
        assert truncated.tolist() == [each[3] for each in shown]
        again = truncated if step != 3 else np.array([False, True, False])  # one in mid-episode
        if again.any():
            resets += int(again.sum())
            obs, infos = many.reset(seed=[step] * 3, options={"reset_mask": again})
            for k in np.flatnonzero(again):
                shown[k] = singles[k].reset(seed=step)
    assert resets > 9


def test_what_is_finished_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    training = script("training")
    runs: list[tuple[str, int]] = []

    def train(task: Any, variant: str, seed: int, steps: int) -> list[dict[str, str]]:  # noqa: ANN401
        runs.append((variant, seed))
        rate = {"plain": 1, "ours": 4}[variant]
        cells = [variant, str(seed), str(steps), str(task.episodes), str(rate), "0", "1.5"]
        return [dict(zip(training.FIELDS, cells, strict=True))]

    monkeypatch.setattr(training, "train", train)
    task = dataclasses.replace(
        script("train_patrol").TASK, variants=("plain", "ours"), ours="ours", drawn=("ours",),
        episodes=4, first_seed=7, steps=49_000,
    )  # fmt: skip
    output, picture = tmp_path / "found" / "runs.csv", tmp_path / "curves.png"
    options = ["--output", str(output), "--plot", str(picture)]
    training.main(task, "About.", ["--seeds", "1", *options])
    training.main(task, "About.", ["--seeds", "3", *options])
    training.main(task, "About.", ["--seeds", "3", *options])
    assert runs == [(variant, seed) for seed in (7, 8, 9) for variant in ("plain", "ours")]
    shown = capsys.readouterr().out.splitlines()
    assert shown[-3:] == [
        "variant  seeds  satisfied, %    90 % at  p    s a seed",
        "plain    3      25 [25, 25]     never    0.1  2",
        "ours     3      100 [100, 100]  49k           2",
    ]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_methods_of_the_study_say_and_pay_the_end_at_the_speed_limit_as_they_are_called() -> None:
    limited = script("study").speed_limit_env
    fast = [np.array([1, -1, 1, -1, 1, -1], np.float32) * (-1) ** (k // 4) for k in range(500)]
    paid: dict[str, list[float]] = {}
    for method in ("plain", "ours", "control", "whole"):
        env = limited(method)
        env.reset(seed=5)
        rewards = []
        for action in fast:
            _, reward, terminated, truncated, _ = env.step(action)
            rewards.append(float(reward))
            if method != "plain" and env.unwrapped.data.qvel[0] >= 1.5:
                assert (terminated, truncated) == (method != "control", False)
                break
            assert not terminated
        paid[method] = rewards
    count = len(paid["ours"])
    assert 1 < count < 500
    assert paid["whole"] == paid["ours"]
    assert len(paid["ours"]) == len(paid["control"]) == count
    assert paid["ours"][:-1] == paid["control"][:-1]
    assert paid["ours"][-1] == pytest.approx(paid["control"][-1], abs=1)  # 0 after an end
    # A potential within [-1, 1] changes the sum of discounted rewards by at most 2.
    discounts = 0.99 ** np.arange(count)
    lost = float(discounts @ np.subtract(paid["plain"][:count], paid["ours"]))
    assert lost == pytest.approx(30 * discounts[-1], abs=2)


def test_the_study_draws_the_runs_that_there_are(tmp_path: Path) -> None:
    rows = [
        {"task": task, "method": method, "satisfied": ends, "episodes": 100}
        for task in ("corridor", "speed_limit")
        for method, ends in (("ours", 100), ("ours", 16), ("plain", 0))
    ]
    picture = tmp_path / "runs.png"
    script("study").draw(rows, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
