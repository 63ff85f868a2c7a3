"""The section of methods over training seeds: their table, curves with bands, and profiles."""

from __future__ import annotations

from collections.abc import Sequence

from rtamt_gym.evaluation.method_scores import Estimate
from rtamt_gym.evaluation.methods import MethodComparison
from rtamt_gym.reports.model import Fact, Section
from rtamt_gym.reports.series import rounded, six
from rtamt_gym.reports.views import Curve, MethodRow, MethodsView

__all__ = ["of_methods"]


def of_methods(found: MethodComparison) -> Section:
    """The section of a comparison of methods."""
    facts = [Fact("baseline", found.baseline)]
    if found.tasks != ("",):
        facts.append(Fact("tasks", ", ".join(found.tasks)))
    facts += [
        Fact("intervals", f"{100 * found.confidence:g} %, bootstrap of {found.resamples} draws"),
    ]
    rows = tuple(
        MethodRow(
            name=name,
            runs=each.runs,
            mean=six(each.mean.value),
            mean_interval=_six(each.mean),
            middle=six(each.interquartile_mean.value),
            middle_interval=_six(each.interquartile_mean),
            quartiles=rounded(each.quartiles),
            improvement=None if each.improvement is None else six(each.improvement.value),
            improvement_interval=None if each.improvement is None else _six(each.improvement),
            p=each.adjusted,
        )
        for name, each in found.methods.items()
    )
    return Section(
        kind="methods",
        title=f"{found.score} of {len(rows)} methods over training seeds",
        facts=tuple(facts),
        methods=MethodsView(
            score=found.score,
            baseline=found.baseline,
            sentence=found.sentence,
            rows=rows,
            steps=rounded(found.steps),
            curves=tuple(_curve(name, each.curve) for name, each in found.methods.items())
            if found.steps
            else (),
            thresholds=rounded(found.thresholds),
            profiles=tuple(_curve(name, each.profile) for name, each in found.methods.items()),
        ),
    )


def _six(estimate: Estimate) -> tuple[float, float]:
    low, high = estimate.interval
    return six(low), six(high)


def _curve(name: str, points: Sequence[Estimate]) -> Curve:
    return Curve(
        name,
        rounded(each.value for each in points),
        rounded(each.interval[0] for each in points),
        rounded(each.interval[1] for each in points),
    )
