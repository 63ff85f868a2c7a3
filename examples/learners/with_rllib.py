"""PPO of RLlib on monitored CartPoles, with metrics of satisfaction and the cost of episodes.

Run: python examples/learners/with_rllib.py
"""

import gymnasium as gym
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.tune.registry import register_env

from rtamt_gym import StlMonitor
from rtamt_gym.learners.rllib import SatisfactionCallback


class Costs(RLlibCallback):
    def on_episode_end(self, *, episode, metrics_logger, **kwargs):
        cost = sum(info["cost"] for info in episode.get_infos()[1:])
        metrics_logger.log_value("cost", cost, window=100)  # a mean over the last 100 episodes


def make_env(config):
    return StlMonitor(
        gym.make("CartPole-v1", max_episode_steps=20),
        "always(abs(x) < 0.12)",
        {"x": "obs[0]"},
        at_termination="failure",
        on_violation="report",
        cost="violation",
    )


register_env("monitored-cart", make_env)
config = (
    PPOConfig()
    .environment("monitored-cart")
    .env_runners(num_env_runners=0, num_envs_per_env_runner=2)
    .evaluation(evaluation_interval=1, evaluation_duration=20)
    .callbacks([SatisfactionCallback, Costs])
    .training(train_batch_size_per_learner=512, minibatch_size=64, num_epochs=1)
    .debugging(seed=1)
)
algorithm = config.build_algo()
result = algorithm.train()
for name, value in result["stl"].items():
    print(name, value)
print("evaluated", result["evaluation"]["stl"]["satisfied"])
print(f"cost {result['env_runners']['cost']:.2f} an episode")
algorithm.stop()
ray.shutdown()
