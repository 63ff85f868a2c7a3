"""`simulate` evaluates the end of a run as the wrapper evaluates the end of an episode."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import pytest
import rtamt_envs  # noqa: F401 - registers the scenarios
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, sample, traces

import rtamt
from rtamt import EpisodeMonitor, Formula, InputError, Verdict, judge
from rtamt_gym import Runner, StepMonitor, StlMonitor, simulate

TERMINATION = ("complete", "cut", "failure")
TRUNCATION = ("cut", "complete", "open")

SPECS = {
    "near": "always(abs(x) < 1)",
    "upright": "always(abs(angle) < 0.15)",
    "later": "always[0:4](abs(x) < 9)",
    "goal": "eventually(x > 0.3)",
    "again": "always(eventually[0:0.3](angle < 9))",
}
SIGNALS = {"x": "obs[0]", "angle": "obs[2]"}


def sign(value: float) -> float:
    return math.copysign(1.0, value)


@given(
    formula=formulas(depth=2, endless=True),
    trace=traces(),
    end=st.sampled_from(("complete", "cut", "open", "failure")),
    by_itself=st.booleans(),
)
def test_the_last_values_of_a_run_are_those_of_a_monitor_after_the_same_end(
    formula: Formula,
    trace: Trace,
    end: Any,  # noqa: ANN401
    by_itself: bool,  # noqa: FBT001
) -> None:
    formula = formula.always()
    rows = [sample(trace, i) for i in range(length(trace))]
    assume(by_itself or len(rows) > 1)  # a duration has one step or more
    monitor = EpisodeMonitor(formula)
    for row in rows:
        monitor.update({name: row[name] for name in monitor.variables})
    failed = end == "failure" and monitor.verdict == Verdict.UNDECIDED
    lower = monitor.lower
    by_samples = monitor.verdict
    if end not in {"open", "failure"}:
        monitor.finish(end)
    if by_itself or end == "failure":
        if end == "open":
            return
        run = simulate(rows, formula, period=1, stop="end", at_termination=end)
        assert run.ended == "terminated"
    else:
        longer = [*rows, rows[-1]]
        duration = len(rows) - 1
        run = simulate(longer, formula, period=1, stop="end", duration=duration, at_truncation=end)
        assert run.ended == "duration"
    (course,) = run.histories.values()
    verdict = Verdict.VIOLATED if failed else monitor.verdict
    assert (course.verdict, course.verdicts[-1]) == (verdict, verdict)
    assert (course.final, course.robustness[-1]) == (monitor.robustness, monitor.robustness)
    last = (course.lower[-1], course.upper[-1])
    assert last == (lower, 0.0) if failed else last == (monitor.lower, monitor.upper)
    assert sign(last[1]) == (-1.0 if failed else sign(monitor.upper))
    assert (run.violated_by is not None) == (verdict < 0)
    assert (course.decided_at is None) == (by_samples == Verdict.UNDECIDED)
    assert course.ended_at == (len(rows) - 1 if verdict and not by_samples else None)
    judged = judge(formula, trace, n=len(rows), end="open")
    assert course.decided_at == judged.decided_at
    if verdict < 0:
        assert run.violated_at == (len(rows) - 1 if not by_samples else course.decided_at)


@pytest.mark.parametrize("at_termination", TERMINATION)
@pytest.mark.parametrize("at_truncation", TRUNCATION)
@pytest.mark.parametrize("limit", [8, 500])
def test_a_run_ends_as_an_episode_of_the_wrapper(
    at_termination: Any,  # noqa: ANN401
    at_truncation: Any,  # noqa: ANN401
    limit: int,
) -> None:
    ends = {"at_termination": at_termination, "at_truncation": at_truncation}
    env = gym.make("CartPole-v1", max_episode_steps=limit)
    run = simulate(env, SPECS, SIGNALS, policy=lambda _: 1, seed=4, stop="end", **ends)
    wrapped = StlMonitor(env, SPECS, SIGNALS, on_violation="report", **ends)
    wrapped.reset(seed=4)
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = wrapped.step(1)
    assert run.ended == ("truncated" if limit == 8 else "terminated")
    for name, course in run.histories.items():
        outcome = info["stl_episode"][name]
        assert course.verdict.name == outcome["verdict"]
        assert (course.final, course.decided_at) == (
            outcome["robustness"],
            outcome.get("decided_at"),
        )
        assert course.ended_at == outcome.get("ended_at")
    assert run.violated_by == info.get("stl_violated_by")
    assert min(course.upper[-1] for course in run.histories.values()) == info["stl_upper"]


def test_what_the_options_make_of_a_fall_and_of_a_time_limit() -> None:
    def verdict(limit: int, **ends: Any) -> str:  # noqa: ANN401
        env = gym.make("CartPole-v1", max_episode_steps=limit)
        spec = "always(abs(x) < 1)"
        run = simulate(env, spec, SIGNALS, policy=lambda _: 1, seed=4, **ends)
        return run.verdict.name

    assert [verdict(500, at_termination=end) for end in TERMINATION] == [
        "SATISFIED",
        "SATISFIED",
        "VIOLATED",
    ]
    assert verdict(5) == "SATISFIED"
    assert [verdict(5, at_truncation=end) for end in TRUNCATION] == [
        "SATISFIED",
        "SATISFIED",
        "UNDECIDED",
    ]


def test_a_fall_that_satisfies_an_invariant_is_told_where_nobody_has_said_what_it_means() -> None:
    env = gym.make("CartPole-v1")
    named: dict[str, Any] = {"signals": SIGNALS, "policy": lambda _: 1, "seed": 4}
    with pytest.warns(UserWarning, match=r"specification 'near' was open") as caught:
        simulate(env, {"goal": "eventually(x > 9)", "near": "always(abs(x) < 1)"}, **named)
    assert [item.filename for item in caught] == [__file__]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(env, "always(abs(x) < 1)", at_termination="complete", **named)
        simulate(env, "eventually(x > 9)", **named)  # the end does not satisfy it
        simulate(env, "eventually(abs(x) < 9)", **named)  # it was satisfied before
        simulate([{"x": 1.0}], "always(x < 3)")  # the samples are complete


def test_a_stopped_run_decides_nothing_more() -> None:
    rows = [{"x": float(i), "y": 0.0} for i in range(9)]
    specs = {"low": "always(x < 3)", "calm": "always(y < 1)"}
    run = simulate(rows, specs, at_termination="failure", at_truncation="complete")
    assert (run.ended, run.violated_by) == ("violation", "low")
    assert run.histories["calm"].verdict == Verdict.UNDECIDED


XML = """
<mujoco>
  <worldbody><body><joint type="slide" axis="0 0 1"/><geom size="1"/></body></worldbody>
