"""PPO in the style of CleanRL on a monitored CartPole, which keeps the weights that satisfy most.

Run: python examples/learners/with_cleanrl.py
"""

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

from rtamt_gym import StlMonitor, evaluate_policy
from rtamt_gym.learners.best import Best
from rtamt_gym.learners.metrics import Satisfaction, ended_episodes

num_envs, num_steps, iterations, gamma, gae_lambda, clip = 4, 64, 8, 0.99, 0.95, 0.2


def make_env():
    env = gym.make("CartPole-v1", max_episode_steps=20)
    env = StlMonitor(
        env,
        "always(abs(x) < 0.12)",
        {"x": "obs[0]"},
        at_termination="failure",
        on_violation="report",
        cost="violation",
    )
    return gym.wrappers.RecordEpisodeStatistics(env)


torch.manual_seed(1)
envs = gym.vector.SyncVectorEnv(
    [make_env] * num_envs, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP
)
actor = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 2))
critic = nn.Sequential(nn.Linear(4, 32), nn.Tanh(), nn.Linear(32, 1))
optimizer = torch.optim.Adam([*actor.parameters(), *critic.parameters()], lr=3e-3)


def act(obs):
    return int(actor(torch.as_tensor(obs)).argmax())


training, best = Satisfaction(window=100, period=0.02), Best()
returns, successes, episode_costs = [], [], []
costs = np.zeros(num_envs)
obs, _ = envs.reset(seed=1)
done = np.zeros(num_envs, bool)
for iteration in range(iterations):
    batch = {key: [] for key in ("obs", "action", "logprob", "value", "reward", "done")}
    for step in range(num_steps):
        seen = torch.as_tensor(obs)
        with torch.no_grad():
            choice = Categorical(logits=actor(seen))
            action = choice.sample()
            value = critic(seen).squeeze(-1)
        obs, reward, terminated, truncated, infos = envs.step(action.numpy())
        found = (seen, action, choice.log_prob(action), value, torch.as_tensor(reward), done)
        for column, entry in zip(batch.values(), found):
            column.append(torch.as_tensor(entry))
        done = terminated | truncated
        costs += np.where(done, 0.0, infos.get("cost", 0.0))
        if done.any():
            last = infos["final_info"]
            costs[done] += last["cost"][done]
            returns += last["episode"]["r"][done].tolist()
            successes += last["is_success"][done].tolist()
            episode_costs += costs[done].tolist()
            costs[done] = 0.0
        for episode in ended_episodes(infos, done):
            training.add(episode)

    b = {key: torch.stack(column) for key, column in batch.items()}
    advantages = torch.zeros(num_steps, num_envs)
    with torch.no_grad():
        next_value, next_done = critic(torch.as_tensor(obs)).squeeze(-1), torch.as_tensor(done)
        advantage = torch.zeros(num_envs)
        for t in reversed(range(num_steps)):
            delta = b["reward"][t] + gamma * next_value * ~next_done - b["value"][t]
            advantages[t] = advantage = delta + gamma * gae_lambda * ~next_done * advantage
            next_value, next_done = b["value"][t], b["done"][t]
    for epoch in range(4):
        choice = Categorical(logits=actor(b["obs"]))
        ratio = (choice.log_prob(b["action"]) - b["logprob"]).exp()
        gain = torch.min(ratio * advantages, ratio.clamp(1 - clip, 1 + clip) * advantages)
        error = critic(b["obs"]).squeeze(-1) - (advantages + b["value"])
        loss = -gain.mean() + 0.5 * error.square().mean() - 0.01 * choice.entropy().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    for name, value in training.metrics().items():
        print(f"stl/{name}", value)  # writer.add_scalar(f"stl/{name}", value, global_step)
    found = evaluate_policy(act, make_env, episodes=20, seed=10_000, keep=0)
    if best.add(found):
        torch.save(actor.state_dict(), "best.pt")
    print(f"evaluated: {found.success.rate:.2f} successful, {found.returns.mean():.1f} return")
print(f"{np.mean(successes):.2f} successful, cost {np.mean(episode_costs):.2f} an episode")
envs.close()
