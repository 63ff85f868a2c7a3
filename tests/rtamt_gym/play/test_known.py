"""A run that stops once its robustness is known returns that robustness."""

import math
from collections.abc import Iterator, Mapping

import gymnasium as gym
import pytest
import rtamt_envs  # noqa: F401 - registers the scenarios
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import InputError
from rtamt_gym import Runner, simulate

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
