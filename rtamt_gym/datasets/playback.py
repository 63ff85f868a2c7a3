"""Recorded episodes as a vector environment for monitors and rewards.

Only the wrappers of vector environments define robustness, verdicts, costs and shaped rewards. So
the signals of recorded episodes become the observations of a vector environment, and each
environment plays one episode after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from rtamt_gym.datasets.episodes import RecordedEpisode
from rtamt_gym.signals.columns import Batch, Entries, Floats


class Tape:
    """Recorded episodes in sequence: a row for every sample, and one for idle environments.

    Attributes:
        starts: The rows in which episodes start; the last is the row of idle environments.
        signals: The signals of every row.
        rewards: The rewards of every row.
        terminated: Whether the row is the last of a terminated episode.
        truncated: Whether it is the last one of any other episode.
    """

    def __init__(
        self,
        episodes: Sequence[RecordedEpisode],
        tables: Sequence[Floats],
        rewards: Sequence[Floats],
    ) -> None:
        self.starts = np.cumsum([0, *(len(table) for table in tables)])
        self.signals = np.concatenate([*tables, tables[-1][:1]])  # which is never nan
        rows = len(self.signals)
        self.rewards = np.zeros(rows)
        self.terminated, self.truncated = np.zeros(rows, np.bool_), np.zeros(rows, np.bool_)
        for episode, begin, paid in zip(episodes, self.starts[:-1], rewards, strict=True):
            end = begin + len(paid)
            self.rewards[begin + 1 : end + 1] = paid
            self.terminated[end] = episode.terminations[-1]
            self.truncated[end] = episode.truncations[-1] or not episode.terminations[-1]


class Playback(VectorEnv[Any, Any, Any]):
    """A vector environment that plays a tape; actions do nothing.

    Attributes:
        tape: The tape, to be set before a reset.
        rows: The row that each environment shows.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 - as Gymnasium's

    tape: Tape

    def __init__(self, num: int, columns: int) -> None:
        self.num_envs = num
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (columns,), np.float64)
        self.single_action_space = spaces.Discrete(1)
        self.rows: NDArray[np.intp] = np.zeros(num, np.intp)
        self._next = 0
        self._ended: Entries = np.zeros(num, np.bool_)

    def reset(self, **_: Any) -> tuple[Floats, dict[str, Any]]:  # noqa: ANN401
        """Rewind the tape."""
        self._next = 0
        self._ended = np.ones(self.num_envs, np.bool_)
        self._advance()
        self._ended = np.zeros(self.num_envs, np.bool_)
        return self.tape.signals[self.rows], {}

    def step(
        self,
        actions: Any,  # noqa: ANN401, ARG002 - they were taken long ago
    ) -> tuple[Floats, Floats, Entries, Entries, dict[str, Any]]:
        """Show the next sample of every episode, or the first of the next one."""
        self._advance()
        tape, rows = self.tape, self.rows
        terminated, truncated = tape.terminated[rows], tape.truncated[rows]
        self._ended = terminated | truncated
        return tape.signals[rows], tape.rewards[rows], terminated, truncated, {}

    @property
    def playing(self) -> bool:
        """Whether an episode is running or left."""
        idle = self.tape.starts[-1]
        left = self._next < len(self.tape.starts) - 1
        return left or bool(np.any((self.rows != idle) & ~self._ended))

    def _advance(self) -> None:
        idle = self.tape.starts[-1]
        self.rows = np.where(self.rows == idle, idle, self.rows + 1)
        for entry in np.flatnonzero(self._ended):
            self.rows[entry] = self.tape.starts[self._next]
            self._next = min(self._next + 1, len(self.tape.starts) - 1)


class JudgedTape:
    """The results of the wrappers for every sample of a tape, and for the ends of its episodes.

    Attributes:
        columns: By key of the infos, a value for every row, 0 if it is missing; nested as the
            infos.
        rewards: The shaped rewards of every row.
        outcomes: The outcomes of each episode, by its last row.
        violations: The specification that was violated first and the sample, by the same row.
    """

    def __init__(self, rows: int) -> None:
        self.columns: dict[str, Any] = {}
        self.rewards = np.zeros(rows)
        self.outcomes: dict[int, dict[str, dict[str, Any]]] = {}
        self.violations: dict[int, tuple[str, int]] = {}

    def keep(self, rows: NDArray[np.intp], rewards: Floats, infos: dict[str, Any]) -> None:
        """Store the results of a step for the rows that it shows."""
        self.rewards[rows] = rewards
        _keep(self.columns, infos, rows, len(self.rewards))

    def conclude(self, rows: NDArray[np.intp], ended: Entries, infos: dict[str, Any]) -> None:
        """Store the outcomes of the episodes that a step ends."""
        for entry in np.flatnonzero(ended):
            row = int(rows[entry])
            self.outcomes[row] = {
                name: {
                    key: value[entry : entry + 1].tolist()[0]
                    for key, value in outcome.items()
                    if not key.startswith("_") and outcome[f"_{key}"][entry]
                }
                for name, outcome in infos["stl_episode"].items()
                if not name.startswith("_") or f"_{name}" in infos["stl_episode"]
            }
            if "stl_violated_by" in infos and infos["_stl_violated_by"][entry]:
                violation = infos["stl_violated_by"][entry], int(infos["stl_violated_at"][entry])
                self.violations[row] = violation


_OF_THE_EPISODE = frozenset({"stl_episode", "stl_violated_by", "stl_violated_at", "final_info"})


def _keep(
    columns: dict[str, Any], infos: dict[str, Any], rows: NDArray[np.intp], size: int
) -> None:
    for key, value in infos.items():
        if key in _OF_THE_EPISODE or (key.startswith("_") and key[1:] in infos):
            continue
        if isinstance(value, dict):
            _keep(columns.setdefault(key, {}), value, rows, size)
        elif value.dtype != object:
            if key not in columns:
                columns[key] = np.zeros(size, value.dtype)
            columns[key][rows] = value


def play(envs: Batch, playback: Playback) -> JudgedTape:
    """Play the tape of a playback through the wrappers around it."""
    judged = JudgedTape(len(playback.tape.rewards))
    actions = np.zeros(playback.num_envs, np.int64)
    _, infos = envs.reset()
    judged.keep(playback.rows, np.zeros(playback.num_envs), infos)
    while playback.playing:
        _, rewards, terminated, truncated, infos = envs.step(actions)
        judged.keep(playback.rows, rewards, infos)
        ended = terminated | truncated
        if ended.any():
            judged.conclude(playback.rows, ended, infos)
    return judged
