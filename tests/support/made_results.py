"""Results with numbers that tests choose: rows, records, runs and evaluations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from rtamt import Verdict
from rtamt_gym import Case, Parameter, falsify, simulate, sweep
from rtamt_gym.reports.model import Figure, Section
from rtamt_gym.reports.requirements import with_trials
from rtamt_gym.results import Evaluation, Falsification, Record, Run, Sweep
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.trial import Trial

SPECS = {"dry": "always(level < 2)", "fills": "eventually[0:9](level > 1.2)"}
SPACE = [Parameter("inflow", 0.1, 0.3, unit="m3/s"), Parameter("leak", 0.1, 0.2)]


def figures(section: Section, kind: str) -> list[Figure]:
    """Return the charts of a kind in a section, in order."""
    requirements = [with_trials(each, section) for each in section.requirements]
    drawn = [*section.figures, *(each for r in requirements for each in r.figures)]
    return [each for each in drawn if isinstance(each, Figure) and each.kind == kind]


def tank(inflow: float, leak: float) -> Iterator[dict[str, float]]:
    """A tank that fills and leaks."""
    level = 1.0
    for _ in range(20):
        yield {"level": level}
        level += inflow - leak * level


def searched() -> Falsification:
    """Return a search that finds an overflow of the tank."""
    return falsify(tank, {"dry": SPECS["dry"]}, SPACE, period=1)


def swept() -> Sweep:
    """Return a sweep over a grid of the tank."""
    return sweep(tank, SPECS, SPACE, samples=4, sampler="grid", period=1, progress=False)


def outcome(height: float, at: float | None = None) -> Outcome:
    """Return the outcome of a robustness: violated if negative, undecided if it is 0.5."""
    verdict = Verdict.UNDECIDED if height == 0.5 else Verdict(1 if height >= 0 else -1)
    decided = None if at is None else Moment(None, at)
    return Outcome(height, -math.inf, height, verdict, decided)


def row(
    heights: Mapping[str, float],
    *,
    seed: int | None = None,
    case: Mapping[str, float] | None = None,
    at: float | None = None,
    reward: float | None = None,
    error: str = "",
) -> Trial:
    """Return a row of 2 simulated seconds, with violations certain at a time."""
    outcomes = {name: outcome(h, at if h < 0 else None) for name, h in heights.items()}
    return Trial(Case(case or {}), seed, outcomes, "duration", 2.0, 0.1, error, reward)


def wave(samples: int, seed: int = 0, signals: int = 2) -> Run:
    """Return a run over random signals ``x0``, ``x1``, ... with ``low`` as a bound of the first."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(samples, signals)).round(3)
    values[samples // 3, 0] = 9.0 + seed
    rows = [{f"x{i}": float(each) for i, each in enumerate(line)} for line in values]
    specs = {"low": "always(x0 < 5)", "seen": "eventually[0:1](x1 > 0.5)"}
    run = simulate(rows, specs, period=0.1, stop="end")
    return replace(run, seed=seed)


def evaluation(rows: Sequence[Trial], runs: Mapping[str, tuple[Run, ...]]) -> Evaluation:
    """Return an evaluation of two requirements with these episodes."""
    texts = {"low": "always(x0 < 5)", "seen": "eventually[0:1](x1 > 0.5)"}
    record = Record(rows, texts, "Waves-v0")
    return Evaluation(record, "Waves-v0", "random", Fraction(1, 10), 2.0, 7, None, runs)
