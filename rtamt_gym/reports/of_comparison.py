"""The section of a comparison: each requirement under two policies, pair by pair."""

from __future__ import annotations

from dataclasses import replace

from rtamt_gym.evaluation.compared import Compared
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.reports.episodes import in_words_of
from rtamt_gym.reports.model import Fact, Section
from rtamt_gym.reports.rows import TRIALS
from rtamt_gym.reports.series import six
from rtamt_gym.reports.views import ComparedRequirement, ComparisonView
from rtamt_gym.results.statistics import SUCCESS
from rtamt_gym.tables import counted

__all__ = ["of_comparison"]


def of_comparison(comparison: Comparison) -> Section:
    """The section of a comparison."""
    seeds = comparison.seeds
    facts = [
        Fact("A", comparison.a),
        Fact("B", comparison.b),
        Fact("pairs", str(len(seeds))),
        Fact("seeds", f"{min(seeds)} to {max(seeds)}"),
    ]
    if comparison.returns is not None:
        effect = comparison.returns
        low, high = effect.interval
        text = f"{effect.value:.4g} ({effect.statistic}, 95 %: {low:.4g} to {high:.4g})"
        facts.append(Fact("return of B minus return of A", text))
    return Section(
        kind="comparison",
        title=f"{comparison.b} against {comparison.a}",
        system=comparison.system,
        facts=tuple(facts),
        notes=tuple(comparison.notes),
        comparison=ComparisonView(
            comparison.a,
            comparison.b,
            comparison.sentence,
            tuple(
                replace(_compared(each), id=comparison.ids.get(each.name))
                for each in comparison.results
            ),
        ),
    )


def _compared(of: Compared) -> ComparedRequirement:
    """One requirement; at most 500 pairs of it are drawn."""
    effect = of.robustness
    pairs = [] if effect is None else sorted(effect.pairs)
    step = max(1, -(-len(pairs) // TRIALS))
    every = of.name == SUCCESS
    return ComparedRequirement(
        name=of.name,
        words=f"every requirement of the {counted(of.pairs, 'pair')} at once"
        if every
        else in_words_of(of.formula, 1),
        formula=of.formula,
        sentence=of.sentence,
        rate_a=of.rate_a,
        rate_b=of.rate_b,
        interval_a=of.interval_a,
        interval_b=of.interval_b,
        difference=of.difference,
        interval=of.interval,
        p=of.adjusted,
        both=of.both,
        only_a=of.only_a,
        only_b=of.only_b,
        neither=of.neither,
        robustness=None if effect is None else six(effect.value),
        robustness_interval=None
        if effect is None
        else (six(effect.interval[0]), six(effect.interval[1])),
        pairs=tuple((six(a), six(b)) for a, b in pairs[::step]),
    )
