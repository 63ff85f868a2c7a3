"""Records of episodes that have ended: the entries of ``stl_episodes``."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt_gym.judging.infos import Lanewise, SpecRows, Where, present

__all__ = ["EpisodeRecords", "record"]


def record(
    outcomes: Mapping[str, Any] | SpecRows,
    violated: Lanewise,
    violated_by: Lanewise,
    violated_at: Lanewise,
    samples: Lanewise,
    terminated: Lanewise,
    truncated: Lanewise,
) -> dict[str, Any]:
    """Return the record of an episode, or of several; the arguments are those of `last_info`."""
    return {
        "samples": samples,
        "terminated": terminated,
        "truncated": truncated,
        "specs": outcomes,
        "violated_by": Where(violated, violated_by),
        "violated_at": Where(violated, violated_at),
    }


class EpisodeRecords:
    """The records of the last episodes that ended in a vector environment.

    They are kept as the arrays of `record`, one set for each step that ended episodes: to make
    Python values of all would take longer than the step.

    Args:
        length: How many records are kept.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._count = 0
        self._steps: deque[tuple[NDArray[np.integer[Any]], dict[str, Any]]] = deque()

    def append(self, envs: NDArray[np.integer[Any]], records: dict[str, Any]) -> None:
        """Adds the records of the environments with these numbers; drops the oldest records."""
        self._steps.append((envs, records))
        self._count += len(envs)
        while self._steps and self._count - len(self._steps[0][0]) >= self._length:
            self._count -= len(self._steps.popleft()[0])

    def newest(self) -> deque[dict[str, Any]]:
        """The records, the newest last, each with ``"env"``, the number of the environment."""
        held = ((envs, records, i) for envs, records in self._steps for i in range(len(envs)))
        surplus = max(self._count - self._length, 0)
        return deque(
            (
                {"env": int(envs[i]), **present(_element(records, i))}
                for envs, records, i in islice(held, surplus, None)
            ),
            self._length,
        )


def _element(value: Any, i: int) -> Any:  # noqa: ANN401
    """Element i of all arrays in a record, as the record of one environment has it."""
    match value:
        case Where():
            return Where(value.there[i], value.value.item(i))
        case SpecRows():
            return _element(value.by_name(), i)
        case dict():
            return {key: _element(part, i) for key, part in value.items()}
        case _:
            return value[i] if value.dtype == np.float64 else value.item(i)
