"""What the monitors of one environment share: its samples, its end, the record of an episode."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np

from rtamt import Explanation, Specification, StateError
from rtamt_gym.judging.ends import assumed
from rtamt_gym.judging.episodes import record
from rtamt_gym.judging.explanations import chosen, titled
from rtamt_gym.judging.feeding import Assessment, Feed
from rtamt_gym.judging.infos import last_info, present
from rtamt_gym.judging.panel import Monitors, Panel
from rtamt_gym.signals.signals import Env, ParsedSignal, Read
from rtamt_gym.signals.step_time import StepTime
from rtamt_gym.signals.taps import Tap
from rtamt_gym.wrappers.monitoring import Monitoring, OnViolation

__all__ = ["EpisodeMonitoring"]

EpisodeOutcomes = tuple[dict[str, Any], bool, str | None, int | None]
"""The outcomes; whether a specification is violated, which was first, and at which sample."""


class EpisodeMonitoring(Monitoring):
    """The base of `StlMonitor` and `ParallelStlMonitor`."""

    stl_episodes: deque[dict[str, Any]]
    _panel: Panel
    _history: bool
    _watch: StepTime | None = None
    """What compares the period with the environment; None without a period."""
    _comparing: Feed
    """Feeds in the first steps of an episode, and compares the time."""
    _newest: dict[str, float] | None = None

    def newest_signals(self) -> dict[str, float]:
        """The signals of the newest sample by name, in a dictionary that every sample changes.

        They are kept from the first call on, so it is empty until the next sample.
        """
        if self._newest is None:
            self._newest = {}
            self._bind_signals()
        return self._newest

    @property
    def signal_names(self) -> tuple[str, ...]:
        """The names of the signals that the specifications read."""
        return tuple(signal.name for signal in self._signals)

    @property
    def bounds(self) -> tuple[float, float]:
        """The least and the greatest that the robustness can still become."""
        return self._panel.lower, self._panel.upper

    @property
    def first_violation(self) -> tuple[str, int] | None:
        """The specification that was violated first, and the sample that showed it."""
        name, at = self._panel.violated_by, self._panel.violated_at
        return None if name is None or at is None else (name, at)

    @property
    def samples(self) -> int:
        """Samples fed since :meth:`reset`, counting the sample of the reset."""
        return self._panel.samples

    @property
    def monitors(self) -> Monitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self._panel.monitors)

    def explain(self, name: str | None = None) -> Explanation:
        """Which sub-formulas and samples decided the robustness of the episode so far.

        It needs ``history=True``. After the last step it is about the whole episode, until the next
        :meth:`reset`; inside a vector environment that resets by itself, that is too late. Below
        other wrappers it is ``env.get_wrapper_attr("explain")()``. With ``view="step"`` it is about
        the worst instant: about ``always`` of the formula. A violation that ``at_termination=
        "failure"`` makes changes no robustness, and so no explanation.

        Args:
            name: The specification. None: the one that was violated first, or if none was the one
                with the least robustness.

        Raises:
            InputError: If there is no such specification.
            StateError: Without ``history=True``, or before the first :meth:`reset`.

        Example:
            >>> import gymnasium as gym
            >>> from rtamt_gym import StlMonitor
            >>> specs, signals = {"upright": "always(abs(theta) < 0.1)"}, {"theta": "obs[2]"}
            >>> env = StlMonitor(gym.make("CartPole-v1"), specs, signals, history=True)
            >>> _, info = env.reset(seed=123)
            >>> while not info["stl_violated"]:
            ...     *_, info = env.step(1)
            >>> print(env.explain())
            robustness -0.0227786 at 0 s, decided by abs(theta) < 0.1 at 0.12 s
            <BLANKLINE>
                at       value  formula
               0 s  -0.0227786  upright = always(abs(theta) < 0.1)
            0.12 s  -0.0227786  abs(theta) < 0.1
            0.12 s   -0.122779  theta
        """
        pairs = self._panel.monitors
        robustness = {each: judge.robustness for each, (_, judge) in pairs.items()}
        name = chosen(name, robustness, self._panel.violated_by)
        source, judge = pairs[name]
        root = judge.specification.formula
        formula = root if source is judge else root.args[0]  # the judge's is always(formula)
        return titled(judge.explain(), name, formula)

    def _make_panel(self, specs: Mapping[str, Specification]) -> Panel:
        return Panel(specs, self._of_monitors, self._cost, history=self._history)

    @property
    def _told_period(self) -> np.float64 | None:
        """What the info of a reset says of the period."""
        period = self._panel.period
        return None if period is None else np.float64(period)

    def _bind_signals(self) -> None:
        signals = self._readings()
        names = [signal.name for signal in signals]
        tap, feeder = self._beneath, self._panel.feeder
        env = self.env if tap is None else tap.env
        feed = feeder(names, [signal.bind(env) for signal in signals])
        feed_reset = feeder(names, [signal.bind_reset(env) for signal in signals])
        if tap is not None:
            feed, feed_reset = _fed_by(tap, feed), _fed_by(tap, feed_reset)
        self._feed: Feed = self._compared(feed)
        self._feed_reset: Feed = feed_reset

    def _compared(self, feed: Feed, *, substeps: bool = False) -> Feed:
        """Return the function that feeds; in the first steps of an episode it compares the time."""
        watch, panel = self._watch, self._panel
        if watch is None:
            return feed

        def compare_and_feed(*step: Any) -> Assessment:  # noqa: ANN401 - the arguments of a `Read`
            watch.step(panel.samples - 1 - watch.samples if substeps else 1)
            if not watch.left:
                self._feed = feed
            return feed(*step)

        self._comparing = compare_and_feed
        return compare_and_feed if watch.left else feed

    def _begin_times(self) -> None:
        """Compare the period after a reset of the environment; the time now is that of sample 0.

        Raises:
            StateError: If the environment has changed its period since construction.
        """
        if self._watch is not None:
            self._watch.begin()
            if self._watch.left:
                self._feed = self._comparing

    def _readings(self) -> Sequence[ParsedSignal]:
        """The signals; where somebody wants to see them, such that their values are kept."""
        newest = self._newest
        if newest is None:
            return self._signals
        return [
            _Kept(each.name, each.reads, each.default, each.row, each.refuses_nan, newest)
            for each in self._signals
        ]

    def _resume(self) -> None:
        """Go on with the episode of a copy, or refuse a step without an episode."""
        if not self._resumes():
            raise StateError(
                "expected a running episode, got step() before reset() or after the end of the "
                "episode; call reset()"
            )

    def _how_to_end(self) -> str:
        """What a verdict on all specifications, certain before any end, does to the episode."""
        panel = self._panel
        if panel.violated_by is not None:
            words = [self._on_violation[name] for name in panel.violated]
            return min(words, key=get_args(OnViolation).index)
        return self._on_satisfaction if panel.all_decided else "report"

    def _finish(self, terminated: bool) -> Assessment:  # noqa: FBT001 - as Gymnasium has it
        """Reads the end that the environment has made; returns robustness and bounds after it."""
        panel = self._panel
        if not terminated:
            return panel.finish(self._at_truncation)
        if not self._unasked:
            return panel.finish(self._at_termination)
        undecided, windows = panel.undecided, panel.cut_windows()
        found = panel.finish(self._at_termination)
        self._assumed = assumed([name for name in undecided if panel.satisfies(name)], windows)
        return found

    def _add_last(self, info: dict[str, Any], found: EpisodeOutcomes) -> None:
        """Adds the keys that only a last info has; an ``is_success`` that it has already stays."""
        panel, reported = self._panel, "is_success" in info
        info.update(present(last_info(*found, panel.success, bool(panel.undecided), reported)))
        self._seen_success |= reported

    def _found(self) -> EpisodeOutcomes:
        panel = self._panel
        by = panel.violated_by
        return panel.outcomes(), by is not None, by, panel.violated_at

    def _record(self, found: EpisodeOutcomes, *, terminated: bool, truncated: bool) -> None:
        made = record(*found, self._panel.samples, bool(terminated), bool(truncated))
        self.stl_episodes.append(present(made))

    def _abandon(self) -> bool:
        """Records an episode that goes on as truncated; returns whether there was one."""
        running, self._running = self._running and self._panel.samples > 1, False
        if running:
            self._panel.finish(self._at_truncation)
            self._record(self._found(), terminated=False, truncated=True)
        return running


def _fed_by(tap: Tap, feed: Feed) -> Feed:
    """The function that feeds what a tap has kept, whatever it is given."""
    return lambda *_: feed(*tap.seen)


@dataclass(frozen=True, slots=True)
class _Kept(ParsedSignal):
    """A signal whose newest value is kept: read once, for the monitors and for who looks on."""

    newest: dict[str, float] = field(default_factory=dict)

    def bind(self, env: Env) -> Read:
        return self._keeping(ParsedSignal.bind(self, env))

    def bind_reset(self, env: Env) -> Read:
        return self._keeping(ParsedSignal.bind_reset(self, env))

    def _keeping(self, read: Read) -> Read:
        newest, name = self.newest, self.name

        def kept(obs: Any, action: Any, reward: Any, info: Any) -> float:  # noqa: ANN401
            value = newest[name] = read(obs, action, reward, info)
            return value

        return kept
