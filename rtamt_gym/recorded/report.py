"""The report on one recorded trace, for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from rtamt_gym.recorded.judge import TraceJudgement
from rtamt_gym.results.matrix import indented, undecided_lines
from rtamt_gym.tables import number, shorten, table


def report(
    judgements: Mapping[str, TraceJudgement],
    trace: Iterable[str],
    notes: Iterable[str] = (),
    reasons: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """Return the lines of judgements in words and as a table.

    Args:
        judgements: The judgement of each requirement.
        trace: The lines that describe the trace.
        notes: Notes on the trace.
        reasons: A phrase with the reason for the verdict, by requirement.
    """
    several = len(judgements) > 1
    rows = [("spec", "formula", "at the start", "minimum", "at", "violated from")]
    for name, judgement in judgements.items():
        for formula, values in judgement.series.items():
            series = values.instants
            least, below = series.least, series.below
            rows.append(
                (
                    name if several and formula == next(iter(judgement.series)) else "",
                    formula,
                    judgement.text_of(float(series.values[0])),
                    judgement.text_of(float(series.values[least])),
                    series.at(least),
                    "-" if below is None else series.at(below),
                )
            )
    room = 80 - sum(2 + max(map(len, column)) for column in list(zip(*rows, strict=True))[2:])
    width = max(8, (room - 2) // 2 if several else room)
    cells = [[shorten(text, width) for text in row[:2]] + [*row[2:]] for row in rows]
    verdicts, unknown = [], {}
    for name, judgement in judgements.items():
        verdicts.append(f"{shorten(name, 20)}: {judgement}" if several else str(judgement))
        if name in reasons:
            verdicts += indented(f"why: {reasons[name]}", "    ")
        verdicts += undecided_lines(judgement.not_recorded, judgement.way_out)
        if judgement.late_start is not None:
            verdicts += indented(judgement.late_start.text, "    ")
        verdicts += [line for text in judgement.asked for line in indented(text, "    ")]
        if judgement.from_start.unknown:
            unknown[name] = judgement.from_start.unknown
    notes = [*notes, *_left_out(unknown, several=several)]
    for name, judgement in judgements.items():
        notes += filter(None, [judgement.note_of_end(name if several else "")])
        if judgement.series and judgement.otherwise_complete:
            of_spec = f" of {name}" if several else ""
            notes.append(
                f"robustness over time{of_spec} assumes that nothing follows; with --end complete "
                f"the verdict is {judgement.otherwise_complete}"
            )
        late = judgement.late_start
        if judgement.series and late is not None and late.counted:
            of_spec = f" of {name}" if several else ""
            notes.append(f"robustness over time{of_spec} starts at {number(late.time)} s")
    return [
        *verdicts,
        *trace,
        *(line for note in notes for line in indented(f"note: {note}", "")),
        *(["", *table(cells, "<<>>>>")] if len(rows) > 1 else []),
    ]


def _left_out(unknown: Mapping[str, tuple[str, ...]], *, several: bool) -> list[str]:
    """Return a sentence on requirements that the table omits; empty if it has all."""
    if not unknown:
        return []
    of_specs = f" of {', '.join(unknown)}" if several else ""
    names = dict.fromkeys(name for variables in unknown.values() for name in variables)
    return [f"no robustness over time{of_specs}: values of {', '.join(names)} are not known"]
