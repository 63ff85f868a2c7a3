"""The keys that the wrappers add to ``info``, for one environment and for a batch.

The infos of a batch have an array for every key, and a mask ``_key`` of the environments with a
value, as in Gymnasium's `SyncVectorEnv`. Without a value, the array holds zero, or None in an array
of objects. A key without any value is absent; a dictionary of infos becomes a dictionary of arrays.

A key of every step is a line in `step_info` or in `_OPTIONAL`; a key of an entry of ``info["stl"]``
is a line in `spec_state`; a key of the last info of an episode is a line in `last_info`. A key that
not every environment has gets a `Where`.

To add a key, compute its value for one environment, for a batch and for arrays:

- A key of every info that depends on the options is a row of `_OPTIONAL` and an attribute of that
  name in `rtamt_gym.judging.monitor_set`, `rtamt_gym.judging.vector_monitor_set` and
  ``_Optional`` of `rtamt_arrays.judging`, which is None where the key is absent.
- Any other key of every info is an argument of `step_info`, with its callers: ``monitor``,
  ``vector_monitor`` and ``parallel`` in `rtamt_gym.wrappers`, and `rtamt_arrays.judging`.
- A key of ``info["stl"]`` is an argument of `spec_state`, a key of ``info["stl_episode"]`` an
  argument of `outcome`. Both monitor sets call them; `rtamt_arrays.judging` calls `spec_state`.
- A key of the last info is an argument of `last_info`, which ``episode_monitoring`` and
  ``vector_monitor`` call. If it is a number or a truth value, add it to `end_info`, which
  `rtamt_arrays.judging` calls too.

Describe it in the docstring of `StlMonitor` and in ``docs/gymnasium.md``. A key of every info is
also an array of `relabel`: list it in its docstring. The exact keys are in ``test_stl_monitor.py``
and ``test_parallel_monitor.py`` in ``tests/rtamt_gym/wrappers``. The contract in
``tests/support/array_requirements.py`` compares arrays with the vector wrapper, and
``tests/support/episode_oracle.py`` defines all infos again. A key of the last info that is not one
value per sample is in ``_OF_THE_EPISODE`` of `rtamt_gym.datasets.relabel`. A key of `end_info` is
listed in ``docs/arrays.md`` and in `rtamt_arrays.jax.brax`.
"""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.signals.columns import Entries

VERDICTS = np.array(["UNDECIDED", "SATISFIED", "VIOLATED"], dtype=object)
"""The names of the verdicts 0, 1 and -1."""

Entrywise = Any
"""A value of one environment, or an array with an element for each of a batch."""

_OPTIONAL = {"stl_of_instant": "of_instant", "stl_progress": "least_progress"}
"""Keys of every info that depend on the options: the key, and the attribute of the monitor set."""


class HasOptionalKeys(Protocol):
    """A monitor set; ``optional_keys`` are its constant rows of `_OPTIONAL`."""

    @property
    def optional_keys(self) -> tuple[tuple[str, str], ...]: ...


class Where(NamedTuple):
    """A value that exists only where ``there`` is true, which is a bool or an array of them."""

    there: Entrywise
    value: Entrywise


class SpecRows(NamedTuple):
    """Values of several specifications in a batch: arrays with a row for each specification.

    ``more`` has further values of a specification, by its name.
    """

    names: Sequence[str]
    found: Mapping[str, Entrywise]
    more: Mapping[str, Mapping[str, Entrywise]]

    def by_name(self) -> dict[str, dict[str, Any]]:
        """Return the values of each specification."""
        return {
            name: {key: _row(value, k) for key, value in self.found.items()}
            | dict(self.more.get(name, {}))
            for k, name in enumerate(self.names)
        }


def _row(value: Entrywise, k: int) -> Entrywise:
    return Where(value.there[k], value.value[k]) if isinstance(value, Where) else value[k]


def step_info(
    info: Mapping[str, Any],
    robustness: Entrywise,
    lower: Entrywise,
    upper: Entrywise,
    violated: Entrywise,
    monitors: HasOptionalKeys | None = None,
    states: Mapping[str, Any] | None = None,
    costs: Mapping[str, Entrywise] | None = None,
    period: Entrywise | None = None,
) -> dict[str, Any]:
    """Return the info of a step with the keys that every info has.

    ``monitors`` has the values of optional keys, ``states`` is a `spec_state` for each
    specification, and ``period`` belongs to the info of a reset.
    """
    # Setting key by key takes half the time of merging two dictionaries.
    added = dict(info)
    added["robustness"] = robustness
    added["stl_lower"] = lower
    added["stl_upper"] = upper
    added["stl_violated"] = violated
    if monitors is not None:
        for key, attribute in monitors.optional_keys:
            added[key] = getattr(monitors, attribute)
    if period is not None:
        added["stl_period"] = period
    if states is not None:
        added["stl"] = states
    if costs is not None:
        added.update(costs)
    return added


def optional_keys(monitors: object) -> tuple[tuple[str, str], ...]:
    """Return the rows of `_OPTIONAL` with an attribute other than None."""
    rows = _OPTIONAL.items()
    return tuple(row for row in rows if getattr(monitors, row[1], None) is not None)


