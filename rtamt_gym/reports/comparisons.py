"""The sections of comparisons: two policies, methods over training seeds, and recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath

from rtamt.language import RequirementId
from rtamt.monitors import Occurrence
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.evaluation.methods import MethodComparison
from rtamt_gym.evaluation.paired import Compared
from rtamt_gym.evaluation.recording_changes import (
    HEADINGS,
    ChangedRequirement,
    RecordingsComparison,
    ViolationChange,
    clock_text,
    columns_of,
    comparison_warnings,
)
from rtamt_gym.reports.episodes import in_words_of
from rtamt_gym.reports.figures import Curve, curves_figure, pairs_figure
from rtamt_gym.reports.model import (
    TRIALS,
    Cell,
    Column,
    Facts,
    Figure,
    Requirement,
    Row,
    Section,
    Table,
    Text,
)
from rtamt_gym.reports.numbers import number, percent, rounded, six
from rtamt_gym.results.codec import plain
from rtamt_gym.results.method_scores import Estimate, MethodScores
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.statistics import SUCCESS
from rtamt_gym.tables import counted, p_text


def of_comparison(comparison: Comparison) -> Section:
    """Return the section of a comparison."""
    seeds = comparison.seeds
    facts = [
        ("A", comparison.a),
        ("B", comparison.b),
        ("pairs", str(len(seeds))),
        ("seeds", f"{min(seeds)} to {max(seeds)}"),
    ]
    if comparison.returns is not None:
        effect = comparison.returns
        low, high = effect.interval
        text = f"{effect.value:.4g} ({effect.statistic}, 95 %: {low:.4g} to {high:.4g})"
        facts.append(("return of B minus return of A", text))
    return Section(
        kind="comparison",
        title=f"{comparison.b} against {comparison.a}",
        system=comparison.system,
        facts=tuple(facts),
        notes=tuple(comparison.notes),
        lead=Text(f"A: {comparison.a}. B: {comparison.b}.", "words"),
        blocks=(
            Text(comparison.sentence, "sentence"),
            Facts((("A", comparison.a, ""), ("B", comparison.b, ""))),
        ),
        requirements=tuple(
            _compared(result, comparison.ids.get(result.name)) for result in comparison.results
        ),
    )


def _compared(compared: Compared, identity: RequirementId | None) -> Requirement:
    """Return one requirement under two policies."""
    words = f"every requirement of the {counted(compared.pairs, 'pair')} at once"
    together = compared.name == SUCCESS
    return replace(
        _requirement_of(compared, words if together else in_words_of(compared.formula, 1)),
        id=identity,
        together=together,
    )


def _requirement_of(
    compared: Compared,
    words: str,
    noun: str = "episode",
    legend: str = "",
    changes: Sequence[Table | Text] = (),
    figures: Sequence[Figure] = (),
) -> Requirement:
    """Return a requirement in pairs of A and B; at most 500 pairs are drawn."""
    pairs = () if compared.robustness is None else sorted(compared.robustness.pairs)
    step = max(1, -(-len(pairs) // TRIALS))
    rates = percent(compared.rate_a), percent(compared.rate_b)
    return Requirement(
        name=compared.name,
        words=words,
        formula=compared.formula,
        rate=compared.difference,
        interval=compared.interval,
        legend=f"{legend}A {rates[0]} %, B {rates[1]} %",
        blocks=(
            Text(compared.sentence_of(noun), "sentence"),
            _rates_table(compared),
            *changes,
        ),
        figures=(
            *figures,
            _pairs_table(compared, noun),
            *pairs_figure([(six(a), six(b)) for a, b in pairs[::step]]),
        ),
    )


def _rates_table(compared: Compared) -> Table:
    """Return the table of the rates of A and B, and their difference."""
    rows = []
    for side, rate, (low, high) in (
        ("A", compared.rate_a, compared.interval_a),
        ("B", compared.rate_b, compared.interval_b),
    ):
        ends = Cell(f"{percent(low)} to {percent(high)} %", interval=(rate, (low, high), 0))
        rows.append(Row((side, Cell(f"{percent(rate)} %", "n"), ends)))
    gap, (low, high) = compared.difference, compared.interval
    ends = Cell(f"{percent(low)} to {percent(high)} points", interval=(gap, (low, high), -1))
    value = Cell(f"{'+' * (gap > 0)}{percent(gap)} points", "n")
    rows.append(Row(("B less A", value, ends), style="difference"))
    if compared.robustness is not None:
        effect = six(compared.robustness.value)
        text = " to ".join(number(six(end)) for end in compared.robustness.interval)
        value = Cell(f"{'+' * (effect > 0)}{number(effect)}", "n")
        rows.append(Row(("mean robustness, B less A", value, text)))
    head = (Column(""), Column("rate", "n"), Column("95 % interval"))
    return Table(head, tuple(rows), f"Rates of {compared.name}", style="rates")


def _pairs_table(compared: Compared, noun: str) -> Table:
    """Return the table of the pairs that satisfy a requirement under A and under B."""
    counts = {
        "A satisfies": (compared.both, compared.only_a),
        "A does not": (compared.only_b, compared.neither),
    }
    rows = (Row((name, *(Cell(str(n), "n") for n in both))) for name, both in counts.items())
    head = (Column(""), Column("B satisfies", "n"), Column("B does not", "n"))
    caption = f"Pairs of {noun}s, {p_text(compared.adjusted)} (McNemar)"
    return Table(head, tuple(rows), f"Pairs of {compared.name}", caption, "pairs")


def of_methods(methods: MethodComparison) -> Section:
    """Return the section of a comparison of methods."""
    facts = [("baseline", methods.baseline)]
    if methods.tasks != ("",):
        facts.append(("tasks", ", ".join(methods.tasks)))
    intervals = f"{100 * methods.confidence:g} %, bootstrap of {methods.resamples} draws"
    heads = ["method", "runs", "mean", "interval", "interquartile mean", "interval", "minimum"]
    heads += ["quartiles", "maximum", f"chance to be above {methods.baseline}", "adjusted p"]
    wordy = {"method", "interval", *heads[-2:]}
    sentence = Text(methods.sentence, "sentence")
    table = Table(
        tuple(Column(text, "" if text in wordy else "n") for text in heads),
        tuple(_method(name, scores) for name, scores in methods.methods.items()),
        "Methods",
        f"{methods.score} over the runs of each method, a run for each training seed",
        "rates",
    )
    return Section(
        kind="methods",
        title=f"{methods.score} of {len(methods.methods)} methods over training seeds",
        facts=(*facts, ("intervals", intervals)),
        lead=sentence,
        blocks=(sentence, table),
        figures=tuple(_curves(methods)),
    )


def _method(name: str, scores: MethodScores) -> Row:
    low, first, middle, third, high = rounded(scores.quartiles)
    cells: list[str | Cell] = [name, Cell(str(scores.runs), "n")]
    for estimate in (scores.mean, scores.interquartile_mean):
        cells += [Cell(number(six(estimate.value)), "n"), _ends(estimate)]
    quartiles = ", ".join(map(number, (first, middle, third)))
    cells += [Cell(text, "n") for text in (number(low), quartiles, number(high))]
    chance = scores.improvement
    cells.append("" if chance is None else f"{number(six(chance.value))} ({_ends(chance)})")
    cells.append("" if scores.adjusted is None else p_text(scores.adjusted))
    return Row(tuple(cells))


def _ends(estimate: Estimate) -> str:
    return " to ".join(number(six(end)) for end in estimate.interval)


def _curves(methods: MethodComparison) -> list[Figure]:
    """Return the learning curves if they are known, and the performance profiles."""
    figures, score = [], methods.score
    if methods.steps:
        curves = [_curve(name, method.curve) for name, method in methods.methods.items()]
        best = max(curves, key=lambda curve: curve.values[-1])
        summary = (
            f"The mean {score} over the runs of each method, with its interval. At the end "
            f"{best.name} is highest, at {number(best.values[-1])}."
        )
        steps = ("steps of training", rounded(methods.steps))
        figures.append(curves_figure("Learning", summary, steps, score, curves))
    summary = (
        f"The share of runs with a {score} above each number: a curve further to the right shows a "
        "better method, and a curve that falls early shows failed runs."
    )
    profiles = [_curve(name, method.profile) for name, method in methods.methods.items()]
    x = (score, rounded(methods.thresholds))
    profile = curves_figure("Performance profile", summary, x, "share of runs above", profiles)
    return [*figures, profile]


def _curve(name: str, points: Sequence[Estimate]) -> Curve:
    return Curve(
        name,
        rounded(point.value for point in points),
        rounded(point.interval[0] for point in points),
        rounded(point.interval[1] for point in points),
    )


_ROWS = 200
"""The maximum number of violations of a requirement that the page lists."""

_RUNS = 500
"""The maximum number of violations in a timeline for each side."""

_BADGES: dict[str, Word] = {
    "new": "violated",
    "longer": "violated",
    "undecided": "undecided",
    "gone": "satisfied",
    "shorter": "satisfied",
}
"""The verdict that gives a status its colour."""


def of_recordings(comparison: RecordingsComparison) -> Section:
    """Return the section of a comparison of two sets of recordings."""
    words = comparison.words
    verdict = "B is not worse than A"
    if "violated" in words:
        verdict = "B is worse than A"
    elif "undecided" in words:
        verdict = "It is undecided whether B is worse than A"
    warnings = [f"{warning.text}." for warning in comparison_warnings(comparison)]
    return Section(
        kind="recordings",
        title="{} against {}".format(*_names(comparison.b, comparison.a)),
        facts=(
            ("A", comparison.a),
            ("B", comparison.b),
            ("recordings in both", str(len(comparison.recordings))),
            ("tolerance", number(comparison.tolerance)),
            ("clock", comparison.times),
        ),
        notes=(*warnings, *(f"{note}." for note in comparison.notes)),
        lead=Text(f"A: {comparison.a}. B: {comparison.b}. {verdict}.", "words"),
        blocks=(Text(f"{clock_text(comparison)}.", "sentence"), _counts(comparison)),
        requirements=tuple(
            _changed(comparison, name, item) for name, item in comparison.requirements.items()
        ),
    )


def _names(*paths: str) -> list[str]:
    """Return the names of files without their folders, if they differ."""
    names = [PurePath(path).name for path in paths]
    return names if len(set(names)) == len(names) else list(paths)


def _counts(comparison: RecordingsComparison) -> Table:
    """Return the number of violations of each requirement with each status."""
    columns = columns_of(comparison)
    rows = [
        Row(
            (
                name,
                *(Cell(str(count), "n") for count in (item.count_a, item.count_b)),
                *(Cell(str(item.statuses[word]), "n") for word in columns),
            )
        )
        for name, item in comparison.requirements.items()
    ]
    head = (Column("requirement"), *(Column(text, "n") for text in ("A", "B", *columns)))
    return Table(head, tuple(rows), "Violations of A and B", "Violations of A and B")


def _changed(comparison: RecordingsComparison, name: str, item: ChangedRequirement) -> Requirement:
    rows = [row for row in comparison.changes if row.requirement == name]
    counts = [f"{item.statuses[word]} {word}" for word in ("new", "longer", "gone", "moved")]
    requirement = _requirement_of(
        item.compared,
        in_words_of(item.compared.formula, 1 if item.unit == "s" else None),
        "recording",
        f"{', '.join(counts)}; satisfied: ",
        _changes(rows, item.unit),
        _timeline(rows, item.unit, comparison.shifts),
    )
    return replace(requirement, name=name, id=comparison.ids.get(name))


def _changes(rows: Sequence[ViolationChange], unit: str) -> list[Table | Text]:
    """Return the table of violations that are not the same, the worst statuses first."""
    order = list(HEADINGS)
    rows = sorted(
        (row for row in rows if row.status != "same"), key=lambda row: order.index(row.status)
    )
    if not rows:
        return []
    several = len({row.body for row in rows}) > 1
    head = ["recording", *["part"] * several, "status", "A", "B", "robustness of A", "of B"]
    table = Table(
        tuple(map(Column, head)),
        tuple(
            Row(
                (
                    row.recording,
                    *[Cell(codes=(row.body,))] * several,
                    Cell(row.status, "cell", verdict=_BADGES.get(row.status)),
                    *(_times(side, unit) for side in (row.a, row.b)),
                    *(number(six(side.robustness)) if side else "" for side in (row.a, row.b)),
                )
            )
            for row in rows[:_ROWS]
        ),
        "Violations that differ",
        "Violations that differ",
    )
    if len(rows) <= _ROWS:
        return [table]
    return [table, Text(f"{counted(len(rows) - _ROWS, 'violation')} more not listed.", "muted")]


def _times(span: Occurrence | None, unit: str) -> str:
    if span is None:
        return ""
    text = number(six(span.start))
    if span.end != span.start:
        text += f" to {number(six(span.end))}"
    return f"{text}{' s' if unit == 's' else ''}{' (end)' if span.to_end else ''}"


def _timeline(
    rows: Sequence[ViolationChange], unit: str, shifts: Mapping[str, float]
) -> list[Figure]:
    """Return the violations in the recording with most new, longer or otherwise different ones."""
    differing = Counter(row.recording for row in rows if row.status != "same")
    if not differing:
        return []
    worse = Counter(row.recording for row in rows if row.status in ("new", "longer"))
    name, count = max(differing.items(), key=lambda item: (worse[item[0]], item[1]))
    own = [row for row in rows if row.recording == name]
    bodies, drawn = [], list[float]()
    for text in dict.fromkeys(row.body for row in own):
        for side, shift in (("a", 0.0), ("b", shifts.get(name, 0.0))):
            spans = [
                (six(span.start + shift), six(span.end + shift), number(six(span.robustness)))
                for row in own
                if row.body == text and (span := getattr(row, side)) is not None
            ]
            runs = tuple(
                (start, end, "violated", worst) for start, end, worst in sorted(spans)[:_RUNS]
            )
            drawn += [end for run in runs for end in run[:2]]
            bodies.append({"text": f"{side.upper()}: {text}", "runs": runs})
    summary = (
        f"{name}: {counted(count, 'violation')} {'differs' if count == 1 else 'differ'} between A "
        "and B."
    )
    if name in shifts:
        summary += f" The times of B are moved by {number(shifts[name])} s."
    data = {
        "bodies": tuple(bodies),
        "span": (min(drawn), max(drawn)),
        "unit": "s" if unit == "s" else "steps",
    }
    return [
        Figure(
            "timeline",
            "Violations of A and B",
            summary,
            110 + 34 * len(bodies),
            plain(data),
            wide=True,
            words=("violated",),
        )
    ]
