"""The signals of a specification, read from a step of many environments on a device.

A selector is ``obs[2]``, ``obs['state'][0]``, ``action[0]``, ``reward``, ``info['key']`` or
``metrics['key']``, as in `rtamt_gym`. A function takes an `ArrayStep` of one environment, and is
vectorized. Action and reward do not exist at a reset; a pair sets a value: ``("action[0]", 0.0)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_arrays.operations import Tensor
from rtamt_gym.signals.signals import ParsedSignal, SignalLike, Source, parse_signals
from rtamt_gym.signals.sources import STEP


class ArrayStep(NamedTuple):
    """A step of a batch of environments; functions of signals get a step of one environment.

    Attributes:
        obs: The observation: an array, or a dictionary of arrays.
        action: The action of the step; None at a reset.
        reward: The environment's own reward of the step; None at a reset.
        info: The environment's own info.
        state: The state of the simulator.
        metrics: The metrics of a Brax or Playground environment.
    """

    obs: Any
    action: Any
    reward: Any
    info: Mapping[str, Any]
    state: Any
    metrics: Mapping[str, Any] = {}


def _unbound(_signal: ParsedSignal, _env: object) -> Any:  # noqa: ANN401 - no environment binds it
    msg = "arrays are read by ArraySignals"
    raise AssertionError(msg)


SOURCES: Mapping[str, Source] = {
    **STEP,
    "metrics": Source(example="metrics['key']", bind=_unbound, brackets="key"),
}
"""The first words of selectors."""


class ArraySignals:
    """The signals of specifications, read from steps.

    Args:
        signals: For each variable a selector, a function, or a pair with its value at a reset.
        variables: The variables of the specifications.
        vectorize: Returns the function of a batch for a function of one environment.

    Raises:
        InputError: As `rtamt_gym.StlMonitor` does, and if a value at a reset is unknown.
    """

    def __init__(
        self,
        signals: Mapping[str, SignalLike],
        variables: Sequence[str],
        vectorize: Callable[[Callable[[Any], Any]], Callable[[Any], Any]],
    ) -> None:
        self._signals = parse_signals(signals, variables, SOURCES)
        self._vectorize = vectorize
        for signal in self._signals:
            if signal.default is not None and math.isnan(signal.default):
                raise InputError(
                    f"signal {signal.name!r}: the value at a reset is None, and monitors on "
                    "arrays have no unknown samples. Set any number, and write a specification of "
                    "the samples after the reset, such as always[1:inf](...)."
                )

    def step(self, step: ArrayStep) -> dict[str, Tensor]:
        """Return an array for each signal, with one number per environment."""
        return {signal.name: self._read(signal, step) for signal in self._signals}

    def reset(self, step: ArrayStep) -> dict[str, Tensor | float]:
        """Return an array for each signal at a reset, or one number for all environments."""
        return {
            signal.name: self._read(signal, step) if signal.default is None else signal.default
            for signal in self._signals
        }

    def _read(self, signal: ParsedSignal, step: ArrayStep) -> Tensor:
        if callable(signal.reads):
            return self._vectorize(signal.reads)(step)
        value = getattr(step, str(signal.source))
        for part in signal.path:
            value = _part(signal, value, part)
        return value


def _part(signal: ParsedSignal, value: Any, part: int | str) -> Any:  # noqa: ANN401
    """Return an element along the axis after the batch, or the value of a key.

    Arrays clamp an index out of range, so check the shape.
    """
    if isinstance(value, Mapping):
        if part in value:
            return value[part]
        keys = ", ".join(sorted(map(str, value))) or "none"
        raise InputError(
            f"signal {signal.name!r}: {signal} has no {part!r}; the keys are {keys}"
            f"{nearest(str(part), [str(key) for key in value])}"
        )
    shape = tuple(getattr(value, "shape", ()))[1:]
    if not shape or isinstance(part, str) or not -shape[0] <= part < shape[0]:
        raise InputError(
            f"signal {signal.name!r}: {signal} does not fit the values of one environment, an "
            f"array of shape {shape}"
        )
    return value[:, part]
