"""Outcomes as Markdown, for the summary of a CI job."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from rtamt.errors import shown, shown_lines
from rtamt_gym.results.matrix import (
    Matrix,
    cell_text,
    label,
    legend,
    summary,
    times_text,
    worst_traces,
)
from rtamt_gym.results.outcome import Failure, Outcome
from rtamt_gym.results.warnings import (
    VerdictWarning,
    evidence_warnings,
    failing_summary,
    triggered_in,
)

_MOST = 50
"""The number of cells that are explained: the pages of CI systems are limited in size."""


def to_markdown(
    matrix: Matrix,
    warnings: Sequence[VerdictWarning] = (),
    constants: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return the table of outcomes, and why requirements are violated, undecided or in error.

    The first 50 are explained. Of more than 10,000 traces the table shows the 100 worst.

    Args:
        matrix: The outcomes.
        warnings: The warnings of the command; the heading shows warnings that make it fail.
        constants: The values of constants that replace values in the specifications, by name.
    """
    asked = {name for name in matrix.requirements if triggered_in(matrix, name) is not None}
    names = [_escaped(name) + " | triggers" * (name in asked) for name in matrix.requirements]
    heading = [label(matrix.word), *filter(None, [_escaped(failing_summary(warnings))])]
    lines = [f"# {', '.join(heading)}", ""]
    few, note = worst_traces(matrix)
    lines += [f"{_escaped(text)}  " for text in (*summary(matrix), *filter(None, [note]))]
    lines += ["", f"| trace | verdict | {' | '.join(names)} |"]
    lines.append(f"|---|---|{'---:|' * (len(names) + len(asked))}")
    for row in few.rows:
        cells = []
        for name in matrix.requirements:
            cells.append(cell_text(row.cell(name)).strip())
            cells += [times_text(row.cell(name))] * (name in asked)
        lines.append(f"| {_escaped(row.name)} | {label(row.word)} | {' | '.join(cells)} |")
    lines += ["", f"{legend(matrix)}."]
    if constants:
        values = ", ".join(f"{name} = {value}" for name, value in constants.items())
        lines += ["", f"Constants set on the command line: {_escaped(values)}"]
    for name, identifier in matrix.provenance.ids.items():
        shown = (
            f"[{_escaped(identifier.id)}]({identifier.link})"
            if identifier.link
            else _escaped(identifier.id)
        )
        lines += ["", f"{_escaped(name)}: {shown}"]
    evidence = evidence_warnings(matrix)
    lines += [""] * bool(evidence) + [f"{_escaped(warning.text)}  " for warning in evidence]
    explained = list(_explained(few))
    for head, why in explained[:_MOST]:
        fence, text = "`" * 3, shown_lines(why)
        while fence in text:
            fence += "`"
        lines += ["", f"<details><summary>{_html(head)}</summary>", "", fence, text, fence]
        lines += ["", "</details>"]
    if len(explained) > _MOST:
        lines += ["", f"{len(explained) - _MOST} more are not explained here."]
    return "\n".join(lines) + "\n"


def _explained(matrix: Matrix) -> Iterator[tuple[str, str]]:
    for row in matrix.rows:
        for name in matrix.requirements:
            cell = row.cell(name)
            head = f"{row.name}: {name}"
            if isinstance(cell, Failure):
                yield f"{head}: error", cell.message
            elif cell.explanation or cell.way_out:
                yield f"{head}: {cell.text}", _why(cell, matrix.requirements[name])


def _why(cell: Outcome, formula: str) -> str:
    if cell.explanation:
        return f"{formula}\n\n{cell.explanation}"
    return "\n".join([formula, "", *cell.not_recorded, cell.way_out])


def _escaped(text: str) -> str:
    r"""Escape the characters of Markdown: ``a_b|c`` becomes ``a\_b\|c``."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|~" else c for c in shown(text))


def _html(text: str) -> str:
    return shown(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
