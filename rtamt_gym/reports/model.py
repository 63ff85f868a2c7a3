"""The content of the results page: sections of requirements, and blocks of five kinds.

A block is `Facts`, `Text`, `Table`, `Figure` or `ShownEpisode`; each has one template in ``page/``.
Numbers of series have six digits; times are in the unit of their section.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final, Literal, NamedTuple

from rtamt.language import RequirementId
from rtamt_gym.results.mutation import MutationScore
from rtamt_gym.results.outcome import Moment, Word

SectionKind = Literal[
    "evaluation", "sweep", "search", "matrix", "comparison", "recordings", "methods"
]
"""The subject of a section: episodes of a policy, simulations of a record, the search for a
violation, recorded traces, two evaluations, two sets of recordings, or learning methods over
training seeds."""

NOUNS: Final[Mapping[SectionKind, str]] = {
    "evaluation": "episode",
    "sweep": "simulation",
    "search": "simulation",
    "matrix": "trace",
    "comparison": "pair",
    "recordings": "recording",
    "methods": "run",
}
"""The word for one run in a section of each kind."""

ShownSeries = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Facts:
    """Names with their values.

    Attributes:
        rows: The name, the value and a remark, which may be empty.
        style: Further classes of the list.
    """

    rows: tuple[tuple[str, str, str], ...]
    style: str = ""


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph; names in backticks are shown as code.

    Attributes:
        text: The paragraph.
        style: Its classes, such as ``"note"``.
    """

    text: str
    style: str = "note"


class Column(NamedTuple):
    """The head of a column.

    Attributes:
        text: The text.
        style: Its classes; ``"n"`` is a column of numbers.
        requirement: The requirement that the column is about, for the filter of the page.
        sortable: Whether a click on it sorts the table.
    """

    text: str
    style: str = ""
    requirement: str = ""
    sortable: bool = True


class Cell(NamedTuple):
    """A cell with more than a text.

    Attributes:
        text: The text.
        style: Its classes.
        value: The sort key of the column.
        verdict: The verdict that it shows: a sign before the text if ``style`` is set; otherwise, a
            badge.
        muted: Remarks after the text.
        codes: Pieces of code after the text.
        link: The id on the page that the text links to.
        copied: A text that a button copies, and the label of the button.
        interval: A number, its interval, and the minimum of their axis.
    """

    text: str = ""
    style: str = ""
    value: float | None = None
    verdict: Word | None = None
    muted: tuple[str, ...] = ()
    codes: tuple[str, ...] = ()
    link: str = ""
    copied: tuple[str, str] | None = None
    interval: tuple[float, tuple[float, float], float] | None = None


class Row(NamedTuple):
    """A row of a table; its first cell is its head.

    Attributes:
        cells: The cells.
        id: The id of the row on the page.
        verdict: The verdict of the row, for the filter of the page.
        style: Its classes.
    """

    cells: tuple[str | Cell, ...]
    id: str = ""
    verdict: str = ""
    style: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table.

    Attributes:
        head: The heads of the columns.
        rows: The rows.
        label: A description for screen readers.
        caption: The text above it.
        style: Its classes.
        labelled: The id of the element that labels it, in place of ``label``.
    """

    head: tuple[Column, ...]
    rows: tuple[Row, ...]
    label: str = "Numbers of the chart"
    caption: str = ""
    style: str = ""
    labelled: str = ""


@dataclass(frozen=True, slots=True)
class Figure:
    """A chart that the script draws.

    Attributes:
        kind: The function of the script that draws it.
        title: Its title.
        summary: A description in a sentence or two.
        height: Its height in pixels.
        data: The data for the script.
        table: Its numbers; None if they are elsewhere on the page, or the script makes the table.
        wide: Whether it takes the full width.
        words: The verdicts that it shows by colour and sign, for its legend.
        id: Its id on the page.
    """

    kind: str
    title: str
    summary: str
    height: int
    data: Mapping[str, Any]
    table: Table | None = None
    wide: bool = False
    words: tuple[Word, ...] = ()
    id: str = ""


@dataclass(frozen=True, slots=True)
class Decision:
    """A sample that decided the robustness, as `rtamt.explain` marks it.

    Attributes:
        predicate: The text of the predicate; a key of `ShownEpisode.predicates`.
        time: The time of the sample.
        values: The values of the predicate's variables at that time.
        robustness: The robustness of the predicate at that time.
        words: The same as a sentence.
    """

    predicate: str
    time: float
    values: Mapping[str, float]
    robustness: float
    words: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of an episode at a time: a ``data:`` URL, and a description."""

    time: float
    source: str
    words: str


