"""`Matrix`: recorded traces under requirements, and its table for a terminal of 80 columns.

`RESULTS` and `IDENTITY` name the files in a folder of ``rtamt monitor --results``.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Final, get_args

from rtamt import Verdict
from rtamt_gym.results.extent import gap_summary, length_text
from rtamt_gym.results.outcome import Failure, Outcome, Word, order, word
from rtamt_gym.results.provenance import ids_lines
from rtamt_gym.results.statistics import Results
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import trigger_line, triggered_in
from rtamt_gym.tables import counted, number, shorten, table

RESULTS: Final = "results.parquet"
"""The file of all rows, written at the end of a run."""

IDENTITY: Final = "recordings.json"
"""The specification and the options of the rows."""


_WIDTH = 80

_MOST_ROWS, _WORST = 10_000, 100
"""The most traces that a table shows, and the number that it shows of more traces."""

LEGEND = "numbers are robustness; V: violated, U: undecided, E: error, otherwise satisfied"
"""The meaning of the cells of the table."""


class Matrix(Results):
    """Recorded traces under requirements, a row for each trace, at least one."""

    def counts(self) -> dict[Word, int]:
        """Return the number of outcomes with each word, including 0."""
        words = [word(row.cell(name)) for row in self.rows for name in self.requirements]
        return {item: words.count(item) for item in get_args(Word)}

    @property
    def word(self) -> Word:
        """The worst of all verdicts, as a word."""
        return next(value for value, count in self.counts().items() if count)

    def shorter(self, minimum: Fraction) -> list[str]:
        """Return the traces that are shorter than ``minimum`` seconds."""
        extents = {row.name: row.judged_extent for row in self.rows}
        return [name for name, extent in extents.items() if extent and extent.shorter(minimum)]

    def failures(self) -> dict[str, tuple[Failure, list[str]]]:
        """Return the error and its traces for each message of an error."""
        result: dict[str, tuple[Failure, list[str]]] = {}
        for row in self.rows:
            for failure in row.failures.values():
                _, traces = result.setdefault(failure.message, (failure, []))
                if row.name not in traces[-1:]:
                    traces.append(row.name)
        return result

    def worst_requirement(self) -> tuple[str, str] | None:
        """Return the name of the requirement that most traces violate, and why; None without one.

        At a tie, it names the requirement that most traces leave undecided, then the requirement
        with the smallest robustness, then the first.
        """
        columns = {
            name: {row.name: row.outcomes[name] for row in self.rows if name in row.outcomes}
            for name in self.requirements
        }
        return _worst(columns, "{word} in {count} of {total}", "trace", "in")

    def worst_trace(self) -> tuple[str, str] | None:
        """Return the name of the trace that violates most requirements, and why; None without one.

        At a tie, it names the trace that leaves most requirements undecided, then the trace with
        the smallest robustness.
        """
        rows = {row.name: row.outcomes for row in self.rows}
        return _worst(rows, "{count} of {total} {word}", "requirement", "of")


def _worst(
    lines: Mapping[str, Mapping[str, Outcome]], template: str, noun: str, preposition: str
) -> tuple[str, str] | None:
    """Return the worst row or column and why, with the template for counts of verdicts."""

    def badness(name: str) -> tuple[int, int, float]:
        verdicts = [outcome.verdict for outcome in lines[name].values()]
        lowest = min(outcome.robustness for outcome in lines[name].values())
        return verdicts.count(Verdict.VIOLATED), verdicts.count(Verdict.UNDECIDED), -lowest

    name = max(filter(lines.get, lines), key=badness, default=None)
    if name is None:
        return None
    violated, undecided, _ = badness(name)
    outcomes, total = lines[name], counted(len(lines[name]), noun)
    counts = {"violated": violated, "undecided": undecided}
    words = [
        template.format(word=word, count=count, total=total)
        for word, count in counts.items()
        if count
    ]
    least = min(outcomes, key=lambda other: order(outcomes[other].robustness))
    words.append(f"minimum {number(outcomes[least].robustness + 0.0)} {preposition} {least}")
    return name, ", ".join(words)


def label(value: Word) -> str:
    """Return the word of the table: the name of a verdict, or ``"ERROR"``."""
    return "ERROR" if value == "failed" else value.upper()


def worst_traces(matrix: Matrix) -> tuple[Matrix, str]:
    """Return the traces that a table shows: the 100 worst of more than 10,000, with a note.

    An error is worse than a violation, and a verdict is worse with less robustness. The note is
    empty if the table shows all traces.
    """
    if len(matrix.rows) <= _MOST_ROWS:
        return matrix, ""

    def badness(row: Trial) -> tuple[int, tuple[float, float]]:
        values = [order(outcome.robustness) for outcome in row.outcomes.values()]
        return words.index(row.word), min(values, default=(-math.inf, 0.0))

    words = get_args(Word)
    rows = sorted(matrix.rows, key=badness)[:_WORST]
    worst = Matrix(rows, matrix.requirements, matrix.system, matrix.provenance)
    return worst, f"the table shows the {_WORST} worst of {len(matrix.rows)} traces"


def matrix_lines(matrix: Matrix) -> list[str]:
    """Return a table with a row for each trace, and the worst and open requirements in words.

    Requirements that do not fit next to each other follow in further tables. For more than 10,000
    traces, the table shows the 100 worst.
    """
    few, note = worst_traces(matrix)
    names = ["trace", *(_cut(row.name, 36) for row in few.rows)]
    words = ["verdict", *(label(row.word) for row in few.rows)]
    marked = _on_defaults(few)
    columns = [_column(few, name, on_defaults=marked) for name in matrix.requirements]
    lines = []
    for head, part in _blocks([names, *_lengths(few), words], columns):
        align = "<" * len(head) + ">" * len(part)
        if len(head) > 1:
            align = "<" + ">" * (len(head) - 2) + "<" + ">" * len(part)
        lines += [*table(list(zip(*head, *part, strict=True)), align), ""]
    for text in (legend(matrix), *filter(None, [note]), *summary(matrix)):
        lines += textwrap.wrap(text, _WIDTH, subsequent_indent="    ", break_on_hyphens=False)
    lines += ids_lines(matrix.provenance)
    return lines + [line for name in matrix.requirements for line in _open(matrix, name)]


def _column(matrix: Matrix, name: str, *, on_defaults: bool) -> list[str]:
    """Return the head and the cells of a requirement, with a column of triggers if it has any."""
    cells = [cell_text(row.cell(name), on_defaults=on_defaults) for row in matrix.rows]
    column = [f"{shorten(name, 16)}  {' ' * on_defaults}", *cells]
    if triggered_in(matrix, name) is None:
        return column
    triggers = ["triggers", *(times_text(row.cell(name)) for row in matrix.rows)]
    width, other = max(map(len, column)), max(map(len, triggers))
    return [f"{a:>{width}}{b:>{other}}" for a, b in zip(column, triggers, strict=True)]


def _lengths(matrix: Matrix) -> list[list[str]]:
    """Return the columns of lengths and periods of the traces, if they have cells."""
    extents = [row.extent for row in matrix.rows]
    lengths = [length_text(item.length if item else None) for item in extents]
    periods = [length_text(item.period if item else None) for item in extents]
    columns = {"length": lengths, "period": periods}
    return [[head, *cells] for head, cells in columns.items() if any(cells)]


def summary(matrix: Matrix) -> Iterator[str]:
    """Yield the counts of outcomes, the worst requirement and trace, and notes on the files."""
    counts = [
        counted(count, "error") if value == "failed" else f"{count} {value}"
        for value, count in matrix.counts().items()
        if count
    ]
    traces = counted(len(matrix.rows), "trace")
    yield f"{traces}, {counted(len(matrix.requirements), 'requirement')}: {', '.join(counts)}"
    for phrase, worst in (
        ("requirement", matrix.worst_requirement()),
        ("trace", matrix.worst_trace()),
    ):
        if worst:
            yield f"worst {phrase}: {worst[0]}, {worst[1]}"
    if triggers := trigger_line(matrix):
        yield triggers
    if gaps := gap_summary({row.name: row.extent for row in matrix.rows if row.extent}):
        yield gaps
    yield from _notes(matrix)


def note_lines(matrix: Matrix) -> list[str]:
    """Return the notes on the files, in lines for a terminal."""
    return [line for note in _notes(matrix) for line in indented(note, "")]


def _notes(matrix: Matrix) -> Iterator[str]:
    """Yield the notes on the files; a note that many traces share is shown for the first."""
    noted: dict[str, list[tuple[str, str]]] = {}
    for row in matrix.rows:
        for note in row.notes:
            noted.setdefault(_shape(note, row.name), []).append((row.name, note))
    for (name, note), *others in noted.values():
        on = f" on {name}{_more(1 + len(others))}" if len(matrix.rows) > 1 else ""
        yield f"note{on}: {note}"


def _shape(note: str, trace: str) -> str:
    """Return a note without numbers and the name of its trace, so that equal notes are one."""
    return re.sub(r"[\d.]+(?:e[+-]?\d+)?", "", note.replace(trace, ""))


def legend(matrix: Matrix) -> str:
    """Return the meaning of the cells of the table."""
    return f"{LEGEND}; d: rests on a default" if _on_defaults(matrix) else LEGEND


def _on_defaults(matrix: Matrix) -> bool:
    return any(outcome.defaults for row in matrix.rows for outcome in row.outcomes.values())


def cell_text(cell: Outcome | Failure, *, on_defaults: bool = False) -> str:
    """Return a robustness with the letter of its verdict, a blank for satisfied."""
    if isinstance(cell, Failure):
        return "E"
    letter = {Verdict.VIOLATED: "V", Verdict.UNDECIDED: "U"}.get(cell.verdict, " ")
    mark = "d" if cell.defaults else " " * on_defaults
    return f"{cell.robustness + 0.0:.4g} {letter}{mark}"


def times_text(cell: Outcome | Failure) -> str:
    """Return the number of triggers, as in ``12x``; empty without an implication."""
    times = None if isinstance(cell, Failure) else cell.trigger_count
    return "" if times is None else f"{times}x"


def _blocks(
    first: list[list[str]], columns: Sequence[list[str]]
) -> Iterator[tuple[list[list[str]], list[list[str]]]]:
    """Yield the columns that fit next to the names, the first with lengths and verdicts."""
    names, head, part = first[0], first, list[list[str]]()
    room = _WIDTH + 2 - sum(2 + max(map(len, column)) for column in head)
    for column in columns:
        width = 2 + max(map(len, column))
        if part and width > room:
            yield head, part
            head, part = [names], []
            room = _WIDTH - max(map(len, names))
        part.append(column)
        room -= width
    yield head, part


def _open(matrix: Matrix, name: str) -> list[str]:
    """Return why a requirement is undecided, at the first trace that leaves it undecided."""
    result = [
        (row.name, cell)
        for row in matrix.rows
        if isinstance(cell := row.cell(name), Outcome) and cell.verdict == Verdict.UNDECIDED
    ]
    if not result:
        return []
    trace, cell = result[0]
    parts = f"{name} is undecided in {trace}{_more(len(result))}"
    head = textwrap.wrap(parts, _WIDTH, subsequent_indent="    ")
    return ["", *head, *undecided_lines(cell.not_recorded, cell.way_out)]


def _more(count: int) -> str:
    return f" and {count - 1} more" if count > 1 else ""


def _cut(text: str, width: int) -> str:
    """Cut a text to a width, with three dots at the start."""
    return text if len(text) <= width else "..." + text[3 - width :]


def undecided_lines(not_recorded: Iterable[str], way_out: str) -> list[str]:
    """Return why a verdict is undecided, indented; no line if it is decided."""
    return [line for text in (*not_recorded, way_out) for line in indented(text, "    ")]


def indented(text: str, indent: str) -> list[str]:
    """Return a text in at most four indented lines."""
    return textwrap.wrap(
        text,
        width=80,
        initial_indent=indent,
        subsequent_indent=f"{indent}  ",
        break_on_hyphens=False,
        max_lines=4,
        placeholder=" ...",
    )
