"""The sections of comparisons: two policies pair by pair, and methods over training seeds."""

from __future__ import annotations

from collections.abc import Sequence

from rtamt.language import RequirementId
from rtamt_gym.evaluation.compared import Compared
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.evaluation.methods import MethodComparison
from rtamt_gym.reports.episodes import in_words_of
from rtamt_gym.reports.figures import Curve, curves_figure, pairs_figure
from rtamt_gym.reports.model import (
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
from rtamt_gym.reports.requirements import TRIALS
from rtamt_gym.results.seeds import Estimate, MethodScores
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
    """Return one requirement under two policies; at most 500 pairs are drawn."""
    effect, together = compared.robustness, compared.name == SUCCESS
    pairs = [] if effect is None else sorted(effect.pairs)
    step = max(1, -(-len(pairs) // TRIALS))
    rates = compared.rate_a, compared.rate_b
    words = f"every requirement of the {counted(compared.pairs, 'pair')} at once"
    return Requirement(
        name=compared.name,
        words=words if together else in_words_of(compared.formula, 1),
        formula=compared.formula,
        rate=compared.difference,
        interval=compared.interval,
        legend="A {} %, B {} %".format(*map(percent, rates)),
        blocks=(Text(compared.sentence, "sentence"), rates_table(compared)),
        figures=(
            pairs_table(compared),
            *pairs_figure([(six(a), six(b)) for a, b in pairs[::step]]),
        ),
        id=identity,
        together=together,
    )


def rates_table(compared: Compared) -> Table:
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


def pairs_table(compared: Compared, noun: str = "episode") -> Table:
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
    least, first, middle, third, greatest = rounded(scores.quartiles)
    cells: list[str | Cell] = [name, Cell(str(scores.runs), "n")]
    for estimate in (scores.mean, scores.interquartile_mean):
        cells += [Cell(number(six(estimate.value)), "n"), _ends(estimate)]
    quartiles = ", ".join(map(number, (first, middle, third)))
    cells += [Cell(text, "n") for text in (number(least), quartiles, number(greatest))]
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
        f"The share of runs whose {score} is above each number: a curve further to the right is of "
        "a better method, and one that falls early has failed runs."
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
