"""What the rewards share: the monitor, the shaping, and what is observed."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Mapping
from itertools import compress
from typing import Any, Required, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorWrapper

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.constants import ConstantValue
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.shaping import Mode, Shaping, ShapingNumbers
from rtamt_gym.signals.columns import Lanes
from rtamt_gym.signals.signals import SignalLike, own_signals
from rtamt_gym.wrappers.clipping import ClipWatch
from rtamt_gym.wrappers.monitor import StlMonitor
from rtamt_gym.wrappers.monitoring import MonitorOptions
from rtamt_gym.wrappers.observing import Observe, Observing
from rtamt_gym.wrappers.parallel_monitor import ParallelStlMonitor
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor

__all__ = ["Rewarding", "ShapingOptions", "find_or_make"]

_M = TypeVar("_M")


class ShapingOptions(ShapingNumbers):
    """The keyword arguments of `rtamt_gym.shaping.Shaping.of`."""

    mode: Required[Mode]


class Rewarding(Observing):
    """The base of the wrappers."""

    _monitor: StlMonitor[Any, Any] | VectorStlMonitor | ParallelStlMonitor
    _followed = 0
    """The changes of constants that it has followed."""

    def _set_up(
        self,
        env: Any,  # noqa: ANN401 - an environment, or many
        monitors: Mapping[str, tuple[Any, Any]],
        options: ShapingOptions,
        observe: Observe | None,
        num: int,
    ) -> None:
        self._shaping = shaping = Shaping.of(list(monitors), **options)
        self._whole = shaping.mode == "terminal"
        self._settles = shaping.settles
        self._set_up_observations(
            env,
            observe,
            shaping.clip,
            monitors,
            self._monitor.track_obligations,
            shaping.weights,
            whole=self._whole,
        )
        self._watch = ClipWatch(shaping, num) if shaping.pays_robustness else None
        self._followed = self._monitor.constant_changes

    @property
    def constants(self) -> dict[str, float]:
        """The values of the constants, as the monitor has them; setting it changes some there."""
        return self._monitor.constants

    @constants.setter
    def constants(self, constants: Mapping[str, ConstantValue]) -> None:
        self._monitor.constants = constants

    def _follow(self) -> None:
        """Goes over to the monitors with other constants."""
        monitor = self._monitor
        self._follow_monitors(monitor.monitors, monitor.track_obligations)
        self._followed = monitor.constant_changes

    def _require_known_start(self, begun: Lanes | None = None) -> None:
        """Refuses episodes whose first sample hangs on what is unknown.

        Args:
            begun: The environments whose episodes begin; None: all.

        Raises:
            InputError: If a specification reads an unknown value of the sample of a reset.
        """
        if not self._monitor.unknown_allowed:
            return
        for name, (_, judge) in self._monitor.monitors.items():
            unknown = judge.unknown
            if not isinstance(unknown, tuple):  # a row for each environment
                rows = unknown if begun is None else unknown[begun]
                unknown = tuple(compress(judge.variables, np.any(rows, axis=0).tolist()))
            read = [v for v in unknown if v in judge.program.read_first()]
            if read:
                raise InputError(
                    f"specification {name!r} reads {listing(read)} at the sample of the reset, "
                    "where nothing is known of it: its worst case stays as it is there for the "
                    "whole episode, and nothing can be learned; give the signal a value at the "
                    "reset, speak of the samples after it, as in always[1:inf](...), or pass ",
                    Argument("nan", "hold"),
                )

    def _warn_if_flat(self) -> None:
        """Ends the watch over the first episodes once they are over."""
        watch = self._watch
        if watch is not None and watch.finished:
            self._watch = None
            report = watch.report
            if report is not None:
                self._looking = None  # the same clip, which this asks to change
                warnings.warn(report, UserWarning, stacklevel=caller_level())

    @property
    def stl_episodes(self) -> deque[dict[str, Any]]:
        """The records of the last episodes that ended, as the monitor keeps them."""
        return self._monitor.stl_episodes


def find_or_make(
    kind: type[_M],
    env: Any,  # noqa: ANN401 - an environment, or many
    specs: SpecsLike | None,
    signals: Mapping[str, SignalLike] | None,
    options: MonitorOptions,
) -> tuple[Any, _M]:
    """Finds the monitor of an environment, or makes one.

    Args:
        kind: `StlMonitor`, `VectorStlMonitor` or `ParallelStlMonitor`.
        env: The environment.
        specs: The argument of the monitor to make; None if the environment has a monitor.
        signals: The argument of the monitor to make; None if the environment has a monitor, or
            names its signals itself.
        options: The other arguments of the monitor to make.

    Returns:
        The environment inside its monitor, and the monitor.

    Raises:
        InputError: If the environment has no monitor and the arguments describe none, or if it has
            one and the arguments describe another.
    """
    what = f"{'a' if kind.__name__.startswith('V') else 'an'} {kind.__name__}"
    given = {"specs": specs, "signals": signals}
    within = env
    while isinstance(within, gym.Wrapper | VectorWrapper) or hasattr(within, "possible_agents"):
        if isinstance(within, Rewarding):
            raise InputError(
                f"expected an environment without a reward of its requirements, got one with "
                f"{type(within).__name__}, "
                "which pays for its specifications already; give one wrapper all specifications, "
                'and what each counts in weights={"upright": 1.0, "near": 0.5} or priorities='
            )
        if isinstance(within, kind):
            names = [*(name for name, value in given.items() if value is not None), *options]
            if names:
                raise InputError(
                    f"{', '.join(f'{name}=' for name in names)} would describe another monitor, "
                    f"and the environment has {what}, which is used; give them to that one"
                )
            return env, within
        within = getattr(within, "env", None)
    for name, value in given.items():
        if value is None and not (name == "signals" and own_signals(env)):
            raise InputError(
                f"expected {name}=, or an environment with {what}, got neither; such as "
                'specs="always(x > 0)", signals={"x": "obs[0]"}'
            )
    made: Any = kind
    monitor = made(env, specs, signals, **options)
    return monitor, monitor
