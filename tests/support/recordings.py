"""Episodes recorded while they run with a monitor, and the results of the monitor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from rtamt_gym import StlMonitor, StlReward

Raw = dict[str, Any]
OURS = ("robustness", "stl_lower", "stl_upper", "stl_violated")
ENDS = ("stl_success", "stl_undecided")


def record(
    env: gym.Env[Any, Any], seed: int, policy: Callable[[Any], Any], steps: int | None = None
) -> tuple[Raw, Raw]:
    """Return an episode of the inner environment, and the results of the monitor around it.

    Args:
        env: The monitored environment.
        seed: The seed of the reset.
        policy: The action for an observation.
        steps: The number of recorded steps; None records until the end of the episode.
    """
    obs, info = env.reset(seed=seed)
    observed, infos, actions, rewards = [obs], [info], [], []
    flags: list[tuple[bool, bool]] = []
    while not flags or not (any(flags[-1]) or len(flags) == steps):
        actions.append(policy(obs))
        obs, reward, terminated, truncated, info = env.step(actions[-1])
        observed.append(obs)
        rewards.append(float(reward))
        flags.append((terminated, truncated))
        infos.append(info)
    own = [info["reward"] for info in infos[1:]] if "reward" in infos[-1] else rewards
    terminations, truncations = np.array(flags).T
    raw = {
        "observations": _stacked(observed),
        "actions": np.array(actions),
        "rewards": np.array(own),
        "terminations": terminations,
        "truncations": truncations,
        "infos": {
            key: np.array([info[key] for info in infos[1:]])
            for key in ("x_velocity", "crashed")
            if key in infos[-1]
        },
        "seed": seed,
    }
    said: Raw = {key: np.array([info[key] for info in infos]) for key in OURS}
    for key in (*ENDS, "is_success"):
        said[key] = np.array([bool(info.get(key, False)) for info in infos])
    for key in infos[-1]:
        if key.startswith("cost") or key == "reward":
            said[key] = np.array([info.get(key, 0.0) for info in infos])
    said["rewards"] = np.array(rewards)
    last = infos[-1]
    said["outcomes"] = last.get("stl_episode")
    said["violation"] = last.get("stl_violated_by"), last.get("stl_violated_at")
    return raw, said


def monitored(
    env: gym.Env[Any, Any],
    specs: Any,  # noqa: ANN401
    signals: Mapping[str, Any],
    **options: Any,  # noqa: ANN401
) -> gym.Env[Any, Any]:
    """Return the environment with a reward for a mode, otherwise a monitor; no early end."""
    wrapper = StlReward if "mode" in options else StlMonitor
    return wrapper(env, specs, signals, on_violation="report", **options)


def difference(found: Iterable[Any], said: Iterable[Raw]) -> str:
    """Return the first difference of relabelled episodes from the monitor, or an empty text."""
    for episode, expected in zip(found, said, strict=True):
        for key, wanted in expected.items():
            match key:
                case "rewards":
                    same = (
                        episode.rewards.tobytes() == wanted.astype(episode.rewards.dtype).tobytes()
                    )
                case "outcomes":
                    same = wanted is None or repr(episode.outcomes) == repr(_plain(wanted))
                case "violation":
                    same = (episode.violated_by, episode.violated_at) == wanted
                case _:
                    same = episode.infos[key].tobytes() == wanted.tobytes()
            if not same:
                return f"episode {episode.number}: {key}"
    return ""


def _plain(tree: Any) -> Any:  # noqa: ANN401
    """Return the same dictionaries with Python numbers."""
    if isinstance(tree, dict):
        return {key: _plain(value) for key, value in tree.items()}
    return tree.item() if isinstance(tree, np.generic) else tree


def _stacked(observations: list[Any]) -> Any:  # noqa: ANN401
    if isinstance(observations[0], dict):
        return {key: _stacked([each[key] for each in observations]) for key in observations[0]}
    return np.array(observations)
