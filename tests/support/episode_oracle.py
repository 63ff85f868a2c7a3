"""The report of a wrapper on an episode, from the rules; shares no code with the library.

The report follows from the samples of an episode, the end that the environment reports, and the
options of the wrapper. `oracle` and `end_oracle` compute the values of formulas.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from end_oracle import ended, holds
from interface_oracle import reader
from oracle import Read, Trace, bounds, episode, horizon, order, robustness

from rtamt import Formula
from rtamt.language.node import Node

INF = math.inf
Flags = tuple[bool, bool]
"""Whether a step terminates its episode, and whether it truncates it."""


@dataclass(frozen=True)
class Options:
    """The options of a wrapper that affect an episode's report."""

    on_violation: str = "terminate"
    at_termination: str | None = None
    at_truncation: str = "cut"
    cost: str | None = None
    view: str = "episode"
    details: bool = False
    semantics: str = "standard"

    @property
    def read(self) -> Read:
        """Return the value of a predicate."""
        return reader(self.semantics, frozenset(), frozenset())


@dataclass
class Report:
    """The report of a wrapper on an episode.

    Attributes:
        infos: The info of the reset and of every step.
        flags: How each step ends the episode; the first item belongs to the reset.
        record: The entry of ``stl_episodes``; None while the episode runs.
        assumed: Whether the default of ``at_termination`` has satisfied a specification.
    """

    infos: list[dict[str, Any]] = field(default_factory=list)
    flags: list[Flags] = field(default_factory=list)
    record: dict[str, Any] | None = None
    assumed: bool = False


@dataclass
class _Judgement:
    """The judgement of one specification after the newest sample.

    If only the end decided, ``decided_at`` is the last sample and ``by_end`` is true.
    """

    robustness: float
    lower: float
    upper: float
    overall: float
    verdict: int = 0
    decided_at: int | None = None
    by_end: bool = False


def report(
    specs: Mapping[str, Formula],
    trace: Trace,
    flags: Sequence[Flags],
    options: Options,
    *,
    own: Sequence[Mapping[str, Any]] = (),
    left: bool = False,
) -> Report:
    """Return the report on an episode with these flags; the first belongs to the reset.

    Args:
        specs: The formulas, with bounds in samples.
        trace: The samples of all variables.
        flags: For every sample, whether the environment terminates or truncates.
        options: The options of the wrapper.
        own: The environment's own infos, one for every sample; all empty by default.
        left: Whether a reset or a close follows the last sample.
    """
    made, decided = Report(), dict[str, _Judgement]()
    for t, ended_by in enumerate(flags):
        before = decided
        end = _reading(options, *ended_by)
        decided = {
            name: _judge(f, trace, t, options, end, decided.get(name)) for name, f in specs.items()
        }
        if ended_by[0] and options.at_termination is None:
            made.assumed = any(it.verdict > 0 and it.by_end for it in decided.values())
        violated = [it for it in decided.values() if it.verdict < 0]
        info: dict[str, Any] = {
            "robustness": _least([it.robustness for it in decided.values()]),
            "stl_lower": _least([it.lower for it in decided.values()]),
            "stl_upper": _least([it.upper for it in decided.values()]),
            "stl_violated": bool(violated),
        }
        mark = {"of_instant": True} if options.view == "step" else {}
        info |= {f"stl_{key}": each for key, each in mark.items()}
        if t == 0:
            info["stl_period"] = np.float64(1.0)  # bounds count samples
        if options.details:
            info["stl"] = {name: _state(it) | mark for name, it in decided.items()}
        if t and options.cost:
            info |= _costs(specs, trace, t, options, before, decided)
        terminated, truncated = ended_by
        if t and not terminated and any(not it.by_end for it in violated):
            terminated = options.on_violation == "terminate"
            truncated = truncated or options.on_violation == "truncate"
        over = bool(t) and (terminated or truncated)
        if over:
            success = all(it.verdict > 0 for it in decided.values())
            info |= {
                "stl_episode": {name: _outcome(it) for name, it in decided.items()},
                "stl_success": success,
                "stl_undecided": any(it.verdict == 0 for it in decided.values()),
                "is_success": own[t].get("is_success", success) if own else success,
                **_blame(decided, "stl_violated"),
            }
            made.record = _record(decided, t + 1, terminated=terminated, truncated=truncated)
        made.infos.append({**own[t], **info} if own else info)
        made.flags.append((terminated, truncated))
        if over:
            return made
    if left:
        t = len(flags) - 1
        end = options.at_truncation
        read = {name: _judge(f, trace, t, options, end, decided[name]) for name, f in specs.items()}
        made.record = _record(read, t + 1, terminated=False, truncated=True)
    return made


