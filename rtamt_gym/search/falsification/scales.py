"""Scales of predicates, which make predicates of different units comparable for a search."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

import rtamt
from rtamt import Formula, InputError, Specification
from rtamt.errors import nearest
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.names import listing
from rtamt_gym.play.history import SimulatedTrace


def checked_scales(
    scales: Mapping[str, float] | Literal["plain"] | None, specs: Mapping[str, Specification]
) -> dict[str, float] | None:
    """Return the scales by the canonical texts of predicates; None if the search computes them.

    It does by default if predicates read different variables, which may have different units.
    """
    predicates = _predicates(specs.values())
    if scales is None:
        return None if len(set(map(_variables, predicates))) > 1 else {}
    if scales == "plain":
        return {}
    if not isinstance(scales, Mapping):
        raise InputError(
            f'expected scales= as {{"rpm < 3000": 1000}}, None or "plain", got {scales!r}'
        )
    known = [str(predicate) for predicate in predicates]
    result = {}
    for text, scale in scales.items():
        name = str(rtamt.parse(text).formula)
        if name not in known:
            raise InputError(
                f"scales= names an unknown predicate {text!r}; the predicates are "
                f"{listing(known)}{nearest(name, known)}"
            )
        result[name] = check_number(f"scales[{text!r}]", scale)
    return result


def spreads(
    specs: Mapping[str, Specification], traces: Iterable[SimulatedTrace]
) -> dict[str, float]:
    """Return the scales of predicates: the range of their robustness over all traces.

    Predicates that read the same variables share their largest scale. A predicate with a constant
    or infinite robustness has no scale.
    """
    predicates = _predicates(specs.values())
    low = dict.fromkeys(predicates, math.inf)
    high = dict.fromkeys(predicates, -math.inf)
    for trace in traces:
        for predicate in predicates:
            heights = rtamt.evaluate(predicate, trace.signals, n=trace.samples, nan="hold")
            heights = heights[np.isfinite(heights)]
            if len(heights):
                low[predicate] = min(low[predicate], float(heights.min()))
                high[predicate] = max(high[predicate], float(heights.max()))
    result: dict[tuple[str, ...], float] = {}
    for predicate in predicates:
        spread = high[predicate] - low[predicate]
        if 0 < spread < math.inf:
            result[_variables(predicate)] = max(result.get(_variables(predicate), 0.0), spread)
    shared = {str(predicate): result.get(_variables(predicate)) for predicate in predicates}
    return {text: float(f"{scale:.3g}") for text, scale in shared.items() if scale is not None}


def in_scales(
    specs: Mapping[str, Specification], scales: Mapping[str, float]
) -> dict[str, Specification]:
    """Return the specifications with their predicates in units of the scales, by name."""
    return {name: _in_scales(spec, scales) for name, spec in specs.items()}


def _in_scales(spec: Specification, scales: Mapping[str, float]) -> Specification:
    own = {
        predicate: scales[str(predicate)]
        for predicate in _predicates([spec])
        if str(predicate) in scales
    }
    formula = spec.scaled(own).formula
    # Named formulas of the text are not part of the new one.
    bare = replace(
        spec, formula=formula, name=None, formulas={}, positions={}, uses={}, requirement=None
    )
    return replace(bare, text=str(bare))


def _predicates(specs: Iterable[Specification]) -> list[Formula]:
    return list(dict.fromkeys(predicate for spec in specs for predicate in spec.predicates()))


def _variables(formula: Formula) -> tuple[str, ...]:
    return tuple(sorted(Specification.of(formula).variables))
