"""The library against the golden files, which were computed by a separate program."""

import math
from typing import Literal

import numpy as np
from golden_cases import cases, length

from rtamt import EpisodeMonitor, Monitor, evaluate

Backend = Literal["native", "python"]
DISCRETE = cases("discrete.json")
EPISODES = cases("episode.json")


def test_the_golden_files_are_whole() -> None:
    assert (len(DISCRETE), len(EPISODES)) == (400, 300)


def test_evaluate_agrees_with_golden_at_every_sample(backend: Backend) -> None:
    for case in DISCRETE:
        expected = [float(value) for value in case["robustness"]]
        assert evaluate(case["formula"], case["trace"], backend=backend).tolist() == expected, case


def test_monitor_gives_golden_values_no_later_than_the_golden_horizon(backend: Backend) -> None:
    for case in DISCRETE:
        if case["horizon"] is None:
            continue
        monitor, n = Monitor(case["formula"], backend=backend), length(case)
        assert monitor.latency <= case["horizon"], case
        values = monitor.update_many({v: case["trace"][v] for v in monitor.variables})
        expected = [math.nan] * monitor.latency + [float(value) for value in case["robustness"]]
        assert np.array_equal(values, expected[:n], equal_nan=True), case


def test_episode_monitor_agrees_with_golden_after_every_sample(backend: Backend) -> None:
    for case in EPISODES:
        monitor = EpisodeMonitor(case["formula"], backend=backend)
        for i, after in enumerate(case["after"]):
            now = monitor.update({v: case["trace"][v][i] for v in monitor.variables})
            found = (now, monitor.lower, monitor.upper)
            assert found == tuple(map(float, after)), (case["formula"], i)
