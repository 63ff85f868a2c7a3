"""Sweeps: their runs, their stored data, and errors."""

import math
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

from rtamt import InputError, InputTypeError, SpecificationError
from rtamt_gym import Case, Parameter, Runner, Signal, Space, Waveform, simulate, sweep
from rtamt_gym.results import Record, Sweep
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.sweeps.effects import map_of
from rtamt_gym.search.sweeps.pictures import draw_map
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

DRY = {"dry": "always(level < 2)"}
INFLOW, LEAK = Parameter("inflow", 0.1, 0.3), Parameter("leak", 0.1, 0.2)
SYSTEM = "rtamt/RequestGrant-v0"


def tank(inflow: float, leak: float = 0.1) -> Iterator[dict[str, float]]:
    level = 1.0
    for _ in range(20):
        yield {"level": level}
        level += inflow - leak * level


def test_rows_are_the_runs_of_their_cases_in_the_order_of_the_points() -> None:
    done = sweep(tank, DRY, [INFLOW, LEAK], samples=3, sampler="grid", period=1)
    assert [tuple(row.case.columns().values()) for row in done.record] == [
        pytest.approx((inflow, leak)) for inflow in (0.1, 0.2, 0.3) for leak in (0.1, 0.15, 0.2)
    ]
    for row in done.record:
        run = simulate(tank, DRY, case=row.case, period=1, stop="end")
        assert row.outcomes["dry"].robustness == run.histories["dry"].final
        assert (row.ended, row.simulated, row.seed) == ("terminated", 19.0, None)
        assert done.replay(row) == run


def test_seeds_belong_to_cases_and_rows_do_not_depend_on_the_batch() -> None:
    options: dict[str, Any] = {"samples": 7, "sampler": "lhs", "seed": 5}
    noise = Parameter("noise", 0.1, 1)
    records = [sweep(SYSTEM, None, [noise], batch=n, **options).record for n in (1, 3, 100)]
    assert records[0] == records[1] == records[2]
    assert [row.seed for row in records[0]] == list(range(5, 12))


def test_a_scenario_offers_its_inputs_and_requirements() -> None:
    done = sweep(SYSTEM, samples=2)
    assert list(done.requirements) == ["granted"]
    assert list(done.space.entries) == ["request"]
    assert done.space.duration == 15.0
    assert done.record.system == SYSTEM


def test_requirements_are_names_texts_or_several_of_both() -> None:
    def names(given: Any) -> list[str]:  # noqa: ANN401
        return list(sweep(SYSTEM, given, [Parameter("limit", 0, 8)], samples=1).requirements)

    assert names("granted") == ["granted"]
    assert names("always(gnt < 9)") == ["spec"]
    assert names(["granted", "low = always(gnt < 9)"]) == ["granted", "low"]
    assert names(["always(gnt < 9)", "always(gnt < 8)"]) == ["spec", "spec2"]
    assert names({"mine": "granted", "low": "always(gnt < 9)"}) == ["mine", "low"]


def test_a_fixed_number_is_in_every_case() -> None:
    done = sweep(tank, DRY, [INFLOW], fixed={"leak": 0.2}, samples=2, sampler="grid", period=1)
    assert [row.case for row in done.record] == [
        Case({"inflow": 0.1, "leak": 0.2}),
        Case({"inflow": 0.3, "leak": 0.2}),
    ]
    assert list(done.space.entries) == ["inflow"]


def test_signals_last_as_long_as_a_run() -> None:
    done = sweep(
        lambda time, u: {"y": u(time)},
        "always(y < 9)",
        {"u": Signal("u", 0, 10, points=2, interpolation="linear")},
        samples=3,
        duration=4,
        period=0.5,
    )
    for row in done.record:
        wave = row.case["u"]
        assert isinstance(wave, Waveform)
        assert tuple(wave.times) == (0.0, 4.0)
        assert row.outcomes["spec"].robustness == 9 - max(wave.values)


MODEL = """<mujoco model="rolling"><option timestep="0.01"/><worldbody>
<body name="ball"><freejoint/>
<geom name="ball" size="0.1" mass="1"/></body></worldbody></mujoco>"""


