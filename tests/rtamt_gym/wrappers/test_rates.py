"""Rates of change in environments and recordings."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from rtamt import SpecificationError
from rtamt_gym import StlMonitor, VectorStlMonitor
from rtamt_gym.__main__ import main

SPEC = "always(abs(rate(angle)) <= 0.5)"
READ = {"angle": "obs[2]"}


def test_wrappers_divide_by_the_time_step() -> None:
    one = StlMonitor(gym.make("CartPole-v1"), SPEC, signals=READ)
    envs = gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    several = VectorStlMonitor(envs, SPEC, signals=READ)
    for seed in (3, 8):
        angles = [one.reset(seed=seed)[0][2]]
        several.reset(seed=[seed, seed + 1])
        ended = False
        while not ended:
            observation, _, ended, _, info = one.step(1)
            *_, infos = several.step(np.array([1, 0]))
            angles.append(observation[2])
            rates = np.diff(np.array(angles, np.float64)) / 0.02
            assert info["robustness"] == min(0.5, (0.5 - np.abs(rates)).min())
            assert infos["robustness"][0] == info["robustness"]


def test_wrapper_needs_a_period() -> None:
    unknown = gym.make("FrozenLake-v1")
    with pytest.raises(SpecificationError, match="does not state the duration of a step"):
        StlMonitor(unknown, "always(rate(place) <= 4)", signals={"place": "obs"})


@pytest.mark.parametrize(
    ("first", "options", "code"),
    [
        ("time", (), 1),
        ("time", ("--period", "1"), 0),
        ("A", (), 2),  # resembles times
        ("A", ("--time", "A"), 1),
        ("step", (), 0),  # per sample
        ("time", ("--dense",), 2),
    ],
)
def test_recordings_divide_by_their_period(
    first: str, options: tuple[str, ...], code: int, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    rows = zip((0, 0.1, 0.2, 0.3, 0.4), (0, 1, 2, 6, 6), strict=True)
    path.write_text(f"{first},v\n" + "".join(f"{time},{v}\n" for time, v in rows))
    assert main(["monitor", "always(abs(rate(v)) <= 20)", str(path), *options]) == code
