"""Vectorized cases equal single cases bit by bit, also if they stop early."""

from typing import Any, get_args

import gymnasium as gym
import pytest
import rtamt_envs
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt import RtamtError
from rtamt_gym import Case, Parameter, Runner, Signal, Space, Waveform, sweep
from rtamt_gym.inputs.case import WaveformInterpolation
from rtamt_gym.play.history import Stop
from rtamt_gym.results.trial import Trial
from rtamt_gym.systems.registry import make

SCENARIOS = tuple(f"rtamt/{name}-v0" for name in rtamt_envs.SCENARIOS)

ENVIRONMENTS: dict[str, Any] = {}


def environment(name: str) -> Any:  # noqa: ANN401
    """Return an environment, created once."""
    if name not in ENVIRONMENTS:
        ENVIRONMENTS[name] = make(name)
    return ENVIRONMENTS[name]


def spaces(env: gym.Env[Any, Any]) -> st.SearchStrategy[Space]:
    """Spaces over some parameters of a scenario, and over all of its actions or none."""
    scenario: Any = env.unwrapped.scenario  # type: ignore[attr-defined]  # of a scenario
    low, high = env.action_space.low, env.action_space.high  # type: ignore[attr-defined]  # a Box
    chosen = st.lists(st.sampled_from(scenario.parameters), unique=True, max_size=3)

    @st.composite
    def drawn(draw: st.DrawFn) -> Space:
        entries: list[Signal | Parameter] = draw(chosen) if scenario.parameters else []
        if not entries or draw(st.booleans()):
            how = draw(st.sampled_from(get_args(WaveformInterpolation)))
            entries += [
                Signal(
                    item.name, low[i], high[i], points=draw(st.integers(2, 4)), interpolation=how
                )
                for i, item in enumerate(scenario.actions)
            ]
        return Space(entries, duration=draw(st.sampled_from([1.7, 5.0])))

    return drawn()


@pytest.mark.slow
@settings(max_examples=examples(40))
@given(data=st.data())
def test_environments_are_single_runs_to_the_last_bit(data: st.DataObject) -> None:
    env = environment(data.draw(st.sampled_from(SCENARIOS)))
    space = data.draw(spaces(env))
    unit = st.lists(st.floats(0, 1), min_size=space.dimension, max_size=space.dimension)
    points = data.draw(st.lists(unit, min_size=1, max_size=5))
    seeds = [data.draw(st.integers(0, 2**32)) for _ in points]
    known = env.unwrapped.requirements
    names = data.draw(st.lists(st.sampled_from(sorted(known)), min_size=1, max_size=3, unique=True))
    options: dict[str, Any] = {
        "stop": data.draw(st.sampled_from(get_args(Stop))),
        "duration": data.draw(st.sampled_from([1.0, 2.55, 7.0])),
        "at_truncation": data.draw(st.sampled_from(["cut", "complete", "open"])),
    }
    cases = [space.case(point) for point in points]
    batch = data.draw(st.integers(2, 4))
    with Runner(env, names, batch=batch, **options) as entries:
        assert entries.vectorized
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(entries, "simulate", never)
            side_by_side = dict(entries.run(cases, seeds))
    with Runner(env, names, batch=1, **options) as alone:
        assert not alone.vectorized
        one_by_one = dict(alone.run(cases, seeds))
    assert list(one_by_one) == sorted(side_by_side)
    for index, row in one_by_one.items():
        assert row.error == ""
        # The text too: it distinguishes -0.0, which violates, and 0.0.
        assert same(side_by_side[index], row)


def never(*_: object) -> Any:  # noqa: ANN401
    raise AssertionError("a case of environments ran alone")


