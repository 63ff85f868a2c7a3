"""The signals of recorded episodes: a table with a row for every sample.

All steps of an episode are read at once, like one step of many environments: a selector is bound by
`rtamt_gym.signals.columns`, to the spaces of the dataset. A function gets a `Step` for each sample,
and one that is marked with `rtamt_gym.wrappers.batched` those of an episode at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space

from rtamt import InputError, RtamtError
from rtamt.typing import NanPolicy
from rtamt_gym.datasets.episodes import RecordedEpisode, part
from rtamt_gym.signals.columns import Floats, SignalColumns
from rtamt_gym.signals.signals import Batched, ParsedSignal, Step

__all__ = ["SignalReader"]


class SignalReader:
    """Reads the signals of episodes.

    Args:
        signals: What to read, in the order of the columns.
        observations: The space of an observation.
        actions: The space of an action.
        nan: Whether a signal that is nan is refused, or keeps its last value.

    Raises:
        InputError: If a selector does not fit the spaces.
    """

    def __init__(
        self,
        signals: Sequence[ParsedSignal],
        observations: spaces.Space[Any],
        actions: spaces.Space[Any],
        nan: NanPolicy,
    ) -> None:
        self._signals = signals
        self._called = [
            at
            for at, each in enumerate(signals)
            if each.source is None and not isinstance(each.reads, Batched)
        ]
        self._selected = [at for at in range(len(signals)) if at not in self._called]
        self._spaces = observations, actions
        self._nan = nan
        self._compare = True  # in the first episode, what marked functions give
        self._columns(1)  # so that a selector that does not fit is refused now

    def table(self, episode: RecordedEpisode, rewards: Floats) -> Floats:
        """Reads an episode: a row for the reset, and one for every step.

        Args:
            episode: The episode.
            rewards: The rewards of the environment itself.

        Raises:
            InputError: If a signal cannot be read or is nan; a note names the episode.
        """
        where = f"in episode {episode.number}"
        try:
            table = self._read(episode, rewards)
            self._check(table)
        except RtamtError as error:
            error.add_note(where)
            raise
        except (IndexError, KeyError, TypeError) as error:
            other = InputError(
                "expected observations and actions of one form in all episodes, got others than "
                f"in the first: {type(error).__name__}: {error}"
            )
            other.add_note(where)
            raise other from error
        return table

    def _columns(self, num: int) -> SignalColumns:
        """Reads so many steps at once."""
        signals = [self._signals[at] for at in self._selected]
        observations, actions = self._spaces
        lanes: Any = SimpleNamespace(
            num_envs=num,
            single_observation_space=observations,
            single_action_space=actions,
            observation_space=batch_space(observations, num),
            action_space=batch_space(actions, num),
        )
        return SignalColumns(signals, lanes, same_step=False, compare=self._compare)

    def _read(self, episode: RecordedEpisode, rewards: Floats) -> Floats:
        table = np.empty((len(episode) + 1, len(self._signals)))
        first, later = _split(episode.infos, len(episode))
        obs, actions = episode.observations, episode.actions
        if self._selected:
            reset = self._columns(1).reset(part(obs, slice(0, 1)), first, np.ones(1, np.bool_))
            table[0, self._selected] = reset[0]
            steps = self._columns(len(episode))
            table[1:, self._selected] = steps.step(
                part(obs, slice(1, None)), actions, rewards, later
            )
            self._compare = False
        for at, signal in enumerate(self._signals):
            # An info that has no value at reset is padded with nan in a dataset.
            if signal.default is not None and np.isnan(table[0, at]):
                table[0, at] = signal.default
        for at in self._called:
            signal = self._signals[at]
            for k in range(len(table)):
                if k == 0 and signal.default is not None:
                    table[k, at] = signal.default
                    continue
                step = Step(part(obs, 0), None, None, part(first, 0), None)
                if k:
                    said = part(later, k - 1)
                    step = Step(part(obs, k), part(actions, k - 1), rewards[k - 1], said, None)
                table[k, at] = signal.number(signal.call(step))
        return table

    def _check(self, table: Floats) -> None:
        if self._nan == "unknown":
            return
        missing = np.isnan(table)
        unknown = [each.default is not None and np.isnan(each.default) for each in self._signals]
        missing[0] &= ~np.array(unknown, np.bool_)
        found = np.argwhere(missing)
        if len(found) == 0 or (self._nan == "hold" and found[0, 0] > 0):
            return
        sample, column = found[0]
        way_out = "; nan='hold' keeps the last value"
        if sample == 0:
            way_out += ", and the first sample has none"
        raise InputError(
            f"signal {self._signals[column].name!r} is nan at sample {sample}{way_out}"
        )


def _split(infos: Mapping[str, Any], steps: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Splits infos into the reset's and the steps'; n elements for n steps leave the reset none."""
    first: dict[str, Any] = {}
    later: dict[str, Any] = {}
    for key, value in infos.items():
        if isinstance(value, Mapping):
            first[key], later[key] = _split(value, steps)
            continue
        entries = np.asarray(value)
        if entries.ndim and len(entries) == steps + 1:
            first[key], later[key] = entries[:1], entries[1:]
        else:  # a selector that reads it refuses another length
            later[key] = entries
    return first, later
