"""Recorded episodes, in the form of Minari: their signals, and datasets of them.

All steps of an episode are read at once, like one step of a batch: `rtamt_gym.signals.columns`
binds a selector to the spaces of the dataset. A function gets a `Step` per sample, or the whole
episode at once if `rtamt_gym.wrappers.batched` marks it.
"""

from __future__ import annotations

import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, RtamtError, Specification
from rtamt.errors import nearest
from rtamt.typing import NanPolicy
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.columns import Entries, Floats, SignalColumns
from rtamt_gym.signals.signals import Batched, ParsedSignal, Step


@dataclass(frozen=True, slots=True)
class RecordedEpisode:
    """A recorded episode of n steps.

    Attributes:
        number: Its number in the dataset.
        observations: n + 1 observations, the first from the reset: an array, or a dictionary or a
            tuple of arrays.
        actions: n actions.
        rewards: n numbers.
        terminations: n booleans.
        truncations: n booleans.
        infos: Arrays by key, with n + 1 elements, or n without a value at reset.
        seed: The seed of the reset, if it is known.
        options: The options of the reset, if they are known.
    """

    number: int
    observations: Any
    actions: Any
    rewards: NDArray[Any]
    terminations: Entries
    truncations: Entries
    infos: dict[str, Any]
    seed: int | None = None
    options: dict[str, Any] | None = None

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.rewards)


@dataclass(frozen=True, slots=True)
class RelabelledEpisode(RecordedEpisode):
    """A recorded episode with the results of monitors.

    It has the attributes of Minari's ``EpisodeData``, and:

    Attributes:
        outcomes: For each specification ``{"robustness", "verdict", "satisfied", "decided_at"}``,
            as in ``info["stl_episode"]`` of a monitored environment.
        violated_by: The specification that was violated first; None without a violation.
        violated_at: The sample of the violation, the last one if only the end decided; None without
            a violation.
    """

    outcomes: dict[str, dict[str, Any]] = field(default_factory=dict)
    violated_by: str | None = None
    violated_at: int | None = None

    @property
    def satisfied(self) -> bool:
        """Whether all specifications are satisfied."""
        return all(outcome["satisfied"] for outcome in self.outcomes.values())

    @property
    def robustness(self) -> float:
        """The minimum robustness over all specifications."""
        return float(min(outcome["robustness"] for outcome in self.outcomes.values()))


_FIELDS = ("observations", "actions", "rewards", "terminations", "truncations")


def read_episode(
    source: Any,  # noqa: ANN401 - any object
    number: int,
    metadata: Mapping[str, Any] | None = None,
) -> RecordedEpisode:
    """Return an episode of a dataset; raise an error if its parts do not fit together.

    ``metadata`` has ``seed`` and ``options`` of the reset, unless the episode has them.
    """
    if isinstance(source, Mapping):
        known, missing = source, [name for name in _FIELDS if name not in source]
    else:
        names = (*_FIELDS, "infos", "seed", "options")
        known = {name: getattr(source, name) for name in names if hasattr(source, name)}
        missing = [name for name in _FIELDS if name not in known]
        if len(missing) == len(_FIELDS):
            raise InputTypeError(
                f"expected episode {number} as Minari's EpisodeData, or as a mapping with "
                f"{listing(_FIELDS)}, got {type(source).__name__}"
            )
    if missing:
        raise InputError(
            f"episode {number} has no {missing[0]!r}; its keys are {listing(known)}"
            f"{nearest(missing[0], [name for name in known if name not in _FIELDS])}"
        )
    if not isinstance(known.get("infos") or {}, Mapping):
        raise InputTypeError(
            f"episode {number}: expected infos as a mapping from keys to arrays, got "
            f"{type(known['infos']).__name__}"
        )
    reset = known if metadata is None else metadata
    episode = RecordedEpisode(
        number,
        _arrays(known["observations"]),
        _arrays(known["actions"]),
        np.asarray(known["rewards"]),
        np.asarray(known["terminations"], np.bool_),
        np.asarray(known["truncations"], np.bool_),
        dict(known.get("infos") or {}),
        reset.get("seed"),
        reset.get("options"),
    )
    _check(episode)
    return episode


