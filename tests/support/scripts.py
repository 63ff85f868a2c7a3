"""Scripted environments, and generated specifications, scripts and options for them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import gymnasium as gym
import numpy as np
from episode_oracle import Flags, Options
from gymnasium import spaces
from hypothesis import strategies as st
from oracle import horizon
from strategies import INTEGERS, VARIABLES, Trace, formulas, length, traces

from rtamt import Formula
from rtamt.language.formula import make

AT_RESET = 1.0
"""The value of the reward's signal at a reset."""

SIGNALS: dict[str, Any] = {"a": "obs[0]", "b": "obs[1]", "c": ("reward", AT_RESET)}

ENDS: dict[str, Flags] = {
    "terminated": (True, False),
    "truncated": (False, True),
    "both": (True, True),
    "none": (False, False),
}


@dataclass(frozen=True)
class Script:
    """The behaviour of an environment in an episode.

    Attributes:
        trace: The samples.
        end: The end of the episode at the last sample, a name of `ENDS`.
        success: The value of ``is_success``; None for no key.
        always: Whether every info has the key, and not only the last one.
    """

    trace: Trace
    end: str
    success: bool | None = None
    always: bool = False

    def __len__(self) -> int:
        return length(self.trace)

    @property
    def flags(self) -> list[Flags]:
        """The flags of the reset and of every step."""
        return [(False, False)] * (len(self) - 1) + [ENDS[self.end]]

    @property
    def infos(self) -> list[dict[str, Any]]:
        """The infos of the reset and of every step."""
        said = {} if self.success is None else {"is_success": self.success}
        ended = {} if self.end == "none" else said
        return [{"own": i, **(said if self.always else {})} for i in range(len(self) - 1)] + [
            {"own": len(self) - 1, **(said if self.always else ended)}
        ]


class Scripted(gym.Env[Any, Any]):
    """Plays scripts, one per episode, and starts again after the last; none ends early.

    After a script without an end it stays at the last sample.
    """

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = spaces.Discrete(2)

    def __init__(self, scripts: Sequence[Script]) -> None:
        self.scripts = scripts
        self.episode = -1
        self.at = 0

    @property
    def script(self) -> Script:
        return self.scripts[self.episode % len(self.scripts)]

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ANN401
        super().reset(seed=seed, options=options)
        self.episode += 1
        self.at = 0
        return self._observation(), dict(self.script.infos[0])

    def step(self, action: Any) -> Any:  # noqa: ANN401, ARG002
        script, last = self.script, len(self.script) - 1
        self.at = min(self.at + 1, last)
        info = dict(script.infos[self.at])
        return self._observation(), script.trace["c"][self.at], *script.flags[self.at], info

    def _observation(self) -> Any:  # noqa: ANN401
        return np.array([self.script.trace[name][self.at] for name in ("a", "b")])


@dataclass(frozen=True)
class Case:
    """Specifications, options, and the scripts of every environment."""

    specs: dict[str, Formula]
    options: Options
    entries: list[list[Script]]


@functools.cache
@st.composite
def scripts(draw: st.DrawFn) -> Script:
    """Episodes of two or more samples, of integers with many zeros."""
    trace = draw(traces(2, 8, INTEGERS))
    trace["c"][0] = AT_RESET
    own = draw(st.sampled_from((None, None, None, True, False)))
    return Script(trace, draw(st.sampled_from(tuple(ENDS))), own, draw(st.booleans()))


@functools.cache
@st.composite
def requirements(draw: st.DrawFn, view: str, depth: int = 1) -> Formula:
    """Formulas over more than the first sample, as users write them."""
    endless = view == "episode"
    if depth and draw(st.integers(0, 3)) == 0:
        parts = draw(st.lists(requirements(view, depth - 1), min_size=2, max_size=3))
        return cast("Formula", make("and", tuple(parts)))
    begin, width = draw(_few), draw(_few)
    end = None if endless and draw(st.booleans()) else begin + width
    p = draw(formulas(draw(_depth), endless=endless and draw(_seldom)))
    match draw(_shape):
        case "always":
            return p.always()
        case "within":
            return p.always(begin, end)
        case "eventually":
            return p.eventually(begin, end)
        case "until":
            return p.until(draw(formulas(1)), begin, end)
        case "response":
            return p.implies(draw(formulas(0)).eventually(0, width)).always()
        case _:
            return p if horizon(p) else p.always()


_few = st.integers(0, 3)
_depth = st.integers(0, 2)
_seldom = st.sampled_from((False,) * 5 + (True,))
_shape = st.sampled_from(("always", "within", "eventually", "until", "response", "any"))


@functools.cache
@st.composite
def cases(draw: st.DrawFn, costs: tuple[str | None, ...], num: int = 1) -> Case:
    """Cases for ``num`` environments with these costs."""
    view = draw(st.sampled_from(("episode", "episode", "step")))
    cost = draw(st.sampled_from(costs))
    options = Options(
        on_violation=draw(st.sampled_from(("terminate", "truncate", "report"))),
        at_termination=draw(st.sampled_from((None, "complete", "cut", "failure"))),
        at_truncation=draw(st.sampled_from(("cut", "complete", "open"))),
        cost=cost,
        view=view,
        details=draw(st.booleans()),
        semantics="boolean" if cost != "depth" and draw(_seldom) else "standard",
    )
    drawn = draw(st.lists(_wanted(view), min_size=1, max_size=3))
    entry = st.lists(scripts(), min_size=1, max_size=3)
    entries = draw(st.lists(entry, min_size=num, max_size=num))
    return Case({f"r{i}": f for i, f in enumerate(drawn)}, options, entries)


@functools.cache
def _wanted(view: str) -> st.SearchStrategy[Formula]:
    """Return whether a formula fits the view: in the view of steps, its future must be bounded or
    at the root.
    """
    drawn = requirements(view)
    if view == "episode":
        return drawn.filter(horizon)
    bounded = drawn.filter(lambda f: horizon(f) < float("inf"))
    return st.one_of(bounded, formulas(2), formulas(1).map(Formula.always))


def variables(specs: dict[str, Formula]) -> dict[str, Any]:
    """Return the signals of the specifications."""
    read = {name for f in specs.values() for name in f.variables}
    return {name: SIGNALS[name] for name in VARIABLES if name in read}
