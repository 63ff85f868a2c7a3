"""The demo: what it claims of good and of bad controllers, and how it reads."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtamt_gym import Run, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.demo import HIGHWAY, PENDULUM, watch
from rtamt_gym.systems.registry import make


def verdicts(runs: list[Run]) -> dict[str, dict[str, str]]:
    return {r.label: {name: c.verdict.name for name, c in r.courses.items()} for r in runs}


@pytest.fixture(scope="module")
def pendulum() -> list[Run]:
    return watch(PENDULUM)


@pytest.fixture(scope="module")
def highway() -> list[Run]:
    return watch(HIGHWAY)


def test_the_pendulum_violates_what_its_controller_neglects(pendulum: list[Run]) -> None:
    assert verdicts(pendulum) == {
        "comes back": {"upright": "SATISFIED", "returns": "SATISFIED"},
        "stays away": {"upright": "UNDECIDED", "returns": "VIOLATED"},
        "lets go": {"upright": "VIOLATED", "returns": "UNDECIDED"},
    }


def test_a_deadline_is_missed_when_it_passes_and_not_before(pendulum: list[Run]) -> None:
    away = pendulum[1]
    left = int(np.argmax(away.signals["cart"] > 0.2))
    assert away.period is not None
    assert (away.steps - left) * away.period == 5


@pytest.mark.slow
def test_the_highway_violates_what_its_driver_neglects(highway: list[Run]) -> None:
    assert verdicts(highway) == {
        "careful": {"distance": "SATISFIED", "closes": "SATISFIED"},
        "races": {"distance": "VIOLATED", "closes": "UNDECIDED"},
        "creeps": {"distance": "UNDECIDED", "closes": "VIOLATED"},
    }


def test_a_violated_episode_ends_with_the_sample_that_decides(
    pendulum: list[Run], highway: list[Run]
) -> None:
    for episode in [*pendulum, *highway]:
        if episode.violated_by is None:
            assert (episode.ended, episode.steps) == ("truncated", episode.limit)
            assert episode.saved is None
        else:
            assert episode.ended == "violation"
            assert episode.courses[episode.violated_by].decided_at == episode.steps
            assert episode.limit is not None
            assert episode.saved == episode.limit - episode.steps


def test_an_episode_is_repeated_by_its_seed(pendulum: list[Run]) -> None:
    falls = replace(PENDULUM, drivers={"lets go": PENDULUM.drivers["lets go"]})
    assert watch(falls) == pendulum[2:]
    assert watch(falls, seed=1) != pendulum[2:]


def test_the_demo_prints_tables_of_80_columns_and_draws(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    picture = tmp_path / "demo.png"
    assert main(["demo", "--plot", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    assert lines[0] == "InvertedPendulum-v5: 40 s in steps of 0.04 s"
    assert "highway-fast-v0: 30 s in steps of 1 s" in lines
    assert lines[-1] == f"picture: {picture}"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_on_an_empty_road_the_gap_is_the_longest_that_is_told() -> None:
    env = make(HIGHWAY.env_id)
    road: Any = env.unwrapped
    road.config["vehicles_count"] = 0
    careful = HIGHWAY.drivers["careful"](env)
    run = simulate(env, "always(gap > 99)", HIGHWAY.signals, policy=careful, seed=0, duration=3)
    env.close()
    assert run.signals["gap"].tolist() == [100.0] * 4
    assert run.signals["speed"][-1] > run.signals["speed"][0]  # so that it hurries
