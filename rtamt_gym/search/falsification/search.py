"""`Search`: simulates the points of an optimizer, in its folder and offline where it is faster."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from fractions import Fraction
from itertools import accumulate, pairwise
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rtamt import Formula, InputError, RtamtError, Specification, Verdict
from rtamt.patterns import stages
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.inputs.space import Space
from rtamt_gym.judging.judge import TriggerCounter
from rtamt_gym.play.campaign import ParallelRunner
from rtamt_gym.play.folder import Folder
from rtamt_gym.play.history import SimulatedTrace, Stop
from rtamt_gym.play.record import Record
from rtamt_gym.play.runner import CaseLike, Runner
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.provenance import Reuse
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.falsification.points import (
    Effects,
    Floats,
    inputs_without_effect,
    spread,
    take,
)
from rtamt_gym.search.falsification.scales import in_scales, spreads

_WORST: Final = 1e12
"""The value of a run without robustness; it is finite, since optimizers compute with it."""

_FIRST: Final = 8
"""The number of first runs from which scales are computed."""


_SECONDS: Final = 1.0
"""The time between writes; a killed process loses the simulations of this time."""

_SEARCH: Final = "search"
"""The key of the fields that are stored next to the rows."""


class SearchOver(BaseException):
    """The end of the search; not an `Exception`, so that an optimizer does not catch it."""


class Search:
    """The evaluation of points for an optimizer, until one violates or the budget is spent.

    The rows are as if the points had run one after the other, in the order of the requests: the
    search ends at the first violation, and simulations next to it do not count.

    Attributes:
        groups: The coordinates of each input.
        trials: The simulations so far, with their values.
        points: Their points.
        scales: The scales by the text of a predicate; None until they are computed.
        advance: A function that gets the number of finished simulations.
    """

    def __init__(
        self,
        make: Callable[[Mapping[str, Specification], Stop], Runner],
        runner: Runner,
        space: Space,
        fixed: Mapping[str, float | Waveform],
        budget: int,
        seed: int,
        rng: np.random.Generator,
        scales: Mapping[str, float] | None,
        parallel: Callable[..., ParallelRunner] | None = None,
        folder: SearchFolder | None = None,
    ) -> None:
        self._parallel = parallel
        self._opened = ExitStack()
        self._folder = folder
        if folder is not None:
            self._opened.callback(folder.close)
            if scales is not None:
                folder.scales = scales
            elif folder.scales is None:
                folder.forget()
        self._make = make
        self._unscaled = runner
        self._specs = runner.requirements
        self._space = space
        self._fixed = fixed
        self._budget = budget
        self._seed = seed
        self._rng = rng
        self.advance: Callable[[int], None] = lambda _: None
        self._traces: dict[int, SimulatedTrace] = {}
        self._scaled_names = list(self._specs)
        self._runner: Runner | OfflineRunner | ParallelRunner = runner
        self._judge = runner.judge
        ends = [*accumulate((len(entry.columns) for entry in space), initial=0)]
        self.groups: Sequence[slice] = [slice(*pair) for pair in pairwise(ends)]
        self.trials: list[ValuedTrial] = []
        self.points: list[Floats] = []
        self.scales = scales
        if scales is not None:
            self._use(scales)

    def __call__(self, points: ArrayLike, level: float = math.inf) -> Floats:
        """Run a simulation for each point; see `Evaluate`."""
        checked = self._checked(points)
        if self.scales is not None:
            return self._run(checked, level)
        missing = _FIRST - len(checked)
        if missing > 0:
            others = spread(self.groups, self._rng)
            self._run(take(others, missing, self.dimension), math.inf)
        begin = len(self.trials)
        self._run(checked[:_FIRST], math.inf)
        self._find_scales()
        first = self._values(begin)
        return np.concatenate([first, self._run(checked[_FIRST:], level)])

    def _find_scales(self) -> None:
        """Compute the scales from the first simulations, and the values of these in the scales."""
        if self._folder is not None and self._folder.scales is not None:
            self.scales = self._folder.scales  # the stored values are in their units already
            self._use(self.scales)
            return
        self.scales = spreads(self._specs, self._traces.values())
        self._use(self.scales)
        for index, trace in self._traces.items():
            heights = {name: self._judge(name, trace) for name in self._scaled_names}
            least, value = self._minimum(heights)
            self.trials[index] = self.trials[index]._replace(least=least, value=value)
        self._traces.clear()
        if self._folder is not None:
            self._folder.scales = self.scales
            self._folder.add(dict(enumerate(self.trials)))
            self._folder.write()

    @property
    def rows(self) -> list[Trial]:
        """The simulations so far."""
        return [trial.row for trial in self.trials]

    @property
    def violated(self) -> str | None:
        """The requirement that the last simulation violates; None without a violation."""
        return self.trials[-1].violated if self.trials else None

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point."""
        return self._space.dimension

    @property
    def best(self) -> int:
        """The index of the violating simulation; without one, of the minimum value.

        A failed simulation is the best only if all failed.
        """
        if self.violated:
            return len(self.trials) - 1
        keys = [(bool(trial.row.error), trial.value) for trial in self.trials]
        return keys.index(min(keys))

    @property
    def judged_points(self) -> Floats:
        """The points of simulations without an error, shape (points, dimension)."""
        trials = zip(self.points, self.trials, strict=True)
        judged = [point for point, trial in trials if not trial.row.error]
        return np.array(judged).reshape(-1, self.dimension)

    @property
    def closest(self) -> str:
        """The requirement that the best row violates, or comes closest to violating."""
        return self.violated or self.trials[self.best].least

    def effects(self) -> Effects:
        """Return the inputs without an effect, from simulations that are not among the rows.

        The base points are the best row and the row with the most different value. An input with a
        range of one value is left out; without a judged simulation, all inputs are.
        """
        trials = self.trials
        judged = [index for index, trial in enumerate(trials) if not trial.row.error]
        if not judged:
            return Effects()
        best = self.best
        other = max(judged, key=lambda index: abs(trials[index].value - trials[best].value))
        bases = list(dict.fromkeys([best, other]))
        groups = {
            entry.name: group
            for entry, group in zip(self._space, self.groups, strict=True)
            if entry.low < entry.high
        }
        with ExitStack() as opened:
            runner: Runner | ParallelRunner = self._unscaled
            if self._parallel is not None:
                runner = opened.enter_context(closing(self._parallel(self._unscaled)))

            def run(index: int, points: Sequence[Floats]) -> list[object]:
                cases = [Case({**self._space.case(point), **self._fixed}) for point in points]
                seed = trials[bases[index]].row.seed
                seeds = None if seed is None else [seed] * len(cases)
                rows = dict(runner.run(cases, seeds))
                return [_key(rows[position]) for position in range(len(cases))]

            return inputs_without_effect(groups, [self.points[index] for index in bases], run)

    def close(self) -> None:
        """Close the processes of the simulations, but not the runner of the caller."""
        self._opened.close()

    def _checked(self, points: ArrayLike) -> Floats:
        """Return the points as an array; raise InputError for points outside the unit cube."""
        try:
            array = np.array(points, np.float64)
            got = f"shape {array.shape}"
        except (TypeError, ValueError):  # rows of different lengths, or no numbers
            array, got = np.empty(0), repr(points)
        dimension = self.dimension
        if array.ndim != 2 or array.shape[1] != dimension:
            raise InputError(
                f"expected the optimizer to evaluate points of shape (k, {dimension}), a row for "
                f"each point, got {got}"
            )
        inside = (array >= 0) & (array <= 1)
        if not inside.all():
            row, column = np.argwhere(~inside)[0].tolist()
            raise InputError(
                f"expected the optimizer to evaluate points of the unit cube, got "
                f"{array[row, column]:g} in coordinate {column} of point {row}; "
                "points.clip(0, 1) moves points into it"
            )
        return array

    def _use(self, scales: Mapping[str, float]) -> None:
        """From now on, evaluate runs in units of scales too, and stop them at known values."""
        scaled: dict[str, Specification] = {}
        if scales:
            in_units = in_scales(self._specs, scales)
            scaled = {f"{name} in scales": spec for name, spec in in_units.items()}
            self._scaled_names = list(scaled)
        every = {**self._specs, **scaled}
        complete = prefers_offline(every, self._unscaled)
        runner = self._opened.enter_context(self._make(every, "known"))
        self._runner, self._judge = runner, runner.judge
        if self._parallel is not None:
            self._runner = self._parallel(runner, wrap=OfflineRunner if complete else None)
            self._opened.callback(self._runner.close)
        elif complete:
            self._runner = OfflineRunner(runner)

    def _run(self, points: Floats, level: float) -> Floats:
        """Run points and add their rows; raise `SearchOver` if the search is over."""
        begin = len(self.trials)
        points = points[: self._budget - begin]
        cases = [Case({**self._space.case(point), **self._fixed}) for point in points]
        result: dict[int, ValuedTrial] = {}
        traces: dict[int, SimulatedTrace] = {}
        last = len(cases)  # the number of cases that count
        for index, case in enumerate(cases):
            known = None if self._folder is None else self._folder.known(begin + index, case)
            if known is not None and index <= last:
                result[index] = known
                last = min(last, self._last(index, result))
        self.advance(len(result))
        left = [index for index in range(min(last, len(cases))) if index not in result]
        try:
            for index, row in self._rows(left, cases, begin, level, traces):
                result[index] = self._valued_row(row)
                if self._folder is not None and self.scales is not None:
                    self._folder.add({begin + index: result[index]})
                self.advance(1)
                last = min(last, self._last(index, result))
                if last < len(cases) and all(i in result for i in range(last)):
                    break
        finally:
            for index in sorted(result):
                if index <= last:
                    if index in traces and not result[index].row.error:
                        self._traces[len(self.trials)] = traces[index]
                    self.trials.append(result[index])
                    self.points.append(points[index])
        spent = len(self.trials) >= self._budget
        if self.violated is not None or spent or self._hopeless({}):
            raise SearchOver
        return self._values(begin)

    def _values(self, begin: int) -> Floats:
        return np.array([trial.value for trial in self.trials[begin:]])

    def _rows(
        self,
        left: Sequence[int],
        cases: Sequence[Case],
        begin: int,
        level: float,
        traces: dict[int, SimulatedTrace],
    ) -> Iterator[tuple[int, Trial]]:
        """Run the remaining cases; yield rows with the indices of their cases."""
        if not left:
            return
        remaining = [cases[index] for index in left]
        seeds = None
        if self._unscaled.takes_seeds:
            seeds = [self._seed + begin + index for index in left]
        if self.scales is None:
            keep = lambda place, trace: traces.__setitem__(left[place], trace)  # noqa: E731
            rows = self._unscaled.run(remaining, seeds, keep=keep)
        else:
            above = dict.fromkeys(self._specs, -math.inf) | dict.fromkeys(self._scaled_names, level)
            rows = self._runner.run(remaining, seeds, above=above)
        for place, row in rows:
            yield left[place], row

    def _last(self, index: int, trials: Mapping[int, ValuedTrial]) -> int:
        """Return the index of the last run that counts, now that run `index` has finished."""
        if trials[index].violated is not None:
            return index
        return _FIRST - len(self.trials) - 1 if self._hopeless(trials) else sys.maxsize

    def _hopeless(self, trials: Mapping[int, ValuedTrial]) -> bool:
        """Return whether the first simulations all failed in the same way before sample 0."""
        first = [trial.row for trial in self.trials[:_FIRST]]
        first += [trials[i].row for i in range(_FIRST - len(first)) if i in trials]
        errors = {row.error for row in first}
        began = any(row.outcomes for row in first)
        return len(first) == _FIRST and len(errors) == 1 and "" not in errors and not began

    def _valued_row(self, row: Trial) -> ValuedTrial:
        """Return a row with its value, and with the outcomes of the requirements only."""
        heights = {name: _height(row, name) for name in self._scaled_names}
        outcomes = {name: row.outcomes[name] for name in self._specs if name in row.outcomes}
        least, value = self._minimum(heights)
        return ValuedTrial(replace(row, outcomes=outcomes), least, value, self._violated(row))

    def _violated(self, row: Trial) -> str | None:
        """Return the violated requirement with the smallest robustness, or None."""
        if row.error:
            return None
        violated = [
            (row.outcomes[value].robustness, name)
            for name, value in zip(self._specs, self._scaled_names, strict=True)
            if row.outcomes[name].verdict is Verdict.VIOLATED
        ]
        return min(violated)[1] if violated else None

    def _minimum(self, heights: Mapping[str, float]) -> tuple[str, float]:
        """Return the requirement with the smallest height, and the height in units of its scale."""
        values = {
            name: _WORST if math.isnan(height) else min(max(height, -_WORST), _WORST)
            for name, height in zip(self._specs, heights.values(), strict=True)
        }
        return min(values.items(), key=itemgetter(1))


