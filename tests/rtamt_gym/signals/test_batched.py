"""A signal function is for one environment, also in vector environments; `batched` marks others."""

from __future__ import annotations

import copy
import functools
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, VectorEnv
from pole_functions import drift, energies, energy, sideways
from vector_environments import MODES, difference, sync, trajectory

from rtamt import InputError, InputTypeError
from rtamt_gym import (
    ParallelStlMonitor,
    Step,
    StepMonitor,
    StlMonitor,
    VectorStlMonitor,
    VectorStlReward,
    evaluate_policy,
    relabel,
    simulate,
)
from rtamt_gym.wrappers import batched

pytestmark = pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning")

SPEC = "always[0:1](x < 1)"
FOUR = 4


def pole() -> gym.Env[Any, Any]:
    return gym.make("CartPole-v1", max_episode_steps=12)


def poles(mode: AutoresetMode = AutoresetMode.NEXT_STEP) -> Any:
    return sync([pole] * FOUR, mode)


def native(num: int = FOUR) -> Any:
    return gym.make_vec("CartPole-v1", num, vectorization_mode="vector_entry_point")


def first(envs: Any, seed: int = 3) -> Any:
    return envs.reset(seed=seed)[1]["robustness"].tolist()


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
@pytest.mark.parametrize("read", [sideways, drift, energy], ids=["obs", "action", "marked"])
def test_function_reads_each_environment(mode: AutoresetMode, read: Callable[[Step], Any]) -> None:

    signals = {"x": read}

    def wrapped() -> gym.Env[Any, Any]:
        return StlMonitor(pole(), SPEC, signals, on_violation="report")

    together = VectorStlMonitor(poles(mode), SPEC, signals)
    singles = sync([wrapped] * FOUR, mode)
    assert difference(trajectory(together, 40), trajectory(singles, 40)) == ""


def test_native_vector_environment() -> None:
    obs, _ = native().reset(seed=3)
    expected = (1.0 - (obs[:, 0] - obs[:, 2]).astype(np.float64)).tolist()
    assert first(VectorStlMonitor(native(), SPEC, {"x": sideways})) == pytest.approx(expected)


def test_async_vector_environment() -> None:
    apart = AsyncVectorEnv([pole] * FOUR)
    both = []
    for envs in (apart, poles()):
        monitor = VectorStlReward(
            envs, "always[0:1](x + u < 1)", {"x": sideways, "u": drift}, mode="add", period=0.02
        )
        both.append(trajectory(monitor, 15))
        monitor.close()
    assert difference(both[0], both[1]) == ""


class Told(gym.Env[Any, Any]):
    """An environment with its own numbers in the info, in attributes, and in observations."""

    observation_space = spaces.Dict({"at": spaces.Discrete(9), "deep": spaces.Box(-9, 9, (2,))})
    action_space = spaces.Box(-1, 1, (1,))

    def __init__(self, number: int) -> None:
        self.number = number

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        return self.shown(), {"begun": True}

    def step(self, action: Any) -> Any:
        info = {"deep": {"n": 0.5 * self.number}, "name": "told"}
        return self.shown(), float(action[0]), False, False, info

    def shown(self) -> dict[str, Any]:
        return {"at": self.number, "deep": np.full(2, self.number, np.float32)}


def of_told(step: Step) -> Any:
    value = step.obs["at"] + 10.0 * step.obs["deep"][1] + 100.0 * step.env.unwrapped.number
    if step.action is None:
        return value if step.info == {"begun": True} and step.reward is None else -1.0
    return value + step.action[0] + step.reward + step.info["deep"]["n"] + len(step.info["name"])


def test_single_steps_of_vector_environment() -> None:
    makes = [functools.partial(Told, number) for number in (1, 2, 5)]
    envs = VectorStlMonitor(sync(makes, AutoresetMode.NEXT_STEP), "always(x < 0)", {"x": of_told})
    _, infos = envs.reset()
    assert infos["robustness"].tolist() == [-111.0, -222.0, -555.0]
    actions = np.array([[0.5], [-0.5], [0.25]], np.float32)
    *_, infos = envs.step(actions)
    assert infos["robustness"].tolist() == [-116.5, -226.0 + 0.0, -562.0]


@pytest.mark.parametrize(
    ("envs", "why"),
    [
        (native, "its environments are not accessible"),
        (
            functools.partial(poles, AutoresetMode.SAME_STEP),
            "with AutoresetMode.SAME_STEP they are reset before the end is seen",
        ),
    ],
)
def test_inaccessible_environment_error(envs: Callable[[], Any], why: str) -> None:
    with pytest.raises(InputError) as caught:
        VectorStlMonitor(envs(), SPEC, {"x": lambda step: step.env.unwrapped.state[0]}).reset()
    text = str(caught.value)
    assert text.startswith("signal 'x': ")
    assert "step.env.unwrapped of environment 0 cannot be read from " in text
    assert f": {why}; read step.obs or step.info, or wrap each environment" in text


