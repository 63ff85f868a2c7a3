"""The cost of a monitor in a step of MJX and of gymnax, both in one compiled function.

Run: python tests/bench/arrays/simulators.py; the argument mjx or gymnax selects one of them.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import gymnax
import jax
from brax import envs
from brax.envs.wrappers.training import AutoResetWrapper, EpisodeWrapper, VmapWrapper

from rtamt_arrays.jax.brax import StlWrapper
from rtamt_arrays.jax.gymnax import StlEnvironment

RUNS = 30
STEPS = {"mjx": 10, "gymnax": 50}


def brax_steps(entries: int, spec: str | None, options: dict[str, Any]) -> Callable[[], Any]:
    """Run inverted_pendulum in MJX."""
    env: Any = envs.get_environment("inverted_pendulum", backend="mjx")
    env = EpisodeWrapper(VmapWrapper(env), 200, 1)
    if spec is not None:
        env = StlWrapper(env, spec, {"angle": "obs[1]"}, on_violation="report", period=1, **options)
    env = AutoResetWrapper(env)
    action = jax.numpy.zeros((entries, 1))
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), entries))

    def step(state: Any, _: None) -> tuple[Any, None]:
        return env.step(state, action), None

    def rolled(state: Any) -> Any:
        last = jax.lax.scan(step, state, None, STEPS["mjx"])[0]
        return last.obs, *(last.info[key] for key in READ if key in last.info)

    run = jax.jit(rolled)
    return lambda: run(state)  # an argument, because XLA evaluates constants while it compiles


def gymnax_steps(entries: int, spec: str | None, options: dict[str, Any]) -> Callable[[], Any]:
    """Run CartPole in gymnax."""
    env, params = gymnax.make("CartPole-v1")
    if spec is not None:
        env = StlEnvironment(
            env, spec, {"angle": "obs[2]"}, on_violation="report", period=1, **options
        )
    keys = jax.random.split(jax.random.key(0), entries)
    _, state = jax.vmap(env.reset, in_axes=(0, None))(keys, params)

    def step(state: Any, key: Any) -> tuple[Any, Any]:
        made = jax.vmap(env.step, in_axes=(0, 0, None, None))(
            jax.random.split(key, entries), state, 1, params
        )
        return made[1], [made[5].get(key, made[2]).sum() for key in READ]

    keys = jax.random.split(jax.random.key(1), STEPS["gymnax"])
    run = jax.jit(lambda state, keys: jax.lax.scan(step, state, keys))
    return lambda: run(state, keys)


READ = ("robustness", "stl_lower", "stl_upper", "stl_success", "cost")
"""The info keys that are returned, so that no compiler removes their computation."""
ALWAYS = "always(abs(angle) < 0.2)"
RESPONSE = "always((angle > 0.1) implies eventually[0:5](angle < 0.1))"
CASES: dict[str, tuple[str | None, dict[str, Any]]] = {
    "none": (None, {}),
    "always": (ALWAYS, {}),
    "response, complete": (RESPONSE, {"at_truncation": "complete"}),
    "response, cut": (RESPONSE, {}),
    "response, cut, cost": (RESPONSE, {"cost": "violation"}),
}


def main() -> None:
    """Print nanoseconds per entry and step, the minimum of several runs."""
    for name, rollout, many in (
        ("mjx", brax_steps, (256,)),
        ("gymnax", gymnax_steps, (1024, 4096)),
    ):
        for entries in many if name in (sys.argv[1:] or name) else ():
            for label, (spec, options) in CASES.items():
                run = rollout(entries, spec, options)
                jax.block_until_ready(run())
                times = []
                for _ in range(RUNS):
                    begin = time.perf_counter()
                    jax.block_until_ready(run())
                    times.append(time.perf_counter() - begin)
                per_step = min(times) / entries / STEPS[name]
                print(name, entries, label, round(per_step * 1e9), flush=True)


if __name__ == "__main__":
    main()
