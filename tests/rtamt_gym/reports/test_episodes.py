"""An episode shows its deciding part if its samples determine it; otherwise only its curves."""

from __future__ import annotations

import math

import gymnasium as gym

from rtamt import Verdict
from rtamt_gym import simulate
from rtamt_gym.play.run import Run
from rtamt_gym.reports.model import ShownEpisode
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.simulations import of_run
from rtamt_gym.results.outcome import Moment


def shown(run: Run) -> ShownEpisode:
    """Return the episode of a run."""
    (episode,) = of_run(run, ROOM).requirements[0].worst
    return episode


def test_episode_with_unknown_sample() -> None:
    runs = {
        known: simulate(
            gym.make("CartPole-v1"),
            "always(x < 0.5)",
            {"x": (lambda step: step.reward, known)},
            policy=lambda _: 0,
            duration=0.1,
        )
        for known in (0.0, None)
    }
    assert {run.outcomes["spec"].verdict for run in runs.values()} == {Verdict.VIOLATED}
    explained, unknown = (shown(run) for run in runs.values())
    assert explained.explanation.startswith("robustness -0.5 ")
    assert [each.values for each in explained.deciding] == [{"x": 1.0}]
    assert (unknown.explanation, unknown.deciding, unknown.predicates) == ("", (), {})
    assert math.isnan(unknown.signals["x"][0])
    for run, episode in zip(runs.values(), (explained, unknown), strict=True):
        assert (episode.verdict, episode.final) == ("violated", run.outcomes["spec"].robustness)
        assert episode.decided_at == Moment(1, 0.02)
        assert episode.signals["x"][1:] == (1.0,) * (episode.samples - 1)


def test_window_outside_trace_has_no_decision() -> None:
    rows = [{"x": 1.0}, {"x": 2.0}]
    episode = shown(simulate(rows, "eventually[5:6](x > 0)", period=1, stop="end"))
    assert episode.deciding == ()
    assert "its window lies outside the trace: 5 s to 6 s" in episode.explanation
    inside = shown(simulate(rows, "eventually[0:1](x > 0)", period=1, stop="end"))
    assert [(each.time, each.values) for each in inside.deciding] == [(1.0, {"x": 2.0})]
