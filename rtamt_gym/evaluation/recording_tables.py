"""The comparison of two sets of recordings for a terminal: counts, violations and remarks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from rtamt.errors import shown
from rtamt.monitors import Occurrence
from rtamt_gym.evaluation.paired import effect_sentence
from rtamt_gym.results.span_matching import Status
from rtamt_gym.results.warnings import VerdictWarning
from rtamt_gym.tables import counted, number, shorten, table, wrapped

if TYPE_CHECKING:
    from rtamt_gym.evaluation.recording_changes import RecordingsComparison, ViolationChange

_NAMED: Final = 3
"""The number of recordings that a warning names."""

_LISTED: Final = 10
"""The number of violations that are listed for each status."""

HEADINGS: Final[dict[Status, str]] = {
    "new": "new in B",
    "longer": "longer in B",
    "undecided": "undecided in the other",
    "gone": "gone in B",
    "shorter": "shorter in B",
    "moved": "moved in B",
    "part": "part of a violation of the other",
    "same": "the same",
}
"""The meaning of each status, the worst first."""

_COLUMNS: Final[tuple[Status, ...]] = (
    *("same", "moved", "longer", "shorter", "new", "gone", "part", "undecided"),
)
_ALWAYS: Final = ("same", "moved", "new", "gone")


def columns_of(comparison: RecordingsComparison) -> list[Status]:
    """Return the statuses that a table shows: the usual ones, and others that occur."""
    every = comparison.requirements.values()
    return [
        word for word in _COLUMNS if word in _ALWAYS or any(item.statuses[word] for item in every)
    ]


def clock_text(comparison: RecordingsComparison) -> str:
    """Return the recordings, the tolerance and the clock of a comparison in words."""
    unit = _unit(comparison)
    clock = "recorded times" if comparison.times == "recorded" else "times since the start"
    pairs = counted(len(comparison.recordings), "recording")
    return f"{pairs} in both, tolerance {number(comparison.tolerance)}{unit}, {clock}"


def _unit(comparison: RecordingsComparison) -> str:
    """Return the unit of all times with a space before it; empty if there are two."""
    units = {item.unit for item in comparison.requirements.values()}
    return {"s": " s", "samples": " samples"}.get(units.pop() if len(units) == 1 else "", "")


def recordings_lines(comparison: RecordingsComparison) -> Iterator[str]:
    """Yield the lines of a comparison, at most 80 columns wide but for long names."""
    yield f"A: {shown(comparison.a)}"
    yield f"B: {shown(comparison.b)}"
    yield clock_text(comparison)
    yield ""
    columns = columns_of(comparison)
    rows = [
        [
            shorten(name, 24),
            *(str(count) for count in (item.count_a, item.count_b)),
            *(str(item.statuses[word]) for word in columns),
        ]
        for name, item in comparison.requirements.items()
    ]
    head = ["violations", "A", "B", *columns]
    yield from table([head, *rows], "<" + ">" * (len(head) - 1))
    for word, heading in HEADINGS.items():
        changes = comparison.rows(word)
        if word == "same" or not changes:
            continue
        yield ""
        yield f"{heading}:"
        for row in changes[:_LISTED]:
            yield from wrapped(f"  {_row(comparison, row)}")
        if len(changes) > _LISTED:
            yield f"  and {len(changes) - _LISTED} more"
    yield ""
    for text in sentences(comparison):
        yield from wrapped(text)
    for note in comparison.notes:
        yield from wrapped(f"note: {note}")


def _row(comparison: RecordingsComparison, row: ViolationChange) -> str:
    """Return a violation in words."""
    unit = comparison.requirements[row.requirement].unit
    spans = [
        f"{side} {interval_text(span, unit)}"
        for side, span in (("A", row.a), ("B", row.b))
        if span is not None
    ]
    bodies = {r.body for r in comparison.changes if r.requirement == row.requirement}
    body = f" ({shorten(row.body, 50)})" if len(bodies) > 1 else ""
    return f"{row.requirement}{body} in {shown(row.recording)}: {'; '.join(spans)}"


def interval_text(span: Occurrence, unit: str) -> str:
    """Return the time of a violation and its worst robustness in words."""
    s = " s" if unit == "s" else ""
    sample = "sample " if unit == "samples" else ""
    text = f"{sample}{span.start:.12g}{s}"
    if span.end != span.start:
        text += f" to {span.end:.12g}{s}"
    text += ", up to the end" * span.to_end + " (after the recording)" * span.unseen
    return f"{text}, robustness {number(span.robustness + 0.0)}"


def sentences(comparison: RecordingsComparison) -> Iterator[str]:
    """Yield the paired statistics of each requirement in words."""
    for name, item in comparison.requirements.items():
        yield item.compared.sentence_of("recording")
        if item.violated_time is not None and item.count_a + item.count_b:
            what = f"the violated time of `{name}`"
            unit = "seconds" if item.unit == "s" else "samples"
            yield f"{effect_sentence(item.violated_time, what)[:-1]}, in {unit} per recording."
        if item.open_b:
            stretches = counted(item.open_b, "stretch").replace("stretchs", "stretches")
            yield f"B does not decide `{name}` in {stretches} that A satisfies."


def comparison_warnings(
    comparison: RecordingsComparison, *, require_all: bool = False
) -> list[VerdictWarning]:
    """Return the warnings on recordings and requirements that were not compared.

    Args:
        comparison: The comparison.
        require_all: Whether the command fails if B lacks a recording, a requirement, a time or all
            triggers of a requirement.
    """
    unit, total = _unit(comparison), len(comparison.recordings)
    groups: list[tuple[str, Sequence[str], bool]] = [
        ("only in A", comparison.only_a, True),
        ("only in B", comparison.only_b, False),
        ("requirements only in A", comparison.requirements_a, True),
        ("requirements only in B", comparison.requirements_b, False),
        ("requirements with another text in B", comparison.changed, True),
        (
            "B covers less time",
            [f"{name} ({number(time)}{unit} less)" for name, time in comparison.shorter.items()],
            True,
        ),
        (
            "never triggered in B",
            [
                f"{name} ({count} of {counted(total, 'recording')} of A)"
                for name, count in comparison.untriggered.items()
                if count
            ],
            True,
        ),
        (
            "never triggered in A and B",
            [name for name, count in comparison.untriggered.items() if not count],
            False,
        ),
    ]
    missing = comparison.not_compared
    texts = [
        f"not compared: {shown(n.requirement)} in {shown(n.recording)} ({n.reason})"
        for n in missing[:_NAMED]
    ]
    if len(missing) > _NAMED:
        texts.append(f"not compared: {len(missing) - _NAMED} more")
    nothing = [] if comparison.requirements else ["nothing was compared: no verdict in both"]
    return [
        *(VerdictWarning(text, fails=True) for text in nothing),
        *(
            VerdictWarning(f"{phrase}: {_listed(names)}", fails=require_all and lacking)
            for phrase, names, lacking in groups
            if names
        ),
        *(VerdictWarning(text, fails=require_all) for text in texts),
    ]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(shown(shorten(name, 160)) for name in names[:_NAMED]) + more
