"""A requirement with a parameter, and the specification for each value of the parameter."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from functools import lru_cache
from numbers import Real

import rtamt
from rtamt import InputError, InputTypeError, SpecificationError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.formulas import require_whole_episode
from rtamt_gym.tables import number

Ranges = Mapping[str, tuple[float, float]]
"""The smallest and the largest value of a parameter, by its name."""

_PARTS = re.compile(r"//[^\n]*|/\*.*?\*/|\?([A-Za-z_]\w*)|([A-Za-z_][\w.]*)", re.DOTALL)
"""Comments, marked names and other words of a text."""


def unmarked(text: str) -> tuple[str, tuple[str, ...]]:
    """Return the text with a blank for each ``?`` before a name, and these names.

    Every other character stays where it was, so that errors show the right place.

    Raises:
        InputError: If a name occurs with and without the mark.

    Example:
        >>> unmarked("always(x < ?v) // all?right")
        ('always(x <  v) // all?right', ('v',))
    """
    names = list(dict.fromkeys(match[1] for match in _PARTS.finditer(text) if match[1]))
    for match in _PARTS.finditer(text):
        if match[2] in names:
            raise InputError(
                f"{match[2]!r} occurs with and without '?', as a parameter and as another name; "
                "give the parameter another name"
            )
    plain = _PARTS.sub(lambda match: f" {match[1]}" if match[1] else match[0], text)
    return plain, tuple(names)


class Template:
    """A requirement for each value of its parameter; `template` returns it.

    Attributes:
        text: The requirement, as it was passed.
        unit: The unit of the parameter if it bounds a time, as in ``eventually[0:?t](x > 1)``; None
            if it does not.
    """

    def __init__(
        self,
        requirement: str | rtamt.Specification,
        parameter: str,
        low: float,
        high: float,
        constants: Mapping[str, object],
        *,
        every: bool = False,
        text: str = "",
    ) -> None:
        self.parameter, self.low, self.high = parameter, low, high
        self._requirement = None
        self._unit = "s"
        self._every = every
        self._constants = dict(constants)
        if isinstance(requirement, str):
            self.text = text or requirement.strip()
            self._plain = unmarked(requirement)[0]
        else:
            self.text = text or requirement.text.strip()
            self._plain, self._unit = requirement.text, requirement.unit
            self._requirement = requirement.requirement
            self._constants = {**requirement.overrides, **self._constants}
        self.at = lru_cache(maxsize=64)(self._at)
        self.unit = self._bounding_unit()

    def _at(self, value: float | Fraction) -> rtamt.Specification:
        """Return the specification for a value of the parameter."""
        constants = {**self._constants, self.parameter: value}
        spec = rtamt.parse(self._plain, unit=self._unit, constants=constants)  # type: ignore[arg-type]  # it checks them
        if self._requirement is not None:
            spec = spec.requirements[self._requirement]
        if len(spec.requirements) > 1:
            raise InputError(
                f"expected one requirement, got {listing(spec.requirements)}; select one"
            )
        if self._every:
            return spec.always()
        if not spec.looks_ahead:
            raise SpecificationError(
                f"the requirement reads the first sample only; write always({self.text})"
            )
        require_whole_episode("the requirement", spec, "")
        return spec

    def _bounding_unit(self) -> str | None:
        """Return the unit of the parameter if an interval depends on it, or None."""
        ends = (list(_intervals(self.at(value).formula)) for value in (self.low, self.high))
        for one, other in zip(*ends, strict=True):
            if one != other:
                return one.unit or other.unit or self._unit
        return None


def _intervals(formula: rtamt.Formula) -> Iterator[rtamt.Interval]:
    """Yield the interval of each operator, or its default interval."""
    nodes: list[object] = [formula]
    while nodes:
        node = nodes.pop()
        if isinstance(node, rtamt.Formula):
            yield node.interval or rtamt.Interval(Fraction(0), None)
            nodes += node.args


def template(
    requirement: str | rtamt.Specification,
    ranges: Ranges,
    constants: Mapping[str, object] | None = None,
    *,
    every: bool = False,
    text: str = "",
) -> Template:
    """Read a requirement and the range of its parameter.

    The parameter is ``?name`` in a text, or a constant that the text or specification defines. With
    ``every``, the requirement has to hold at every sample, not at the first only. ``text`` is the
    displayed text; empty for the original text.
    """
    if not isinstance(requirement, str | rtamt.Specification):
        raise InputTypeError(
            f"expected the text of a requirement or a specification, got {requirement!r}"
        )
    path = requirement if isinstance(requirement, str) else ""
    if path.endswith(".stl") and len(path.split()) == 1:
        raise SpecificationError(
            f"expected the text of a requirement, got the path {path!r}; write "
            f"Path({path!r}).read_text()"
        )
    if not isinstance(ranges, Mapping):
        raise InputTypeError(
            f'expected the range of a parameter by its name, {{"v": (0, 100)}}, got {ranges!r}'
        )
    if len(ranges) != 1:
        raise InputError(
            f"expected the range of one parameter, got {listing(ranges)}; mine one parameter, and "
            "set the others: ",
            Argument("constants", {"w": 3}),
        )
    ((parameter, ends),) = ranges.items()
    fixed = dict(constants or {})
    if parameter in fixed:
        raise InputError(f"expected {parameter!r} with a range or a value, got both")
    check_parameter(requirement, parameter, fixed)
    low, high = _read_range(parameter, ends)
    return Template(requirement, parameter, low, high, fixed, every=every, text=text)


def check_parameter(
    requirement: str | rtamt.Specification, parameter: str, fixed: Mapping[str, object]
) -> None:
    """Raise InputError for a name that is not a parameter, or a parameter without a value."""
    marked: tuple[str, ...] = ()
    known: Mapping[str, object] = {}
    if isinstance(requirement, rtamt.Specification):
        known = requirement.constants
    else:
        plain, marked = unmarked(requirement)
        if re.search(r"\bconst\b", plain):
            values = dict.fromkeys(marked, 1.0)
            known = rtamt.parse(plain, constants=values).constants
    names = list(dict.fromkeys([*marked, *known]))
    if parameter not in names:
        has = f"; it has {listing(names)}{nearest(parameter, names)}" if names else ""
        raise InputError(
            f"the requirement has no parameter {parameter!r}{has}; write ?{parameter} in place of "
            f"its value, as in always(x < ?{parameter})"
        )
    for name in marked:
        if name not in fixed and name != parameter:
            raise InputError(
                f"the parameter ?{name} has neither a range nor a value; one is mined at a time: "
                "write ",
                Argument("constants", {name: 3}),
            )


def _read_range(parameter: str, ends: object) -> tuple[float, float]:
    """Return the two ends of a range."""
    numbers = list(ends) if isinstance(ends, tuple | list) else []
    if len(numbers) != 2 or not all(isinstance(item, Real) for item in numbers):
        raise InputTypeError(
            f"expected the range of {parameter!r} as two numbers, (0, 100), got {ends!r}"
        )
    low, high = map(float, numbers)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise InputError(
            f"expected the range of {parameter!r} as two finite numbers, the smaller first, got "
            f"{number(low)} and {number(high)}"
        )
    return low, high
