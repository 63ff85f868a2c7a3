"""An error in a signal function names the signal, wherever it is called."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

import rtamt
from rtamt import InputError, StateError
from rtamt_gym import Step, StepMonitor, StlMonitor, VectorStlMonitor, simulate


def missing(step: Step) -> float:
    return float(step.info["foo"])


def late(step: Step) -> float:
    """Fail at the first step, which has a reward."""
    return 0.0 if step.reward is None else float(step.env.unwrapped.nothing)


def silent(_: Step) -> float:
    raise ValueError


class Late:
    """A callable without a name."""

    def __call__(self, step: Step) -> float:
        return missing(step)

    def __repr__(self) -> str:
        return "<Late>"


def scalar(read: Callable[[Any], float]) -> None:
    env = StlMonitor(gym.make("CartPole-v1"), "always(x < 1)", {"x": read})
    env.reset()
    env.step(0)


def vector(read: Callable[[Any], Any]) -> None:
    env = VectorStlMonitor(gym.make_vec("CartPole-v1", 2), "always(x < 1)", {"x": read})
    env.reset()
    env.step(np.zeros(2, np.int64))


def simulated(read: Callable[[Any], float]) -> None:
    simulate(gym.make("CartPole-v1"), "always(x < 1)", {"x": read}, policy=lambda _: 0)


@pytest.mark.parametrize("run", [scalar, vector, simulated])
@pytest.mark.parametrize(
    ("read", "message", "cause"),
    [
        (missing, "signal 'x': missing raised KeyError: 'foo'", KeyError),
        (Late(), "signal 'x': <Late> raised KeyError: 'foo'", KeyError),
        (silent, "signal 'x': silent raised ValueError", ValueError),
    ],
)
def test_error_at_reset_names_signal(
    run: Callable[[Any], None], read: Callable[[Any], Any], message: str, cause: type[Exception]
) -> None:
    with pytest.raises(InputError) as caught:
        run(read)
    assert str(caught.value) == message
    assert type(caught.value.__cause__) is cause


def acted(step: Step) -> float:
    return float(step.action[0])


def paid(step: Step) -> Any:
    return step.reward


@pytest.mark.parametrize("run", [scalar, vector, simulated])
@pytest.mark.parametrize(
    ("read", "message"),
    [
        (acted, "signal 'x': acted raised TypeError: 'NoneType' object is not subscriptable"),
        (paid, "signal 'x': expected a number from paid, got None; a "),
    ],
)
def test_function_reads_action_at_reset_error(
    run: Callable[[Any], None], read: Any, message: str
) -> None:
    with pytest.raises(rtamt.RtamtError) as caught:
        run(read)
    text = str(caught.value)
    assert text.startswith(message)
    assert text.endswith(
        "; at a reset there is no action and no reward: give a first value, "
        '"x": (FUNCTION, VALUE), or "x": (FUNCTION, None) if it is unknown: then no always '
        "over it can be satisfied"
    )
    if read is paid:
        run((read, 0.0))


@pytest.mark.parametrize("run", [scalar, simulated])
def test_error_at_step_names_signal(run: Callable[[Any], None]) -> None:
    with pytest.raises(InputError) as caught:
        run(late)
    assert str(caught.value) == (
        "signal 'x': late raised AttributeError: 'CartPoleEnv' object has no attribute 'nothing'"
    )


def test_error_at_vector_step_names_signal() -> None:
    def read(step: Step) -> Any:
        return 0.0 if step.reward is None else 1.0 / step.reward["x"]

    with pytest.raises(InputError, match=r"^signal 'x': .*read raised IndexError: invalid index"):
        vector(read)


def monitored(model: Any, data: Any, read: Callable[..., float]) -> None:
    StepMonitor(model, data, "always(z < 1)", {"z": read}).run(1)


def rolled(model: Any, data: Any, read: Callable[..., float]) -> None:
    simulate((model, data), "always(z < 1)", {"z": read}, duration=1)


@pytest.mark.parametrize("loop", [monitored, rolled])
def test_error_in_mujoco_loop_names_signal(loop: Callable[..., None]) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody>'
        "</mujoco>"
    )
    data = mujoco.MjData(model)
    given = []

    def height(model: Any, data: Any) -> float:
        given.append((model, data))
        return float(data.qpos[99 if len(given) > 3 else 0])

    with pytest.raises(InputError) as caught:
        loop(model, data, height)
    assert str(caught.value) == (
        "signal 'z': test_error_in_mujoco_loop_names_signal.<locals>.height raised "
        "IndexError: index 99 is out of bounds for axis 0 with size 1"
    )
    assert given == [(model, data)] * 4


def test_error_with_signal_is_not_wrapped_again() -> None:
    own = InputError("signal 'x': expected a torso, got none")

    def raises_own(_: Step) -> float:
        raise own

    with pytest.raises(InputError) as caught:
        scalar(raises_own)
    assert caught.value is own

    monitor = rtamt.EpisodeMonitor("always(y > 0)")

    def finishes(_: Step) -> float:
        return monitor.finish()

    with pytest.raises(InputError, match=r"^signal 'x': .*finishes raised StateError: ") as wrapped:
        scalar(finishes)
    assert isinstance(wrapped.value.__cause__, StateError)


def test_interrupt_passes_through() -> None:
    def interrupted(_: Step) -> float:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scalar(interrupted)


def test_callable_of_observation_error() -> None:
    def place(obs: Any) -> float:
        return obs[0]  # type: ignore[no-any-return]  # the whole observation

    env = StlMonitor(gym.make("CartPole-v1"), "always(x < 1)", {"x": place})
    with pytest.raises(rtamt.InputTypeError) as caught:
        env.reset(seed=1)
    assert str(caught.value).startswith("signal 'x': expected a number from ")
    assert str(caught.value).endswith(
        "; a callable takes a rtamt_gym.Step, such as lambda step: step.obs[0]"
    )