def test_inaccessible_environment_has_no_protocols() -> None:
    def read(step: Step) -> float:
        return float(not hasattr(step.env, "__len__") and copy.copy(step.obs)[0])

    _, infos = VectorStlMonitor(native(), SPEC, {"x": read}).reset(seed=3)
    assert len(set(infos["robustness"].tolist())) == FOUR


def test_shared_info_value() -> None:
    class Shared(VectorEnv[Any, Any, Any]):
        """Two environments that share a wind and a table of places."""

        num_envs = 2
        single_observation_space = spaces.Box(-9, 9, (1,))
        single_action_space = spaces.Discrete(2)
        observation_space = spaces.Box(-9, 9, (2, 1))
        action_space = spaces.MultiDiscrete([2, 2])
        metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

        def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
            own = np.array([1.0, 2.0])
            return own[:, None].astype(np.float32), {
                "own": own,
                "wind": 0.5,
                "places": [10.0, 20.0, 30.0],
            }

    def read(step: Step) -> float:
        info = step.info
        return float(info["own"] + info["wind"] + sum(info["places"]))

    _, infos = VectorStlMonitor(Shared(), "always[0:1](x < 0)", {"x": read}, period=1).reset()
    assert infos["robustness"].tolist() == [-61.5, -62.5]


@pytest.mark.parametrize(
    "read", [lambda step: step.obs[:, 0], lambda step: step.obs[..., :, 0].tolist()]
)
def test_unmarked_batch_function_error(
    read: Callable[[Step], Any],
) -> None:
    with pytest.raises(InputError) as caught:
        VectorStlMonitor(native(), SPEC, {"x": read}).reset(seed=3)
    assert str(caught.value).endswith(
        "; the function is called for each environment, but returns 4 numbers for the batch: "
        f"mark it, rtamt_gym.wrappers.batched({read.__qualname__})"
    )


def test_arrays_of_different_shapes_error() -> None:
    sizes = iter([1, 3, 2])

    def read(_: Step) -> Any:
        return np.zeros(next(sizes, 1))

    envs = VectorStlMonitor(native(3), SPEC, {"x": read})
    with pytest.raises(InputTypeError) as caught:
        envs.reset()
    assert str(caught.value).startswith("signal 'x': expected a number from ")


def test_wrong_function_error() -> None:
    with pytest.raises(InputTypeError) as caught:
        VectorStlMonitor(native(3), SPEC, {"x": lambda step: step.obs}).reset()
    assert str(caught.value).endswith(
        "; a function takes the rtamt_gym.Step of one environment, such as lambda step: step.obs[0]"
    )


def test_batched_function_is_called_once_per_step() -> None:
    sizes: list[int] = []

    def count(step: Step) -> Any:
        sizes.append(len(step.obs))
        return step.obs[:, 0]

    envs = VectorStlMonitor(native(), SPEC, {"x": batched(count)})
    envs.reset(seed=3)
    envs.step(np.ones(FOUR, np.int64))
    assert sizes == [4, 1, 1, 1, 1] * 2
    envs.step(np.ones(FOUR, np.int64))
    envs.reset(seed=4)
    assert sizes[10:] == [4, 4]


@pytest.mark.parametrize(
    ("read", "says"),
    [
        (
            lambda step: step.obs[0] - step.obs[2],
            "for environment 0 in the batch of 4, but raises an error for it alone: batched(",
        ),
        (lambda step: step.obs[0], "for environment 1 in the batch of 4, but "),
        (
            lambda step: step.obs[:, 0] - step.obs[:, 0].mean(),
            "for environment 0 in the batch of 4, but 0 for it alone",
        ),
        (
            lambda step: step.obs.mean(axis=0)[: len(step.obs)],
            "for environment 0 in the batch of 4, but ",
        ),
        (
            lambda step: np.zeros(4) if len(step.obs) == 4 else np.zeros((1, 2)),
            "0 for environment 0 in the batch of 4, but an array of shape (1, 2) for it alone",
        ),
    ],
)
def test_batched_function_mixes_environments_error(read: Callable[[Step], Any], says: str) -> None:
    envs = VectorStlMonitor(native(), SPEC, {"x": batched(read)})
    with pytest.raises(InputError) as caught:
        envs.reset(seed=3)
    text = str(caught.value)
    assert text.startswith("signal 'x': batched(")
    assert says in text
    assert text.endswith(
        "; a batched function must keep environments apart, as lambda step: step.obs[:, 0] does; "
        "remove batched from a function of one environment"
    )


