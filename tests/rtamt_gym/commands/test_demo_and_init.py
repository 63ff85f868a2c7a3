"""The demonstration, and the files to start with."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtamt_gym import simulate
from rtamt_gym.__main__ import main
from rtamt_gym.demo import HIGHWAY, PENDULUM, watch
from rtamt_gym.results import Run
from rtamt_gym.starters import STARTERS
from rtamt_gym.systems.registry import make


def verdicts(runs: list[Run]) -> dict[str, dict[str, str]]:
    return {r.label: {name: c.verdict.name for name, c in r.histories.items()} for r in runs}


@pytest.fixture(scope="module")
def pendulum() -> list[Run]:
    return watch(PENDULUM)


@pytest.fixture(scope="module")
def highway() -> list[Run]:
    return watch(HIGHWAY)


def test_the_pendulum_violates_what_its_controller_neglects(pendulum: list[Run]) -> None:
    assert verdicts(pendulum) == {
        "recovers": {"upright": "SATISFIED", "returns": "SATISFIED"},
        "drifts": {"upright": "UNDECIDED", "returns": "VIOLATED"},
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
            assert episode.histories[episode.violated_by].decided_at == episode.steps
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
    assert run.signals["speed"][-1] > run.signals["speed"][0]  # so that it is fast


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("name", STARTERS)
def test_it_writes_a_specification_a_test_and_a_job_and_says_so(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", name]) == 0
    told, _, begin = capsys.readouterr().out.partition("\n\nstart with: ")
    written = set(contents(tmp_path))
    assert set(told.splitlines()) == written
    assert begin == f"{STARTERS[name].begin}\n"
    assert {Path(each).suffix for each in written} >= {".stl", ".py", ".yml"}
    assert [each for each in written if Path(each).name.startswith("test_")]
    assert not [each for each in written if each.endswith(".txt")]


def test_it_makes_the_folder_that_it_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a b" / "gate"
    assert main(["init", "recordings", str(folder)]) == 0
    assert "recordings/monday.csv" in contents(folder)
    assert f"\nstart with: cd '{folder}' && rtamt monitor " in capsys.readouterr().out


@pytest.mark.parametrize("there", ["requirements.stl", ".github/workflows/requirements.yml"])
def test_it_overwrites_nothing_and_then_writes_nothing(
    there: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / there).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / there).write_text("mine")
    assert main(["init", "violation", str(tmp_path)]) == 2
    assert contents(tmp_path) == {there: b"mine"}
    message = f"{tmp_path / there} would be overwritten: give another folder, rtamt init violation"
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("blocked", ["", ".github"])
def test_a_file_in_the_place_of_a_folder_is_an_error(
    blocked: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "here"
    file = folder / blocked
    file.parent.mkdir(exist_ok=True)
    file.write_text("mine")
    assert main(["init", "violation", str(folder)]) == 2
    assert f"{file} is a file: give another folder" in capsys.readouterr().err
    assert set(contents(tmp_path)) == {file.relative_to(tmp_path).as_posix()}


def test_an_unknown_starter_is_an_error_that_names_those_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", "gate", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert all(name in said for name in STARTERS)
    assert contents(tmp_path) == {}
