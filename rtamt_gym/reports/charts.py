"""The charts of the page: what each shows in a sentence, as a table, and as data for the script."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from rtamt_gym.reports.model import Section, ShownEpisode, ShownRequirement, plain
from rtamt_gym.reports.texts import aligned, number, time
from rtamt_gym.reports.views import (
    Cases,
    ComparedRequirement,
    Convergence,
    Curve,
    HeatMap,
    MethodsView,
)
from rtamt_gym.results.outcome import BY_END, Word
from rtamt_gym.tables import counted

__all__ = ["Chart", "Table", "bins", "charts_of", "curves_charts", "episode_chart", "pairs_chart"]

NOUNS: Mapping[str, str] = {
    "evaluation": "episode",
    "sweep": "simulation",
    "search": "simulation",
    "matrix": "trace",
    "comparison": "pair",
    "methods": "run",
}
"""What one run is called in a section of each kind."""


@dataclass(frozen=True, slots=True)
class Table:
    """The numbers of a chart as texts, for those who do not see it."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart that the script draws.

    Attributes:
        kind: Which function of the script draws it.
        title: Its title.
        summary: What it shows, in a sentence or two.
        height: Its height in pixels.
        data: What the script needs.
        table: Its numbers; None if the page has them elsewhere, or the script makes the table.
        wide: Whether it takes the whole width.
        words: The verdicts that it shows by colour and sign, for its legend.
    """

    kind: str
    title: str
    summary: str
    height: int
    data: Mapping[str, Any]
    table: Table | None = None
    wide: bool = False
    words: tuple[Word, ...] = ()


@dataclass(slots=True)
class Bins:
    """Counts of numbers in intervals of one width, with an edge at zero.

    Attributes:
        width: The width of an interval.
        first: The number of the first interval; number 0 begins at zero.
        counts: How many are in each interval, from the first on.
        below: How many are minus infinity.
        above: How many are infinity.
    """

    width: float
    first: int = 0
    counts: list[int] = field(default_factory=list)
    below: int = 0
    above: int = 0


_LARGEST = 1e100

WORDS: Final[tuple[Word, ...]] = ("violated", "undecided", "satisfied", "failed")
"""What became of requirements, in the order in which charts stack and name them."""


def bins(values: Sequence[float]) -> Bins:
    """Counts numbers in at most 27 intervals; those below zero never share one with the others.

    A zero with a minus sign counts as below, as a robustness that violates does. Numbers beyond
    1e100 count as infinite, and all within 1e-100 of each other share an interval.

    Example:
        >>> bins([-0.5, -0.0, 0.0, 0.4, math.inf])
        Bins(width=0.2, first=-3, counts=[1, 0, 1, 1, 0, 1], below=0, above=1)
    """
    finite = [value for value in values if abs(value) <= _LARGEST]
    found = Bins(
        1.0, below=sum(v < -_LARGEST for v in values), above=sum(v > _LARGEST for v in values)
    )
    if not finite:
        return found
    least, greatest = min(finite), max(finite)
    span = max(greatest - least or abs(greatest) or 1.0, 1 / _LARGEST)
    # Readers see a shape in as many intervals as the root of the count allows.
    wanted = min(max(8.0, 2 * math.sqrt(len(finite))), 24.0)
    power = 10.0 ** math.floor(math.log10(span / wanted))
    found.width = next(w for w in (power, 2 * power, 5 * power, 10 * power) if span <= wanted * w)
    places = Counter(_place(value, found.width) for value in finite)
    found.first = min(places)
    found.counts = [places[i] for i in range(found.first, max(places) + 1)]
    return found


def _by_verdict(requirement: ShownRequirement, found: Bins) -> dict[Word, list[int]]:
    """How many of each interval have each verdict, by word; words that none has are left out."""
    places = Counter(
        (verdict, _place(value, found.width))
        for value, verdict in zip(requirement.robustness, requirement.verdicts, strict=True)
        if abs(value) <= _LARGEST
    )
    numbers = range(found.first, found.first + len(found.counts))
    counts = {word: [places[word, i] for i in numbers] for word in WORDS}
    return {word: each for word, each in counts.items() if any(each)}


def _place(value: float, width: float) -> int:
    if math.copysign(1.0, value) < 0:
        return min(math.floor(value / width + 1e-9), -1)
    return max(math.floor(value / width + 1e-9), 0)


def charts_of(section: Section, requirement: ShownRequirement) -> list[Chart]:
    """The charts of a requirement but for its worst episodes."""
    noun = NOUNS[section.kind]
    found = []
    if requirement.robustness:
        found.append(_histogram(requirement, noun))
    if requirement.first_violations and len(requirement.trials) > 1:
        found.append(_violations(requirement, noun, section.unit))
    found += [_convergence(c) for c in section.convergence if c.requirement == requirement.name]
    found += [_map(m) for m in section.maps if m.requirement == requirement.name]
    if section.cases is not None and requirement.name in section.cases.robustness:
        found.append(_cases(section.cases, requirement.name))
    return found


def _histogram(requirement: ShownRequirement, noun: str) -> Chart:
    values = requirement.robustness
    found = bins(values)
    verdicts = _by_verdict(requirement, found)
    edges = aligned([found.width * (found.first + i) for i in range(len(found.counts) + 1)])
    rows = [
        (f"{low} to {high}", str(count), *(str(each[i]) for each in verdicts.values()))
        for i, ((low, high), count) in enumerate(
            zip(itertools.pairwise(edges), found.counts, strict=True)
        )
        if count
    ]
    if found.below:
        rows.insert(0, (number(-math.inf), str(found.below), *_beyond(requirement, verdicts, -1)))
    if found.above:
        rows.append((number(math.inf), str(found.above), *_beyond(requirement, verdicts, 1)))
    negative = sum(math.copysign(1.0, value) < 0 for value in values)
    undecided = requirement.verdicts.count("undecided")
    open_ = f", {undecided} undecided" if undecided else ""
    low, middle, high = (number(requirement.quantiles[share]) for share in ("0.25", "0.5", "0.75"))
    they = "it" if requirement.by_end == 1 else "they"
    by_end = f", {requirement.by_end} violated by how {they} ended" if requirement.by_end else ""
    parts = [
        f"{negative} of {counted(len(values), noun)} below zero{by_end}{open_}.",
        f"Median {middle}, middle half {low} to {high}.",
        f"Least {number(values[0])}, greatest {number(values[-1])}.",
    ]
    beyond = [
        f"{counted(count, noun)} at {number(value)}"
        for count, value in ((found.below, -math.inf), (found.above, math.inf))
        if count
    ]
    if beyond:
        parts.append(f"{' and '.join(beyond)} beyond the axis.")
    return Chart(
        "histogram",
        "Robustness",
        " ".join(parts),
        240,
        {**plain(found), "noun": noun, "by_verdict": verdicts},
        Table(("robustness", f"{noun}s", *verdicts), tuple(rows)),
        words=tuple(verdicts),
    )


def _beyond(requirement: ShownRequirement, words: Iterable[Word], sign: int) -> list[str]:
    """How many of the infinite robustness of a sign have each of the verdicts."""
    found = [
        verdict
        for value, verdict in zip(requirement.robustness, requirement.verdicts, strict=True)
        if value * sign > _LARGEST
    ]
    return [str(found.count(word)) for word in words]


def _violations(requirement: ShownRequirement, noun: str, unit: str) -> Chart:
    times = requirement.first_violations
    total = requirement.counts.episodes
    summary = (
        f"{len(times)} of {counted(total, noun)} certainly violated: "
        f"the first at {time(times[0], unit)}, half of them by "
        f"{time(float(np.median(times)), unit)}, the last at {time(times[-1], unit)}."
    )
    if len(times) == 1:
        summary = f"1 of {counted(total, noun)} certainly violated, at {time(times[0], unit)}."
    counts = sorted(Counter(times).items())
    sums = itertools.accumulate(count for _, count in counts)
    rows = zip(aligned([at for at, _ in counts]), map(str, sums), strict=True)
    return Chart(
        "violations",
        "Time of first violation",
        summary,
        240,
        {"times": times, "episodes": total, "unit": unit, "noun": noun},
        Table((f"time ({unit})", f"{noun}s violated by then"), tuple(rows)),
    )


def _convergence(convergence: Convergence) -> Chart:
    least = convergence.least
    steps = [
        (n, value)
        for i, (n, value) in enumerate(zip(convergence.simulations, least, strict=True))
        if value is not None and (i == 0 or value != least[i - 1])
    ]
    last = steps[-1] if steps else None
    summary = (
        f"The least robustness found is {number(last[1])}, in simulation {last[0]} of {len(least)}."
        if last
        else "No simulation came to a robustness."
    )
    return Chart(
        "convergence",
        "Convergence of the search",
        summary,
        260,
        plain(convergence),
        words=_present(convergence.verdicts),
        table=Table(
            ("simulation", "least robustness so far"),
            tuple(
                zip((str(n) for n, _ in steps), aligned([value for _, value in steps]), strict=True)
            ),
        ),
    )


def _present(words: Sequence[Word]) -> tuple[Word, ...]:
    return tuple(word for word in WORDS if word in words)


def _map(heat: HeatMap) -> Chart:
    cells = [value for row in heat.cells for value in row]
    words = [word for row in heat.verdicts for word in row]
    known = [value for value in cells if value is not None]
    summary = f"{words.count('violated')} of {counted(len(known), 'cell')} violated"
    if "undecided" in words:
        summary += f", {words.count('undecided')} undecided"
    summary += "."
    if known:
        where = cells.index(min(known))
        row, column = divmod(where, len(heat.xs))
        summary += (
            f" The least is {number(min(known))}, at {heat.x} = {number(heat.xs[column])} and "
            f"{heat.y} = {number(heat.ys[row])}."
        )
    if heat.folded:
        summary += " A cell is the least of several simulations."
    if len(known) < len(cells):
        summary += f" {counted(len(cells) - len(known), 'cell')} without a result."
    texts = iter(aligned(cells))
    rows = [(y, *(next(texts) or "failed" for _ in heat.xs)) for y in aligned(heat.ys)]
    return Chart(
        "map",
        f"Robustness over {heat.x} and {heat.y}",
        summary,
        min(max(260, 26 * len(heat.ys) + 100), 560),
        plain(heat),
        words=_present(words),
        table=Table((f"{heat.y} \\ {heat.x}", *aligned(heat.xs)), tuple(reversed(rows))),
    )


def _cases(cases: Cases, name: str) -> Chart:
    words = Counter(cases.verdicts[name])
    summary = "Each point is a simulation: " + ", ".join(
        f"{words[word]} {word}"
        for word in ("satisfied", "violated", "undecided", "failed")
        if words[word]
    )
    if cases.left_out:
        summary += f"; {counted(cases.left_out, 'simulation')} left out"
    return Chart(
        "cases",
        "Robustness over what was varied",
        f"{summary}. The table of simulations has their numbers.",
        240,
        {"requirement": name},
        words=_present(cases.verdicts[name]),
        wide=len(cases.columns) > 1,
    )


def _verdict(episode: ShownEpisode) -> str:
    """The verdict on an episode; of a violation by the end alone it says that."""
    by_end = episode.verdict == "violated" and math.copysign(1.0, episode.final) > 0
    return f"violated {BY_END}" if by_end else episode.verdict


def episode_chart(episode: ShownEpisode, unit: str) -> Chart:
    """The plot of one episode: signals, robustness, predicates, one below the other."""
    panels = len(episode.signals) + len(episode.predicates)
    summary = (
        f"Robustness {number(episode.final)} at the end, {_verdict(episode)}"
        + (
            f"; the violation was certain from {time(episode.decided_at.time, unit)} on."
            if episode.decided_at is not None
            else "."
        )
        + " Diamonds mark the samples that decided." * bool(episode.deciding and episode.predicates)
    )
    if episode.of_instant and episode.robustness:
        summary += " The curve of robustness is of each instant, its bounds are about all of them."
    if len(episode.times) < episode.samples:
        summary += f" {len(episode.times)} of {episode.samples} samples are shown."
    data = {
        **{
            name: getattr(episode, name)
            for name in ("times", "signals", "robustness", "lower", "upper", "predicates")
        },
        "deciding": episode.deciding,
        "decided_at": episode.decided_at,
        "frames": episode.frames,
        "verdict": episode.verdict,
        "unit": unit,
    }
    height = 96 * panels + (150 if episode.robustness else 0) + 64
    return Chart("episode", "", summary, height, data, wide=True)


def pairs_chart(compared: ComparedRequirement) -> Chart | None:
    """The robustness of both policies in each pair of episodes; None if it is not known."""
    if not compared.pairs:
        return None
    better = sum(second > first for first, second in compared.pairs)
    return Chart(
        "pairs",
        "Robustness of A and B in each pair",
        f"B is above A in {better} of {counted(len(compared.pairs), 'pair')}: "
        "the points above the dotted line.",
        340,
        {"pairs": compared.pairs},
        Table(
            ("A", "B"),
            tuple(
                zip(*(aligned([pair[i] for pair in compared.pairs]) for i in (0, 1)), strict=True)
            ),
        ),
    )


def curves_charts(view: MethodsView) -> list[Chart]:
    """The learning curves of methods if they are known, and their performance profiles."""
    found = []
    if view.curves:
        best = max(view.curves, key=lambda curve: curve.values[-1])
        summary = (
            f"The mean {view.score} over the runs of each method, with its interval. At the end "
            f"{best.name} is highest, at {number(best.values[-1])}."
        )
        found.append(
            _curves("Learning", summary, ("steps of training", view.steps), view.score, view.curves)
        )
    summary = (
        f"The share of runs whose {view.score} is above each number: a curve further to the right "
        "is of a better method, and one that falls early has failed runs."
    )
    return [
        *found,
        _curves(
            "Performance profile",
            summary,
            (view.score, view.thresholds),
            "share of runs above",
            view.profiles,
        ),
    ]


def _curves(
    title: str,
    summary: str,
    x: tuple[str, tuple[float, ...]],
    y: str,
    curves: Sequence[Curve],
) -> Chart:
    name, places = x
    cells = [aligned(each) for each in (places, *(curve.values for curve in curves))]
    return Chart(
        "curves",
        title,
        summary,
        300,
        {"x": name, "places": places, "y": y, "curves": plain(tuple(curves))},
        Table((name, *(curve.name for curve in curves)), tuple(zip(*cells, strict=True))),
    )
