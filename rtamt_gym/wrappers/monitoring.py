"""What the monitors of environments share: their options, their signals, their episodes."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from typing import Any, ClassVar, Literal, NamedTuple, NoReturn, TypedDict, cast, get_args

import gymnasium as gym
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv, VectorWrapper

from rtamt import InputError, InputTypeError, RtamtError, Specification, StateError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.arguments import check_choice, check_known
from rtamt_gym.checks.callers import caller_level, wrappers_around
from rtamt_gym.judging.constants import Constants, ConstantValue
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.ends import UnseenEndWarning, warn_of_open_end
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.specs import SpecsLike, check_period, load_specs, own_requirements
from rtamt_gym.judging.unknown import with_unknown_start
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.judging.vector_panel import VectorPanel
from rtamt_gym.options.evaluation import AtTermination, EvaluationKeywords, Reading
from rtamt_gym.signals.periods import (
    ask_another,
    warn_of_unverified_period,
    why_no_period,
)
from rtamt_gym.signals.signals import (
    SignalLike,
    Source,
    own_signals,
    parse_signals,
)
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.step_time import ReadPeriod, StepTime
from rtamt_gym.signals.taps import rescaling, tapped
from rtamt_gym.wrappers.books import counts_episodes
from rtamt_gym.wrappers.copies import clock_times, is_rebuilt, is_restored
from rtamt_gym.wrappers.observing import Observing
from rtamt_gym.wrappers.vector_forms import PufferVectorEnv, is_pool

__all__ = [
    "MonitorOptions",
    "Monitoring",
    "OnSatisfaction",
    "OnViolation",
    "Violations",
    "check_can_end",
    "refuse_monitored",
    "single_env",
]

OnViolation = Literal["terminate", "truncate", "report"]
"""What happens to an episode at a certain violation, the strongest first."""

Violations = OnViolation | Mapping[str, OnViolation]
"""The option ``on_violation``: one word for all requirements, or a word for each, by name."""

OnSatisfaction = Literal["report", "terminate", "truncate"]
"""What happens to an episode once every specification is certainly satisfied."""

_Choice = Literal["on_satisfaction", "cost"]
_CHOICES: dict[_Choice, tuple[object, ...]] = {
    "on_satisfaction": get_args(OnSatisfaction),
    "cost": (None, *get_args(Cost)),
}


_ENDS: tuple[Literal["on_violation"], Literal["on_satisfaction"]]
_ENDS = "on_violation", "on_satisfaction"


class OwnOptions(TypedDict):
    """The keyword arguments of all monitors that say what they do, and not how they judge."""

    on_violation: Violations
    on_satisfaction: OnSatisfaction
    details: bool
    cost: Cost | None
    buffer_length: int
    constants: Mapping[str, ConstantValue] | None


class MonitorOptions(EvaluationKeywords, total=False):
    """The keyword arguments of `StlMonitor` and of `VectorStlMonitor`."""

    on_violation: Violations
    on_satisfaction: OnSatisfaction
    details: bool
    cost: Cost | None
    buffer_length: int
    constants: Mapping[str, ConstantValue] | None


class ChangedConstants(NamedTuple):
    """Other values of constants, and the monitors with them."""

    constants: Constants
    panel: Any


class Monitoring(Observing):
    """The base of the wrappers."""

    _UNPICKLED: ClassVar[frozenset[str]]
    """Attributes that pickle cannot carry; `_bind_signals` makes them anew."""

    env: Any
    _panel: Panel | VectorPanel
    _on_violation: dict[str, OnViolation]
    """What a violation of each requirement does."""
    _beneath: Any
    """What has shown the samples that are read, if not the environment in the wrapper."""
    _running = False  # whether an episode runs
    _lost: list[float] | None = None
    """In a copy whose environment has lost the episode, the times of the original's clocks."""
    _next: ChangedConstants | None = None
    """What the next reset changes."""
    _warned_of_unseen_end = False
    constant_changes = 0
    """How often constants have changed."""

    def _set_up(
        self,
        env: Any,  # noqa: ANN401 - an environment, or many
        specs: SpecsLike,
        signals: Mapping[str, SignalLike] | None,
        reading: Reading,
        options: OwnOptions,
        read_period: ReadPeriod,
        sources: Mapping[str, Source] = SOURCES,
        agents: Collection[str] = (),
    ) -> Judging:
        """Checks the options, parses specifications and signals, and finds the period.

        Returns:
            The specifications, the signals, and how the monitors are to judge the samples.
        """
        _refuse_monitored(env)
        for name, choices in _CHOICES.items():
            check_choice(name, options[name], choices)
        length: object = options["buffer_length"]
        if not isinstance(length, int) or length < 0:
            raise InputError(f"expected buffer_length= as an integer, 0 or more, got {length!r}")
        self._on_satisfaction = options["on_satisfaction"]
        self._at_termination: AtTermination = reading.at_termination or "complete"
        self._at_truncation = reading.at_truncation
        self._unasked = reading.at_termination is None  # and nobody was told yet
        # What an end satisfied unasked, and whether inside a bounded window, until that is told.
        self._assumed: tuple[str, bool] | None = None
        self._seen_success = self._told_success = False
        self._details = options["details"]
        self._cost = options["cost"]
        loaded = load_specs(specs, own_requirements(env), options["constants"])
        self._on_violation = _violation_words(options["on_violation"], loaded)
        self._constants = Constants(loaded)
        variables = [name for spec in loaded.values() for name in spec.variables]
        given, own = ({} if signals is None else signals), own_signals(env)
        read = {name: (given if name in given else own).get(name) for name in variables}
        cost = self._cost
        needy = () if cost is None else (Argument("cost", cost),)
        of_monitors, refuse_nan = with_unknown_start(reading, read, *needy)
        self._signals = parse_signals(
            given, variables, sources, agents=agents, own=own, refuse_nan=refuse_nan
        )
        timed = any(spec.timed for spec in loaded.values())
        self._read_period, self._timed = read_period, timed
        period = reading.period
        self._has_read_period = period is None
        if period is None:
            period = read_period(env)
            if period is not None and timed and not reading.substeps:
                warn_of_unverified_period(env)
        if period is None and timed:
            period = ask_another(env)
            check_period(loaded, period, env.unwrapped, why_no_period(env))
        seen = () if reading.substeps else self._signals  # where no observation is read
        rescaler = rescaling(env, seen, below=reading.below, rescaled=reading.rescaled)
        self._beneath = None if rescaler is None else tapped(rescaler)
        self._judging = Judging(loaded, signals, reading.having(period=period).whole("runs"))
        self._of_monitors = of_monitors.having(period=period).whole("runs")
        return self._judging._replace(reading=self._of_monitors)

    @property
    def constants(self) -> dict[str, float]:
        """The values of the constants of the specifications, by name, from the next reset on.

        Set it to change some of them: ``env.constants = {"limit": 0.3}``. Others keep their value.
        An error leaves all as it was.

        Raises:
            InputError: If no specification uses one of the constants; or if a constant in a bound
                would change how many numbers ``observe="obligations"`` appends.
            SpecificationError: If a value is no number, or if a bound is none, or no multiple of
                the period.
        """
        return (self._constants if self._next is None else self._next.constants).values

    @constants.setter
    def constants(self, constants: Mapping[str, ConstantValue]) -> None:
        self._next = self._change(constants)

    def _change(self, constants: Mapping[str, ConstantValue]) -> ChangedConstants | None:
        """What values of constants change; None if nothing. Raises as `constants` does."""
        before = self._constants if self._next is None else self._next.constants
        after = before.at(constants)
        if after is before:
            return self._next
        env = self.env.unwrapped
        check_period(after.specs, self._judging.reading.period, env, why_no_period(self.env))
        panel = self._make_panel(after.specs)
        if self._panel.tracks_obligations:
            shown, now = self._panel.track_obligations(), panel.track_obligations()
            if _sizes(shown) != _sizes(now):
                raise InputError(
                    f"expected constants that leave the observation space as it is, got "
                    f"{dict(constants)!r}, which change the temporal operators that ",
                    Argument("observe", "obligations"),
                    f" shows: from {_listed(shown)} to {_listed(now)}; make another environment",
                )
        return ChangedConstants(after, panel)

    def _make_panel(self, specs: Mapping[str, Specification]) -> Any:  # noqa: ANN401 - of one, or many
        """Makes monitors of the specifications."""
        raise NotImplementedError

    def _taken(
        self, options: dict[str, Any] | None
    ) -> tuple[dict[str, Any] | None, ChangedConstants | None]:
        """The options of a reset without the constants, and what these change."""
        if options is None or "constants" not in options:
            self._refuse_constants_around()
            return options, self._next
        rest = {name: value for name, value in options.items() if name != "constants"}
        return rest or None, self._change(options["constants"])

    def _refuse_constants_around(self) -> None:
        """Refuse other values of constants in an attribute of a wrapper around this one.

        ``wrapper.constants = ...`` sets an attribute of the wrapper, as ``set_attr`` of
        Stable-Baselines3 does with the outermost one, and changes no specification.
        """
        if not self.constants:
            return
        held = self._constants if self._next is None else self._next.constants
        for wrapper in wrappers_around(self):
            given = vars(wrapper).get("constants")
            if isinstance(given, Mapping) and _differs(given, held):
                raise InputError(
                    f"{type(wrapper).__name__} around {type(self).__name__} has an attribute "
                    f"constants={given!r}, which changes no specification. Delete it and call "
                    'env.set_wrapper_attr("constants", {...}); with Stable-Baselines3 write '
                    'vec_env.env_method("set_wrapper_attr", "constants", {...}) in place of '
                    'vec_env.set_attr("constants", {...})'
                )

    def _warn_of_unseen_end(self, *, unended: bool) -> None:
        """Warn once that a wrapper around this one may have ended an episode.

        Without a wrapper around that can end episodes, the program itself resets early.

        Args:
            unended: Whether an episode was running when the reset was called.
        """
        if not unended or self._warned_of_unseen_end:
            return
        around = next((each for each in wrappers_around(self) if _can_end(each)), None)
        if around is not None:
            self._warned_of_unseen_end = True
            told = UnseenEndWarning(type(self).__name__, type(around).__name__)
            warnings.warn(told, stacklevel=caller_level())

    def _adopt(self, change: ChangedConstants | None) -> None:
        """Goes over to other values of constants, between two episodes."""
        if change is None:
            return
        self._next = None
        self._constants, self._panel = change
        specs = self._constants.specs
        self._judging = self._judging._replace(specs=specs)
        self.constant_changes += 1
        self._follow_monitors(self._panel.monitors, self._panel.track_obligations)
        self._bind_signals()

    def _step_time(self, env: Any, period: float) -> StepTime:  # noqa: ANN401 - one, or many
        """Make what compares the period with an environment."""
        return StepTime(
            env,
            period,
            self._read_period,
            was_read=self._has_read_period,
            timed=self._timed,
            substeps=self._judging.reading.substeps,
            stated=self._read_period(env),
        )

    def _tell(self) -> None:
        """Warns, once each, of an end that satisfied what was open and of an own ``is_success``.

        The last act of a step, for a warning may be an error: the episode is recorded by then.
        """
        told, self._assumed = self._assumed, None
        if told is not None:
            self._unasked = False
            warn_of_open_end(told[0], window=told[1])
        if self._seen_success and not self._told_success:
            self._told_success = True
            warnings.warn(
                f"{self.env.unwrapped} reports an is_success of its own, which is kept; "
                'info["stl_success"] says whether the specifications are satisfied',
                stacklevel=caller_level(),
            )

    @property
    def judging(self) -> Judging:
        """What it monitors from the next reset on, and how; every option counts as given."""
        if self._next is None:
            return self._judging
        return self._judging._replace(specs=self._next.constants.specs)

    @property
    def unknown_allowed(self) -> bool:
        """Whether its monitors take a nan for unknown."""
        return self._of_monitors.nan == "unknown"

    @contextmanager
    def tapped(self, tap: Any) -> Iterator[None]:  # noqa: ANN401 - an environment, or many
        """A context in which it steps ``tap``, which steps its environment, and ends no episode.

        Nor does it tell there what an open end was taken for.
        """
        env, before = self.env, (self._on_violation, self._on_satisfaction, self._unasked)
        self._tap(tap)
        self._on_violation = dict.fromkeys(self._on_violation, "report")
        self._on_satisfaction, self._unasked = "report", False
        try:
            yield
        finally:
            self._tap(env)
            self._on_violation, self._on_satisfaction, self._unasked = before

    def _tap(self, env: Any) -> None:  # noqa: ANN401 - an environment, or many
        self.env = env

    def values(self) -> MonitorValues[Any]:
        """Reads robustness and bounds of each specification now: of many environments, arrays."""
        return self._panel.values()

    def track_obligations(self) -> list[list[Obligation]]:
        """Follows what temporal operators owe, from the next reset on; `values` has it then.

        Returns:
            The temporal operators below the top of each specification.
        """
        found = self._panel.track_obligations()
        if self._next is not None:
            self._next.panel.track_obligations()
        self._bind_signals()  # what feeds samples was made without
        return found

    def __repr__(self) -> str:
        """The environment in its wrappers, with the time between two samples."""
        panel = getattr(self, "_panel", None)  # an error in the construction may write it
        period = None if panel is None else panel.period
        told = "no period" if period is None else f"period {float(period):g} s"
        return f"<{type(self).__name__}{self.env}, {told}>"

    __str__ = __repr__

    def describe(self) -> dict[str, dict[str, Any]]:
        """The state of every specification, as ``info["stl"]`` has it, and ``period`` in seconds.

        Of many environments there are arrays. Without a period there is none.
        """
        period = self._panel.period
        told = {} if period is None else {"period": float(period)}
        return {name: {**state, **told} for name, state in self._panel.describe().items()}

    @property
    def cost(self) -> Cost | None:
        """What ``info["cost"]`` measures; ``None`` if it is not there."""
        return self._cost

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; ``None`` if neither the argument nor the environment says."""
        return self._panel.period

    def __getstate__(self) -> dict[str, Any]:
        state = {
            name: value for name, value in self.__dict__.items() if name not in self._UNPICKLED
        }
        return {**state, "_clock_times": clock_times(self.env)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        times = self.__dict__.pop("_clock_times")
        if self._running and is_rebuilt(self.env, times):
            self._running, self._lost = False, times
        self._bind_signals()

    def _resumes(self) -> bool:
        """Whether a step may go on with the episode of a copy.

        Raises:
            StateError: If the environment of the copy has lost the episode.
        """
        if self._lost is None:
            return False
        if not is_restored(self.env, self._lost):
            raise StateError(
                f"expected reset() before step(): this is a copy in mid-episode, and copying "
                f"{self.env.unwrapped} builds it again from the arguments of its constructor, so "
                "the simulation has lost the episode that the monitor has seen; call reset(), or "
                "restore the state of the simulation with its time"
            )
        self._running, self._lost = True, None
        return True

    def _bind_signals(self) -> None:
        """Makes the functions that read this environment."""
        raise NotImplementedError


def _can_end(wrapper: object) -> bool:
    """Whether a wrapper may end episodes: not if its step is this package's or only counts."""
    step = getattr(type(wrapper), "step", None)
    owner = getattr(step, "__module__", "")
    harmless = owner == "gymnasium.core" or owner.partition(".")[0] == "rtamt_gym"
    return not (harmless or counts_episodes(wrapper))


