"""Files of version 1, one of each kind, are read: their results, and pages of them."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from paths import ROOT

from rtamt import InputError
from rtamt_gym import Comparison, Evaluation, Record, Run, SavedCase, Sweep
from rtamt_gym.reports.results import section_of
from rtamt_gym.reports.series import ROOM
from rtamt_gym.results.codec import KINDS, read, trials_of
from rtamt_gym.results.outcome import Moment

FILES = ROOT / "tests" / "golden" / "results_v1"
KIND = {
    "run.json": "runs",
    "outcomes.json": "traces",
    "outcomes_dense.json": "traces",
    "record.json": "record",
    "search.json": "search",
    "case.json": "case",
    "evaluation.json": "evaluation",
    "comparison.json": "comparison",
    "mined.json": "mined",
}


def raw(name: str) -> Any:  # noqa: ANN401 - JSON
    return json.loads((FILES / name).read_text(encoding="utf-8"))


def test_there_is_a_file_of_each_kind() -> None:
    assert {*KIND.values(), "examples", "methods"} == set(KINDS)  # two had no version 1
    assert {path.name for path in FILES.glob("*.json")} == set(KIND)


@pytest.mark.parametrize("name", KIND)
def test_a_file_of_version_1_is_read_as_what_it_is(name: str) -> None:
    kept = read(FILES / name)
    assert (kept["kind"], kept["version"]) == (KIND[name], 2)
    assert kept["rtamt"] == raw(name).get("rtamt")


@pytest.mark.parametrize("name", [*KIND, "sweep.parquet", "run.parquet"])
def test_a_page_shows_a_file_of_version_1(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    section = section_of(FILES / name, ROOM)
    assert section.title
    shown = section.comparison.requirements if section.comparison else section.requirements
    assert shown


def test_the_runs_of_version_1_have_their_outcomes() -> None:
    trials, before = trials_of(read(FILES / "run.json")), raw("run.json")
    assert [trial.simulated for trial in trials] == [
        run["steps"] * before["period"] for run in before["episodes"]
    ]
    for trial, run in zip(trials, before["episodes"], strict=True):
        assert trial.seed == run["seed"]
        for name, outcome in trial.outcomes.items():
            kept = run["specs"][name]
            assert outcome.robustness == float(kept["robustness"])
            assert outcome.bounds == (float(kept["lower"]), float(kept["upper"]))
            at = kept["decided_at"]
            assert outcome.decided == (None if at is None else Moment(at, at * 0.02))


@pytest.mark.parametrize("name", ["outcomes.json", "outcomes_dense.json"])
def test_the_traces_of_version_1_have_their_outcomes(name: str) -> None:
    trials, before = trials_of(read(FILES / name)), raw(name)
    assert [trial.name for trial in trials] == [trace["trace"] for trace in before["traces"]]
    for trial, trace in zip(trials, before["traces"], strict=True):
        assert list(trial.notes) == trace["notes"]
        for key, kept in trace["requirements"].items():
            outcome = trial.outcomes[key]
            assert (outcome.verdict.name, outcome.decided_at) == (
                kept["verdict"],
                kept["certain_from"],
            )
            assert outcome.explanation == kept.get("explanation", "")
            assert list(outcome.not_recorded) == kept.get("not_recorded", [])


def test_an_evaluation_of_version_1_is_loaded() -> None:
    before = raw("evaluation.json")
    loaded = Evaluation.load(FILES / "evaluation.json")
    for name, kept in before["results"].items():
        result = {**loaded.requirements, loaded.success.name: loaded.success}[name]
        for key in ("episodes", "satisfied", "violated", "undecided", "failed", "rate", "saved"):
            assert getattr(result, key) == kept[key]
        assert result.interval == pytest.approx(kept["interval"], rel=1e-12)
        assert result.first_violations.tolist() == kept["first_violations"]
        assert [list(each) for each in result.worst] == kept["worst"]
    assert loaded.period is not None
    for kept, run in zip(before["runs"], loaded.worst_runs["up"], strict=False):
        assert run.seed == kept["seed"]
        assert run.courses["up"].decided_at == kept["courses"]["up"]["decided_at"]
        assert run.signals["x"].tolist() == kept["signals"]["x"]
    assert loaded.reading == before["reading"]


def test_a_comparison_of_version_1_is_loaded() -> None:
    before = raw("comparison.json")
    loaded = Comparison.load(FILES / "comparison.json")
    for kept in before["requirements"]:
        compared = loaded.requirements[kept["name"]]
        assert (compared.both, compared.only_a, compared.p) == (
            kept["both"],
            kept["only_a"],
            kept["p"],
        )
        assert compared.sentence == kept["sentence"]


def test_records_of_version_1_are_loaded() -> None:
    sweep = Sweep.load(FILES / "sweep.parquet")
    for place, cells in enumerate(raw("record.json")["simulations"]):
        columns = sweep.record[place].columns()
        assert {name: columns[name] for name in cells if name != "wall"} == {
            name: cell for name, cell in cells.items() if name != "wall"
        }
    kept = read(FILES / "record.json")
    of_json = Record(trials_of(kept), kept["requirements"], kept["system"])
    same = [name for name in sweep.record.columns() if name != "wall"]
    assert [of_json.columns()[name] for name in same] == [
        sweep.record.columns()[name] for name in same
    ]


def test_a_search_of_version_1_has_its_simulations() -> None:
    heights = raw("search.json")["robustness_of_simulations"]["granted"]
    trials = trials_of(read(FILES / "search.json"))
    assert [trial.outcomes["granted"].robustness for trial in trials] == heights
    assert [trial.word for trial in trials] == ["satisfied", "satisfied", "violated"]


def test_a_case_of_version_1_runs_as_it_ran() -> None:
    saved = SavedCase.load(FILES / "case.json")
    assert saved.repeats(saved.replay())


def test_a_run_of_version_1_is_loaded() -> None:
    run = Run.load(FILES / "run.parquet")
    (course,) = run.courses.values()
    assert course.verdict.name == "VIOLATED"
    assert course.decided_at == run.violated_at
    assert math.copysign(1.0, course.final) < 0
    assert run.case is not None


def test_a_mined_value_of_version_1_has_its_witnesses() -> None:
    kept, before = read(FILES / "mined.json"), raw("mined.json")
    assert [trial.name for trial in trials_of(kept)] == [
        each["trace"] for each in before["witnesses"]
    ]
    assert kept["value"] == before["value"]


@pytest.mark.parametrize(
    "kept",
    [
        {"format": "rtamt evaluation 2"},
        {"episodes": [], "specs": {}},
        {"format": "rtamt result", "version": "2", "kind": "runs"},
        {"format": "rtamt result", "version": 2, "kind": "dreams"},
    ],
)
def test_what_no_version_has_written_is_no_result(kept: Mapping[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "some.json"
    path.write_text(json.dumps(kept), encoding="utf-8")
    with pytest.raises(InputError, match="holds no result"):
        read(path)
