"""The base of the monitors of one environment: samples, ends, and records of episodes."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, get_args

from rtamt import Explanation, Specification, StateError
from rtamt_gym.judging.end_warnings import assumed
from rtamt_gym.judging.infos import last_info, present, record
from rtamt_gym.judging.monitor_set import (
    Assessment,
    Feed,
    Monitors,
    MonitorSet,
    SeeValues,
    together,
)
from rtamt_gym.judging.monitors import chosen, titled
from rtamt_gym.signals.periods import StepTime
from rtamt_gym.signals.taps import Tap
from rtamt_gym.wrappers.monitoring import Monitoring, OnViolation, check_pictures

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track
    from rtamt_gym.live.view import RerunView


class EpisodeMonitoring(Monitoring):
    """The base of `StlMonitor` and `ParallelStlMonitor`: one episode at a time."""

    stl_episodes: deque[dict[str, Any]]
    _monitor_set: MonitorSet
    _history: bool
    _time: StepTime | None = None
    """Compares the period with the environment; None without a period."""
    _comparing: Feed
    """Updates the monitors in the first steps of an episode, and compares the time."""
    _newest: dict[str, float] | None = None
    _live: Track | None = None
    """The track of a live view; None without one."""

    def newest_signals(self) -> dict[str, float]:
        """Return the signals of the newest sample, in a dictionary that every sample changes.

        They are recorded from the first call on, so it is empty until the next sample.
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
    def shown_live(self) -> bool:
        """True if a live view shows the samples."""
        return self._live is not None

    @property
    def bounds(self) -> tuple[float, float]:
        """The lower and the upper bound of the robustness of the episode."""
        return self._monitor_set.lower, self._monitor_set.upper

    @property
    def first_violation(self) -> tuple[str, int] | None:
        """The specification that was violated first, and the sample that showed it."""
        name, sample = self._monitor_set.violated_by, self._monitor_set.violated_at
        return None if name is None or sample is None else (name, sample)

    @property
    def samples(self) -> int:
        """The number of samples since :meth:`reset`, including the sample of the reset."""
        return self._monitor_set.samples

    @property
    def monitors(self) -> Monitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self._monitor_set.monitors)

    def explain(self, name: str | None = None) -> Explanation:
        """Return the sub-formulas and samples that decided the robustness of the episode so far.

        Needs ``history=True``. After the last step it explains the whole episode, until the next
        :meth:`reset`, which is too late in a vector environment that resets by itself. Below other
        wrappers, call ``env.get_wrapper_attr("explain")()``. With ``view="step"`` it explains
        ``always`` of the formula, that is, the worst instant. A violation by
        ``at_termination="failure"`` changes no robustness, and so no explanation.

        Args:
            name: The specification. Default: the first violated specification; without a violation,
                the specification with the minimum robustness.

        Raises:
            InputError: If the specification is unknown.
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
        pairs = self._monitor_set.monitors
        robustness = {key: judge.robustness for key, (_, judge) in pairs.items()}
        name = chosen(name, robustness, self._monitor_set.violated_by)
        source, judge = pairs[name]
        root = judge.specification.formula
        formula = root if source is judge else root.args[0]  # the judge's is always(formula)
        return titled(judge.explain(), name, formula)

    def _make_monitor_set(self, specs: Mapping[str, Specification]) -> MonitorSet:
        return MonitorSet(specs, self._of_monitors, self._cost, history=self._history)

    def _bind_signals(self) -> None:
        signals, names = self._signals, self.signal_names
        tap, feeder, keep = self._beneath, self._monitor_set.feeder, self._keep()
        env = self.env if tap is None else tap.env
        feed = feeder(names, [signal.bind(env) for signal in signals], keep=keep)
        feed_reset = feeder(names, [signal.bind_reset(env) for signal in signals], keep=keep)
        if tap is not None:
            feed, feed_reset = _fed_by(tap, feed), _fed_by(tap, feed_reset)
        self._feed: Feed = self._compared(feed)
        self._feed_reset: Feed = feed_reset

    def _show(self, live: RerunView | None) -> None:
        """Show the samples in a live view."""
        if live is None:
            return
        period = None if self.period is None else float(self.period)
        if live.pictures is not None:
            check_pictures(self.env, "RerunView(pictures=)", lists=False)
        self._live = track = live.track(self.signal_names, [*self._monitor_set.monitors], period)
        if live.pictures is not None:
            track.draw(self.env.render, live.pictures)

    def _keep(self) -> SeeValues | None:
        """Return the function that shows and records the values of a sample, or None."""
        newest, names = self._newest, self.signal_names
        record: SeeValues | None = None
        if newest is not None:
            record = partial(_record, newest, names)
        if self._live is None:
            return record
        self._live.follow(self._monitor_set.monitors)
        return together(record, self._live.sample)

    def _compared(self, feed: Feed, *, substeps: bool = False) -> Feed:
        """Return a `Feed` that also compares the time in the first steps of an episode."""
        time, monitor_set = self._time, self._monitor_set
        if time is None:
            return feed

        def compare_and_feed(*step: Any) -> Assessment:
            time.step(monitor_set.samples - 1 - time.samples if substeps else 1)
            if not time.left:
                self._feed = feed
            return feed(*step)

        self._comparing = compare_and_feed
        return compare_and_feed if time.left else feed

    def _begin_times(self) -> None:
        """Compare the period after a reset of the environment, at the time of sample 0."""
        if self._time is not None:
            self._time.begin()
            if self._time.left:
                self._feed = self._comparing

    def _resume(self) -> None:
        """Go on with the episode of a copy, or refuse a step without an episode."""
        if not self._resumes():
            raise StateError(
                "expected a running episode, got step() before reset() or after the end of the "
                "episode; call reset()"
            )

    def _how_to_end(self) -> str:
        """Return how the verdicts that are certain without an end change the episode."""
        monitor_set = self._monitor_set
        if monitor_set.violated_by is not None:
            words = [self._on_violation[name] for name in monitor_set.violated]
            return min(words, key=get_args(OnViolation).index)
        return self._on_satisfaction if monitor_set.all_decided else "report"

    def _finish(self, terminated: bool) -> Assessment:  # noqa: FBT001 - as Gymnasium has it
        """Evaluate the environment's own end; return robustness and bounds after it."""
        monitor_set = self._monitor_set
        if not terminated:
            return monitor_set.finish(self._at_truncation)
        if not self._warns_of_open_end:
            return monitor_set.finish(self._at_termination)
        undecided, windows = monitor_set.undecided, monitor_set.cut_windows()
        assessment = monitor_set.finish(self._at_termination)
        self._assumed = assumed(
            [name for name in undecided if monitor_set.satisfies(name)], windows
        )
        return assessment

    def _conclude(self, infos: Sequence[dict[str, Any]], terminated: bool, truncated: bool) -> None:  # noqa: FBT001 - as Gymnasium has them
        """Add the keys of last infos, keep an own ``is_success``, and record the episode."""
        monitor_set, violation = self._monitor_set, self._violation()
        for info in infos:
            own = "is_success" in info
            last = last_info(*violation, monitor_set.success, not monitor_set.all_decided, own)
            info.update(present(last))
            self._seen_success |= own
        self._record(violation, terminated=terminated, truncated=truncated)

    def _violation(self) -> tuple[dict[str, Any], bool, str | None, int | None]:
        """Return outcomes, whether there is a violation, the first violated name, its sample."""
        monitor_set = self._monitor_set
        by = monitor_set.violated_by
        return monitor_set.outcomes(), by is not None, by, monitor_set.violated_at

    def _record(
        self,
        violation: tuple[dict[str, Any], bool, str | None, int | None],
        *,
        terminated: bool,
        truncated: bool,
    ) -> None:
        samples = self._monitor_set.samples
        episode = record(*violation, samples, bool(terminated), bool(truncated))
        self.stl_episodes.append(present(episode, deep=False))  # the outcomes are its own
        if self._live is not None:
            self._live.end(self._monitor_set.describe())

    def _abandon(self) -> bool:
        """Record a running episode as truncated; return whether there was one."""
        running, self._running = self._running and self._monitor_set.samples > 1, False
        if running:
            self._monitor_set.finish(self._at_truncation)
            self._record(self._violation(), terminated=False, truncated=True)
        return running


def _record(newest: dict[str, float], names: Sequence[str], values: Sequence[float]) -> None:
    newest.update(zip(names, values, strict=True))


def _fed_by(tap: Tap, feed: Feed) -> Feed:
    """Return a `Feed` of the last results of a tap, which ignores its arguments."""
    return lambda *_: feed(*tap.seen)
