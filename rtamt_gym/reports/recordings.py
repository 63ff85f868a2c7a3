"""The section of two sets of recordings: violations that are new, gone or moved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import PurePath

from rtamt.monitors import Occurrence
from rtamt_gym.evaluation.recording_changes import (
    ChangedRequirement,
    RecordingsComparison,
    ViolationChange,
)
from rtamt_gym.evaluation.recording_tables import (
    HEADINGS,
    clock_text,
    columns_of,
    comparison_warnings,
)
from rtamt_gym.reports.comparisons import pairs_table, rates_table
from rtamt_gym.reports.episodes import in_words_of
from rtamt_gym.reports.figures import pairs_figure
from rtamt_gym.reports.model import (
    Cell,
    Column,
    Figure,
    Requirement,
    Row,
    Section,
    Table,
    Text,
    plain,
)
from rtamt_gym.reports.numbers import number, percent, six
from rtamt_gym.reports.requirements import TRIALS
from rtamt_gym.results.outcome import Word
from rtamt_gym.tables import counted

_ROWS = 200
"""The violations of a requirement that the page lists."""

_RUNS = 500
"""The violations that a timeline shows of each side."""

_BADGES: dict[str, Word] = {
    "new": "violated",
    "longer": "violated",
    "undecided": "undecided",
    "gone": "satisfied",
    "shorter": "satisfied",
}
"""The verdict whose colour a status has."""


def of_recordings(comparison: RecordingsComparison) -> Section:
    """Return the section of a comparison of two sets of recordings."""
    words = comparison.words
    verdict = "B is not worse than A"
    if "violated" in words:
        verdict = "B is worse than A"
    elif "undecided" in words:
        verdict = "It is undecided whether B is worse than A"
    warnings = [f"{warning.text}." for warning in comparison_warnings(comparison)]
    return Section(
        kind="recordings",
        title="{} against {}".format(*_names(comparison.b, comparison.a)),
        facts=(
            ("A", comparison.a),
            ("B", comparison.b),
            ("recordings in both", str(len(comparison.recordings))),
            ("tolerance", number(comparison.tolerance)),
            ("clock", comparison.times),
        ),
        notes=(*warnings, *(f"{note}." for note in comparison.notes)),
        lead=Text(f"A: {comparison.a}. B: {comparison.b}. {verdict}.", "words"),
        blocks=(Text(f"{clock_text(comparison)}.", "sentence"), _counts(comparison)),
        requirements=tuple(
            _requirement(comparison, name, item) for name, item in comparison.requirements.items()
        ),
    )


def _names(*paths: str) -> list[str]:
    """Return the names of files without their folders, if they differ."""
    names = [PurePath(path).name for path in paths]
    return names if len(set(names)) == len(names) else list(paths)


def _counts(comparison: RecordingsComparison) -> Table:
    """Return the number of violations of each requirement with each status."""
    columns = columns_of(comparison)
    rows = [
        Row(
            (
                name,
                *(Cell(str(count), "n") for count in (item.count_a, item.count_b)),
                *(Cell(str(item.statuses[word]), "n") for word in columns),
            )
        )
        for name, item in comparison.requirements.items()
    ]
    head = (Column("requirement"), *(Column(text, "n") for text in ("A", "B", *columns)))
    return Table(head, tuple(rows), "Violations of A and B", "Violations of A and B")


def _requirement(
    comparison: RecordingsComparison, name: str, item: ChangedRequirement
) -> Requirement:
    compared = item.compared
    rows = [row for row in comparison.changes if row.requirement == name]
    known = compared.robustness.pairs if compared.robustness is not None else ()
    step = max(1, -(-len(known) // TRIALS))
    drawn = [(six(a), six(b)) for a, b in sorted(known)[::step]]
    rates = (percent(rate) for rate in (compared.rate_a, compared.rate_b))
    counts = [f"{item.statuses[word]} {word}" for word in ("new", "longer", "gone", "moved")]
    return Requirement(
        name=name,
        words=in_words_of(compared.formula, 1 if item.unit == "s" else None),
        formula=compared.formula,
        rate=compared.difference,
        interval=compared.interval,
        legend="{}; satisfied: A {} %, B {} %".format(", ".join(counts), *rates),
        blocks=(
            Text(compared.sentence_of("recording"), "sentence"),
            rates_table(compared),
            *_changes(rows, item.unit),
        ),
        figures=(
            *_timeline(rows, item.unit, comparison.shifts),
            pairs_table(compared, "recording"),
            *pairs_figure(drawn),
        ),
        id=comparison.ids.get(name),
    )


def _changes(rows: Sequence[ViolationChange], unit: str) -> list[Table | Text]:
    """Return the table of violations that are not the same, the worst statuses first."""
    order = list(HEADINGS)
    rows = sorted(
        (row for row in rows if row.status != "same"), key=lambda row: order.index(row.status)
    )
    if not rows:
        return []
    several = len({row.body for row in rows}) > 1
    head = ["recording", *["part"] * several, "status", "A", "B", "robustness of A", "of B"]
    table = Table(
        tuple(map(Column, head)),
        tuple(
            Row(
                (
                    row.recording,
                    *[Cell(codes=(row.body,))] * several,
                    Cell(row.status, "cell", verdict=_BADGES.get(row.status)),
                    *(_times(side, unit) for side in (row.a, row.b)),
                    *(number(six(side.robustness)) if side else "" for side in (row.a, row.b)),
                )
            )
            for row in rows[:_ROWS]
        ),
        "Violations that differ",
        "Violations that differ",
    )
    if len(rows) <= _ROWS:
        return [table]
    return [table, Text(f"{counted(len(rows) - _ROWS, 'violation')} more not listed.", "muted")]


def _times(span: Occurrence | None, unit: str) -> str:
    if span is None:
        return ""
    text = number(six(span.start))
    if span.end != span.start:
        text += f" to {number(six(span.end))}"
    return f"{text}{' s' if unit == 's' else ''}{' (end)' if span.to_end else ''}"


def _timeline(
    rows: Sequence[ViolationChange], unit: str, shifts: Mapping[str, float]
) -> list[Figure]:
    """Return the violations in the recording with most that are new or longer, or that differ."""
    differing = Counter(row.recording for row in rows if row.status != "same")
    if not differing:
        return []
    worse = Counter(row.recording for row in rows if row.status in ("new", "longer"))
    name, count = max(differing.items(), key=lambda item: (worse[item[0]], item[1]))
    own = [row for row in rows if row.recording == name]
    bodies, drawn = [], list[float]()
    for text in dict.fromkeys(row.body for row in own):
        for side, shift in (("a", 0.0), ("b", shifts.get(name, 0.0))):
            spans = [
                (six(span.start + shift), six(span.end + shift), number(six(span.robustness)))
                for row in own
                if row.body == text and (span := getattr(row, side)) is not None
            ]
            runs = tuple(
                (start, end, "violated", worst) for start, end, worst in sorted(spans)[:_RUNS]
            )
            drawn += [end for run in runs for end in run[:2]]
            bodies.append({"text": f"{side.upper()}: {text}", "runs": runs})
    summary = (
        f"{name}: {counted(count, 'violation')} {'differs' if count == 1 else 'differ'} between A "
        "and B."
    )
    if name in shifts:
        summary += f" The times of B are moved by {number(shifts[name])} s."
    data = {
        "bodies": tuple(bodies),
        "span": (min(drawn), max(drawn)),
        "unit": "s" if unit == "s" else "steps",
    }
    return [
        Figure(
            "timeline",
            "Violations of A and B",
            summary,
            110 + 34 * len(bodies),
            plain(data),
            wide=True,
            words=("violated",),
        )
    ]
