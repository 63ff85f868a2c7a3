"""From robustness to reward: pure functions of floats, and of arrays with one for each environment.

Let r be the environment's reward, x the robustness of the episode before the step, clipped to
[-clip, clip], and x' the same after the step:

| mode | reward | keeps |
|---|---|---|
| ``add`` | r + weight * x' | |
| ``replace`` | x' | |
| ``potential`` | r + weight * (gamma * x' - x), x' = 0 after a termination | the optimal policy |
| ``terminal`` | r, plus weight * x' in the last step, terminated or truncated | |
| ``progress`` | r + weight * (m' - m), m the middle of the bounds | |
| ``hierarchical`` | the value of the first negative level, below | the order of the levels |
| ``verdict`` | 0 | |

In every mode, `settle` pays a bonus once all specifications are certainly satisfied, and a penalty
once any is certainly violated. Each is paid once per episode, at the step of the decision, or at
the last step if only the end decides. ``potential`` then keeps the policy that is optimal for r
with bonus and penalty, not for r alone.

``progress`` pays the gain of the bounds of the robustness, each clipped. Its sum over an episode is
weight times their middle at the end minus their middle at the reset, which no action changes. At
the end, the middle has the sign of the verdict; if only the end decides, it is the robustness, as
in ``terminal``. But each gain is paid at the step that earned it.

``potential`` keeps x' at a truncation, because the episode could have gone on and the learner
bootstraps with the value of its last state. After a termination, by the environment or by the
monitor, nothing follows and the potential must be 0 (Ng, Harada and Russell, "Policy invariance
under reward transformations", ICML 1999). ``gamma`` must be the learner's discount.

The other modes change the optimal policy on purpose. While x is negative for many steps (a goal not
yet reached), ``add``, ``replace`` and ``hierarchical`` pay a negative amount each step. An early
failure may then earn more than a late success; ``terminal``, ``progress`` and ``potential`` do not
depend on the number of steps in this way.

Functions that take several specifications take a sequence with an element for each: floats, or
arrays of shape (environments,), of NumPy, of JAX or of torch. Flags (``ended``, ``terminated``) are
1 or 0 in arrays, otherwise True or False.

To add a mode: its name in `Mode`, one case of `Shaping.reward` and a row of the table above; if it
depends on the episode or on bounds, also `pays_episode` or `pays_bounds`; if it ignores the weight
or the robustness, `pays_robustness`. The case computes with floats and arrays of every library, so
`rtamt_arrays` needs no change. Describe the mode in the docstrings of `StlReward` and
`ParallelStlReward`, in ``docs/gymnasium.md`` and in ``docs/learning.md``. The tests run every name
in `Mode`, with the options from ``tests/support/replay.py``; an error in
``tests/rtamt_gym/wrappers/errors.txt`` lists all modes.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypedDict, TypeVar, assert_never, cast, get_args

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.arguments import check_amount, check_choice, check_known, check_number


def library_of(array: Any) -> Any:  # noqa: ANN401 - of any library
    """Return the library of an array, which is loaded: NumPy, JAX or torch."""
    if isinstance(array, np.ndarray):
        return np
    names = getattr(array, "__array_namespace__", None)  # torch lacks it
    return sys.modules["torch"] if names is None else names()


def check_mapping(name: str, value: object, example: Mapping[str, str]) -> None:
    """Raise InputError if a value is not a mapping."""
    if not isinstance(value, Mapping):
        raise InputError(
            f"expected {name}= as a mapping from specifications, such as "
            f"{name}={_code(example)}, got {value!r}"
        )


def levels_of(
    names: Sequence[str], mode: str, priorities: Mapping[str, str] | None
) -> tuple[tuple[int, ...], ...]:
    """Return the places of the specifications in each level; no level is empty.

    Each `Priority` is a level, in order. Modes other than ``"hierarchical"`` have one level.
    Priorities that do not fit are an InputError.
    """
    if mode != "hierarchical":
        if priorities is not None:
            raise InputError(f"priorities= belongs to mode='hierarchical', got mode={mode!r}")
        return (tuple(range(len(names))),)
    ranks = get_args(Priority)
    enough = [*ranks, *[ranks[-1]] * len(names)]
    example = {name: f'"{rank}"' for name, rank in zip(names, enough, strict=False)}
    if priorities is None:
        raise InputError(
            "expected priorities= with mode='hierarchical', got None; pass the priority of each "
            f"specification, such as priorities={_code(example)}"
        )
    check_mapping("priorities", priorities, example)
    check_known("priorities", priorities, names)
    for name in names:
        if name not in priorities:
            raise InputError(
                f"specification {name!r} has no priority; add it to priorities=, such as "
                f'"{name}": "{ranks[-1]}"'
            )
        check_choice(f"priorities[{name!r}]", priorities[name], ranks)
    levels = (
        tuple(i for i, name in enumerate(names) if priorities[name] == rank) for rank in ranks
    )
    return tuple(level for level in levels if level)


def _code(entries: Mapping[str, str]) -> str:
    """Return a dictionary as Python code; the values are code already."""
    return "{" + ", ".join(f'"{name}": {value}' for name, value in entries.items()) + "}"


Mode = Literal["add", "replace", "potential", "terminal", "progress", "hierarchical", "verdict"]
"""How robustness becomes reward."""

Priority = Literal["safety", "target", "comfort"]
"""The levels of ``hierarchical``, the most important first."""

Numeric = TypeVar("Numeric", float, NDArray[np.float64])
"""A float, or an array with one float for each environment."""


def clip(x: Numeric, bound: float) -> Numeric:
    """``min(max(x, -bound), bound)``; infinities become finite.

    Example:
        >>> clip(float("-inf"), 1.0), clip(0.25, 1.0)
        (-1.0, 0.25)
    """
    if isinstance(x, float | int):
        # Calls of min() and max() would cost twice as much.
        return bound if x > bound else max(x, -bound)
    clipped: Numeric = library_of(x).clip(x, -bound, bound)
    return clipped


def scaled(values: Sequence[Numeric], weights: Sequence[float], bound: float) -> list[Numeric]:
    """Return the values of the specifications, each times its weight and clipped.

    Example:
        >>> scaled([0.2, -3.0, float("inf")], weights=[10.0, 0.1, 1.0], bound=1.0)
        [1.0, -0.3..., 1.0]
    """
    pairs = zip(weights, values, strict=True)
    if isinstance(values[0], float):  # as `clip` does, without calls
        return [
            bound if (x := weight * value) > bound else max(x, -bound) for weight, value in pairs
        ]
    return [clip(weight * value, bound) for weight, value in pairs]


def least(values: Sequence[Numeric], temperature: float | None = None) -> Numeric:
    """Return the minimum; with a temperature T, ``-T * log(sum(exp(-value / T)))``.

    This smooth minimum of n values lies between ``min - T * log(n)`` and ``min``: if it is
    positive, all values are. It depends on all values, mostly on the smallest; for one value it is
    that value. It is smooth over specifications only: minima and maxima in a formula stay exact.

    Args:
        values: Finite numbers, one or more.
        temperature: T > 0; None for the exact minimum.

    Example:
        >>> least([0.5, 0.25])
        0.25
        >>> round(least([0.5, 0.25], temperature=0.1), 3)
        0.242
    """
    first = values[0]
    if not isinstance(first, float | int):
        return cast("Numeric", _least_of_entries(values, temperature))
    low = min(values)
    if low == 0.0:  # min gives the first zero
        low = min(values, key=lambda value: math.copysign(1.0, value) if value == 0.0 else 2.0)
    if temperature is None:
        return low
    return low - temperature * math.log(sum(math.exp((low - v) / temperature) for v in values))


def _least_of_entries(values: Sequence[Any], temperature: float | None) -> Any:  # noqa: ANN401
    library = library_of(values[0])
    lowest = functools.reduce(library.minimum, values)
    # A minimum may have either sign of zero. Only NumPy can check cheaply whether there is a zero.
    if len(values) > 1 and not (library is np and lowest.all()):
        negative = functools.reduce(library.logical_or, map(library.signbit, values))
        lowest = library.where((lowest == 0.0) & negative, -0.0, lowest)
    if temperature is None:
        return lowest
    # differences to the minimum, so that no exponential overflows
    powers = sum(library.exp((lowest - value) / temperature) for value in values)
    return lowest - temperature * library.log(powers)


def hierarchical(levels: Sequence[Numeric], bound: float) -> Numeric:
    """Return the first negative level, or the last, raised by ``bound`` for every level before it.

    With all levels in [-bound, bound], the ranges do not overlap: a violated level never returns
    more than a violation of later levels only. The value is negative exactly if a level is, -0.0
    included, and never falls when a level rises. The margin of a satisfied level counts for the
    last level only.

    Args:
        levels: Robustness of each level, the most important first.
        bound: The clip of the levels.

    Example:
        >>> hierarchical([-0.5, 1.0, 1.0], 1.0), hierarchical([0.5, -0.5, 1.0], 1.0)
        (-0.5, 0.5)
        >>> hierarchical([0.5, 0.5, -0.5], 1.0), hierarchical([0.5, 0.5, 0.5], 1.0)
        (1.5, 2.5)
    """
    if len(levels) == 1:
        return levels[0]
    # Not level + 0 * bound, which would lose the sign of a zero.
    raised = [level + rank * bound if rank else level for rank, level in enumerate(levels)]
    return _of_first_negative(levels, raised)


def _of_first_negative(levels: Sequence[Numeric], values: Sequence[Numeric]) -> Numeric:
    """Return the value for the first negative level, or the last value."""
    value = values[-1]
    for rank in range(len(levels) - 2, -1, -1):
        level = levels[rank]
        if isinstance(level, float | int):
            value = values[rank] if math.copysign(1.0, level) < 0.0 else value
        else:
            library = library_of(level)
            value = library.where(library.signbit(level), values[rank], value)
    return value


def outcome(lower: Numeric, upper: Numeric) -> Numeric:
    """Return 1 if the bounds exclude a violation, -1 if they exclude satisfaction, otherwise 0.

    Args:
        lower: The minimum robustness that the episode can still have, its sign bit included.
        upper: The maximum.

    Example:
        >>> outcome(0.5, 2.0), outcome(-1.0, -0.0), outcome(-1.0, 0.0)
        (1.0, -1.0, 0.0)
    """
    if isinstance(lower, float | int):
        return (math.copysign(1.0, lower) + math.copysign(1.0, upper)) / 2.0
    library = library_of(lower)
    decided: Numeric = (
        library.copysign(library.ones_like(lower), lower)
        + library.copysign(library.ones_like(upper), upper)
    ) / 2.0
    return decided


def settle(before: Numeric, after: Numeric, bonus: float, penalty: float) -> Numeric:
    """Return the bonus where an `outcome` became 1, minus the penalty where it became -1.

    An outcome other than 0 never changes. At a reset it counts as 0, so that the first step settles
    a decision of the first sample.

    Example:
        >>> settle(0.0, 1.0, bonus=5.0, penalty=2.0), settle(0.0, -1.0, bonus=5.0, penalty=2.0)
        (5.0, -2.0)
        >>> settle(1.0, 1.0, bonus=5.0, penalty=2.0)
        0.0
    """
    change = after - before
    return bonus * (change > 0.0) - penalty * (change < 0.0)


class ShapingNumbers(TypedDict, total=False):
    """The keyword arguments of `Shaping.of`, except the mode."""

    weight: float
    clip: float
    gamma: float
    temperature: float | None
    weights: Mapping[str, float] | None
    priorities: Mapping[str, Priority] | None
    bonus: float
    penalty: float


@dataclass(frozen=True, slots=True)
class Shaping:
    """A mode and its numbers for specifications in a fixed order; `of` returns one.

    Attributes:
        mode: How robustness becomes reward.
        weight: Factor of the robustness next to the environment's reward; 0 pays no robustness.
        clip: Bound of the robustness.
        gamma: Discount of the learner.
        temperature: Temperature of the smooth minimum over the specifications; None: exact.
        weights: Factor of every specification's robustness.
        levels: Indices of the specifications in each level; all modes but ``hierarchical`` have one
            level.
        bonus: The reward of a certain satisfaction.
        penalty: The cost of a certain violation.
        pays_episode: Whether the reward depends on the robustness of the whole episode, not of an
            instant. Every step reads it, so it is not a property.
        pays_bounds: Whether the reward depends on the `middle` of the bounds, not on the
            robustness.
    """

    mode: Mode
    weight: float
    clip: float
    gamma: float
    temperature: float | None
    weights: tuple[float, ...]
    levels: tuple[tuple[int, ...], ...]
    bonus: float
    penalty: float
    pays_episode: bool = field(init=False, repr=False, compare=False)
    pays_bounds: bool = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pays_episode", self.mode == "terminal")
        object.__setattr__(self, "pays_bounds", self.mode == "progress")

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        *,
        mode: Mode,
        weight: float = 1.0,
        clip: float = 1.0,
        gamma: float = 0.99,
        temperature: float | None = None,
        weights: Mapping[str, float] | None = None,
        priorities: Mapping[str, Priority] | None = None,
        bonus: float = 0.0,
        penalty: float = 0.0,
    ) -> Shaping:
        """Return the shaping of specifications; `StlReward` documents the arguments.

        Raises:
            InputError: If an argument is not among its choices, out of its range, or names an
                unknown specification.
        """
        check_choice("mode", mode, get_args(Mode))
        if weights is not None:
            check_mapping("weights", weights, dict.fromkeys(names, "1.0"))
            check_known("weights", weights, names)
        factor = {
            name: check_number(f"weights[{name!r}]", value)
            for name, value in (weights or {}).items()
        }
        if mode == "verdict" and bonus == penalty == 0.0:
            raise InputError(
                "mode='verdict' pays only bonus= and penalty=, which are both 0; set at least one, "
                "such as bonus=1.0, penalty=1.0"
            )
        return cls(
            mode=mode,
            weight=check_amount("weight", weight),
            clip=check_number("clip", clip),
            gamma=check_number("gamma", gamma, 1.0),
            temperature=(None if temperature is None else check_number("temperature", temperature)),
            weights=tuple(factor.get(name, 1.0) for name in names),
            levels=levels_of(names, mode, priorities),
            bonus=check_amount("bonus", bonus),
            penalty=check_amount("penalty", penalty),
        )

    @property
    def settles(self) -> bool:
        """Whether a bonus or a penalty is paid."""
        return self.bonus > 0.0 or self.penalty > 0.0

    @property
    def pays_robustness(self) -> bool:
        """Whether the reward depends on the robustness, and not on verdicts alone."""
        unweighted = self.mode in {"replace", "hierarchical"}
        return self.mode != "verdict" and (unweighted or self.weight > 0.0)

    def robustness(self, values: Sequence[Numeric]) -> Numeric:
        """Combine the robustness of the specifications into the number that the reward uses."""
        if len(self.levels) == 1:
            bounded = scaled(values, self.weights, self.clip)
            return clip(least(bounded, self.temperature), self.clip)
        return hierarchical(self._levels_of(values), self.clip)

    @property
    def factor(self) -> float | None:
        """Return the common weight, if `robustness` is the minimum robustness times this weight.

        Then it is ``clip(factor * least)``: weights and clips keep the order of numbers.
        """
        one = len(self.levels) == 1 and self.temperature is None
        return self.weights[0] if one and len(set(self.weights)) == 1 else None

    def middle(self, lower: Sequence[Numeric], upper: Sequence[Numeric]) -> Numeric:
        """Return the middle of the clipped bounds of the robustness, which ``progress`` pays."""
        return 0.5 * (self.robustness(lower) + self.robustness(upper))

    def deciding(self, values: Sequence[Numeric]) -> Numeric:
        """Return the value that decides `robustness`, before clipping.

        It is the minimum over the specifications, each times its weight; in the mode
        ``hierarchical`` the minimum over the level that pays. If it is beyond the clip, no small
        change of a specification in that level changes the reward.
        """
        weighted = [factor * value for factor, value in zip(self.weights, values, strict=True)]
        lows = [least([weighted[i] for i in level]) for level in self.levels]
        return _of_first_negative(self._levels_of(values), lows)

    def _levels_of(self, values: Sequence[Numeric]) -> list[Numeric]:
        bounded = scaled(values, self.weights, self.clip)
        return [
            clip(least([bounded[i] for i in level], self.temperature), self.clip)
            for level in self.levels
        ]

    def reward(
        self, reward: Numeric, before: Numeric, after: Numeric, terminated: Numeric, ended: Numeric
    ) -> Numeric:
        """Return the shaped reward of a step.

        Args:
            reward: The reward of the environment.
            before: `robustness` before the step; in the mode ``progress`` the `middle`.
            after: The same after the step.
            terminated: Whether the episode was terminated.
            ended: Whether it was terminated or truncated.
        """
        match self.mode:
            case "add":
                return reward + self.weight * after
            case "replace" | "hierarchical":
                return after
            case "potential":
                goes_on = 1.0 - terminated
                return reward + self.weight * (self.gamma * after * goes_on - before)
            case "terminal":
                return reward + self.weight * (after * ended)
            case "progress":
                return reward + self.weight * (after - before)
            case "verdict":
                return 0.0 * ended
            case _ as never:
                assert_never(never)
