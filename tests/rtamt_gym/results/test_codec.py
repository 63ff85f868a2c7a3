"""The one form of results: every writer uses it, numbers are exact, a page shows every kind."""

import json
import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from evaluations import evaluation_of
from hypothesis import given, settings
from hypothesis import strategies as st
from paths import ROOT
from profiles import examples

from rtamt import Verdict
from rtamt_gym import Case, Waveform, compare, compare_methods, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.reports.model import Facts
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.requirements import with_trials
from rtamt_gym.reports.write import SECTIONS, section_of
from rtamt_gym.results import Evaluation, Run
from rtamt_gym.results.codec import KINDS, plain, read, trial_of
from rtamt_gym.results.outcome import Failure, Moment, Outcome
from rtamt_gym.results.trial import Trial

Output = pytest.CaptureFixture[str]

NUMBERS = st.floats(allow_nan=False)
MOMENTS = st.none() | st.builds(
    Moment, st.none() | st.integers(0, 2**40), st.none() | st.floats(0, 1e9)
)
OUTCOMES = st.builds(
    Outcome,
    NUMBERS,
    NUMBERS,
    NUMBERS,
    st.sampled_from(Verdict),
    MOMENTS,
    text=st.text(),
    not_recorded=st.lists(st.text()).map(tuple),
    way_out=st.text(),
    explanation=st.text(),
    ended=MOMENTS,
)
ENTRIES = NUMBERS | st.lists(st.floats(-9, 9), min_size=2, max_size=2).map(
    lambda values: Waveform([0, 1], values)
)
SIMULATED = st.builds(
    Trial,
    st.dictionaries(st.text(min_size=1), ENTRIES, max_size=2).map(Case),
    st.none() | st.integers(0, 2**60),
    st.dictionaries(st.text(min_size=1), OUTCOMES, max_size=2),
    st.sampled_from(["violation", "truncated", "error"]),
    st.floats(0, 1e9),
    st.floats(0, 1e9),
    st.text(),
    st.none() | NUMBERS,
)
RECORDED = st.builds(
    Trial.of_trace,
    st.text(min_size=1),
    st.text(),
    st.dictionaries(st.text(min_size=1), OUTCOMES | st.builds(Failure, st.text()), max_size=2),
    st.lists(st.text(), max_size=2),
)


@settings(max_examples=examples(60))
@given(SIMULATED | RECORDED)
def test_trial_round_trip_is_exact(trial: Trial) -> None:
    text = json.dumps(plain(trial), allow_nan=False)
    loaded = trial_of(json.loads(text))
    assert loaded == trial
    # Also the signs of zeros, and wall times, which equality ignores.
    assert repr(loaded.columns()) == repr(trial.columns())


