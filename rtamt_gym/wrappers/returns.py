"""What statistics of episodes say of the return: the sum of the rewards that the learner was paid.

Wrappers that count episodes inside of a reward count the rewards of the environment. Learners read
``info["episode"]["r"]`` as their own progress, so the reward puts its own sum there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rtamt_gym.judging.infos import Lanewise
from rtamt_gym.judging.vector_infos import key_mask
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["put_return", "put_returns"]


def put_return(info: dict[str, Any], paid: float) -> bool:
    """Puts the return into the last info of an episode; returns whether statistics are there.

    Example:
        >>> info = {"episode": {"r": 12.0, "l": 12}}
        >>> put_return(info, 3.5)
        True
        >>> info
        {'episode': {'r': 3.5, 'l': 12, 'r_env': 12.0}}
    """
    episode = _statistics(info)
    if episode is not None:
        info["episode"] = _paid(episode, paid)
    return episode is not None


def put_returns(infos: dict[str, Any], paid: Floats, ended: Lanes) -> None:
    """Puts the returns of the environments that ended into their last infos."""
    episode = _statistics(infos)
    if episode is None:
        return
    num = len(ended)
    counted = ended & key_mask(infos, "episode", num) & key_mask(episode, "r", num)
    returns = np.array(episode["r"], np.float64)
    returns[counted] = paid[counted]
    infos["episode"] = made = _paid(episode, returns)
    if "_r" in episode:
        made.setdefault("_r_env", episode["_r"])


def _statistics(infos: dict[str, Any]) -> dict[str, Any] | None:
    episode = infos.get("episode")
    return episode if isinstance(episode, dict) and "r" in episode else None


def _paid(episode: dict[str, Any], paid: Lanewise) -> dict[str, Any]:
    # A copy: the wrapper that made the statistics may keep them.
    return {**episode, "r": paid, "r_env": episode.get("r_env", episode["r"])}
