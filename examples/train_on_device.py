"""A cart that must visit a place, learned on the device: simulator, monitor and PPO in one jit.

The cart of gymnax's CartPole must reach x > 0.3 once and stay within 0.8. A violation ends the
episode. The observation has the state of the monitors, which shows whether the cart has been there.
Every step adds the robustness so far to the reward of CartPole. Afterwards the last policy plays in
Gymnasium's CartPole under `rtamt_gym.evaluate_policy`, with the same specifications.

Run: pip install '.[gym,gymnax]' && python examples/train_on_device.py --seeds 10
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import gymnax
import jax
import jax.numpy as jnp
import numpy as np

import rtamt_gym
from rtamt_arrays.jax.gymnax import StlEnvironment

SPECS = {"visit": "eventually(x > 0.3)", "inside": "always(abs(x) < 0.8)"}
SIGNALS = {"x": "obs[0]"}
GAMMA = 0.99
ENTRIES, STEPS, UPDATES, EPOCHS, BATCHES = 64, 64, 500, 4, 4
HIDDEN = 64
FIRST_RUN, FIRST_EPISODE, EPISODES = 61_000, 62_000, 200  # seeds, fixed before the first run

Parameters = Any
"""Weights and biases of each layer of the actor and of the critic."""


class Transition(NamedTuple):
    """A step of all entries."""

    obs: jax.Array
    action: jax.Array
    log_probability: jax.Array
    value: jax.Array
    reward: jax.Array
    over: jax.Array
    success: jax.Array


def make_env() -> tuple[Any, Any]:
    """Return the monitored environment and its parameters.

    The reward of a step is 1 plus twice the robustness so far. Until the visit this is the
    robustness of `visit`, at least -0.35, so survival pays; afterwards, it is the smaller of both,
    which are positive.
    """
    env, params = gymnax.make("CartPole-v1")
    return StlEnvironment(
        env,
        SPECS,
        SIGNALS,
        on_violation="terminate",
        at_termination="failure",
        at_truncation="open",  # the learner and the bounds continue beyond a time limit
        observe="state",
        mode="add",
        weight=2.0,
    ), params


def layers(key: jax.Array, sizes: tuple[int, ...], last: float) -> Parameters:
    """Return orthogonal weights, scaled in the last layer, and biases of 0."""
    keys = jax.random.split(key, len(sizes) - 1)
    scales = [2.0**0.5] * (len(sizes) - 2) + [last]
    return [
        (jax.nn.initializers.orthogonal(scale)(k, (n, m)), jnp.zeros(m))
        for k, scale, n, m in zip(keys, scales, sizes[:-1], sizes[1:], strict=True)
    ]


def output(parameters: Parameters, x: jax.Array) -> jax.Array:
    """Return the output of layers."""
    for weight, bias in parameters[:-1]:
        x = jnp.tanh(x @ weight + bias)
    weight, bias = parameters[-1]
    return x @ weight + bias


def train(key: jax.Array) -> tuple[Parameters, jax.Array]:
    """Train from scratch; return the parameters and the rate of satisfied episodes per update."""
    env, params = make_env()
    size = env.observation_space(params).shape[0]
    key, first, actor, critic = jax.random.split(key, 4)
    policy = {
        "actor": layers(actor, (size, HIDDEN, HIDDEN, env.num_actions), 0.01),
        "critic": layers(critic, (size, HIDDEN, HIDDEN, 1), 1.0),
    }
    zero = jax.tree.map(jnp.zeros_like, policy)
    obs, state = jax.vmap(env.reset, in_axes=(0, None))(jax.random.split(first, ENTRIES), params)

    def play(carried: Any, key: jax.Array) -> tuple[Any, Transition]:
        policy, obs, state = carried
        choice, steps = jax.random.split(key)
        logits = output(policy["actor"], obs)
        action = jax.random.categorical(choice, logits)
        following, state, reward, terminated, truncated, info = jax.vmap(
            env.step, in_axes=(0, 0, 0, None)
        )(jax.random.split(steps, ENTRIES), state, action, params)
        value = output(policy["critic"], obs)[:, 0]
        limit = truncated & ~terminated
        # A time limit does not end the task: the value of the last state replaces later rewards.
        beyond = output(policy["critic"], info["final_observation"])[:, 0]
        # Scale rewards so that values are about 1: the critic starts at 0.
        reward = (1.0 - GAMMA) * reward + GAMMA * beyond * limit
        transition = Transition(
            obs,
            action,
            log_probability(logits, action),
            value,
            reward,
            terminated | truncated,
            limit & (info["robustness"] > 0.0),
        )
        return (policy, following, state), transition

    def update(carried: Any, key: jax.Array) -> tuple[Any, jax.Array]:
        policy, moments, count, obs, state = carried
        playing, shuffling = jax.random.split(key)
        (_, obs, state), steps = jax.lax.scan(
            play, (policy, obs, state), jax.random.split(playing, STEPS)
        )
        advantage = advantages(steps, output(policy["critic"], obs)[:, 0])
        data = (steps.obs, steps.action, steps.log_probability, advantage, advantage + steps.value)
        flat = jax.tree.map(lambda x: x.reshape(ENTRIES * STEPS, *x.shape[2:]), data)

        def learn(carried: Any, rows: jax.Array) -> tuple[Any, None]:
            policy, moments, count = carried
            gradient = jax.grad(loss)(policy, *jax.tree.map(lambda x: x[rows], flat))
            return adam(policy, moments, count, gradient), None

        orders = [
            jax.random.permutation(k, ENTRIES * STEPS).reshape(BATCHES, -1)
            for k in jax.random.split(shuffling, EPOCHS)
        ]
        (policy, moments, count), _ = jax.lax.scan(
            learn, (policy, moments, count), jnp.concatenate(orders)
        )
        rate = steps.success.sum() / jnp.maximum(steps.over.sum(), 1)
        return (policy, moments, count, obs, state), rate

    start = (policy, (zero, zero), jnp.zeros(()), obs, state)
    (policy, *_), rates = jax.lax.scan(update, start, jax.random.split(key, UPDATES))
    return policy, rates


def log_probability(logits: jax.Array, action: jax.Array) -> jax.Array:
    """Return the log-probabilities of actions."""
    every = jax.nn.log_softmax(logits)
    return jnp.take_along_axis(every, action[..., None], axis=-1)[..., 0]


def advantages(steps: Transition, last: jax.Array) -> jax.Array:
    """Return generalized advantages, with a factor of 0.95."""

    def back(carried: Any, step: Transition) -> tuple[Any, jax.Array]:
        advantage, following = carried
        goes_on = 1.0 - step.over
        error = step.reward + GAMMA * following * goes_on - step.value
        advantage = error + GAMMA * 0.95 * goes_on * advantage
        return (advantage, step.value), advantage

    return jax.lax.scan(back, (jnp.zeros_like(last), last), steps, reverse=True)[1]


def loss(
    policy: Parameters,
    obs: jax.Array,
    action: jax.Array,
    before: jax.Array,
    advantage: jax.Array,
    target: jax.Array,
) -> jax.Array:
    """Return the clipped loss of PPO, with the loss of the critic and a bonus for entropy."""
    logits = output(policy["actor"], obs)
    ratio = jnp.exp(log_probability(logits, action) - before)
    scaled = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    gain = jnp.minimum(ratio * scaled, jnp.clip(ratio, 0.8, 1.2) * scaled).mean()
    error = jnp.square(output(policy["critic"], obs)[:, 0] - target).mean()
    chances = jax.nn.softmax(logits)
    entropy = -(chances * jax.nn.log_softmax(logits)).sum(axis=-1).mean()
    return -gain + 0.5 * error - 0.01 * entropy


def adam(policy: Parameters, moments: Any, count: jax.Array, gradient: Parameters) -> Any:
    """Return a step of Adam, with a falling rate and gradients of at most norm 0.5."""
    norm = jnp.sqrt(sum(jnp.square(g).sum() for g in jax.tree.leaves(gradient)))
    gradient = jax.tree.map(lambda g: g * jnp.minimum(1.0, 0.5 / (norm + 1e-8)), gradient)
    count = count + 1.0
    mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, moments[0], gradient)
    square = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, moments[1], gradient)
    rate = 1e-3 * (1.0 - count / (UPDATES * EPOCHS * BATCHES + 1))

    def step(p: jax.Array, m: jax.Array, v: jax.Array) -> jax.Array:
        return p - rate * (m / (1 - 0.9**count)) / (jnp.sqrt(v / (1 - 0.999**count)) + 1e-8)

    return jax.tree.map(step, policy, mean, square), (mean, square), count


def evaluate(policy: Parameters) -> rtamt_gym.results.Evaluation:
    """Evaluate the most likely actions in Gymnasium's CartPole, with the C++ monitors."""
    actor = jax.tree.map(np.asarray, policy["actor"])

    def act(obs: Any) -> int:
        x = np.asarray(obs, np.float32)
        for weight, bias in actor[:-1]:
            x = np.tanh(x @ weight + bias)
        weight, bias = actor[-1]
        return int(np.argmax(x @ weight + bias))

    env: gym.Env[Any, Any] = gym.make("CartPole-v1")
    env = rtamt_gym.StlMonitor(
        env, SPECS, SIGNALS, on_violation="terminate", at_termination="failure", observe="state"
    )
    return rtamt_gym.evaluate_policy(act, env, episodes=EPISODES, seed=FIRST_EPISODE)


def main() -> None:
    """Train and evaluate each seed, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--seeds", type=int, default=10, help="number of runs, each with its own seed"
    )
    learn: Callable[[jax.Array], Any] = jax.jit(train)
    for seed in range(FIRST_RUN, FIRST_RUN + parser.parse_args().seeds):
        begin = time.perf_counter()
        policy, rates = jax.block_until_ready(learn(jax.random.key(seed)))
        seconds = time.perf_counter() - begin
        print(f"seed {seed}: {seconds:.0f} s, in training {float(rates[-10:].mean()):.0%}")
        print(evaluate(policy))


if __name__ == "__main__":
    main()
