"""A run as a record: saved, loaded, replayed, drawn."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bits import bits
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import order
from profiles import examples
from strategies import INFINITIES, INTEGERS, Trace, formulas, length, sample, traces

import rtamt
from rtamt import Formula, InputError, Verdict
from rtamt.typing import SemanticsName
from rtamt_gym import Runner, StepMonitor, simulate
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import View
from rtamt_gym.play.history import Stop
from rtamt_gym.play.summaries import run_table
from rtamt_gym.results import Run

SPECS = {"low": "always(x < 3)", "soon": "eventually[0:1](x > 2)"}


def run(
    *values: float,
    specs: Any = SPECS,  # noqa: ANN401 - of simulate
    period: float | None = 0.5,
    **options: Any,  # noqa: ANN401
) -> Run:
    if period is None:
        specs = {"low": SPECS["low"]}
    return simulate([{"x": x} for x in values], specs, period=period, **options)


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


@settings(max_examples=examples(40))
@given(
    both=st.tuples(formulas(depth=2), formulas(depth=2)),
    trace=traces(values=INTEGERS),
    view=st.sampled_from(("episode", "step")),
    semantics=st.sampled_from(get_args(SemanticsName)),
    align=st.sampled_from((None, "outward")),
    period=st.sampled_from((1, 0.5)),
    stop=st.sampled_from(("violation", "decided", "end")),
)
def test_a_run_explains_what_was_monitored(
    both: tuple[Formula, Formula],
    trace: Trace,
    view: View,
    semantics: SemanticsName,
    align: Any,  # noqa: ANN401
    period: float,
    stop: Any,  # noqa: ANN401
) -> None:
    specs = dict(zip(("p", "q"), both, strict=True))
    if view == "episode":
        specs = {name: spec.always() for name, spec in specs.items()}
    known = {name for spec in specs.values() for name in spec.variables}
    made = simulate(
        [sample(trace, i) for i in range(length(trace))],
        specs,
        period=period,
        view=view,
        semantics=semantics,
        inputs=tuple(name for name in ("a",) if name in known),
        outputs=tuple(name for name in ("b", "c") if name in known),
        align=align,
        stop=stop,
    )
    for name, course in made.histories.items():
        explanation = made.explain(name)
        assert explanation.robustness == course.final
        if semantics in EXACT:  # else a zero may be of no concern, and then its sign is none
            assert bits([explanation.robustness]) == bits([course.final])
        replayed = made.replay()[name]
        last = made.steps
        assert bits([made.explain(name, sample=last).robustness]) == bits(replayed[last:])
        assert max(map(len, str(explanation).splitlines())) <= 80
    chosen = made.violated_by or min(made.histories, key=lambda n: order(made.histories[n].final))
    assert made.explain() == made.explain(chosen)


def test_the_specification_that_was_violated_first_is_explained_by_its_name() -> None:
    made = run(1.0, 2.0, 5.0, 9.0, stop="end", specs={"high": "always(x < 8)", **SPECS})
    assert str(made.explain()) == (
        "robustness -6 at 0 s, decided by x < 3 at 1.5 s\n"
        "\n"
        "   at  value  formula\n"
        "  0 s     -6  low = always(x < 3)\n"
        "1.5 s     -6  x < 3\n"
        "1.5 s      9  x"
    )
    assert made.explain("high").causes == (("x", 3, 9.0),)
    assert made.explain("soon").causes == (("x", 2, 5.0),)
    calm = run(1.0, 2.5, 1.0)
    assert (calm.violated_by, calm.explain().steps[0].name) == (None, "low")


def test_in_the_view_of_steps_the_worst_sample_is_explained_or_the_one_that_is_named() -> None:
    made = run(1.0, 2.0, 5.0, 4.0, specs={"low": "x < 3"}, view="step", stop="end")
    assert str(made.explain()).splitlines()[3:] == [
        "0 s     -2  always(x < 3)",
        "1 s     -2  low = x < 3",
        "1 s      5  x",
    ]
    assert made.explain(sample=3).causes == (("x", 3, 4.0),)
    assert made.explain("low", sample=0).robustness == 2.0


def test_what_a_run_has_not_is_refused() -> None:
    made = run(1.0, 2.0, 5.0)
    with pytest.raises(InputError) as refused:
        made.explain("lwo")
    assert str(refused.value) == (
        "expected the name of a specification, got 'lwo'; the specifications are 'low', 'soon'; "
        "did you mean 'low'?"
    )
    with pytest.raises(InputError) as refused:
        made.explain(["low"])  # type: ignore[arg-type]
    assert str(refused.value) == (
        "expected the name of a specification, got ['low']; the specifications are 'low', 'soon'"
    )
    with pytest.raises(InputError) as refused:
        made.explain(sample=3)
    assert str(refused.value) == "expected a sample from 0 to 2, got 3"


def continued() -> Run:
    """The second half of an episode."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    monitor = StepMonitor(model, mujoco.MjData(model), "always(z > -1)", {"z": "qpos[2]"})
    monitor.reset()
    monitor.run(0.01)
    return simulate(monitor, duration=0.01)


def test_a_run_that_lacks_the_begin_of_its_episode_is_not_explained() -> None:
    made = continued()
    with pytest.raises(InputError) as refused:
        made.explain()
    assert str(refused.value) == (
        "expected the samples of a whole episode, got the samples from 5 on; "
        "rtamt.explain(formula, run.signals, run.period) takes sample 5 for the start of an episode"
    )
    explanation = rtamt.explain("always(z > -1)", made.signals, made.period)
    assert explanation.robustness == made.histories["spec"].final


# Data frames. ------------------------------------------------------------------------------------


def test_a_frame_has_the_columns_that_are_saved(tmp_path: Path) -> None:
    made = run(1.0, 2.0, 5.0)
    made.save(tmp_path / "run.parquet")
    saved = pq.read_table(tmp_path / "run.parquet").to_pydict()
    frame = made.to_frame()
    assert {name: list(frame[name]) for name in frame.columns} == saved
    assert list(frame.columns) == list(saved)
    assert frame.loc[made.violated_at, "upper(low)"] == -2.0
    assert isinstance(frame, pd.DataFrame)


def test_the_index_of_a_frame_is_the_number_of_the_sample_in_its_episode() -> None:
    made = continued()
    frame = made.to_frame()
    assert (frame.index.name, frame.index[0], frame.index[-1]) == ("sample", 5, made.last_sample)
    assert np.array_equal(frame["time"], made.times)


@pytest.mark.slow
def test_without_pandas_the_extra_is_named_and_nothing_else_needs_it() -> None:
    code = (
        "import sys; sys.modules['pandas'] = None\n"
        "from rtamt_gym import simulate\n"
        "run = simulate([{'x': 1.0}], 'always(x > 0)')\n"
        "run.explain()\n"
        "try:\n"
        "    run.to_frame()\n"
        "except ModuleNotFoundError as error:\n"
        "    print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.stderr, ran.stdout) == (
        "",
        (
            "Run.to_frame needs pandas, which is not installed; "
            "from the checkout: pip install '.[pandas]'\n"
        ),
    )
