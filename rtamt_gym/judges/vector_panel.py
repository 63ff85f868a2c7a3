"""The specifications of a vector wrapper: monitors in lockstep, and what they have decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt_gym.judges.episodes import outcome, record
from rtamt_gym.judges.infos import mask_of, put, put_at, put_group, who_has
from rtamt_gym.judges.specs import Nan, View, check_looks_ahead
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["Ended", "InstantMonitors", "Lockstep", "Reading"]

_WORDS = np.array(["UNDECIDED", "SATISFIED", "VIOLATED"], dtype=object)
"""By verdict: 0, 1, -1."""


class InstantMonitors:
    """`InstantMonitor` of all environments: ``view="step"``.

    Attributes:
        robustness: Of every environment's newest instant whose horizon has passed; before the
            first, that of the samples so far.
        judge: Bounds and verdicts of ``always(formula)``, fed with the same samples.
    """

    def __init__(
        self, spec: rtamt.Specification, num: int, period: float | str | None, nan: Nan
    ) -> None:
        self._instant = rtamt.VectorMonitor(spec, num, period, nan=nan)
        self._sofar = rtamt.VectorEpisodeMonitor(spec, num, period, nan=nan)
        self.judge = rtamt.VectorEpisodeMonitor(spec.always(), num, period, nan=nan)
        self.robustness = np.full(num, np.nan)

    def update(self, values: Floats, mask: Lanes | None = None) -> Floats:
        """Feeds one sample; returns the robustness."""
        robustness = self._instant.update(values, mask)
        self.judge.update(values, mask)
        early = np.isnan(robustness)
        if early.any():
            fed = early if mask is None else early & mask
            robustness = np.where(early, self._sofar.update(values, fed), robustness)
        self.robustness = robustness
        return robustness

    def reset(self, mask: Lanes | None = None) -> None:
        """Forgets every sample of the environments of the mask."""
        self._instant.reset(mask)
        self._sofar.reset(mask)
        self.judge.reset(mask)


class Reading(NamedTuple):
    """What the monitors say: by specification an array with a number for every environment.

    Attributes:
        robustness: What ``info["robustness"]`` is the least of.
        judged: Robustness of the whole episode.
        lower: The least that it can still become.
        upper: The greatest.
        samples: Samples of every environment's episode.
    """

    robustness: list[Floats]
    judged: list[Floats]
    lower: list[Floats]
    upper: list[Floats]
    samples: NDArray[np.int64]


class Lockstep:
    """Monitors of several specifications in every environment.

    Attributes:
        names: Of the specifications.
        judges: By specification who judges the episodes.
        robustness: The least over the specifications, of every environment.
        lower: Likewise the least that it can still become.
        upper: Likewise the greatest.
        violated: Whether no continuation satisfies all specifications.

    Args:
        specs: By name.
        num: How many environments.
        period: Time between samples.
        view: Whether formulas speak of the episode or of every instant.
        nan: Whether a signal that is nan is refused, or keeps its last value.
        columns: Names of the columns of what is fed.

    Raises:
        SpecificationError: As `rtamt_gym.judges.specs.make_monitor` does.
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        num: int,
        period: float | str | None,
        view: View,
        nan: Nan,
        columns: Sequence[str],
    ) -> None:
        self._num = num
        self.names = tuple(specs)
        self._sources: list[rtamt.VectorEpisodeMonitor | InstantMonitors] = []
        self.judges: list[rtamt.VectorEpisodeMonitor] = []
        self._picks: list[list[int] | None] = []
        for name, spec in specs.items():
            if view == "step":
                instant = InstantMonitors(spec, num, period, nan)
                self._sources.append(instant)
                self.judges.append(instant.judge)
            else:
                check_looks_ahead(name, spec)
                self.judges.append(rtamt.VectorEpisodeMonitor(spec, num, period, nan=nan))
                self._sources.append(self.judges[-1])
            pick = [columns.index(variable) for variable in spec.variables]
            self._picks.append(None if pick == list(range(len(columns))) else pick)
        # By specification and environment the sample that decided it, -1 while it is open.
        self._decided_at = np.full((len(specs), num), -1)
        # By environment the place of the specification that was violated first, -1 if none was.
        self._violated_by = np.full(num, -1)
        self._settled = 0
        self.robustness = self.lower = self.upper = np.full(num, np.nan)
        self.violated = np.zeros(num, np.bool_)

    @property
    def samples(self) -> NDArray[np.int64]:
        """Samples of every environment's episode; a fresh array."""
        return self.judges[0].samples

    def reset(self, lanes: Lanes | None = None) -> None:
        """Forgets the episodes of the environments of the mask; None: of all."""
        for source in self._sources:
            source.reset(lanes)
        which = slice(None) if lanes is None else lanes
        self._decided_at[:, which] = -1
        self._violated_by[which] = -1
        self._settled = int(np.count_nonzero(self._decided_at >= 0))

    def feed(self, table: Floats, lanes: Lanes | None = None) -> None:
        """Feeds a row of the table to every environment of the mask; None: to all."""
        found = [
            source.update(table if pick is None else table[:, pick], lanes)
            for source, pick in zip(self._sources, self._picks, strict=True)
        ]
        self.robustness = _least(found)
        self._look()

    def finish(self, lanes: Lanes) -> None:
        """Ends the traces of the environments of the mask."""
        for judge in self.judges:
            judge.finish(lanes)
        self._look()

    def read(self) -> Reading:
        """What the monitors say now."""
        return Reading(
            [source.robustness for source in self._sources],
            [judge.robustness for judge in self.judges],
            [judge.lower for judge in self.judges],
            [judge.upper for judge in self.judges],
            self.samples,
        )

    def describe(self, infos: dict[str, Any], lanes: Lanes | None) -> None:
        """Adds ``stl``, the state of every specification."""
        states: dict[str, Any] = {}
        for name, source, judge in zip(self.names, self._sources, self.judges, strict=True):
            state: dict[str, Any] = {}
            put(state, "robustness", source.robustness, lanes)
            put(state, "lower", judge.lower, lanes)
            put(state, "upper", judge.upper, lanes)
            put(state, "verdict", _WORDS[judge.verdict], lanes)
            put_group(states, name, state, lanes, self._num)
        put_group(infos, "stl", states, lanes, self._num)

    def ended(self, lanes: Lanes, terminated: Lanes, truncated: Lanes) -> Ended:
        """What became of the episodes of the mask, which have ended."""
        at = np.flatnonzero(lanes)
        return Ended(
            self.names,
            self._num,
            at,
            self.samples[at],
            terminated[at],
            truncated[at],
            np.array([judge.robustness[at] for judge in self.judges]),
            np.array([judge.verdict[at] for judge in self.judges]),
            self._decided_at[:, at],
            self._violated_by[at],
        )

    @property
    def failed(self) -> Lanes:
        """The environments in which a specification is violated."""
        return np.asarray(self._violated_by >= 0)

    def _look(self) -> None:
        """Reads the bounds, and notes the verdicts that they have decided."""
        verdicts = [judge.verdict for judge in self.judges]
        self.lower = _least([judge.lower for judge in self.judges])
        self.upper = _least([judge.upper for judge in self.judges])
        self.violated = _least(verdicts) < 0
        # Verdicts stay until the reset, so a count says whether one is new.
        settled = 0
        for verdict in verdicts:
            settled += int(np.count_nonzero(verdict))
        if settled == self._settled:
            return
        self._settled = settled
        for place, (judge, verdict) in enumerate(zip(self.judges, verdicts, strict=True)):
            new = np.flatnonzero((verdict != 0) & (self._decided_at[place] < 0))
            self._decided_at[place, new] = judge.samples[new] - 1
            first = new[(verdict[new] < 0) & (self._violated_by[new] < 0)]
            self._violated_by[first] = place


