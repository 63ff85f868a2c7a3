"""Outcomes as JUnit XML, which CI systems show: a suite for each trace, a case for each formula.

To add a format of outcomes for CI, write a module next to this one that writes a `Matrix`, and add
its option to `rtamt_gym.commands.monitor`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree as ET

from rtamt import Verdict
from rtamt.errors import shown_lines
from rtamt.language import RequirementId
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Failure, Outcome, Word, word
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import VerdictWarning, failing_cell, never_triggered_word
from rtamt_gym.tables import number

_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What no XML file may hold."""


def junit_parts(
    matrix: Matrix,
    rules: Mapping[str, str],
    warnings: Sequence[VerdictWarning] = (),
    *,
    least: Fraction | None = None,
) -> Iterator[bytes]:
    """Yield the parts of a file of JUnit XML with the outcomes; a suite is a part.

    A violation is a failure, an undecided requirement is skipped, and a trace that could not be
    judged is an error. A warning that makes the command fail is a failure too, so the file agrees
    with the exit code. The file has no times of execution: the same traces return the same file.

    Args:
        matrix: The outcomes.
        rules: How the traces were judged, by name; properties of every suite.
        warnings: The warnings of the command; warnings that make it fail are failures.
        least: The minimum duration of a trace in seconds, the property ``shorter_than`` in the
            suite of a shorter trace; None for no minimum.
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
