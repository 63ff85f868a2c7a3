"""The time of an environment: the period of its steps, the attributes that state it, its clock.

`StepTime` compares the period of samples with both.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, ClassVar, Literal, NamedTuple

import gymnasium as gym
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import MaxAndSkipObservation, TimeLimit
from numpy.typing import NDArray

from rtamt import InputError, StateError
from rtamt.errors import Argument
from rtamt_gym.checks.callers import caller_level

AnyEnv = gym.Env[Any, Any] | VectorEnv[Any, Any, Any]
"""An environment, or a vector of them."""

# Gymnasium 1.3 added RepeatAction; RLlib still requires Gymnasium 1.2.
_SKIPPING: tuple[type[Any], ...] = (
    MaxAndSkipObservation,
    getattr(gym.wrappers, "RepeatAction", MaxAndSkipObservation),
)
"""The wrappers that repeat steps of the environment."""

_Kind = Literal["control", "step", "physics"]


def _names(kind: _Kind, *, times: str = "", rates: str = "") -> dict[str, tuple[_Kind, bool]]:
    return dict.fromkeys(times.split(), (kind, False)) | dict.fromkeys(rates.split(), (kind, True))


_NAMES: dict[str, tuple[_Kind, bool]] = {
    **_names(
        "control",
        times="control_timestep control_dt ctrl_dt step_dt policy_dt",
        rates="control_hz control_freq control_frequency control_rate ctrl_freq policy_freq "
        "policy_frequency",
    ),
    **_names("step", times="dt tau"),
    **_names(
        "physics",
        times="sim_dt physics_dt sim_timestep physics_timestep model_timestep",
        rates="sim_hz sim_freq sim_frequency simulation_frequency physics_freq physics_hz",
    ),
}
"""The attributes that state a time: its kind, and whether it is a rate, the inverse of a time.

