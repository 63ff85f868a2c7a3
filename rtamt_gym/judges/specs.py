"""The specifications of an environment wrapper: loaded, named, timed, and turned into monitors."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
from gymnasium.logger import warn
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import MaxAndSkipObservation

import rtamt
from rtamt import InputError, InputTypeError, RtamtError, SpecificationError

__all__ = [
    "InstantMonitor",
    "Nan",
    "SpecLike",
    "SpecsLike",
    "View",
    "autoreset_mode",
    "check_looks_ahead",
    "load_specs",
    "machine_state",
    "make_monitor",
    "read_period",
    "recordable",
    "resolve_period",
]

SpecLike = str | os.PathLike[str] | rtamt.Formula | rtamt.Specification
"""Text, the path of a ``.stl`` file, a formula built in Python, or a parsed specification."""

SpecsLike = SpecLike | Mapping[str, SpecLike]
"""One specification, or several with their names."""

View = Literal["episode", "step"]
"""Whether a formula speaks of the episode from sample 0 on, or of every instant."""

Nan = Literal["raise", "hold"]
"""Whether a signal that is nan is refused, or keeps its last value."""


Env = gym.Env[Any, Any] | VectorEnv[Any, Any, Any]
"""An environment, or a vector of them."""


class InstantMonitor:
    """``view="step"``: robustness instant by instant, and a judge of ``always(formula)``.

    Attributes:
        robustness: That of the newest instant whose horizon has passed; before the first, that of
            the samples so far.
        judge: Bounds and verdict of ``always(formula)``, fed with the same samples.
    """

    def __init__(
        self, spec: rtamt.Specification, period: float | str | None, nan: Nan = "raise"
    ) -> None:
        self._instant = rtamt.Monitor(spec, period=period, nan=nan)
        self._sofar = rtamt.EpisodeMonitor(spec, period=period, nan=nan)
        self.judge = rtamt.EpisodeMonitor(spec.always(), period=period, nan=nan)
        self.robustness = math.nan

    def update(self, *values: float) -> float:
        """Feeds one sample; returns the robustness."""
        robustness = self._instant.update(*values)
        self.judge.update(*values)
        if math.isnan(robustness):
            robustness = self._sofar.update(*values)
        self.robustness = robustness
        return robustness

    def reset(self) -> None:
        """Forgets every sample."""
        self._instant.reset()
        self._sofar.reset()
        self.judge.reset()

    def state(self) -> tuple[Any, ...]:
        """What `restore` takes."""
        return [machine_state(monitor) for monitor in self._parts()], self.robustness

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes back to a `state`."""
        states, self.robustness = state
        for monitor, held in zip(self._parts(), states, strict=True):
            monitor.__setstate__(held)

    def _parts(self) -> list[rtamt.Monitor | rtamt.EpisodeMonitor]:
        return [self._instant, self._sofar, self.judge]


def machine_state(monitor: rtamt.Monitor | rtamt.EpisodeMonitor) -> Any:  # noqa: ANN401 - opaque
    """What ``__setstate__`` of a monitor of the same specification takes."""
    return monitor.__reduce__()[2]


def load_specs(specs: SpecsLike) -> dict[str, rtamt.Specification]:
    """The specifications by name; one alone has the name that its text gives it, else ``"spec"``.

    Raises:
        SpecificationError: If one has no meaning; a note names it where there are several.
        InputError: If there is none.
        InputTypeError: If one is neither text, nor a path, nor a ``Specification``.
    """
    if not isinstance(specs, Mapping):
        alone = _load(specs)
        return {_name(alone): alone}
    if not specs:
        raise InputError("expected at least one specification, got an empty mapping")
    loaded = {}
    for name, spec in specs.items():
        try:
            loaded[name] = _load(spec)
        except RtamtError as error:
            error.add_note(f"in specification {name!r}")
            raise
    return loaded


def recordable(specs: SpecsLike) -> str | dict[str, str]:
    """The specifications as ``EnvSpec.to_json`` can write them."""
    if isinstance(specs, Mapping):
        return {name: _text(spec) for name, spec in specs.items()}
    return _text(specs)