def _check(episode: RecordedEpisode) -> None:
    number, steps = episode.number, len(episode)
    if steps == 0:
        raise InputError(f"episode {number} has no steps; remove it")
    for name in _FIELDS:
        expected = steps + (name == "observations")
        for leaf in _leaves(getattr(episode, name)):
            if len(leaf) != expected:
                phrase = ", the first from the reset" if name == "observations" else ""
                raise InputError(
                    f"episode {number}: expected {expected} {name} for {steps} rewards{phrase}, "
                    f"got {len(leaf)}"
                )
    early = np.flatnonzero((episode.terminations | episode.truncations)[:-1])
    if len(early):
        raise InputError(
            f"episode {number} ends at step {early[0]} and has {steps} steps; split it there"
        )


def _arrays(tree: Any) -> Any:  # noqa: ANN401 - of observations or actions
    """Return the tree with arrays as leaves."""
    if isinstance(tree, Mapping):
        return {key: _arrays(branch) for key, branch in tree.items()}
    if isinstance(tree, tuple):
        return tuple(_arrays(branch) for branch in tree)
    return np.asarray(tree)


def _leaves(tree: Any) -> list[NDArray[Any]]:  # noqa: ANN401 - of observations or actions
    if isinstance(tree, Mapping):
        return [leaf for branch in tree.values() for leaf in _leaves(branch)]
    if isinstance(tree, tuple):
        return [leaf for branch in tree for leaf in _leaves(branch)]
    return [tree]


def size_of(episode: RecordedEpisode) -> int:
    """Return the bytes of the observations and actions."""
    trees = episode.observations, episode.actions
    return sum(leaf.nbytes for tree in trees for leaf in _leaves(tree))


def part(tree: Any, index: Any) -> Any:  # noqa: ANN401 - an index or a slice of a tree
    """Return the elements of all leaves of a tree at an index, or in a slice."""
    if isinstance(tree, Mapping):
        return {key: part(branch, index) for key, branch in tree.items()}
    if isinstance(tree, tuple):
        return tuple(part(branch, index) for branch in tree)
    return tree[index]


def space_of(tree: Any) -> spaces.Space[Any]:  # noqa: ANN401 - of observations or actions
    """Return a space for the elements of a tree, for datasets that declare none."""
    if isinstance(tree, Mapping):
        return spaces.Dict([(key, space_of(branch)) for key, branch in tree.items()])
    if isinstance(tree, tuple):
        return spaces.Tuple([space_of(branch) for branch in tree])
    kind = tree.dtype
    if kind.kind in "iu":
        limits: Any = np.iinfo(kind)
        return spaces.Box(limits.min, limits.max, tree.shape[1:], kind)
    if kind.kind == "b":
        return spaces.Box(0, 1, tree.shape[1:], np.int8)
    return spaces.Box(-np.inf, np.inf, tree.shape[1:], kind)


