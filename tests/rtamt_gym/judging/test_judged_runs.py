"""Requirements are checked and compiled once, before the first simulation."""

import gc
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import rtamt
import rtamt_gym
from rtamt_gym import Parameter, Runner, StlMonitor, evaluate_policy, falsify, simulate, sweep
from rtamt_gym.judging.judge import Judge
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.options.evaluation import EvaluationOptions

SPACE = [Parameter("gain", 0, 1)]
GRAVITY = [Parameter("env.gravity", 9, 10)]


class Counted(gym.Wrapper[Any, Any, Any, Any]):
    """Counts the resets of an environment."""

    resets = 0

    def reset(self, **options: Any) -> Any:  # noqa: ANN401
        self.resets += 1
        return super().reset(**options)


def tank(gain: float) -> Iterator[dict[str, float]]:
    for i in range(5):
        yield {"level": gain * i}


def push(_obs: object) -> int:
    return 1


class Endless(gym.Env[Any, Any]):
    """Ends after a number of steps that is an attribute."""

    observation_space = gym.spaces.Box(-1, 1, (2,))
    action_space = gym.spaces.Discrete(2)
    length = 10.0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401, ARG002
        self.count = 0
        return np.zeros(2), {}

    def step(self, action: Any) -> Any:  # noqa: ANN401, ARG002
        self.count += 1
        return np.zeros(2), 0.0, False, self.count >= self.length, {}


ENVIRONMENTS: list[Callable[..., Any]] = [
    lambda env, specs, signals, **how: sweep(
        env, specs, GRAVITY, samples=3, policy=push, signals=signals, **how
    ),
    lambda env, specs, signals, **how: falsify(
        env, specs, GRAVITY, budget=3, policy=push, signals=signals, **how
    ),
    lambda env, specs, signals, **how: evaluate_policy(
        push, env, specs, signals, episodes=3, **how
    ),
]

MISTAKES: list[tuple[str, dict[str, str], dict[str, Any], type[Exception], str]] = [
    ("always(x < 1)", {"x": "obs[7]"}, {}, rtamt.InputError, "signal 'x'"),
    ("always(x < 1)", {"y": "obs[0]"}, {}, rtamt.InputError, "'x'"),
    (
        *("always(x < 1)", {"x": "obs[0]"}, {"semantics": "output-robustness"}),
        *(rtamt.InputError, "semantics='output-robustness' needs output variables"),
    ),
    (
        *("always(x < 1)", {"x": "obs[0]"}, {"semantics": "bolean"}),
        *(rtamt.InputError, "did you mean 'boolean'"),
    ),
    (
        *("always(x < 1)", {"x": "obs[0]"}, {"inputs": ["z"]}),
        *(rtamt.InputError, "'z'"),
    ),
    ("eventually[0:0.03](x < 1)", {"x": "obs[0]"}, {}, rtamt.SpecificationError, "0.02"),
    ("x < 1", {"x": "obs[0]"}, {}, rtamt.SpecificationError, "first sample only"),
]


@pytest.mark.parametrize("run", ENVIRONMENTS, ids=["sweep", "falsify", "evaluate_policy"])
@pytest.mark.parametrize("mistake", MISTAKES, ids=[each[-1] for each in MISTAKES])
def test_wrong_argument_fails_before_simulations(
    run: Callable[..., Any],
    mistake: tuple[str, dict[str, str], dict[str, Any], type[Exception], str],
) -> None:
    text, signals, how, kind, word = mistake
    env = Counted(gym.make("CartPole-v1"))
    with pytest.raises(kind) as refused:
        run(env, text, signals, **how)
    assert word in str(refused.value)
    assert "simulations failed" not in str(refused.value)
    assert env.resets == 0


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"period": 1, "signals": {"levl": "level"}}, "read by no specification"),
        ({"period": 1, "semantics": "output-vacuity"}, "needs output variables"),
    ],
)
def test_wrong_argument_fails_for_other_systems(how: dict[str, Any], words: str) -> None:
    for search in (sweep, falsify):
        more: dict[str, Any] = {"samples": 3} if search is sweep else {"budget": 3}
        with pytest.raises(rtamt.InputError) as refused:
            search(tank, "always(level < 3)", SPACE, **more, **how)
        assert words in str(refused.value)
        assert "simulations failed" not in str(refused.value)


