"""A simulation that crashes raises with the samples so far."""

from __future__ import annotations

import json
import math
import sys
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from leaving import LEAVING, Leaving, leaves_while_running, leaving_policy
from strategies import INFINITIES, Trace, formulas, length, sample, traces

from rtamt import Formula, InputError, InputTypeError, StateError, Verdict
from rtamt_gym import Parameter, Runner, StepMonitor, evaluate_policy, falsify, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import View
from rtamt_gym.results import Run
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

LOW = "always(x < 3)"
BALL = """<mujoco model="ball"><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body>
</worldbody></mujoco>"""


class CrashError(Exception):
    """An unexpected error."""


class BareError(Exception):
    """An error without attributes."""

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
    """Return the report of a run on its samples."""
    return run.signals, run.histories, run.violated_by, run.period, run.view, run.first_sample


def alike(left: Any, right: Any) -> bool:  # noqa: ANN401
    """Return whether two reports are equal."""
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
    rows += rows[: len(rows) == 1]  # a duration is at least one step
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
        with pytest.raises(StateError) as crashed:
            simulate(system, *given, policy=explode, duration=1)
        assert str(crashed.value) == (
            "expected the time 0.014 s of ball after a step, got 0.002 s: MuJoCo found the "
            "simulation unstable and reset it"
        )
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


Output = pytest.CaptureFixture[str]
NO_END = "which does not end a simulation; return, or raise an error"


def test_a_simulation_that_leaves_is_an_error_with_its_samples() -> None:
    with pytest.raises(InputError) as caught:
        simulate(leaves_while_running, "always(y < 2)", case={"x": 1.0}, period=1)
    assert str(caught.value) == f"leaves_while_running called sys.exit(0), {NO_END}"
    assert caught.value.run.steps == 0  # type: ignore[attr-defined]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("n_jobs", [None, 1])
def test_a_search_counts_it_as_failed_and_goes_on(n_jobs: int | None) -> None:
    with pytest.warns(FailedSimulationWarning):
        found = falsify(
            *(leaves_while_running, "always(y < 2)", [Parameter("x", 0, 1)]),
            period=1,
            budget=20,
            n_jobs=n_jobs,
        )
    error = f"InputError: leaves_while_running called sys.exit(0), {NO_END}"
    assert {row.error: row.case.columns()["x"] >= 0.5 for row in found.record} == {
        "": False,
        error: True,
    }


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("where", LEAVING)
@pytest.mark.parametrize("options", [{}, {"n_jobs": 1}, {"n_envs": 2}, {"vector": True}])
def test_an_episode_that_leaves_is_not_satisfied(where: str, options: dict[str, Any]) -> None:
    def make() -> Any:  # noqa: ANN401
        return Leaving(where)

    env, name = make, "Leaving"
    if options == {"vector": True}:
        options, name = {}, "an environment" if where == "step" else "SyncVectorEnv"
        env = lambda: gym.vector.SyncVectorEnv([make, make])  # noqa: E731
    policy = leaving_policy if where == "policy" else (lambda _obs: 0)
    with pytest.warns(FailedSimulationWarning):
        result = evaluate_policy(
            *(policy, env, "always(y < 2)", {"y": "obs[0]"}),
            episodes=6,
            at_termination="complete",
            **options,
        )
    found = result.requirements["spec"]
    assert (found.satisfied, found.failed, found.rate) == (3, 3, 0.5)
    errors = {row.error.partition(", ")[0] for row in result.record.failed()}
    if where == "policy":
        assert errors == {"InputError: the policy called sys.exit()"}
    else:
        assert errors == {f"InputError: {name} called sys.exit(0)"}


class Still:
    """A model that acts in all episodes at once."""

    def predict(self, observation: Any, state: Any, *_: Any, **__: Any) -> tuple[Any, Any]:  # noqa: ANN401
        return np.zeros(len(observation) if np.ndim(observation) > 1 else (), np.int64), state


def test_a_step_that_leaves_beside_other_episodes_is_of_one_alone() -> None:
    with pytest.warns(FailedSimulationWarning):
        found = evaluate_policy(
            *(Still(), lambda: Leaving("step"), "always(y < 2)", {"y": "obs[0]"}),
            episodes=6,
            at_termination="complete",
            n_envs=3,
        )
    errors = [row.error.partition(", ")[0] for row in found.record]
    assert errors == ["", "InputError: Leaving called sys.exit(0)"] * 3


