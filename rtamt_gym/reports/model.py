"""`Report`: everything that the page of results shows, as plain numbers and text.

The modules ``of_*`` beside this one make sections of results, `rtamt_gym.reports.html` makes the
page. What is drawn beside requirements is in `rtamt_gym.reports.views`.

Numbers of series have six digits; times are in the unit that the section names.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from rtamt import RequirementId
from rtamt_gym.reports.views import (
    Cases,
    ComparisonView,
    Convergence,
    HeatMap,
    MethodsView,
    MutantView,
    ShownExample,
    ShownSeries,
    TraceTable,
)
from rtamt_gym.results.outcome import Moment, Word

__all__ = [
    "Counts",
    "Decision",
    "Fact",
    "Picture",
    "Report",
    "Section",
    "SectionKind",
    "ShownEpisode",
    "ShownFile",
    "ShownRequirement",
    "ShownTrial",
    "plain",
]

SectionKind = Literal["evaluation", "sweep", "search", "matrix", "comparison", "methods"]
"""What a section is about: episodes of a policy, simulations of a record, the search for a
violation, recorded traces, two evaluations side by side, or methods of learning over training
seeds."""


@dataclass(frozen=True, slots=True)
class Fact:
    """A line of the table at the head of a section, such as ``episodes`` and ``100``."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Counts:
    """How many episodes satisfied a requirement, violated it, left it open, or failed.

    A failed episode counts in ``failed`` alone; the four sum up to ``episodes``.
    """

    episodes: int
    satisfied: int
    violated: int
    undecided: int
    failed: int


@dataclass(frozen=True, slots=True)
class ShownFile:
    """A file that a result stands on.

    Attributes:
        path: Its path as it was given.
        sha256: Its SHA-256 in hexadecimal digits; empty if it is not known.
    """

    path: str
    sha256: str = ""


@dataclass(frozen=True, slots=True)
class ShownTrial:
    """What became of one requirement in one episode, simulation or trace.

    Attributes:
        label: What tells it from others: ``seed 17``, ``simulation 4`` or the name of a file.
        verdict: What became of the requirement.
        robustness: The robustness at the end; None if there is none.
        violated_at: When a violation showed, at the last sample if only the end decided it; None
            without a violation, or if nobody knows.
        duration: How long the episode was; None if nobody knows.
        reward: The sum of the environment's rewards; None for a system without.
        seed: The seed of the reset; None for a system without.
        case: What the simulation was given, a text for each entry.
        text: The error that ended it, or what else there is to say; may be empty.
        asked: How often it put the implications of the requirement to the test; None if nobody
            counted, or there are none.
        vacuous: Whether it satisfied the requirement without an answer.
        defaults: The declared defaults that it read, each as ``limit = 0.5``.
        unknown: Whether values are not known in it, so that ``asked`` counts what is certain.
        progress: How far it came in the stages of the requirement; None if that has none.
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


@dataclass(frozen=True, slots=True)
class Decision:
    """A sample that decided the robustness, as `rtamt.explain` marks it.

    Attributes:
        predicate: The text of the predicate; a key of `ShownEpisode.predicates`.
        time: When.
        values: The values of the predicate's variables then; some may be no key of
            `ShownEpisode.signals`.
        robustness: The robustness of the predicate then.
        words: The same as a sentence.
    """

    predicate: str
    time: float
    values: Mapping[str, float]
    robustness: float
    words: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of the episode.

    Attributes:
        time: When.
        source: The picture as a ``data:`` URL.
        words: What it shows, for those who do not see it.
    """

    time: float
    source: str
    words: str


