"""An actor-critic on a monitored vector of PufferLib.

Run: python examples/learners/with_pufferlib.py
"""

import gymnasium as gym
import numpy as np
import pufferlib.emulation
import pufferlib.vector
import torch
from torch import nn
from torch.distributions import Categorical

from rtamt_gym import VectorStlReward
from rtamt_gym.wrappers import SharedBuffers

num_envs, num_steps, iterations, gamma = 8, 64, 8, 0.99


def make_env():
    env = gym.make("CartPole-v1", max_episode_steps=20)
    return pufferlib.emulation.GymnasiumPufferEnv(env)


torch.manual_seed(1)
vecenv = pufferlib.vector.make(make_env, num_envs=num_envs, backend=pufferlib.vector.Serial)
envs = VectorStlReward(
    vecenv, "always(abs(x) < 0.12)", {"x": "obs[0]"}, mode="add", at_termination="failure"
)
vecenv = SharedBuffers(envs)

actor = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 2))
critic = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 1))
optimizer = torch.optim.Adam([*actor.parameters(), *critic.parameters()], lr=3e-3)
satisfied, robustness = [], []
vecenv.async_reset(1)
for iteration in range(iterations):
    batch, done = [], np.zeros(num_envs, bool)
    for step in range(num_steps):
        obs, reward, terminals, truncations, infos, env_id, mask = vecenv.recv()
        for info in infos:
            satisfied += info.get("stl/satisfied", [])
            robustness += info.get("stl/robustness", [])
        seen = torch.tensor(obs)  # a copy: the next step writes over the array
        with torch.no_grad():
            action = Categorical(logits=actor(seen)).sample()
        batch.append((seen, action, torch.tensor(reward), torch.tensor(terminals | truncations)))
        vecenv.send(action.numpy())

    # The reward and the flags next to an observation belong to the action before it.
    seen, actions, rewards, ended = (torch.stack(each) for each in zip(*batch))
    goal, goals = critic(seen[-1]).squeeze(-1).detach(), []
    for reward, over in zip(rewards[1:].flip(0), ended[1:].flip(0)):
        goal = reward + gamma * ~over * goal
        goals.insert(0, goal)
    error = torch.stack(goals) - critic(seen[:-1]).squeeze(-1)
    gain = Categorical(logits=actor(seen[:-1])).log_prob(actions[:-1]) * error.detach()
    counts = ~ended[:-1]  # after an end a step only resets
    loss = (counts * (0.5 * error.square() - gain)).sum() / counts.sum()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    print(f"{np.mean(satisfied[-100:]):.2f} satisfied, robustness {np.mean(robustness[-100:]):.3f}")
vecenv.close()