``"control"`` is the time between two actions, which is the time of a step; ``"physics"`` is the
time of a physics step. ``dt`` and ``tau`` are either, depending on the environment.
"""

_SLACK = 1e-6
"""Relative difference between two times that counts as rounding; some are 32-bit floats."""

_TESTED = ("gymnasium.envs.", "rtamt_envs.", "rtamt_gym.benchmarks.")
"""Packages in whose environments ``dt`` and ``tau`` are the time of a step, as tests verify."""


class StatedTime(NamedTuple):
    """A time in seconds, and the attribute or entry of ``config`` that states it."""

    name: str
    period: float

    def __str__(self) -> str:
        return f"{self.name} ({self.period:g} s)"


class _Stated(NamedTuple):
    """The period that an environment states, or a clause about contradictory times.

    It is ``assumed`` if only a ``dt`` or ``tau`` states it, which may be the time of a physics
    step.
    """

    time: StatedTime | None = None
    assumed: bool = False
    conflict: str = ""


def read_period(env: AnyEnv) -> float | None:
    """Return the seconds between two steps of an environment; None if they are not known.

    The control rate comes first, such as ``control_hz`` or ``control_timestep``, as an attribute or
    an entry of ``unwrapped.config``. In highway-env a step lasts ``(simulation_frequency //
    policy_frequency) / simulation_frequency`` seconds. Without a control rate, the period is
    ``unwrapped.dt`` (MuJoCo, Pendulum, Acrobot) or ``unwrapped.tau`` (CartPole). If ``unwrapped``
    states no time and holds one environment with the same actions (PointMaze, AntMaze), the period
    of that environment counts. ``metadata["render_fps"]`` is the frame rate of pictures: Pendulum
    renders 30 frames and makes 20 steps a second.

    A `SyncVectorEnv` has the period of its environments; `ask_another` reads the period of an
    `AsyncVectorEnv`. The period is not known below a wrapper that repeats steps, or if the
    environment states contradictory times; `why_no_period` returns the reason.

    Raises:
        InputError: If the environments of a `SyncVectorEnv` have different periods, or if an
            environment of highway-env makes no physics step in an action.
    """
    simulation = env.unwrapped
    if isinstance(simulation, AsyncVectorEnv) or _skips(env):
        return None
    if isinstance(simulation, SyncVectorEnv):
        periods = {read_period(single) for single in simulation.envs}
        if len(periods) > 1:
            raise InputError(
                f"expected environments of one period, got {', '.join(sorted(map(str, periods)))} "
                f"s in {simulation}; give ",
                Argument("period"),
                ", or ",
                Argument("period", 1),
                " to count steps",
            )
        return periods.pop()
    source = find_period(simulation)
    return None if source is None else source[0]


def find_period(simulation: Any) -> tuple[float, str] | None:
    """Return the seconds between two steps of a simulation and the attribute that states them."""
    for path, inner in simulations(simulation):
        stated = _stated(inner)
        if stated.time is not None:
            return stated.time.period, f"{path}{stated.time.name}"
        if stated.conflict:
            return None
    return None


def simulations(simulation: Any) -> Iterator[tuple[str, Any]]:
    """Yield an environment and the environment that it holds, with their paths.

    The inner environment must have the same actions: with other actions, as below a hierarchy of
    policies, it may step more often. A path is empty or ends with a dot.
    """
    yield "", simulation
    inside = [
        (name, held)
        for name, held in getattr(simulation, "__dict__", {}).items()
        if isinstance(held, gym.Env) and held is not simulation
    ]
    if len(inside) != 1:
        return
    ((name, held),) = inside
    if _skips(held) or held.action_space != getattr(simulation, "action_space", None):
        return
    path = name if held.unwrapped is held else f"{name}.unwrapped"
    yield f"{path}.", held.unwrapped


def ask_another(env: AnyEnv) -> float | None:
    """Return the period of an `AsyncVectorEnv`, read from one more environment; otherwise None.

    Gymnasium shuts the workers down if a requested attribute is missing. Therefore, the first
    function of ``env_fns`` makes one more environment in this process, which is closed without a
    reset.
    """
    simulation = env.unwrapped
    if not isinstance(simulation, AsyncVectorEnv):
        return None
    try:
        another = simulation.env_fns[0]()
    except Exception as error:
        error.add_note(f"when another environment of {simulation} was made, to read its period;")
        error.add_note("give period=, which needs none")
        raise
    try:
        warn_of_unverified_period(another)
        return read_period(another)
    finally:
        another.close()


def why_no_period(env: AnyEnv) -> str:
    """Return the reason why the period of an environment is not known."""
    if skipping := _skips(env):
        return f"a {skipping} makes several steps in one"
    simulation = env.unwrapped
    many = isinstance(simulation, AsyncVectorEnv | SyncVectorEnv)
    one = simulation.envs[0].unwrapped if isinstance(simulation, SyncVectorEnv) else simulation
    if conflict := conflicting_times(one):
        return conflict
    where = (
        "its environments, or in an environment inside these"
        if many
        else ("it, or in an environment inside it")
    )
    return f"there is no dt, tau or config['policy_frequency'] in {where}"


def conflicting_times(simulation: Any) -> str:
    """Return the contradictory times of a step as a clause; empty without a conflict."""
    for path, inner in simulations(simulation):
        if conflict := _stated(inner).conflict:
            return f"in {path.removesuffix('.')}, {conflict}" if path else conflict
    return ""


def warn_of_unverified_period(env: Any) -> None:
    """Warn if the period of an environment is an `unverified_period`."""
    time = unverified_period(env)
    if time is not None:
        warnings.warn(
            f"a step of {type(env.unwrapped).__name__} is taken to last {time.period:g} s, its "
            f"{time.name}, which nothing verifies: in some simulators {time.name} is the time of a "
            "physics step, and an action takes several. Set period= (--period) to the seconds "
            "between two actions",
            UserWarning,
            stacklevel=caller_level(),
        )


def unverified_period(env: Any) -> StatedTime | None:
    """Return the period of an environment if it is a ``dt`` or ``tau`` that nothing verifies.

    A control rate or a clock of the simulation verifies it, and Gymnasium's environments are known.
    """
    simulation = env.unwrapped
    if isinstance(simulation, SyncVectorEnv):
        simulation = simulation.envs[0].unwrapped
    elif isinstance(simulation, VectorEnv):  # `PufferVectorEnv` may hold a single environment
        one = getattr(simulation, "one", None)
        simulation = simulation if one is None else one.unwrapped
    for path, inner in simulations(simulation):
        if clock_of(inner) is not None:
            return None
        time, assumed, _ = _stated(inner)
        if time is not None:
            module = getattr(getattr(type(inner), "step", None), "__module__", "")
            known = not assumed or module.startswith(_TESTED)
            return None if known else StatedTime(f"{path}{time.name}", time.period)
    return None


class StatedTimes:
    """The attributes of an environment that its period depends on, quick to read again."""

    def __init__(self, env: AnyEnv) -> None:
        inside = [inner for _, inner in simulations(env.unwrapped)]
        spelled = [spelling for name in _NAMES for spelling in _spellings(name)]
        self._named = [
            (inner, name)
            for inner in inside
            for name in spelled
            if getattr(inner, name, None) is not None
        ]
        self._configured = [
            (inner, name)
            for inner in inside
            if isinstance(getattr(inner, "config", None), Mapping)
            for name in _NAMES
            if name in inner.config
        ]

    def read(self) -> list[float | None]:
        """Return their values now."""
        return [
            *(_attribute(inner, name) for inner, name in self._named),
            *(_positive(inner.config.get(name)) for inner, name in self._configured),
        ]


def frames_per_action(config: Mapping[str, Any]) -> int | None:
    """Return the physics steps of an action in highway-env; None for other configurations."""
    policy = _positive(config.get("policy_frequency"))
    simulation = _positive(config.get("simulation_frequency"))
    if policy is None or simulation is None:
        return None
    frames = int(simulation // policy)
    if not frames:
        raise InputError(
            f"config['policy_frequency'] is {policy:g} Hz and config['simulation_frequency'] is "
            f"{simulation:g} Hz, so an action makes no physics step and nothing moves. Set "
            f"simulation_frequency to {policy:g} or more"
        )
    return frames


def _stated(simulation: Any) -> _Stated:
    """Read every time that an environment states, and compare them."""
    config = getattr(simulation, "config", None)
    config = config if isinstance(config, Mapping) else {}
    frames = frames_per_action(config)
    if frames is not None:  # highway-env
        time = frames / float(config["simulation_frequency"])
        controls = [StatedTime("config['policy_frequency']", time)]
        steps = physics = _times(simulation, {}, "step")
    else:
        controls = _times(simulation, config, "control")
        steps = _times(simulation, config, "step")
        physics = steps + _times(simulation, config, "physics")
    if not controls and not steps:
        return _Stated()
    first, *others = controls or steps
    for other in others:
        if not math.isclose(first.period, other.period, rel_tol=_SLACK):
            return _Stated(conflict=f"{first} and {other} are different times of a step")
    for part in physics if controls else ():
        count = first.period / part.period
        if not round(count) or not math.isclose(count, round(count), rel_tol=_SLACK):
            return _Stated(
                conflict=f"{first} is not a multiple of {part}, so the time of a step depends on "
                "how the environment rounds"
            )
    return _Stated(first, assumed=not controls)


def _times(simulation: Any, config: Mapping[str, Any], kind: _Kind) -> list[StatedTime]:
    """Read the times of a kind from attributes, some also in capitals, and from ``config``."""
    times = []
    for name, (kind_of_name, is_rate) in _NAMES.items():
        if kind_of_name != kind:
            continue
        values = {spelling: _attribute(simulation, spelling) for spelling in _spellings(name)}
        if kind != "step":
            values[f"config[{name!r}]"] = _positive(config.get(name))
        for position, number in values.items():
            if number is not None:
                times.append(StatedTime(position, 1.0 / number if is_rate else number))
    return times


def _spellings(name: str) -> tuple[str, ...]:
    return (name,) if _NAMES[name][0] == "step" else (name, name.upper())


def _attribute(simulation: Any, name: str) -> float | None:
    value = getattr(simulation, name, None)
    if name == "control_timestep" and callable(value):  # as in dm_control
        value = value()
    return _positive(value)


def _skips(env: AnyEnv) -> str:
    """Return the name of the wrapper that repeats steps, or an empty string."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, _SKIPPING):
            return type(env).__name__
        env = env.env
    return ""


