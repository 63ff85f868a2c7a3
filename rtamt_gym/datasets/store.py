"""Datasets of Minari: reading their episodes, and writing new ones part by part."""

from __future__ import annotations

import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from rtamt import InputError, InputTypeError, Specification
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.datasets.episodes import RecordedEpisode, RelabelledEpisode, read_episode, space_of
from rtamt_gym.signals.signals import ParsedSignal


def is_dataset(value: object) -> bool:
    """Return whether a value is a dataset of Minari; a loaded Minari has made it."""
    minari: Any = sys.modules.get("minari")
    return minari is not None and isinstance(value, minari.MinariDataset)


def episodes_of(dataset: Any) -> Iterator[RecordedEpisode]:  # noqa: ANN401 - Minari is not typed
    """Yield the episodes of a dataset, or of any iterable.

    Raises:
        InputTypeError: If it is not an iterable of episodes.
        InputError: If an episode is incomplete.
    """
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
    """A new dataset, which exists from the first episodes on.

    Args:
        dataset_id: Its name.
        source: The dataset to copy metadata from, or None.
        said: A description of how it is made, for the metadata.

    Raises:
        ModuleNotFoundError: If Minari is not installed; names the extra.
        InputError: If the name is taken or invalid.
    """

    def __init__(self, dataset_id: str, source: Any, said: dict[str, Any]) -> None:  # noqa: ANN401
        try:
            import minari  # noqa: F401 - the error below is about this one
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
        self._id, self._source, self._said = dataset_id, source, said
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
            self._dataset = self._made(episodes[0], buffers)
        else:
            self._dataset.update_dataset_from_buffer(buffers)

    def _made(self, first: RecordedEpisode, buffers: Sequence[Any]) -> Any:  # noqa: ANN401
        import minari

        old = self._old
        form = {name: old[name] for name in ("data_format", "jpeg_encoding") if name in old}
        observations, actions = spaces_of(self._source, first)
        with warnings.catch_warnings():
            # It asks for an author and the like, which are taken over below.
            warnings.simplefilter("ignore", UserWarning)
            dataset = minari.create_dataset_from_buffers(
                self._id,
                list(buffers),
                observation_space=observations,
                action_space=actions,
                **form,
            )
        left_out = _OWN | (_OF_REWARDS if self._said["mode"] else frozenset())
        metadata = {name: value for name, value in old.items() if name not in left_out}
        dataset.storage.update_metadata({**metadata, "rtamt": self._said})
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
"""What every dataset says of itself."""

_OF_REWARDS = frozenset({"ref_max_score", "ref_min_score", "num_episodes_average_score"})
"""What is true of the environment's own rewards alone."""
