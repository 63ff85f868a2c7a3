"""The table of many recorded traces and requirements, for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from rtamt import Verdict
from rtamt_gym.recorded.outcome import ERROR, Failure, Matrix, Outcome
from rtamt_gym.recorded.report import undecided_lines
from rtamt_gym.tables import counted, shorten, table

__all__ = ["LEGEND", "cell_text", "matrix_lines", "summary"]

_WIDTH = 80

LEGEND = "numbers are robustness; V: violated, U: undecided, E: error, else satisfied"
"""What the cells of the table say."""


def matrix_lines(matrix: Matrix) -> list[str]:
    """Writes a table with a row for each trace, and in words what is worst and what is open.

    Requirements that do not fit beside each other stand in further tables below.
    """
    names = ["trace", *(_cut(row.trace, 36) for row in matrix.rows)]
    words = ["verdict", *(row.word for row in matrix.rows)]
    columns = [
        [f"{shorten(name, 16)}  ", *(cell_text(row.cells[name]) for row in matrix.rows)]
        for name in matrix.formulas
    ]
    lines = []
    for head, part in _blocks(names, words, columns):
        align = "<" * len(head) + ">" * len(part)
        lines += [*table(list(zip(*head, *part, strict=True)), align), ""]
    wrapped = (textwrap.wrap(text, _WIDTH, subsequent_indent="    ") for text in summary(matrix))
    lines += [LEGEND, *(line for text in wrapped for line in text)]
    return lines + [line for name in matrix.formulas for line in _open(matrix, name)]


def summary(matrix: Matrix) -> Iterator[str]:
    """Counts the outcomes in words, names what is worst, and says if traces were read otherwise."""
    counts = [
        counted(count, "error") if word == ERROR else f"{count} {word.lower()}"
        for word, count in matrix.counts().items()
        if count
    ]
    traces = counted(len(matrix.rows), "trace")
    yield f"{traces}, {counted(len(matrix.formulas), 'requirement')}: {', '.join(counts)}"
    for what, worst in (
        ("requirement", matrix.worst_requirement()),
        ("trace", matrix.worst_trace()),
    ):
        if worst:
            yield f"worst {what}: {worst[0]}, {worst[1]}"
    noted = [row for row in matrix.rows if row.notes]
    if noted:
        yield f"note on {noted[0].trace}{_more(len(noted))}: {'; '.join(noted[0].notes)}"


def cell_text(cell: Outcome | Failure) -> str:
    """A robustness with the letter of its verdict, which is a blank if that is satisfied."""
    if isinstance(cell, Failure):
        return "E"
    letter = {Verdict.VIOLATED: "V", Verdict.UNDECIDED: "U"}.get(cell.verdict, " ")
    return f"{cell.robustness + 0.0:.4g} {letter}"


def _blocks(
    names: list[str], words: list[str], columns: Sequence[list[str]]
) -> Iterator[tuple[list[list[str]], list[list[str]]]]:
    """Parts of the columns that fit beside the names, the first with the verdicts too."""
    head, part = [names, words], list[list[str]]()
    room = _WIDTH - sum(2 + max(map(len, column)) for column in head)
    for column in columns:
        width = 2 + max(map(len, column))
        if part and width > room:
            yield head, part
            head, part = [names], []
            room = _WIDTH - 2 - max(map(len, names))
        part.append(column)
        room -= width
    yield head, part


def _open(matrix: Matrix, name: str) -> list[str]:
    """Says why a requirement is undecided, at the first trace where it is."""
    found = [
        (row.trace, cell)
        for row in matrix.rows
        if isinstance(cell := row.cells[name], Outcome) and cell.verdict == Verdict.UNDECIDED
    ]
    if not found:
        return []
    trace, cell = found[0]
    said = f"{name} is undecided in {trace}{_more(len(found))}"
    head = textwrap.wrap(said, _WIDTH, subsequent_indent="    ")
    return ["", *head, *undecided_lines(cell.not_recorded, cell.way_out)]


def _more(count: int) -> str:
    return f" and {count - 1} more" if count > 1 else ""


def _cut(text: str, width: int) -> str:
    """Cuts a text to a width, with three dots in place of its beginning."""
    return text if len(text) <= width else "..." + text[3 - width :]