@dataclass(frozen=True, slots=True)
class ShownEpisode:
    """One episode in full: signals, robustness with bounds, and the samples that decided.

    Every series has a number for each of ``times``, or is empty if it is unknown. Long episodes are
    thinned; extremes and the first, the last and the deciding samples stay.

    Attributes:
        label: As `TrialRow.label`.
        verdict: The outcome of the requirement.
        final: The robustness at the end.
        samples: The number of samples; more than ``times`` if the episode is thinned.
        times: The times of the samples shown, increasing.
        signals: The values of each variable and of each further recorded signal.
        robustness: The robustness, if the episode ended there.
        lower: The minimum robustness that was still possible.
        upper: The maximum robustness that was still possible.
        predicates: The robustness of each predicate of the requirement, by its text.
        deciding: The samples that decided.
        decided_at: The moment of the sample that decided a violation, or None.
        seed: As `TrialRow.seed`.
        case: As `TrialRow.case`.
        explanation: The explanation as text; may be empty.
        frames: Pictures of the episode.
        note: A remark; may be empty.
        of_instant: Whether the robustness is about each instant, with bounds about the episode.
        figure: The plot; None before the page is laid out.
        id: Its id on the page.
    """

    label: str
    verdict: Word
    final: float
    samples: int
    times: ShownSeries
    signals: Mapping[str, ShownSeries]
    robustness: ShownSeries = ()
    lower: ShownSeries = ()
    upper: ShownSeries = ()
    predicates: Mapping[str, ShownSeries] = field(default_factory=dict)
    deciding: tuple[Decision, ...] = ()
    decided_at: Moment | None = None
    seed: int | None = None
    case: tuple[str, ...] = ()
    explanation: str = ""
    frames: tuple[Picture, ...] = ()
    note: str = ""
    of_instant: bool = False
    figure: Figure | None = None
    id: str = ""


Block = Facts | Text | Table | Figure | ShownEpisode


class Counts(NamedTuple):
    """How many episodes satisfied a requirement, violated it, left it undecided, or failed.

    A failed episode counts in ``failed`` only; the four add up to ``episodes``.
    """

    episodes: int = 0
    satisfied: int = 0
    violated: int = 0
    undecided: int = 0
    failed: int = 0


@dataclass(frozen=True, slots=True)
class TrialRow:
    """The outcome of one requirement in one episode, simulation or trace.

    Attributes:
        label: The name of the trial: ``seed 17``, ``simulation 4`` or the name of a file.
        verdict: The outcome of the requirement.
        robustness: The robustness at the end, or None.
        violated_at: The moment of a violation, the last sample if only the end decided it; None
            without a violation, or if it is unknown.
        duration: The length of the episode; None if it is unknown.
        reward: The sum of the environment's rewards; None for a system without rewards.
        seed: The seed of the reset; None for a system without a seed.
        case: The case of the simulation, a text for each entry.
        text: The error that ended it, or another remark; may be empty.
        asked: How often it triggered the implications of the requirement; None without implications
            or a count.
        vacuous: Whether it satisfied the requirement without an answer.
        defaults: The declared defaults that it read, each as ``limit = 0.5``.
        unknown: Whether some values are unknown, so that ``asked`` counts only certain triggers.
        progress: The progress in the stages of the requirement; None without stages.
    """

    label: str
    verdict: Word
    robustness: float | None = None
    violated_at: Moment | None = None
    duration: float | None = None
    reward: float | None = None
    seed: int | None = None
    case: tuple[str, ...] = ()
    text: str = ""
    asked: int | None = None
    vacuous: bool = False
    defaults: tuple[str, ...] = ()
    unknown: bool = False
    progress: float | None = None


class Band(NamedTuple):
    """A signal of an example, as paths of an SVG that is 100 wide and 36 high.

    Attributes:
        name: The name of the signal.
        line: Its values in steps.
        dots: Its samples; empty if there are many.
        levels: A line for each number that the signal is compared with.
        compared: These numbers.
        low: The number at the bottom.
        high: The number at the top.
    """

    name: str
    line: str
    dots: str
    levels: tuple[str, ...]
    compared: str
    low: str
    high: str


class ShownExample(NamedTuple):
    """A trace that shows something about a requirement.

    Attributes:
        verdict: The verdict of the requirement on it.
        robustness: The robustness on it; None for a trace that repeats for ever.
        why: The reason for showing it.
        length: Its length with the unit.
        bands: Its signals.
        repeats: The percentage of its end that repeats for ever.
        loop: The same in words; empty if nothing repeats.
        steady: Further, constant signals with their values.
        table: A row for each run of equal samples.
    """

    verdict: Word
    robustness: float | None
    why: str
    length: str
    bands: tuple[Band, ...]
    repeats: float
    loop: str
    steady: str
    table: Table


