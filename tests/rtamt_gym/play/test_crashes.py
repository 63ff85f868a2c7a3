"""A simulation that crashes raises with the samples so far."""

import math
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import INFINITIES, Trace, formulas, length, sample, traces

from rtamt import Formula, InputError, InputTypeError, StateError, Verdict
from rtamt_gym import StepMonitor, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import View
from rtamt_gym.results import Run

LOW = "always(x < 3)"
BALL = """<mujoco model="ball"><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body>
</worldbody></mujoco>"""


class CrashError(Exception):
    """What no one expects."""


class BareError(Exception):
    """An error that takes no attributes."""

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(name)


def crashing(
    rows: list[dict[str, float]], error: BaseException | type[BaseException]
) -> Iterator[Mapping[str, float]]:
    yield from rows
    raise error


def run_of(error: BaseException) -> Run:
    run: Run = error.run  # type: ignore[attr-defined]  # simulate sets it
    return run


def told(run: Run) -> Any:  # noqa: ANN401
    """What a run tells about the samples."""
    return run.signals, run.histories, run.violated_by, run.period, run.view, run.first_sample


def alike(left: Any, right: Any) -> bool:  # noqa: ANN401
    """Whether two of the above are equal."""
    (signals, *rest), (others, *other_rest) = left, right
    return rest == other_rest and {name: values.tolist() for name, values in signals.items()} == {
        name: values.tolist() for name, values in others.items()
    }


@given(
    formula=formulas(depth=2, total=False),
    trace=traces(values=INFINITIES),
    view=st.sampled_from(("episode", "step")),
    other=st.booleans(),
)
def test_the_run_of_an_error_is_that_of_the_samples_before_it(
    formula: Formula,
    trace: Trace,
    view: View,
    other: bool,  # noqa: FBT001
) -> None:
    rows = [sample(trace, i) for i in range(length(trace))]
    rows += rows[: len(rows) == 1]  # a duration is a step at least
    specs = {"it": formula if view == "step" else formula.always()}
    if other:
        specs["other"] = (~formula).always()
    named: dict[str, Any] = {"period": 1, "view": view, "stop": "end"}
    with pytest.raises(CrashError) as crashed:
        simulate(crashing(rows, CrashError), specs, **named)
    run = run_of(crashed.value)
    named |= {"duration": len(rows) - 1, "at_truncation": "open"}
    cut = simulate([*rows, rows[-1]], specs, **named)
    assert alike(told(run), told(cut))
    assert (run.ended, run.steps, cut.ended) == ("error", len(rows) - 1, "duration")


def test_a_sample_that_one_monitor_took_and_another_refused_is_in_none() -> None:
    rows = [{"x": 1.0, "y": 1.0}, {"x": 2.0, "y": 1.0}, {"x": 9.0, "y": math.nan}]
    specs = {"first": LOW, "second": "always(y < 3)"}
    with pytest.raises(InputError, match="variable 'y' is nan at sample 2") as crashed:
        simulate(rows, specs)
    run = run_of(crashed.value)
    assert run.signals["x"].tolist() == [1.0, 2.0]
    assert (run.verdict, run.violated_by) == (Verdict.UNDECIDED, None)
    assert run.histories["first"].final == 1.0
    assert crashed.value.__notes__ == ["error.run holds 2 samples, up to sample 1"]


def test_the_error_keeps_its_type_and_tells_of_the_run_in_a_note() -> None:
    with pytest.raises(CrashError) as crashed:
        simulate(crashing([{"x": 1.0}] * 4, CrashError("at noon")), LOW, period=0.5)
    assert "".join(traceback.format_exception_only(crashed.value)).splitlines()[1:] == [
        "error.run holds 4 samples, up to 1.5 s"
    ]
    assert str(crashed.value) == "at noon"
    assert repr(run_of(crashed.value)) == "<Run of samples: error at 1.5 s, 4 samples>"


def test_verdicts_are_as_the_samples_leave_them() -> None:
    specs = {"low": LOW, "soon": "eventually[0:1](x > 2)", "long": "always[0:9](x < 9)"}
    with pytest.raises(CrashError) as crashed:
        simulate(crashing([{"x": 1.0}, {"x": 4.0}], CrashError), specs, period=1, stop="end")
    run = run_of(crashed.value)
    assert {name: course.verdict.name for name, course in run.histories.items()} == {
        "low": "VIOLATED",
        "soon": "SATISFIED",
        "long": "UNDECIDED",
    }
    assert (run.violated_by, run.violated_at) == ("low", 1)


def test_an_interrupted_run_is_kept_too() -> None:
    with pytest.raises(KeyboardInterrupt) as crashed:
        simulate(crashing([{"x": 1.0}] * 3, KeyboardInterrupt), LOW)
    assert run_of(crashed.value).steps == 2