def test_a_model_starts_each_run_where_it_stood() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    before = data.qpos.copy()
    masses = Parameter("qpos[2]", 1.0, 2.0)
    done = sweep(
        (model, data),
        "always(height > 0.5)",
        [masses],
        signals={"height": "qpos[2]"},
        samples=3,
        sampler="grid",
        duration=0.1,
    )
    again = [done.replay(row).histories["spec"].final for row in reversed(done.record)][::-1]
    heights = [row.outcomes["spec"].robustness for row in done.record]
    assert heights == again
    assert np.diff(heights) == pytest.approx([0.5, 0.5])
    assert done.record.system == "rolling"
    assert (data.qpos == before).all()


def fragile(x: float) -> Iterator[dict[str, float]]:
    yield {"level": x}
    if x > 0.5:
        raise ValueError(f"too much: {x:g}")
    yield {"level": 3.0}


def test_errors_are_kept_with_what_came_before_and_the_sweep_goes_on() -> None:
    with pytest.warns(FailedSimulationWarning) as caught:
        done = sweep(fragile, DRY, [Parameter("x", 0, 1)], samples=3, sampler="grid", period=1)
    assert str(caught[0].message) == (
        "1 of 3 simulations failed, the first with x=1: ValueError: too much: 1"
    )
    assert caught[0].filename == __file__
    assert [row.ended for row in done.record] == ["terminated", "terminated", "error"]
    failed = done.record[2]
    assert failed.error == "ValueError: too much: 1"
    assert failed.outcomes["dry"].robustness == 1.0
    assert failed.simulated == 0.0
    assert "1 of 3 simulations failed, the first with x=1:\n  ValueError: too much: 1" in str(done)


def test_a_sweep_prints_its_requirements_and_the_map_of_a_grid() -> None:
    done = sweep(tank, DRY, [INFLOW, LEAK], samples=3, sampler="grid", period=1)
    head, line, empty, took, *rest = str(done).splitlines()
    assert head == "requirement  satisfied  violated  minimum  median  maximum"
    assert line == "dry                  8         1    -0.73   0.682        1"
    assert took == "9 simulations, 171 simulated seconds"
    assert (empty, rest) == (
        "",
        [
            "",
            "robustness of dry over leak:",
            "inflow     0.1   0.15    0.2",
            "   0.1   1.000  1.000  1.000",
            "   0.2   0.135  0.682  1.000",
            "   0.3  -0.730  0.046  0.507",
        ],
    )
    assert repr(done) == "<Sweep of tank: 9 simulations, 1 violates>"


def test_the_cells_of_a_map_are_those_of_the_columns() -> None:
    done = sweep(tank, DRY, [INFLOW, LEAK], samples=3, sampler="grid", period=1)
    upright, turned = done.map(), done.map(x="inflow", y="leak")
    assert (upright.x, upright.y) == ("leak", "inflow")
    assert upright.cells is not None
    assert turned.cells is not None
    assert (turned.cells == upright.cells.T).all()
    assert upright.cells.ravel().tolist() == [row.outcomes["dry"].robustness for row in done.record]


def test_a_map_of_more_columns_shows_the_least() -> None:
    start = Parameter("start", values=(1, 2))

    def slow(inflow: float, leak: float, start: float) -> Iterator[dict[str, float]]:
        yield {"level": start + inflow - leak}

    done = sweep(slow, DRY, [INFLOW, LEAK, start], samples=2, sampler="grid", period=1)
    found = done.map(x="leak", y="inflow")
    assert found.folded
    assert found.cells is not None
    assert found.cells.ravel() == pytest.approx([0.0, 0.1, -0.2, -0.1], abs=1e-12)
    assert done.map(x="start", y="leak").cells is not None


def test_a_space_that_is_made_keeps_its_duration() -> None:
    for duration, lasts in ((3.0, 3.0), (None, 19.0)):
        space = Space([INFLOW], duration=duration)
        done = sweep(tank, DRY, space, samples=2, period=1, duration=19)
        assert done.space.duration == lasts