def read_period(env: Env) -> float | None:
    """Seconds between two steps of an environment, or None if it does not say.

    ``unwrapped.dt`` (MuJoCo, Pendulum, Acrobot), ``unwrapped.tau`` (CartPole) or
    ``unwrapped.config["policy_frequency"]`` (highway-env). The frame rate of the pictures,
    ``metadata["render_fps"]``, is not the rate of the samples: Pendulum says 30 and makes 20.

    A `SyncVectorEnv` says what its environments say; an `AsyncVectorEnv` says nothing: asked for
    what its environments do not have, it would shut them down. Nor is there an answer where a
    `MaxAndSkipObservation` makes several steps of one.

    Raises:
        InputError: If the environments of a `SyncVectorEnv` say different things.
    """
    simulation = env.unwrapped
    if isinstance(simulation, AsyncVectorEnv) or _skips(env):
        return None
    if isinstance(simulation, SyncVectorEnv):
        periods = {read_period(each) for each in simulation.envs}
        if len(periods) > 1:
            raise InputError(
                f"expected environments of one period, got {', '.join(sorted(map(str, periods)))} "
                f"s in {simulation}; give period=, or period=1 to count steps"
            )
        return periods.pop()
    for name in ("dt", "tau"):
        period = _positive(getattr(simulation, name, None))
        if period is not None:
            return period
    config = getattr(simulation, "config", None)
    if isinstance(config, Mapping):
        frequency = _positive(config.get("policy_frequency"))
        if frequency is not None:
            return 1.0 / frequency
    return None


def autoreset_mode(env: VectorEnv[Any, Any, Any]) -> AutoresetMode:
    """When a vector environment resets those whose episodes have ended.

    Raises:
        InputError: If it says something that is no mode.
    """
    mode = env.metadata.get("autoreset_mode")
    if isinstance(mode, AutoresetMode):
        return mode
    if mode is not None:
        raise InputError(
            f"expected an AutoresetMode as metadata['autoreset_mode'] of {env}, got {mode!r}"
        )
    # As Gymnasium's own wrappers do.
    warn(
        f"{env} has no metadata['autoreset_mode']; VectorStlMonitor takes it for "
        "AutoresetMode.NEXT_STEP"
    )
    return AutoresetMode.NEXT_STEP


def resolve_period(
    specs: Mapping[str, rtamt.Specification],
    period: float | str | None,
    env: Env,
    read: Callable[[Any], float | None] = read_period,
) -> float | str | None:
    """The period given, else the period of the environment, as ``read`` finds it.

    Raises:
        SpecificationError: If neither is there and a specification has a bound.
    """
    if period is None:
        period = read(env)
    if period is None:
        for name, spec in specs.items():
            if spec.timed:
                raise SpecificationError(
                    f"specification {name!r} has bounds in time, but {env.unwrapped} does not "
                    "say how long a step lasts; give period= in seconds, or period=1 to count steps"
                )
    return period


def make_monitor(
    name: str, spec: rtamt.Specification, period: float | str | None, view: View, nan: Nan
) -> tuple[rtamt.EpisodeMonitor | InstantMonitor, rtamt.EpisodeMonitor]:
    """What to feed for one specification, and who judges the episode: the same, or its part.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, if the formula speaks of
            the first sample only and ``view`` is ``"episode"``, or if its future has no bound and
            ``view`` is ``"step"``.
    """
    if view == "step":
        monitor = InstantMonitor(spec, period, nan)
        return monitor, monitor.judge
    check_looks_ahead(name, spec)
    judge = rtamt.EpisodeMonitor(spec, period=period, nan=nan)
    return judge, judge


def check_looks_ahead(name: str, spec: rtamt.Specification) -> None:
    """Refuses what the first sample alone decides, which no episode can be judged by.

    Raises:
        SpecificationError: If the formula looks at no later sample.
    """
    if not spec.looks_ahead:
        raise SpecificationError(
            f"specification {name!r} speaks of the first sample only: {spec.formula}; "
            f"write always({spec.formula}) or view='step'"
        )


def _load(spec: SpecLike) -> rtamt.Specification:
    match spec:
        case rtamt.Specification():
            return spec
        case rtamt.Formula():
            return rtamt.Specification.of(spec)
        case os.PathLike():
            return rtamt.load(Path(spec))
        case str() if spec.endswith(".stl") and len(spec.split()) == 1:
            return rtamt.load(Path(spec))
        case str():
            return rtamt.parse(spec)
    raise InputTypeError(
        "expected the text of a specification, the path of a .stl file or an "
        f"rtamt.Specification, got {spec!r}"
    )


def _skips(env: Env) -> bool:
    """Whether a wrapper of Gymnasium makes several steps of the simulation in one."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, MaxAndSkipObservation):
            return True
        env = env.env
    return False


def _positive(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    number = float(value)
    return number if 0.0 < number < math.inf else None


def _name(spec: rtamt.Specification) -> str:
    return spec.name or _result_name(spec) or "spec"


def _result_name(spec: rtamt.Specification) -> str | None:
    return next((name for name, formula in spec.formulas.items() if formula is spec.formula), None)


def _text(spec: SpecLike) -> str:
    return os.fspath(spec) if isinstance(spec, os.PathLike) else str(spec)