def test_missing_moment_is_null() -> None:
    assert plain(Moment.of(3, Fraction(1, 2))) == {"sample": 3, "seconds": 1.5}
    assert plain(Moment.of(3, None)) == {"sample": 3, "seconds": None}
    assert plain(Moment(None, 0.25)) == {"sample": None, "seconds": 0.25}
    assert plain([math.inf, -math.inf, math.nan, -0.0]) == ["inf", "-inf", "nan", -0.0]


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output) -> dict[str, Path]:
    """Return a file of each kind, and of the forms of traces, as the commands write them."""
    monkeypatch.chdir(tmp_path)
    tank = "def tank(inflow):\n    level = 1.0\n    for _ in range(20):\n"
    tank += "        yield {'level': level}\n        level += inflow - 0.1 * level\n"
    Path("plant.py").write_text(tank, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    response = [str(ROOT / "examples" / each) for each in ("response.stl", "response.csv")]
    untimed = Path("untimed.csv")
    untimed.write_text("x\n1\n5\n1\n", encoding="utf-8")
    pole = ["CartPole-v1", "--policy", "zero", "--seed", "0", "--signal", "angle=obs[2]"]
    pole += ["--spec", "upright = always(abs(angle) < 0.1)", "--episodes", "2"]
    search = ["plant:tank", "always(level < 2)", "--vary", "inflow=0:0.3", "--period", "0.5"]
    vary = ["rtamt/RequestGrant-v0", "--vary", "limit=0:2", "--samples", "2", "--json", "w.json"]
    printed = {
        "traces": ["monitor", *response, "--json"],
        "traces, untimed": ["monitor", "always(x < 3)", str(untimed), "--json"],
        "traces, dense": ["monitor", *response, "--dense", "--json"],
        "search": ["falsify", *search, "--save", "case.json", "--json"],
        "mined": ["mine", "always(speed < ?v)", response[1], "--range", "v=0:100", "--json"],
    }
    files = {}
    for name, arguments in printed.items():
        main(arguments)
        files[name] = Path(f"{name}.json")
        files[name].write_text(capsys.readouterr().out, encoding="utf-8")
    assert main(["run", *pole, "--json", "runs.json"]) == 0
    assert main(["evaluate", *pole, "--save", "evaluation.json"]) == 0
    assert main(["compare", "evaluation.json", "evaluation.json", "--save", "compared.json"]) == 0
    assert main(["sweep", *vary]) == 0
    releases = [str(ROOT / "examples" / "releases" / f"{each}.json") for each in ("old", "new")]
    assert main(["compare", *releases, "--save", "recordings.json"]) == 1
    capsys.readouterr()
    compare_methods({"plain": [0.1, 0.0], "shaped": [1.0, 0.9]}).save("methods.json")
    named = {"runs": "runs", "evaluation": "evaluation", "comparison": "compared"}
    named |= {"methods": "methods", "recordings": "recordings"}
    named |= {"record": "w", "case": "case"}
    return files | {kind: Path(f"{name}.json") for kind, name in named.items()}


def test_files_have_form_and_moments(
    written: dict[str, Path],
) -> None:
    assert {name.partition(",")[0] for name in written} == set(SECTIONS)
    assert set(KINDS) == {*SECTIONS, "examples"}  # they have no trials, and no page of their own
    moments: dict[str, set[tuple[bool, bool]]] = {}
    for name, path in written.items():
        kept = json.loads(path.read_text(encoding="utf-8"), parse_constant=pytest.fail)
        head = [kept[key] for key in ("format", "version", "kind")]
        assert head == ["rtamt result", 2, name.partition(",")[0]]
        assert kept == read(path)
        moments[name] = {
            (at["sample"] is not None, at["seconds"] is not None) for at in _moments(kept)
        }
        section_of(path, ROOM)
    assert {name: found for name, found in moments.items() if found} == {
        **{key: {(True, True)} for key in ["runs", "record", "evaluation", "traces", "search"]},
        "traces, untimed": {(True, False)},
        "traces, dense": {(False, True)},
    }


def _moments(kept: Any) -> list[Any]:  # noqa: ANN401 - JSON
    """Return all values of ``decided_at`` at any depth."""
    if isinstance(kept, list):
        return [at for each in kept for at in _moments(each)]
    if not isinstance(kept, dict):
        return []
    own = [kept["decided_at"]] if kept.get("decided_at") else []
    return own + [at for each in kept.values() for at in _moments(each)]


def test_files_agree_on_moments(written: dict[str, Path]) -> None:
    runs, evaluation = (read(written[name]) for name in ("runs", "evaluation"))
    at = [each["outcomes"]["upright"]["decided_at"] for each in runs["trials"]]
    assert at == [each["outcomes"]["upright"]["decided_at"] for each in evaluation["trials"]]
    assert at[0] == {"sample": 8, "seconds": 0.16}
    worst = Evaluation.load(written["evaluation"]).worst_runs["upright"]
    assert {run.seed: run.histories["upright"].decided_at for run in worst}[0] == 8
    section = section_of(written["evaluation"], ROOM)
    assert {each.violated_at for each in section.requirements[0].trials} >= {Moment(8, 0.16)}


def test_run_is_equal_in_table_and_evaluation(tmp_path: Path) -> None:
    levels = [{"level": x} for x in (1.0, 2.0, 4.0, 8.0)]
    run = simulate(levels, {"dry": "always(level < 3)"}, period=0.5)
    run.save(tmp_path / "run.parquet")
    assert Run.load(tmp_path / "run.parquet") == run
    section = section_of(tmp_path / "run.parquet", ROOM)
    (episode,) = section.requirements[0].worst
    assert episode.decided_at == Moment(2, 1.0)
    assert run.outcomes["dry"].decided == Moment(2, 1.0)


def test_page_has_statistics_of_terminal() -> None:
    evaluation = evaluation_of({"near": [float(i) for i in range(40)]})
    section = section_of(evaluation, ROOM)
    shown = with_trials(section.requirements[0], section)
    (facts,) = (block for block in shown.blocks if isinstance(block, Facts))
    assert {name: text for name, text, _ in facts.rows} == {
        "minimum": "0",
        "CVaR 5%": "0.5",
        "median": "19",
        "maximum": "39",
    }
    assert evaluation.requirements["near"].interval == shown.interval
    kept = json.loads(evaluation.to_json())["results"]["near"]
    assert (kept["cvar"], kept["least"], kept["greatest"]) == (0.5, 0.0, 39.0)
    assert compare(evaluation, evaluation).requirements["near"].difference == 0