def _key(row: Trial) -> object:
    """Return a key that compares two simulations, also with nan."""
    return row.error, [repr(outcome.robustness) for outcome in row.outcomes.values()]


def _height(row: Trial, name: str) -> float:
    """Return the value of a run for the optimizer: its robustness, a known bound, or nan."""
    if row.error:
        return math.nan
    outcome = row.outcomes[name]
    return outcome.lower if row.ended == "known" else outcome.robustness


class ValuedTrial(NamedTuple):
    """A simulation of a search, with its value for the optimizer.

    Attributes:
        least: The requirement with the smallest robustness, in units of the scales.
        value: This robustness, or a bound of it; the optimizer gets this number.
        violated: The requirement that it violates; None if it violates none.
    """

    row: Trial
    least: str
    value: float
    violated: str | None


class SearchFolder:
    """The folder of a search, from which it can resume.

    A resumed search starts the optimizer again with the same seed and returns the stored values for
    points that have run. The optimizer then continues as if it had never been interrupted.

    Attributes:
        scales: The stored scales; None if they are not known yet.
        reused: The numbers of the stored simulations that were used.
    """

    def __init__(self, folder: Folder, optimizer: str) -> None:
        self._folder = folder
        self._optimizer = optimizer
        self._known: dict[int, ValuedTrial] = {}
        self._waiting: dict[int, ValuedTrial] = {}
        self._since = time.monotonic()
        self.scales: Mapping[str, float] | None = None
        self.reused: set[int] = set()
        for numbers, rows, extra in folder.parts():
            fields = extra[_SEARCH]
            values = zip(fields["least"], fields["values"], fields["violated"], strict=True)
            for number, row, value in zip(numbers, rows, values, strict=True):
                self._known[number] = ValuedTrial(row, *value)
            self.scales = fields["scales"] if self.scales is None else self.scales
        self._stored = frozenset(self._known)

    def forget(self) -> None:
        """Discard simulations from before the scales were known, unless one ended the search."""
        if all(valued.violated is None for valued in self._known.values()):
            self._known.clear()

    def known(self, number: int, case: Case) -> ValuedTrial | None:
        """Return the stored simulation of a number, or None; raise InputError for another case."""
        result = self._known.get(number)
        if result is not None and result.row.case != case:
            raise InputError(
                f"{self._folder.path} holds another input as simulation {number + 1}: the "
                f"optimizer {self._optimizer} requests other points with the same seed, so that "
                "the search cannot resume; give another folder"
            )
        if result is not None and number in self._stored:
            self.reused.add(number)
        return result

    def reuse(self, total: int) -> Reuse:
        """Return how many of all simulations were stored before, for the provenance."""
        return self._folder.reuse(sum(number < total for number in self.reused), total)

    def add(self, trials: Mapping[int, ValuedTrial]) -> None:
        """Store finished simulations by their numbers; write them after a second at most."""
        self._waiting |= {i: trial for i, trial in trials.items() if i not in self._known}
        if self._waiting and time.monotonic() - self._since > _SECONDS:
            self.write()

    def write(self) -> None:
        """Write pending simulations."""
        if self._waiting:
            trials = sorted(self._waiting.items())
            rows = [(number, trial.row) for number, trial in trials]
            self._folder.add(rows, self._fields([trial for _, trial in trials]))
            self._known |= self._waiting
            self._waiting.clear()
        self._since = time.monotonic()

    def finish(self, record: Record, trials: list[ValuedTrial]) -> None:
        """Replace the parts by one file with all simulations of a finished search.

        After a call with a smaller budget, the folder holds more simulations and stays as it is.
        """
        self.write()
        more = any(number >= len(trials) for number in self._known)
        if not more or trials[-1].violated is not None:
            self._folder.finish(record, self._fields(trials))

    def close(self) -> None:
        """Write pending simulations, and release the folder."""
        try:
            self.write()
        finally:
            self._folder.close()

    def _fields(self, trials: list[ValuedTrial]) -> dict[str, Any]:
        return {
            _SEARCH: {
                "least": [trial.least for trial in trials],
                "values": [trial.value for trial in trials],
                "violated": [trial.violated for trial in trials],
                "scales": None if self.scales is None else dict(self.scales),
            }
        }


