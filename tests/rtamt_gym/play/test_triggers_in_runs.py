"""Every run reports how often its requirements were triggered, as `rtamt.judge` does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from implying import requirements
from profiles import examples
from strategies import VARIABLES, Trace, length, sample, traces

import rtamt
from rtamt import Formula
from rtamt.monitors import TriggerCount
from rtamt_gym import Parameter, Runner, StlMonitor, evaluate_policy, falsify, simulate, sweep
from rtamt_gym.judging.judge import TriggerCounter
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.play.history import Stop
from rtamt_gym.results import Record, Run
from rtamt_gym.results.outcome import Outcome

End = Literal["complete", "cut", "open"]
RESPONSE = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
SPECS = {"answered": RESPONSE, "calm": "always(gnt < 99)"}
LEAN = {"right": "always(angle > 0.02 implies eventually[0:0.1](angle < 0.02))"}
ANGLE = {"angle": "obs[2]"}


def judged(run: Run, name: str, end: End) -> rtamt.Judgement:
    """Return the judgement of the samples of a run."""
    course = run.histories[name]
    spec = course.specification
    whole = spec.always() if run.view == "step" else spec
    period = None if run.period is None else f"{run.period.numerator / run.period.denominator}s"
    return rtamt.judge(whole, run.signals, period, end, n=run.steps + 1, align=run.align)


def same(found: Outcome, expected: rtamt.Judgement) -> bool:
    return (found.triggers, found.vacuous, found.never_triggered) == (
        expected.triggers,
        expected.vacuous,
        expected.never_triggered,
    )


def server(every: float = 3.0, late: float = 1.0) -> Iterator[dict[str, float]]:
    """A server with a request at every third step, and an answer a step later."""
    for i in range(20):
        yield {"req": 5.0 * (i % round(every) == 1), "gnt": 5.0 * ((i - late) % every == 1)}


@settings(max_examples=examples(60))
@given(
    formula=requirements(2),
    trace=traces(most=8),
    stop=st.sampled_from(["end", "violation", "decided", "known", "verdicts"]),
    duration=st.sampled_from([None, 2, 5]),
    at_termination=st.sampled_from(["complete", "cut", "failure"]),
    at_truncation=st.sampled_from(["complete", "cut", "open"]),
)
def test_a_run_says_what_the_judgement_of_its_samples_says(
    formula: Formula,
    trace: Trace,
    stop: Stop,
    duration: float | None,
    at_termination: AtTermination,
    at_truncation: End,
) -> None:
    spec = rtamt.Specification.of(formula)
    spec = spec if spec.looks_ahead else spec.always()
    run = simulate(
        [sample(trace, i) for i in range(length(trace))],
        {"p": spec},
        {name: name for name in VARIABLES},
        period=1,
        stop=stop,
        duration=duration,
        at_termination=at_termination,
        at_truncation=at_truncation,
    )
    ended: dict[str, End] = {
        "terminated": "complete" if at_termination == "failure" else at_termination,
        "duration": at_truncation,
    }
    found = run.outcomes["p"]
    expected = judged(run, "p", ended.get(run.ended, "open"))
    if found.verdict is expected.verdict:
        assert same(found, expected)
        return
    # Only the end violates it, so that an answer could be missing.
    assert (at_termination, found.verdict, found.vacuous) == ("failure", -1, False)
    assert found.triggers == tuple(replace(item, vacuous=False) for item in expected.triggers)


@pytest.mark.parametrize("nan", ["hold", "unknown"])
def test_samples_that_are_nan_are_read_as_its_monitors_read_them(
    nan: rtamt.typing.NanPolicy,
) -> None:
    rows = [{"req": x, "gnt": 5.0} for x in (0.0, 4.0, np.nan, 0.0)]
    found = simulate(rows, SPECS, period=1, stop="end", nan=nan).outcomes["answered"]
    columns = {name: [row[name] for row in rows] for name in ("req", "gnt")}
    assert same(found, rtamt.judge(RESPONSE, columns, 1, "complete", nan=nan))
    (asked,) = found.triggers or ()
    assert isinstance(asked, TriggerCount)
    assert asked.samples == (2 if nan == "hold" else 1)


def test_each_instant_is_asked_in_the_view_of_steps() -> None:
    rows = [{"req": 5.0 * (i in (1, 4)), "gnt": 9.0} for i in range(6)]
    response = "req >= 3 implies gnt >= 3"
    run = simulate(rows, {"answered": response}, view="step", stop="end")
    assert same(run.outcomes["answered"], judged(run, "answered", "complete"))
    assert run.outcomes["answered"].trigger_count == 2


def test_a_search_has_the_rows_of_whole_runs() -> None:
    space = [Parameter("late", 0.0, 2.0), Parameter("every", 2.0, 4.0)]
    done = sweep(server, SPECS, space, samples=9, sampler="grid", period=1)
    for trial in done.record:
        run = done.replay(trial)
        assert trial.outcomes == run.outcomes
        for name in SPECS:
            assert same(trial.outcomes[name], judged(run, name, "complete"))
    assert {trial.outcomes["calm"].triggers for trial in done.record} == {()}
    assert all(trial.outcomes["answered"].trigger_count for trial in done.record)
    found = falsify(server, "always(req >= 3 implies gnt >= -1)", space, budget=12, period=1)
    for trial in found.record:
        (outcome,) = trial.outcomes.values()
        assert outcome.trigger_count, trial.ended


def test_a_search_that_judges_whole_runs_counts_in_them() -> None:
    found = falsify("rtamt/AutomaticTransmission-v0", "AT54", budget=12, reduce=False)
    whole = [trial for trial in found.record if trial.ended == "truncated"]
    assert whole
    for trial in whole[:2]:
        run = found._runner.simulate(trial.case, trial.seed, stop="end")
        assert same(trial.outcomes["AT54"], judged(run, "AT54", "cut"))


@pytest.mark.parametrize("how", [{}, {"n_jobs": 2}, {"n_envs": 2}])
def test_an_evaluation_has_the_rows_of_its_episodes(how: dict[str, Any]) -> None:
    options: dict[str, Any] = {"episodes": 3, "at_termination": "cut", **how}
    evaluation = evaluate_policy("zero", "CartPole-v1", LEAN, ANGLE, **options)
    for trial in evaluation.record:
        run = evaluation.replay(trial.seed or 0)
        found = trial.outcomes["right"]
        assert run.outcomes["right"] == found
        assert same(found, judged(run, "right", "cut"))
    asked = [trial.outcomes["right"].trigger_count for trial in evaluation.record]
    assert evaluation.requirements["right"].triggered == sum(map(bool, asked))


def test_environments_of_a_vector_environment_have_the_rows_of_single_ones() -> None:
    vector = gym.make_vec("CartPole-v1", num_envs=3, vectorization_mode="sync")
    options: dict[str, Any] = {"episodes": 4, "at_termination": "cut"}
    together = evaluate_policy("zero", vector, LEAN, ANGLE, **options).record
    alone = evaluate_policy("zero", "CartPole-v1", LEAN, ANGLE, **options).record
    assert [item.outcomes for item in together] == [item.outcomes for item in alone]
    assert any(item.outcomes["right"].trigger_count for item in alone)


def test_a_monitored_environment_is_counted_too() -> None:
    env = StlMonitor(gym.make("CartPole-v1"), LEAN, ANGLE, at_termination="cut")
    bare = simulate(gym.make("CartPole-v1"), LEAN, ANGLE, policy=act, seed=3, at_termination="cut")
    assert simulate(env, policy=act, seed=3).outcomes == bare.outcomes
    assert bare.outcomes["right"].trigger_count


def act(_obs: object) -> int:
    return 1


def test_a_run_that_fails_has_the_rows_of_what_it_was() -> None:
    def fails() -> Iterator[dict[str, float]]:
        yield from ({"req": 5.0, "gnt": 5.0}, {"req": 0.0, "gnt": 0.0})
        raise ValueError("broken")

    with Runner(fails, SPECS, period=1) as runner:
        ((_, trial),) = runner.run([{}])
    assert trial.error
    expected = rtamt.judge(RESPONSE, {"req": [5.0, 0.0], "gnt": [5.0, 0.0]}, 1, "open")
    assert same(trial.outcomes["answered"], expected)


# Files. --------------------------------------------------------------------------------------


def test_files_keep_what_was_counted(tmp_path: Path) -> None:
    rows = [{"req": 5.0, "gnt": 5.0}] * 3
    run = simulate(rows, SPECS, period=1)
    run.save(tmp_path / "run.parquet")
    assert Run.load(tmp_path / "run.parquet") == run
    space = [Parameter("late", 0.0, 2.0)]
    record = sweep(server, SPECS, space, samples=3, sampler="grid", period=1).record
    record.save(tmp_path / "record.parquet")
    assert Record.load(tmp_path / "record.parquet") == record
    frame = record.to_frame()
    assert frame["asked(answered)"].to_list() == [
        trial.outcomes["answered"].trigger_count for trial in record
    ]
    assert "asked(calm)" not in frame
    evaluation = evaluate_policy(
        "zero", "CartPole-v1", LEAN, ANGLE, episodes=2, at_termination="cut"
    )
    evaluation.save(tmp_path / "evaluation.json")
    assert type(evaluation).load(tmp_path / "evaluation.json") == evaluation


def test_samples_are_kept_only_where_a_requirement_may_be_asked() -> None:
    calm = {"calm": rtamt.parse("always(gnt < 99)")}
    assert not TriggerCounter(calm, EvaluationOptions())
    assert TriggerCounter(calm | {"answered": rtamt.parse(RESPONSE)}, EvaluationOptions())
    found = TriggerCounter(calm, EvaluationOptions()).evidence(
        {}, 3, "cut", {"calm": rtamt.Verdict.SATISFIED}
    )
    assert (found["calm"].triggers, found["calm"].vacuous) == ((), False)
