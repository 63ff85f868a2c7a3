"""Whether an environment has lanes, and which."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

import gymnasium as gym

import rtamt
from rtamt_gym.checks.numbers import exact
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.panel import Panel
from rtamt_gym.search.runs.lanes import NativeLanes
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import ElementRead, SignalLike, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.simulation.record import Stop

__all__ = ["lanes_of"]


def lanes_of(
    system: Any,  # noqa: ANN401
    judging: Judging,
    duration: float | None,
    stop: Stop,
    batch: int,
) -> NativeLanes | None:
    """The lanes that run the cases of an environment; None if it has none, or they do not do."""
    spec = system.spec if isinstance(system, gym.Env) else None
    if spec is None or spec.vector_entry_point is None or spec.additional_wrappers:
        return None
    if judging.reading.substeps:
        return None
    elements = _elements(system, judging.specs, judging.signals)
    vector = gym.make_vec(spec, num_envs=1)
    has_rollout = hasattr(vector.unwrapped, "rollout")
    vector.close()
    if elements is None or not has_rollout or spec.max_episode_steps is None:
        return None
    if judging.reading.period is None:
        reading = judging.reading.having(period=read_period(system))
        judging = judging._replace(reading=reading)
    panel = Panel(judging.specs, judging.reading)
    most = None
    if duration is not None and duration != math.inf:
        most = int(exact(duration) / (panel.period or 1))
    return NativeLanes(system, judging, elements, most, stop, batch)


def _elements(
    env: gym.Env[Any, Any],
    specs: Mapping[str, rtamt.Specification],
    signals: Mapping[str, SignalLike] | None,
) -> dict[str, int] | None:
    """The element of the observation that each variable reads; None if one reads something else."""
    variables = list(dict.fromkeys(name for spec in specs.values() for name in spec.variables))
    own = own_signals(env)
    chosen = {name: (signals or {}).get(name, own.get(name)) for name in variables}
    texts = {name: read for name, read in chosen.items() if isinstance(read, str)}
    if set(texts) != set(variables) or not set(signals or {}) <= set(variables):
        return None
    try:
        bound = [each.bind(env) for each in parse_signals(texts, variables, SOURCES)]
    except rtamt.RtamtError:  # which the first simulation raises, in words of its own
        return None
    if not all(isinstance(read, ElementRead) for read in bound):
        return None
    return dict(zip(variables, (cast("ElementRead", read).index for read in bound), strict=True))