def _positive(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    number = float(value)
    return number if 0.0 < number < math.inf else None


@dataclass(frozen=True, slots=True)
class SimulationClock:
    """The time of a MuJoCo simulation, which each step of the physics advances."""

    simulation: Any
    name: ClassVar[str] = "data.time"

    def read(self) -> float:
        """Return the time in seconds."""
        return float(self.simulation.data.time)


class _RoadClock(SimulationClock):
    """The time of highway-env from its physics steps; its own ``time`` counts actions."""

    name = "its physics steps"

    def read(self) -> float:
        return float(self.simulation.steps / self.simulation.config["simulation_frequency"])


@dataclass(frozen=True, slots=True)
class StepCount(SimulationClock):
    """The time of the steps that a `TimeLimit` counts, with the stated period."""

    period: float
    name = "the steps that its TimeLimit counts"

    @classmethod
    def of(cls, env: Any, period: float) -> StepCount | None:
        """Return the count of the innermost `TimeLimit`; None without one."""
        limit: Any = None
        while isinstance(env, gym.Wrapper):
            if isinstance(env, TimeLimit):
                limit = env
            env = env.env
        if limit is None or not isinstance(getattr(limit, "_elapsed_steps", None), int | None):
            return None
        return cls(limit, period)

    def read(self) -> float:
        """Return the time in seconds."""
        return (self.simulation._elapsed_steps or 0) * self.period  # noqa: SLF001 - no public count


def clock_of(simulation: Any) -> SimulationClock | None:
    """Return the clock of a simulation of MuJoCo or highway-env; None for all others."""
    mujoco = sys.modules.get("mujoco")  # a simulation of it has loaded it
    if mujoco is not None and isinstance(getattr(simulation, "data", None), mujoco.MjData):
        return SimulationClock(simulation)
    config = getattr(simulation, "config", None)
    if (
        isinstance(config, Mapping)
        and {"policy_frequency", "simulation_frequency"} <= config.keys()
        and isinstance(getattr(simulation, "steps", None), int)
    ):
        return _RoadClock(simulation)
    return None


ReadPeriod = Callable[[Any], float | None]
"""Returns the period that an environment states now."""

STEPS = 10
"""The number of steps of the first episode that are compared."""

AGAIN = 2
"""The number of steps of each later episode, as a reset may change the time of a step."""

_DRIFT = 0.001
"""The tolerance of clocks in periods, because the time is a rounded sum."""


class StepTime:
    """Compares a period with the environment at each reset, and with its clock in the first steps.

    A period that was read from the environment, and that a bound depends on, must not change: a
    change is an error. All other differences are warnings, each once. A period of 1 that the user
    has set counts steps, and is compared with nothing.

    The clock of MuJoCo is ``data.time``, the clock of highway-env is ``steps /
    config["simulation_frequency"]``. For all others, the innermost `TimeLimit` counts steps, which
    reveals a wrapper inside the monitor that repeats actions.

    Args:
        env: The environment, or a vector environment.
        period: Seconds between samples.
        read: Reads the period that the environment states.
        was_read: Whether the period was read, not set.
        timed: Whether a specification has bounds in time.
        substeps: Whether there are several samples in a step.
        stated: The period that the environment states now; None: read it at the first reset.

    Attributes:
        samples: The samples since the reset, without the sample of the reset.
        left: The number of steps of this episode that are still to compare; 0 until a reset.
        reported: The times of a step in earlier warnings, which many environments share.
    """

    def __init__(
        self,
        env: Any,
        period: float,
        read: ReadPeriod,
        *,
        was_read: bool,
        timed: bool,
        substeps: bool = False,
        stated: float | None = None,
    ) -> None:
        self._env, self._period, self._read = env, period, read
        self._was_read, self._timed, self._substeps = was_read, timed, substeps
        self._stated = stated
        # Quicker to read at every reset than the period itself.
        self._times = StatedTimes(env)
        self._values = None if stated is None else self._times.read()
        self._clock: SimulationClock | None = None
        self._counts_steps = period == 1.0 and not was_read
        if not self._counts_steps:
            inside = [clock_of(inner) for _, inner in simulations(env.unwrapped)]
            self._clock = next(filter(None, inside), None)
        self._has_clock = self._clock is not None
        if self._clock is None and was_read and not substeps:
            self._clock = StepCount.of(env, period)
        self._start, self._due = 0.0, STEPS
        self.samples = self.left = 0
        self.reported: list[float] = []

    def begin(self) -> None:
        """Compare the period after a reset; a change that a bound depends on is a StateError."""
        self._compare_stated()
        if self._clock is not None:
            self._start, self.samples = self._clock.read(), 0
            self.left, self._due = self._due, AGAIN

    def step(self, samples: int = 1) -> None:
        """Compare the clock after a step with this number of samples, as `begin` does."""
        if not self.left or self._clock is None:
            return
        self.samples += samples
        elapsed = self._clock.read() - self._start
        # A clock that stands still, or was set back, is not a clock.
        if elapsed <= 0.0 or abs(elapsed - self.samples * self._period) <= _DRIFT * self._period:
            self.left -= 1
            return
        lasts = elapsed / self.samples
        source = f"{self._env.unwrapped} states" if self._was_read else "period= states"
        error = StateError(
            f"expected samples {self._period:g} s apart, as {source}, got {lasts:g} s by "
            f"{self._clock.name}: bounds last {lasts / self._period:g} times as long as specified; "
            "if an inner wrapper makes several steps in one, pass ",
            Argument("period", round(lasts, 9)),
            ", or put the monitor inside of it",
        )
        if self._was_read and self._timed:
            raise error
        self.left = 0
        self._warn(lasts, str(error))

    def _compare_stated(self) -> None:
        if self._counts_steps or not self._timed:
            return
        values = self._times.read()
        if values == self._values and not self._substeps:
            return
        stated, before = self._read(self._env), self._stated
        if self._was_read:
            if before is not None and (stated is None or not math.isclose(stated, self._period)):
                raise StateError(
                    f"expected the period of {self._period} s that {self._env.unwrapped} had at "
                    f"construction, got {stated} s; wrap it again, or give period="
                )
            self._values = values
            return
        self._stated, self._values = stated, values
        if self._has_clock or stated is None or before is None or math.isclose(stated, before):
            return
        if not math.isclose(stated, self._period):
            self._warn(
                stated,
                f"period= is {self._period:g} s, but a step of {self._env.unwrapped}, which lasted "
                f"{before:g} s, lasts {stated:g} s since this reset; make the monitor again with "
                "the seconds between two samples as period=",
            )

    def _warn(self, lasts: float, text: str) -> None:
        """Warn of a time of a step, unless a warning has reported it."""
        if not any(math.isclose(lasts, time, rel_tol=_DRIFT) for time in self.reported):
            self.reported.append(lasts)
            warnings.warn(text, UserWarning, stacklevel=caller_level())


class StepTimes:
    """The `StepTime` of each environment of a `SyncVectorEnv`, or one for all others.

    The one of all is compared at every reset of some environments. ``make`` is None without a
    period.
    """

    def __init__(self, env: Any, make: Callable[[Any], StepTime] | None) -> None:
        base = env.unwrapped
        self._shared: StepTime | None = None
        self._times: Sequence[StepTime] = ()
        if make is not None and isinstance(base, SyncVectorEnv):
            self._times = [make(single) for single in base.envs]
            for time in self._times:
                time.reported = self._times[0].reported
        elif make is not None:
            self._shared = make(env)
        self._compared: set[int] = set()

    def begin(self, entries: NDArray[Any]) -> None:
        """Compare the environments of a mask after their reset."""
        if self._shared is not None:
            self._shared.begin()
        if self._times:
            for entry in entries.nonzero()[0].tolist():
                self._times[entry].begin()
                if self._times[entry].left:
                    self._compared.add(entry)

    def step(self, again: NDArray[Any] | None) -> None:
        """Compare the step of all environments; ``again`` is the mask of the reset ones."""
        if self._compared:
            for entry in sorted(self._compared):
                if again is None or not again[entry]:
                    self._times[entry].step()
            self._compared = {entry for entry in self._compared if self._times[entry].left}
        if again is not None and again.any():
            self.begin(again)
