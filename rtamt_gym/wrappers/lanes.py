"""What `VectorStlMonitor` says of episodes in its infos, and what it does at their ends."""

from __future__ import annotations

from typing import Any

import numpy as np

from rtamt_gym.judging.episodes import EpisodeRecords, record
from rtamt_gym.judging.infos import last_info, step_info
from rtamt_gym.judging.vector_infos import key_mask, put, put_last
from rtamt_gym.judging.vector_panel import VectorPanel
from rtamt_gym.signals.columns import Floats, Lanes
from rtamt_gym.wrappers.monitoring import Monitoring

__all__ = ["LaneMonitoring", "flagged"]


class LaneMonitoring(Monitoring):
    """The base of `VectorStlMonitor`."""

    num_envs: int
    _panel: VectorPanel
    _episodes: EpisodeRecords
    _done: Lanes | None
    _running: bool

    def _certain(self) -> list[tuple[Lanes, str]]:
        """The environments whose episodes a certain verdict ends, and how."""
        panel = self._panel
        found: list[tuple[Lanes, str]] = []
        if self._on_violation != "report":
            found.append((panel.violated_at >= 0, self._on_violation))
        if self._on_satisfaction != "report":
            satisfied = panel.success(np.arange(self.num_envs))
            found.append((satisfied, self._on_satisfaction))
        return found

    def _report(
        self,
        infos: dict[str, Any],
        lanes: Lanes | None,
        costs: dict[str, Floats] | None = None,
        charged: Lanes | None = None,
    ) -> None:
        """Adds the keys that every info has, to the environments of the mask; None: to all.

        The costs are added to the environments ``charged``; None: to all.
        """
        panel = self._panel
        states = panel.describe() if self._details else None
        violated = panel.violated_at >= 0
        added = step_info({}, panel.robustness, panel.lower, panel.upper, violated, states)
        for key, value in added.items():
            put(infos, key, value, lanes, self.num_envs)
        for key, cost in (costs or {}).items():
            put(infos, key, cost, charged, self.num_envs)

    def _finish(self, terminated: Lanes, truncated: Lanes) -> None:
        """Reads the ends that the environments have made."""
        panel, names = self._panel, list(self._panel.monitors)
        at = terminated.nonzero()[0]
        undecided = panel.undecided(at) if self._unasked else None
        panel.finish(terminated, self._at_termination)
        panel.finish(truncated & ~terminated, self._at_truncation)
        if undecided is not None:
            held = np.flatnonzero((undecided & panel.satisfied(at)).any(axis=1))
            self._assumed = names[held[0]] if len(held) else None

    def _conclude(
        self,
        infos: dict[str, Any],
        ended: Lanes,
        terminated: Any,  # noqa: ANN401
        truncated: Any,  # noqa: ANN401
    ) -> None:
        """Adds the keys that only the last infos of episodes have, and records the episodes."""
        panel, at = self._panel, ended.nonzero()[0]
        found = panel.outcomes(at), panel.violated_by[at], panel.violated_at[at]
        reported = key_mask(infos, "is_success", self.num_envs)
        undecided = panel.undecided(at).any(axis=0)
        last = last_info(*found, panel.success(at), undecided, reported[at])
        put_last(infos, last, at, ended, reported)
        flags = np.asarray(terminated)[at], np.asarray(truncated)[at]
        self._episodes.append(at, record(*found, panel.samples[at], *flags))
        self._seen_success |= bool(reported[at].any())

    def _abandon(self, lanes: Lanes) -> None:
        """Records what goes on in these environments as truncated: it was ended from outside."""
        if self._running:
            cut = lanes & (self._panel.samples > 1)
            if self._done is not None:
                cut &= ~self._done
            at, panel = cut.nonzero()[0], self._panel
            if len(at):
                panel.finish(cut, self._at_truncation)
                found = panel.outcomes(at), panel.violated_by[at], panel.violated_at[at]
                self._episodes.append(at, record(*found, panel.samples[at], ~cut[at], cut[at]))
        self._running = False


def flagged(lanes: Lanes, how: str, terminated: Any, truncated: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Sets a flag for the environments of the mask that are not terminated; returns both flags."""
    ended = lanes & ~np.asarray(terminated)
    if how == "terminate":
        return np.logical_or(terminated, ended), truncated
    return terminated, np.logical_or(truncated, ended)