@dataclass(frozen=True, slots=True)
class Requirement:
    """A requirement, and its outcomes in all episodes of a section.

    Attributes:
        name: Its name.
        words: The requirement in plain English.
        formula: Its formula.
        counts: The counts of outcomes; all 0 in a comparison.
        rate: The rate of satisfaction, in a comparison the rate of B minus the rate of A; None if
            a rate has no meaning.
        interval: The 95 % interval of the rate; None without a rate.
        robustness: The robustness of every episode that has one, smallest first; evenly spaced
            ranks if there are more than 1000.
        verdicts: The outcome of the requirement for each of these.
        quantiles: The quantiles of the robustness, by the text of the share (``"0.05"``).
        first_violations: `TrialRow.violated_at` of the violations, earliest first.
        trials: The outcome in each episode, worst first, at most 500.
        left_out: How many episodes ``trials`` leaves out.
        blocks: Texts, facts and tables at the head.
        figures: Charts, and tables next to them.
        worst: The worst episodes in full, worst first.
        note: A remark, such as the simulated time that early ends saved; may be empty.
        by_end: How many episodes are violated by how they ended, at a robustness above zero.
        id: Its id where requirements are kept, with a link; None without an id.
        asked: How many episodes triggered it, and in how many triggers were counted; None without
            implications.
        unknown: Whether values are unknown in an episode, so that ``asked`` counts only certain
            triggers.
        vacuous: How many episodes satisfied it without an answer.
        defaults: How many episodes read each of the declared defaults, as ``limit = 0.5``.
        answer: The answer of sequential stopping about its rate; None without a target.
        together: Whether it stands for all requirements of its section.
        legend: The rates of both sides of a comparison; otherwise empty.
        examples: Traces that satisfy it and violate it.
        more_examples: The number of further examples.
        place: Its id on the page.
        key: Its number in every section.
        table: The table of its trials; None before the page is laid out.
    """

    name: str
    words: str
    formula: str
    counts: Counts = field(default_factory=Counts)
    rate: float | None = None
    interval: tuple[float, float] | None = None
    robustness: ShownSeries = ()
    verdicts: tuple[Word, ...] = ()
    quantiles: Mapping[str, float] = field(default_factory=dict)
    first_violations: ShownSeries = ()
    trials: tuple[TrialRow, ...] = ()
    left_out: int = 0
    blocks: tuple[Block, ...] = ()
    figures: tuple[Figure | Table, ...] = ()
    worst: tuple[ShownEpisode, ...] = ()
    note: str = ""
    by_end: int = 0
    id: RequirementId | None = None
    asked: tuple[int, int] | None = None
    unknown: bool = False
    vacuous: int = 0
    defaults: Mapping[str, int] = field(default_factory=dict)
    answer: Word | None = None
    together: bool = False
    legend: str = ""
    examples: tuple[ShownExample, ...] = ()
    more_examples: int = 0
    place: str = ""
    key: int | str = ""
    table: Table | None = None


@dataclass(frozen=True, slots=True)
class Section:
    """One result.

    Attributes:
        kind: The kind of the section.
        title: Its title.
        system: The name of the system; may be empty.
        policy: The name of the policy; may be empty.
        unit: The unit of times: ``"s"``, or ``"steps"`` without a period.
        replay: The command that replays an episode, with ``{seed}`` for its seed; may be empty.
        facts: Names and values at its head.
        notes: Remarks about the result.
        lead: The text at the glance, in place of a list of requirements or above it.
        blocks: Texts, facts and tables above the requirements.
        figures: Charts below them.
        requirements: The requirements.
        returns: The sum of the rewards of every episode, smallest first; empty without rewards.
        durations: The lengths of the episodes, shortest first; empty if they are not known.
        cases: The points of a sweep or a search, for charts: labels, columns, robustness, verdicts.
        mutants: The mutation score of each requirement of recorded traces; None without mutants.
        min_share: The required share of killed mutants, or None.
        source: The path and the SHA-256 of the file of the result; None if it was an object.
        files: The SHA-256 of each file that the result was made of, by path.
        versions: The versions of Python and packages that made it.
        not_played: The error that prevented the replay of a saved case; otherwise empty.
        id: Its id on the page.
    """

    kind: SectionKind
    title: str
    system: str = ""
    policy: str = ""
    unit: str = "s"
    replay: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    lead: Text | None = None
    blocks: tuple[Block, ...] = ()
    figures: tuple[Figure | Table, ...] = ()
    requirements: tuple[Requirement, ...] = ()
    returns: ShownSeries = ()
    durations: ShownSeries = ()
    cases: Mapping[str, Any] | None = None
    mutants: Mapping[str, MutationScore] | None = None
    min_share: float | None = None
    source: tuple[str, str] | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    not_played: str = ""
    id: str = ""

    @property
    def noun(self) -> str:
        """The word for one run."""
        return NOUNS[self.kind]


@dataclass(frozen=True, slots=True)
class Report:
    """A page of results: a title, its origin and date, and a section for each result."""

    title: str
    made_with: str
    sections: tuple[Section, ...]
    made_on: str = ""


def numbers_table(head: tuple[str, ...], rows: tuple[tuple[str, ...], ...], **also: Any) -> Table:  # noqa: ANN401 - fields
    """Return a table of texts."""
    return Table(tuple(map(Column, head)), tuple(map(Row, rows)), **also)


def plain(value: Any) -> Any:  # noqa: ANN401 - any field of the model
    """Return a part of a report as JSON holds it; infinities are ``"inf"`` and ``"-inf"``."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if hasattr(value, "__dataclass_fields__"):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return value
