"""Outcomes for CI systems: JUnit XML, and Markdown for the summary of a job.

To add a format, write a function here that writes a `Matrix`, and add its option to
`rtamt_gym.commands.monitor`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree as ET

from rtamt import Verdict
from rtamt.errors import shown, shown_lines
from rtamt.language import RequirementId
from rtamt_gym.results.matrix import (
    Matrix,
    cell_text,
    label,
    legend,
    summary,
    times_text,
    worst_traces,
)
from rtamt_gym.results.outcome import Failure, Outcome, Word, word
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import (
    VerdictWarning,
    evidence_warnings,
    failing_cell,
    failing_summary,
    never_triggered_word,
    triggered_in,
)
from rtamt_gym.tables import number

_EXPLAINED = 50
"""The number of cells that Markdown explains: CI systems limit the size of pages."""


def to_markdown(
    matrix: Matrix,
    warnings: Sequence[VerdictWarning] = (),
    constants: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return the table of outcomes, and why requirements are violated, undecided or in error.

    It explains the first 50. For more than 10,000 traces, the table shows the 100 worst.
    """
    triggered = {name for name in matrix.requirements if triggered_in(matrix, name) is not None}
    names = [_escaped(name) + " | triggers" * (name in triggered) for name in matrix.requirements]
    heading = [label(matrix.word), *filter(None, [_escaped(failing_summary(warnings))])]
    lines = [f"# {', '.join(heading)}", ""]
    few, note = worst_traces(matrix)
    lines += [f"{_escaped(text)}  " for text in (*summary(matrix), *filter(None, [note]))]
    lines += ["", f"| trace | verdict | {' | '.join(names)} |"]
    lines.append(f"|---|---|{'---:|' * (len(names) + len(triggered))}")
    for row in few.rows:
        cells = []
        for name in matrix.requirements:
            cells.append(cell_text(row.cell(name)).strip())
            cells += [times_text(row.cell(name))] * (name in triggered)
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
    for head, why in explained[:_EXPLAINED]:
        fence, text = "`" * 3, shown_lines(why)
        while fence in text:
            fence += "`"
        lines += ["", f"<details><summary>{_html(head)}</summary>", "", fence, text, fence]
        lines += ["", "</details>"]
    if len(explained) > _EXPLAINED:
        lines += ["", f"{len(explained) - _EXPLAINED} more are not explained here."]
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


