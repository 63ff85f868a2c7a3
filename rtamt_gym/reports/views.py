"""What sections show beside their requirements: maps, points, convergence, comparisons, traces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rtamt import RequirementId
from rtamt_gym.results.mutation import MutationScore
from rtamt_gym.results.outcome import Word

__all__ = [
    "Band",
    "Cases",
    "Cell",
    "ComparedRequirement",
    "ComparisonView",
    "Convergence",
    "Curve",
    "HeatMap",
    "MethodRow",
    "MethodsView",
    "MutantView",
    "ShownExample",
    "ShownSeries",
    "TraceLine",
    "TraceTable",
]

ShownSeries = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Band:
    """A signal of an example, as lines of an SVG that is 100 wide and 36 high.

    Attributes:
        name: Its name.
        line: Its values in steps.
        dots: Its samples; empty where there are many.
        levels: A line for each number that it is compared with.
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


@dataclass(frozen=True, slots=True)
class ShownExample:
    """A trace that shows something about a requirement.

    Attributes:
        verdict: What the requirement is on it.
        robustness: The robustness on it; None of a trace that repeats for ever.
        why: What it shows.
        length: How long it is, with its unit.
        bands: Its signals.
        repeats: How much of its end, from 0 to 100, repeats for ever.
        loop: The same in words; empty if nothing does.
        steady: Further signals, which do not change, with their values.
        head: The head of its table.
        rows: A row for each run of equal samples.
    """

    verdict: Word
    robustness: float | None
    why: str
    length: str
    bands: tuple[Band, ...]
    repeats: float
    loop: str
    steady: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class HeatMap:
    """The robustness of a requirement over a grid of two columns.

    Attributes:
        requirement: The name of the requirement.
        x: The column to the right, with its unit if it has one.
        y: The column upwards.
        xs: The numbers of x, increasing.
        ys: The numbers of y, increasing.
        cells: A row for each of ys, with the robustness for each of xs; None where the simulation
            failed.
        verdicts: A row for each of ys, with the worst word of each cell.
        folded: Whether a cell is the least of several simulations.
    """

    requirement: str
    x: str
    y: str
    xs: ShownSeries
    ys: ShownSeries
    cells: tuple[tuple[float | None, ...], ...]
    verdicts: tuple[tuple[Word, ...], ...]
    folded: bool


@dataclass(frozen=True, slots=True)
class Cases:
    """What the simulations were given and what came of it, to draw over one column or two.

    Every sequence has an entry for each simulation.

    Attributes:
        labels: As `ShownTrial.label`.
        columns: The numbers of each column that varies.
        robustness: The robustness by name of the requirement; None where it failed.
        verdicts: The verdicts by name of the requirement.
        left_out: How many simulations are not in it: of more than 2000 the worst and evenly spaced
            others are.
    """

    labels: tuple[str, ...]
    columns: Mapping[str, ShownSeries]
    robustness: Mapping[str, tuple[float | None, ...]]
    verdicts: Mapping[str, tuple[Word, ...]]
    left_out: int = 0


@dataclass(frozen=True, slots=True)
class Convergence:
    """The robustness of a requirement over the simulations of a search.

    Attributes:
        requirement: The name of the requirement.
        simulations: The numbers of the simulations, from 1.
        robustness: The robustness of each; None where it failed.
        verdicts: What became of the requirement in each.
        least: The least up to each; None before the first.
    """

    requirement: str
    simulations: tuple[int, ...]
    robustness: tuple[float | None, ...]
    verdicts: tuple[Word, ...]
    least: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class ComparedRequirement:
    """One requirement under two policies, A and B.

    Attributes:
        name: Its name.
        words: It in plain English.
        formula: It as a formula.
        sentence: What the comparison says about it.
        rate_a: The rate of A.
        rate_b: The rate of B.
        interval_a: Its 95 % interval.
        interval_b: Its 95 % interval.
        difference: The rate of B minus the rate of A.
        interval: The 95 % interval of the difference.
        p: The probability of so great a difference, or a greater one, if there were none (McNemar).
        both: Pairs of episodes in which both satisfy it.
        only_a: Pairs of episodes in which A alone does.
        only_b: Pairs of episodes in which B alone does.
        neither: Pairs of episodes in which neither does.
        robustness: The mean robustness of B minus A's; None if it is not known.
        robustness_interval: Its 95 % interval (bootstrap).
        pairs: The robustness of A and of B in each pair, for a scatter.
        id: As `ShownRequirement.id`.
        examples: As `ShownRequirement.examples`.
        more_examples: As `ShownRequirement.more_examples`.
    """

    name: str
    words: str
    formula: str
    sentence: str
    rate_a: float
    rate_b: float
    interval_a: tuple[float, float]
    interval_b: tuple[float, float]
    difference: float
    interval: tuple[float, float]
    p: float
    both: int
    only_a: int
    only_b: int
    neither: int
    robustness: float | None = None
    robustness_interval: tuple[float, float] | None = None
    pairs: tuple[tuple[float, float], ...] = ()
    id: RequirementId | None = None
    examples: tuple[ShownExample, ...] = ()
    more_examples: int = 0


