"""What `StlMonitor` and `VectorStlMonitor` share: their options, their signals and their period."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, ClassVar, Literal, TypedDict, get_args

from rtamt import InputError, Specification, StateError
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.judges.infos import Cost
from rtamt_gym.judges.interface import Names, Semantics
from rtamt_gym.judges.panel import Panel
from rtamt_gym.judges.specs import Align, Nan, SpecsLike, View, check_period, load_specs
from rtamt_gym.judges.vector_panel import VectorPanel
from rtamt_gym.signals.signals import SignalLike, parse_signals
from rtamt_gym.signals.sources import SOURCES

__all__ = ["MonitorOptions", "Monitoring", "OnViolation"]

OnViolation = Literal["terminate", "truncate", "report"]
"""What happens to an episode at a certain violation."""

_CHOICES: dict[Literal["on_violation", "view", "nan", "align", "cost"], tuple[object, ...]] = {
    "on_violation": get_args(OnViolation),
    "view": get_args(View),
    "nan": get_args(Nan),
    "align": (None, *get_args(Align)),
    "cost": (None, *get_args(Cost)),
}


class MonitorOptions(TypedDict, total=False):
    """The keyword arguments of `StlMonitor` and of `VectorStlMonitor`."""

    period: float | str | None
    on_violation: OnViolation
    view: View
    nan: Nan
    align: Align | None
    semantics: Semantics
    inputs: Names | None
    outputs: Names | None
    details: bool
    cost: Cost | None
    buffer_length: int


class Monitoring:
    """The base of the two wrappers."""

    _UNPICKLED: ClassVar[frozenset[str]]
    """Attributes that pickle cannot carry; `_bind_signals` makes them anew."""

    _panel: Panel | VectorPanel

    def _set_up(
        self,
        env: Any,  # noqa: ANN401 - an environment, or many
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        options: MonitorOptions,
        read_period: Callable[[Any], float | None],
    ) -> dict[str, Specification]:
        """Checks the options, parses specifications and signals, and finds the period."""
        for name, choices in _CHOICES.items():
            check_choice(name, options[name], choices)
        length: object = options["buffer_length"]
        if not isinstance(length, int) or length < 0:
            raise InputError(f"expected buffer_length= as an integer, 0 or more, got {length!r}")
        self._on_violation = options["on_violation"]
        self._details = options["details"]
        self._cost = options["cost"]
        loaded = load_specs(specs)
        variables = [name for spec in loaded.values() for name in spec.variables]
        self._signals = parse_signals(signals, variables, SOURCES)
        self._read_period = read_period
        period = options["period"]
        self._period = read_period(env) if period is None else period
        check_period(loaded, self._period, env.unwrapped)
        timed = any(spec.timed for spec in loaded.values())
        self._guards_period = period is None and timed
        return loaded

    def _check_period(self, env: Any) -> None:  # noqa: ANN401
        """Refuses an environment that has changed its period since the wrapper was made."""
        if self._guards_period and self._read_period(env) != self._period:
            raise StateError(
                f"expected the period of {self._period} s that {env.unwrapped} had at "
                f"construction, got {self._read_period(env)} s; wrap it again, or give period="
            )

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples; ``None`` if neither the argument nor the environment says."""
        return self._panel.period

    def __getstate__(self) -> dict[str, Any]:
        return {name: self.__dict__[name] for name in self.__dict__ if name not in self._UNPICKLED}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind_signals()

    def _bind_signals(self) -> None:
        """Makes the functions that read this environment."""
        raise NotImplementedError
