"""Episodes in full: signals, robustness with bounds, predicates, and the samples that decided."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import Explanation, RtamtError, Specification, Verdict
from rtamt.internal import explain_verdict
from rtamt.typing import End
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.run import Run
from rtamt_gym.play.summaries import case_lines
from rtamt_gym.reports.model import Decision, ShownEpisode
from rtamt_gym.reports.numbers import points_of, rounded, shown, six
from rtamt_gym.results.outcome import Moment, Outcome, word

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayedEpisode:
    """The samples of an episode and the outcome of a requirement in it."""

    label: str
    spec: Specification
    interface: Mapping[str, Any]
    signals: Mapping[str, Floats]
    times: Floats
    period: Fraction | None
    align: Any
    outcome: Outcome
    curves: Mapping[str, Floats]
    first: int = 0

    def episode(self, room: int, episodes: int, **also: Any) -> ShownEpisode:  # noqa: ANN401 - fields of an episode
        """Return the episode for a page with room for a number of values of several episodes.

        A predicate is left out if its term has no value at a sample.
        """
        predicates = self._predicates()
        every = {**self.signals, **self.curves, **{f"({p})": v for p, v in predicates.items()}}
        explanation = self._explanation() if self.first == 0 else None
        deciding = () if explanation is None else self._decisions(explanation)
        required = [] if explanation is None else [step.sample for step in explanation.steps]
        decided = self._violated()
        required += [] if decided is None else [(decided.sample or 0) - self.first]
        most = points_of(room, episodes, len(every) + 1)
        samples = shown(every.values(), len(self.times), required, most)
        curves = {name: rounded(values[samples]) for name, values in self.curves.items()}
        return ShownEpisode(
            label=self.label,
            verdict=word(self.outcome),
            final=six(self.outcome.robustness),
            samples=len(self.times),
            times=rounded(self.times[samples]),
            signals={name: rounded(values[samples]) for name, values in self.signals.items()},
            robustness=curves.get("robustness", ()),
            lower=curves.get("lower", ()),
            upper=curves.get("upper", ()),
            predicates={text: rounded(values[samples]) for text, values in predicates.items()},
            deciding=deciding,
            decided_at=decided,
            explanation="" if explanation is None else str(explanation),
            **also,
        )

    def _violated(self) -> Moment | None:
        """Return the moment that decided a violation, with its sample, which some files lack."""
        moment = self.outcome.decided
        if moment is None or moment.time is None or self.outcome.verdict is not Verdict.VIOLATED:
            return None
        if moment.sample is None:
            nearest = int(np.abs(self.times - moment.time).argmin())
            moment = Moment(nearest + self.first, moment.seconds)
        return rounded_moment(moment)

    def _predicates(self) -> dict[str, Floats]:
        result = {}
        for predicate in self.spec.predicates():
            # A term that the verdict does not need may have no value.
            with suppress(RtamtError):
                result[str(predicate)] = rtamt.evaluate(
                    predicate, self.signals, self.period, n=len(self.times), **self.interface
                )
        return result

    def _explanation(self) -> Explanation | None:
        """Return the explanation of the verdict, or of the robustness if it is undecided.

        The bounds of the outcome show how the trace ended: if they differ, the bound that decides
        is explained.
        """
        outcome = self.outcome
        arguments: dict[str, Any] = {"n": len(self.times), "align": self.align, **self.interface}
        start = float(self.times[0])
        violated = outcome.verdict is Verdict.VIOLATED
        decided = outcome.upper if violated else outcome.lower
        ends: tuple[End, ...] = ("open", "cut")
        try:
            if outcome.verdict is Verdict.UNDECIDED or outcome.lower == outcome.upper:
                return rtamt.explain(self.spec, self.signals, self.period, start=start, **arguments)
            for end in ends:
                explanation = explain_verdict(
                    *(self.spec, self.signals, self.period),
                    end=end,
                    violated=violated,
                    start=start,
                    **arguments,
                )
                if explanation is not None and explanation.robustness == decided:
                    return explanation
        except RtamtError:  # the available samples do not explain the stored verdict
            pass
        return None

    def _decisions(self, explanation: Explanation) -> tuple[Decision, ...]:
        """Return the predicate and the sample that decided; none for a window outside the trace."""
        last = explanation.steps[-1]
        if not explanation.causes:
            return ()
        values = {cause.variable: six(cause.value) for cause in explanation.causes}
        time, unit = self.times[last.sample], "s" if self.period else ""
        when = f"{six(time):g} {unit}" if unit else f"sample {last.sample}"
        where = " and ".join(f"{name} is {value:g}" for name, value in values.items())
        words = f"{last.text} decided at {when}, where {where}"
        return (Decision(str(last.formula), six(time), values, six(last.value), words),)


def episode_of_run(run: Run, name: str, label: str, room: int, episodes: int) -> ShownEpisode:
    """Return an episode in full from its run."""
    history = run.histories[name]
    step = run.view == "step"
    spec = history.specification
    played = PlayedEpisode(
        label=label,
        spec=spec.always() if step else spec,
        interface=history.interface,
        signals=run.signals,
        times=run.times,
        period=run.period,
        align=run.align,
        outcome=history.outcome(run.period),
        curves={key: getattr(history, key) for key in ("robustness", "lower", "upper")},
        first=run.first_sample,
    )
    return played.episode(room, episodes, case=case_texts(run.case or {}), of_instant=step)


def rounded_moment(moment: Moment) -> Moment:
    """Return the moment with seconds of six digits."""
    return Moment(moment.sample, None if moment.seconds is None else six(moment.seconds))


def case_texts(case: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a case, a text for each entry."""
    lines = (case_lines(Case({name: entry})) for name, entry in case.items())
    return tuple(" ".join(" ".join(line).split()) for line in lines)


def in_words_of(formula: str, period: object, *, unit: str = "s", step: bool = False) -> str:
    """Return a requirement of a record in words; without a period, bounds count steps."""
    spec = rtamt.parse(formula, unit=unit)
    shown = spec.formula.always() if step else spec.formula
    return shown.in_words(unit="steps" if period is None else unit)
