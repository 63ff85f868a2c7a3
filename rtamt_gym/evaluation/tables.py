"""Evaluations and comparisons for a terminal: a table with remarks below it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from rtamt_gym.evaluation.paired import Compared, Effect, effect_sentence, points
from rtamt_gym.play.summaries import failures
from rtamt_gym.results.intervals import promise, rate_interval
from rtamt_gym.results.provenance import reuse_lines
from rtamt_gym.results.statistics import RequirementResult, Statistic, columns_of
from rtamt_gym.results.trial import end_note, open_at_stop
from rtamt_gym.results.warnings import evidence_lines
from rtamt_gym.tables import Terminal, counted, p_text, short

_NAMED: Final = 3
"""The number of worst episodes that a table names."""

_OPTIONAL: Final = ("cvar", "least")
"""The columns that a table leaves out if it is too wide; the worst episodes are named below it."""

_NAME_WIDTH: Final = 11
"""The minimum width of the names of requirements."""


def evaluation_table(evaluation: Any, terminal: Terminal | None = None) -> str:  # noqa: ANN401 - an `Evaluation`, which imports this module
    """Return the table of an evaluation as text, by default plain text of 80 columns."""
    lines = _of_evaluation(evaluation, terminal or Terminal())
    return "\n".join([*lines, *evidence_lines(evaluation.record, "episode")])


def show(evaluation: Any) -> None:  # noqa: ANN401 - an `Evaluation`
    """Print the table of an evaluation, on a terminal with colours and in its full width.

    The command reports requirements that were never triggered by itself, at its end.
    """
    print(*_of_evaluation(evaluation, Terminal.present()), sep="\n")  # noqa: T201 - of the command line


def comparison_table(
    heads: Sequence[str],
    results: Sequence[Compared],
    returns: Effect | None,
    notes: Sequence[str],
) -> str:
    """Return the table of a comparison as plain text of 80 columns.

    Args:
        heads: The lines above the table.
        results: The requirements; for several, the last result is for all at once.
        returns: The difference of the returns.
        notes: The sentences below the table.
    """
    return "\n".join(_of_comparison(heads, results, returns, notes, Terminal()))


def _of_evaluation(evaluation: Any, terminal: Terminal) -> Iterator[str]:  # noqa: ANN401
    results = list(evaluation.requirements.values())
    if len(results) > 1:
        results.append(evaluation.success)
    seeds = [row.seed for row in evaluation.record if row.seed is not None]
    yield from map(terminal.cut, _heading(evaluation))
    yield terminal.cut(
        f"{counted(len(evaluation.record), 'episode')}"
        + (f", seeds {min(seeds)} to {max(seeds)}" if seeds else "")
    )
    yield ""
    columns = columns_of(results, rates=True)
    for optional in _OPTIONAL:
        if _width(columns, results) + _NAME_WIDTH > terminal.width:
            columns = [column for column in columns if column.key != optional]
    # The name for all at once is short, so that it is never cut.
    names = ["all" if result is evaluation.success else result.name for result in results]
    rows = [
        [name, *(column.cell(value) for column in columns)]
        for name, value in zip(names, results, strict=True)
    ]
    head = ["requirement", *(column.heading for column in columns)]
    yield from terminal.table([head, *rows], "<" + ">" * len(columns))
    stopped = {i for name in evaluation.requirements for i in open_at_stop(evaluation.record, name)}
    at_stop = f" (at the stop in {counted(len(stopped), 'open episode')})" if stopped else ""
    of_robustness = ", ".join(column.heading for column in columns if column.robustness)
    yield terminal.cut(f"{of_robustness}: of the robustness{at_stop}")
    yield terminal.cut(f"95% interval: {promise(evaluation.interval)}")
    yield from map(terminal.cut, end_note(evaluation.record))
    yield ""
    for value in evaluation.requirements.values():
        name = evaluation.record.provenance.called(value.name)
        yield terminal.cut(f"{name}: {value.formula}")
    yield ""
    unit = "s" if evaluation.period is not None else "steps"
    lines = [line for value in evaluation.requirements.values() for line in _worst(value, unit)]
    yield from map(terminal.cut, (*lines, _around(evaluation)))
    if evaluation.reported is not None:
        count, total = evaluation.reported
        low, high = (100 * end for end in rate_interval(count, total, evaluation.interval))
        yield from terminal.wrapped(
            f"is_success of the environment itself: {100 * count / total:.1f}% of "
            f"{counted(total, 'episode')}, 95% interval {low:.1f} to {high:.1f}"
        )
    if evaluation.repeats is False:
        yield from terminal.wrapped(_unrepeated(evaluation))
    if evaluation.decision is not None:
        yield ""
        for name, decision in evaluation.decision.items():
            yield from terminal.wrapped(f"{name}: {decision}", _style(decision))
    if lines := failures(evaluation.record):
        yield ""
        yield from (line for item in lines for line in terminal.wrapped(item, "red"))
    reused = reuse_lines(evaluation.record.provenance, "episode")
    yield from ["", *reused] if reused else []


def _unrepeated(evaluation: Any) -> str:  # noqa: ANN401
    """Return why a seed does not repeat an episode."""
    if evaluation.differing:
        return (
            f"note: episode {evaluation.differing[0]} differed when it was played again: the same "
            "call may give other numbers"
        )
    return (
        "note: two resets with one seed begin differently: the same call plays other episodes, and "
        "none is played again"
    )


def _heading(evaluation: Any) -> list[str]:  # noqa: ANN401
    lines = [f"{evaluation.system} under {evaluation.policy}"]
    if evaluation.interrupted is not None:
        planned = counted(evaluation.interrupted, "episode")
        lines.append(f"interrupted after {len(evaluation.record)} of {planned}")
    return lines


def _width(columns: Sequence[Statistic], results: Sequence[RequirementResult]) -> int:
    """Return the widths of the columns next to the names."""
    return sum(
        2 + max(len(column.heading), *(len(column.cell(result)) for result in results))
        for column in columns
    )


def _worst(result: RequirementResult, unit: str) -> Iterator[str]:
    """Yield the worst episodes of a requirement, and when it is violated."""
    if result.satisfied == result.episodes or not result.worst:
        return
    worst = ", ".join(f"{seed} ({short(height)})" for seed, height in result.worst[:_NAMED])
    yield f"worst seeds of {result.name}: {worst}"
    times = result.first_violations[~np.isnan(result.first_violations)]
    if times.size:
        first, last = short(float(times.min())), short(float(times.max()))
        if first == last:
            yield f"  violated at {first} {unit}"
            return
        half = short(float(np.median(times)))
        yield f"  violated from {first} {unit} to {last} {unit}, half of them by {half} {unit}"


def _around(evaluation: Any) -> str:  # noqa: ANN401
    """Return a line with the returns, the lengths, and the time that stopping saved."""
    unit = "s" if evaluation.period is not None else "steps"
    parts = [f"length {short(float(np.mean(evaluation.lengths)))} {unit} on average"]
    known = evaluation.returns[~np.isnan(evaluation.returns)]
    if known.size:
        parts.insert(0, f"return {short(float(np.mean(known)))} on average")
    if saved := max(value.saved for value in evaluation.requirements.values()):
        parts.append(f"{short(saved)} {unit} saved by stopping")
    return ", ".join(parts)


def _style(decision: str) -> str:
    for start, style in (("meets", "green"), ("falls short", "red"), ("undecided", "yellow")):
        if decision.startswith(start):
            return style
    return ""


def _of_comparison(
    heads: Sequence[str],
    results: Sequence[Compared],
    returns: Effect | None,
    notes: Sequence[str],
    terminal: Terminal,
) -> Iterator[str]:
    yield from map(terminal.cut, heads)
    yield ""
    names = ["requirement", "A", "B", "B - A", "95%", "p", "robustness", "95%"]
    rows = [[result.name, *_cells(result)] for result in results]
    yield from terminal.table([names, *rows], "<" + ">" * 7)
    for result in results:
        yield ""
        yield from terminal.wrapped(result.sentence)
    below = [] if returns is None else [effect_sentence(returns, "the return")]
    if len(results) > 1:
        below.append(
            f"p: McNemar's exact test, adjusted by Holm's method for {len(results) - 1} "
            "requirements, but of all at once; intervals are of each alone."
        )
    below += [f"note: {note}" for note in notes]
    yield from [""] if below else []
    for text in below:
        yield from terminal.wrapped(text)


def _cells(compared: Compared) -> list[str]:
    """Return the cells of a requirement."""
    pairs = compared.pairs
    rates = (f"{points(rate, pairs)}%" for rate in (compared.rate_a, compared.rate_b))
    gap, *ends = (
        _signed(points(item, pairs)) for item in (compared.difference, *compared.interval)
    )
    p = p_text(compared.adjusted).removeprefix("p ").removeprefix("= ").replace(" ", "")
    return [*rates, gap, " to ".join(ends), p, *_effect(compared.robustness)]


def _effect(effect: Effect | None) -> tuple[str, str]:
    """Return the cells of an effect: the difference, and its interval."""
    if effect is None:
        return "-", "-"
    low, high = effect.interval
    known = math.isfinite(low) or math.isfinite(high)
    ends = f"{_signed(short(low, 2))} to {_signed(short(high, 2))}" if known else "-"
    return _signed(short(effect.value, 2)), ends


def _signed(text: str) -> str:
    return text if text.startswith("-") or float(text) == 0 else f"+{text}"
