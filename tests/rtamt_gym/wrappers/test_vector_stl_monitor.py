"""`VectorStlMonitor` reports for each environment what `StlMonitor` reports, in every mode."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from environments import CASES, Case
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList
from replay import Replay, X
from vector_environments import MODES, Make, both, difference, native, trajectory

from rtamt_gym import Step, StlMonitor, VectorStlMonitor
from rtamt_gym.options.evaluation import View

modes = pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)


monitored = functools.partial(both, StlMonitor, VectorStlMonitor, on_violation="report")


# The quick environment of highway-env is sufficient.
QUICK = [case for case in CASES if "highway-fast" not in case.env_id]


def bare(case: Case) -> list[Make]:
    """Return episodes of different lengths, so that they do not end together."""
    return [
        functools.partial(gym.make, case.env_id, max_episode_steps=limit) for limit in (6, 40, 9)
    ]


@pytest.mark.slow(keep=8)
@pytest.mark.filterwarnings("ignore:expected samples")  # the period fits only the bounds
@modes
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.env_id.split(":")[-1])
@pytest.mark.parametrize("view", ["episode", "step"])
def test_trajectories_and_infos_are_those_of_environments_wrapped_one_by_one(
    case: Case, mode: AutoresetMode, view: View
) -> None:
    specs, signals = case.specs, case.signals
    if case.env_id == "HalfCheetah-v5" and mode is AutoresetMode.SAME_STEP:
        # The simulation has been reset when the terminal observation is shown.
        signals = {"pitch": "obs[1]", "vz": "obs[9]", "v": signals["v"]}
    if view == "step":
        specs, name = {}, next(iter(signals))
        specs = {"low": f"{name} < 0.5", "calms": f"{name} > 0 implies eventually[0:0.5]({name}<0)"}
        signals = {name: signals[name]}
    together, singles = monitored(
        bare(case), mode, specs, signals, view=view, details=True, cost="depth", period=0.1
    )
    steps = 14 if "parking" in case.env_id else 30
    expected = [strip(shown) for shown in trajectory(singles, steps)]
    assert difference([strip(shown) for shown in trajectory(together, steps)], expected) == ""
    assert len(together.stl_episodes) >= 2
    together.close()
    singles.close()


def strip(shown: tuple[Any, ...]) -> tuple[Any, ...]:
    """Remove the random actions in highway-env's infos of a reset, which no seed repeats."""
    infos = {key: value for key, value in shown[-1].items() if key.strip("_") != "action"}
    return (*shown[:-1], infos)


SERIES: list[Sequence[float]] = [
    [3, 2, 0, 4, 4],
    [3, 3],
    [0, 3, 3],
    [3, 3, 3, 3, 3, 3, 0, 3],
    [2, 0.5, 3],
]


def replays(end: str = "terminated") -> list[Make]:
    return [functools.partial(Replay, values, end) for values in SERIES]


@modes
def test_observations_and_infos_may_be_nested(mode: AutoresetMode) -> None:
    signals = {
        "x": "obs['pair'][0][1]",
        "n": "obs['pair'][1]",
        "a": ("action['push'][0]", 0.0),
        "v": ("info['deep']['speed'][1]", 1.0),
        "w": ("info['list'][0]", 0.5),
    }
    specs = "always(x + n + a + v + w < 9)"
    together, singles = monitored(
        [functools.partial(Nested, n) for n in (2, 3)], mode, specs, signals
    )
    assert difference(trajectory(together, 9), trajectory(singles, 9)) == ""


