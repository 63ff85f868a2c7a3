"""Infos of vector environments: an array for every key, and a mask ``_key`` of those that have it.

Gymnasium's `SyncVectorEnv` has the same form: where an environment has no value the array holds
zero, or None if it is an array of objects; a key that no environment has is absent; a dictionary of
infos becomes a dictionary of arrays.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.infos import SpecRows, Where
from rtamt_gym.signals.columns import Lanes

__all__ = ["final_infos", "final_observations", "key_mask", "put", "put_last"]


_Place = dict[str, Any] | list[dict[str, Any]]
_Column = tuple[_Place, str, str, NDArray[Any], Lanes | None]
"""What `VerdictBook.spread` writes: the place, two keys, the values, and which there are."""


def put(infos: dict[str, Any], key: str, value: Any, lanes: Lanes | None, num: int) -> None:  # noqa: ANN401
    """Sets a key for the environments of the mask; None: for all, and the array is not copied.

    ``value`` has an element for every environment, or is a dictionary of such arrays.
    """
    if isinstance(value, dict):
        group: dict[str, Any] = {}
        for name, part in value.items():
            put(group, name, part, lanes, num)
        value = group
    elif lanes is not None:
        if np.count_nonzero(lanes) == 0:
            return
        value = value.copy()
        value[~lanes] = None if value.dtype == object else 0
    infos[key], infos[f"_{key}"] = value, (_all(num) if lanes is None else lanes).copy()


def put_last(
    infos: dict[str, Any],
    last: Mapping[str, Any],
    at: NDArray[np.int64],
    mask: Lanes,
    reported: Lanes | None,
    spread: Callable[[list[_Column], NDArray[np.int64]], None],
) -> None:
    """Sets the keys of `last_info` for the environments of the mask, which have the numbers ``at``.

    Keeps ``is_success`` where the environment has reported it; None: nowhere. ``last`` has an
    element for each of the environments; `Where` and `SpecRows` have such arrays. ``spread`` writes
    all at once, as `VerdictBook.spread` does.
    """
    num, before = len(mask), infos.get("is_success")
    columns: list[_Column] = []
    for key, value in last.items():
        if not isinstance(value, SpecRows):
            columns.append(_column(infos, key, value))
            continue
        groups: list[dict[str, Any]] = [{} for _ in value.names]
        columns += [_column(groups, name, found) for name, found in value.found.items()]
        named: dict[str, Any] = {}
        for name, group in zip(value.names, groups, strict=True):
            columns += [_column(group, *each) for each in value.more.get(name, {}).items()]
            named[name], named[f"_{name}"] = group, mask.copy()
        infos[key], infos[f"_{key}"] = named, mask.copy()
    spread(columns, at)
    if reported is not None:
        new = key_mask(infos, "is_success", num) & ~reported
        held = np.array(before)
        held[new] = infos["is_success"][new]
        infos["is_success"], infos["_is_success"] = held, reported | new


def _column(place: _Place, key: str, value: Any) -> _Column:  # noqa: ANN401
    if isinstance(value, Where):
        return place, key, f"_{key}", value.value, value.there
    return place, key, f"_{key}", value, None


@functools.cache
def _all(num: int) -> Lanes:
    """A mask that is true everywhere, to be copied: making one takes four times as long."""
    return np.ones(num, np.bool_)


def key_mask(infos: Mapping[str, Any], key: str, num: int) -> Lanes:
    """The mask of the environments that have a key: all, if the infos hold no mask for it."""
    mask = infos.get(f"_{key}")
    if mask is None:
        return np.ones(num, np.bool_) if key in infos else np.zeros(num, np.bool_)
    return np.asarray(mask, np.bool_)


def final_observations(
    space: spaces.Space[Any],
    obs: Any,  # noqa: ANN401
    infos: Mapping[str, Any],
    ended: Lanes,
) -> Any:  # noqa: ANN401
    """The observations from before the resets in a step.

    Args:
        space: The observation space of one environment.
        obs: The observations after the resets.
        infos: Has the observations from before the resets as ``final_obs``: an array with one
            object for each environment, as Gymnasium makes it, or a batch.
        ended: The environments that ended.

    Raises:
        InputError: If there is no ``final_obs``.
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
    ended: Lanes,
) -> Any:  # noqa: ANN401
    """Replaces the observations of the environments that ended.

    ``final`` is a list with an observation for each of them, or a batch like ``obs``.
    """

    def part(key: Any) -> Any:  # noqa: ANN401
        return [each[key] for each in final] if isinstance(final, list) else final[key]

    match space:
        case spaces.Dict():
            return {
                key: _replaced(each, obs[key], part(key), ended)
                for key, each in space.spaces.items()
            }
        case spaces.Tuple():
            return tuple(
                _replaced(each, obs[i], part(i), ended) for i, each in enumerate(space.spaces)
            )
        case spaces.Box() | spaces.Discrete() | spaces.MultiDiscrete() | spaces.MultiBinary():
            batch = np.array(obs)
            batch[ended] = final if isinstance(final, list) else np.asarray(final)[ended]
            return batch
        case _:  # no array, and no signal
            return obs


def final_infos(infos: dict[str, Any], ended: Lanes) -> dict[str, Any]:
    """The infos from before the resets in a step: ``final_info`` where episodes ended."""
    before = {k: v for k, v in infos.items() if k not in _FINAL}
    return _merged(before, infos.get("final_info", {}), ended)


_FINAL = frozenset({"final_info", "_final_info", "final_obs", "_final_obs"})


def _merged(infos: Mapping[str, Any], final: Mapping[str, Any], ended: Lanes) -> dict[str, Any]:
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
            held = np.array(old, np.result_type(old, new))
            held[ended] = np.asarray(new)[ended]
            merged[key] = held
        num = len(ended)
        merged[f"_{key}"] = np.where(ended, key_mask(final, key, num), key_mask(infos, key, num))
    return merged