@pytest.mark.parametrize("part", ["policy", "signal", "environment"])
def test_every_part_of_an_environment_may_crash(part: str) -> None:
    count = 0

    def crash(of: str) -> None:
        nonlocal count
        count += of == part
        if count == 4:
            raise CrashError(of)

    class Fragile(gym.Wrapper[Any, Any, Any, Any]):
        def step(self, action: Any) -> Any:  # noqa: ANN401
            crash("environment")
            return self.env.step(action)

    def act(_obs: Any) -> int:  # noqa: ANN401
        crash("policy")
        return 0

    def position(step: Any) -> float:  # noqa: ANN401
        crash("signal")
        return float(step.obs[0])

    env = Fragile(gym.make("CartPole-v1"))
    named: dict[str, Any] = {"signals": {"x": position}, "seed": 1}
    with pytest.raises((CrashError, InputError), match=part) as crashed:
        simulate(env, LOW, policy=act, **named)
    samples = 3 if part == "signal" else 4
    whole = simulate(gym.make("CartPole-v1"), LOW, {"x": "obs[0]"}, policy=lambda _: 0, seed=1)
    assert run_of(crashed.value).signals["x"].tolist() == whole.signals["x"][:samples].tolist()


def test_an_unstable_model_shows_how_it_came_to_it() -> None:
    model = mujoco.MjModel.from_xml_string(BALL)

    def explode(_model: Any, data: Any) -> None:  # noqa: ANN401
        if data.time > 0.01:
            data.qvel[0] = 1e12

    for monitored in (False, True):
        data = mujoco.MjData(model)
        system: Any = (model, data)
        given: tuple[Any, ...] = (LOW, {"x": "time"})
        if monitored:
            system, given = StepMonitor(model, data, *given), ()
        with pytest.raises(StateError, match="unstable") as crashed:
            simulate(system, *given, policy=explode, duration=1)
        assert run_of(crashed.value).steps == 6


def test_before_sample_0_there_is_no_run() -> None:
    for rows in ([], [{"x": math.nan}]):
        with pytest.raises(InputError) as crashed:
            simulate(rows, LOW)
        assert not hasattr(crashed.value, "run")
        assert not hasattr(crashed.value, "__notes__")


def test_the_signal_that_is_no_number_ends_the_record_before_it() -> None:
    rows: list[Any] = [{"x": 1.0, "y": 0.0}, {"x": 7.0, "y": "high"}]
    with pytest.raises(InputTypeError, match="expected a number for 'y' at sample 1") as crashed:
        simulate(rows, LOW, {"y": "y"})
    run = run_of(crashed.value)
    assert (run.steps, run.violated_by, run.histories["spec"].final) == (0, None, 2.0)


def test_an_error_that_takes_no_attributes_is_raised_as_it_is() -> None:
    with pytest.raises(BareError) as crashed:
        simulate(crashing([{"x": 1.0}], BareError), LOW)
    assert not hasattr(crashed.value, "run")


def test_a_crash_inside_a_crash_is_the_run_of_the_outer_one() -> None:
    def outer() -> Iterator[Mapping[str, float]]:
        yield from [{"x": 1.0}] * 5
        simulate(crashing([{"x": 0.0}] * 2, CrashError), LOW)

    with pytest.raises(CrashError) as crashed:
        simulate(outer, LOW)
    assert run_of(crashed.value).steps == 4
    assert crashed.value.__notes__ == ["error.run holds 5 samples, up to sample 4"]


@pytest.mark.slow
def test_the_run_of_an_error_is_saved_loaded_replayed_and_drawn(tmp_path: Path) -> None:
    with pytest.raises(CrashError) as crashed:
        simulate(crashing([{"x": 1.0}, {"x": 2.5}], CrashError), LOW, period=0.1)
    run = run_of(crashed.value)
    run.save(tmp_path / "run.parquet")
    assert Run.load(tmp_path / "run.parquet") == run
    assert run.replay()["spec"].tolist() == [0.5, 0.5]
    run.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_an_error_at_the_close_comes_with_the_whole_run() -> None:
    def closes_badly() -> Iterator[Mapping[str, float]]:
        try:
            while True:
                yield {"x": 1.0}
        finally:
            raise CrashError

    with pytest.raises(CrashError) as crashed:
        simulate(closes_badly, LOW, period=1, duration=3)
    assert (run_of(crashed.value).ended, run_of(crashed.value).steps) == ("duration", 3)


def test_the_command_line_says_an_error_once(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["CartPole-v1", "--spec", "always(sqrt(0.04 - x) < 9)", "--signal", "x=obs[0]"]
    assert main(["run", *arguments]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: 'sqrt(0.04 - x)' is not a number at sample 5, where x = "
        "0.04274933412671089\n"
    )