def test_failed_case_stays_in_its_row() -> None:
    def odd(gain: float) -> Iterator[dict[str, float]]:
        if gain > 0.5:
            raise ValueError(gain)
        yield from tank(gain)

    with pytest.warns(UserWarning, match="1 of 3 simulations"):
        done = sweep(
            odd, "always(level < 9)", SPACE, samples=3, sampler="grid", period=1, duration=4
        )
    assert [bool(trial.error) for trial in done.record] == [False, False, True]


def test_case_may_change_the_period() -> None:
    env: Any = gym.make("CartPole-v1")
    env.unwrapped.tau = 0.3
    runner = Runner(env, "eventually[0:0.5](x < 1)", signals={"x": "obs[0]"}, policy=push)
    trials = dict(runner.run([{"env.tau": 0.25}, {"env.tau": 0.5}, {"env.tau": 0.4}], [1, 2, 3]))
    assert [bool(trials[i].error) for i in range(3)] == [False, False, True]
    assert "0.4" in trials[2].error


@pytest.mark.parametrize("view", ["episode", "step"])
def test_trials_match_full_runs(view: Any) -> None:  # noqa: ANN401
    specs = {
        "near": "always(abs(x) < 0.05)",
        "soon": "eventually[0:0.2](v > 0.3)",
        "back": "always(v > 0.2 implies eventually[0:0.1](x > 0))",
    }
    signals = {"x": "obs[0]", "v": "obs[1]"}
    for chosen in ({"near": specs["near"]}, specs):
        for stop in ("end", "violation", "decided", "known", "verdicts"):
            for limit in (None, 0.3):
                how: dict[str, Any] = {"stop": stop, "duration": limit, "view": view}
                env = gym.make("CartPole-v1", max_episode_steps=30)
                used = {name: signals[name] for name in signals if name in str(chosen)}
                runner = Runner(
                    *(env, chosen), signals=used, policy=push, at_termination="failure", **how
                )
                for index, trial in runner.run([{}] * 4, range(4)):
                    run = runner.simulate({}, index)
                    assert trial == run.trial(trial.case), (chosen, stop, limit, index)


def test_error_in_mid_run_keeps_samples() -> None:
    specs = {"a": "always(x < 9)", "b": "always(sqrt(y) < 9)"}
    signals: dict[str, Any] = {
        "x": "obs[0]",
        "y": (lambda step: -1.0 if step.env.unwrapped.steps_done == 4 else 1.0, 1.0),
    }

    class Steps(gym.Wrapper[Any, Any, Any, Any]):
        def reset(self, **options: Any) -> Any:  # noqa: ANN401
            self.env.unwrapped.steps_done = 0  # type: ignore[attr-defined]  # of this test
            return super().reset(**options)

        def step(self, action: Any) -> Any:  # noqa: ANN401
            self.env.unwrapped.steps_done += 1  # type: ignore[attr-defined]  # of this test
            return super().step(action)

    runner = Runner(Steps(gym.make("CartPole-v1")), specs, signals=signals, policy=push)
    ((_, trial),) = runner.run([{}], [1])
    with pytest.raises(rtamt.InputError) as raised:
        runner.simulate({}, 1)
    run = raised.value.run  # type: ignore[attr-defined]  # every simulation's error has it
    assert trial == run.trial(trial.case, trial.error)
    assert (trial.ended, trial.simulated, len(trial.outcomes)) == ("error", 0.06, 2)


def test_a_sweep_compiles_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def counted(*arguments: Any) -> Judge:  # noqa: ANN401
        made.append(Judge(*arguments))
        return made[-1]

    monkeypatch.setattr("rtamt_gym.play.simulate.Judge", counted)
    sweep(tank, {"low": "always(level < 9)"}, SPACE, samples=8, period=1)
    env = gym.make("CartPole-v1")
    how: dict[str, Any] = {"episodes": 20, "keep": 0, "at_termination": "failure"}
    evaluate_policy(push, env, "always(x < 9)", {"x": "obs[0]"}, **how)
    assert len(made) == 2


