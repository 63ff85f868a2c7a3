"""PPO of TorchRL on a monitored CartPole, which keeps the weights that satisfy most.

Run: python examples/learners/with_torchrl.py
"""

import gymnasium as gym
import numpy as np
import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Unbounded
from torchrl.envs import (
    ExplorationType,
    GymWrapper,
    check_env_specs,
    default_info_dict_reader,
    set_exploration_type,
)
from torchrl.modules import OneHotCategorical, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from rtamt_gym import StlMonitor, evaluate_policy
from rtamt_gym.learners.best import Best
from rtamt_gym.learners.metrics import Satisfaction

training, best = Satisfaction(window=100, period=0.02), Best()


class InfoReader(default_info_dict_reader):
    def __call__(self, info, tensordict):
        if "stl_episode" in info:
            training.add(info["stl_episode"])
        arrays = {key: np.asarray(info[key]) for key in self.keys if key in info}
        return super().__call__(arrays, tensordict)


def make_env():
    return StlMonitor(
        gym.make("CartPole-v1", max_episode_steps=20),
        "always(abs(x) < 0.12)",
        {"x": "obs[0]"},
        at_termination="failure",
        on_violation="report",
        cost="violation",
    )


number, flag = Unbounded((), dtype=torch.float64), Unbounded((), dtype=torch.bool)
env = GymWrapper(make_env())
keys = {"robustness": number, "cost": number, "stl_success": flag, "stl_violated": flag}
env.set_info_dict_reader(InfoReader(list(keys), keys))
check_env_specs(env)

torch.manual_seed(1)
env.set_seed(1)
network = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 2))
actor = ProbabilisticActor(
    TensorDictModule(network, ["observation"], ["logits"]),
    in_keys=["logits"],
    distribution_class=OneHotCategorical,
    return_log_prob=True,
)
critic = ValueOperator(nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 1)))
advantage, loss = GAE(gamma=0.99, lmbda=0.95, value_network=critic), ClipPPOLoss(actor, critic)
optimizer = torch.optim.Adam(loss.parameters(), lr=3e-3)


def act(obs):
    return int(network(torch.as_tensor(obs)).argmax())


for iteration in range(4):
    with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        batch = env.rollout(500, actor, break_when_any_done=False)
    for epoch in range(4):
        advantage(batch)
        losses = loss(batch)
        optimizer.zero_grad()
        sum(losses[f"loss_{part}"] for part in ("objective", "critic", "entropy")).backward()
        optimizer.step()
    for name, value in training.metrics().items():
        print(f"stl/{name}", value)
    found = evaluate_policy(act, make_env, episodes=20, seed=10_000, keep=0)
    if best.add(found):
        torch.save(network.state_dict(), "best.pt")
    print(f"evaluated: {found.success.rate:.2f} successful, {found.returns.mean():.1f} return")

rollout = batch["next"]
done = rollout["done"].squeeze(-1)
print(f"{rollout['stl_success'][done].double().mean():.2f} successful")
print(f"cost {rollout['cost'].sum() / done.sum():.2f} an episode")
env.close()
