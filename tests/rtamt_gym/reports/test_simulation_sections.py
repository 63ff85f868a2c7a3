"""Sections of sweeps and searches: points, maps, convergence, and repeated worst runs."""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_results import figures, row, searched, swept

from rtamt_gym import Parameter, Signal, Waveform, falsify
from rtamt_gym.__main__ import main
from rtamt_gym.reports.html import standing_of
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.requirements import cases_of
from rtamt_gym.reports.simulations import convergence_of, of_case, of_record, of_search
from rtamt_gym.reports.write import Access, section_of
from rtamt_gym.results import Record, SavedCase, Sweep

PLAY = Access(play=True)


def test_sweep_section() -> None:
    done = swept()
    section = of_record(done, ROOM)
    assert section.kind == "sweep"
    dry = section.requirements[0]
    assert dry.words == "level stays below 2 at all times"
    assert dry.counts["violated"] == len(done.record.violated("dry")) == 3
    assert dry.rate is None
    assert dry.trials[0].case == ("inflow = 0.3", "leak = 0.1")
    (episode,) = dry.worst
    worst = done.replay(done.worst("dry"))
    np.testing.assert_allclose(episode.signals["level"], worst.signals["level"], rtol=1e-5)
    assert episode.label == dry.trials[0].label == "simulation 13"
    assert episode.decided_at == dry.trials[0].violated_at
    heat, *_ = figures(section, "map")
    assert (heat.data["x"], heat.data["y"]) == ("leak", "inflow [m3/s]")
    expected = done.map("leak", "inflow", "dry").cells
    assert expected is not None
    np.testing.assert_allclose(np.array(heat.data["cells"], float), expected, rtol=1e-5)
    assert section.cases is not None
    assert set(section.cases["columns"]) == {"inflow", "leak"}
    assert section.cases["robustness"]["dry"][12] == pytest.approx(dry.lowest)


def test_sweep_without_system() -> None:
    done = swept()
    bare = Sweep(done.record, done.space, done.sampler, done.seed)
    section = of_record(bare, ROOM)
    assert [each.worst for each in section.requirements] == [(), ()]
    assert section.notes == (
        "The result holds no system, so that no simulation was played again for this page.",
    )
    maps = figures(section, "map")
    assert maps == figures(of_record(done, ROOM), "map")
    bare_maps = figures(of_record(done.record, ROOM), "map")
    assert [each.data["cells"] for each in bare_maps] == [each.data["cells"] for each in maps]


@pytest.mark.slow
def test_worst_of_many_simulations() -> None:
    rng = np.random.default_rng(1)
    heights = rng.normal(size=5000)
    rows = [row({"dry": h}, case={"x": float(i), "fixed": 1.0}) for i, h in enumerate(heights)]
    rows[17] = row({}, case={"x": 17.0, "fixed": 1.0}, error="ValueError: broke")
    record = Record(rows, {"dry": "always(x < 1)"}, "made")
    found = cases_of(record)
    assert found is not None
    cases, left_out = found
    assert len(cases["labels"]) == 2000
    assert left_out == 3000
    assert set(cases["columns"]) == {"x"}
    least = sorted(range(5000), key=lambda i: -math.inf if i == 17 else heights[i])[:500]
    assert {f"simulation {i + 1}" for i in least} <= set(cases["labels"])
    assert cases["verdicts"]["dry"][cases["labels"].index("simulation 18")] == "failed"
    section = of_record(record, ROOM)
    requirement = section.requirements[0]
    assert (len(requirement.trials), requirement.left_out) == (5000, 4500)
    assert sum(figures(section, "histogram")[0].data["counts"]) == 1000


def test_no_map_if_all_failed() -> None:
    rows = [
        row({}, case={"x": float(i), "y": float(-i)}, error="ValueError: broke") for i in range(3)
    ]
    record = Record(rows, {"dry": "always(x < 1)"}, "made")
    assert figures(of_record(record, ROOM), "map") == []


def test_rate_of_seeds() -> None:
    rows = [row({"dry": 1.0 if i % 4 else -1.0}, seed=i) for i in range(8)]
    requirement = of_record(Record(rows, {"dry": "always(x < 1)"}), ROOM).requirements[0]
    assert requirement.rate == 0.75
    assert requirement.interval == pytest.approx((0.349144, 0.968146), abs=1e-6)
    assert requirement.trials[0].label == "seed 0"


