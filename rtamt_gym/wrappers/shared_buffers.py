"""`SharedBuffers`: monitored environments of PufferLib for its learners."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from rtamt import InputError, StateError
from rtamt_gym.wrappers.vector_forms import PufferVectorEnv

__all__ = ["SharedBuffers"]


class SharedBuffers:
    """Shows environments of PufferLib below a monitor as a vector environment of PufferLib again.

    PufferLib's environments write observations, rewards and flags into arrays that the learner
    reads. The monitor reads these arrays, and what it changes is written into them: the rewards of
    :class:`VectorStlReward` take the place of the environments' own. Nothing is copied. The
    learner's calls, ``async_reset``, ``recv`` and ``send``, and ``reset`` and ``step``, give what
    PufferLib gives. Every other attribute is that of PufferLib's vector environment.

    The list of infos has one dictionary more at steps that end episodes, whose values have a number
    for each of these: ``stl/satisfied`` (0 or 1) and ``stl/robustness`` of all requirements, and
    ``stl/NAME/satisfied`` and ``stl/NAME/robustness`` of each. PufferLib's learner logs their
    means.

    ``send`` waits until the environments have stepped.

    Args:
        envs: A :class:`VectorStlMonitor` or :class:`VectorStlReward` around what
            ``pufferlib.vector.make`` gives, also in other wrappers.

    Raises:
        InputError: If there is no environment of PufferLib in it, or if its observations are others
            than those in the shared array, as with ``observe=``.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        shared = getattr(envs, "unwrapped", None)
        if not isinstance(shared, PufferVectorEnv):
            raise InputError(
                f"expected a VectorStlMonitor or VectorStlReward around environments of PufferLib, "
                f"got {envs!r}"
            )
        if envs.single_observation_space != shared.single_observation_space:
            raise InputError(
                "expected the observations of the shared array, of "
                f"{shared.single_observation_space}, got {envs.single_observation_space}; leave "
                "observe= out, or put StlReward around each environment"
            )
        self.envs = envs
        self._shared = shared
        self._newest: tuple[Any, ...] | None = None

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        if name.startswith("__") or name == "_shared":  # of a protocol that is asked for
            raise AttributeError(name)
        return getattr(self._shared.adapted, name)

    def async_reset(self, seed: int | list[int] | None = None) -> None:
        """Resets all environments; `recv` gives the observations."""
        given: Any = seed
        obs, _ = self.envs.reset(seed=given)
        self._keep(obs, self._shared.infos)

    def send(self, actions: Any) -> None:  # noqa: ANN401
        """Steps all environments; `recv` gives what they show."""
        obs, rewards, terminated, truncated, infos = self.envs.step(actions)
        shared = self._shared
        _write(shared.rewards, rewards)
        _write(shared.terminated, terminated)
        _write(shared.truncated, truncated)
        ended = np.logical_or(terminated, truncated)
        self._keep(obs, [*shared.infos, *_told(infos, ended)])

    def recv(self) -> tuple[Any, ...]:
        """Observations, rewards, terminals, truncations, infos, numbers of agents, masks.

        Raises:
            StateError: Before the first reset.
        """
        if self._newest is None:
            raise StateError("expected running episodes, got recv() before a reset")
        return self._newest

    def reset(self, seed: int | list[int] | None = None) -> tuple[Any, list[Any]]:
        """Resets all environments; returns observations and infos."""
        self.async_reset(seed)
        obs, *_, infos, _, _ = self.recv()
        return obs, infos

    def step(self, actions: Any) -> tuple[Any, ...]:  # noqa: ANN401
        """Steps all environments; returns the first five of what `recv` returns."""
        self.send(actions)
        return self.recv()[:5]

    def close(self) -> None:
        """Closes the environments."""
        self.envs.close()

    def _keep(self, obs: Any, infos: list[Any]) -> None:  # noqa: ANN401
        shared = self._shared
        flags = shared.terminated, shared.truncated
        num = shared.num_envs
        ids = np.arange(num)
        self._newest = obs, shared.rewards, *flags, infos, ids, np.ones(num, np.bool_)


def _write(shared: Any, given: Any) -> None:  # noqa: ANN401
    if given is not shared:
        shared[...] = given


def _told(infos: dict[str, Any], ended: Any) -> list[dict[str, list[float]]]:  # noqa: ANN401
    """What the list of infos has more, for the episodes that have ended."""
    if not ended.any():
        return []
    last = infos.get("final_info", infos)
    found = {"satisfied": last["stl_success"], "robustness": last["robustness"]}
    for name, each in last["stl_episode"].items():
        if not name.startswith("_"):
            found |= {f"{name}/{key}": each[key] for key in ("satisfied", "robustness")}
    return [{f"stl/{key}": each[ended].astype(float).tolist() for key, each in found.items()}]