def same(one: Trial, other: Trial) -> bool:
    """Return whether two rows are equal bit by bit, except for their wall times."""
    cells = [repr(row.columns() | {"wall": 0.0}) for row in (one, other)]
    return one == other and cells[0] == cells[1]


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_runs_its_own_inputs_in_environments(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Runner(environment(name), duration=2) as runner:
        space = Space(runner.inputs, duration=2)
        cases = [space.case([height] * space.dimension) for height in (0.1, 0.8)] + [Case({})]
        expected = dict(Runner(environment(name), duration=2, batch=1).run(cases, range(3)))
        monkeypatch.setattr(runner, "simulate", never)
        rows = dict(runner.run(cases, range(3)))
        whole = {index: row for index, row, _ in runner.whole(cases, range(3))}
    assert all(same(rows[i], expected[i]) for i in range(3))
    assert sorted(whole) == [0, 1, 2]


@pytest.mark.parametrize("stop", get_args(Stop))
def test_a_whole_episode_in_environments_is_truncated_as_alone(stop: Stop) -> None:
    env = environment("rtamt/RequestGrant-v0")
    cases = [{"limit": limit, "noise": 0.5} for limit in (0.0, 2.0, 4.0, 8.0)]
    rows = [dict(Runner(env, stop=stop, batch=batch).run(cases, range(4))) for batch in (1, 3, 100)]
    for index in range(4):
        assert same(rows[0][index], rows[1][index])
        assert same(rows[0][index], rows[2][index])
    ended = {row.ended for row in rows[1].values()}
    assert (
        ended
        == {
            "end": {"truncated"},
            "violation": {"violation", "truncated"},
            "decided": {"violation", "decided"},
            "known": {"violation", "known"},
            "verdicts": {"decided"},
        }[stop]
    )


def test_environments_that_are_over_stop_and_are_given_before_the_others() -> None:
    env = environment("rtamt/AutomaticTransmission-v0")
    full, none = ({"throttle": held, "brake": 0.0} for held in (100.0, 0.0))
    with Runner(env, "AT2", stop="violation", duration=20) as runner:
        rows = list(runner.run([none, full, none], range(3)))
    assert [index for index, _ in rows] == [1, 0, 2]
    violated, held = rows[0][1], rows[1][1]
    assert violated.ended == "violation"
    assert violated.simulated == violated.outcomes["AT2"].decided_at == 6.11
    assert (held.ended, held.simulated) == ("duration", 20.0)


def test_what_no_environment_can_run_runs_alone() -> None:
    env = environment("rtamt/AutomaticTransmission-v0")
    cases: list[dict[str, float | Waveform]] = [
        {"throttle": Waveform([0.0], [50.0]), "brake": 0.0},  # in an environment
        {"throttle": Waveform([0.0], [50.0])},  # the baseline brakes
        {},  # the baseline drives, in an environment
    ]
    with Runner(env, "AT2", duration=1) as runner, Runner(env, "AT2", duration=1, batch=1) as alone:
        rows, others = dict(runner.run(cases)), dict(alone.run(cases))
    assert len(rows) == 3
    assert all(same(rows[i], others[i]) for i in range(3))


def test_an_error_of_an_environment_is_in_its_row_and_the_others_go_on() -> None:
    env = environment("rtamt/RequestGrant-v0")
    cases = [{"delay": 1.0}, {"dealy": 1.0}, {"delay": 2.0}, {"request": 9.0}]
    with Runner(env) as runner:
        rows = dict(runner.run(cases))
    assert [rows[i].ended for i in range(4)] == ["truncated", "error", "truncated", "error"]
    assert rows[1].error.startswith("InputError: rtamt/RequestGrant-v0 takes no 'dealy' of a case")
    assert rows[3].error == (
        "InputError: expected 'request' of the case from 0 to 8, the bounds of the action, got 9"
    )
    assert rows[1].case == Case({"dealy": 1.0})
    assert rows[1].outcomes == {}


def test_an_error_within_a_batch_leaves_the_other_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    env = environment("rtamt/RequestGrant-v0")
    with Runner(env) as runner, Runner(env, batch=1) as alone:
        expected = dict(alone.run([{"delay": 1.0}, {"delay": 2.0}], [1, 2]))
        monkeypatch.setattr(
            "rtamt_envs.vector.ScenarioVectorEnv.rollout", lambda *_: 1 / 0, raising=True
        )
        told = (
            "the vector environment of rtamt/RequestGrant-v0 raised ZeroDivisionError: division by "
            "zero; the cases ran one by one without an error"
        )
        with pytest.warns(RuntimeWarning, match=f"^{told}$"):
            rows = dict(runner.run([{"delay": 1.0}, {"delay": 2.0}], [1, 2]))
    assert all(same(rows[i], expected[i]) for i in range(2))


@pytest.mark.parametrize("period", [0.2, "50ms"])
def test_waveforms_follow_the_period_that_is_given(period: float | str) -> None:
    request = Signal("request", 0, 8, points=4, interpolation="linear")
    options: dict[str, Any] = {"samples": 4, "sampler": "random", "period": period}
    records = []
    for batch in (1, 100):
        done = sweep("rtamt/RequestGrant-v0", "always(req < 3)", [request], batch=batch, **options)
        assert {row.simulated for row in done.record} == {done.space.duration}
        records.append(done.record)
    assert records[0] == records[1]
    # The period sets the speed of time, not the simulation.
    usual = sweep(
        "rtamt/RequestGrant-v0", "always(req < 3)", [request], samples=4, sampler="random"
    )
    heights = [done.numbers("robustness(spec)").tolist() for done in (records[0], usual.record)]
    assert heights[0] == heights[1]


def wrapped() -> gym.Env[Any, Any]:
    return gym.make("rtamt/RequestGrant-v0", max_episode_steps=20)


@pytest.mark.parametrize(
    ("options", "vectorized"),
    [
        ({}, True),
        ({"signals": {"req": "obs[0]", "gnt": "obs[1]"}}, True),
        ({"signals": {"gnt": "obs[0]"}}, True),
        ({"signals": {"gnt": lambda step: step.obs[1]}}, False),
        ({"signals": {"gnt": ("action[0]", 0.0)}}, False),
        ({"policy": lambda _: [1.0]}, False),
        ({"batch": 1}, False),
    ],
)
def test_environments_are_taken_where_they_give_the_same(options: Any, vectorized: bool) -> None:  # noqa: ANN401, FBT001
    with Runner(wrapped(), **options) as runner:
        assert runner.vectorized == vectorized
        rows = dict(runner.run([{"delay": 1.0}, {"delay": 0.5}], [3, 4]))
        for row in rows.values():
            run = runner.simulate(row.case, row.seed)
            assert same(run.trial(row.case), row)
    assert rows[0].simulated == 2.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"signals": {"gnt": "obs[7]"}}, "signal 'gnt': obs[7] does not fit: "),
        ({"signals": {"gnt": "info.granted"}}, "signal 'gnt', column 5: expected '['"),
        ({"substeps": True}, "specification 'granted' has bounds in time, but "),
    ],
)
def test_what_no_environment_reads_is_refused_in_the_words_of_a_single_run(
    options: Any,  # noqa: ANN401
    said: str,
) -> None:
    with Runner(wrapped(), **options) as runner:
        assert not runner.vectorized
        with pytest.raises(RtamtError) as caught:
            list(runner.run([{}]))
    assert str(caught.value).startswith(said)


def test_a_signal_of_an_info_is_read_one_by_one() -> None:
    with Runner(wrapped(), signals={"gnt": "info['granted']"}) as runner:
        assert not runner.vectorized
        ((_, row),) = runner.run([{}])
    assert row.error.startswith("AbsentError: signal 'gnt': the info has no info['granted']")