@dataclass(frozen=True, slots=True)
class ComparisonView:
    """Two evaluations of the same requirements, side by side.

    Attributes:
        a: What A is.
        b: What B is.
        sentence: What the comparison says.
        requirements: Each requirement.
    """

    a: str
    b: str
    sentence: str
    requirements: tuple[ComparedRequirement, ...]


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve with a band, as numbers at places that several curves share.

    Attributes:
        name: What it is of.
        values: The curve.
        low: The lower end of the band.
        high: The upper end.
    """

    name: str
    values: ShownSeries
    low: ShownSeries
    high: ShownSeries


@dataclass(frozen=True, slots=True)
class MethodRow:
    """A method over its training seeds.

    Attributes:
        name: Its name.
        runs: How many runs it has.
        mean: The mean of their scores.
        mean_interval: Its interval.
        middle: The interquartile mean.
        middle_interval: Its interval.
        quartiles: The least score, the quartiles and the greatest.
        improvement: The chance that a run scores above one of the baseline; None of the baseline.
        improvement_interval: Its interval.
        p: The adjusted p-value against the baseline.
    """

    name: str
    runs: int
    mean: float
    mean_interval: tuple[float, float]
    middle: float
    middle_interval: tuple[float, float]
    quartiles: ShownSeries
    improvement: float | None = None
    improvement_interval: tuple[float, float] | None = None
    p: float | None = None


@dataclass(frozen=True, slots=True)
class MethodsView:
    """Methods of learning, beside each other.

    Attributes:
        score: What a score is called.
        baseline: The method with which the others are compared.
        sentence: What the comparison says.
        rows: Each method.
        steps: The steps of training at which the points of ``curves`` lie.
        curves: The means over training, of each method; empty if they are not known.
        thresholds: The scores at which the points of ``profiles`` lie.
        profiles: The share of runs above each threshold, of each method.
    """

    score: str
    baseline: str
    sentence: str
    rows: tuple[MethodRow, ...]
    steps: ShownSeries
    curves: tuple[Curve, ...]
    thresholds: ShownSeries
    profiles: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Cell:
    """The outcome of one requirement on one trace."""

    verdict: Word
    robustness: float | None


@dataclass(frozen=True, slots=True)
class TraceLine:
    """A line of a `TraceTable`: a trace with a cell for each requirement.

    Attributes:
        name: The name of the trace.
        verdict: The worst of its verdicts.
        described: The number of its samples, and its times; may be empty.
        cells: A cell for each requirement.
        notes: What was read otherwise than it is written.
    """

    name: str
    verdict: Word
    described: str
    cells: tuple[Cell, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TraceTable:
    """Recorded traces under requirements.

    Attributes:
        requirements: The names of the columns.
        traces: A line for each trace, in their order; of more than 500 the worst.
        left_out: How many traces are not among them.
    """

    requirements: tuple[str, ...]
    traces: tuple[TraceLine, ...]
    left_out: int = 0


@dataclass(frozen=True, slots=True)
class MutantView:
    """What recorded traces notice of the mutants of requirements.

    Attributes:
        scores: The score of each requirement, by name.
        least: The share that was asked for; None: none.
    """

    scores: Mapping[str, MutationScore]
    least: float | None = None

    @property
    def below(self) -> list[str]:
        """The requirements of which less than the share that was asked for is noticed."""
        least = 0.0 if self.least is None else self.least
        shares = {name: score.share for name, score in self.scores.items()}
        return [name for name, share in shares.items() if share is not None and share < least]
