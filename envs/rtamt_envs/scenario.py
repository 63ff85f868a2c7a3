"""The declaration of a scenario, and the table of all scenarios.

To add a scenario, add a file to this folder with its ``SCENARIO``, and a row to `SCENARIOS`, which
registers it and tests it in ``tests/rtamt_envs/test_contract.py``. Add ``test_NAME.py`` and, for a
second model that shares no code with it, ``test_validation_NAME.py`` in ``tests/rtamt_envs`` and a
file in ``tests/support/models``. Add a row to the table of scenarios in ``docs/simulations.md``,
and correct the number of models at the top of that page.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.space import Parameter, Signal

if TYPE_CHECKING:  # it is optional
    from matplotlib.figure import Figure


SCENARIOS: dict[str, tuple[str, int]] = {
    "AircraftElevator": ("aircraft_elevator", 1000),
    "AutomaticTransmission": ("automatic_transmission", 3500),
    "ChasingCars": ("chasing_cars", 2000),
    "SteamCondenser": ("steam_condenser", 3500),
    "MobileRobot": ("mobile_robot", 600),
    "RequestGrant": ("request_grant", 150),
    "TwoServiceRobots": ("two_service_robots", 600),
}
"""The module of each scenario and the steps of its episodes, by name. Modules are imported only
when an environment is created, because they import numba."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Quantity(NamedTuple):
    """A component of an action or an observation.

    Attributes:
        name: The name that requirements and search spaces use.
        unit: The unit; empty for a plain number.
        low: The minimum.
        high: The maximum.
    """

    name: str
    unit: str = ""
    low: float = -np.inf
    high: float = np.inf


class EpisodeSoFar(NamedTuple):
    """An episode up to the current sample, for a picture.

    Attributes:
        times: The times of the samples in seconds, shape (k + 1,).
        observations: The observations, shape (k + 1, observations).
        actions: The action of each step, shape (k, actions).
        parameters: The parameters of the episode by name.
    """

    times: Floats
    observations: Floats
    actions: Floats
    parameters: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Scenario:
    """A model with requirements: the declaration of its environments.

    The functions work on one-dimensional arrays of float64 and fill their last arguments in place.
    They are written in the part of Python that numba compiles, see `rtamt_envs.compiled`.

    Attributes:
        name: The name; the environment is registered as ``rtamt/NAME-v0``.
        title: A short description.
        source: The source of equations and numbers.
        period: Seconds between samples.
        duration: Seconds of an episode.
        actions: The components of an action.
        observations: The components of an observation.
        requirements: The text of a ``.stl`` file; formulas that no other formula uses are
            requirements.
        state: The size of a state. Discrete state is stored as whole numbers.
        start: ``start(parameters, noise, state, observation)`` starts an episode.
        step: ``step(action, parameters, noise, state, observation)`` makes a step of a period.
        baseline: ``baseline(time, observation, parameters, action)`` is a policy.
        parameters: Free parameters, initial states and times of faults, each with its default.
        inputs: The waveforms of actions for a search.
        noise: The number of standard normal random numbers per step.
        draw: A function that draws an episode into a figure of Matplotlib; None plots each
            observation.
    """

    name: str
    title: str
    source: str
    period: float
    duration: float
    actions: tuple[Quantity, ...]
    observations: tuple[Quantity, ...]
    requirements: str = field(repr=False)
    state: int
    start: Callable[[Floats, Floats, Floats, Floats], None] = field(repr=False)
    step: Callable[[Floats, Floats, Floats, Floats, Floats], None] = field(repr=False)
    baseline: Callable[[float, Floats, Floats, Floats], None] = field(repr=False)
    parameters: tuple[Parameter, ...] = ()
    inputs: tuple[Signal, ...] = ()
    noise: int = 0
    draw: Callable[[Figure, EpisodeSoFar], None] | None = field(default=None, repr=False)

    @property
    def id(self) -> str:
        """The id of the registered environment."""
        return f"rtamt/{self.name}-v0"

    @cached_property
    def specifications(self) -> Mapping[str, rtamt.Specification]:
        """The requirements by name."""
        return rtamt.parse(self.requirements).requirements

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """The selector of each name of the observation, for wrappers and `simulate`."""
        return {observation.name: f"obs[{i}]" for i, observation in enumerate(self.observations)}

    @cached_property
    def defaults(self) -> Floats:
        """The default of each parameter."""
        return np.array([parameter.default for parameter in self.parameters], np.float64)

    def parameter_row(self, values: Mapping[str, Any], base: Floats) -> Floats:
        """Return a copy of ``base`` with some parameters replaced; shape (..., parameters).

        Args:
            values: A number for each name, or an array with a number per environment.
            base: The parameters of one environment or of many.

        Raises:
            InputError: If a parameter is unknown, or a value has a wrong shape or is nan.
            InputTypeError: If ``values`` is not a mapping, or a value is not a number.
        """
        if not isinstance(values, Mapping):
            raise InputTypeError(
                f"expected parameters of {self.id} as a mapping from names to numbers, got "
                f"{values!r}"
            )
        row = base.copy()
        names = [parameter.name for parameter in self.parameters]
        for name, value in values.items():
            if name not in names:
                has = f"the parameters are {listing(names)}" if names else "it has none"
                raise InputError(
                    f"{self.id} has no parameter {name!r}; {has}{nearest(name, names)}"
                )
            try:
                numbers = np.asarray(value, np.float64)
            except (TypeError, ValueError):
                raise InputTypeError(
                    f"expected a number as parameter {name!r} of {self.id}, got {value!r}"
                ) from None
            if numbers.shape not in {(), row.shape[:-1]} or np.isnan(numbers).any():
                entries = f" or {row.shape[0]} numbers" if row.ndim > 1 else ""
                raise InputError(
                    f"expected a number{entries} as parameter {name!r} of {self.id}, got {value!r}"
                )
            row[..., names.index(name)] = numbers
        return row

    def __deepcopy__(self, memo: object) -> Scenario:
        """Return itself, because it is immutable."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name, because compiled functions cannot be pickled."""
        return scenario_of, (self.name,)


def scenario_of(name: str) -> Scenario:
    """Return the scenario with a name, such as ``"ChasingCars"``, or raise InputError."""
    if name not in SCENARIOS:
        raise InputError(
            f"unknown scenario {name!r}{nearest(name, SCENARIOS)}; there are {listing(SCENARIOS)}"
        )
    result: Scenario = import_module(f"rtamt_envs.{SCENARIOS[name][0]}").SCENARIO
    return result


class Declared:
    """The attributes of a scenario that its environment and its vector environment share."""

    scenario: Scenario

    @property
    def dt(self) -> float:
        """Seconds of a step."""
        return self.scenario.period

    @property
    def requirements(self) -> Mapping[str, rtamt.Specification]:
        """The requirements by name."""
        return self.scenario.specifications

    @property
    def signals(self) -> Mapping[str, str]:
        """The selector of each name of the observation, for wrappers and `simulate`."""
        return self.scenario.signals

    @property
    def action_names(self) -> tuple[str, ...]:
        """The names of the components of an action."""
        return tuple(action.name for action in self.scenario.actions)
