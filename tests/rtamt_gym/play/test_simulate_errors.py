"""Errors of `simulate`."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import pytest
from _pytest.mark import ParameterSet

from rtamt import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt_gym import simulate

BALL = """<mujoco model="ball"><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body>
</worldbody></mujoco>"""


def model() -> tuple[Any, Any]:
    made = mujoco.MjModel.from_xml_string(BALL)
    return made, mujoco.MjData(made)


def ramp(t: float) -> dict[str, float]:
    return {"x": t}


class Learner:
    """A model as in Stable-Baselines3: called by `predict`."""

    def predict(self, _obs: object) -> tuple[int, None]:
        return 0, None

    def __repr__(self) -> str:
        return "Learner()"


CARTPOLE = gym.make("CartPole-v1")
ROWS = [{"level": 1.0}, {"level": 2.0}]
LOW = "always(level < 3)"
Z = {"level": "qpos[2]"}


run: Any = simulate  # the calls have wrong types on purpose


def refused(
    call: Callable[[], object], message: str, error: type[RtamtError] = InputError
) -> ParameterSet:
    return pytest.param(call, error, message)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        refused(
            lambda: run(CARTPOLE, LOW, {"level": "obs[0]"}),
            "an environment needs a policy, a function from observation to action; policy=lambda "
            "obs: env.action_space.sample() acts at random",
        ),
        refused(
            lambda: run(CARTPOLE, LOW, policy=int),
            'variable \'level\' has no signal; pass signals={"level": "obs[INDEX]"}, or '
            "declare a constant: const float level = VALUE",
        ),
        refused(
            lambda: run(gym.make_vec("CartPole-v1", num_envs=2), LOW, policy=int),
            "expected one environment, got CartPoleVectorEnv(CartPole-v1, num_envs=2); "
            "VectorStlMonitor monitors many at once",
        ),
        refused(
            lambda: run(ROWS, LOW, policy=int),
            "policy= is for environments and MuJoCo models, got <class 'int'> for [{'level': "
            "1.0}, {'level': 2.0}]",
        ),
        refused(
            lambda: run(ROWS, LOW, seed=3),
            "seed= is for environments, got seed=3 for [{'level': 1.0}, {'level': 2.0}]",
        ),
        refused(
            lambda: run(3, LOW),
            "expected an environment, a pair (model, data) of MuJoCo, a StepMonitor, Fmus, a "
            "function of time or an iterable of samples, got 3",
            InputTypeError,
        ),
        refused(
            lambda: run("CartPole-v1", LOW),
            "expected a system to run, got its name; write gym.make('CartPole-v1')",
            InputTypeError,
        ),
        refused(
            lambda: run(Path("plant.fmu"), LOW),
            "expected a system to run, got its name; write Fmus('plant.fmu')",
            InputTypeError,
        ),
        refused(
            lambda: run({"level": [1.0, 2.0]}, LOW),
            "expected samples one after the other, got columns; rtamt.evaluate takes these, and "
            "to_dict('records') makes samples of a data frame",
            InputTypeError,
        ),
        refused(
            lambda: run(ramp, LOW),
            "ramp does not state the duration of a step; give period= in seconds",
        ),
        refused(
            lambda: run(ROWS, "always[0:2](level < 3)"),
            "specification 'spec' has bounds in time, but samples does not state the duration of "
            "a step; give period= in seconds, or period=1 if every bound counts steps",
            SpecificationError,
        ),
        refused(
            lambda: run(ramp, LOW, period=0.1),
            "ramp does not end by itself; give duration= in seconds, or duration=math.inf to run "
            "until it is stopped",
        ),
        refused(
            lambda: run(ROWS, LOW, duration=20),
            "duration=20.0 can mean 20 s or 20 steps, since samples does not state the duration "
            "of a step; give period= in seconds, or period=1 if the duration, and every bound, "
            "counts steps",
        ),
        refused(
            lambda: run(ROWS, "always[0:2](level < 3)", duration=20),
            "duration=20.0 can mean 20 s or 20 steps, since samples does not state the duration "
            "of a step; give period= in seconds, or period=1 if the duration, and every bound, "
            "counts steps",
        ),
        refused(
            lambda: run(ROWS, LOW, period=100, duration=20),
            "duration=20.0 is shorter than a step of 100 s, so no step would be evaluated; give at "
            "least duration=100.0, or period='100ms' if a step lasts 100 ms",
        ),
        refused(
            lambda: run(CARTPOLE, LOW, {"level": "obs[0]"}, policy=lambda _: 0, duration=0.01),
            "duration=0.01 is shorter than a step of 0.02 s, so no step would be evaluated; give "
            "at least duration=0.02",
        ),
        refused(
            lambda: run(ROWS, LOW, duration=-1),
            "expected duration= as a finite number above 0, got -1",
        ),
        refused(
            lambda: run(ROWS, LOW, stop="never"),
            "expected stop='violation', 'decided', 'known', 'verdicts' or 'end', got 'never'",
        ),
        refused(lambda: run(ROWS, LOW, view="all"), "expected view='episode' or 'step', got 'all'"),
        refused(
            lambda: run([{"level": math.nan}], LOW, nan="hold"),
            "variable 'level' is nan at sample 0",
        ),
        refused(
            lambda: run(ROWS, "level < 3"),
            "specification 'spec' is about the first sample only; write always(level < 3) or "
            "view='step'",
            SpecificationError,
        ),
        refused(
            lambda: run(ROWS, LOW, {"levle": "x"}),
            "signal 'levle' is read by no specification; the variables are 'level'; did you mean "
            "'level'?",
        ),
        refused(
            lambda: run(ROWS, LOW, {"beside": "level2"}),
            "sample 0 of samples has no 'level2'; it has 'level'; did you mean 'level'?",
        ),
        refused(
            lambda: run([{"level": 1.0, "beside": "high"}], LOW, {"beside": "beside"}),
            "expected a number for 'beside' at sample 0, got str 'high'",
            InputTypeError,
        ),
        refused(
            lambda: run(CARTPOLE, "always(angle < 1)", {"angel": "obs[2]"}, policy=int),
            "variable 'angle' has no signal; the signals are 'angel'; did you mean 'angel'?",
        ),
        refused(
            lambda: run(CARTPOLE, LOW, {"level": "obs[0]"}, policy=0),
            "expected a policy, a function from observation to action, got 0; write "
            "policy=lambda obs: 0",
            InputTypeError,
        ),
        refused(
            lambda: run(CARTPOLE, LOW, {"level": "obs[0]"}, policy=Learner()),
            "expected a policy, a function from observation to action, got Learner(); write "
            "policy=lambda obs: model.predict(obs)[0]",
            InputTypeError,
        ),
        refused(
            lambda: run(model()[::-1], LOW, Z, duration=1),
            "expected an MjModel and its MjData, got MjData and MjModel",
            InputTypeError,
        ),
        refused(
            lambda: run(model(), LOW, Z, policy=1.0, duration=1),
            "expected a policy, a function of model and data that sets data.ctrl, got 1.0",
            InputTypeError,
        ),
        refused(
            lambda: run(ROWS, LOW, {"level": 0}),
            "signal 'level': expected a name, got 0",
            InputTypeError,
        ),
        refused(
            lambda: run(ROWS, LOW, "level"),
            'expected a mapping such as signals={"x": "its name"}, got \'level\'',
            InputTypeError,
        ),
        refused(
            lambda: run(ROWS, "always(levels < 3)"),
            "sample 0 of samples has no 'levels'; it has 'level'; did you mean 'level'?",
        ),
        refused(lambda: run([ROWS[0], {}], LOW), "sample 1 of samples has no 'level'; it has none"),
        refused(
            lambda: run([3.0], LOW),
            "expected a mapping of names to numbers as sample 0 of samples, got 3.0",
            InputTypeError,
        ),
        refused(lambda: run([], LOW), "expected at least one sample, samples returned none"),
        refused(
            lambda: run([*ROWS, {"level": math.nan}], LOW),
            "variable 'level' is nan at sample 2",
        ),
        refused(
            lambda: run([{"level": "high"}], LOW),
            "expected a number for 'level' at sample 0, got str 'high'",
            InputTypeError,
        ),
        refused(
            lambda: run(model(), LOW, Z),
            "ball does not end by itself; give duration= in seconds, or duration=math.inf to run "
            "until it is stopped",
        ),
        refused(
            lambda: run(model(), LOW, Z, period=0.005, duration=1),
            "the period 0.005 s is not a multiple of the timestep of ball, 0.002 s (2.5 steps); "
            "use 0.004 s or 0.006 s",
        ),
    ],
)
def test_what_cannot_be_run_is_refused(
    call: Callable[[], object], error: type[RtamtError], message: str
) -> None:
    with pytest.raises(error) as caught:
        call()
    assert str(caught.value).startswith(message)


def test_counted_steps_are_a_duration() -> None:
    ended = simulate([{"level": 1.0}] * 9, LOW, period=1, duration=3, stop="end")
    assert (ended.ended, ended.steps) == ("duration", 3)


def test_signals_without_mapping_error() -> None:
    with pytest.raises(InputTypeError, match=r"^expected a mapping such as signals=.*got \['x'\]"):
        simulate(gym.make("CartPole-v1"), "always(x < 1)", ["x"], policy=lambda _: 0)  # type: ignore[arg-type]
