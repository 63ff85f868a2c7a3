"""A run as a record: saved, loaded, replayed, drawn."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import INFINITIES, Trace, formulas, length, sample, traces

import rtamt
from rtamt import Formula, InputError, Verdict
from rtamt_gym import Runner, simulate
from rtamt_gym.options.evaluation import View
from rtamt_gym.play.history import Stop
from rtamt_gym.play.summaries import run_table
from rtamt_gym.results import Run

SPECS = {"low": "always(x < 3)", "soon": "eventually[0:1](x > 2)"}


def run(*values: float, period: float | None = 0.5, label: str = "") -> Run:
    specs = SPECS if period else {"low": SPECS["low"]}
    return simulate([{"x": x} for x in values], specs, period=period, label=label)


@given(
    formula=formulas(depth=2, total=False),
    trace=traces(values=INFINITIES),
    period=st.sampled_from((1, "500ms", 1 / 3)),
    stop=st.sampled_from(("violation", "decided", "end")),
    view=st.sampled_from(("episode", "step")),
)
def test_a_run_that_was_saved_is_loaded_equal(
    formula: Formula,
    trace: Trace,
    period: float,
    stop: Stop,
    view: View,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path = tmp_path_factory.getbasetemp() / "run.parquet"
    rows = [sample(trace, i) for i in range(length(trace))]
    spec = formula if view == "step" else formula.always()
    made = simulate(rows, spec, period=period, stop=stop, view=view)
    made.save(path)
    loaded = Run.load(path)
    assert loaded == made
    assert (loaded.wall_time, loaded.replay().keys()) == (made.wall_time, made.replay().keys())


def test_a_saved_run_is_a_table_that_others_read(tmp_path: Path) -> None:
    made = run(1.0, 2.0, 5.0, 1.0)
    made.save(tmp_path / "run.parquet")
    table = pq.read_table(tmp_path / "run.parquet").to_pydict()
    assert list(table) == [
        "time",
        "x",
        *(f"{curve}({name})" for name in SPECS for curve in ("robustness", "lower", "upper")),
    ]
    assert table["time"] == [0.0, 0.5, 1.0]
    assert table["x"] == [1.0, 2.0, 5.0]
    assert table["upper(low)"] == [2.0, 1.0, -2.0]


def test_a_signal_called_time_stands_in_place_of_the_times(tmp_path: Path) -> None:
    made = simulate([{"time": 3.0}, {"time": 4.0}], "always(time > 0)")
    made.save(tmp_path / "run.parquet")
    assert pq.read_table(tmp_path / "run.parquet")["time"].to_pylist() == [3.0, 4.0]
    assert Run.load(tmp_path / "run.parquet") == made


@pytest.mark.parametrize("name", ["run.csv", "run", "run.feather"])
def test_a_run_is_saved_under_the_name_of_its_format_alone(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    with pytest.raises(InputError) as refused:
        run(1.0, 2.0, 5.0, 1.0).save(path)
    assert str(refused.value) == (
        f"cannot write {path}: expected a name that ends in .parquet, the format that holds all of "
        "a run; run.to_frame() has the columns for other formats"
    )
    assert not path.exists()


def test_what_holds_no_run_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.parquet"
    pq.write_table(pa.table({"x": [1.0]}), path)
    with pytest.raises(InputError) as refused:
        Run.load(path)
    assert str(refused.value) == f"{path} is not a run: expected a file of Run.save"
    path.write_text("x,y")
    with pytest.raises(InputError) as refused:
        Run.load(path)
    assert str(refused.value) == f"cannot read {path}: it is not a Parquet file"


def test_runs_differ_in_what_they_record_and_not_in_wall_time() -> None:
    assert run(1.0, 2.0) == run(1.0, 2.0)
    assert run(1.0, 2.0) != run(1.0, 2.5)
    assert run(1.0, 2.0) != run(1.0, 2.0, label="again")
    assert run(1.0) != 1.0
    assert run(1.0, 2.0).histories["low"] != run(1.0, 2.5).histories["low"]
    with pytest.raises(TypeError, match="unhashable"):
        hash(run(1.0))


def test_times_are_seconds_or_numbers_of_samples() -> None:
    assert run(1.0, 2.0, 2.0).times.tolist() == [0.0, 0.5, 1.0]
    assert run(1.0, 2.0, 2.0, period=None).times.tolist() == [0.0, 1.0, 2.0]
    tenths = simulate([{"x": 1.0}] * 8, "always(x < 3)", period=0.1)
    assert tenths.times.tolist() == [i / 10 for i in range(8)]
    assert (tenths.duration, run(1.0, 2.0, period=None).duration) == (0.7, 1.0)


def test_a_run_is_replayed_under_other_specifications() -> None:
    made = run(1.0, 2.0, 5.0, 1.0)
    replayed = made.replay({"high": "eventually[0:0.5](x > 4)"})
    assert {name: values.tolist() for name, values in replayed.items()} == {
        "high": [-2.0, 1.0, 1.0]
    }
    with pytest.raises(InputError) as refused:
        made.replay("always(y > 0)")
    assert str(refused.value) == (
        "specification 'spec' reads 'y', which was not recorded; the signals of the run are 'x'"
    )


def test_the_verdict_is_that_of_the_worst_specification() -> None:
    assert run(1.0, 5.0).verdict == Verdict.VIOLATED
    assert run(1.0, 2.5).verdict == Verdict.SATISFIED
    longer = [{"x": 1.0}, {"x": 2.5}, {"x": 2.5}]
    cut = simulate(longer, SPECS, period=0.5, duration=0.5, at_truncation="open")
    assert cut.verdict == Verdict.UNDECIDED


def test_a_run_is_drawn(tmp_path: Path) -> None:
    run(1.0, 5.0).plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"expected a name that ends in \.png, \.svg or \.pdf"):
        run(1.0).plot(tmp_path / "run.doc")


def test_a_run_evaluates_alike_on_both_machines(backend: rtamt.machines.backend.Backend) -> None:
    made = run(1.0, 2.0, 5.0)
    for name, course in made.histories.items():
        offline = rtamt.evaluate(course.formula, made.signals, made.period, backend=backend)
        assert offline.tolist() == made.replay()[name].tolist()
        assert offline[0] == course.final


def test_a_run_of_an_environment_without_a_clock_saves_steps_and_one_of_many_rewards_has_none() -> (
    None
):
    class Several(gym.Env[Any, Any]):
        observation_space = gym.spaces.Box(-9.0, 9.0, (1,), np.float64)
        action_space = gym.spaces.Discrete(2)

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
            super().reset(seed=seed, options=options)
            return np.zeros(1), {}

        def step(self, _action: Any) -> Any:  # noqa: ANN401
            return np.ones(1), np.array([1.0, 2.0]), False, False, {}

    options: Any = {"signals": {"x": "obs[0]"}, "policy": lambda _obs: 0}
    limited = gym.wrappers.TimeLimit(Several(), 7)
    run = simulate(limited, "always(x < 1)", stop="violation", duration=7, period=1, **options)
    assert run.reward is None
    with Runner(Several(), "always(x < 2)", duration=3, period=1, **options) as runner:
        ((_, row),) = runner.run([{}])
    assert (row.reward, row.ended) == (None, "duration")
    known = simulate(
        gym.make("MountainCar-v0"), "always(x > 0)", stop="violation", seed=1, **options
    )
    assert (known.period, known.saved) == (None, 200)
    assert run_table([known])[1].endswith("  200 steps")


def test_a_run_says_when_it_was_violated_and_first_by_what() -> None:
    rows = [{"x": x} for x in (1.0, 4.0, 6.0, 1.0)]
    specs = {"high": "always(x < 5)", "low": "always(x < 3)"}
    run = simulate(rows, specs, stop="end")
    assert (run.violated_by, run.violated_at) == ("low", 1)
    assert simulate(rows, "always(x < 9)").violated_at is None
    assert repr(run.histories["high"]) == (
        "<History of always(x < 5): VIOLATED at sample 2, robustness -1>"
    )
