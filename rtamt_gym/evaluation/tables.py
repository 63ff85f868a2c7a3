"""Evaluations and comparisons for a terminal: a table, and below it what it cannot say."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.evaluation.compared import Compared
from rtamt_gym.evaluation.paired import Effect
from rtamt_gym.evaluation.sentences import effect_sentence, p_text, points, short
from rtamt_gym.search.runs.report import failures
from rtamt_gym.search.runs.rows import open_at_stop
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rich.text import Text

__all__ = ["comparison_table", "evaluation_table", "show"]

_WIDTH: Final = 80

_NAMED: Final = 3
"""How many of the worst episodes are named."""


def evaluation_table(evaluation: Any) -> str:  # noqa: ANN401 - an `Evaluation`, which prints itself so
    """The table of an evaluation as plain text of 80 columns."""
    return _plain(_of_evaluation(evaluation))


def show(evaluation: Any) -> None:  # noqa: ANN401 - an `Evaluation`
    """Prints the table of an evaluation: on a terminal with colours, and as wide as it is."""
    plain = evaluation_table(evaluation)
    from rich.console import Console

    console = Console(markup=False, highlight=False, emoji=False)
    if console.is_terminal:
        _print(console, _of_evaluation(evaluation))
    else:
        print(plain)  # noqa: T201 - of the command line


def comparison_table(
    heads: Sequence[str],
    results: Sequence[Compared],
    returns: Effect | None,
    notes: Sequence[str],
) -> str:
    """The table of a comparison as plain text of 80 columns.

    Args:
        heads: The lines above the table.
        results: The requirements; of several the last is all at once.
        returns: The difference of the returns.
        notes: The lines below, which are sentences.
    """
    return _plain(_of_comparison(heads, results, returns, notes))


Part = Any  # a Text or a Table of rich
Parts = Iterator[Part]


def _plain(parts: Parts) -> str:
    try:
        from rich.console import Console
    except ModuleNotFoundError as error:
        raise naming_extra(error, "the table of an evaluation") from error
    file = io.StringIO()
    _print(Console(file=file, width=_WIDTH, color_system=None, markup=False, emoji=False), parts)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def _print(console: Any, parts: Parts) -> None:  # noqa: ANN401 - a Console of rich
    for part in parts:
        cut = getattr(part, "no_wrap", None)
        console.print(part, highlight=False, no_wrap=cut, overflow="ellipsis" if cut else None)


def _of_evaluation(evaluation: Any) -> Parts:  # noqa: ANN401
    results = list(evaluation.requirements.values())
    if len(results) > 1:
        results.append(evaluation.success)
    seeds = [row.seed for row in evaluation.record if row.seed is not None]
    yield _line(f"{evaluation.system} under {evaluation.policy}")
    yield _line(
        f"{counted(len(evaluation.record), 'episode')}"
        + (f", seeds {min(seeds)} to {max(seeds)}" if seeds else "")
    )
    yield ""
    columns: list[tuple[str, Callable[[Any], str], str]] = [
        ("satisfied", lambda of: f"{of.rate:.1%}", ""),
        ("95% interval", lambda of: _percents(of.interval), ""),
        ("violated", lambda of: str(of.violated), "red"),
        ("open", lambda of: str(of.undecided), "yellow"),
        ("failed", lambda of: str(of.failed), "red"),
        ("least", lambda of: short(float(np.nanmin(of.robustness))) if of.worst else "-", ""),
        ("median", lambda of: short(of.quantiles[0.5]) if of.worst else "-", ""),
    ]
    left_out = {
        name
        for name, count in (("open", "undecided"), ("failed", "failed"))
        if not any(getattr(each, count) for each in results)
    }
    shown = [column for column in columns if column[0] not in left_out]
    yield _table(
        [name for name, _, _ in shown],
        [
            # The name of all at once is short, so that it is never cut.
            (
                "all" if each is evaluation.success else each.name,
                [_cell(cell(each), style) for _, cell, style in shown],
            )
            for each in results
        ],
    )
    stopped = {i for name in evaluation.requirements for i in open_at_stop(evaluation.record, name)}
    at_stop = f" (at the stop in {counted(len(stopped), 'open episode')})" if stopped else ""
    yield _line(f"least, median: of the robustness{at_stop}")
    yield ""
    for each in evaluation.requirements.values():
        yield _line(f"{each.name}: {each.formula}")
    yield ""
    for each in evaluation.requirements.values():
        yield from _worst(each, "s" if evaluation.period is not None else "steps")
    yield from _around(evaluation)
    if evaluation.decision is not None:
        yield ""
        for name, decision in evaluation.decision.items():
            yield _text(f"{name}: {decision}", _style(decision))
    if lines := failures(evaluation.record):
        yield ""
        yield from (_text(line, "red") for line in lines)


def _worst(result: Any, unit: str) -> Parts:  # noqa: ANN401 - a `RequirementResult`
    """The worst episodes of a requirement that is not satisfied in all, and when it is violated."""
    if result.satisfied == result.episodes or not result.worst:
        return
    worst = ", ".join(f"{seed} ({short(height)})" for seed, height in result.worst[:_NAMED])
    yield _line(f"worst seeds of {result.name}: {worst}")
    times = result.first_violations[~np.isnan(result.first_violations)]
    if times.size:
        least, most = short(float(times.min())), short(float(times.max()))
        if least == most:
            yield _line(f"  violated at {least} {unit}")
            return
        half = short(float(np.median(times)))
        yield _line(
            f"  violated from {least} {unit} to {most} {unit}, half of them by {half} {unit}"
        )


def _around(evaluation: Any) -> Parts:  # noqa: ANN401
    """The returns, the lengths, and what stopping has saved."""
    unit = "s" if evaluation.period is not None else "steps"
    parts = [f"length {short(float(np.mean(evaluation.lengths)))} {unit} on average"]
    known = evaluation.returns[~np.isnan(evaluation.returns)]
    if known.size:
        parts.insert(0, f"return {short(float(np.mean(known)))} on average")
    if saved := max(each.saved for each in evaluation.requirements.values()):
        parts.append(f"{short(saved)} {unit} saved by stopping")
    yield _line(", ".join(parts))


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
) -> Parts:
    yield from map(_line, heads)
    yield ""
    names = ["A", "B", "B - A", "95%", "p", "robustness", "95%"]
    yield _table(names, [(each.name, _cells(each)) for each in results])
    for each in results:
        yield ""
        yield _text(each.sentence)
    if returns is not None or len(results) > 1 or notes:
        yield ""
    if returns is not None:
        yield _text(effect_sentence(returns, "the return"))
    if len(results) > 1:
        yield _text(
            f"p: McNemar's exact test, adjusted by Holm's method for {len(results) - 1} "
            "requirements, but of all at once; intervals are of each alone."
        )
    for note in notes:
        yield _text(f"note: {note}")


def _cells(compared: Compared) -> list[Text]:
    """The cells of a requirement."""
    pairs = compared.pairs
    rates = (f"{points(rate, pairs)}%" for rate in (compared.rate_a, compared.rate_b))
    gap, *ends = (
        _signed(points(each, pairs)) for each in (compared.difference, *compared.interval)
    )
    p = p_text(compared.adjusted).removeprefix("p ").removeprefix("= ").replace(" ", "")
    texts = map(_text, (*rates, gap, " to ".join(ends), p))
    return [*texts, *_effect(compared.robustness)]


def _effect(effect: Effect | None) -> list[Text]:
    """The cells of an effect: the difference, and its interval."""
    if effect is None:
        return [_text("-"), _text("-")]
    low, high = effect.interval
    known = math.isfinite(low) or math.isfinite(high)
    ends = f"{_signed(short(low, 2))} to {_signed(short(high, 2))}" if known else "-"
    return [_text(_signed(short(effect.value, 2))), _text(ends)]


def _signed(text: str) -> str:
    return text if text.startswith("-") or float(text) == 0 else f"+{text}"


def _cell(text: str, style: str) -> Text:
    return _text(text, "" if text == "0" else style)


def _percents(interval: tuple[float, float]) -> str:
    return " to ".join(f"{100 * end:.1f}" for end in interval)


def _table(head: Sequence[str], rows: Sequence[tuple[str, Sequence[Text]]]) -> Part:
    """A table whose first column has names, which are shortened where the others need the room."""
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    table.add_column("requirement", overflow="ellipsis", min_width=6)
    for name in head:
        table.add_column(name, justify="right", no_wrap=True)
    for name, cells in rows:
        table.add_row(_line(name), *cells)
    return table


def _text(text: str, style: str = "") -> Text:
    """A text that is wrapped at the width of the terminal."""
    from rich.text import Text

    return Text(text, style=style)


def _line(text: str) -> Text:
    """A text that is cut at the width of the terminal."""
    from rich.text import Text

    return Text(text, no_wrap=True, overflow="ellipsis")
