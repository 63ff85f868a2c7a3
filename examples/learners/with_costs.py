"""A random search that limits the cost of a monitored CartPole, through `CostEnv`.

Run: python examples/learners/with_costs.py
"""

import gymnasium as gym
import numpy as np

from rtamt_gym import CostEnv, StlMonitor

env = CostEnv(
    StlMonitor(
        gym.make("CartPole-v1", max_episode_steps=20),
        "always(abs(x) < 0.12)",
        {"x": "obs[0]"},
        at_termination="failure",
        on_violation="report",
        cost="violation",
    )
)


def ride(weights, seed):
    obs, info = env.reset(seed=seed)
    total, costs, ended = 0.0, 0.0, False
    while not ended:
        action = int(weights @ obs > 0)
        obs, reward, cost, terminated, truncated, info = env.step(action)
        total, costs, ended = total + reward, costs + cost, terminated or truncated
    return total, costs, info["is_success"]


def evaluate(weights):
    return np.mean([ride(weights, seed) for seed in range(5)], axis=0)


# Random search; the price of the cost rises while it is above its limit.
rng = np.random.default_rng(1)
weights, price, limit = np.zeros(4), 0.0, 0.5
total, cost, success = evaluate(weights)
for iteration in range(30):
    tried = weights + rng.normal(size=4)
    found = evaluate(tried)
    if found[0] - price * found[1] > total - price * cost:
        weights, (total, cost, success) = tried, found
    price = max(0.0, price + 0.5 * (cost - limit))
print(f"return {total:.1f}, cost {cost:.2f}, {success:.2f} successful")
env.close()
