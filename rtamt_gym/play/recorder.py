"""Feeds the samples of a simulation to monitors, and keeps what both show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from numbers import Real
from typing import Any, Literal

import numpy as np

import rtamt
from rtamt import Asked, End, Evidence, InputTypeError, NanPolicy
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.feeding import Assessment, Feed
from rtamt_gym.judging.interface import EXACT
from rtamt_gym.judging.panel import Panel
from rtamt_gym.options.evaluation import AtTermination
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import Course, Floats
from rtamt_gym.results.trial import Trial
from rtamt_gym.signals.signals import Read
from rtamt_gym.tables import sample_text


class Recorder:
    """Feeds samples to the monitors; keeps the samples and the values of the monitors.

    Attributes:
        first_sample: The number of the first sample in its episode.

    Args:
        panel: The monitors.
        variables: The names that the specifications read.
        signals: The names of further signals.
        nan: Whether a signal that is nan is refused, or keeps its last value.
        fed: Whether the system feeds the monitors: they know a sample when it comes here.
    """

    def __init__(
        self,
        panel: Panel,
        variables: Sequence[str],
        signals: Iterable[str],
        nan: NanPolicy,
        *,
        fed: bool = False,
    ) -> None:
        self.first_sample = 0
        self._panel = panel
        self._holds = nan == "hold"
        self._fed = fed
        self._names = list(dict.fromkeys([*variables, *signals]))
        self._unread = range(len(variables), len(self._names))
        self._samples: list[Sequence[float]] = []
        self._curves: dict[str, list[Assessment]] = {name: [] for name in panel.monitors}
        self._feed = panel.feeder(variables)
        self._monitors = [
            (source, judge, self._curves[name].append)
            for name, (source, judge) in panel.monitors.items()
        ]
        self._begin = panel.state()

    def __len__(self) -> int:
        """The number of samples."""
        return len(self._samples)

    def take(self, values: Sequence[float]) -> None:
        """Feeds and keeps a sample: the variables, then the signals that are not variables."""
        if self._holds and self._samples:
            last = self._samples[-1]
            values = [kept if new != new else new for new, kept in zip(values, last, strict=True)]  # noqa: PLR0124 - nan
        if not self._fed:
            self._feed(values)
        elif not self._samples:
            self.first_sample = self._panel.samples - 1
            self._begin = self._panel.state()
        self._keep(values)

    def rewind(self) -> None:
        """Sets the monitors to the last sample that was kept: an error may have come in between.

        Some monitors may know a sample that others have refused.
        """
        samples, self._samples = self._samples, []
        for curve in self._curves.values():
            curve.clear()
        self._panel.restore(self._begin)
        for values in samples:
            if self._samples or not self._fed:
                self._feed(values)
            self._keep(values)

    def _keep(self, values: Sequence[float]) -> None:
        for index in self._unread:  # values that no monitor reads, and so checks
            value: object = values[index]
            if type(value) is not float and not isinstance(value, Real):  # the second takes longer
                raise InputTypeError(
                    f"expected a number for {self._names[index]!r} at sample {len(self._samples)}, "
                    f"got {type(value).__name__} {value!r}"
                )
        for source, judge, keep in self._monitors:
            keep((source.robustness, judge.lower, judge.upper))
        self._samples.append(tuple(values))

    def finish(self, end: AtTermination | End) -> None:
        """Ends the trace for the monitors; their last values are those after the end."""
        self._panel.finish(end)
        for name, state in self._panel.describe().items():
            self._curves[name][-1] = state["robustness"], state["lower"], state["upper"]

    def signals(self) -> dict[str, Floats]:
        """The values of every signal."""
        shape = len(self._samples), len(self._names)
        table = np.array(self._samples, dtype=np.float64).reshape(shape)
        return dict(zip(self._names, np.ascontiguousarray(table.T), strict=True))

    def columns(self) -> dict[str, Floats]:
        """The values of every variable."""
        return self.signals()

    def courses(
        self,
        specs: Mapping[str, rtamt.Specification],
        stands_on: Mapping[str, Evidence[Asked]],
    ) -> dict[str, Course]:
        """The course of every specification.

        Args:
            specs: The specifications.
            stands_on: How often each was put to the test; empty if nobody has counted.
        """
        outcomes = self._panel.outcomes()
        courses = {}
        for name, (_, judge) in self._panel.monitors.items():
            robustness, lower, upper = np.ascontiguousarray(np.array(self._curves[name]).T)
            courses[name] = Course(
                str(specs[name].formula),
                robustness,
                lower,
                upper,
                judge.robustness,
                rtamt.Verdict[outcomes[name]["verdict"]],
                outcomes[name].get("decided_at"),
                specs[name].unit,
                judge.interface.semantics,
                _of_role("input", judge),
                _of_role("output", judge),
                None if name not in stands_on else stands_on[name].asked,
                name in stands_on and stands_on[name].vacuous,
                outcomes[name].get("progress"),
                outcomes[name].get("ended_at"),
            )
        return courses


class Tally:
    """Feeds samples to the monitors, and keeps no more than it takes to undo half a sample.

    It serves one run after the other.

    Attributes:
        panel: The monitors.

    Args:
        panel: As above.
        variables: The names that the specifications read.
        keeps: Whether the samples are asked for at the end.
    """

    def __init__(self, panel: Panel, variables: Sequence[str], *, keeps: bool) -> None:
        self.panel, self._variables = panel, variables
        self._feed = panel.feeder(variables)
        # One monitor takes a sample as a whole or not at all.
        alone = len(panel.monitors) == 1 and not keeps
        self._samples: list[Sequence[float]] | None = None if alone else []
        self._reads: Sequence[Read] | None = None
        self._feed_step: Feed

    def __len__(self) -> int:
        """The number of samples."""
        return self.panel.samples if self._samples is None else len(self._samples)

    def reset(self) -> None:
        """Forgets the samples, for another run."""
        self.panel.reset()
        if self._samples is not None:
            self._samples.clear()

    def take(self, values: Sequence[float]) -> None:
        """Feeds a sample."""
        self._feed(values)
        if self._samples is not None:
            self._samples.append(tuple(values))

    def feeder(self, reads: Sequence[Read]) -> Feed:
        """The function that feeds a step of an environment, made anew for other reads alone."""
        if reads is not self._reads:
            keep = None if self._samples is None else self._samples.append
            self._feed_step = self.panel.feeder(self._variables, reads, keep=keep)
            self._reads = reads
        return self._feed_step

    def columns(self) -> dict[str, Floats]:
        """The values of every variable; of a tally that keeps samples, and has some."""
        table = np.array(self._samples, dtype=np.float64)
        return dict(zip(self._variables, np.ascontiguousarray(table.T), strict=True))

    def rewind(self) -> None:
        """Sets the monitors to the last sample that all of them have taken."""
        if self._samples is not None:
            self.panel.reset()
            for values in self._samples:
                self._feed(values)

    def finish(self, end: AtTermination | End) -> None:
        """Ends the trace for the monitors."""
        self.panel.finish(end)


def _of_role(role: Literal["input", "output"], judge: rtamt.EpisodeMonitor) -> tuple[str, ...]:
    """The variables of a formula that have a role; none under semantics that ask for no roles."""
    if judge.interface.semantics in EXACT:
        return ()
    variables = judge.specification.formula.variables
    return tuple(name for name in variables if judge.interface.role(name) == role)


def carry(error: BaseException, run: Run) -> None:
    """Makes a run the attribute ``run`` of an error, and says so in a note.

    The run of a simulation inside of this one, which the error has crashed before, gives way.
    """
    before = getattr(error, "run", None)
    with suppress(AttributeError):  # of an error that takes no attributes
        crashed: Any = error
        crashed.run = run
        if isinstance(before, Run):
            crashed.__notes__.remove(_note(before))
        error.add_note(_note(run))


def failed(error: Exception, case: Case, seed: int | None, wall: float) -> Trial:
    """The trial that an error has ended, with what the samples that it carries came to."""
    text = f"{type(error).__name__}: {error}"
    run = getattr(error, "run", None)
    if isinstance(run, Run):
        return run.trial(case, text)
    return Trial(case, seed, {}, "error", 0.0, wall, text)


def _note(run: Run) -> str:
    samples = f"{run.steps + 1} samples" if run.steps else "1 sample"
    return f"error.run holds {samples}, up to {sample_text(run.last_sample, run.period)}"
