"""An artificial report with a section of every kind, for tests of the page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from rtamt import Verdict
from rtamt.checking import Answer, Example, ExampleTrace, RequirementExamples
from rtamt_gym.reports.examples import with_examples
from rtamt_gym.reports.figures import (
    cases_figure,
    convergence_figure,
    map_figure,
    pairs_figure,
)
from rtamt_gym.reports.model import (
    Cell,
    Column,
    Decision,
    Facts,
    Figure,
    Picture,
    Report,
    Requirement,
    Row,
    Section,
    ShownEpisode,
    Table,
    Text,
    TrialRow,
    numbers_table,
)
from rtamt_gym.reports.requirements import worst_first
from rtamt_gym.results.outcome import Moment, Word

_PIXEL = (
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGA"
    "WjR9awAAAABJRU5ErkJggg=="
)
"""The smallest picture."""

_TIMES = tuple(round(0.02 * i, 2) for i in range(101))
_ANGLE = tuple(round(0.25 * math.sin(3 * time) * time, 6) for time in _TIMES)
_MARGIN = tuple(round(0.2 - abs(angle), 6) for angle in _ANGLE)
_SO_FAR = tuple(min(_MARGIN[: i + 1]) for i in range(101))
_WORST = min(range(101), key=lambda i: _MARGIN[i])
_AT = next(time for time, margin in zip(_TIMES, _MARGIN, strict=True) if margin < 0)

_EPISODE = ShownEpisode(
    label="seed 17",
    verdict="violated",
    final=_MARGIN[_WORST],
    samples=101,
    times=_TIMES,
    signals={"angle": _ANGLE, "position": tuple(round(time / 4, 6) for time in _TIMES)},
    robustness=_SO_FAR,
    lower=(-math.inf,) * 101,
    upper=_SO_FAR,
    predicates={"abs(angle) < 0.2": _MARGIN},
    deciding=(
        Decision(
            "abs(angle) < 0.2",
            _TIMES[_WORST],
            {"angle": _ANGLE[_WORST]},
            _MARGIN[_WORST],
            f"abs(angle) < 0.2 is {_MARGIN[_WORST]:.4g} at {_TIMES[_WORST]:g} s",
        ),
    ),
    decided_at=Moment(round(_AT / 0.02), _AT),
    explanation=f"robustness {_MARGIN[_WORST]:.4g} at 0 s, decided by abs(angle) < 0.2",
    frames=(
        Picture(0.0, _PIXEL, "the pole at 0 s"),
        Picture(_AT, _PIXEL, f"the pole at {_AT:g} s"),
    ),
)

_FAILED = TrialRow(
    "seed 4", "failed", seed=4, duration=0.4, text="ValueError: the simulator stopped"
)
_NOTE = "2 episodes that ended at their violation saved 16.2 simulated seconds"


def _seeds(
    verdict: Word, robustness: Sequence[float], seeds: Sequence[int], duration: float
) -> Iterator[TrialRow]:
    for seed, value in zip(seeds, robustness, strict=True):
        yield TrialRow(f"seed {seed}", verdict, value, None, duration, 50 * duration, seed)


_UPRIGHT = Requirement(
    "upright",
    "at all times, the absolute value of angle is less than 0.2",
    "always(abs(angle) < 0.2)",
    (
        _FAILED,
        TrialRow(
            "seed 17", "violated", _MARGIN[_WORST], Moment(round(_AT / 0.02), _AT), 2.0, 61.0, 17
        ),
        TrialRow("seed 9", "violated", -0.05, Moment(95, 1.9), 2.0, 96.0, 9),
        *_seeds(
            "satisfied",
            [0.01 * i for i in range(1, 18)],
            [i for i in range(20) if i not in (4, 9, 17)],
            2.0,
        ),
    ),
    worst=(_EPISODE,),
    rate=0.85,
    interval=(0.6395894, 0.9476195),
    note=_NOTE,
)

_CENTRED = Requirement(
    "centred",
    "within the first 2 s, position is at least 0.1 at some time",
    "eventually[0:2](position >= 0.1)",
    (
        _FAILED,
        *_seeds("undecided", [-math.inf, 0.02, 0.04, 0.06], [3, 5, 6, 7], 0.4),
        *_seeds(
            "satisfied",
            [*(0.02 * i for i in range(4, 18)), math.inf],
            [i for i in range(20) if i not in (3, 4, 5, 6, 7)],
            2.0,
        ),
    ),
    rate=0.75,
    interval=(0.531299, 0.888138),
)


_EVALUATION = Section(
    kind="evaluation",
    title="CartPole-v1 under model.zip",
    system="CartPole-v1",
    policy="sb3:model.zip",
    replay="rtamt run CartPole-v1 --policy sb3:model.zip --seed {seed}",
    facts=(("episodes", "20"), ("seeds", "0 to 19"), ("period", "0.02 s")),
    notes=("The test has decided after 20 of 200 episodes: the rate is below 0.95.",),
    requirements=(_UPRIGHT, _CENTRED),
    returns=(61.0, 96.0, *(100.0,) * 17),
    durations=(0.4, *(2.0,) * 19),
)

_GRID = (0.1, 0.2, 0.3)
_CELLS = ((1.0, 0.135, -0.73), (1.0, 0.682, 0.046), (1.0, 1.0, None))
_WORDS: tuple[tuple[Word, ...], ...] = (
    ("satisfied", "satisfied", "violated"),
    ("satisfied", "satisfied", "undecided"),
    ("satisfied", "satisfied", "failed"),
)


def _dry(trials: Sequence[TrialRow], *figures: Figure) -> Requirement:
    worst = replace(_EPISODE, label="simulation 3", case=("inflow = 0.3",), frames=())
    return Requirement(
        "dry",
        "at all times, level is less than 2",
        "always(level < 2)",
        tuple(trials),
        worst=(worst,),
        figures=figures,
    )


_CASES: dict[str, Any] = {
    "labels": tuple(f"simulation {i + 1}" for i in range(9)),
    "columns": {"inflow": _GRID * 3, "leak": (0.1, 0.1, 0.1, 0.15, 0.15, 0.15, 0.2, 0.2, 0.2)},
    "robustness": {"dry": tuple(cell for cells in _CELLS for cell in cells)},
    "verdicts": {"dry": ("satisfied", "satisfied", "violated", *("satisfied",) * 5, "failed")},
}
_TANKS = sorted(
    (
        TrialRow(label, word, value, Moment(11, 11.0) if word == "violated" else None, 19.0)
        for label, word, value in zip(
            _CASES["labels"],
            _CASES["verdicts"]["dry"],
            _CASES["robustness"]["dry"],
            strict=True,
        )
    ),
    key=worst_first,
)
_TANKS[1] = replace(_TANKS[1], case=("inflow = 0.3", "leak = 0.1"))

_POINTS = cases_figure(_CASES, "dry", 0)
_MAP = map_figure(
    "dry", ("inflow", "leak"), (_GRID, (0.1, 0.15, 0.2)), _CELLS, _WORDS, folded=False
)
_COURSE = convergence_figure(
    "dry",
    (1, 2, 3, 4, 5),
    (0.9, 1.0, 0.4, None, -0.73),
    ("satisfied", "satisfied", "undecided", "failed", "violated"),
    (0.9, 0.9, 0.4, 0.4, -0.73),
)

_SWEEP = Section(
    kind="sweep",
    title="tank over inflow and leak",
    system="tank",
    unit="steps",
    facts=(("simulations", "9"), ("sampler", "grid")),
    requirements=(_dry(_TANKS, _MAP, _POINTS),),
    durations=(19.0,) * 9,
    cases=_CASES,
)

_SEARCH = Section(
    kind="search",
    title="search for a violation of dry",
    system="tank",
    unit="steps",
    facts=(("optimizer", "portfolio"), ("budget", "300"), ("seed", "0")),
    notes=("dry is violated in simulation 5 of at most 300.", "The case was made simpler."),
    requirements=(_dry(_TANKS[1:6], _COURSE, _POINTS),),
    cases=_CASES,
)


def _line(name: str, verdict: Word, robustness: str, *notes: str) -> Row:
    cell = Cell(robustness, f"n cell {verdict}", verdict=verdict)
    return Row((Cell(name, muted=notes), Cell(verdict=verdict), cell), verdict=verdict)


_TIMELINE = Figure(
    "timeline",
    "All violations",
    "runs/b.csv: 2 violations, 3 s in all; the longest starts at 4 s and lasts 2 s.",
    144,
    {
        "bodies": (
            {
                "text": "level < 5",
                "runs": (
                    (4.0, 6.0, "violated", "\N{MINUS SIGN}0.5"),
                    (8.0, 9.0, "violated", "\N{MINUS SIGN}0.1"),
                    (9.0, 10.0, "undecided", ""),
                ),
            },
        ),
        "span": (0.0, 10.0),
        "unit": "s",
    },
    numbers_table(
        ("body", "start (s)", "end (s)"),
        (("level < 5", "4", "6"), ("level < 5", "8", "9")),
    ),
    wide=True,
    words=("violated", "undecided"),
)

_MATRIX = Section(
    kind="matrix",
    title="3 traces",
    facts=(("end", "cut"), ("semantics", "standard")),
    requirements=(
        _dry(
            (
                TrialRow("runs/c.csv", "failed", text="there is no column 'level'"),
                TrialRow("runs/b.csv", "violated", -0.5, Moment(4, 4.0)),
                TrialRow("runs/a.csv", "satisfied", 1.0),
            ),
            _TIMELINE,
        ),
    ),
    blocks=(
        Table(
            (Column("trace"), Column("verdict"), Column("dry", "n", "dry")),
            (
                _line("runs/a.csv", "satisfied", "1", "101 samples"),
                _line("runs/b.csv", "violated", "\N{MINUS SIGN}0.5", "101 samples"),
                _line("runs/c.csv", "failed", "", "resampled"),
            ),
            "Traces and requirements",
            "Robustness of each requirement on each trace",
            "matrix",
        ),
        Text("2 traces more not listed.", "muted left-out"),
    ),
)

_OF_A, _OF_B = (0.02786648, 0.3010336), (0.6395894, 0.9476195)
_SENTENCE = "B satisfies upright more often than A, by 75 points (95 % interval 49 to 88)."
_COMPARED = Requirement(
    name="upright",
    words=_UPRIGHT.words,
    formula=_UPRIGHT.formula,
    rate=0.75,
    interval=(0.49, 0.88),
    legend="A 10 %, B 85 %",
    blocks=(
        Text("B satisfies upright in 85 % and A in 10 % of 20 paired episodes.", "sentence"),
        Table(
            (Column(""), Column("rate", "n"), Column("95 % interval")),
            (
                Row(
                    (
                        "A",
                        Cell("10 %", "n"),
                        Cell("3 to 30 %", interval=(0.1, (0.02786648, 0.3010336), 0)),
                    )
                ),
                Row(
                    (
                        "B",
                        Cell("85 %", "n"),
                        Cell("64 to 95 %", interval=(0.85, (0.6395894, 0.9476195), 0)),
                    )
                ),
                Row(
                    (
                        "B less A",
                        Cell("+75 points", "n"),
                        Cell("49 to 88 points", interval=(0.75, (0.49, 0.88), -1)),
                    ),
                    style="difference",
                ),
                Row(("mean robustness, B less A", Cell("+0.31", "n"), "0.2 to 0.4")),
            ),
            "Rates of upright",
            style="rates",
        ),
    ),
    figures=(
        Table(
            (Column(""), Column("B satisfies", "n"), Column("B does not", "n")),
            (
                Row(("A satisfies", Cell("2", "n"), Cell("0", "n"))),
                Row(("A does not", Cell("15", "n"), Cell("3", "n"))),
            ),
            "Pairs of upright",
            "Pairs of episodes, p < 0.001 (McNemar)",
            "pairs",
        ),
        *pairs_figure([(-0.3 + 0.01 * i, 0.01 * i) for i in range(20)]),
    ),
)

_COMPARISON = Section(
    kind="comparison",
    title="model.zip against random",
    system="CartPole-v1",
    facts=(("pairs", "20"), ("seeds", "0 to 19")),
    lead=Text("A: random. B: model.zip.", "words"),
    blocks=(
        Text(_SENTENCE, "sentence"),
        Facts((("A", "random", ""), ("B", "model.zip", ""))),
    ),
    requirements=(_COMPARED,),
)

_HELD = (0.0,) * 100
_EXAMPLES = {
    "upright": RequirementExamples(
        _UPRIGHT.formula,
        Fraction(1, 50),
        Answer("yes"),
        Answer("yes"),
        (
            Example(
                ("satisfied",),
                "a trace that <i>satisfies</i> it",
                Verdict.SATISFIED,
                0.2,
                ExampleTrace({"angle": _HELD}, 100, 0),
            ),
            Example(
                ("violated",),
                "the shortest violation; abs(angle) < 0.2 fails by a margin that is told at length",
                Verdict.VIOLATED,
                -math.inf,
                ExampleTrace({"angle": (0.0, 0.25, -0.25)}, 3, 0),
            ),
            Example(
                ("threshold",),
                "exactly at its threshold, again and again",
                Verdict.VIOLATED,
                None,
                ExampleTrace({"angle": (0.19, 0.2, -0.2, 0.0)}, 4, 2),
            ),
            *(
                Example(
                    ("violated",),
                    f"one more, {place}",
                    Verdict.VIOLATED,
                    -0.1,
                    ExampleTrace({"angle": (0.3,) * place}, place, 0),
                )
                for place in (1, 2, 3)
            ),
        ),
    ),
}

EXAMPLE = Report(
    "Pole and tank <b>&amp;</b> more",
    "rtamt 0.5.0",
    with_examples((_EVALUATION, _SWEEP, _SEARCH, _MATRIX, _COMPARISON), [_EXAMPLES]),
)
"""A report with a section of every kind, examples, infinities, failures, texts to be escaped."""
