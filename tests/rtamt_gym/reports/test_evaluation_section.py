"""The section of an evaluation shows its numbers and its worst episodes."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from made_results import evaluation, figures, row, wave

from rtamt import Verdict, evaluate
from rtamt_gym.reports.evaluations import of_evaluation
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Report
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.simulations import of_record
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import RunEnd

ROWS = [
    row({"low": 1.0, "seen": -1.0}, seed=7, at=1.0, reward=5.0),
    row({"low": -2.0, "seen": 3.0}, seed=8, at=0.4, reward=4.0),
    row({"low": -3.0, "seen": 0.5}, seed=9, at=1.5, reward=3.0),
    row({}, seed=10, error="ValueError: it broke"),
    row({"low": 2.0, "seen": 1.0}, seed=11, reward=2.0),
]


def test_section_matches_rows() -> None:
    section = of_evaluation(evaluation(ROWS, {}), ROOM)
    low, seen, every = section.requirements
    assert (low.name, seen.name, every.name) == ("low", "seen", "all requirements")
    assert low.counts == {"satisfied": 2, "violated": 2, "failed": 1}
    assert (seen.counts["satisfied"], seen.counts["undecided"], len(seen.trials)) == (2, 1, 5)
    assert (every.counts["satisfied"], every.counts["violated"]) == (1, 3)
    assert low.rate == 0.4
    assert low.interval == pytest.approx((0.052745, 0.853367), abs=1e-6)  # by tables
    assert low.lowest == -3.0
    assert "Median \N{MINUS SIGN}2, " in figures(section, "histogram")[0].summary
    assert figures(section, "violations")[0].data["times"] == (0.4, 1.5)
    assert [trial.label for trial in low.trials] == [f"seed {i}" for i in (10, 9, 8, 7, 11)]
    assert low.trials[0].text == "ValueError: it broke"
    assert [each.violated_at and each.violated_at.time for each in every.trials] == [
        *(None, 1.5, 0.4, 1.0, None)
    ]
    assert section.returns == (2.0, 3.0, 4.0, 5.0)
    assert low.words == "x0 stays below 5 at all times"
    assert seen.words == "x1 gets above 0.5 within the first 1 s"
    facts = dict(section.facts)
    assert facts["seeds"] == "7 to 11"
    assert facts["period"] == "0.1 s"
    assert section.replay.format(seed=8) == "evaluation.replay(8)"


def test_episode_in_full() -> None:
    run = wave(50)
    section = of_evaluation(evaluation(ROWS, {"low": (run,)}), ROOM)
    (episode,) = section.requirements[0].worst
    assert episode.samples == len(episode.times) == 50
    np.testing.assert_allclose(episode.times, run.times)
    np.testing.assert_allclose(episode.signals["x1"], run.signals["x1"])
    np.testing.assert_allclose(episode.upper, run.histories["low"].upper, rtol=1e-5)
    margins = evaluate("x0 < 5", run.signals, 0.1)
    np.testing.assert_allclose(episode.predicates["x0 < 5"], margins, rtol=1e-5)
    (decision,) = episode.deciding
    place = int(margins.argmin())
    assert decision.time == pytest.approx(run.times[place])
    assert decision.values == {"x0": 9.0}
    assert decision.robustness == episode.final == -4.0
    assert decision.words == "x0 < 5 decided at 1.6 s, where x0 is 9"
    assert episode.decided_at == Moment(16, 1.6)
    assert episode.verdict == "violated"


def test_size_of_evaluation_page() -> None:
    heights = np.random.default_rng(0).normal(size=100)
    rows = [row({"low": h, "seen": -h}, seed=7 + i, at=1.0) for i, h in enumerate(heights)]
    long = wave(6000, signals=12)
    short = wave(20)
    runs = {"low": (long,) * 10, "seen": (short,) * 10}
    section = of_evaluation(evaluation(rows, runs), ROOM)
    (data,) = re.findall(
        '<script type="application/json" id="data">(.*?)</script>',
        render(Report("many", "rtamt", (section,))),
    )
    assert 100_000 < len(data) < 700_000
    (episode, *_) = section.requirements[0].worst
    assert episode.samples == 6000
    assert 60 <= len(episode.times) < 400
    assert max(episode.signals["x0"]) == 9.0
    assert {d.time for d in episode.deciding} <= set(episode.times)
    assert len(section.requirements[1].worst[0].times) == 20


def test_steps_without_period() -> None:
    made = evaluation(ROWS, {})
    steps = type(made)(made.record, "Waves-v0", "random", None, None, 7)
    section = of_evaluation(steps, ROOM)
    assert section.unit == "steps"
    assert section.requirements[1].words == "x1 gets above 0.5 within the first 1 step"
    assert not math.isnan(section.durations[0])


def test_decision_of_sequential_stopping() -> None:
    made = evaluation(ROWS, {})
    decided = type(made)(
        *(made.record, "Waves-v0", "random", None, None, 7),
        {"low": "falls short of 0.9", "seen": "known to 0.05"},
    )
    assert of_evaluation(decided, ROOM).notes == (
        "Sequential stopping after 5 episodes: the rate of low falls short of 0.9.",
        "Sequential stopping after 5 episodes: the rate of seen is known to 0.05.",
    )


@pytest.mark.parametrize(
    ("violated", "words"),
    [
        ([1.0, -2.0, -0.1], "2 of 4 episodes below zero, 1 violated by how it ended. "),
        ([0.1, 1.0, math.inf], "0 of 4 episodes below zero, 3 violated by how they ended. "),
        ([-1.0, -math.inf, -0.1], "3 of 4 episodes below zero. "),
    ],
)
def test_violations_by_end_are_noted(violated: list[float], words: str) -> None:
    rows = [row({"low": 3.0, "seen": 3.0}, seed=7)]
    for seed, height in enumerate(violated, 8):
        outcome = Outcome(height, height, height, Verdict.VIOLATED, Moment(20, 2.0))
        rows.append(replace(rows[0], seed=seed, outcomes={"low": outcome, "seen": outcome}))
    section = of_evaluation(evaluation(rows, {}), ROOM)
    assert len(section.requirements) == 3
    for histogram in figures(section, "histogram"):
        assert histogram.summary.startswith(words)
        finite = [height for height in violated if math.isfinite(height)]
        by_verdict = histogram.data["by_verdict"]
        assert sum(by_verdict.get("violated", [0])) == len(finite)
        assert sum(by_verdict["satisfied"]) == 1
        sums = map(sum, zip(*by_verdict.values(), strict=True))
        assert list(sums) == histogram.data["counts"]


def test_undecided_colours() -> None:
    verdicts = {
        -1.0: Verdict.VIOLATED,
        -0.9: Verdict.UNDECIDED,
        -0.0: Verdict.VIOLATED,
        0.1: Verdict.UNDECIDED,
        0.9: Verdict.SATISFIED,
        1.0: Verdict.UNDECIDED,
        -math.inf: Verdict.UNDECIDED,
    }
    rows = []
    for seed, (height, verdict) in enumerate(verdicts.items(), 7):
        outcome = Outcome(height, -math.inf, math.inf, verdict)
        rows.append(
            replace(row({"low": 3.0}, seed=seed), outcomes={"low": outcome, "seen": outcome})
        )
    section = of_evaluation(evaluation(rows, {}), ROOM)
    requirement = section.requirements[0]
    assert {trial.robustness: trial.verdict for trial in requirement.trials} == {
        (height or 0.0): verdict.name.lower() for height, verdict in verdicts.items()
    }
    histogram = figures(section, "histogram")[0]
    assert histogram.words == ("violated", "undecided", "satisfied")
    assert {word: sum(each) for word, each in histogram.data["by_verdict"].items()} == {
        "violated": 2,
        "undecided": 3,
        "satisfied": 1,
    }
    assert ", 4 undecided." in histogram.summary
    assert histogram.table is not None
    head = [column.text for column in histogram.table.head]
    assert head == ["robustness", "episodes", *histogram.words]
    cells = [row.cells for row in histogram.table.rows]
    for _, episodes, *verdicts_of in cells:
        assert int(str(episodes)) == sum(int(str(cell)) for cell in verdicts_of)
    assert cells[0][1:] == ("1", "0", "1", "0")


def test_early_stop_is_noted() -> None:
    ends: list[tuple[float, RunEnd]] = [
        (0.5, "violation"),
        (0.5, "violation"),
        (1.0, "violation"),
        (0.5, "truncated"),
    ]
    rows = [
        replace(row({"low": 1.0 if i else 0.5, "seen": seen}, seed=7 + i), ended=ended)
        for i, (seen, ended) in enumerate(ends)
    ]
    low, seen, _ = of_evaluation(evaluation(rows, {}), ROOM).requirements
    (again, _) = of_record(evaluation(rows, {}).record, ROOM).requirements
    assert low.note == (
        "1 undecided episode was stopped early: its robustness counts the samples until the stop."
    )
    assert seen.note == (
        "2 undecided episodes were stopped early: their robustness counts the "
        "samples until the stop."
    )
    assert again.note == low.note.replace("episode", "simulation")
