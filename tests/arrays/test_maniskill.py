"""Wrapped environments of ManiSkill are judged like recorded signals.

Its own tasks need a renderer. A task without a robot and without a picture runs on any machine,
with one environment, because its simulator on processors has only one.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.pose import Pose
from mani_skill.vector.wrappers.gymnasium import ManiSkillVectorEnv

from rtamt import EpisodeMonitor, InputError
from rtamt_arrays.torch.maniskill import StlManiSkillWrapper
from rtamt_gym.signals.signals import SignalLike

SPEC = "always((height < 1) implies eventually[0:0.1](height < 0.9)) and always(height > 0.5)"
LIMIT = 12


@register_env("FallingBall-v1", max_episode_steps=LIMIT)
class FallingBall(BaseEnv):  # type: ignore[misc] # ManiSkill is untyped
    """A ball that falls."""

    SUPPORTED_ROBOTS = ("none",)
    single_action_space = action_space = gym.spaces.Box(-1.0, 1.0, (1,))  # nothing reads it

    def __init__(self, **options: Any) -> None:  # noqa: ANN401
        super().__init__(robot_uids="none", **options)

    def _load_agent(self, options: object) -> None:
        super()._load_agent(options, sapien.Pose())

    def _load_scene(self, _: object) -> None:
        builder = self.scene.create_actor_builder()
        builder.add_sphere_collision(radius=0.05)
        builder.initial_pose = sapien.Pose(p=[0, 0, 1])
        self.ball = builder.build(name="ball")

    def _load_lighting(self, _: object) -> None:
        """Load no light, because nothing is shown."""

    def _initialize_episode(self, env_idx: torch.Tensor, _: object) -> None:
        place = torch.tensor([[0.0, 0.0, 1.1]]).repeat(len(env_idx), 1)
        self.ball.set_pose(Pose.create_from_pq(place))
        self.ball.set_linear_velocity(torch.zeros_like(place))

    def _get_obs_agent(self) -> dict[str, Any]:
        return {}

    def _get_obs_extra(self, _: object) -> dict[str, Any]:
        return {"height": self.ball.pose.p[:, 2:]}

    def get_state_dict(self) -> Any:  # noqa: ANN401
        return self.scene.get_sim_state()

    def evaluate(self) -> dict[str, Any]:
        return {"success": self.ball.pose.p[:, 2] < -1e3}


def made(signal: SignalLike = "obs[0]", **options: Any) -> StlManiSkillWrapper:  # noqa: ANN401
    env = gym.make(
        "FallingBall-v1",
        num_envs=1,
        obs_mode="state",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
    )
    return StlManiSkillWrapper(env, SPEC, {"height": signal}, at_truncation="complete", **options)


def height(step: Any) -> torch.Tensor:  # noqa: ANN401
    found: torch.Tensor = step.state.ball.pose.p[:, 2]
    return found


@pytest.mark.parametrize("signal", ["obs[0]", height])
@pytest.mark.parametrize("on_violation", ["terminate", "truncate", "report"])
def test_episodes_are_judged_as_recorded_signals(signal: SignalLike, on_violation: str) -> None:
    env = made(signal, on_violation=on_violation)
    monitor = EpisodeMonitor(SPEC, period=0.05)
    options: Any
    for options in (None, {"env_idx": torch.tensor([0])}):
        obs, info = env.reset(seed=0, options=options)
        monitor.reset()
        monitor.update({"height": float(obs[0, 0])})
        steps, over = 0, False
        while not over:
            np.testing.assert_allclose(info["robustness"], [monitor.robustness], atol=1e-6)
            obs, _, terminated, truncated, info = env.step(None)
            monitor.update({"height": float(obs[0, 0])})
            violated = np.signbit(monitor.upper)
            assert info["stl_violated"].tolist() == [violated]
            steps, over = steps + 1, bool(terminated | truncated)
        assert violated
        assert (steps < LIMIT) == (on_violation != "report")
        assert terminated.tolist() == [on_violation == "terminate"]
        assert truncated.tolist() == [on_violation != "terminate"]
        assert info["is_success"].tolist() == [False]


def test_vector_restarts_keep_final_infos() -> None:
    env: Any = ManiSkillVectorEnv(made())
    obs, info = env.reset(seed=0)
    monitor, ends = EpisodeMonitor(SPEC, period=0.05), 0
    monitor.update({"height": float(obs[0, 0])})
    while ends < 2:
        obs, _, terminated, _, info = env.step(None)
        if not terminated.any():
            monitor.update({"height": float(obs[0, 0])})
            continue
        ends += 1
        monitor.update({"height": float(info["final_observation"][0, 0])})
        last = info["final_info"]
        assert last["stl_violated"].tolist() == [np.signbit(monitor.upper)] == [True]
        np.testing.assert_allclose(last["robustness"], [monitor.robustness], atol=1e-6)
        monitor.reset()
        monitor.update({"height": float(obs[0, 0])})
        np.testing.assert_allclose(info["robustness"], [monitor.robustness], atol=1e-6)
        assert info["stl_violated_at"].tolist() == [-1]


def test_what_it_does_not_have_is_refused() -> None:
    with pytest.raises(InputError) as error:
        made(observe="state")
    assert str(error.value) == "StlManiSkillWrapper has no observe='state'. Remove the option."