class Ended(NamedTuple):
    """Episodes that ended in one step, an element each.

    Attributes:
        names: Of the specifications.
        num: How many environments there are.
        envs: Numbers of the environments.
        samples: Samples of the episodes.
        terminated: How they ended.
        truncated: Likewise.
        robustness: By specification, of the whole episode.
        verdict: Likewise.
        decided_at: Likewise; -1 if it is open.
        violated_by: Place of the specification that was violated first; -1 if none was.
    """

    names: tuple[str, ...]
    num: int
    envs: NDArray[np.int64]
    samples: NDArray[np.int64]
    terminated: Lanes
    truncated: Lanes
    robustness: Floats
    verdict: NDArray[np.int8]
    decided_at: NDArray[np.int64]
    violated_by: NDArray[np.int64]

    def put(self, infos: dict[str, Any]) -> None:
        """Adds what the infos of the last steps have more than others."""
        at, num, failed = self.envs, self.num, self.violated_by >= 0
        episode: dict[str, Any] = {}
        everyone = mask_of(at, num)
        for name, robustness, verdict, decided_at in zip(
            self.names, self.robustness, self.verdict, self.decided_at, strict=True
        ):
            decided = decided_at >= 0
            said: dict[str, Any] = {}
            put_at(said, "robustness", robustness, at, num)
            put_at(said, "verdict", _WORDS[verdict], at, num)
            put_at(said, "satisfied", verdict > 0, at, num)
            put_at(said, "decided_at", decided_at[decided], at[decided], num)
            put_group(episode, name, said, everyone, num)
        put_group(infos, "stl_episode", episode, everyone, num)
        by, violated = self.violated_by[failed], at[failed]
        names = np.array(self.names, dtype=object)
        put_at(infos, "stl_violated_by", names[by], violated, num)
        put_at(infos, "stl_violated_at", self.decided_at[by, np.flatnonzero(failed)], violated, num)
        known = failed | np.all(self.decided_at >= 0, axis=0)
        own = who_has(infos, "is_success", num)
        if own.any():  # the environment's word stands
            known &= ~own[at]
            held = np.array(infos["is_success"])
            held[at[known]] = ~failed[known]
            put(infos, "is_success", held, own | mask_of(at[known], num))
        else:
            put_at(infos, "is_success", ~failed[known], at[known], num)

    def records(self, newest: int) -> list[dict[str, Any]]:
        """What `StlMonitor.stl_episodes` has of the newest of them, and ``"env"``, the number."""
        made = []
        for i, env in islice(enumerate(self.envs), max(len(self.envs) - newest, 0), None):
            specs = {
                name: outcome(
                    float(self.robustness[place, i]),
                    str(_WORDS[self.verdict[place, i]]),
                    int(at) if (at := self.decided_at[place, i]) >= 0 else None,
                )
                for place, name in enumerate(self.names)
            }
            by = self.violated_by[i]
            kept = record(
                specs,
                self.names[by] if by >= 0 else None,
                samples=int(self.samples[i]),
                terminated=bool(self.terminated[i]),
                truncated=bool(self.truncated[i]),
            )
            made.append({"env": int(env), **kept})
        return made


def _least(values: Sequence[NDArray[Any]]) -> NDArray[Any]:
    least = values[0]
    for other in values[1:]:
        least = np.minimum(least, other)
    return least