def test_batched_function_mixes_environments_at_step() -> None:
    def mixed(step: Step) -> Any:
        if step.action is None:
            return step.obs[:, 0]
        return step.obs[:, 0] * len(step.obs)

    envs = VectorStlMonitor(native(), SPEC, {"x": batched(mixed)})
    envs.reset(seed=3)
    with pytest.raises(InputError, match=r"returns .* for environment 0 in .* 4, but .* alone"):
        envs.step(np.ones(FOUR, np.int64))


def test_batched_function_reads_vector_environment() -> None:
    envs = VectorStlMonitor(
        native(), SPEC, {"x": batched(lambda step: step.env.unwrapped.state[2])}
    )
    obs, infos = envs.reset(seed=3)
    assert infos["robustness"].tolist() == pytest.approx((1.0 - obs[:, 2]).tolist(), abs=1e-6)


@pytest.mark.parametrize("n_envs", [1, 3])
def test_evaluation_with_batched_function(n_envs: int) -> None:
    found = [
        evaluate_policy(
            "zero", "CartPole-v1", "always(x < 0.2)", {"x": read}, episodes=4, n_envs=n_envs
        )
        for read in (sideways, batched(lambda step: step.obs[:, 0] - step.obs[:, 2]))
    ]
    rows = [[row.outcomes["spec"].robustness for row in each.record] for each in found]
    assert rows[0] == rows[1]
    vector = evaluate_policy("zero", poles(), "always(x < 0.2)", {"x": sideways}, episodes=4)
    assert len(vector.record) == 4


def test_single_environment_is_batch_of_one() -> None:
    shapes = []

    def look(step: Step) -> Any:
        shapes.append((step.obs["deep"].shape, step.obs["at"].shape, step.info))
        return step.obs["deep"][:, 0]

    run = simulate(
        Told(2), "always(x > 0)", {"x": batched(look)}, policy=lambda _: [0.5], duration=2, period=1
    )
    assert run.signals["x"].tolist() == [2.0, 2.0, 2.0]
    assert shapes[0][:2] == ((1, 2), (1,))
    assert shapes[0][2] == {"begun": np.array([True]), "_begun": np.array([True])}
    assert shapes[1][2]["deep"]["n"].tolist() == [1.0]
    assert shapes[1][2]["name"].tolist() == ["told"]


def test_relabel_with_batched_function() -> None:
    episode = {
        "observations": [[0.5, 1.0], [0.2, 2.0], [0.1, 0.5]],
        "actions": [[0.0], [1.0]],
        "rewards": [1.0, 2.0],
        "terminations": [False, False],
        "truncations": [False, True],
    }
    sizes = []

    def difference_of(step: Step) -> Any:
        assert step.env is None
        sizes.append(len(step.obs))
        return step.obs[:, 0] - step.obs[:, 1]

    both = [
        relabel([episode] * 3, "always(x < 1)", {"x": read})
        for read in (batched(difference_of), lambda step: step.obs[0] - step.obs[1])
    ]
    assert both[0][2].infos["robustness"].tolist() == both[1][2].infos["robustness"].tolist()
    assert sizes == [1, 1, 2, 1, 1, 1, 2, 1, 2]


def test_batched_function_without_batches_error() -> None:
    import mujoco  # type: ignore[import-untyped]

    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody>'
        "</mujoco>"
    )
    message = (
        "signal 'x': batched(_energy) reads a batch of Gymnasium environments, and this is a "
        "single environment; remove batched"
    )
    with pytest.raises(InputError) as caught:
        StepMonitor(model, mujoco.MjData(model), "always(x < 1)", {"x": energy})  # type: ignore[dict-item]  # what is refused
    assert str(caught.value) == message

    class Pair:
        possible_agents = ("a", "b")
        unwrapped: Any = None

    with pytest.raises(InputError) as caught:
        ParallelStlMonitor(Pair(), "always(x < 1)", {"x": energy})
    assert str(caught.value) == message


def test_batched_function_copies_and_compares() -> None:
    assert pickle.loads(pickle.dumps(energy)) == energy
    assert copy.deepcopy(energies) is energies
    assert pickle.loads(pickle.dumps(energies)) is energies  # marked where it is defined
    assert batched(energy) is energy
    assert energy == batched(energy.function)
    assert len({energy, batched(energy.function)}) == 1
    envs = VectorStlMonitor(poles(), SPEC, {"x": energies})
    envs.reset(seed=1)
    again = pickle.loads(pickle.dumps(envs))
    actions = np.ones(FOUR, np.int64)
    assert difference([again.step(actions)], [envs.step(actions)]) == ""
    with pytest.raises(InputTypeError, match=r"^expected a function of a rtamt_gym.Step to mark"):
        batched("obs[2]")  # type: ignore[arg-type]  # what is refused
