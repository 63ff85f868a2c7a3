"""The content of the results page: sections of requirements, and blocks of five kinds.

A block is `Facts`, `Text`, `Table`, `Figure` or `ShownEpisode`; each has one template in ``page/``.
Numbers of series have six digits; times are in the unit of their section.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
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
    """Names with their values."""

    rows: tuple[tuple[str, str, str], ...]  # name, value, and a remark, which may be empty
    style: str = ""  # further classes of the list


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph; names in backticks are shown as code."""

    text: str
    style: str = "note"


class Column(NamedTuple):
    """The head of a column."""

    text: str
    style: str = ""  # its classes; "n" is a column of numbers
    requirement: str = ""  # for the filter of the page
    sortable: bool = True


class Cell(NamedTuple):
    """A cell with more than a text."""

    text: str = ""
    style: str = ""
    value: float | None = None  # the sort key of the column
    verdict: Word | None = None  # a sign before the text with a style, a badge without
    muted: tuple[str, ...] = ()  # remarks after the text
    codes: tuple[str, ...] = ()  # pieces of code after the text
    link: str = ""  # the id on the page that the text links to
    copied: tuple[str, str] | None = None  # a text that a button copies, and the button's label
    interval: tuple[float, tuple[float, float], float] | None = None  # number, ends, axis minimum


class Row(NamedTuple):
    """A row of a table; its first cell is its head."""

    cells: tuple[str | Cell, ...]
    id: str = ""
    verdict: str = ""  # for the filter of the page
    style: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table."""

    head: tuple[Column, ...]
    rows: tuple[Row, ...]
    label: str = "Numbers of the chart"  # for screen readers
    caption: str = ""  # the text above it
    style: str = ""
    labelled: str = ""  # the id of the element that labels it, in place of label


@dataclass(frozen=True, slots=True)
class Figure:
    """A chart that the script draws."""

    kind: str  # the function of the script that draws it
    title: str
    summary: str  # a description in a sentence or two
    height: int  # in pixels
    data: Mapping[str, Any]  # for the script
    table: Table | None = None  # its numbers, unless they are elsewhere on the page
    wide: bool = False
    words: tuple[Word, ...] = ()  # the verdicts of its legend
    id: str = ""


@dataclass(frozen=True, slots=True)
class Decision:
    """A sample that decided the robustness, as `rtamt.explain` marks it."""

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
    """

    label: str
    verdict: Word
    final: float  # the robustness at the end
    samples: int  # more than there are times if the episode is thinned
    times: ShownSeries
    signals: Mapping[str, ShownSeries]
    robustness: ShownSeries = ()  # if the episode ended there
    lower: ShownSeries = ()
    upper: ShownSeries = ()
    predicates: Mapping[str, ShownSeries] = field(default_factory=dict)
    deciding: tuple[Decision, ...] = ()
    decided_at: Moment | None = None
    case: tuple[str, ...] = ()
    explanation: str = ""
    frames: tuple[Picture, ...] = ()
    of_instant: bool = False  # the robustness is about each instant, its bounds about the episode
    figure: Figure | None = None  # the plot, once the page is laid out
    id: str = ""


Block = Facts | Text | Table | Figure | ShownEpisode


@dataclass(frozen=True, slots=True)
class TrialRow:
    """The outcome of one requirement in one episode, simulation or trace."""

    label: str  # as seed 17, simulation 4, or the name of a file
    verdict: Word
    robustness: float | None = None
    violated_at: Moment | None = None
    duration: float | None = None
    reward: float | None = None
    seed: int | None = None
    case: tuple[str, ...] = ()
    text: str = ""  # its error, or another remark
    asked: int | None = None  # the number of triggers; None without implications or a count
    vacuous: bool = False
    defaults: tuple[str, ...] = ()
    unknown: bool = False  # only certain triggers count
    progress: float | None = None


class Band(NamedTuple):
    """A signal of an example, as paths of an SVG that is 100 wide and 36 high."""

    name: str
    line: str  # its values in steps
    dots: str  # its samples, if there are few
    levels: tuple[str, ...]  # a line for each number that it is compared with
    compared: str  # these numbers
    low: str
    high: str


class ShownExample(NamedTuple):
    """A trace that shows something about a requirement."""

    verdict: Word
    robustness: float | None
    why: str
    length: str
    bands: tuple[Band, ...]
    repeats: float  # the percentage of its end that repeats for ever
    loop: str  # the same in words
    steady: str  # further, constant signals with their values
    table: Table


TRIALS: Final = 500
"""The maximum number of trials of a requirement that are shown."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A requirement, and its outcomes in all trials of a section, the worst first."""

    name: str
    words: str
    formula: str
    trials: tuple[TrialRow, ...] = ()
    rate: float | None = None  # None if it has no meaning; of B minus A in a comparison
    interval: tuple[float, float] | None = None
    blocks: tuple[Block, ...] = ()  # at the head
    figures: tuple[Figure | Table, ...] = ()
    worst: tuple[ShownEpisode, ...] = ()
    note: str = ""
    id: RequirementId | None = None
    answer: Word | None = None  # of sequential stopping about its rate
    together: bool = False  # whether it stands for all requirements of its section
    legend: str = ""  # the rates of both sides of a comparison
    examples: tuple[ShownExample, ...] = ()
    more_examples: int = 0
    place: str = ""  # its id on the page
    key: int | str = ""  # its number in every section
    table: Table | None = None  # of its trials, once the page is laid out

    @property
    def counts(self) -> Counter[Word]:
        """The number of trials with each outcome."""
        return Counter(trial.verdict for trial in self.trials)

    @property
    def lowest(self) -> float | None:
        """The minimum robustness, if a trial has any."""
        return min((t.robustness for t in self.trials if t.robustness is not None), default=None)

    @property
    def triggers(self) -> list[int]:
        """The numbers of triggers, if they were counted."""
        return [trial.asked for trial in self.trials if trial.asked is not None]

    @property
    def unknown(self) -> bool:
        """Whether values are unknown, so that only certain triggers count."""
        return any(trial.unknown for trial in self.trials if trial.asked is not None)

    @property
    def defaults(self) -> Counter[str]:
        """The number of trials that read each declared default, as ``limit = 0.5``."""
        return Counter(text for trial in self.trials for text in trial.defaults)

    @property
    def left_out(self) -> int:
        """The number of trials that the page does not list."""
        return max(0, len(self.trials) - TRIALS)


@dataclass(frozen=True, slots=True)
class Section:
    """One result."""

    kind: SectionKind
    title: str
    system: str = ""
    policy: str = ""
    unit: str = "s"  # of times: "steps" without a period
    replay: str = ""  # the command that replays an episode, with {seed} for its seed
    facts: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    lead: Text | None = None  # at the glance
    blocks: tuple[Block, ...] = ()  # above the requirements
    figures: tuple[Figure | Table, ...] = ()  # below the blocks
    requirements: tuple[Requirement, ...] = ()
    returns: ShownSeries = ()  # in order
    durations: ShownSeries = ()
    cases: Mapping[str, Any] | None = None  # labels, columns, robustness and verdicts of points
    mutants: Mapping[str, MutationScore] | None = None
    min_share: float | None = None  # the required share of killed mutants
    source: tuple[str, str] | None = None  # the path and the SHA-256 of its file
    files: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    charts: bool = True  # of the trials of its requirements
    not_played: str = ""  # the error that prevented the replay of a saved case
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