def chargeable(specs: Mapping[str, Formula], view: str) -> bool:
    """Return whether every demand can be charged while the episode runs."""
    return all(horizon(p) < INF for f in specs.values() for p, _, _ in _demands(f, view))


def charge(f: Formula, trace: Trace, t: int, options: Options) -> float:
    """Return the cost of sample t: the settled instants that violate a demand."""
    settled = {
        p: robustness(p, trace, t + 1, options.read) for p, _, _ in _demands(f, options.view)
    }
    depths = [
        -value
        for p, first, last in _demands(f, options.view)
        if first <= t - horizon(p) <= last and not holds(value := settled[p][int(t - horizon(p))])
    ]
    return max(depths, default=0.0) if options.cost == "depth" else float(bool(depths))


def _reading(options: Options, terminated: bool, truncated: bool) -> str | None:  # noqa: FBT001 - as Gymnasium has them
    """Return the end mode; None if the episode continues."""
    if terminated:
        return options.at_termination or "complete"
    return options.at_truncation if truncated else None


def _judge(
    f: Formula, trace: Trace, t: int, options: Options, end: str | None, before: _Judgement | None
) -> _Judgement:
    """Return the judgement of a formula after sample t."""
    read, instants = options.read, options.view == "step"
    judged = f.always() if instants else f
    now, low, high = episode(judged, trace, t + 1, read)
    it = _Judgement(_instant(f, trace, t, read) if instants else now, low, high, now)
    it.verdict = _verdict(low, high)
    by_end = not it.verdict
    if end == "failure":
        it.upper = it.upper if it.verdict else -0.0
    elif end is not None:
        it.overall, it.lower, it.upper = ended(judged, trace, t + 1, end, read)
        it.robustness = it.robustness if instants else it.overall
    it.verdict = _verdict(it.lower, it.upper)
    it.by_end = by_end and it.verdict != 0
    it.decided_at = t if it.verdict else None
    if before is not None and before.verdict:
        it.decided_at, it.by_end = before.decided_at, False
    return it


def _verdict(low: float, high: float) -> int:
    return -1 if not holds(high) else int(holds(low))


def _instant(f: Node, trace: Trace, t: int, read: Read) -> float:
    """Return the value of the newest instant with a passed horizon; before, of sample 0."""
    assert f.op is not None
    endless = f.op.name in ("always", "eventually") and bounds(f) == (0, INF)
    late = horizon(f.args[0] if endless else f)
    if t < late:
        return robustness(f, trace, t + 1, read)[0]
    if not endless:
        return robustness(f, trace, t + 1, read)[int(t - late)]
    seen = robustness(f.args[0], trace, t + 1, read)[: int(t - late) + 1]
    return min(seen, key=order) if f.op.name == "always" else max(seen, key=order)


def _demands(f: Formula, view: str) -> list[tuple[Node, float, float]]:
    """Return each demand, with its first and last instant."""
    parts: list[Node] = [f]
    while view == "episode" and any(_named(part, "and") for part in parts):
        parts = [p for part in parts for p in (part.args if _named(part, "and") else [part])]
    found: list[tuple[Node, float, float]] = []
    for part in parts:
        p, first, last = part, 0.0, 0.0
        if view == "step":
            last = INF
        elif _named(part, "always"):
            p, (first, last) = part.args[0], bounds(part)
        while last == INF and _named(p, "always") and bounds(p)[1] == INF:
            p, first = p.args[0], first + bounds(p)[0]
        found.append((p, first, last))
    return found


