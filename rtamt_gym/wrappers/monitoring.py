"""The base of all monitors of environments: options, signals, the period, constants, copies."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    NoReturn,
    cast,
    get_args,
)

import gymnasium as gym
from gymnasium.utils import EzPickle
from gymnasium.vector import SyncVectorEnv, VectorEnv, VectorWrapper

from rtamt import InputError, RtamtError, Specification, StateError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.arguments import check_choice, check_known
from rtamt_gym.checks.callers import caller_level, wrappers_around
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.end_warnings import UnseenEndWarning, warn_of_open_end
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.specs import (
    Constants,
    ConstantValue,
    SpecsLike,
    check_period,
    load_specs,
    own_requirements,
    with_unknown_start,
)
from rtamt_gym.judging.vector_monitor_set import VectorMonitorSet
from rtamt_gym.options.evaluation import AtTermination, EvaluationKeywords, EvaluationOptions
from rtamt_gym.signals.periods import (
    ReadPeriod,
    StepTime,
    ask_another,
    clock_of,
    read_period,
    warn_of_unverified_period,
    why_no_period,
)
from rtamt_gym.signals.signals import (
    SignalLike,
    Source,
    checked_mapping,
    own_signals,
    parse_signals,
)
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.taps import rescaling, tapped
from rtamt_gym.wrappers.episode_counters import counts_episodes
from rtamt_gym.wrappers.observing import Observing
from rtamt_gym.wrappers.vector_forms import PufferVectorEnv

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView


OnViolation = Literal["terminate", "truncate", "report"]
"""The effect of a certain violation on the episode, the strongest first."""

Violations = OnViolation | Mapping[str, OnViolation]
"""The option ``on_violation``: one word for all requirements, or a word for each by its name."""

OnSatisfaction = Literal["report", "terminate", "truncate"]
"""The effect on the episode once every specification is certainly satisfied."""


class MonitorOptions(EvaluationKeywords, total=False):
    """The keyword arguments of `StlMonitor` and of `VectorStlMonitor`."""

    on_violation: Violations
    on_satisfaction: OnSatisfaction
    details: bool
    cost: Cost | None
    buffer_length: int
    constants: Mapping[str, ConstantValue] | None
    live: RerunView | None


class ChangedConstants(NamedTuple):
    """New values of constants, and the monitors with them."""

    constants: Constants
    monitor_set: Any


class Monitoring(Observing):
    """The base of `StlMonitor`, `VectorStlMonitor` and `ParallelStlMonitor`."""

    _UNPICKLED: ClassVar[frozenset[str]]
    """Attributes that pickle cannot carry; `_bind_signals` makes them."""

    env: Any
    _monitor_set: MonitorSet | VectorMonitorSet
    _on_violation: dict[str, OnViolation]
    _beneath: Any
    """The tap below a rescaling wrapper, which signals read; None: they read the environment."""
    _running = False
    _lost: list[float] | None = None
    """If the environment of a copy has lost the episode, the times of the original's clocks."""
    _next: ChangedConstants | None = None
    """The change that the next reset applies."""
    _warned_of_unseen_end = False
    constant_changes = 0
    """The number of changes of constants."""

    def _set_up(
        self,
        env: Any,
        specs: SpecsLike,
        signals: Mapping[str, SignalLike] | None,
        reading: EvaluationOptions,
        options: MonitorOptions,
        find_period: ReadPeriod = read_period,
        *,
        sources: Mapping[str, Source] = SOURCES,
        agents: Collection[str] = (),
    ) -> dict[str, Specification]:
        """Check the options, find the period, and return the parsed specifications."""
        _refuse_monitored(env)
        check_choice("on_satisfaction", options["on_satisfaction"], get_args(OnSatisfaction))
        check_choice("cost", options["cost"], (None, *get_args(Cost)))
        length: object = options["buffer_length"]
        if not isinstance(length, int) or length < 0:
            raise InputError(f"expected buffer_length= as an integer, 0 or more, got {length!r}")
        self._on_satisfaction = options["on_satisfaction"]
        self._at_termination: AtTermination = reading.at_termination or "complete"
        self._at_truncation = reading.at_truncation
        self._warns_of_open_end = reading.at_termination is None
        # A specification that the end satisfied by default, and whether the end cut a window.
        self._assumed: tuple[str, bool] | None = None
        self._seen_success = self._warned_of_success = False
        self._details, self._cost = options["details"], options["cost"]
        loaded = load_specs(specs, own_requirements(env), options["constants"])
        self._on_violation = violation_words(options["on_violation"], loaded)
        self._constants = Constants(loaded)
        variables = [name for spec in loaded.values() for name in spec.variables]
        explicit, own = checked_mapping(signals), own_signals(env)
        read = {name: (explicit if name in explicit else own).get(name) for name in variables}
        cost = () if self._cost is None else (Argument("cost", self._cost),)
        self._of_monitors, refuse_nan = with_unknown_start(reading, read, *cost)
        self._signals = parse_signals(
            explicit, variables, sources, agents=agents, own=own, refuse_nan=refuse_nan
        )
        self._timed = any(spec.timed for spec in loaded.values())
        self._read_period, self._has_read_period = find_period, reading.period is None
        period = reading.period
        if period is None:
            period = find_period(env)
            if period is not None and self._timed and not reading.substeps:
                warn_of_unverified_period(env)
        if period is None and self._timed:
            period = ask_another(env)
            check_period(loaded, period, env.unwrapped, why_no_period(env))
        observed = () if reading.substeps else self._signals  # substeps read no observation
        rescaler = rescaling(env, observed, below=reading.below, rescaled=reading.rescaled)
        self._beneath = None if rescaler is None else tapped(rescaler)
        self._judging = Judging(loaded, signals, reading.having(period=period).complete("runs"))
        self._of_monitors = self._of_monitors.having(period=period).complete("runs")
        return loaded

    @property
    def constants(self) -> dict[str, float]:
        """The values of the constants of the specifications, by name, from the next reset on.

        Set it to change some of them: ``env.constants = {"limit": 0.3}``. Others keep their value.
        After an error nothing has changed.

        Raises:
            InputError: If no specification uses a constant, or if a constant in a bound would
                change the number of values that ``observe="obligations"`` appends.
            SpecificationError: If a value is not a number, or a bound is not a multiple of the
                period.
        """
        return (self._constants if self._next is None else self._next.constants).values

    @constants.setter
    def constants(self, constants: Mapping[str, ConstantValue]) -> None:
        self._next = self._change(constants)

    def _change(self, constants: Mapping[str, ConstantValue]) -> ChangedConstants | None:
        """Return the change to these values, or None. Raises as `constants` does."""
        before = self._constants if self._next is None else self._next.constants
        after = before.at(constants)
        if after is before:
            return self._next
        env = self.env.unwrapped
        check_period(after.specs, self._judging.reading.period, env, why_no_period(self.env))
        monitor_set = self._make_monitor_set(after.specs)
        if self._monitor_set.tracks_obligations:
            shown, now = self._monitor_set.track_obligations(), monitor_set.track_obligations()
            if _sizes(shown) != _sizes(now):
                raise InputError(
                    f"expected constants that leave the observation space as it is, got "
                    f"{dict(constants)!r}, which change the temporal operators that ",
                    Argument("observe", "obligations"),
                    f" shows: from {_listed(shown)} to {_listed(now)}; make another environment",
                )
        return ChangedConstants(after, monitor_set)

    def _make_monitor_set(self, specs: Mapping[str, Specification]) -> Any:
        """Return monitors of the specifications."""
        raise NotImplementedError

    def _split_options(
        self, options: dict[str, Any] | None
    ) -> tuple[dict[str, Any] | None, ChangedConstants | None]:
        """Return the options of a reset without the constants, and the change of constants."""
        if options is None or "constants" not in options:
            self._refuse_constants_around()
            return options, self._next
        remainder = {name: value for name, value in options.items() if name != "constants"}
        return remainder or None, self._change(options["constants"])

    def _refuse_constants_around(self) -> None:
        """Refuse other values of constants in an attribute of an outer wrapper.

        ``set_attr`` of Stable-Baselines3 sets it, which changes no specification.
        """
        constants = self._constants if self._next is None else self._next.constants
        if not constants.are_some:
            return
        for wrapper in wrappers_around(self):
            values = vars(wrapper).get("constants")
            if isinstance(values, Mapping) and _differs(values, constants):
                raise InputError(
                    f"{type(wrapper).__name__} around {type(self).__name__} has an attribute "
                    f"constants={values!r}, which changes no specification. Delete it and call "
                    'env.set_wrapper_attr("constants", {...}); with Stable-Baselines3 write '
                    'vec_env.env_method("set_wrapper_attr", "constants", {...}) in place of '
                    'vec_env.set_attr("constants", {...})'
                )

    def _warn_of_unseen_end(self, *, unended: bool) -> None:
        """Warn once that an outer wrapper may have ended an episode that was running at a reset."""
        if not unended or self._warned_of_unseen_end:
            return
        around = next((item for item in wrappers_around(self) if _can_end(item)), None)
        if around is not None:
            self._warned_of_unseen_end = True
            warning = UnseenEndWarning(type(self).__name__, type(around).__name__)
            warnings.warn(warning, stacklevel=caller_level())

    def _apply(self, change: ChangedConstants | None) -> None:
        """Apply a change of constants, between two episodes."""
        if change is None:
            return
        self._next = None
        self._constants, self._monitor_set = change
        self._judging = self._judging._replace(specs=self._constants.specs)
        self.constant_changes += 1
        self._follow_monitors(self._monitor_set)
        self._bind_signals()

    def _step_time(self, env: Any, period: float) -> StepTime:
        return StepTime(
            env,
            period,
            self._read_period,
            was_read=self._has_read_period,
            timed=self._timed,
            substeps=self._judging.reading.substeps,
            stated=self._read_period(env),
        )

    def _warn_of_ends(self) -> None:
        """Warn, once each, of an end that satisfied an open verdict and of an own ``is_success``.

        A step does this last, because a warning may be an error: the episode is recorded by then.
        """
        assumed, self._assumed = self._assumed, None
        if assumed is not None:
            self._warns_of_open_end = False
            warn_of_open_end(assumed[0], window=assumed[1])
        if self._seen_success and not self._warned_of_success:
            self._warned_of_success = True
            warnings.warn(
                f"{self.env.unwrapped} reports an is_success of its own, which is kept; "
                'info["stl_success"] is true if the specifications are satisfied',
                stacklevel=caller_level(),
            )

    @property
    def judging(self) -> Judging:
        """Specifications, signals and evaluation options from the next reset on, all explicit."""
        if self._next is None:
            return self._judging
        return self._judging._replace(specs=self._next.constants.specs)

    @property
    def unknown_allowed(self) -> bool:
        """Whether its monitors read nan as an unknown value."""
        return self._of_monitors.nan == "unknown"

    @contextmanager
    def tapped(self, tap: Any) -> Iterator[None]:
        """Step ``tap``, which steps the environment, in this context, and end no episode.

        Open ends cause no warnings in the context.
        """
        env = self.env
        before = self._on_violation, self._on_satisfaction, self._warns_of_open_end
        self._set_env(tap)
        self._on_violation = dict.fromkeys(self._on_violation, "report")
        self._on_satisfaction, self._warns_of_open_end = "report", False
        try:
            yield
        finally:
            self._set_env(env)
            self._on_violation, self._on_satisfaction, self._warns_of_open_end = before

    def _set_env(self, env: Any) -> None:
        self.env = env

    def values(self) -> MonitorValues[Any]:
        """Return robustness and bounds of each specification now: numbers, or arrays of many."""
        return self._monitor_set.values()

    def track_obligations(self) -> list[list[Obligation]]:
        """Track pending obligations from the next reset on; return the operators of each spec."""
        operators = self._monitor_set.track_obligations()
        if self._next is not None:
            self._next.monitor_set.track_obligations()
        self._bind_signals()  # the functions that update monitors do not track them
        return operators

    def __repr__(self) -> str:
        """The environment in its wrappers, with the time between two samples."""
        monitor_set = getattr(self, "_monitor_set", None)  # an error of the constructor prints it
        period = None if monitor_set is None else monitor_set.period
        text = "no period" if period is None else f"period {float(period):g} s"
        return f"<{type(self).__name__}{self.env}, {text}>"

    __str__ = __repr__

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the state of every specification, as in ``info["stl"]``, and the ``period``.

        The period is in seconds, and absent if it is unknown. A vector environment has arrays.
        """
        period = self._monitor_set.period
        extra = {} if period is None else {"period": float(period)}
        return {name: {**state, **extra} for name, state in self._monitor_set.describe().items()}

    @property
    def cost(self) -> Cost | None:
        """The meaning of ``info["cost"]``; ``None`` if it is absent."""
        return self._cost

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; ``None`` if neither an argument nor the environment sets it."""
        return self._monitor_set.period

    def __getstate__(self) -> dict[str, Any]:
        state = {
            name: value for name, value in self.__dict__.items() if name not in self._UNPICKLED
        }
        return {**state, "_clock_times": _clock_times(self.env)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        times = self.__dict__.pop("_clock_times")
        if self._running and (
            any(map(_is_rebuilt, _levels(self.env))) or _clock_times(self.env) != times
        ):
            self._running, self._lost = False, times
        self._bind_signals()

    def _resumes(self) -> bool:
        """Whether a step may continue the episode of a copy; StateError if its environment lost it.

        `gymnasium.utils.EzPickle` copies an environment by calling its constructor, because the
        state of MuJoCo, Box2D or Atari is outside Python. The monitor is copied with its samples.
        """
        if self._lost is None:
            return False
        rebuilt = [level for level in _levels(self.env) if _is_rebuilt(level)]
        have_clocks = all(clock_of(level) is not None for level in rebuilt)
        # A time of 0 does not show whether the state was restored.
        if not (have_clocks and all(self._lost) and _clock_times(self.env) == self._lost):
            raise StateError(
                f"expected reset() before step(): this is a copy in mid-episode, and copying "
                f"{self.env.unwrapped} builds it again from the arguments of its constructor, so "
                "the simulation has lost the episode that the monitor has seen; call reset(), or "
                "restore the state of the simulation with its time"
            )
        self._running, self._lost = True, None
        return True

    def _bind_signals(self) -> None:
        """Make the functions that read this environment."""
        raise NotImplementedError


def _clock_times(env: Any) -> list[float]:
    clocks = [clock_of(level) for level in _levels(env)]
    return [clock.read() for clock in clocks if clock is not None]


def _is_rebuilt(level: Any) -> bool:
    """Whether copying calls the constructor."""
    return getattr(type(level), "__setstate__", None) is EzPickle.__setstate__


def _levels(env: Any, seen: set[int] | None = None) -> Iterator[Any]:
    """Yield an environment, its wrappers, and the environments that they hold."""
    seen = set() if seen is None else seen
    if id(env) in seen:
        return
    seen.add(id(env))
    yield env
    inside = [
        value
        for name, value in getattr(env, "__dict__", {}).items()
        # Environments of PettingZoo have no common base.
        if isinstance(value, gym.Env | VectorEnv) or name in {"env", "aec_env"}
    ]
    if isinstance(env, SyncVectorEnv):
        inside += env.envs
    for inner in inside:
        yield from _levels(inner, seen)


def _can_end(wrapper: object) -> bool:
    """Whether a wrapper may end episodes: not if its step belongs to this package or counts."""
    step = getattr(type(wrapper), "step", None)
    owner = getattr(step, "__module__", "")
    harmless = owner == "gymnasium.core" or owner.partition(".")[0] == "rtamt_gym"
    return not (harmless or counts_episodes(wrapper))


def _differs(values: Mapping[Any, Any], constants: Constants) -> bool:
    """Whether a mapping has another value of a constant, or a name similar to a constant."""
    names = constants.values
    if any(nearest(name, names) for name in values if name not in names):
        return True
    try:
        known = {name: values[name] for name in names if name in values}
        return constants.at(known) is not constants
    except RtamtError:
        return True


def _sizes(operators: list[list[Obligation]]) -> list[list[int]]:
    """Return the number of operands of each operator, which sets the length of observations."""
    return [[len(item.operands) for item in spec] for spec in operators]


def _listed(operators: list[list[Obligation]]) -> str:
    return ", ".join(str(item.formula) for spec in operators for item in spec) or "none"


def _refuse_monitored(env: Any) -> None:
    where = ""
    while env is not None:
        if isinstance(env, Monitoring):
            refuse_monitored(type(env).__name__, where)
        if isinstance(env, gym.Wrapper | VectorWrapper) or hasattr(env, "possible_agents"):
            env = getattr(env, "env", None)
            continue
        inside = env.envs[0] if isinstance(env, SyncVectorEnv) else None
        env = env.one if isinstance(env, PufferVectorEnv) else inside
        where = " around each of its environments"


def violation_words(words: object, specs: Collection[str]) -> dict[str, OnViolation]:
    """Return the word for each requirement, or raise InputError."""
    choices = get_args(OnViolation)
    if not isinstance(words, Mapping):
        check_choice("on_violation", words, choices)
        return dict.fromkeys(specs, cast("OnViolation", words))
    check_known("on_violation", words, specs)
    for name in specs:
        if name not in words:
            raise InputError(
                f"on_violation= has no word for {name!r}; add "
                f'{name!r}: "terminate", "truncate" or "report"'
            )
        check_choice(f"on_violation[{name!r}]", words[name], choices)
    return {name: words[name] for name in specs}


def refuse_monitored(monitor: str, where: str = "") -> NoReturn:
    """Raise an `InputError` about an environment that already has this monitor."""
    raise InputError(
        f"expected an environment without a monitor, got one with {monitor}{where}; give one "
        'monitor all specifications, such as specs={"upright": "always(abs(angle) < 0.1)", '
        '"near": "always(abs(x) < 1)"}'
    )


def check_pictures(env: Any, name: str, *, lists: bool = True) -> None:
    """Raise an `InputError`, for the wrapper ``name``, if an environment renders no pictures."""
    if env.render_mode != "rgb_array" and not (lists and env.render_mode == "rgb_array_list"):
        raise InputError(
            f"{name} needs pictures, got render_mode={env.render_mode!r} of {env}; make it with "
            'gym.make(..., render_mode="rgb_array")'
        )