@pytest.mark.parametrize("several", [False, True])
def test_later_episodes_reuse_feeders(
    monkeypatch: pytest.MonkeyPatch,
    several: bool,  # noqa: FBT001
) -> None:
    specs = {"near": "always(abs(x) < 9)"} | ({"soon": "eventually(x > 9)"} if several else {})
    env = gym.make("CartPole-v1")
    made = []
    feeder = MonitorSet.feeder

    def counted(monitor_set: MonitorSet, *arguments: Any, **how: Any) -> Any:  # noqa: ANN401
        made.append(monitor_set)
        return feeder(monitor_set, *arguments, **how)

    monkeypatch.setattr(MonitorSet, "feeder", counted)
    for episodes in (1, 20):
        made.clear()
        how: dict[str, Any] = {"episodes": episodes, "keep": 0, "at_termination": "failure"}
        evaluate_policy(push, env, specs, {"x": "obs[0]"}, **how)
        assert len(made) == 2  # of the reset, and of steps
        assert len(set(map(id, made))) == 1


def test_error_leaves_later_episodes_unchanged() -> None:
    class Breaks(gym.Wrapper[Any, Any, Any, Any]):
        def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ANN401
            self.left = 5 if seed == 1 else 1000
            return super().reset(seed=seed, options=options)

        def step(self, action: Any) -> Any:  # noqa: ANN401
            self.left -= 1
            if self.left == 0:
                raise RuntimeError("broken")
            return super().step(action)

    specs = {"near": "always(abs(x) < 0.05)", "soon": "eventually[0:0.2](v > 0.3)"}
    signals = {"x": "obs[0]", "v": "obs[1]"}
    runner = Runner(Breaks(gym.make("CartPole-v1")), specs, signals=signals, policy=push)
    trials = dict(runner.run([{}] * 3, range(3)))
    assert [bool(trials[i].error) for i in range(3)] == [False, True, False]
    assert trials[2] == runner.simulate({}, 2).trial(trials[2].case)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("several", [False, True])
def test_sample_needs_at_most_one_call(several: bool) -> None:  # noqa: FBT001
    specs = {"near": "always(abs(x) < 9)"} | ({"still": "always(v > -99)"} if several else {})
    signals = {"x": "obs[0]", "v": "obs[1]"}
    runner = Runner(
        Endless(),
        specs,
        signals={name: signals[name] for name in signals if name in str(specs)},
        policy=push,
        period=1,
    )
    ours = str(Path(rtamt_gym.__file__).parent)

    def calls(steps: int) -> int:
        found = 0

        def count(frame: FrameType, event: str, _: object) -> None:
            nonlocal found
            found += event == "call" and frame.f_code.co_filename.startswith(ours)

        case = {"env.length": steps}
        gc.collect()
        gc.disable()  # objects of other tests must not be freed in between
        sys.setprofile(count)
        try:
            ((_, trial),) = runner.run([case], [1])
        finally:
            sys.setprofile(None)
            gc.enable()
        assert trial.simulated == steps
        return found

    calls(1)
    assert calls(30) - calls(20) == (10 if rtamt.BACKEND == "python" else 0)


def test_parallel_runs_have_own_monitors() -> None:
    judge = Judge({"low": rtamt.parse("always(x < 1)")}, EvaluationOptions())
    one, two = judge.begin(), judge.begin()
    one.feeder(judge.variables)([3.0])
    assert two.samples == 0
    assert one.violated_by == "low"
    judge.end(one)
    assert judge.begin() is one
    assert one.violated_by is None
    assert (one.samples, one.settled) == (0, 0)


def test_run_is_unchanged_by_later_runs() -> None:
    env = StlMonitor(gym.make("CartPole-v1"), "always(x < 0.02)", {"x": "obs[0]"})
    runner = Runner(env, policy=push, stop="violation")
    first = runner.simulate({}, 1)
    before = first.trial(), first.histories["spec"].robustness.copy()
    runner.simulate({}, 2)
    assert first.trial() == before[0]
    assert (first.histories["spec"].robustness == before[1]).all()
    assert first == simulate(env, policy=push, seed=1, case={})