class SignalReader:
    """Reads the signals of episodes; ``signals`` are in the order of the columns."""

    def __init__(
        self,
        signals: Sequence[ParsedSignal],
        observations: spaces.Space[Any],
        actions: spaces.Space[Any],
        nan: NanPolicy,
    ) -> None:
        self._signals = signals
        self._called = [
            index
            for index, signal in enumerate(signals)
            if signal.source is None and not isinstance(signal.reads, Batched)
        ]
        self._selected = [index for index in range(len(signals)) if index not in self._called]
        self._spaces = observations, actions
        self._nan = nan
        self._compare = True  # compare the results of marked functions in the first episode
        self._columns(1)  # raises now if a selector does not fit

    def table(self, episode: RecordedEpisode, rewards: Floats) -> Floats:
        """Return the signals of an episode: a row for the reset, and one for every step."""
        note = f"in episode {episode.number}"
        try:
            table = self._read(episode, rewards)
            self._check(table)
        except RtamtError as error:
            error.add_note(note)
            raise
        except (IndexError, KeyError, TypeError) as error:
            other = InputError(
                "expected observations and actions of one form in all episodes, got others than "
                f"in the first: {type(error).__name__}: {error}"
            )
            other.add_note(note)
            raise other from error
        return table

    def _columns(self, num: int) -> SignalColumns:
        """Return the signals of a number of steps."""
        signals = [self._signals[index] for index in self._selected]
        observations, actions = self._spaces
        entries: Any = SimpleNamespace(
            num_envs=num,
            single_observation_space=observations,
            single_action_space=actions,
            observation_space=batch_space(observations, num),
            action_space=batch_space(actions, num),
        )
        return SignalColumns(signals, entries, same_step=False, compare=self._compare)

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
        for index, signal in enumerate(self._signals):
            # An info that has no value at reset is padded with nan in a dataset.
            if signal.default is not None and np.isnan(table[0, index]):
                table[0, index] = signal.default
        for index in self._called:
            signal = self._signals[index]
            for k in range(len(table)):
                if k == 0 and signal.default is not None:
                    table[k, index] = signal.default
                    continue
                step = Step(part(obs, 0), None, None, part(first, 0), None)
                if k:
                    info = part(later, k - 1)
                    step = Step(part(obs, k), part(actions, k - 1), rewards[k - 1], info, None)
                table[k, index] = signal.number(signal.call(step))
        return table

    def _check(self, table: Floats) -> None:
        if self._nan == "unknown":
            return
        missing = np.isnan(table)
        unknown = [
            signal.default is not None and np.isnan(signal.default) for signal in self._signals
        ]
        missing[0] &= ~np.array(unknown, np.bool_)
        places = np.argwhere(missing)
        if len(places) == 0 or (self._nan == "hold" and places[0, 0] > 0):
            return
        sample, column = places[0]
        way_out = "; nan='hold' keeps the last value"
        if sample == 0:
            way_out += ", and the first sample has none"
        raise InputError(
            f"signal {self._signals[column].name!r} is nan at sample {sample}{way_out}"
        )