def test_a_table_of_a_map_needs_cells_and_room() -> None:
    points = sweep(tank, DRY, [INFLOW, LEAK], samples=5, sampler="random", period=1).map()
    assert (points.cells, points.lines()) == (None, [])
    many = sweep(tank, DRY, [INFLOW, LEAK], samples=13, sampler="grid", period=1, batch=1)
    assert many.map().lines() == []
    numbers: list[int] = []
    for done in (many, sweep(tank, DRY, [INFLOW, LEAK], samples=3, sampler="grid", period=1)):
        figure = draw_map(done.map(), done.space, "dry")
        numbers.append(len(figure.axes[0].texts))
    assert numbers == [0, 9]  # 169 numbers could not be read


def test_failures_alone_have_no_map() -> None:
    rows = [
        Trial(Case({"a": x, "b": y}), None, {}, "error", 0, 0, "no") for x, y in ((1, 2), (3, 4))
    ]
    space = Space([Parameter("a", 0, 9), Parameter("b", 0, 9)])
    with pytest.raises(InputError) as caught:
        map_of(Record(rows, {"dry": ""}, "tank"), space, None, None, None)
    assert str(caught.value) == "cannot draw a map: no simulation has a robustness of 'dry'"


@pytest.mark.parametrize(
    ("seeds", "message"),
    [
        ([1, 2], "expected 1 seeds, one for each case, got 2"),
        ([1], "seeds= are for environments, got some for tank"),
    ],
)
def test_seeds_are_one_for_each_case_of_an_environment(seeds: list[int], message: str) -> None:
    with Runner(tank, DRY, period=1) as runner, pytest.raises(InputError) as caught:
        list(runner.run([{"inflow": 0.1}], seeds))
    assert str(caught.value) == message


