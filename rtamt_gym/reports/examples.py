"""Examples of requirements on the page: small drawings of traces that satisfy and violate them."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Final, NamedTuple, cast

import rtamt
from rtamt import Formula, InputError, Term, Verdict
from rtamt.checking import Example, ExampleTrace, RequirementExamples
from rtamt.errors import Argument
from rtamt_gym.checks.names import listing
from rtamt_gym.reports.model import Band, Requirement, Section, ShownExample, numbers_table
from rtamt_gym.reports.numbers import aligned, number
from rtamt_gym.results.codec import fraction_of, number_of, read_as
from rtamt_gym.tables import counted, shorten

ExamplesLike = Mapping[str, RequirementExamples] | str | os.PathLike[str]
"""The result of `rtamt.examples`, or the path of a file of ``rtamt examples --json``."""

_EACH: Final = 3
"""The maximum number of examples of a verdict."""

_WIDTH, _HEIGHT = 100.0, 36.0
"""The size of the drawing of a signal, which the page stretches."""

_DOTS: Final = 40
"""The maximum number of samples with a mark for each."""

_BANDS: Final = 4
"""The maximum number of variables that are all drawn; of more, only those that change."""


class _Known(NamedTuple):
    """The examples of a requirement."""

    name: str
    formula: Formula
    period: Fraction | None
    examples: Sequence[Example]


def with_examples(
    sections: Sequence[Section], several: Iterable[ExamplesLike]
) -> tuple[Section, ...]:
    """Return the sections with examples next to their requirements.

    Examples belong to a requirement with the same formula, under any name.
    """
    shown = [requirement for section in sections for requirement in section.requirements]
    texts = {item.formula for item in shown if item.formula}
    formulas = {text: rtamt.parse(text).formula for text in texts}
    known: dict[Formula, _Known] = {}
    for source in several:
        examples = [*_read(source)]
        if not {item.formula for item in examples} & {*formulas.values()}:
            raise InputError(_of_others(source, examples, shown))
        for item in examples:
            known.setdefault(item.formula, item)

    def shown_with(requirement: Requirement) -> Requirement:
        result = known.get(formulas[requirement.formula]) if requirement.formula else None
        if result is None or not result.examples:
            return requirement
        chosen = _chosen(result.examples)
        drawn = tuple(_shown(item, result) for item in chosen)
        more = len(result.examples) - len(chosen)
        return replace(requirement, examples=drawn, more_examples=more)

    return tuple(
        replace(section, requirements=tuple(map(shown_with, section.requirements)))
        for section in sections
    )


def _of_others(
    source: ExamplesLike,
    examples: Sequence[_Known],
    shown: Sequence[Requirement],
) -> str:
    """Return the error for examples of requirements that the page does not show."""
    where = os.fspath(source) if isinstance(source, str | os.PathLike) else "the examples"
    ours = {item.name: item.formula for item in shown}
    for item in examples:
        if item.name in ours:
            return (
                f"{where}: {item.name} is {shorten(str(item.formula), 200)} there, and "
                f"{shorten(ours[item.name], 200)} in the results; make the examples of these"
            )
    names = listing(item.name for item in examples)
    return f"{where}: examples of {names}, and none of {listing(ours)}, which the results have"


def _read(source: ExamplesLike) -> Iterator[_Known]:
    """Yield the examples of each requirement."""
    if isinstance(source, Mapping):
        for name, result in source.items():
            if not isinstance(result, RequirementExamples):
                raise InputError(
                    Argument("examples"),
                    f": expected the result of rtamt.examples, got {type(result).__name__}",
                )
            formula = rtamt.parse(result.text).formula
            yield _Known(name, formula, result.period, result.examples)
        return
    yield from read_as(source, "examples", _from_saved)


def _from_saved(stored: Mapping[str, Any]) -> list[_Known]:
    period = fraction_of(stored["period"])
    return [
        _Known(
            name,
            rtamt.parse(text).formula,
            period,
            [_example(item) for item in stored["results"][name]["examples"]],
        )
        for name, text in stored["requirements"].items()
    ]


def _example(stored: Mapping[str, Any]) -> Example:
    trace = stored["trace"]
    columns = {
        name: tuple(cast("float", number_of(value)) for value in values)
        for name, values in trace["columns"].items()
    }
    return Example(
        tuple(stored["kinds"]),
        stored["why"],
        Verdict[stored["verdict"]],
        number_of(stored["robustness"]),
        ExampleTrace(columns, trace["samples"], trace["repeats"]),
    )


def _chosen(examples: Sequence[Example]) -> list[Example]:
    """Return the examples that are shown, in their order: some of each verdict."""
    left = {Verdict.SATISFIED: _EACH, Verdict.VIOLATED: _EACH}
    chosen = []
    for example in examples:
        if left[example.verdict]:
            left[example.verdict] -= 1
            chosen.append(example)
    return chosen


def _shown(example: Example, of: _Known) -> ShownExample:
    trace = example.trace
    steady = {name: values[0] for name, values in trace.columns.items() if len({*values}) == 1}
    drawn = [name for name in trace.columns if name not in steady]
    if len(trace.columns) <= _BANDS:
        drawn, steady = [*trace.columns], {}
    levels = _levels(of.formula)
    length = counted(trace.samples, "sample")
    if of.period is not None:
        length = f"{number(float(trace.samples * of.period))} s"
    return ShownExample(
        verdict="satisfied" if example.verdict is Verdict.SATISFIED else "violated",
        robustness=example.robustness,
        why=example.why,
        length=length,
        bands=tuple(_band(name, trace.columns[name], levels.get(name, ())) for name in drawn),
        repeats=trace.loop / trace.samples * _WIDTH,
        loop=counted(trace.loop, "sample") if trace.loop else "",
        steady=", ".join(f"{name} = {number(value)}" for name, value in steady.items()),
        table=numbers_table(
            ("sample", *trace.columns), tuple(_rows(trace)), label="Samples of the example"
        ),
    )


def _rows(trace: ExampleTrace) -> Iterator[tuple[str, ...]]:
    """Return a row for each run of equal samples."""
    samples = [*zip(*trace.columns.values(), strict=True)]
    runs = [(values, len([*run])) for values, run in itertools.groupby(samples)]
    columns = [aligned(column) for column in zip(*(values for values, _ in runs), strict=True)]
    begin = 0
    for index, (_, count) in enumerate(runs):
        end = begin + count - 1
        span = str(begin) if count == 1 else f"{begin} to {end}"
        yield (span, *(column[index] for column in columns))
        begin = end + 1


def _band(name: str, values: Sequence[float], levels: Sequence[float]) -> Band:
    """Return a signal drawn in steps; the top is at 0."""
    finite = [value for value in (*values, *levels) if math.isfinite(value)] or [0.0]
    low, high = min(finite), max(finite)
    if low == high:
        low, high = low - 1.0, high + 1.0

    def down(value: float) -> str:
        share = (min(max(value, low), high) - low) / (high - low)
        return f"{_HEIGHT * (1 - share):.3g}"

    count, begin, line = len(values), 0, ""
    dots = ""
    for value, run in itertools.groupby(values):
        end = begin + len([*run])
        x, y = f"{_WIDTH * begin / count:.4g}", down(value)
        line += f"V{y}" if line else f"M{x} {y}"
        line += f"H{_WIDTH * end / count:.4g}"
        if count <= _DOTS:
            places = (_WIDTH * i / count for i in range(begin, end))
            dots += "".join(f"M{position:.4g} {y}h0" for position in places)
        begin = end
    return Band(
        name,
        line,
        dots,
        tuple(f"M0 {down(level)}H{_WIDTH:g}" for level in levels),
        ", ".join(map(number, levels)),
        number(low),
        number(high),
    )


def _levels(formula: Formula) -> dict[str, tuple[float, ...]]:
    """Return the numbers that each variable is compared with."""
    result: dict[str, dict[float, None]] = {}
    for node in formula.nodes():
        if node.op is None or node.op.notation != "infix" or node.op.result == "term":
            continue
        left, right, *_ = node.args
        for side, other in ((left, right), (right, left)):
            if not isinstance(side, Term) or not isinstance(other.leaf, float):
                continue
            name, signs = _compared(side)
            for sign in signs:
                result.setdefault(name, {})[sign * other.leaf + 0.0] = None
    return {name: tuple(levels) for name, levels in result.items()}


def _compared(side: Term) -> tuple[str, tuple[float, ...]]:
    """Return the variable of one side, and the signs that it may have."""
    if side.op is not None and side.op.name == "abs":
        name, _ = _compared(cast("Term", side.args[0]))
        return name, (1.0, -1.0) if name else ()
    if side.op is None and isinstance(side.leaf, str):
        return side.leaf, (1.0,)
    return "", ()