def test_a_policy_of_a_module_that_leaves_is_named_with_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("quitter.py").write_text("import sys\n\ndef act(obs):\n    sys.exit(0)\n")
    of = ["CartPole-v1", "--signal", "x=obs[0]", "--policy", "quitter:act"]
    said = f"the policy quitter:act called sys.exit(0) (quitter.py, line 4), {NO_END}\n"
    assert main(["run", *of, "--spec", "always(x < 2)"]) == 2
    assert capsys.readouterr().err == f"rtamt: error: {said}"
    all_failed = "rtamt: error: all 3 episodes failed, the first with InputError: "
    assert main(["evaluate", *of, "--spec", "always(x < 2)", "--episodes", "3"]) == 2
    assert capsys.readouterr().err.splitlines(keepends=True)[-1] == f"{all_failed}{said}"


def test_a_policy_that_leaves_is_told_from_its_environment() -> None:
    def act(*_shown: object) -> int:
        sys.exit(3)

    model = mujoco.MjModel.from_xml_string(BALL)
    given = "always(y < 9)", {"y": "qpos[0]"}
    systems: list[tuple[Any, tuple[Any, ...], dict[str, Any]]] = [
        (Leaving("policy"), (given[0], {"y": "obs[0]"}), {"period": 1}),
        ((model, mujoco.MjData(model)), given, {}),
        (StepMonitor(model, mujoco.MjData(model), *given), (), {}),
    ]
    for system, asked, options in systems:
        with pytest.raises(InputError) as caught:
            simulate(system, *asked, policy=act, duration=3, **options)
        assert str(caught.value) == f"the policy called sys.exit(3), {NO_END}"
        assert caught.value.run.steps == 0  # type: ignore[attr-defined]


def test_an_environment_that_leaves_while_it_is_made_is_an_error() -> None:
    gym.register("Leaves-v0", lambda **_: Leaving("init"))
    try:
        with pytest.raises(InputError) as caught:
            Runner("Leaves-v0", "always(y < 2)", signals={"y": "obs[0]"})
    finally:
        del gym.registry["Leaves-v0"]
    assert str(caught.value) == f"the making of Leaves-v0 called sys.exit(0), {NO_END}"
    with pytest.raises(InputError, match="the function that makes the environment called"):
        evaluate_policy(lambda _obs: 0, lambda: Leaving("init"), "always(y < 2)", {"y": "obs[0]"})


@pytest.fixture
def leaving_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory with modules, of which one leaves while it is imported."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wry.py").write_text(
        "def tank(x):\n    yield {'y': x}\n\nimport sys\nsys.exit(0)\n"
    )
    (tmp_path / "sly.py").write_text("import sys\n\ndef tank(x):\n    sys.exit()\n    yield {}\n")


IMPORTED = (
    "rtamt: error: cannot import wry: it called sys.exit(0) (wry.py, line 5); put "
    "the main program below "
    'if __name__ == "__main__":\n'
)


@pytest.mark.slow(keep=1)
@pytest.mark.usefixtures("leaving_module")
@pytest.mark.parametrize("more", [[], ["-j", "1"]])
def test_a_module_that_leaves_while_it_is_imported_exits_2(more: list[str], capsys: Output) -> None:
    search = ["always(y < 2)", "--vary", "x=0:1", "--period", "1", "--budget", "3", *more]
    assert main(["falsify", "wry:tank", *search]) == 2
    assert capsys.readouterr().err == IMPORTED
    assert main(["falsify", "sly:tank", *search]) == 2
    expected = (
        "rtamt: error: all 3 simulations failed, the first with InputError: tank called sys.exit"
    )
    assert capsys.readouterr().err.startswith(expected)
    run = ["run", "CartPole-v1", "--spec", "always(x < 2)", "--signal", "x=obs[0]"]
    assert main([*run, "--policy", "wry:tank"]) == 2
    assert capsys.readouterr().err == IMPORTED


@pytest.mark.slow
@pytest.mark.usefixtures("leaving_module")
def test_a_case_whose_system_leaves_has_no_verdict(capsys: Output) -> None:
    found = falsify(leaves_while_running, "always(y < 0.2)", [Parameter("x", 0, 0.4)], period=1)
    found.save("case.json")
    kept = json.loads(Path("case.json").read_text())
    del kept["fingerprint"]  # which another system does not have
    messages = {
        "wry:tank": IMPORTED,
        "sly:tank": f"rtamt: error: tank called sys.exit(), {NO_END}\n",
    }
    for name, message in messages.items():
        Path("case.json").write_text(json.dumps(kept | {"system": {"object": name}}))
        assert main(["replay", "case.json"]) == 2
        assert capsys.readouterr().err == message
        assert main(["report", "--play", "case.json", "-o", "page.html"]) == 3
        out, err = capsys.readouterr()
        assert out == "report: page.html\n"
        error = message.removeprefix("rtamt: error: ")
        line = (
            f"playing case.json, which imports {name.partition(':')[0]} "
            f"case.json was not run: InputError: {error}"
        )
        assert " ".join(err.split()) == line.strip()
        assert "The case was not run: InputError: " in Path("page.html").read_text()
