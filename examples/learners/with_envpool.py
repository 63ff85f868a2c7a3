"""An actor-critic on a monitored vector of EnvPool.

Run: python examples/learners/with_envpool.py
"""

import envpool
import numpy as np
import torch
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from torch import nn
from torch.distributions import Categorical

from rtamt_gym import VectorStlReward
from rtamt_gym.learners.metrics import Satisfaction, ended_episodes

num_envs, num_steps, iterations, gamma = 16, 64, 8, 0.99
pool = envpool.make_gymnasium("CartPole-v1", num_envs=num_envs, seed=1, max_episode_steps=20)
envs = VectorStlReward(
    pool,
    "always(abs(x) < 0.12)",
    {"x": "obs[0]"},
    mode="add",
    at_termination="failure",
    cost="violation",
)
envs = RecordEpisodeStatistics(envs)

torch.manual_seed(1)
actor = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 2))
critic = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 1))
optimizer = torch.optim.Adam([*actor.parameters(), *critic.parameters()], lr=3e-3)
training = Satisfaction(window=100, period=0.02)
returns, successes, cost = [], [], 0.0
obs, _ = envs.reset()
done = np.zeros(num_envs, bool)
for iteration in range(iterations):
    batch = []
    for step in range(num_steps):
        seen = torch.as_tensor(obs)
        with torch.no_grad():
            action = Categorical(logits=actor(seen)).sample()
        resets = done  # this step only resets these environments: it belongs to no episode
        obs, reward, terminated, truncated, infos = envs.step(action.numpy())
        done = terminated | truncated
        batch.append((seen, action, torch.as_tensor(reward).float(), ~done, ~resets))
        cost += infos["cost"].sum()
        if done.any():
            returns += infos["episode"]["r"][done].tolist()
            successes += infos["is_success"][done].tolist()
        for episode in ended_episodes(infos, done):
            training.add(episode)

    seen, actions, rewards, goes_on, counts = (
        torch.as_tensor(np.array(each)) for each in zip(*batch)
    )
    goal, goals = critic(torch.as_tensor(obs)).squeeze(-1).detach(), []
    for reward, more in zip(rewards.flip(0), goes_on.flip(0)):
        goal = reward + gamma * more * goal
        goals.insert(0, goal)
    error = torch.stack(goals) - critic(seen).squeeze(-1)
    gain = Categorical(logits=actor(seen)).log_prob(actions) * error.detach()
    loss = (counts * (0.5 * error.square() - gain)).sum() / counts.sum()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    print(f"{training.metrics()['satisfied']:.2f} satisfied, return {np.mean(returns[-100:]):.1f}")
envs.close()
