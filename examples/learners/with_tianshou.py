"""DQN of Tianshou on monitored CartPoles, with successes and costs of episodes.

Run: python examples/learners/with_tianshou.py
"""

import gymnasium as gym
import numpy as np
import tianshou as ts
import torch
from tianshou.algorithm import DQN
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, CollectStats, VectorReplayBuffer
from tianshou.trainer import OffPolicyTrainerParams
from tianshou.utils.net.common import Net

from rtamt_gym import StlMonitor


def without_texts(actions, batch):
    for key in ("stl_episode", "stl_violated_by"):
        batch.info.pop(key, None)


class Statistics(CollectStats):
    successes: tuple[bool, ...] = ()
    costs: tuple[float, ...] = ()

    def update_at_episode_done(self, episode_batch, *args, **kwargs):
        super().update_at_episode_done(episode_batch, *args, **kwargs)
        self.successes += (bool(episode_batch.info.is_success[-1]),)
        self.costs += (float(episode_batch.info.cost.sum()),)


def make_env():
    return StlMonitor(
        gym.make("CartPole-v1", max_episode_steps=20),
        "always(abs(x) < 0.12)",
        {"x": "obs[0]"},
        at_termination="failure",
        on_violation="report",
        cost="violation",
    )


np.random.seed(1)
torch.manual_seed(1)
envs = ts.env.DummyVectorEnv([make_env] * 4)
envs.seed(1)
net = Net(state_shape=(4,), action_shape=2, hidden_sizes=[32])
policy = DiscreteQLearningPolicy(
    model=net, action_space=gym.spaces.Discrete(2), eps_training=0.9, eps_inference=0.9
)
algorithm = DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3), target_update_freq=50)
training = Collector(
    algorithm,
    envs,
    VectorReplayBuffer(2000, 4),
    exploration_noise=True,
    on_step_hook=without_texts,
    collect_stats_class=Statistics,
)
algorithm.run_training(
    OffPolicyTrainerParams(
        training_collector=training,
        max_epochs=1,
        epoch_num_steps=400,
        collection_step_num_env_steps=40,
        update_step_num_gradient_steps_per_sample=0.1,
        batch_size=32,
        show_progress=False,
    )
)
training.reset()
statistics = training.collect(n_episode=40)
print(f"{np.mean(statistics.successes):.2f} successful, cost {np.mean(statistics.costs):.2f}")
envs.close()