def spec_state(
    robustness: Entrywise,
    lower: Entrywise,
    upper: Entrywise,
    verdict: Entrywise,
    of_instant: Entrywise | None = None,
    progress: Entrywise | None = None,
) -> dict[str, Any]:
    """Return the state of one specification, an entry of ``info["stl"]``.

    ``of_instant`` is None with ``view="episode"``, ``progress`` without stages.
    """
    state = {"robustness": robustness, "lower": lower, "upper": upper, "verdict": verdict}
    if of_instant is not None:
        state["of_instant"] = of_instant
    if progress is not None:
        state["progress"] = progress
    return state


def outcome(
    robustness: Entrywise,
    verdict: Entrywise,
    satisfied: Entrywise,
    settled_at: Entrywise,
    decided: Entrywise,
    ended: Entrywise,
    by_end: Entrywise,
) -> dict[str, Any]:
    """Return the outcome of a specification, an entry of ``info["stl_episode"]``.

    ``settled_at`` is the sample that ``decided`` the verdict, or the last sample if only the end
    did, ``ended``. ``by_end`` is a verdict of -1 although the robustness holds.
    """
    return {
        "robustness": robustness,
        "verdict": VERDICTS[verdict],
        "satisfied": satisfied,
        "decided_at": Where(decided, settled_at),
        "ended_at": Where(ended, settled_at),
        "by_end": Where(by_end, by_end),
    }


def last_info(
    outcomes: Mapping[str, Any] | SpecRows,
    violated: Entrywise,
    violated_by: Entrywise,
    violated_at: Entrywise,
    success: Entrywise,
    undecided: Entrywise,
    reported: Entrywise,
) -> dict[str, Any]:
    """Return the keys that only the last info of an episode has.

    ``outcomes`` has an `outcome` for each specification; ``violated_by`` and ``violated_at`` mean
    the first violation; ``reported`` is where the environment has its own ``is_success``, which
    stays.
    """
    return {
        "stl_episode": outcomes,
        "stl_violated_by": Where(violated, violated_by),
        **end_info(
            Where(violated, violated_at),
            success,
            undecided,
            Where(reported ^ True, success),
        ),
    }


def end_info(
    violated_at: Entrywise, success: Entrywise, undecided: Entrywise, is_success: Entrywise
) -> dict[str, Any]:
    """Return the keys of the last info of an episode that are numbers or truth values."""
    return {
        "stl_violated_at": violated_at,
        "stl_success": success,
        "stl_undecided": undecided,
        "is_success": is_success,
    }


def present(info: Mapping[str, Any], *, deep: bool = True) -> dict[str, Any]:
    """Return the info of one environment without absent keys; deep: in inner ones too."""
    there = {}
    for key, value in info.items():
        kind = type(value)
        if kind is Where:
            if value.there:
                there[key] = value.value
        else:
            there[key] = present(value) if deep and kind is dict else value
    return there


def record(
    outcomes: Mapping[str, Any] | SpecRows,
    violated: Entrywise,
    violated_by: Entrywise,
    violated_at: Entrywise,
    samples: Entrywise,
    terminated: Entrywise,
    truncated: Entrywise,
) -> dict[str, Any]:
    """Return entries of ``stl_episodes``; `last_info` documents the arguments."""
    return {
        "samples": samples,
        "terminated": terminated,
        "truncated": truncated,
        "specs": outcomes,
        "violated_by": Where(violated, violated_by),
        "violated_at": Where(violated, violated_at),
    }


_Place = dict[str, Any] | list[dict[str, Any]]
_Column = tuple[_Place, str, str, NDArray[Any], "Entries | None"]
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
    """Set the keys of `last_info` for the environments in ``mask``, whose numbers are ``at``.

    Each array of ``last``, also in a `Where` or a `SpecRows`, has an element for each of them. An
    own ``is_success`` stays where it is ``reported``; `VerdictLog.spread` writes all values at
    once.
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


class EpisodeRecords:
    """The records of the last ``length`` episodes of a vector environment.

    It keeps the arrays of `record`, because converting them takes longer than a step.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._count = 0
        self._steps: deque[tuple[NDArray[np.integer[Any]], dict[str, Any]]] = deque()

    def append(self, envs: NDArray[np.integer[Any]], records: dict[str, Any]) -> None:
        """Add the records of the environments with these numbers; drop the oldest records."""
        self._steps.append((envs, records))
        self._count += len(envs)
        while self._steps and self._count - len(self._steps[0][0]) >= self._length:
            self._count -= len(self._steps.popleft()[0])

    def newest(self) -> deque[dict[str, Any]]:
        """Return the records, the newest last, with the environment's number as ``env``."""
        stored = ((envs, records, i) for envs, records in self._steps for i in range(len(envs)))
        surplus = max(self._count - self._length, 0)
        return deque(
            (
                {"env": int(envs[i]), **present(_element(records, i))}
                for envs, records, i in islice(stored, surplus, None)
            ),
            self._length,
        )


def _element(value: Any, i: int) -> Any:  # noqa: ANN401
    """Return element i of all arrays in a record."""
    match value:
        case Where():
            return Where(value.there[i], value.value.item(i))
        case SpecRows():
            return _element(value.by_name(), i)
        case dict():
            return {key: _element(part, i) for key, part in value.items()}
        case _:
            return value[i] if value.dtype == np.float64 else value.item(i)
