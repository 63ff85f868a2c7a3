"""Feeds the samples of one run to its monitors, and keeps them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from numbers import Real
from typing import TYPE_CHECKING, Literal

import numpy as np

import rtamt
from rtamt import InputTypeError
from rtamt.monitors import Evidence, TriggerCount
from rtamt.typing import End, NanPolicy
from rtamt_gym.judging.monitor_set import Assessment, Feed, MonitorSet
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import AtTermination
from rtamt_gym.play.run_record import Floats, History
from rtamt_gym.signals.signals import Read

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track


class Recorder:
    """Update the monitors with samples, and record the values that a run needs.

    Attributes:
        monitor_set: The monitors.
        names: The names of the values of a sample: the variables, then further signals.
        first_sample: The number of the first sample in its episode.
    """

    def __init__(
        self,
        monitor_set: MonitorSet,
        variables: Sequence[str],
        signals: Iterable[str] = (),
        nan: NanPolicy = "raise",
        *,
        keeps: bool = True,
        curves: bool = False,
        fed: bool = False,
        live: Track | None = None,
    ) -> None:
        self.monitor_set, self.first_sample = monitor_set, 0
        self.names = list(dict.fromkeys([*variables, *signals]))
        self._variables, self._holds, self._fed = variables, nan == "hold", fed
        self._further = range(len(variables), len(self.names))
        # One monitor takes a sample completely or not at all, so nothing has to be undone.
        single = len(monitor_set.monitors) == 1 and not keeps
        self._samples: list[Sequence[float]] | None = None if single else []
        self._curves: dict[str, list[Assessment]] = (
            {name: [] for name in monitor_set.monitors} if curves or fed else {}
        )
        self._state = monitor_set.state() if fed else None
        self._feed = monitor_set.feeder(variables)
        self._live = live
        if live is not None:
            live.follow(monitor_set.monitors)
            live.begin()
        self._reads: Sequence[Read] | None = None
        self._feed_step: Feed

    def __len__(self) -> int:
        """The number of samples."""
        return self.monitor_set.samples if self._samples is None else len(self._samples)

    @property
    def plain(self) -> bool:
        """Whether monitors may read the steps of an environment without `take`."""
        return not self._further and not self._curves and self._live is None

    def reset(self) -> None:
        """Forget the samples, for another run."""
        self.monitor_set.reset()
        if self._samples is not None:
            self._samples.clear()

    def take(self, values: Sequence[float]) -> None:
        """Feed and keep a sample: the variables, then the further signals."""
        if self._fed:
            if not self._samples:
                self.first_sample = self.monitor_set.samples - 1
                self._state = self.monitor_set.state()
        else:
            self._feed(values)
        for index in self._further:  # values that no monitor reads, and so checks
            value: object = values[index]
            if type(value) is not float and not isinstance(value, Real):  # the second is slower
                raise InputTypeError(
                    f"expected a number for {self.names[index]!r} at sample {len(self)}, "
                    f"got {type(value).__name__} {value!r}"
                )
        self._keep(values)
        if self._live is not None:
            self._live.sample(values)

    def feeder(self, reads: Sequence[Read]) -> Feed:
        """Return the function that feeds a step of an environment; made again for other reads."""
        if reads is not self._reads:
            keep = None if self._samples is None else self._samples.append
            self._feed_step = self.monitor_set.feeder(self._variables, reads, keep=keep)
            self._reads = reads
        return self._feed_step

    def rewind(self) -> None:
        """Set the monitors to the last kept sample: an error may have come within the next one.

        Some monitors may have taken a sample that others have refused.
        """
        if self._samples is None:
            return
        samples = [*self._samples]
        self._samples.clear()
        for curve in self._curves.values():
            curve.clear()
        if self._state is None:
            self.monitor_set.reset()
        else:
            self.monitor_set.restore(self._state)
        for values in samples:
            if not self._fed or self._samples:
                self._feed(values)
            self._keep(values)

    def finish(self, end: AtTermination | End) -> None:
        """End the trace for the monitors; the last values of curves are those after the end."""
        self.monitor_set.finish(end)
        if self._curves:
            for name, state in self.monitor_set.describe().items():
                self._curves[name][-1] = state["robustness"], state["lower"], state["upper"]

    def show_end(self) -> None:
        """End the episode in the live view, if there is one."""
        if self._live is not None:
            self._live.end(self.monitor_set.describe())

    def columns(self) -> dict[str, Floats]:
        """Return the values of every variable and further signal; samples must be kept."""
        assert self._samples is not None  # noqa: S101 - as documented
        table = np.array(self._samples, np.float64).reshape(len(self._samples), len(self.names))
        if self._holds:
            for previous, values in pairwise(table):
                np.copyto(values, previous, where=np.isnan(values))
        return dict(zip(self.names, np.ascontiguousarray(table.T), strict=True))

    def replayed(self, monitor_set: MonitorSet, end: AtTermination | End | None) -> Recorder:
        """Feed the samples to further monitors, and keep the values of these at every sample."""
        other = Recorder(monitor_set, self._variables, self.names, curves=True)
        for values in self._samples or ():
            other.take(values)
        if end is not None:
            other.finish(end)
        return other

    def histories(
        self,
        specs: Mapping[str, rtamt.Specification],
        evidence: Mapping[str, Evidence[TriggerCount]],
    ) -> dict[str, History]:
        """Return the history of every specification."""
        outcomes = self.monitor_set.outcomes()
        histories = {}
        for name, (_, judge) in self.monitor_set.monitors.items():
            robustness, lower, upper = np.ascontiguousarray(np.array(self._curves[name]).T)
            outcome = outcomes[name]
            histories[name] = History(
                str(specs[name].formula),
                robustness,
                lower,
                upper,
                judge.robustness,
                rtamt.Verdict[outcome["verdict"]],
                outcome.get("decided_at"),
                specs[name].unit,
                judge.interface.semantics,
                _with_role("input", judge),
                _with_role("output", judge),
                None if name not in evidence else evidence[name].triggers,
                name in evidence and evidence[name].vacuous,
                outcome.get("progress"),
                outcome.get("ended_at"),
            )
        return histories

    def _keep(self, values: Sequence[float]) -> None:
        for name, curve in self._curves.items():
            source, judge = self.monitor_set.monitors[name]
            curve.append((source.robustness, judge.lower, judge.upper))
        if self._samples is not None:
            self._samples.append(tuple(values))


def _with_role(role: Literal["input", "output"], judge: rtamt.EpisodeMonitor) -> tuple[str, ...]:
    """Return the variables of a formula with a role; exact semantics do not use roles."""
    if judge.interface.semantics in EXACT:
        return ()
    variables = judge.specification.formula.variables
    return tuple(name for name in variables if judge.interface.role(name) == role)
