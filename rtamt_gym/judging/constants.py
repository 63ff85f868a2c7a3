"""Constants of specifications, which change between the episodes of an environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction

import rtamt
from rtamt import InputError, InputTypeError, RtamtError, SpecificationTemplate
from rtamt.errors import Argument, nearest

__all__ = ["ConstantValue", "Constants", "checked_constants", "no_such_constant"]

ConstantValue = float | str | Fraction
"""The value of a constant; a text is an exact decimal number, ``"0.1"``."""


class Constants:
    """The specifications of a monitor, for any values of their constants.

    The text of each is read once, when a constant changes for the first time.

    Attributes:
        specs: The specifications by name, with the values that hold.

    Args:
        specs: The specifications by name.

    Example:
        >>> before = Constants({"near": rtamt.parse("const float d = 2; always(x < d)")})
        >>> after = before.at({"d": 3})
        >>> before.values, after.values, str(after.specs["near"].formula)
        ({'d': 2.0}, {'d': 3.0}, 'always(x < 3)')
    """

    def __init__(
        self,
        specs: Mapping[str, rtamt.Specification],
        templates: Mapping[str, SpecificationTemplate] | None = None,
    ) -> None:
        self.specs = specs
        self._templates = templates

    def __reduce__(self) -> tuple[Callable[..., Constants], tuple[object]]:
        return Constants, (dict(self.specs),)

    @property
    def values(self) -> dict[str, float]:
        """The values by name; where several specifications have the name, the first one's."""
        found: dict[str, float] = {}
        for spec in self.specs.values():
            found = {**spec.constants, **found}
        return found

    def at(self, constants: Mapping[str, ConstantValue]) -> Constants:
        """The specifications with these values; constants that are not named keep theirs.

        A constant of several specifications is changed in all.

        Raises:
            InputError: If no specification has one of the constants, or none uses it.
            InputTypeError: If the values are no mapping.
            SpecificationError: If a value is no number, or makes no interval or range.
        """
        given = checked_constants(constants)
        if self._templates is None:
            having = {name: spec for name, spec in self.specs.items() if spec.constants}
            self._templates = {name: SpecificationTemplate(spec) for name, spec in having.items()}
        unused = set(given)
        specs = dict(self.specs)
        for name, template in self._templates.items():
            # From the values that hold: a template is of those of the beginning.
            mine = {n: v for n, v in given.items() if n in template.names}
            unused -= mine.keys()
            try:
                specs[name] = template.at({**self._held(name, template), **mine})
            except RtamtError as error:
                if len(self.specs) > 1:
                    error.add_note(f"in specification {name!r}")
                raise
        for name in given:
            if name in unused:
                raise no_such_constant(name, self.specs)
        return self if specs == self.specs else Constants(specs, self._templates)

    def _held(self, name: str, template: SpecificationTemplate) -> dict[str, Fraction]:
        given = self.specs[name].given
        return {n: given[n] for n in template.names & given.keys()}


def checked_constants(
    constants: Mapping[str, ConstantValue] | None,
) -> Mapping[str, ConstantValue]:
    """Values of constants by name; raises an `InputTypeError` for what is none."""
    given: object = {} if constants is None else constants
    if not isinstance(given, Mapping):
        raise InputTypeError(
            "expected values of constants by name, such as ",
            Argument("constants", {"limit": 0.3}),
            f", got {constants!r}",
        )
    return given


def no_such_constant(
    name: str, specs: Mapping[str, rtamt.Specification], option: str = "constants"
) -> InputError:
    """The error about the name of a constant that no specification has."""
    known = list(dict.fromkeys(each for spec in specs.values() for each in spec.constants))
    others = [each for spec in specs.values() for each in spec.variables if each != name]
    listed = f"; their constants are {', '.join(known)}" if known else "; they have none"
    near = nearest(name, (*known, *others))
    return InputError(f"{option}: no specification uses the constant {name!r}{near or listed}")