def _named(f: Node, name: str) -> bool:
    return f.op is not None and f.op.name == name


def _costs(
    specs: Mapping[str, Formula],
    trace: Trace,
    t: int,
    options: Options,
    before: Mapping[str, _Judgement],
    decided: Mapping[str, _Judgement],
) -> dict[str, np.float64]:
    """Return the cost of step t, and of each specification if there are several."""
    each = {}
    for name, f in specs.items():
        violated = decided[name].verdict < 0
        match options.cost:
            case "latched":
                each[name] = float(violated)
            case "first":
                each[name] = float(violated and (t == 1 or before[name].verdict >= 0))
            case _:
                each[name] = charge(f, trace, t, options)
    if options.cost == "first" and t > 1 and any(it.verdict < 0 for it in before.values()):
        total = 0.0  # it is charged once
    else:
        total = max(each.values())
    found = {"cost": np.float64(total)}
    if len(specs) > 1:
        found |= {f"cost_{name}": np.float64(cost) for name, cost in each.items()}
    return found


_NAMES = {-1: "VIOLATED", 0: "UNDECIDED", 1: "SATISFIED"}


def _state(it: _Judgement) -> dict[str, Any]:
    found = {"robustness": it.robustness, "lower": it.lower, "upper": it.upper}
    return {key: np.float64(value) for key, value in found.items()} | {
        "verdict": _NAMES[it.verdict]
    }


def _outcome(it: _Judgement) -> dict[str, Any]:
    found = {
        "robustness": np.float64(it.overall),
        "verdict": _NAMES[it.verdict],
        "satisfied": it.verdict > 0,
    }
    if it.verdict < 0 and holds(it.overall):  # only a failure at the end does that
        found["by_end"] = True
    if it.decided_at is None:
        return found
    return {**found, "ended_at" if it.by_end else "decided_at": it.decided_at}


def _blame(decided: Mapping[str, _Judgement], prefix: str) -> dict[str, Any]:
    """Return the specification that was violated first; ties follow their order."""
    violated = {name: it for name, it in decided.items() if it.verdict < 0}
    if not violated:
        return {}
    first = min(violated, key=lambda name: (violated[name].decided_at, violated[name].by_end))
    return {f"{prefix}_by": first, f"{prefix}_at": violated[first].decided_at}


def _record(
    decided: Mapping[str, _Judgement], samples: int, *, terminated: bool, truncated: bool
) -> dict[str, Any]:
    return {
        "samples": samples,
        "terminated": terminated,
        "truncated": truncated,
        "specs": {name: _outcome(it) for name, it in decided.items()},
        **_blame(decided, "violated"),
    }


def _least(values: Sequence[float]) -> np.float64:
    return np.float64(min(values, key=order))


def mismatch(expected: object, got: object, at: str = "") -> str:
    """Return the first difference in type or bit of infos or records; empty without one."""
    if type(expected) is not type(got):
        return f"{at}: {expected!r} and {got!r}"
    match expected, got:
        case dict(), dict():
            if expected.keys() != got.keys():
                return f"{at}: {sorted(expected.keys() ^ got.keys())} in one of them alone"
            parts = (mismatch(expected[key], got[key], f"{at}[{key!r}]") for key in expected)
            return next(filter(None, parts), "")
        case list(), list():
            if len(expected) != len(got):
                return f"{at}: {len(expected)} and {len(got)} elements"
            pairs = enumerate(zip(expected, got, strict=True))
            return next(filter(None, (mismatch(a, b, f"{at}[{i}]") for i, (a, b) in pairs)), "")
        case float(), float():
            same = expected == got and holds(expected) == holds(got)
        case _:
            same = expected == got
    return "" if same else f"{at}: {expected!r} and {got!r}"
