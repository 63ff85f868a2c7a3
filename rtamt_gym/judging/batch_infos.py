"""Infos of vector environments, and their modes of reset.

An info has an array for every key, and a mask ``_key`` of the environments with a value, as in
Gymnasium's `SyncVectorEnv`. Without a value, the array holds zero, or None in an array of objects.
A key without any value is absent; a dictionary of infos becomes a dictionary of arrays.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import logger, spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.infos import SpecRows, Where
from rtamt_gym.signals.columns import Entries

_Place = dict[str, Any] | list[dict[str, Any]]
_Column = tuple[_Place, str, str, NDArray[Any], Entries | None]
"""An argument of `VerdictLog.spread`: the place, two keys, the values and their mask."""


def put(infos: dict[str, Any], key: str, value: Any, entries: Entries | None, num: int) -> None:  # noqa: ANN401
    """Set a key for the environments in the mask; None: for all, without a copy of the array.

    ``value`` is an array with an element for every environment, or a dictionary of arrays.
    """
    if isinstance(value, dict):
        group: dict[str, Any] = {}
        for name, part in value.items():
            put(group, name, part, entries, num)
        value = group
    elif entries is not None:
        if np.count_nonzero(entries) == 0:
            return
        value = value.copy()
        value[~entries] = None if value.dtype == object else 0
    infos[key], infos[f"_{key}"] = value, (_all(num) if entries is None else entries).copy()


def put_last(
    infos: dict[str, Any],
    last: Mapping[str, Any],
    at: NDArray[np.int64],
    mask: Entries,
    reported: Entries | None,
    spread: Callable[[list[_Column], NDArray[np.int64]], None],
) -> None:
    """Set the keys of `last_info` for some environments.

    Args:
        infos: The infos.
        last: The keys; each array, also in a `Where` or a `SpecRows`, has an element for each of
            these environments.
        at: The numbers of the environments.
        mask: The mask of the environments.
        reported: Where the environment has its own ``is_success``, which stays; None: nowhere.
        spread: Writes all values at once, as `VerdictLog.spread` does.
    """
    num, before = len(mask), infos.get("is_success")
    columns: list[_Column] = []
    for key, value in last.items():
        if not isinstance(value, SpecRows):
            columns.append(_column(infos, key, value))
            continue
        groups: list[dict[str, Any]] = [{} for _ in value.names]
        columns += [_column(groups, name, result) for name, result in value.found.items()]
        named: dict[str, Any] = {}
        for name, group in zip(value.names, groups, strict=True):
            columns += [_column(group, *item) for item in value.more.get(name, {}).items()]
            named[name], named[f"_{name}"] = group, mask.copy()
        infos[key], infos[f"_{key}"] = named, mask.copy()
    spread(columns, at)
    if reported is not None:
        new = key_mask(infos, "is_success", num) & ~reported
        success = np.array(before)
        success[new] = infos["is_success"][new]
        infos["is_success"], infos["_is_success"] = success, reported | new


def _column(place: _Place, key: str, value: Any) -> _Column:  # noqa: ANN401
    if isinstance(value, Where):
        return place, key, f"_{key}", value.value, value.there
    return place, key, f"_{key}", value, None


@functools.cache
def _all(num: int) -> Entries:
    """Return a mask that is true everywhere; a copy takes a quarter of the time of a new one."""
    return np.ones(num, np.bool_)


def key_mask(infos: Mapping[str, Any], key: str, num: int) -> Entries:
    """Return the mask of the environments that have a key: all if the infos have no mask for it."""
    mask = infos.get(f"_{key}")
    if mask is None:
        return np.ones(num, np.bool_) if key in infos else np.zeros(num, np.bool_)
    return np.asarray(mask, np.bool_)


def final_observations(
    space: spaces.Space[Any],
    obs: Any,  # noqa: ANN401
    infos: Mapping[str, Any],
    ended: Entries,
) -> Any:  # noqa: ANN401
    """Return the observations from before the resets in a step.

    Args:
        space: The observation space of one environment.
        obs: The observations after the resets.
        infos: Has the observations from before the resets as ``final_obs``: an array with one
            object for each environment, as Gymnasium makes it, or a batch.
        ended: The environments that ended.

    Raises:
        InputError: If ``final_obs`` is missing.
    """
    if "final_obs" not in infos:
        raise InputError(
            "expected the observations at the ends of episodes in infos['final_obs'], as "
            f"AutoresetMode.SAME_STEP has them, got the keys {listing(infos)}"
        )
    final = infos["final_obs"]
    if isinstance(final, np.ndarray) and final.dtype == object:
        final = list(final[ended])
    return _replaced(space, obs, final, ended)


def _replaced(
    space: spaces.Space[Any],
    obs: Any,  # noqa: ANN401
    final: Any,  # noqa: ANN401
    ended: Entries,
) -> Any:  # noqa: ANN401
    """Replace the observations of the environments that ended.

    ``final`` is a list with an observation for each of them, or a batch like ``obs``.
    """

    def part(key: Any) -> Any:  # noqa: ANN401
        return [single[key] for single in final] if isinstance(final, list) else final[key]

    match space:
        case spaces.Dict():
            return {
                key: _replaced(inner, obs[key], part(key), ended)
                for key, inner in space.spaces.items()
            }
        case spaces.Tuple():
            return tuple(
                _replaced(inner, obs[i], part(i), ended) for i, inner in enumerate(space.spaces)
            )
        case spaces.Box() | spaces.Discrete() | spaces.MultiDiscrete() | spaces.MultiBinary():
            batch = np.array(obs)
            batch[ended] = final if isinstance(final, list) else np.asarray(final)[ended]
            return batch
        case _:  # no array, and no signal
            return obs


def final_infos(infos: dict[str, Any], ended: Entries) -> dict[str, Any]:
    """Return the infos from before the resets in a step: ``final_info`` where episodes ended."""
    before = {k: v for k, v in infos.items() if k not in _FINAL}
    return _merged(before, infos.get("final_info", {}), ended)


_FINAL = frozenset({"final_info", "_final_info", "final_obs", "_final_obs"})


def _merged(infos: Mapping[str, Any], final: Mapping[str, Any], ended: Entries) -> dict[str, Any]:
    merged: dict[str, Any] = {}
    keys = {**infos, **final}
    for key in keys:
        if key.startswith("_") and key[1:] in keys:
            continue
        old, new = infos.get(key), final.get(key)
        if isinstance(old, Mapping) or isinstance(new, Mapping):
            merged[key] = _merged(old or {}, new or {}, ended)
        elif old is None or new is None:
            merged[key] = new if old is None else old
        else:
            column = np.array(old, np.result_type(old, new))
            column[ended] = np.asarray(new)[ended]
            merged[key] = column
        num = len(ended)
        merged[f"_{key}"] = np.where(ended, key_mask(final, key, num), key_mask(infos, key, num))
    return merged


def autoreset_mode(env: VectorEnv[Any, Any, Any]) -> AutoresetMode:
    """Return when a vector environment resets an environment after the end of its episode.

    Raises:
        InputError: If its metadata has a value that is not a mode.
    """
    mode, inner = env.metadata.get("autoreset_mode"), env.unwrapped
    if isinstance(inner, SyncVectorEnv | AsyncVectorEnv) and env.metadata is inner.metadata:
        # Before 1.4, vector environments of one class share their metadata.
        mode = mode and inner.autoreset_mode
    if isinstance(mode, AutoresetMode):
        return mode
    if mode is not None:
        raise InputError(
            f"expected an AutoresetMode as metadata['autoreset_mode'] of {env}, got {mode!r}"
        )
    # Gymnasium's own wrappers also assume this mode.
    logger.warn(
        f"{env} has no metadata['autoreset_mode']; VectorStlMonitor assumes AutoresetMode.NEXT_STEP"
    )
    return AutoresetMode.NEXT_STEP


def checked_mask(mask: Any, num: int) -> NDArray[np.bool_]:  # noqa: ANN401
    """Return ``options["reset_mask"]``; raise for a value that Gymnasium would not take."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise InputTypeError(
            f"expected options['reset_mask'] as an array of booleans, got {mask!r}"
        )
    if mask.shape != (num,) or not mask.any():
        raise InputError(
            f"expected options['reset_mask'] of shape ({num},), true for one environment or more, "
            f"got {mask!r}"
        )
    return mask
