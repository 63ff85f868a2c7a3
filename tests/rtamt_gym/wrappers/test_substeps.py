"""`StlMonitor(substeps=True)`: one sample for every step of the simulation, no other change."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from environments import Env, continued, equal, restored, rollout
from gymnasium.envs.mujoco.inverted_pendulum_v5 import InvertedPendulumEnv
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import rtamt
from rtamt_gym import Step, StlMonitor, StlReward

Look = Callable[[Any], float]


@dataclass(frozen=True)
class Case:
    """An environment, its simulation steps per step, and its signal."""

    env_id: str
    frames: int
    period: float
    selector: str
    look: Look

    def bare(self) -> Env:
        return gym.make(self.env_id)

    def monitored(self, spec: str = "always(abs(x) < 1e6)", **arguments: Any) -> Env:
        return StlMonitor(self.bare(), spec, {"x": self.selector}, substeps=True, **arguments)


CASES = [
    Case("HalfCheetah-v5", 5, 0.01, "qvel[1]", lambda s: float(s.data.qvel[1])),
    Case("Ant-v5", 5, 0.01, "qvel[3]", lambda s: float(s.data.qvel[3])),  # RK4
    Case("Hopper-v5", 4, 0.002, "body:torso.xpos[2]", lambda s: float(s.data.xpos[1, 2])),  # RK4
    Case("InvertedPendulum-v5", 2, 0.02, "joint:hinge.qpos", lambda s: float(s.data.qpos[1])),
    Case("highway_env:highway-fast-v0", 5, 0.2, "vehicle.speed", lambda s: float(s.vehicle.speed)),
    Case(
        "highway_env:parking-v0",
        3,
        1 / 15,
        "vehicle.position[1]",
        lambda s: float(s.vehicle.position[1]),
    ),
]
MUJOCO = [case for case in CASES if not case.env_id.startswith("highway")]


def item(*chosen: Case) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("case", chosen, ids=lambda case: case.env_id.split(":")[-1])


cases = item(*CASES)


def frames_of(case: Case, seed: int, steps: int) -> list[float]:
    """Return the states of a simulation at reset and after every step of its own, run by hand."""
    env = case.bare()
    env.reset(seed=seed)
    env.action_space.seed(seed)
    simulation: Any = env.unwrapped
    seen = [case.look(simulation)]
    for _ in range(steps):
        action = env.action_space.sample()
        if case in MUJOCO:
            simulation.data.ctrl[:] = action
        for frame in range(case.frames):
            if case in MUJOCO:
                mujoco.mj_step(simulation.model, simulation.data)
            else:
                if frame == 0:
                    simulation.action_type.act(action)
                simulation.road.act()
                simulation.road.step(case.period)
            seen.append(case.look(simulation))
    env.close()
    return seen


STEPS = 6


@cases
def test_samples_are_those_of_the_simulation_run_by_hand(case: Case) -> None:
    text = f"eventually[0:{2 * case.frames}](always(x > 0)) or always(x < 3)"
    env = case.monitored(text, period=1, on_violation="report", details=True)
    _, info = env.reset(seed=7)
    env.action_space.seed(7)
    seen = frames_of(case, 7, STEPS)
    judge = rtamt.EpisodeMonitor(text, period=1)
    judge.update(x=seen[0])
    for step in range(STEPS + 1):
        assert env.get_wrapper_attr("samples") == judge.samples == 1 + step * case.frames
        state = {"robustness": judge.robustness, "lower": judge.lower, "upper": judge.upper}
        assert info["stl"]["spec"] == {**state, "verdict": judge.verdict.name}
        assert info["robustness"] == judge.robustness
        assert (info["stl_lower"], info["stl_upper"]) == (judge.lower, judge.upper)
        if step == STEPS:
            break
        ended = env.step(env.action_space.sample())
        info = ended[4]
        for value in seen[judge.samples : judge.samples + case.frames]:
            judge.update(x=value)
        if ended[2]:
            assert step >= 2  # a hopper falls early; its trace is complete then
            break
    env.close()


@cases
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_violation_between_frames_is_found_that_frames_alone_miss(case: Case, seed: int) -> None:
    seen = np.array(frames_of(case, seed, 4))
    frames = seen[:: case.frames]
    # A band that the signal crosses between frames: the widest around a sample in between.
    gaps = np.abs(seen[:, None] - frames).min(axis=1)
    center, width = float(seen[gaps.argmax()]), float(gaps.max()) / 2
    assert width > 0.0
    at = int(np.argmax(np.abs(seen - center) < width))
    text = f"const float c = {center}\nconst float w = {width}\nalways(abs(x - c) > w)"
    inside, outside = (
        StlMonitor(case.bare(), text, {"x": case.selector}, substeps=substeps)
        for substeps in (True, False)
    )
    for env in (inside, outside):
        env.reset(seed=seed)
        env.action_space.seed(seed)
    for step in range(1, 5):
        _, _, terminated, _, info = inside.step(inside.action_space.sample())
        assert not outside.step(outside.action_space.sample())[4]["stl_violated"]
        assert terminated == info["stl_violated"] == (step * case.frames >= at)
        if terminated:
            break
    assert step == -(-at // case.frames)
    assert at % case.frames
    assert (info["stl_violated_by"], info["stl_violated_at"]) == ("spec", at)
    assert info["stl_episode"]["spec"]["decided_at"] == at
    assert inside.stl_episodes[-1]["violated_at"] == at
    assert inside.samples == inside.stl_episodes[-1]["samples"] == step * case.frames + 1


@cases
def test_monitoring_inside_changes_nothing_but_the_info(case: Case) -> None:
    bare = rollout(case.bare())
    monitored = rollout(case.monitored(on_violation="report"))
    assert len(bare) == len(monitored)
    for plain, (*rest, info) in zip(bare, monitored, strict=True):
        assert equal(plain[:-1], tuple(rest))
        assert equal(plain[-1], {key: info[key] for key in plain[-1]})


@cases
def test_the_period_is_the_simulations(case: Case) -> None:
    text = f"eventually[0:{round(3 * case.period, 6)}](x > 1e6)"
    env = StlMonitor(case.bare(), text, {"x": case.selector}, substeps=True)
    assert float(env.period or 0) == pytest.approx(case.period)
    env.reset(seed=1)
    while True:
        _, _, terminated, _, info = env.step(env.action_space.sample())
        if terminated:
            break
    assert info["stl_violated_at"] == 3
    env.close()


# The info of Ant-v5 has positions derived before, which are not in MuJoCo's state.
@item(*(case for case in CASES if case.env_id != "Ant-v5"))
@pytest.mark.parametrize("clone", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_in_mid_episode_continues_as_the_original(
    case: Case, clone: Callable[[Env], Env]
) -> None:
    env = case.monitored(on_violation="report", details=True)
    rollout(env, steps=2)
    copy = restored(clone(env), env)
    assert copy.get_wrapper_attr("samples") == 1 + 2 * case.frames
    assert equal(continued(copy, 11, 3), continued(env, 11, 3))
    assert copy.get_wrapper_attr("samples") == env.get_wrapper_attr("samples") > 1 + 2 * case.frames


@cases
def test_nothing_stays_behind_between_steps(case: Case) -> None:
    env = case.monitored()
    env.reset(seed=1)
    simulation: Any = env.unwrapped
    for _ in range(2):
        env.step(env.action_space.sample())
        assert "_step_mujoco_simulation" not in vars(simulation)
        assert "step" not in vars(getattr(simulation, "road", simulation))


@cases
def test_environments_run_side_by_side_and_after_resets(case: Case) -> None:
    env, other = case.monitored(on_violation="report"), case.monitored(on_violation="report")
    alone = rollout(case.monitored(on_violation="report"), steps=3)
    for _ in range(2):
        for item in (env, other):
            item.reset(seed=7)
            item.action_space.seed(7)
        for _, _, _, _, info in alone[1:]:
            for item in (env, other):
                assert equal(item.step(item.action_space.sample())[4], info)


@item(CASES[0], CASES[5])
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
def test_gymnasium_finds_no_fault_and_makes_it_again(case: Case) -> None:
    env = case.monitored(on_violation="report")
    check_env(env, skip_render_check=True)
    expected = rollout(env, steps=3)
    assert env.spec is not None
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec)
        assert str(again) == str(env)
        assert equal(rollout(again, steps=3), expected)
        assert again.get_wrapper_attr("samples") == 1 + 3 * case.frames


def test_the_action_holds_during_a_step() -> None:
    env = StlMonitor(
        gym.make("HalfCheetah-v5"),
        "always(u < 0.5) and eventually(u > 2)",
        {"u": ("action[0]", 3.0)},
        substeps=True,
        on_violation="report",
    )
    env.reset(seed=1)
    action = np.full(6, 0.25, np.float32)
    assert env.step(action)[4]["robustness"] == -2.5
    judge = env.monitors["spec"][1]
    assert judge.samples == 6
    # Only sample 0 has the default.
    assert judge.verdict is rtamt.Verdict.VIOLATED


SEEN: list[tuple[Any, ...]] = []


def depth(step: Step) -> float:
    SEEN.append((step.obs, step.action is None, step.reward, step.info))
    return float(step.env.unwrapped.data.qpos[1])


def test_a_callable_finds_the_simulation_in_the_environment() -> None:
    SEEN.clear()
    env = StlMonitor(gym.make("HalfCheetah-v5"), "always(x > -9)", {"x": depth}, substeps=True)
    env.reset(seed=1)
    env.step(env.action_space.sample())
    env.step(env.action_space.sample())
    assert SEEN == [(None, True, None, {})] + [(None, False, None, {})] * 10


def test_the_reward_may_speak_of_the_simulation_too() -> None:
    case = CASES[0]
    env: Any = StlReward(
        case.bare(),
        "always(abs(x) < 3)",
        {"x": case.selector},
        mode="replace",
        clip=5.0,
        substeps=True,
        observe="state",
        on_violation="report",
    )
    env.reset(seed=7)
    env.action_space.seed(7)
    seen = frames_of(case, 7, 3)
    for step in range(1, 4):
        _, reward, *_ = env.step(env.action_space.sample())
        assert reward == min(3.0 - abs(value) for value in seen[: step * case.frames + 1])
    assert env.samples == 16


def test_the_step_view_takes_every_sample() -> None:
    case = CASES[0]
    text = "x > 0.5 implies eventually[0:0.03](x < 0)"
    env = StlMonitor(
        case.bare(), text, {"x": case.selector}, substeps=True, view="step", on_violation="report"
    )
    env.reset(seed=7)
    env.action_space.seed(7)
    online = rtamt.Monitor(text, period=0.01)
    expected = [online.update(x=value) for value in frames_of(case, 7, 8)]
    for step in range(1, 9):
        info = env.step(env.action_space.sample())[4]
        assert info["robustness"] == expected[step * case.frames]


def test_environments_of_a_vector_are_wrapped_one_by_one() -> None:
    case = CASES[0]

    def wrap(env: Env) -> StlMonitor[Any, Any]:
        return StlMonitor(env, "always(abs(x) < 1e6)", {"x": case.selector}, substeps=True)

    envs = gym.make_vec(case.env_id, 2, vectorization_mode="sync", wrappers=[wrap])
    envs.reset(seed=7)
    envs.action_space.seed(7)
    envs.step(envs.action_space.sample())
    assert [env.samples for env in envs.unwrapped.envs] == [6, 6]  # type: ignore[attr-defined]
    envs.close()


class Rebuilt(InvertedPendulumEnv):
    """Builds its simulation again at every reset, as with random models."""

    def reset(self, **arguments: Any) -> Any:
        self.model, self.data = self._initialize_simulation()
        return super().reset(**arguments)


@pytest.mark.parametrize("substeps", [False, True])
def test_a_simulation_that_is_built_anew_is_read_where_it_is_now(substeps: bool) -> None:  # noqa: FBT001
    specs = {"near": "always(abs(x) < 0.5)", "still": "always(abs(v) < 2 or x > 9)"}
    signals = {"x": "joint:slider.qpos", "v": "qvel[1]"}
    shown = []
    for kind in (InvertedPendulumEnv, Rebuilt):
        env = StlMonitor(
            kind(), specs, signals, substeps=substeps, details=True, on_violation="report"
        )
        shown.append([rollout(env, seed=seed) for seed in range(3)])
    assert equal(*shown)