def _differs(given: Mapping[Any, Any], held: Constants) -> bool:
    """Whether a mapping has another value of a constant, or a name that is almost a constant's."""
    names = held.values
    if any(nearest(name, names) for name in given if name not in names):
        return True
    try:
        return held.at({name: given[name] for name in names if name in given}) is not held
    except RtamtError:
        return True


def _sizes(shown: list[list[Obligation]]) -> list[list[int]]:
    """How many numbers each operator of each specification appends to observations, but one."""
    return [[len(each.operands) for each in found] for found in shown]


def _listed(shown: list[list[Obligation]]) -> str:
    return ", ".join(str(each.formula) for found in shown for each in found) or "none"


def _refuse_monitored(env: Any) -> None:  # noqa: ANN401 - an environment, or many
    """Refuses an environment that has a monitor already."""
    within, where = env, ""
    while not isinstance(within, Monitoring):
        if isinstance(within, gym.Wrapper | VectorWrapper):
            within = within.env
        elif isinstance(within, SyncVectorEnv):
            within, where = within.envs[0], " around each of its environments"
        elif isinstance(within, PufferVectorEnv):
            within, where = within.one, " around each of its environments"
        else:
            return
    refuse_monitored(type(within).__name__, where)


def single_env(env: Any) -> gym.Env[Any, Any]:  # noqa: ANN401 - whatever is given
    """The environment, if a scalar wrapper can be around it."""
    many = isinstance(env, VectorEnv) or is_pool(env)
    if isinstance(env, gym.Env) and not many:
        return env
    way_out = "make it with gym.make"
    if many:
        way_out = "VectorStlMonitor and VectorStlReward are for many environments at once"
    elif hasattr(env, "possible_agents"):
        way_out = "ParallelStlMonitor is for several agents"
    raise InputTypeError(f"expected an environment of Gymnasium, got {env!r}; {way_out}")