def _split(infos: Mapping[str, Any], steps: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split infos into those of the reset and of the steps; the reset has no info of n elements."""
    first: dict[str, Any] = {}
    later: dict[str, Any] = {}
    for key, value in infos.items():
        if isinstance(value, Mapping):
            first[key], later[key] = _split(value, steps)
            continue
        entries = np.asarray(value)
        if entries.ndim and len(entries) == steps + 1:
            first[key], later[key] = entries[:1], entries[1:]
        else:  # a selector that reads another length raises
            later[key] = entries
    return first, later


def is_dataset(value: object) -> bool:
    """Return whether a value is a dataset of Minari, without importing Minari."""
    minari: Any = sys.modules.get("minari")
    return minari is not None and isinstance(value, minari.MinariDataset)


def episodes_of(dataset: Any) -> Iterator[RecordedEpisode]:  # noqa: ANN401 - Minari is not typed
    """Yield the episodes of a dataset, or of any iterable."""
    if is_dataset(dataset):
        metadata = dataset.storage.get_episode_metadata(dataset.episode_indices)
        for episode, reset in zip(dataset.iterate_episodes(), metadata, strict=True):
            yield read_episode(episode, episode.id, reset)
        return
    if isinstance(dataset, str | Mapping) or not isinstance(dataset, Iterable):
        way_out = "; load it: minari.load_dataset(...)" if isinstance(dataset, str) else ""
        raise InputTypeError(
            "expected a dataset of Minari or an iterable of episodes, got "
            f"{dataset if isinstance(dataset, str) else type(dataset).__name__}{way_out}"
        )
    for number, episode in enumerate(dataset):
        yield read_episode(episode, number)


def spaces_of(
    dataset: Any,  # noqa: ANN401
    episode: RecordedEpisode,
) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """Return the spaces of observations and actions, of the dataset or of its first episode."""
    if is_dataset(dataset):
        return dataset.observation_space, dataset.action_space
    return space_of(episode.observations), space_of(episode.actions)


def described(
    specs: Mapping[str, Specification],
    signals: Sequence[ParsedSignal],
    mode: str | None,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """Return how a dataset was relabelled, as values of JSON."""
    return {
        "specs": {name: str(spec) for name, spec in specs.items()},
        "signals": {signal.name: str(signal) for signal in signals},
        "mode": mode,
        **{name: _plain(value) for name, value in options.items()},
    }


def _plain(value: Any) -> Any:  # noqa: ANN401 - of an option
    if isinstance(value, Mapping):
        return {name: _plain(element) for name, element in value.items()}
    if isinstance(value, str | bool | int | float | None):
        return value
    return [*value] if isinstance(value, Iterable) else str(value)


class Store:
    """A new dataset, which exists after the first call of `add`.

    It copies metadata from ``source``; the metadata ``rtamt`` is the ``description``.
    """

    def __init__(self, dataset_id: str, source: Any, description: dict[str, Any]) -> None:  # noqa: ANN401
        try:
            import minari  # noqa: F401 - raises the error below
            from minari.dataset.minari_dataset import parse_dataset_id
            from minari.storage.datasets_root_dir import get_dataset_path
        except ModuleNotFoundError as error:
            raise naming_extra(error, "relabel(dataset_id=)") from error
        try:
            parse_dataset_id(dataset_id)
        except (TypeError, ValueError):  # the first without a version
            raise InputError(
                f'expected dataset_id= as Minari writes names, such as "cart/safe-v0", got '
                f"{dataset_id!r}"
            ) from None
        self._folder = Path(get_dataset_path(dataset_id))
        if self._folder.exists():
            raise InputError(
                f"expected dataset_id= as a new name, got {dataset_id!r}, which is in "
                f"{self._folder}; choose another name, or call "
                f"minari.delete_dataset({dataset_id!r})"
            )
        self._id, self._source, self._description = dataset_id, source, description
        self._old = {} if source is None else source.storage.metadata
        self._format = self._old.get("data_format")
        self._dataset: Any = None

    def add(self, episodes: Sequence[RelabelledEpisode]) -> None:
        """Write episodes."""
        from minari.data_collector import EpisodeBuffer

        if not episodes:
            return
        infos = _listed if self._format == "arrow" else dict
        buffers = [
            EpisodeBuffer(
                seed=episode.seed,
                options=episode.options,
                observations=episode.observations,
                actions=episode.actions,
                rewards=episode.rewards,
                terminations=episode.terminations,
                truncations=episode.truncations,
                infos=infos(episode.infos),
            )
            for episode in episodes
        ]
        if self._dataset is None:
            self._dataset = self._create(episodes[0], buffers)
        else:
            self._dataset.update_dataset_from_buffer(buffers)

    def _create(self, first: RecordedEpisode, buffers: Sequence[Any]) -> Any:  # noqa: ANN401
        import minari

        old = self._old
        form = {name: old[name] for name in ("data_format", "jpeg_encoding") if name in old}
        observations, actions = spaces_of(self._source, first)
        with warnings.catch_warnings():
            # It warns about a missing author and the like, which are copied below.
            warnings.simplefilter("ignore", UserWarning)
            dataset = minari.create_dataset_from_buffers(
                self._id,
                list(buffers),
                observation_space=observations,
                action_space=actions,
                **form,
            )
        left_out = _OWN | (_OF_REWARDS if self._description["mode"] else frozenset())
        metadata = {name: value for name, value in old.items() if name not in left_out}
        dataset.storage.update_metadata({**metadata, "rtamt": self._description})
        return minari.load_dataset(self._id)

    def finish(self) -> Any:  # noqa: ANN401
        """Return the dataset; raise InputError if it has no episode."""
        if self._dataset is None:
            raise InputError(
                f"no episode is left for {self._id!r}: there are no episodes, or keep= rejects "
                "all; no dataset was written"
            )
        return self._dataset

    def discard(self) -> None:
        """Remove the written files."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _listed(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Return the infos with lists: Minari cannot read back Arrow arrays of one dimension."""
    listed: dict[str, Any] = {}
    for key, value in infos.items():
        if isinstance(value, Mapping):
            listed[key] = _listed(value)
        else:
            listed[key] = value.tolist() if np.ndim(value) == 1 else value
    return listed


_OWN = frozenset(
    {
        "dataset_id",
        "data_format",
        "jpeg_encoding",
        "observation_space",
        "action_space",
        "minari_version",
        "total_episodes",
        "total_steps",
        "dataset_size",
    }
)
"""The metadata that every dataset sets itself."""


_OF_REWARDS = frozenset({"ref_max_score", "ref_min_score", "num_episodes_average_score"})
"""The metadata about the environment's own rewards."""
