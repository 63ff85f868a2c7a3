"""A run explains its robustness, and is a data frame."""

import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from bits import bits
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import order
from profiles import examples
from strategies import INTEGERS, Trace, formulas, length, sample, traces

import rtamt
from rtamt import Formula, InputError
from rtamt.typing import SemanticsName
from rtamt_gym import StepMonitor, simulate
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import View
from rtamt_gym.results import Run

SPECS = {"low": "always(x < 3)", "soon": "eventually[0:1](x > 2)"}


def run(*values: float, specs: Any = SPECS, **options: Any) -> Run:  # noqa: ANN401 - of simulate
    return simulate([{"x": x} for x in values], specs, period=0.5, **options)


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


def test_a_run_that_was_loaded_explains_itself_alike(tmp_path: Path) -> None:
    made = run(1.0, 2.0, 5.0)
    made.save(tmp_path / "run.parquet")
    assert Run.load(tmp_path / "run.parquet").explain() == made.explain()


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
