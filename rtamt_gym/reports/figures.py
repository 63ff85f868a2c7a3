"""The charts of the page: a sentence, a table, and data for the script.

To add a chart: a function here that makes a `Figure` with a summary, a table and data, and a
function of ``drawers`` in ``rtamt_gym/reports/page/page.js`` that draws the data. Show it in
``tests/support/report_example.py``.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, get_args

import numpy as np

from rtamt.monitors import BodyOccurrences, Occurrences
from rtamt_gym.reports.model import (
    Cell,
    Column,
    Figure,
    Row,
    ShownEpisode,
    ShownSeries,
    Table,
    TrialRow,
    numbers_table,
)
from rtamt_gym.reports.numbers import aligned, evenly, number, percent, six, spaced, time
from rtamt_gym.results.codec import plain
from rtamt_gym.results.intervals import quantiles
from rtamt_gym.results.outcome import BY_END, Word
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted


@dataclass(slots=True)
class Bins:
    """Counts of numbers in intervals of one width, with an edge at zero."""

    width: float
    first: int = 0
    counts: list[int] = field(default_factory=list)
    below: int = 0
    above: int = 0


_LARGEST = 1e100

WORDS: Final[tuple[Word, ...]] = ("violated", "undecided", "satisfied", "failed")
"""The outcomes of requirements, in the order of charts and legends."""


def bins(values: Sequence[float]) -> Bins:
    """Count numbers in at most 27 intervals; negative numbers never share one with the others.

    A zero with a minus sign counts as negative, like the verdict. Numbers beyond 1e100 count as
    infinite, and numbers within 1e-100 of each other share an interval.

    Example:
        >>> bins([-0.5, -0.0, 0.0, 0.4, math.inf])
        Bins(width=0.2, first=-3, counts=[1, 0, 1, 1, 0, 1], below=0, above=1)
    """
    finite = [value for value in values if abs(value) <= _LARGEST]
    result = Bins(
        1.0, below=sum(v < -_LARGEST for v in values), above=sum(v > _LARGEST for v in values)
    )
    if not finite:
        return result
    low, high = min(finite), max(finite)
    span = max(high - low or abs(high) or 1.0, 1 / _LARGEST)
    # About as many intervals as the root of the count show the shape.
    intervals = min(max(8.0, 2 * math.sqrt(len(finite))), 24.0)
    power = 10.0 ** math.floor(math.log10(span / intervals))
    result.width = next(
        w for w in (power, 2 * power, 5 * power, 10 * power) if span <= intervals * w
    )
    places = Counter(_place(value, result.width) for value in finite)
    result.first = min(places)
    result.counts = [places[i] for i in range(result.first, max(places) + 1)]
    return result


def _place(value: float, width: float) -> int:
    if math.copysign(1.0, value) < 0:
        return min(math.floor(value / width + 1e-9), -1)
    return max(math.floor(value / width + 1e-9), 0)


def trial_figures(trials: Sequence[TrialRow], noun: str, unit: str) -> list[Figure]:
    """Return the histogram of the robustness and the times of violations, if there are any."""
    figures = []
    if any(trial.robustness is not None for trial in trials):
        figures.append(_histogram(trials, noun))
    if len(trials) > 1 and any(trial.violated_at is not None for trial in trials):
        figures.append(_violation_times(trials, noun, unit))
    return figures


_MOST: Final = 1000
"""The maximum number of values in a distribution."""


def _histogram(trials: Sequence[TrialRow], noun: str) -> Figure:
    known = [(t.robustness, t.verdict) for t in trials if t.robustness is not None]
    known.sort(key=lambda pair: (pair[0], get_args(Word).index(pair[1])))
    pairs = spaced(known, _MOST)
    values, words = [value for value, _ in pairs], [word for _, word in pairs]
    result = bins(values)
    places = Counter((w, _place(v, result.width)) for v, w in pairs if abs(v) <= _LARGEST)
    numbers = range(result.first, result.first + len(result.counts))
    counts = {word: [places[word, i] for i in numbers] for word in WORDS}
    verdicts = {word: count for word, count in counts.items() if any(count)}
    edges = aligned([result.width * i for i in (*numbers, numbers.stop)])
    rows = [
        (f"{low} to {high}", str(count), *(str(value[i]) for value in verdicts.values()))
        for i, ((low, high), count) in enumerate(
            zip(itertools.pairwise(edges), result.counts, strict=True)
        )
        if count
    ]
    for sign, count in ((-1, result.below), (1, result.above)):
        infinite = Counter(word for value, word in pairs if value * sign > _LARGEST)
        row = (number(sign * math.inf), str(count), *(str(infinite[word]) for word in verdicts))
        if count:
            rows.insert(0 if sign < 0 else len(rows), row)
    negative = sum(math.copysign(1.0, value) < 0 for value in values)
    undecided = words.count("undecided")
    open_ = f", {undecided} undecided" if undecided else ""
    quartiles = quantiles([value for value, _ in known], (0.25, 0.5, 0.75))
    low, middle, high = (number(six(value)) for value in quartiles.values())
    ended = sum(word == "violated" and math.copysign(1.0, value) > 0 for value, word in known)
    they = "it" if ended == 1 else "they"
    by_end = f", {ended} violated by how {they} ended" if ended else ""
    parts = [
        f"{negative} of {counted(len(values), noun)} below zero{by_end}{open_}.",
        f"Median {middle}, middle half {low} to {high}.",
        f"Minimum {number(values[0])}, maximum {number(values[-1])}.",
    ]
    beyond = [
        f"{counted(count, noun)} at {number(value)}"
        for count, value in ((result.below, -math.inf), (result.above, math.inf))
        if count
    ]
    if beyond:
        parts.append(f"{' and '.join(beyond)} beyond the axis.")
    return Figure(
        "histogram",
        "Robustness",
        " ".join(parts),
        240,
        {**plain(result), "noun": noun, "by_verdict": verdicts},
        numbers_table(("robustness", f"{noun}s", *verdicts), tuple(rows)),
        words=tuple(verdicts),
    )


def _violation_times(trials: Sequence[TrialRow], noun: str, unit: str) -> Figure:
    moments = [trial.violated_at for trial in trials if trial.violated_at is not None]
    times = evenly(sorted(moment.time or 0.0 for moment in moments), _MOST)
    episodes = len(trials)
    total = counted(episodes, noun)
    summary = (
        f"{len(times)} of {total} certainly violated: the first at {time(times[0], unit)}, half of "
        f"them by {time(float(np.median(times)), unit)}, the last at {time(times[-1], unit)}."
    )
    if len(times) == 1:
        summary = f"1 of {total} certainly violated, at {time(times[0], unit)}."
    counts = sorted(Counter(times).items())
    sums = itertools.accumulate(count for _, count in counts)
    rows = zip(aligned([at for at, _ in counts]), map(str, sums), strict=True)
    return Figure(
        "violations",
        "Time of first violation",
        summary,
        240,
        {"times": times, "episodes": episodes, "unit": unit, "noun": noun},
        numbers_table((f"time ({unit})", f"{noun}s violated by then"), tuple(rows)),
    )


def convergence_figure(
    name: str,
    simulations: Sequence[int],
    robustness: Sequence[float | None],
    verdicts: Sequence[Word],
    minima: Sequence[float | None],
) -> Figure:
    """Return the chart of the robustness over the simulations of a search."""
    steps = [
        (n, value)
        for i, (n, value) in enumerate(zip(simulations, minima, strict=True))
        if value is not None and (i == 0 or value != minima[i - 1])
    ]
    summary = "No simulation came to a robustness."
    if steps:
        position, value = steps[-1]
        summary = (
            f"The minimum robustness found is {number(value)}, in simulation {position} of "
            f"{len(minima)}."
        )
    data = {
        "requirement": name,
        "simulations": tuple(simulations),
        "robustness": tuple(robustness),
        "verdicts": tuple(verdicts),
        "least": tuple(minima),
    }
    rows = zip((str(n) for n, _ in steps), aligned([value for _, value in steps]), strict=True)
    return Figure(
        "convergence",
        "Convergence of the search",
        summary,
        260,
        plain(data),
        words=_present(verdicts),
        table=numbers_table(("simulation", "minimum robustness so far"), tuple(rows)),
    )


def _present(words: Sequence[Word]) -> tuple[Word, ...]:
    return tuple(word for word in WORDS if word in words)


def map_figure(
    name: str,
    axes: tuple[str, str],
    places: tuple[ShownSeries, ShownSeries],
    cells: Sequence[Sequence[float | None]],
    verdicts: Sequence[Sequence[Word]],
    *,
    folded: bool,
) -> Figure:
    """Return the map of the robustness over a grid of two columns."""
    (x, y), (xs, ys) = axes, places
    every = [value for row in cells for value in row]
    words = [word for row in verdicts for word in row]
    known = [value for value in every if value is not None]
    summary = f"{words.count('violated')} of {counted(len(known), 'cell')} violated"
    if "undecided" in words:
        summary += f", {words.count('undecided')} undecided"
    summary += "."
    if known:
        row, column = divmod(every.index(min(known)), len(xs))
        summary += (
            f" The minimum is {number(min(known))}, at {x} = {number(xs[column])} and "
            f"{y} = {number(ys[row])}."
        )
    if folded:
        summary += " A cell is the minimum of several simulations."
    if len(known) < len(every):
        summary += f" {counted(len(every) - len(known), 'cell')} without a result."
    texts = iter(aligned(every))
    rows = [(level, *(next(texts) or "failed" for _ in xs)) for level in aligned(ys)]
    data = {"requirement": name, "x": x, "y": y, "xs": xs, "ys": ys, "cells": cells}
    return Figure(
        "map",
        f"Robustness over {x} and {y}",
        summary,
        min(max(260, 26 * len(ys) + 100), 560),
        plain({**data, "verdicts": verdicts, "folded": folded}),
        words=_present(words),
        table=numbers_table((f"{y} \\ {x}", *aligned(xs)), tuple(reversed(rows))),
    )


def cases_figure(cases: Mapping[str, Any], name: str, left_out: int) -> Figure:
    """Return the chart of the robustness over the columns that vary."""
    verdicts = cases["verdicts"][name]
    words = Counter(verdicts)
    summary = "Each point is a simulation: " + ", ".join(
        f"{words[word]} {word}"
        for word in ("satisfied", "violated", "undecided", "failed")
        if words[word]
    )
    if left_out:
        summary += f"; {counted(left_out, 'simulation')} left out"
    return Figure(
        "cases",
        "Robustness over what was varied",
        f"{summary}. The table of simulations has their numbers.",
        240,
        {"requirement": name},
        words=_present(verdicts),
        wide=len(cases["columns"]) > 1,
    )


def episode_figure(episode: ShownEpisode, unit: str) -> Figure:
    """Return the plot of one episode: signals, robustness and predicates, one below the other."""
    panels = len(episode.signals) + len(episode.predicates)
    by_end = episode.verdict == "violated" and math.copysign(1.0, episode.final) > 0
    verdict = f"violated {BY_END}" if by_end else episode.verdict
    summary = f"Robustness {number(episode.final)} at the end, {verdict}"
    if episode.decided_at is None:
        summary += "."
    else:
        summary += f"; the violation was certain from {time(episode.decided_at.time, unit)} on."
    if episode.deciding and episode.predicates:
        summary += " Diamonds mark the samples that decided."
    if episode.of_instant and episode.robustness:
        summary += " The curve of robustness is of each instant, its bounds are about all of them."
    if len(episode.times) < episode.samples:
        summary += f" {len(episode.times)} of {episode.samples} samples are shown."
    names = ("times", "signals", "robustness", "lower", "upper", "predicates", "deciding")
    data = {name: getattr(episode, name) for name in (*names, "decided_at", "frames", "verdict")}
    height = 96 * panels + (150 if episode.robustness else 0) + 64
    return Figure("episode", "", summary, height, {**data, "unit": unit}, wide=True)


def pairs_figure(pairs: Sequence[tuple[float, float]]) -> list[Figure]:
    """Return the chart of the robustness of A and B in each pair; none without pairs."""
    if not pairs:
        return []
    better = sum(second > first for first, second in pairs)
    columns = [aligned([pair[i] for pair in pairs]) for i in (0, 1)]
    figure = Figure(
        "pairs",
        "Robustness of A and B in each pair",
        f"B is above A in {better} of {counted(len(pairs), 'pair')}: "
        "the points above the dotted line.",
        340,
        {"pairs": tuple(pairs)},
        numbers_table(("A", "B"), tuple(zip(*columns, strict=True))),
    )
    return [figure]


class Curve(NamedTuple):
    """A curve with a band at places that several curves share."""

    name: str
    values: ShownSeries
    low: ShownSeries
    high: ShownSeries


def curves_figure(
    title: str, summary: str, x: tuple[str, ShownSeries], y: str, curves: Iterable[Curve]
) -> Figure:
    """Return a chart of curves with bands."""
    name, places = x
    curves = list(curves)
    cells = [aligned(values) for values in (places, *(curve.values for curve in curves))]
    data = {"x": name, "places": places, "y": y}
    return Figure(
        "curves",
        title,
        summary,
        300,
        {**data, "curves": [plain(curve._asdict()) for curve in curves]},
        numbers_table((name, *(curve.name for curve in curves)), tuple(zip(*cells, strict=True))),
    )


_RUNS = 500
"""The maximum number of runs of each body in a timeline."""

_ROWS = 100
"""The maximum number of violations in the table next to a timeline."""


def occurrence_figures(rows: Sequence[Trial], name: str) -> list[Figure | Table]:
    """Return the statistics of a requirement over traces, and the timeline of one trace.

    The timeline shows the trace with the longest violated time. The list is empty if no trace has
    occurrences.
    """
    pairs = [
        (row, outcome.occurrences)
        for row in rows
        if (outcome := row.outcomes.get(name)) is not None and outcome.occurrences is not None
    ]
    if not pairs:
        return []
    statistics = _occurrence_statistics([occurrences for _, occurrences in pairs])
    shown = max(pairs, key=lambda pair: sum(body.violated for body in pair[1].bodies))
    return [statistics, _timeline(*shown)] if len(shown[1]) else [statistics]


def _occurrence_statistics(occurrences: Sequence[Occurrences]) -> Table:
    """Return a row for each body, over all traces."""
    head = ("body", "violations", "share of time", "an hour", "triggers", "answer time, median")
    rows = []
    for bodies in zip(*(item.bodies for item in occurrences), strict=True):
        length, violated = (sum(getattr(body, part) for body in bodies) for part in _SPANS)
        if len({body.unit for body in bodies}) > 1:  # some traces have no times
            length = 0.0
        count = sum(len(body.violations) for body in bodies)
        timed = bodies[0].unit == "s" and length > 0
        triggers = sum(len(body.responses) for body in bodies)
        answers = np.concatenate([body.answer_times for body in bodies])
        cells = (
            Cell(str(count), "n"),
            Cell(f"{percent(violated / length)} %" if length else "", "n"),
            Cell(number(3600 * count / length) if timed else "", "n"),
            Cell(str(triggers) if triggers else "", "n"),
            Cell(_duration(float(np.median(answers)), bodies[0]) if len(answers) else "", "n"),
        )
        rows.append(Row((Cell(codes=(bodies[0].text,)), *cells)))
    columns = (Column(head[0]), *(Column(text, "n") for text in head[1:]))
    what = f"All violations in {counted(len(occurrences), 'trace')}"
    return Table(columns, tuple(rows), "Violations of each body", what)


_SPANS = "length", "violated"


def _duration(value: float, body: BodyOccurrences) -> str:
    return f"{number(value)} {'s' if body.unit == 's' else 'samples'}"


def _timeline(row: Trial, found: Occurrences) -> Figure:
    """Return the chart of the violated and unknown runs of each body in a trace."""
    unit = "s" if found.unit == "s" else "steps"
    bodies, left_out = [], 0
    for body in found.bodies:
        runs = [*_runs(body, "violated"), *_runs(body, "undecided")]
        left_out += len(body.violations) + len(body.unknown) - len(runs)
        bodies.append({"text": body.text, "runs": tuple(run for _, run in sorted(runs))})
    extent = row.judged_extent
    drawn = [
        float(time)
        for body in found.bodies
        for table in (body.violations, body.unknown)
        for part in ("start", "end")
        for time in table.columns[part].tolist()
    ]
    span = [min(drawn), max(drawn)]
    if extent is not None and extent.begin is not None and extent.end is not None and unit == "s":
        span = [min(span[0], extent.begin), max(span[1], extent.end)]
    total = sum(violation.duration for violation in found)
    longest = max(found, key=lambda violation: violation.duration)
    summary = (
        f"{row.name}: {counted(len(found), 'violation')}, {number(total)} {found.unit} in all; the "
        f"longest starts at {time(six(float(longest.start)), unit)} and lasts "
        f"{number(longest.duration)} {found.unit}."
    )
    if left_out:
        summary += f" {counted(left_out, 'run')} not drawn."
    words: tuple[Word, ...] = tuple(
        word
        for word in ("violated", "undecided")
        if any(run[2] == word for body in bodies for run in body["runs"])
    )
    return Figure(
        "timeline",
        "All violations",
        summary,
        110 + 34 * len(bodies),
        plain({"bodies": tuple(bodies), "span": (six(span[0]), six(span[1])), "unit": unit}),
        _violations_table(found),
        wide=True,
        words=words,
    )


def _runs(body: BodyOccurrences, word: Word) -> list[tuple[float, tuple[float, float, Word, str]]]:
    """Return start, end, verdict and robustness of runs, with the start first."""
    if word == "violated":
        texts = [number(six(run.robustness)) for run in body.violations[:_RUNS]]
        spans = [(float(run.start), float(run.end)) for run in body.violations[:_RUNS]]
    else:
        spans = [(float(run.start), float(run.end)) for run in body.unknown[:_RUNS]]
        texts = [""] * len(spans)
    return [
        (start, (six(start), six(end), word, text))
        for (start, end), text in zip(spans, texts, strict=True)
    ]


def _violations_table(found: Occurrences) -> Table:
    rows: list[tuple[Any, ...]] = [
        (body.text, run) for body in found.bodies for run in body.violations[:_ROWS]
    ][:_ROWS]
    starts, ends, durations, worst = (
        aligned([six(float(getattr(run, part))) for _, run in rows])
        for part in ("start", "end", "duration", "robustness")
    )
    texts = [text for text, _ in rows]
    unit = "s" if found.unit == "s" else "samples"
    head = ("body", f"start ({unit})", f"end ({unit})", f"lasts ({unit})", "minimum robustness")
    return numbers_table(head, tuple(zip(texts, starts, ends, durations, worst, strict=True)))
