"""`relabel`: robustness, costs, success and shaped rewards for recorded episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, Unpack, overload

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, Specification
from rtamt.errors import Argument, nearest
from rtamt.typing import Period
from rtamt_gym.checks.names import listing
from rtamt_gym.datasets.episodes import (
    RecordedEpisode,
    RelabelledEpisode,
    SignalReader,
    Store,
    described,
    episodes_of,
    is_dataset,
    part,
    size_of,
    spaces_of,
)
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.specs import SpecsLike, check_period, load_specs, with_unknown_start
from rtamt_gym.options.evaluation import EvaluationKeywords, EvaluationOptions, names_for
from rtamt_gym.shaping import Mode, ShapingNumbers
from rtamt_gym.signals.columns import Batch, Entries, Floats
from rtamt_gym.signals.periods import read_period, warn_of_unverified_period, why_no_period
from rtamt_gym.signals.signals import SignalLike, parse_signals
from rtamt_gym.signals.sources import STEP
from rtamt_gym.wrappers.reward import ShapingOptions, VectorStlReward
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor


class Tape:
    """Recorded episodes in sequence: a row for every sample, and a row for idle environments."""

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
    """A vector environment that plays a tape; actions do nothing."""

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
        actions: Any,  # noqa: ANN401, ARG002 - the episodes are recorded
    ) -> tuple[Floats, Floats, Entries, Entries, dict[str, Any]]:
        """Show the next sample of every episode, or the first of the next one."""
        self._advance()
        tape, rows = self.tape, self.rows
        terminated, truncated = tape.terminated[rows], tape.truncated[rows]
        self._ended = terminated | truncated
        return tape.signals[rows], tape.rewards[rows], terminated, truncated, {}

    @property
    def playing(self) -> bool:
        """Whether an episode is running or waiting."""
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
    """The results of the wrappers for every sample of a tape, and for the ends of its episodes."""

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


KeepEpisodes = Literal["all", "satisfied"] | Callable[[RelabelledEpisode], bool]
"""The selection of episodes."""

ENTRIES = 256
"""The maximum number of episodes that are played side by side."""

SAMPLES, BYTES = 1 << 18, 1 << 28
"""The number of samples, or of bytes of observations and actions, that memory holds."""


class RelabelOptions(EvaluationKeywords, ShapingNumbers, total=False):
    """The options of `StlMonitor` and `StlReward` that apply to recorded episodes."""

    details: bool
    cost: Cost | None


OPTIONS = (*names_for("recorded"), *ShapingNumbers.__annotations__, "details", "cost")
"""The names of the options."""


@overload
def relabel(
    dataset: Any,  # noqa: ANN401 - Minari is not typed
    specs: SpecsLike,
    signals: Mapping[str, SignalLike],
    *,
    dataset_id: None = None,
    keep: KeepEpisodes = "all",
    mode: Mode | None = None,
    **options: Unpack[RelabelOptions],
) -> list[RelabelledEpisode]: ...
@overload
def relabel(
    dataset: Any,  # noqa: ANN401
    specs: SpecsLike,
    signals: Mapping[str, SignalLike],
    *,
    dataset_id: str,
    keep: KeepEpisodes = "all",
    mode: Mode | None = None,
    **options: Unpack[RelabelOptions],
) -> Any: ...  # noqa: ANN401
def relabel(
    dataset: Any,
    specs: SpecsLike,
    signals: Mapping[str, SignalLike],
    *,
    dataset_id: str | None = None,
    keep: KeepEpisodes = "all",
    mode: Mode | None = None,
    **options: Unpack[RelabelOptions],
) -> Any:
    """Add robustness, costs and rewards to recorded episodes.

    The results equal the results of `StlMonitor` with ``on_violation="report"``, to the last bit;
    with a ``mode``, the rewards equal the rewards of `StlReward`. The infos get arrays with an
    element for every sample, the first for the reset; entries of these names are replaced:

    * ``robustness``, ``stl_lower``, ``stl_upper``, ``stl_violated``; with ``details=True`` also
      ``stl``, ``{spec: {"robustness", "lower", "upper"}}``
    * ``stl_progress`` of requirements in stages
    * ``cost`` with ``cost=``, and ``cost_NAME`` for each of several specifications; 0 at the reset
    * ``stl_success``, ``stl_undecided``, ``is_success``: true at the last sample only, if at all;
      an existing ``is_success`` stays
    * ``reward`` with ``mode=``: the environment's own reward; 0 at the reset

    An episode with a last step that neither terminates nor truncates counts as truncated. A dataset
    is read and written in parts, so a new dataset may be larger than memory.

    Args:
        dataset: A dataset of Minari, or an iterable of episodes: ``EpisodeData``, ``EpisodeBuffer``
            or mappings with ``observations`` (one more than steps), ``actions``, ``rewards``,
            ``terminations``, ``truncations`` and optionally ``infos``, ``seed`` and ``options``.
        specs: As for `StlMonitor`.
        signals: As for `StlMonitor`, except selectors that read a simulation. A callable gets a
            `Step` with ``env`` None.
        dataset_id: The name of a new dataset of Minari, such as ``"cart/safe-v0"``. Default: a list
            in memory.
        keep: ``"all"``, ``"satisfied"``, or a function of an episode that selects episodes.
        mode: The reward, as for `StlReward`. Default: the recorded rewards.
        **options: Evaluation options, ``details`` and ``cost`` of `StlMonitor`; with a mode, also
            ``weight``, ``clip``, ``gamma``, ``temperature``, ``weights``, ``priorities``, ``bonus``
            and ``penalty`` of `StlReward`. A missing period is read from the dataset's environment.

    Returns:
        The selected episodes in order: a list of `RelabelledEpisode`, or a dataset of Minari with
        the old metadata and an entry ``rtamt`` that describes the options.

    Raises:
        SpecificationError: As `StlMonitor` does.
        InputError: As `StlMonitor` and `StlReward` do; if an episode is incomplete, the new name is
            taken or invalid, or no episode is left. Then no dataset is written.
        ModuleNotFoundError: If ``dataset_id`` is set and Minari is not installed.

    Example:
        >>> from rtamt_gym import relabel
        >>> episode = {
        ...     "observations": [[0.5], [0.2], [-0.1]],
        ...     "actions": [[0.0], [0.0]],
        ...     "rewards": [1.0, 1.0],
        ...     "terminations": [False, False],
        ...     "truncations": [False, True],
        ... }
        >>> found = relabel([episode], "always(x > 0)", {"x": "obs[0]"}, mode="add", weight=10)
        >>> found[0].satisfied, found[0].rewards, found[0].infos["robustness"]
        (False, array([3., 0.]), array([ 0.5,  0.2, -0.1]))
    """
    check_options(mode, keep, options)
    loaded = load_specs(specs)
    variables = [name for spec in loaded.values() for name in spec.variables]
    readings = parse_signals(signals, variables, STEP)
    nan = options.get("nan", "raise")
    cost = [Argument("cost", options["cost"])] if options.get("cost") is not None else []
    read = {name: signals.get(name) for name in variables}
    evaluation = EvaluationOptions(view=options.get("view", "episode"), nan=nan)
    known, _ = with_unknown_start(evaluation, read, *cost)
    options = {**options, "period": _period(dataset, loaded, options.get("period"))}
    if known.nan != nan:
        options["nan"] = known.nan
    names = [reading.name for reading in readings]
    store = None
    if dataset_id is not None:
        description = described(loaded, readings, mode, options)
        store = Store(dataset_id, dataset if is_dataset(dataset) else None, description)
    kept: list[RelabelledEpisode] = []
    reader: SignalReader | None = None
    judges: tuple[Playback, Batch] | None = None
    try:
        for episodes in _parts(episodes_of(dataset)):
            if reader is None or judges is None:
                spaces = spaces_of(dataset, episodes[0])
                reader = SignalReader(readings, *spaces, nan)
                playback = Playback(min(ENTRIES, len(episodes)), len(names))
                judges = playback, _judge(playback, loaded, names, mode, options)
            relabelled = _judged(episodes, reader, *judges, shaped=mode is not None)
            chosen = [episode for episode in relabelled if _keeps(keep, episode)]
            if store is None:
                kept += chosen
            else:
                store.add(chosen)
        return kept if store is None else store.finish()
    except BaseException:
        if store is not None:
            store.discard()
        raise


def check_options(mode: Mode | None, keep: object, options: Mapping[str, object]) -> None:
    """Refuse options that do not apply to recorded episodes."""
    for name in options:
        if name not in OPTIONS:
            raise InputTypeError(
                f"relabel() has no option {name!r}; the options are {listing(OPTIONS)}"
                f"{nearest(name, OPTIONS)}"
            )
        if mode is None and name in ShapingOptions.__annotations__:
            raise InputError(f'{name}= belongs to shaped rewards; pass a mode, such as mode="add"')
    if keep not in {"all", "satisfied"} and not callable(keep):
        raise InputError(
            f'expected keep="all", "satisfied" or a function of an episode, got {keep!r}'
        )


def _keeps(keep: KeepEpisodes, episode: RelabelledEpisode) -> bool:
    if callable(keep):
        return keep(episode)
    return keep == "all" or episode.satisfied


def _period(
    dataset: Any,  # noqa: ANN401 - Minari is not typed
    specs: Mapping[str, Specification],
    period: Period | None,
) -> Period | None:
    """Return the period, from the environment that the dataset names if it is needed."""
    if period is not None or not any(spec.timed for spec in specs.values()):
        return period
    why = "it names no environment"
    if is_dataset(dataset) and dataset.env_spec is not None:
        try:
            env = gym.make(dataset.env_spec)
        except Exception as error:
            error.add_note("when the environment of the dataset was made, to read its period;")
            error.add_note("give period=, which needs none")
            raise
        period, why = read_period(env), f"of its environment: {why_no_period(env)}"
        if period is not None:
            warn_of_unverified_period(env)
        env.close()
    check_period(specs, period, "the dataset", why)
    return period


def _judge(
    playback: Playback,
    specs: Mapping[str, Specification],
    names: Sequence[str],
    mode: Mode | None,
    options: Mapping[str, Any],
) -> Batch:
    """Return the wrapper that judges a playback."""
    signals = {name: f"obs[{column}]" for column, name in enumerate(names)}
    judge_options: dict[str, Any] = {**options, "on_violation": "report", "buffer_length": 0}
    if mode is None:
        return VectorStlMonitor(playback, dict(specs), signals, **judge_options)
    return VectorStlReward(playback, dict(specs), signals, mode=mode, **judge_options)


def _parts(episodes: Iterable[RecordedEpisode]) -> Iterator[list[RecordedEpisode]]:
    """Yield the episodes in lists that fit into memory."""
    episodes_held: list[RecordedEpisode] = []
    samples = size = 0
    for episode in episodes:
        episodes_held.append(episode)
        samples, size = samples + len(episode) + 1, size + size_of(episode)
        if samples >= SAMPLES or size >= BYTES:
            yield episodes_held
            episodes_held, samples, size = [], 0, 0
    if episodes_held:
        yield episodes_held


def _judged(
    episodes: Sequence[RecordedEpisode],
    reader: SignalReader,
    playback: Playback,
    judge: Batch,
    *,
    shaped: bool,
) -> Iterator[RelabelledEpisode]:
    """Judge episodes, in their order."""
    own = [_own_rewards(episode) for episode in episodes]
    tables = [
        reader.table(episode, rewards) for episode, rewards in zip(episodes, own, strict=True)
    ]
    playback.tape = tape = Tape(episodes, tables, own)
    judged = play(judge, playback)
    for episode, begin, end in zip(episodes, tape.starts, tape.starts[1:] - 1, strict=False):
        rows = slice(begin, end + 1)
        by, sample = judged.violations.get(end, (None, None))
        yield RelabelledEpisode(
            episode.number,
            episode.observations,
            episode.actions,
            judged.rewards[rows][1:].copy() if shaped else episode.rewards,
            episode.terminations,
            episode.truncations,
            _infos(episode, judged, rows),
            episode.seed,
            episode.options,
            judged.outcomes[end],
            by,
            sample,
        )


def _own_rewards(episode: RecordedEpisode) -> Floats:
    """Return the rewards of the environment itself, even if they were shaped before."""
    infos = episode.infos
    if "stl_lower" in infos and len(infos.get("reward", ())) == len(episode) + 1:
        return np.asarray(infos["reward"], np.float64)[1:]
    return np.asarray(episode.rewards, np.float64)


def _infos(episode: RecordedEpisode, judged: JudgedTape, rows: slice) -> dict[str, Any]:
    """Return the infos of an episode, with the keys of the monitors."""
    added = part(judged.columns, rows)
    if "is_success" in episode.infos:
        del added["is_success"]
    return {**episode.infos, **_copied(added)}


def _copied(tree: Any) -> Any:  # noqa: ANN401 - of arrays
    return {k: _copied(v) for k, v in tree.items()} if isinstance(tree, dict) else tree.copy()
