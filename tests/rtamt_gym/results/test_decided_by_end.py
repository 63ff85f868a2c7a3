"""A verdict of the end has no `decided_at`, and its time of violation is the last sample."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from replay import Replay

import rtamt
from rtamt import Verdict
from rtamt_gym import Case, StlMonitor, StlReward, VectorStlMonitor, evaluate_policy, simulate
from rtamt_gym.learners.metrics import Satisfaction, ended_episodes, evaluation_metrics, metrics_of
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import plain_run, run_fields
from rtamt_gym.play.summaries import run_table
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.write import section_of
from rtamt_gym.results import Evaluation, Run
from rtamt_gym.results.codec import outcome_of, plain_outcome
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.statistics import together

VALUES = [1.0, 2.0, 1.0, 2.0]
LAST = len(VALUES) - 1
SPECS = {
    "goal": "eventually(x > 5)",  # the end violates it
    "kept": "always(x < 9)",  # the end satisfies it
    "up": "eventually(x > 1.5)",  # sample 1 satisfies it
    "low": "always(x < 1.5)",  # sample 1 violates it
}
EXPECTED = {
    "goal": ("VIOLATED", None, LAST),
    "kept": ("SATISFIED", None, LAST),
    "up": ("SATISFIED", 1, None),
    "low": ("VIOLATED", 1, None),
}
SIGNALS = {"x": "obs[0]"}
GOAL = {"goal": SPECS["goal"]}


def read(outcomes: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[Any, ...]]:
    keys = ("verdict", "decided_at", "ended_at")
    return {name: tuple(each.get(key) for key in keys) for name, each in outcomes.items()}


def last_info(env: Any) -> dict[str, Any]:  # noqa: ANN401 - a wrapper
    env.reset()
    while True:
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        if terminated or truncated:
            found: dict[str, Any] = info
            return found


def still(_: Any) -> Any:  # noqa: ANN401 - a policy
    return np.zeros(1)


def entries(specs: Any, mode: AutoresetMode = AutoresetMode.SAME_STEP) -> VectorStlMonitor:  # noqa: ANN401
    envs = SyncVectorEnv([lambda: Replay(VALUES)] * 2, autoreset_mode=mode)
    return VectorStlMonitor(envs, specs, SIGNALS, at_termination="complete")


def run_of(specs: Any, **options: Any) -> Run:  # noqa: ANN401
    rows = [{"x": x} for x in VALUES]
    return simulate(rows, specs, stop="end", **{"period": 0.5, **options})


def evaluation(specs: Mapping[str, str] = SPECS) -> Evaluation:
    return evaluate_policy(
        still, lambda: Replay(VALUES), specs, SIGNALS, episodes=2, period=0.5, stop="end"
    )


def test_one_definition_of_decided_at() -> None:
    for name, (verdict, decided, _) in EXPECTED.items():
        judged = rtamt.judge(SPECS[name], {"x": VALUES}, end="complete")
        assert (judged.verdict.name, judged.decided_at) == (verdict, decided)
    env = StlMonitor(Replay(VALUES), SPECS, SIGNALS, on_violation="report")
    info = last_info(env)
    assert read(info["stl_episode"]) == EXPECTED
    assert read(env.stl_episodes[-1]["specs"]) == EXPECTED
    courses = run_of(SPECS).histories
    found = {name: (c.verdict.name, c.decided_at, c.ended_at) for name, c in courses.items()}
    assert found == EXPECTED


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vector_infos_distinguish_sample_and_end(mode: AutoresetMode) -> None:
    envs = entries(SPECS, mode)
    envs.reset()
    for _ in range(LAST):
        _, _, over, _, infos = envs.step(np.zeros(2, np.int64))
    assert over.all()
    found = ended_episodes(infos, over)
    assert [read(each) for each in found] == [EXPECTED] * 2
    assert [read(each["specs"]) for each in envs.stl_episodes] == [EXPECTED] * 2


def test_cut_window_is_open_and_failure_is_by_end() -> None:
    window = {"soon": "always[0:10](x < 9)"}
    open_ = StlMonitor(Replay(VALUES), window, SIGNALS, period=1, at_termination="cut")
    assert read(last_info(open_)["stl_episode"]) == {"soon": ("UNDECIDED", None, None)}
    failed = StlMonitor(Replay(VALUES), window, SIGNALS, period=1, at_termination="failure")
    info = last_info(failed)
    assert read(info["stl_episode"]) == {"soon": ("VIOLATED", None, LAST)}
    assert (info["stl_violated_by"], info["stl_violated_at"]) == ("soon", LAST)
    assert info["stl_episode"]["soon"]["by_end"] is True


def test_violation_by_end_counts() -> None:
    info = last_info(StlReward(Replay(VALUES), GOAL, SIGNALS, mode="terminal"))
    assert info["stl_violated"] is True
    assert info["stl_success"] is info["stl_undecided"] is False
    assert (info["stl_violated_by"], info["stl_violated_at"]) == ("goal", LAST)
    run = run_of(GOAL)
    assert (run.violated_by, run.violated_at) == ("goal", LAST)


def test_vector_wrapper_reports_violation_by_end() -> None:
    envs = entries(GOAL, AutoresetMode.DISABLED)
    envs.reset()
    for _ in range(LAST):
        infos = envs.step(np.zeros(2, np.int64))[-1]
    assert infos["stl_violated"].tolist() == [True, True]
    assert infos["stl_violated_at"].tolist() == [LAST, LAST]
    assert infos["_stl_violated_at"].all()
    assert infos["stl_violated_by"].tolist() == ["goal", "goal"]
    outcome = infos["stl_episode"]["goal"]
    assert "decided_at" not in outcome
    assert outcome["ended_at"].tolist() == [LAST, LAST]
    assert [each["violated_at"] for each in envs.stl_episodes] == [LAST, LAST]
    infos = envs.reset(options={"reset_mask": np.array([True, False])})[1]
    assert infos["stl_violated"].tolist() == [False, False]


def test_times_of_violations_keep_their_values() -> None:
    found = evaluation()
    assert found.requirements["goal"].first_violations.tolist() == [1.5, 1.5]
    assert found.requirements["low"].first_violations.tolist() == [0.5, 0.5]
    assert evaluation_metrics(found)["goal/first_violation"] == 1.5
    env = StlMonitor(Replay(VALUES), SPECS, SIGNALS, on_violation="report")
    episode = last_info(env)["stl_episode"]
    assert metrics_of([episode], 0.5)["goal/first_violation"] == 1.5
    assert metrics_of([episode], 0.5)["low/first_violation"] == 0.5
    training = Satisfaction(period=0.5)
    training.add(episode)
    assert training.metrics()["goal/first_violation"] == 1.5


def test_open_end_warns() -> None:
    with pytest.warns(UserWarning, match="at_termination"):
        evaluation({"kept": SPECS["kept"]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        evaluation({"up": SPECS["up"]})


def test_saved_time_counts_only_stops() -> None:
    def saved(specs: Mapping[str, str]) -> list[float]:
        found = evaluate_policy(
            still,
            lambda: Replay(VALUES),
            specs,
            SIGNALS,
            episodes=1,
            period=1,
            stop="violation",
            duration=5,
        )
        return [each.saved for each in found.requirements.values()]

    assert saved({"low": SPECS["low"], **GOAL}) == [4.0, 0.0]
    assert saved(GOAL) == [0.0]


def test_tables_and_pages_name_the_end(tmp_path: Path) -> None:
    run = run_of(SPECS)
    shown = [line.split() for line in run_table([run])]
    certain = {
        name: line[line.index(name) - 2 : line.index(name)]
        for line in shown
        for name in SPECS
        if name in line
    }
    assert certain == {
        "goal": ["the", "end"],
        "kept": ["the", "end"],
        "up": ["0.5", "s"],
        "low": ["0.5", "s"],
    }
    assert "VIOLATED at the end" in repr(run.histories["goal"])
    assert "the end" in run._repr_html_()
    evaluation().save(tmp_path / "e.json")
    pages = {each.name: each for each in section_of(tmp_path / "e.json", ROOM).requirements}
    assert {each.violated_at for each in pages["goal"].trials} == {Moment(LAST, 1.5)}
    assert {each.violated_at for each in pages["kept"].trials} == {None}
    assert pages["goal"].worst[0].decided_at is None
    assert pages["low"].worst[0].decided_at == Moment(1, 0.5)


def test_files_keep_both_moments(tmp_path: Path) -> None:
    for period in (0.5, None):
        run = run_of(SPECS, period=period)
        run.save(tmp_path / "run.parquet")
        again = Run.load(tmp_path / "run.parquet")
        assert again == run
        assert (again.violated_by, again.violated_at) == ("low", 1)
        assert again.outcomes == run.outcomes
    found = evaluation()
    found.save(tmp_path / "e.json")
    again_ = Evaluation.load(tmp_path / "e.json")
    assert again_.record[0].outcomes == found.record[0].outcomes
    kept = json.loads((tmp_path / "e.json").read_text())["trials"][0]["outcomes"]
    assert kept["goal"]["decided_at"] is None
    assert kept["goal"]["ended_at"] == {"sample": LAST, "seconds": 1.5}
    assert "ended_at" not in kept["low"]


@pytest.mark.parametrize("period", [0.5, None])
def test_record_keeps_both_moments(tmp_path: Path, period: float | None) -> None:
    runs = [run_of(GOAL, period=period), run_of({"goal": "eventually(x > 1.5)"}, period=period)]
    record = Record([run.trial(Case({"k": k})) for k, run in enumerate(runs)], GOAL)
    columns, scale = record.columns(), period or 1
    assert columns["decided_at(goal)"] == [None, scale]
    assert columns["ended_at(goal)"] == [LAST * scale, None]
    assert columns["ended_sample(goal)"] == [LAST, None]
    assert record.has_times is (period is not None)
    assert Record(list(record)[:1], GOAL).has_times is (period is not None)
    assert record.results()["goal"].first_violations.tolist() == [LAST * scale]
    record.save(tmp_path / "record.parquet")
    assert list(Record.load(tmp_path / "record.parquet")) == list(record)
    assert "ended_at(goal)" not in Record(list(record)[1:], GOAL).columns()


def test_older_file_keeps_times() -> None:
    found = run_of(GOAL).outcomes["goal"]
    kept = plain_outcome(found)
    kept["decided_at"] = kept.pop("ended_at")
    old = outcome_of(kept)
    assert isinstance(old, Outcome)
    assert old == replace(found, decided=found.ended, ended=None)
    assert old.violated == found.violated == Moment(LAST, 1.5)


def test_older_run_keeps_times() -> None:
    run = run_of(GOAL)
    kept = plain_run(run)
    course = kept["courses"]["goal"]
    course["decided_at"] = course.pop("ended_at")
    old = Run(**run_fields(kept))
    assert (old.violated_by, old.violated_at) == ("goal", LAST)
    assert old.outcomes["goal"].violated == run.outcomes["goal"].violated


def outcome(verdict: Verdict, decided: int | None, ended: int | None = None) -> Outcome:
    return Outcome.at((0.0, 0.0, 0.0), verdict, decided, None, ended=ended)


def test_conjunction_has_moment_of_decider() -> None:
    good, bad = Verdict.SATISFIED, Verdict.VIOLATED
    for parts, expected in [
        ([outcome(good, 1), outcome(good, 2)], outcome(good, 2)),
        ([outcome(good, 1), outcome(good, None, 3)], outcome(good, None, 3)),
        ([outcome(good, 1), outcome(good, None)], outcome(good, None)),
        ([outcome(bad, None, 3), outcome(bad, 2), outcome(good, 1)], outcome(bad, 2)),
        ([outcome(bad, None, 3), outcome(good, 1)], outcome(bad, None, 3)),
        ([outcome(Verdict.UNDECIDED, None), outcome(good, 1)], outcome(Verdict.UNDECIDED, None)),
    ]:
        assert together(parts) == expected
        assert together(parts[::-1]) == expected


def test_open_verdicts_have_no_moment() -> None:
    assert outcome(Verdict.SATISFIED, 2).violated_at is None
    assert outcome(Verdict.SATISFIED, None, 3).violated is None
    assert outcome(Verdict.VIOLATED, None).violated_at is None