def prefers_offline(specs: Mapping[str, Specification], runner: Runner) -> bool:
    """Return whether an `OfflineRunner` is faster: a window contains a combination of windows.

    For ``always[0:30](p implies eventually[0:5] q)``, updates of a monitor take ten times as long
    as the simulation of a scenario, and the robustness of the whole trace a tenth.
    """
    return (
        runner.duration is not None
        and runner.evaluation_options.view == "episode"
        and runner.evaluation_options.semantics == "standard"
        and all(spec.unit == "s" and spec.horizon <= runner.duration for spec in specs.values())
        and any(_nests(spec.formula) for spec in specs.values())
    )


class OfflineRunner:
    """Runs cases to the end, and judges them by their samples.

    `Runner` returns the same rows, except that a run without a violation is never stopped, and that
    its verdicts are certain at its end. A run with a violation, with an error or with an open
    verdict runs again under monitors, which stop it.
    """

    def __init__(self, runner: Runner) -> None:
        self._runner = runner
        self._trigger_counters: dict[Fraction | None, TriggerCounter] = {}
        self._horizon = max(spec.horizon for spec in runner.requirements.values())

    def close(self) -> None:
        """Close the runner."""
        self._runner.close()

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Run cases, as `Runner.run` does."""
        listed = list(cases)
        satisfied: dict[int, Trial] = {}
        for index, row, trace in self._runner.whole(listed, seeds):
            if row.simulated < self._horizon:
                continue
            with suppress(RtamtError):  # the loop below runs these cases again
                judge, names = self._runner.judge, self._runner.requirements
                robustness = {name: judge(name, trace) for name in names}
                if not np.signbit(list(robustness.values())).any():
                    satisfied[index] = self._satisfied(row, robustness, trace)
        yield from satisfied.items()
        for index in range(len(listed)):
            if index not in satisfied:
                own = None if seeds is None else [seeds[index]]
                for _, row in self._runner.run([listed[index]], own, above=above):
                    yield index, row

    def _satisfied(
        self, row: Trial, robustness: Mapping[str, float], trace: SimulatedTrace
    ) -> Trial:
        """Return the row of a run that satisfies all requirements."""
        period, reading = trace.period, self._runner.evaluation_options
        if period not in self._trigger_counters:
            specs = self._runner.requirements
            self._trigger_counters[period] = TriggerCounter(specs, reading.having(period=period))
        verdicts = dict.fromkeys(robustness, Verdict.SATISFIED)
        terminated = row.ended == "terminated"
        end = (reading.at_termination or "complete") if terminated else reading.at_truncation
        evidence = self._trigger_counters[period].evidence(
            trace.signals, trace.samples, end, verdicts
        )
        last = round(row.simulated / (period or 1))
        outcomes = {
            name: Outcome.at(
                [value] * 3,
                Verdict.SATISFIED,
                last,
                period,
                evidence[name],
                1.0 if stages(self._runner.requirements[name]) else None,
            )
            for name, value in robustness.items()
        }
        return replace(row, outcomes=outcomes)


def _nests(formula: Formula) -> bool:
    """Return whether a window contains a combination of windows."""
    return any(_timed(node) and any(map(_combines, node.args)) for node in formula.nodes())


def _combines(node: Any) -> bool:  # noqa: ANN401 - a formula or a term
    """Return whether a node combines formulas, and one of them has a window."""
    if len(node.args) > 1 and any(_timed(part) for arg in node.args for part in arg.nodes()):
        return True
    return any(map(_combines, node.args))


def _timed(node: Any) -> bool:  # noqa: ANN401 - a formula or a term
    return node.op is not None and bool(node.op.timed)