_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""The characters that XML does not allow."""


def junit_parts(
    matrix: Matrix,
    rules: Mapping[str, str],
    warnings: Sequence[VerdictWarning] = (),
    *,
    least: Fraction | None = None,
) -> Iterator[bytes]:
    """Yield the parts of a file of JUnit XML with the outcomes; a suite is a part.

    A violation is a failure, an undecided requirement is skipped, and a trace that could not be
    judged is an error. A warning that makes the command fail is a failure too, so that the file
    agrees with the exit code. Without times of execution, the same traces give the same file.
    """
    counts = _counts(
        [_word(row, name, warnings) for row in matrix.rows for name in matrix.requirements]
    )
    del counts["skipped"]  # schemas have it in suites only
    root = ET.Element("testsuites", {"name": "rtamt", **counts})
    shorter = set() if least is None else {*matrix.shorter(least)}
    minimum = {} if least is None else {"shorter_than": f"{number(float(least))} s"}
    opening, _, _ = ET.tostring(root, encoding="unicode").rpartition(" />")
    yield f'<?xml version="1.0" encoding="UTF-8"?>\n{opening}>'.encode()
    for row in matrix.rows:
        own = {**rules, **minimum} if row.name in shorter else rules
        suite = _suite(row, matrix.requirements, own, matrix.provenance.ids, warnings)
        ET.indent(suite, level=1)
        yield b"\n  " + ET.tostring(suite, encoding="unicode").encode()
    yield b"\n</testsuites>\n"


def discard_junit(path: Path) -> None:
    """Remove the outcomes of an earlier run, so that no old file remains after an early stop.

    Only a file that `junit_parts` wrote is removed.
    """
    with suppress(OSError):
        with path.open("rb") as file:
            ours = b'<testsuites name="rtamt"' in file.read(200)
        if ours:
            path.unlink()


def _suite(
    row: Trial,
    formulas: Mapping[str, str],
    rules: Mapping[str, str],
    ids: Mapping[str, RequirementId],
    warnings: Sequence[VerdictWarning],
) -> ET.Element:
    counts = _counts([_word(row, name, warnings) for name in formulas])
    suite = ET.Element("testsuite", {"name": _xml(row.name), **counts})
    properties = ET.SubElement(suite, "properties")
    for name, value in rules.items():
        ET.SubElement(properties, "property", name=name, value=value)
    for name in formulas:
        case = ET.SubElement(suite, "testcase", classname=_xml(row.name), name=_xml(name))
        cell = row.cell(name)
        own = _properties(cell, ids.get(name))
        if own:
            properties = ET.SubElement(case, "properties")
            for key, value in own.items():
                ET.SubElement(properties, "property", name=key, value=_xml(value))
        _say(case, cell, formulas[name], failing_cell(warnings, row.name, name, cell))
        if isinstance(cell, Outcome) and cell.triggers:
            never = never_triggered_word(unknown=bool(cell.unknown))
            rows = (f"{never if row.first is None else row}: {row.text}" for row in cell.triggers)
            ET.SubElement(case, "system-out").text = _xml("\n".join(rows))
    if row.described:
        ET.SubElement(suite, "system-out").text = _xml("\n".join([row.described, *row.notes]))
    return suite


def _properties(cell: Outcome | Failure, identity: RequirementId | None) -> dict[str, str]:
    """Return the id and link of a requirement, and the evidence for its verdict."""
    properties = {}
    if identity is not None:
        properties = {"id": identity.id, "link": identity.link}
    if isinstance(cell, Outcome) and cell.trigger_count is not None:
        properties["asked"] = str(cell.trigger_count)
        properties |= {"vacuous": "true"} if cell.vacuous else {}
        properties |= {"never_asked": "true"} if cell.never_triggered else {}
    if isinstance(cell, Outcome) and cell.late_start is not None:
        late = cell.late_start
        properties |= {"late_start": late.text, "left_out": str(late.left_out)}
    if isinstance(cell, Outcome):
        properties |= {f"default:{name}": number(value) for name, value in cell.defaults.items()}
    return {key: value for key, value in properties.items() if value}


def _say(
    case: ET.Element, cell: Outcome | Failure, formula: str, failing: tuple[str, str] | None
) -> None:
    """Add a failure, an error or a skip for a requirement that is not satisfied as required."""
    if isinstance(cell, Failure):
        entry = ET.SubElement(case, "error", message=_xml(cell.message), type="error")
        entry.text = _xml(cell.traceback or cell.message)
    elif failing is not None:
        kind, message = failing
        entry = ET.SubElement(case, "failure", message=_xml(message), type=kind)
        reasons = [item for item in (cell.text, *cell.not_recorded, cell.way_out) if item]
        entry.text = _xml("\n".join([formula, "", message, *reasons]))
    elif cell.verdict == Verdict.VIOLATED:
        entry = ET.SubElement(case, "failure", message=_xml(cell.text), type="violation")
        entry.text = _xml(f"{formula}\n\n{cell.explanation}")
    elif cell.verdict == Verdict.UNDECIDED:
        late = cell.late_start
        reasons = [*cell.not_recorded, cell.way_out, *([late.text] if late and late.of else [])]
        entry = ET.SubElement(case, "skipped", message=_xml("; ".join(reasons)))
        entry.text = _xml("\n".join([formula, "", cell.text, *reasons]))


def _word(row: Trial, name: str, warnings: Sequence[VerdictWarning]) -> Word:
    """Return the kind of a test case."""
    cell = row.cell(name)
    return word(cell) if failing_cell(warnings, row.name, name, cell) is None else "violated"


def _counts(words: Sequence[Word]) -> dict[str, str]:
    counts = {
        "tests": len(words),
        "failures": words.count("violated"),
        "errors": words.count("failed"),
        "skipped": words.count("undecided"),
    }
    return {name: str(count) for name, count in counts.items()}


def _xml(text: str) -> str:
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", shown_lines(text))