def test_search_section() -> None:
    found = searched()
    section = of_search(found, ROOM)
    assert section.notes[:2] == (
        f"dry is violated in simulation {found.simulations}.",
        f"Input: inflow = {found.input['inflow']:g}; leak = {found.input['leak']:g}.",
    )
    course = figures(section, "convergence")[0].data
    assert course["simulations"] == [*range(1, found.simulations + 1)]
    heights = [each.outcomes["dry"].robustness for each in found.record]
    np.testing.assert_allclose(np.array(course["robustness"], float), heights, rtol=1e-5)
    np.testing.assert_allclose(
        np.array(course["least"], float), np.minimum.accumulate(heights), rtol=1e-5
    )
    (episode,) = section.requirements[0].worst
    assert episode.verdict == "violated"
    assert episode.final == pytest.approx(found.robustness, rel=1e-5)


def test_search_notes_reductions() -> None:
    def leaking(push: Waveform, leak: float) -> Iterator[dict[str, float]]:
        level = 0.0
        for second in range(20):
            level += push(second) - leak * level
            yield {"level": level}

    space = [Signal("push", 0, 1, points=4, duration=20), Parameter("leak", 0, 0.5, default=0)]
    options: Any = {"period": 1, "optimizer": "random"}
    reduced = falsify(leaking, "always(level < 8)", space, **options)
    whole = falsify(leaking, "always(level < 8)", space, reduce=False, **options)
    assert reduced.reductions > 0
    (says,) = (note for note in of_search(reduced, ROOM).notes if "made simpler" in note)
    assert re.findall(r"\d+", says) == [str(reduced.reductions)]
    assert not any("simpler" in note for note in of_search(whole, ROOM).notes)


def test_convergence_shows_each_minimum() -> None:
    heights = np.random.default_rng(2).normal(size=9000)
    rows = [row({"dry": h}, case={"x": float(i)}) for i, h in enumerate(heights)]
    rows[0] = row({}, case={"x": 0.0}, error="ValueError: broke")
    course = convergence_of(Record(rows, {"dry": "always(x < 1)"}))["dry"].data
    assert course["least"][0] is None
    assert len(course["simulations"]) <= 2100
    known = np.minimum.accumulate([math.inf, *heights[1:]])
    steps = {i + 1 for i in range(1, 9000) if known[i] < known[i - 1]}
    assert steps <= set(course["simulations"])


@pytest.mark.parametrize("least", [2, 0])
def test_saved_case_shows_triggers(
    least: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tank_of_case.py").write_text(
        'def tank(inflow):\n    for _ in range(9):\n        yield {"level": inflow, "valve": '
        "1.0}\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    formula = f"shut = always(level >= {least} implies valve > 0)"
    words = [formula, "--vary", "inflow=0:1", "--budget", "3", "--period", "1"]
    assert main(["falsify", "tank_of_case:tank", *words, "--save", "case.json"]) == 0
    section = section_of("case.json", ROOM, PLAY)
    (trial,) = section.requirements[0].trials
    assert (trial.asked, trial.vacuous) == ((0, True) if least else (1, False))
    assert section.requirements[0].triggers == [1 - bool(least)]
    said = standing_of([section])
    assert said is not None
    assert ("never triggered: shut" in said.text) is (least > 0)
    # A run with another verdict shows the verdict of the file.
    other = json.loads((tmp_path / "case.json").read_text(encoding="utf-8"))
    other["expected"]["verdict"] = "VIOLATED"
    (tmp_path / "case.json").write_text(json.dumps(other), encoding="utf-8")
    assert section_of("case.json", ROOM, PLAY).requirements[0].triggers == []


def test_saved_case_section(tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    searched().save(path, system="tank_of_test:tank")
    saved = SavedCase.load(path)
    alone = of_case(saved, ROOM, play=True)
    assert alone.notes == (f"The case was not run: {alone.not_played}",)
    assert alone.not_played.startswith("InputError: cannot find the module 'tank_of_test'")
    assert alone.requirements[0].worst == ()
    assert alone.requirements[0].trials[0].robustness == pytest.approx(saved.robustness, rel=1e-5)
    (tmp_path / "tank_of_test.py").write_text(
        "def tank(inflow, leak):\n    level = 1.0\n    for _ in range(20):\n        yield "
        '{"level": level}\n        level += inflow - leak * level\n',
        encoding="utf-8",
    )
    played = of_case(saved, ROOM, play=True)
    assert played.notes == ("Played again for this page, the case gave the same robustness.",)
    assert played.not_played == ""
    assert played.requirements[0].worst[0].verdict == "violated"
    other = json.loads(path.read_text(encoding="utf-8"))
    other["expected"]["robustness"] = -9.0
    path.write_text(json.dumps(other), encoding="utf-8")
    (note,) = of_case(SavedCase.load(path), ROOM, play=True).notes
    assert note.startswith("Played again for this page, the case gave another robustness: -0.0")
