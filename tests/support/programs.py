"""The programs on docs/learners.md or linked there, and the episodes of their environments."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from math import ceil
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.envs.classic_control import CartPoleEnv
from pages import blocks
from paths import ROOT
from scipy.stats import binomtest

PAGE = ROOT / "docs" / "learners.md"

BOUND, LIMIT = 0.12, 20
"""The programs take at most 20 steps, under ``always(abs(x) < 0.12)``."""


@dataclass(eq=False)
class Ride:
    """An episode of CartPole: its positions from the reset on, and whether the pole fell."""

    env: Any
    positions: list[float]
    fell: bool = False
    last_step: int = 0
    """The number of the newest step, over all environments."""

    @property
    def steps(self) -> int:
        return len(self.positions) - 1

    @property
    def margins(self) -> list[float]:
        return [BOUND - abs(x) for x in self.positions]

    @property
    def outside(self) -> int:
        """Return the steps after which the cart is outside."""
        return sum(margin <= 0 for margin in self.margins[1:])

    @property
    def success(self) -> bool:
        """Return whether the cart was always inside, without a fall."""
        return not self.fell and min(self.margins) > 0

    @property
    def violated_at(self) -> int:
        """Return the first sample outside; without one, the last sample, of the fall."""
        outside = (at for at, margin in enumerate(self.margins) if margin <= 0)
        return next(outside, self.steps)


@dataclass
class Rides:
    """All episodes of CartPole in this process."""

    started: list[Ride] = field(default_factory=list)
    steps: int = 0

    def ended(self, *, early: bool, limit: int = LIMIT, within: object = None) -> list[Ride]:
        """Return the complete episodes, in the order of their ends.

        Args:
            early: Whether the first step outside is an end.
            limit: The steps after which an episode ends.
            within: A vector environment of Stable-Baselines3 or Gymnasium, for its episodes only.
        """
        envs: Any = None if within is None else within.get_attr("unwrapped")  # type: ignore[attr-defined]
        ended = [
            ride
            for ride in self.started
            if (ride.fell or ride.steps == limit or (early and ride.outside))
            and (envs is None or any(ride.env is env for env in envs))
        ]
        return sorted(ended, key=lambda ride: ride.last_step)


def shares_of(rides: Sequence[Ride]) -> dict[str, float]:
    """Return the training metrics of one requirement, ``spec``, counted by hand."""
    violations = [ride for ride in rides if not ride.success]
    good = 1 - len(violations) / len(rides)
    metrics = {"satisfied": good, "spec/satisfied": good, "spec/undecided": 0.0}
    metrics["spec/violated"] = len(violations) / len(rides)
    count = len(rides) - len(violations)
    interval = binomtest(count, len(rides)).proportion_ci(0.95, "exact")
    for prefix in ("", "spec/"):
        metrics |= {
            f"{prefix}satisfied_low": interval.low,
            f"{prefix}satisfied_high": interval.high,
        }
    heights = [min(ride.margins) for ride in rides]
    for end, share in (("p5", 0.05), ("median", 0.5), ("p95", 0.95)):
        metrics[f"spec/robustness_{end}"] = least(heights, share)
    if violations:
        times = [ride.violated_at * 0.02 for ride in violations]
        metrics["spec/first_violation"] = least(times, 0.5)
    return metrics


def cost_of(rides: Sequence[Ride]) -> dict[str, float]:
    """Return the mean cost of an episode with ``cost="violation"``, by hand: steps outside."""
    return {"cost": sum(ride.outside for ride in rides) / len(rides)}


def counts_of(rides: Sequence[Ride]) -> dict[str, float]:
    """Return the counts of training since its start, by hand."""
    return {"episodes": len(rides), "spec/violations": sum(not ride.success for ride in rides)}


def least(values: Sequence[float], share: float) -> float:
    """Return the smallest value that at least this share of the values does not exceed."""
    return sorted(values)[ceil(share * len(values)) - 1]


def score(rides: Sequence[Ride]) -> tuple[int, int]:
    """Return the score of the best model: successes, and at a tie the sum of the returns."""
    return sum(ride.success for ride in rides), sum(ride.steps for ride in rides)


def play(env: gym.Env[Any, Any], seed: int, act: Callable[[Any], int]) -> None:
    """Play an episode."""
    obs, _ = env.reset(seed=seed)
    ended = False
    while not ended:
        obs, _, terminated, truncated, _ = env.step(act(obs))
        ended = terminated or truncated


@contextmanager
def watched() -> Iterator[Rides]:
    """Record the results of ``reset`` and ``step`` of every CartPole."""
    rides = Rides()
    reset: Any = CartPoleEnv.reset
    step: Any = CartPoleEnv.step

    @wraps(reset)  # Gymnasium reads its parameters
    def watched_reset(env: Any, **arguments: Any) -> Any:  # noqa: ANN401
        result = reset(env, **arguments)
        env.ride = Ride(env, [float(result[0][0])])
        rides.started.append(env.ride)
        return result

    def watched_step(env: Any, action: Any) -> Any:  # noqa: ANN401
        result = step(env, action)
        rides.steps += 1
        env.ride.last_step = rides.steps
        env.ride.positions.append(float(result[0][0]))
        env.ride.fell = bool(result[2])
        return result

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CartPoleEnv, "reset", watched_reset)
        patch.setattr(CartPoleEnv, "step", watched_step)
        yield rides


def programs() -> dict[str, str]:
    """Return the programs of the page by heading: the linked example, or the block of a section.

    Sessions of ``>>>`` are not programs.
    """
    found: dict[str, str] = {}
    for heading, section in _sections():
        own = [block for block in blocks(section, "python") if ">>>" not in block]
        if linked := _EXAMPLE.findall(section):
            (path,) = linked
            found[heading] = (ROOT / path).read_text(encoding="utf-8")
        elif own:
            (found[heading],) = own
    return found


def excerpts() -> dict[str, list[str]]:
    """Return the Python blocks of sections that link an example, by the path of the example."""
    return {
        _EXAMPLE.findall(section)[0]: blocks(section, "python")
        for _, section in _sections()
        if _EXAMPLE.search(section)
    }


_EXAMPLE = re.compile(r"\]\(\.\./(examples/learners/\w+\.py)\)")


def _sections() -> list[tuple[str, str]]:
    """Return the sections of the page, each with its heading."""
    sections = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return [(section.partition("\n")[0], section) for section in sections]


def recipes() -> dict[str, str]:
    """Return the first Python block of each section of docs/training.md, by heading."""
    text = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
    sections = {section.partition("\n")[0]: section for section in text.split("\n## ")[1:]}
    own = {heading: blocks(section, "python") for heading, section in sections.items()}
    own = {heading: listed for heading, listed in own.items() if listed}
    return {heading: first for heading, (first, *_) in own.items()}


def run(heading: str, folder: Path) -> tuple[dict[str, Any], Rides]:
    """Run the program under a heading as `run_program` does."""
    return run_program(programs()[heading], folder)


def run_program(program: str, folder: Path) -> tuple[dict[str, Any], Rides]:
    """Run a program as a script in a folder.

    Returns: The names of the program, and the rides.
    """
    script = folder / "program.py"
    script.write_text(program, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch, watched() as rides:
        patch.chdir(folder)
        return runpy.run_path(str(script), run_name="__main__"), rides
