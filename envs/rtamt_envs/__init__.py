"""Scenarios: models with requirements, as environments of Gymnasium.

Importing the package registers them, as ``rtamt/NAME-v0``. Without Gymnasium there is nothing to
register them with; `scenario_of` finds them all the same.

    >>> import gymnasium as gym, rtamt_envs
    >>> env = gym.make("rtamt/ChasingCars-v0")
    >>> sorted(env.unwrapped.requirements)
    ['CC1', 'CC2', 'CC3', 'CC4', 'CC5', 'CCx']
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from rtamt import InputError
from rtamt_gym.checks.names import listing, nearest

if TYPE_CHECKING:
    from rtamt_envs.scenario import Scenario

__all__ = ["SCENARIOS", "scenario_of"]

SCENARIOS: dict[str, tuple[str, int]] = {
    "AircraftElevator": ("aircraft_elevator", 1000),
    "AutomaticTransmission": ("automatic_transmission", 3500),
    "ChasingCars": ("chasing_cars", 2000),
    "SteamCondenser": ("steam_condenser", 3500),
    "MobileRobot": ("mobile_robot", 600),
    "RequestGrant": ("request_grant", 150),
    "TwoServiceRobots": ("two_service_robots", 600),
}
"""The module of each scenario and the steps of its episodes, by name. The modules are imported
when an environment is made: they import numba."""


def scenario_of(name: str) -> Scenario:
    """Finds a scenario by its name, such as ``"ChasingCars"``.

    Raises:
        InputError: If there is none of this name; names the nearest.
    """
    if name not in SCENARIOS:
        raise InputError(
            f"there is no scenario {name!r}{nearest(name, SCENARIOS)}; "
            f"there are {listing(SCENARIOS)}"
        )
    found: Scenario = import_module(f"{__name__}.{SCENARIOS[name][0]}").SCENARIO
    return found


if find_spec("gymnasium") is not None:
    import gymnasium as gym

    for _name, (_, _steps) in SCENARIOS.items():
        if f"rtamt/{_name}-v0" not in gym.registry:
            gym.register(
                f"rtamt/{_name}-v0",
                entry_point="rtamt_envs.environment:ScenarioEnv",
                vector_entry_point="rtamt_envs.vector:ScenarioVectorEnv",
                kwargs={"scenario": _name},
                max_episode_steps=_steps,
                disable_env_checker=True,  # an error of the first reset would leave it unusable
            )
