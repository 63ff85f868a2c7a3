"""Runs that are judged after their end have the rows of monitored runs."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import rtamt_envs  # noqa: F401 - registers the scenarios

import rtamt
from rtamt import Specification, Verdict
from rtamt_gym import Runner, Space
from rtamt_gym.play.history import Stop
from rtamt_gym.play.offline_runner import OfflineRunner, prefers_offline
from rtamt_gym.results.outcome import Moment
from rtamt_gym.results.trial import Trial

TRANSMISSION, CARS = "rtamt/AutomaticTransmission-v0", "rtamt/ChasingCars-v0"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("always[0:2](x > 0 implies eventually[0:1] x < 0)", True),
        ("eventually[0:2](x > 0 and not always[0:1] x < 0)", True),
        ("always[0:1] eventually[0:1](x > 0 or always[0:1] x > 1)", True),
        ("x < 3 and always[0:1]((eventually[0:1] x > 0) until[0:1] x > 1)", True),
        ("always[0:1] eventually[0:1] always[0:1] x > 0", False),
        ("always[0:3] x > 0 implies always[0:2] x > 1", False),
        ("always[0:3](x > 0 implies x > 1)", False),
        ("always[0:2](x > 0 implies eventually[0:1.5] x < 0)", False),  # later than the end
        ("always(x > 0 implies eventually[0:1] x < 0)", False),  # as late as any end
        ("always[0:2s](x > 0 implies eventually[0:1] x < 0)", True),
    ],
)
def test_windows_over_combinations_of_windows_are_judged_at_the_end(
    text: str, *, expected: bool
) -> None:
    def system(top: float) -> Iterator[Mapping[str, float]]:
        while True:
            yield {"x": top}

    with Runner(system, text, period=0.5, duration=3) as runner:
        assert prefers_offline(runner.requirements, runner) is expected
    for options in ({"view": "step"}, {"semantics": "output-robustness"}, {"duration": None}):
        with Runner(system, text, period=0.5, **{"duration": 3, **options}) as runner:  # type: ignore[arg-type]
            assert not prefers_offline(runner.requirements, runner)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("system", "names", "count"),
    [(TRANSMISSION, ["AT52", "AT54"], 16), (CARS, ["CC5"], 50)],
    ids=["AT", "CC"],
)
def test_rows_are_those_of_monitored_runs(system: str, names: list[str], count: int) -> None:
    def make(specs: Mapping[str, Specification], stop: Stop) -> Runner:
        return Runner(system, specs, stop=stop, batch=count)

    with Runner(system, names, batch=count, stop="violation") as runner:
        space = Space(runner.inputs, duration=runner.duration)
        points = np.random.default_rng(1).random((count, space.dimension))
        cases = [space.case(point) for point in points]
        seeds = range(count)
        expected = dict(runner.run(cases, seeds))
        whole = OfflineRunner(make(runner.requirements, "known"))
        assert prefers_offline(runner.requirements, runner)
        result = dict(whole.run(cases, seeds))
        whole.close()
    assert sorted(result) == list(range(count))
    verdicts = set()
    for index, row in expected.items():
        violated = any(item.verdict is Verdict.VIOLATED for item in row.outcomes.values())
        verdicts.add(violated)
        if violated:
            assert result[index] == row
        else:
            assert result[index] == _decided_at_the_end(row)
    assert verdicts == {True, False}


def _decided_at_the_end(row: Trial) -> Trial:
    at_end = {}
    for name, outcome in row.outcomes.items():
        at = outcome.decided
        assert at is not None
        assert at.sample
        assert at.seconds is not None
        last = round(row.simulated * at.sample / at.seconds)
        at_end[name] = replace(outcome, decided=Moment(last, row.simulated))
    return replace(row, outcomes=at_end)


TEXT = "always[0:2](x > 0 implies eventually[0:1] x < 0)"


def test_what_fails_or_ends_early_is_left_to_monitors() -> None:
    def system(steps: float) -> Iterator[Mapping[str, float]]:
        for step in range(int(abs(steps))):
            yield {"x": (-1.0) ** step}
        if steps < 0:
            raise ValueError("out of steps")

    def make(specs: Mapping[str, Specification], stop: Stop) -> Runner:
        return Runner(system, specs, stop=stop, period=0.5, duration=3)

    cases = [{"steps": steps} for steps in (20.0, 7.0, 6.0, 1.0, -20.0, -7.0, -6.0, -1.0)]
    specs = {"spec": rtamt.parse(TEXT)}
    whole, monitored = OfflineRunner(make(specs, "known")), make(specs, "known")
    result, expected = dict(whole.run(cases)), dict(monitored.run(cases))
    assert [result[index] for index in (2, 3, 6, 7)] == [expected[index] for index in (2, 3, 6, 7)]
    assert [result[index].error != "" for index in range(8)] == [False] * 6 + [True] * 2
    for index in (0, 1, 4, 5):
        outcome = result[index].outcomes["spec"]
        height = rtamt.evaluate(TEXT, {"x": [(-1.0) ** i for i in range(7)]}, Fraction(1, 2))[0]
        assert (outcome.robustness, outcome.lower, outcome.upper) == (height,) * 3
        assert (outcome.verdict, outcome.decided_at) == (Verdict.SATISFIED, 3.0)
