"""What `simulate` refuses, and how it says so."""

import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import pytest

from rtamt import InputError, InputTypeError, RtamtError, SpecificationError, StateError
from rtamt_gym import simulate

BALL = """<mujoco model="ball"><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body>
</worldbody></mujoco>"""


def model() -> tuple[Any, Any]:
    made = mujoco.MjModel.from_xml_string(BALL)
    return made, mujoco.MjData(made)


def ramp(t: float) -> dict[str, float]:
    return {"x": t}


class Learner:
    """As those of Stable-Baselines3 are: called by `predict`."""

    def predict(self, _obs: object) -> tuple[int, None]:
        return 0, None

    def __repr__(self) -> str:
        return "Learner()"


CARTPOLE = gym.make("CartPole-v1")
ROWS = [{"level": 1.0}, {"level": 2.0}]
LOW = "always(level < 3)"
Z = {"level": "qpos[2]"}


@pytest.mark.parametrize(
    ("arguments", "named", "error", "message"),
    [
        (
            (CARTPOLE, LOW, {"level": "obs[0]"}),
            {},
            InputError,
            (
                "an environment needs a policy, a function from observation to action; "
                "policy=lambda obs: env.action_space.sample() acts at random"
            ),
        ),
        (
            (CARTPOLE, LOW),
            {"policy": int},
            InputError,
            (
                'variable \'level\' has no signal; give one: "level": "obs[INDEX]"'
                ", or if it is a constant declare it: const float level = VALUE"
            ),
        ),
        (
            (gym.make_vec("CartPole-v1", num_envs=2), LOW),
            {"policy": int},
            InputError,
            (
                "expected one environment, got CartPoleVectorEnv(CartPole-v1, num_envs=2); "
                "VectorStlMonitor monitors many at once"
            ),
        ),
        (
            (ROWS, LOW),
            {"policy": int},
            InputError,
            (
                "policy= is for environments and MuJoCo models, got <class 'int'> for "
                "[{'level': 1.0}, {'level': 2.0}]"
            ),
        ),
        (
            (ROWS, LOW),
            {"seed": 3},
            InputError,
            "seed= is for environments, got seed=3 for [{'level': 1.0}, {'level': 2.0}]",
        ),
        (
            (3, LOW),
            {},
            InputTypeError,
            (
                "expected an environment, a pair (model, data) of MuJoCo, a StepMonitor, Fmus, a "
                "function of time or an iterable of samples, got 3"
            ),
        ),
        (
            ("CartPole-v1", LOW),
            {},
            InputTypeError,
            ("expected a system to run, got its name; write gym.make('CartPole-v1')"),
        ),
        (
            ("CartPole-v1", LOW),
            {"policy": int, "seed": 1},
            InputTypeError,
            ("expected a system to run, got its name; write gym.make('CartPole-v1')"),
        ),
        (
            (Path("plant.fmu"), LOW),
            {},
            InputTypeError,
            "expected a system to run, got its name; write Fmus('plant.fmu')",
        ),
        (
            ({"level": [1.0, 2.0]}, LOW),
            {},
            InputTypeError,
            (
                "expected samples one after the other, got columns; rtamt.evaluate takes these, "
                "and to_dict('records') makes samples of a data frame"
            ),
        ),
        (
            (ramp, LOW),
            {},
            InputError,
            "ramp does not say how long a step lasts; give period= in seconds",
        ),
        (
            (ROWS, "always[0:2](level < 3)"),
            {},
            SpecificationError,
            (
                "specification 'spec' has bounds in time, but samples does not say how long a step "
                "lasts; give period= in seconds, or period=1 to count steps"
            ),
        ),
        (
            (ramp, LOW),
            {"period": 0.1},
            InputError,
            (
                "ramp does not end by itself; give duration= in seconds, or duration=math.inf to "
                "run until it is stopped"
            ),
        ),
        (
            (ROWS, LOW),
            {"duration": -1},
            InputError,
            "expected duration= as a finite number above 0, got -1",
        ),
        (
            (ROWS, LOW),
            {"stop": "never"},
            InputError,
            "expected stop='violation' or 'decided' or 'known' or 'verdicts' or 'end', got 'never'",
        ),
        ((ROWS, LOW), {"view": "all"}, InputError, "expected view='episode' or 'step', got 'all'"),
        (
            ([{"level": math.nan}], LOW),
            {"nan": "hold"},
            InputError,
            "variable 'level' is nan at sample 0",
        ),
        (
            (ROWS, "level < 3"),
            {},
            SpecificationError,
            (
                "specification 'spec' speaks of the first sample only; "
                "write always(level < 3) or view='step'"
            ),
        ),
        (
            (ROWS, LOW, {"levle": "x"}),
            {},
            InputError,
            (
                "signal 'levle' is read by no specification; the variables are 'level'; "
                "did you mean 'level'?"
            ),
        ),
        (
            (ROWS, LOW, {"beside": "level2"}),
            {},
            InputError,
            "sample 0 of samples has no 'level2'; it has 'level'; did you mean 'level'?",
        ),
        (
            ([{"level": 1.0, "beside": "high"}], LOW, {"beside": "beside"}),
            {},
            InputTypeError,
            "expected a number for 'beside' at sample 0, got str 'high'",
        ),
        (
            (CARTPOLE, "always(angle < 1)", {"angel": "obs[2]"}),
            {"policy": int},
            InputError,
            "variable 'angle' has no signal; the signals are 'angel'; did you mean 'angel'?",
        ),
        (
            (CARTPOLE, LOW, {"level": "obs[0]"}),
            {"policy": 0},
            InputTypeError,
            (
                "expected a policy, a function from observation to action, got 0; "
                "write policy=lambda obs: 0"
            ),
        ),
        (
            (CARTPOLE, LOW, {"level": "obs[0]"}),
            {"policy": Learner()},
            InputTypeError,
            (
                "expected a policy, a function from observation to action, got Learner(); "
                "write policy=lambda obs: model.predict(obs)[0]"
            ),
        ),
        (
            (model()[::-1], LOW, Z),
            {"duration": 1},
            InputTypeError,
            "expected an MjModel and its MjData, got MjData and MjModel",
        ),
        (
            (model(), LOW, Z),
            {"policy": 1.0, "duration": 1},
            InputTypeError,
            "expected a policy, a function of model and data that sets data.ctrl, got 1.0",
        ),
        ((ROWS, LOW, {"level": 0}), {}, InputTypeError, "signal 'level': expected a name, got 0"),
        (
            (ROWS, LOW, "level"),
            {},
            InputTypeError,
            'expected a mapping such as signals={"x": "its name"}, got \'level\'',
        ),
        (
            (ROWS, "always(levels < 3)"),
            {},
            InputError,
            "sample 0 of samples has no 'levels'; it has 'level'; did you mean 'level'?",
        ),
        (([ROWS[0], {}], LOW), {}, InputError, "sample 1 of samples has no 'level'; it has none"),
        (
            ([3.0], LOW),
            {},
            InputTypeError,
            "expected a mapping of names to numbers as sample 0 of samples, got 3.0",
        ),
        (([], LOW), {}, InputError, "expected one sample at least, samples has given none"),
        (
            ([*ROWS, {"level": math.nan}], LOW),
            {},
            InputError,
            "variable 'level' is nan at sample 2",
        ),
        (
            ([{"level": "high"}], LOW),
            {},
            InputTypeError,
            "expected a number for 'level' at sample 0, got str 'high'",
        ),
        (
            (model(), LOW, Z),
            {},
            InputError,
            (
                "ball does not end by itself; give duration= in seconds, or duration=math.inf to "
                "run until it is stopped"
            ),
        ),
        (
            (model(), LOW, Z),
            {"period": 0.005, "duration": 1},
            InputError,
            (
                "the period 0.005 s is not a multiple of the timestep of ball, 0.002 s "
                "(2.5 steps); use 0.004 s or 0.006 s"
            ),
        ),
    ],
)
def test_what_cannot_be_run_is_refused(
    arguments: tuple[Any, ...], named: dict[str, Any], error: type[RtamtError], message: str
) -> None:
    with pytest.raises(error) as refused:
        simulate(*arguments, **named)
    assert str(refused.value).startswith(message)


def test_an_unstable_simulation_is_an_error() -> None:
    made, data = model()

    def explode(_model: Any, data: Any) -> None:  # noqa: ANN401
        if data.time > 0.01:
            data.qvel[0] = 1e12

    with pytest.raises(StateError) as refused:
        simulate((made, data), LOW, Z, policy=explode, duration=1)
    assert str(refused.value) == (
        "expected the time 0.014 s of ball after a step, got 0.002 s: MuJoCo found the simulation "
        "unstable and reset it"
    )


def test_an_error_of_the_policy_is_the_callers() -> None:
    def fail(_obs: Any) -> int:  # noqa: ANN401
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        simulate(CARTPOLE, LOW, {"level": "obs[0]"}, policy=fail)