def test_a_sweep_that_is_saved_is_loaded_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "sweep.parquet"
    space = [
        Signal("request", 0, 8, points=3, interpolation="pchip"),
        Parameter("delay", 1, 2, log=True, default=math.inf, unit="s"),
        Parameter("limit", values=(1, 8)),
    ]
    done = sweep(SYSTEM, space=space, samples=4, sampler="morris", seed=3)
    done.save(path)
    loaded = Sweep.load(path)
    assert (loaded.record, loaded.space) == (done.record, done.space)
    assert (loaded.sampler, loaded.seed) == ("morris", 3)
    assert str(loaded.indices()) == str(done.indices())
    with pytest.raises(InputError) as caught:
        loaded.replay(loaded.worst())
    assert str(caught.value) == (
        "a sweep from a file or a pickle has no system to run; write simulate(system, specs, "
        "case=row.case, seed=row.seed)"
    )
    pickled = pickle.loads(pickle.dumps(done))
    assert (pickled.record, pickled.space) == (done.record, done.space)
    assert str(pickled.indices()) == str(done.indices())
    done.record.save(path)
    with pytest.raises(InputError) as caught:
        Sweep.load(path)
    assert str(caught.value) == f"{path} is a record, not a sweep; read it with Record.load"


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("kind", ["grid", "points"])
def test_pictures_are_written(tmp_path: Path, kind: str) -> None:
    sampler: Any = "grid" if kind == "grid" else "random"
    done = sweep(tank, DRY, [INFLOW, LEAK], samples=4, sampler=sampler, period=1)
    for name, draw in (("map.png", done.heat_map), ("points.svg", done.scatter)):
        draw(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 5000


def broken(x: float) -> Iterator[dict[str, float]]:
    raise ValueError("never starts")
    yield {"level": x}


@pytest.mark.parametrize(
    ("arguments", "options", "kind", "message"),
    [
        (
            (SYSTEM, "garnted"),
            {},
            InputError,
            (
                "rtamt/RequestGrant-v0 has no requirement 'garnted'; it has 'granted'; "
                "did you mean 'granted'?"
            ),
        ),
        (
            ("rtamt/RequestGran-v0",),
            {},
            InputError,
            (
                "cannot make rtamt/RequestGran-v0: Environment `RequestGran` doesn't exist in "
                "namespace rtamt. Did you mean: `RequestGrant`?"
            ),
        ),
        (
            ("CartPole-v1", "always(x < 1)"),
            {},
            InputError,
            (
                "CartPole-v1 does not declare a space of parameters; give a space, as in "
                'sweep(system, requirements, [Parameter("mass", 1, 2)], ...)'
            ),
        ),
        (
            (tank, None, [INFLOW]),
            {},
            InputError,
            (
                "tank has no requirements of its own; give them after the system, such as "
                '"always(x < 1)"'
            ),
        ),
        (
            (tank, DRY, [INFLOW]),
            {"fixed": {"inflow": 1}},
            InputError,
            "expected 'inflow' varied or fixed, got both",
        ),
        (
            (tank, DRY, [Parameter("wall", 0, 1)]),
            {},
            InputError,
            "a varied parameter cannot have the name 'wall', a column of every record; rename it",
        ),
        (
            (broken, DRY, [Parameter("x", 0, 1)]),
            {"period": 1},
            InputError,
            "all 2 simulations failed, the first with ValueError: never starts",
        ),
        (
            (tank(0.1), DRY, [INFLOW]),
            {},
            InputTypeError,
            (
                "expected a system that restarts for each case, such as the id of an environment, "
                "a pair (model, data) or a function, got <generator object tank"
            ),
        ),
        (
            (SYSTEM,),
            {"stop": "never"},
            InputError,
            "expected stop='violation', 'decided', 'known', 'verdicts' or 'end', got 'never'",
        ),
        (
            (SYSTEM,),
            {"at_trunction": "open"},
            InputTypeError,
            (
                "sweep() got an unexpected keyword argument 'at_trunction'; did you mean "
                "'at_truncation'?"
            ),
        ),
        (
            (SYSTEM,),
            {"at_termination": "cutt"},
            InputError,
            "expected at_termination=None, 'complete', 'cut' or 'failure', got 'cutt'",
        ),
        (
            (3, "always(x < 1)", [INFLOW]),
            {},
            InputTypeError,
            (
                "expected an environment, a pair (model, data) of MuJoCo, a StepMonitor, Fmus, a "
                "function of time or an iterable of samples, got 3"
            ),
        ),
        (
            (SYSTEM,),
            {"policy": 3},
            InputTypeError,
            "expected a policy, a function from observation to action, got 3",
        ),
        (
            (SYSTEM,),
            {"view": "end"},
            InputError,
            "expected view='episode' or 'step', got 'end'",
        ),
        (
            ("plant.fmu", "always(x < 1)"),
            {},
            InputTypeError,
            "expected a system to run, got the name of a file; write Fmus('plant.fmu')",
        ),
        (
            (SYSTEM,),
            {"seed": -1},
            InputError,
            "expected seed= as a whole number, 0 or more, got -1",
        ),
        (
            (gym.make_vec("CartPole-v1", 2, vectorization_mode="sync"),),
            {},
            InputTypeError,
            "expected one environment, or its id, got SyncVectorEnv(CartPole-v1, num_envs=2)",
        ),
        ((SYSTEM,), {"batch": 0}, InputError, "expected batch= as 1 or more, got 0"),
        (
            (SYSTEM,),
            {"duration": -1},
            InputError,
            "expected duration= as a finite number above 0, got -1",
        ),
        (
            (SYSTEM, "always[0:0.05s](gnt < 1)"),
            {},
            SpecificationError,
            "STL:1:7: bound 0.05 s is not a multiple of the period 0.1 s (0.5 steps)",
        ),
        ((SYSTEM, []), {}, InputError, "expected at least one requirement, got none"),
        (
            (SYSTEM, ["granted", "granted"]),
            {},
            InputError,
            "expected one requirement 'granted', got two; name them: {...}",
        ),
        (
            (SYSTEM, 3),
            {},
            InputTypeError,
            "expected the name or the text of a requirement, got 3",
        ),
    ],
)
def test_mistakes_are_told_at_once(
    arguments: Any,  # noqa: ANN401
    options: Any,  # noqa: ANN401
    kind: type[Exception],
    message: str,
) -> None:
    with pytest.raises(kind) as caught:
        sweep(*arguments, **{"samples": 2} | options)
    assert str(caught.value).startswith(message)


def test_an_environment_that_is_given_stays_open() -> None:
    env = gym.make(SYSTEM)
    sweep(env, samples=2)
    env.reset()
    env.close()


def test_what_is_no_row_is_not_replayed() -> None:
    done = sweep(SYSTEM, samples=1)
    with pytest.raises(InputTypeError) as caught:
        done.replay(0)  # type: ignore[arg-type]  # the mistake
    assert str(caught.value) == (
        "expected a row of the record, such as sweep.worst() or sweep.record[0], got 0"
    )