def check_can_end(options: OwnOptions, autoreset: AutoresetMode, env: object) -> None:
    """Refuses to end episodes of a vector environment that nobody could reset then."""
    if autoreset is AutoresetMode.DISABLED:
        return
    chosen = {name: options[name] for name in _ENDS}
    for name, choice in chosen.items():
        words = choice.values() if isinstance(choice, Mapping) else [choice]
        if any(word != "report" for word in words):
            raise InputError(
                f"{name}={choice!r} needs an environment that resets when it is told, "
                f"AutoresetMode.DISABLED, got {autoreset} of {env}; wrap each environment, "
                "gym.make_vec(..., vectorization_mode='sync', wrappers=[...]) with StlMonitor, or "
                f"take {name}='report'"
            )


def _violation_words(given: object, specs: Collection[str]) -> dict[str, OnViolation]:
    """The word for each requirement.

    Raises:
        InputError: If a word is none of the three, or a mapping names no requirement or lacks one.
    """
    choices = get_args(OnViolation)
    if not isinstance(given, Mapping):
        check_choice("on_violation", given, choices)
        return dict.fromkeys(specs, cast("OnViolation", given))
    check_known("on_violation", given, specs)
    for name in specs:
        if name not in given:
            raise InputError(
                f"on_violation= has no word for {name!r}, so it could end the episode or not; add "
                f'{name!r}: "terminate", "truncate" or "report"'
            )
        check_choice(f"on_violation[{name!r}]", given[name], choices)
    return {name: given[name] for name in specs}


def refuse_monitored(monitor: str, where: str = "") -> NoReturn:
    """Refuses an environment that has a monitor of this name already."""
    raise InputError(
        f"expected an environment without a monitor, got one with {monitor}{where}; give one "
        'monitor all specifications, such as specs={"upright": "always(abs(angle) < 0.1)", '
        '"near": "always(abs(x) < 1)"}'
    )
