"""`mine`: the tightest constant with which a requirement holds on all traces."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Final, Literal, Unpack, get_args

import rtamt
from rtamt import Explanation, InputError
from rtamt.errors import Argument
from rtamt.renamed import OldName
from rtamt.typing import End
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.recorded.progress import progress as shown_progress
from rtamt_gym.results.codec import document, plain_results
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.statistics import Results
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.mining.bisection import (
    Candidates,
    Tightest,
    ValueVerdict,
    bounds_between,
    text_of,
    tightest,
    values_between,
)
from rtamt_gym.search.mining.requirement import Ranges, Template, template
from rtamt_gym.search.mining.traces import Samples, Traces, samples_of
from rtamt_gym.tables import counted, number, shorten, wrapped

_SIDES: Final = {"least": "smallest", "greatest": "largest"}
"""The words for the side of a mined value."""


@dataclass(frozen=True, slots=True)
class Witness:
    """A trace that lets no tighter value pass.

    Attributes:
        name: The name of the trace: the path, the label of a run, or its number.
        index: The number of the trace, from 0.
        robustness: The robustness of the trace at the mined value.
        trace: The trace as passed; for a sweep, the `Row`, which ``sweep.replay`` runs again.
    """

    name: str
    index: int
    robustness: float
    trace: object = field(repr=False)


@dataclass(frozen=True, repr=False, eq=False)
class Mined:
    """The tightest value of a parameter with which a requirement holds on all traces.

    ``print`` shows the value, the trace that decided it, and how far it was checked.

    Attributes:
        requirement: The requirement with its parameter, as it was passed.
        parameter: The name of the parameter.
        value: The value. All traces were judged to satisfy the requirement with it.
        side: ``"least"`` if the requirement holds from this value on, ``"greatest"`` if it holds up
            to it.
        fails_at: The neighbour of the value on the other side, with which at least one trace was
            judged not to satisfy the requirement.
        low: The lower end of the range.
        high: The upper end of the range.
        specification: The requirement with the value in place of the parameter.
        traces: The number of traces.
        witnesses: The traces that do not satisfy the requirement at ``fails_at``, in ascending
            order of robustness there.
        explanation: Which sub-formulas and samples decide the robustness of the first witness at
            the value.
        evaluations: The number of evaluations of a trace.
        probes: The number of values, with both ends, at which every trace was judged to check that
            its verdict changes at most once.
        notes: Further remarks, in sentences.
        triggers: The number of traces that trigger the requirement at the value; None if it has no
            implication. If it is 0, the value does not describe the system.
    """

    requirement: str
    parameter: str
    value: float
    side: Literal["least", "greatest"]
    fails_at: float
    low: float
    high: float
    specification: rtamt.Specification
    traces: int
    witnesses: tuple[Witness, ...]
    explanation: Explanation
    evaluations: int
    probes: int
    notes: tuple[str, ...] = ()
    triggers: int | None = None

    asked = OldName("triggers")
    never_asked = OldName("never_triggered")

    @property
    def witness(self) -> Witness:
        """The trace that decided the value: the first of ``witnesses``."""
        return self.witnesses[0]

    @property
    def robustness(self) -> float:
        """The robustness of the witness at the value."""
        return self.witness.robustness

    @property
    def _formula(self) -> str:
        """The text, if it is one formula with its parameter; otherwise the formula at the value."""
        shows = f"?{self.parameter}" in self.requirement
        return self.requirement if shows and "\n" not in self.requirement else self.formula

    @property
    def formula(self) -> str:
        """The requirement as text, with the value in place of the parameter."""
        return str(self.specification.formula)

    @property
    def never_triggered(self) -> str:
        """A warning that no trace triggers the requirement at the value; otherwise empty."""
        if self.triggers != 0:
            return ""
        phrase = f"{self.parameter} = {text_of(self.value)}"
        return f"never triggered: {phrase} in 0 of {counted(self.traces, 'trace')}"

    def to_json(self) -> str:
        """Return the value as a result of the kind ``"mined"``, with the witnesses as trials."""
        names = ("requirement", "parameter", "value", "side", "fails_at", "low", "high", "traces")
        trials = [
            Trial.of_trace(
                witness.name, "", {self.parameter: Outcome.of_height(witness.robustness)}
            )
            for witness in self.witnesses
        ]
        about = {
            **{name: getattr(self, name) for name in names},
            "formula": self.formula,
            "explanation": str(self.explanation),
            "evaluations": self.evaluations,
            "probes": self.probes,
            "notes": self.notes,
            "asked": self.triggers,
        }
        results = Results(trials, {self.parameter: self.formula})
        return document("mined", {**about, **plain_results(results, rates=False)})

    def __repr__(self) -> str:
        return (
            f"<Mined {self.parameter} = {text_of(self.value)}, the {_SIDES[self.side]}: "
            f"{shorten(self._formula, 60)} on {counted(self.traces, 'trace')}>"
        )

    def __str__(self) -> str:
        name, witness = self.parameter, self.witness
        satisfy = "the trace satisfies" if self.traces == 1 else f"all {self.traces} traces satisfy"
        value, fails_at, low, high = map(text_of, (self.value, self.fails_at, self.low, self.high))
        side = _SIDES[self.side]
        others = counted(len(self.witnesses) - 1, "other")
        others_text = f", nor does {others}" if len(self.witnesses) == 2 else f", nor do {others}"
        others_text *= len(self.witnesses) > 1
        checked = f"at the {self.probes} values that were tried from {low} to {high}"
        evaluations = counted(self.evaluations, "evaluation")
        texts = [
            f"{name} = {value} is the {side} for which {satisfy} {self._formula}",
            f"at {name} = {fails_at} {witness.name} does not{others_text}",
            f"no trace changes its verdict more than once {checked} ({evaluations})",
            *(f"note: {note}" for note in self.notes),
        ]
        lines = [line for text in texts for line in _wrapped(text)]
        lines += ["", *_wrapped(f"{witness.name} at {name} = {text_of(self.value)}:")]
        case = getattr(witness.trace, "case", None)
        if case:
            columns = ", ".join(f"{key}={number(value)}" for key, value in case.columns().items())
            lines += _wrapped(f"case: {columns}")
        never = [""] * bool(self.never_triggered) + wrapped(self.never_triggered)
        return "\n".join([*lines, str(self.explanation), *never])


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        text, 80, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False
    )


@documents_options("samples")
def mine(
    requirement: str | rtamt.Specification,
    traces: Traces,
    ranges: Ranges,
    *,
    constants: Mapping[str, float] | None = None,
    tolerance: float | None = None,
    end: End | None = None,
    progress: bool = True,
    **reading: Unpack[EvaluationKeywords],
) -> Mined:
    """Return the tightest value of a parameter with which a requirement holds on all traces.

    A ``?`` before a name makes it the parameter: ``always(speed < ?v)``. A parameter in a predicate
    is mined to a tolerance. A parameter in an interval, ``eventually[0:?t](x > 1)``, is a multiple
    of the period.

    The requirement has to be monotone: all traces satisfy it from some value on, or up to it. This
    is checked, not proved: every trace is judged at 17 values spread over the range, and a trace
    that changes its verdict twice is an error that shows the values. Then bisection finds the
    value. All traces were judged to satisfy the requirement at the value, and at least one was
    judged not to satisfy it at the neighbour.

    Args:
        requirement: A text with a parameter ``?name``; or a text or a specification that defines a
            constant of this name (``const float v = 3``), which is then the parameter.
        traces: One trace or several: columns by name, data frames, paths of files as for ``rtamt
            monitor``, `Run`s; or a `Sweep`, whose simulations run once more to their end, except
            failed ones.
        ranges: The lower and upper end of the parameter's range: ``{"v": (0, 200)}``.
        constants: Values of other parameters and constants.
        tolerance: The values are multiples of this; 0 for all floats. Not for a bound of an
            interval. Default: the largest power of ten up to a 100,000th of the range.
        end: The end mode of a trace, as for `rtamt.judge`. Default: ``"complete"`` for a run that
            its system ended, otherwise ``"cut"``. An undecided trace does not satisfy.
        progress: Whether to show a bar on a terminal if tqdm is installed.
        **reading: Evaluation options: ``period`` (default: the period of a file or a run; otherwise
            bounds count samples), ``nan``, ``align`` (default: the align of a run), ``semantics``,
            ``inputs`` and ``outputs``, as for `rtamt.judge`.

    Raises:
        SpecificationError: If the requirement is wrong for some value of the range.
        InputError: If the requirement is not monotone, or holds for no value or for all values of
            the range, if not exactly one parameter has a range, or if a trace cannot be judged.
        InputTypeError: If an argument is not of the types above.
        OSError: If a file does not exist.

    Example:
        >>> from rtamt_gym import mine
        >>> calm = {"speed": [10.0, 24.5, 18.0]}
        >>> fast = {"speed": [10.0, 22.0, 31.25, 12.0]}
        >>> mined = mine("always(speed < ?v)", [calm, fast], {"v": (0, 50)}, tolerance=0.1)
        >>> mined
        <Mined v = 31.3, the smallest: always(speed < ?v) on 2 traces>
        >>> mined.witness.name, round(mined.robustness, 2), mined.explanation.causes
        ('trace 1', 0.05, (Cause(variable='speed', sample=2, value=31.25),))
        >>> mine("eventually[0:?t](speed > 20)", [calm, fast], {"t": (0, 3)})
        <Mined t = 1, the smallest: eventually[0:?t](speed > 20) on 2 traces>
    """
    check_choice("end", end, (None, *get_args(End)))
    options = checked_options(reading, mine, "samples")
    if end is not None:
        options = options.having(end=end)
    parametric = template(requirement, ranges, constants)
    spec = parametric.at(parametric.low)
    samples, notes = samples_of(traces, spec, options, shown=progress)
    return mined_over(parametric, samples, tolerance, notes, shown=progress)


def mined_over(
    wanted: Template,
    traces: list[Samples],
    tolerance: float | None,
    notes: tuple[str, ...],
    *,
    shown: bool,
) -> Mined:
    """Mine the parameter on traces, with notes on the traces; `mine` documents the errors."""
    values = _values(wanted, traces, tolerance)

    def judge(trace: int, value: Fraction) -> ValueVerdict:
        with_value = f"at {wanted.parameter} = {text_of(value)}"
        try:
            judgement = traces[trace].judge(wanted.at(value))
        except rtamt.RtamtError as error:
            error.add_note(with_value)
            raise
        return ValueVerdict(judgement.verdict, judgement.robustness)

    names = [trace.name for trace in traces]
    with shown_progress("mining", len(traces) if shown else 0, "trace") as advance:
        result = tightest(names, values, wanted.parameter, judge, advance)
    return _mined(wanted, traces, values, result, notes)


def _values(wanted: Template, traces: list[Samples], tolerance: float | None) -> Candidates:
    """Return the values to try: multiples of the tolerance, or bounds at samples."""
    if wanted.unit is None:
        return values_between(wanted.low, wanted.high, tolerance)
    if tolerance is not None:
        raise InputError(
            "expected no ",
            Argument("tolerance"),
            f" for {wanted.parameter!r}, which bounds a time and is sought "
            "among the multiples of the period",
        )
    first = traces[0]
    for trace in traces:
        if trace.period != first.period:
            texts = [
                "none" if item.period is None else f"{text_of(item.period)} s"
                for item in (first, trace)
            ]
            raise InputError(
                f"{wanted.parameter!r} bounds a time, so that all traces need one period; "
                f"{first.name} has {texts[0]}, {trace.name} has {texts[1]}; give ",
                Argument("period"),
            )
    step = Fraction(1)
    if first.period is not None:
        unit = rtamt.Monitor("(true)", f"1{wanted.unit}").period
        step = first.period / (unit or 1)
    return bounds_between(wanted.low, wanted.high, step)


def _mined(
    wanted: Template,
    traces: list[Samples],
    values: Candidates,
    result: Tightest,
    notes: tuple[str, ...],
) -> Mined:
    spec = wanted.at(values.at(result.place))
    witnesses = tuple(
        Witness(traces[i].name, i, robustness, traces[i].source)
        for i, robustness in zip(result.failing, result.robustness, strict=True)
    )
    return Mined(
        wanted.text,
        wanted.parameter,
        float(values.at(result.place)),
        "least" if result.tighter < result.place else "greatest",
        float(values.at(result.tighter)),
        float(values.at(0)),
        float(values.at(values.last)),
        spec,
        len(traces),
        witnesses,
        traces[result.failing[0]].explain(spec),
        result.evaluations,
        result.probes,
        notes,
        _triggers(spec, traces),
    )


def _triggers(spec: rtamt.Specification, traces: list[Samples]) -> int | None:
    """Return how many traces trigger a requirement; None if it has no implication."""
    rows = [traces[0].judge(spec).triggers]
    if not rows[0]:
        return None
    rows += [trace.judge(spec).triggers for trace in traces[1:]]
    return sum(any(trigger.count for trigger in triggers) for triggers in rows)