@dataclass(frozen=True, slots=True)
class ShownEpisode:
    """One episode in full: signals, robustness with bounds, and what decided.

    Every series has a number for each of ``times``, or is empty if it is not known. Long episodes
    are thinned; extremes, the first and the last sample and the deciding ones stay.

    Attributes:
        label: As `ShownTrial.label`.
        verdict: What became of the requirement.
        final: The robustness at the end.
        samples: How many samples the episode has; more than ``times`` if it is thinned.
        times: The times of the samples shown, increasing.
        signals: The values of each variable and of each further recorded signal.
        robustness: The robustness, if the episode ended there.
        lower: The least robustness that was still possible.
        upper: The greatest robustness that was still possible.
        predicates: The robustness of each predicate of the requirement, by its text.
        deciding: The samples that decided.
        decided_at: The moment of the sample that decided a violation; None if none did.
        seed: As `ShownTrial.seed`.
        case: As `ShownTrial.case`.
        explanation: The way from the requirement down to the deciding sample, for a terminal;
            empty if nothing was to be explained.
        frames: Pictures, if some were kept.
        note: What the reader should know, such as that a stopped episode was played to its end;
            may be empty.
        of_instant: Whether the robustness is that of each instant, and the bounds are about all.
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


@dataclass(frozen=True, slots=True)
class ShownRequirement:
    """A requirement, and what became of it in all episodes of a section.

    Attributes:
        name: Its name.
        words: It in plain English.
        formula: It as a formula.
        counts: How many episodes satisfied it.
        rate: Satisfied over all; None where a rate has no meaning, as of a search.
        interval: The 95 % interval of the rate; None without a rate.
        robustness: The robustness of every episode that has one, least first; where there are more
            than 1000, only evenly spaced ranks.
        verdicts: What became of the requirement where it has each of these.
        quantiles: The robustness below which 5, 25, 50, 75 and 95 % of the episodes lie, by the
            text of the share (``"0.05"``); empty if no episode has one.
        first_violations: `ShownTrial.violated_at` of the violations, earliest first.
        trials: What became of it in each episode, worst first.
        left_out: How many episodes ``trials`` leaves out, which shows the worst 500.
        statistics: Numbers of the robustness that no chart shows, such as the conditional value at
            risk.
        worst: The worst episodes in full, worst first.
        note: A sentence, such as what the early end of episodes saved; may be empty.
        by_end: How many episodes are violated by how they ended, at a robustness above zero.
        id: Its id where requirements are kept, with a link; None if its text gives none.
        asked: How many episodes put it to the test, and of how many; None without implications.
        unknown: Whether values are not known in one, so that ``asked`` counts what is certain.
        vacuous: How many episodes satisfied it without an answer.
        defaults: How many episodes read each of the declared defaults, as ``limit = 0.5``.
        answer: What sequential stopping has said of its rate; None without a target.
        together: Whether it stands for all requirements of its section at once.
        examples: Traces that satisfy it and violate it, to read beside its words.
        more_examples: How many further ones there are.
    """

    name: str
    words: str
    formula: str
    counts: Counts
    rate: float | None
    interval: tuple[float, float] | None
    robustness: ShownSeries
    verdicts: tuple[Word, ...]
    quantiles: Mapping[str, float]
    first_violations: ShownSeries
    trials: tuple[ShownTrial, ...]
    left_out: int = 0
    statistics: tuple[Fact, ...] = ()
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
    examples: tuple[ShownExample, ...] = ()
    more_examples: int = 0


@dataclass(frozen=True, slots=True)
class Section:
    """One result.

    Attributes:
        kind: What it is about.
        title: Its title.
        system: The name of the system; may be empty.
        policy: The name of the policy; may be empty.
        unit: The unit of times: ``"s"``, or ``"steps"`` if there is no period.
        replay: The command that plays an episode again, with ``{seed}`` in the place of its seed;
            empty if there is none.
        facts: The table at its head.
        notes: Sentences about the whole.
        requirements: The requirements; empty of a comparison.
        returns: The sum of the rewards of every episode, least first; empty without.
        durations: How long the episodes were, shortest first; empty if not known.
        maps: The maps of a sweep on a grid.
        cases: The points of a sweep or a search.
        convergence: The course of a search, for each requirement.
        comparison: The comparison, if the section is about one.
        methods: The methods of learning, if the section is about some.
        matrix: The recorded traces, if the section is about some.
        mutants: What these notice of the mutants of the requirements; None if none were made.
        source: The file of the result; None if it was an object.
        files: The files that it was made of: specifications, models, traces.
        versions: The versions of Python and packages that made it.
        not_played: The error for which a saved case was not played again; else empty.
    """

    kind: SectionKind
    title: str
    system: str = ""
    policy: str = ""
    unit: str = "s"
    replay: str = ""
    facts: tuple[Fact, ...] = ()
    notes: tuple[str, ...] = ()
    requirements: tuple[ShownRequirement, ...] = ()
    returns: ShownSeries = ()
    durations: ShownSeries = ()
    maps: tuple[HeatMap, ...] = ()
    cases: Cases | None = None
    convergence: tuple[Convergence, ...] = ()
    comparison: ComparisonView | None = None
    methods: MethodsView | None = None
    matrix: TraceTable | None = None
    mutants: MutantView | None = None
    source: ShownFile | None = None
    files: tuple[ShownFile, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    not_played: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """A page of results.

    Attributes:
        title: Its title.
        made_with: What made it, such as ``rtamt 0.5.0``.
        sections: The results.
        made_on: When it was made; may be empty.
    """

    title: str
    made_with: str
    sections: tuple[Section, ...]
    made_on: str = ""

    def plain(self) -> dict[str, Any]:
        """The report as dicts, lists, numbers and texts; infinities are ``"inf"`` and ``"-inf"``.

        Example:
            >>> Report("Runs", "rtamt", (Section("sweep", "Tank"),)).plain()["sections"][0]["kind"]
            'sweep'
        """
        found: dict[str, Any] = plain(self)
        return found

    def to_json(self) -> str:
        """`plain` as strict JSON on one line."""
        return json.dumps(self.plain(), allow_nan=False, separators=(",", ":"), ensure_ascii=False)


def plain(value: Any) -> Any:  # noqa: ANN401 - any field of the model
    """Parts of a report as dicts, lists, numbers and texts, which strict JSON can say."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if hasattr(value, "__dataclass_fields__"):
        return {each.name: plain(getattr(value, each.name)) for each in fields(value)}
    return value