</mujoco>
"""


def test_the_duration_of_a_monitor_that_runs_on_is_no_end_of_it() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    monitor = StepMonitor(model, mujoco.MjData(model), "always(z > -9)", {"z": "qpos[0]"})
    monitor.reset()
    first = simulate(monitor, duration=0.1)
    assert (first.ended, first.verdict) == ("duration", Verdict.UNDECIDED)
    second = simulate(monitor, duration=0.1)
    assert (second.first_sample, second.steps, monitor.samples) == (50, 50, 101)


def test_a_branch_of_a_monitor_ends_and_the_monitor_does_not() -> None:
    from rtamt_gym.results import Snapshot

    model = mujoco.MjModel.from_xml_string(XML)
    monitor = StepMonitor(model, mujoco.MjData(model), "always(z > -9)", {"z": "qpos[0]"})
    monitor.reset()
    start = Snapshot.of(monitor)
    for end, verdict in zip(TRUNCATION, ("SATISFIED", "SATISFIED", "UNDECIDED"), strict=True):
        branch = simulate(monitor, start=start, duration=0.1, at_truncation=end)  # type: ignore[arg-type]  # of TRUNCATION
        assert branch.verdict.name == verdict
    assert monitor.verdict == Verdict.UNDECIDED
    assert simulate(monitor, duration=0.1).steps == 50


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        (
            {"at_termination": "open"},
            "expected at_termination=None, 'complete', 'cut' or 'failure', got 'open'",
        ),
        (
            {"at_truncation": "failure"},
            "expected at_truncation='complete', 'cut' or 'open', got 'failure'",
        ),
    ],
)
def test_another_reading_is_refused(ends: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refused:
        simulate([{"x": 1.0}], "always(x < 3)", **ends)
    assert str(refused.value) == message


WAVES = st.lists(st.integers(-5, 5), min_size=31, max_size=60)


def sampled(values: list[int]) -> Iterator[Mapping[str, float]]:
    for number, value in enumerate(values):
        yield {"x": value, "y": values[number - 7], "z": -values[number - 3]}


@given(values=WAVES, level=st.integers(-3, 3))
@pytest.mark.parametrize(
    "text",
    [
        "always[0:12](x < 4)",
        "eventually[3:15](x > 2) or always[0:20](y < 4)",
        "always[0:9](x < 5) implies always[0:4](y < 2)",
        "always[0:20](x > -6) until[0:9] y > 4",
    ],
)
def test_the_whole_run_becomes_what_is_known_at_the_stop(
    text: str, values: list[int], level: int
) -> None:
    whole = simulate(sampled(values), text, stop="end", period=1).histories["spec"]
    run = simulate(sampled(values), text, stop="known", above={"spec": level}, period=1)
    course = run.histories["spec"]
    low, high = course.lower[-1], course.upper[-1]
    assert low <= whole.final <= high
    if run.ended == "known":
        assert run.steps % 10 == 0
        assert low == high == whole.final or low > level
        assert run.steps < 10 or not (
            course.lower[-11] == course.upper[-11] or course.lower[-11] > level
        )
    elif run.ended == "violation":
        assert whole.verdict is rtamt.Verdict.VIOLATED
    else:
        assert course.final == whole.final


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("level", [math.inf, 500.0, 2000.0])
def test_environments_know_what_runs_alone_know(level: float) -> None:
    env = gym.make("rtamt/AutomaticTransmission-v0")
    cases = [{"throttle": t, "brake": b} for t in (0.0, 30.0, 90.0) for b in (0.0, 300.0)]
    rows = []
    for batch in (1, 100):
        with Runner(env, ["AT6a", "AT2"], stop="known", batch=batch) as runner:
            rows.append(dict(runner.run(cases, range(6), above={"AT6a": level, "AT2": -math.inf})))
            assert runner.vectorized == (batch > 1)
    assert rows[0] == rows[1]
    assert {"known", "violation"} == {row.ended for row in rows[0].values()}


def test_numbers_to_stay_above_are_checked() -> None:
    with pytest.raises(InputError) as caught:
        simulate(sampled([1]), "always(x < 1)", period=1, above={"spec": 0})
    assert str(caught.value) == "expected above= with stop='known' alone, got stop='violation'"
    with pytest.raises(InputError) as caught:
        simulate(sampled([1]), "always(x < 1)", period=1, stop="known", above={"spek": 0})
    assert str(caught.value) == (
        "above= names an unknown specification 'spek'; the specifications are 'spec'; "
        "did you mean 'spec'?"
    )