class Nested(gym.Env[Any, Any]):
    """Nested dictionaries and tuples."""

    observation_space = spaces.Dict(
        {"pair": spaces.Tuple([spaces.Box(-9, 9, (2,)), spaces.Discrete(9)]), "t": spaces.Text(3)}
    )
    action_space = spaces.Dict({"push": spaces.Box(-1, 1, (1,))})

    def __init__(self, length: int) -> None:
        self.length = length
        self.at = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.at = 0
        return self.shown(), {}

    def step(self, action: Any) -> Any:  # noqa: ARG002
        self.at += 1
        speed = np.array([0.0, self.at])
        info = {"deep": {"speed": speed}, "list": [self.at, "x"]}
        return self.shown(), 1.0, self.at == self.length, False, info

    def shown(self) -> dict[str, Any]:
        return {"pair": (np.array([0, self.at], np.float32), self.at), "t": "abc"}


# ---- callables ----


def height(step: Step) -> Any:
    """A signal that reads the step of one environment or of many."""
    return step.obs[..., 0] + (0.0 if step.action is None else step.action[..., 0])


def own(step: Step) -> Any:
    return step.info["own"]


@modes
def test_a_callable_reads_each_environment(mode: AutoresetMode) -> None:
    signals = {"h": height, "i": own, "r": (lambda step: step.reward, 0.0)}
    together, singles = monitored(replays(), mode, "always(h + i + r > 1)", signals)
    assert difference(trajectory(together, 20), trajectory(singles, 20)) == ""


# ---- native and asynchronous environments ----


UPRIGHT = (
    "always(abs(theta) > 0.1 implies eventually[0:0.2](abs(theta) < 0.05))",
    CASES[0].signals,
)


def test_a_native_environment_is_monitored_as_recorded_traces_are() -> None:
    """It draws its states from one generator, one environment after the other."""
    envs = VectorStlMonitor(native(5), *UPRIGHT, cost="first")
    shown = trajectory(envs, 120)
    for entry in range(5):
        monitor = StlMonitor(
            Played(shown, entry), *UPRIGHT, on_violation="report", cost="first", period=0.02
        )
        begins = True
        for row in shown:
            if begins:
                _, info = monitor.reset()
                ended = False
            else:
                _, _, terminated, truncated, info = monitor.step(0)
                ended = terminated or truncated
            begins = ended
            mine = DictInfoToList._convert_info_to_list(DictInfoToList(envs), row[-1])[entry]
            assert difference(plain(mine), plain(info)) == ""
    assert len(envs.stl_episodes) >= 15


def plain(info: dict[str, Any]) -> dict[str, Any]:
    """Return it with Python numbers instead of NumPy's."""
    return {
        key: plain(value) if isinstance(value, dict) else np.array([value]).tolist()[0]
        for key, value in info.items()
    }


class Played(gym.Env[Any, Any]):
    """One environment of a trajectory, as an environment."""

    observation_space = spaces.Box(-9, 9, (4,), np.float32)
    action_space = spaces.Discrete(2)

    def __init__(self, shown: list[tuple[Any, ...]], entry: int) -> None:
        self.rows = iter(shown)
        self.entry = entry

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ARG002
        return next(self.rows)[0][self.entry], {}

    def step(self, action: Any) -> Any:  # noqa: ARG002
        obs, rewards, terminated, truncated, _ = next(self.rows)
        entry = self.entry
        return obs[entry], rewards[entry], bool(terminated[entry]), bool(truncated[entry]), {}


@modes
@pytest.mark.parametrize("view", ["episode", "step"])
def test_a_nan_may_keep_the_last_value_of_its_environment(mode: AutoresetMode, view: View) -> None:
    nan = float("nan")
    traces = [[3.0, nan, 0.5, nan, nan], [2.0, 2.0, nan], [4.0, nan, nan, 0.0, 3.0, nan, 2.0]]
    text = "x > 1 implies eventually[0:2](x < 1)"
    vector, singles = monitored(
        [functools.partial(Replay, values) for values in traces],
        mode,
        f"always({text})" if view == "episode" else text,
        X,
        view=view,
        nan="hold",
        period=1,
        details=True,
    )
    together, alone = (
        [({**shown[-1], "final_obs": None}, *shown[1:-1]) for shown in trajectory(envs, 20)]
        for envs in (vector, singles)
    )
    assert difference(together, alone) == ""
