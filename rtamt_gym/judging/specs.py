"""The specifications of a system: loading, names, constants, period and unknown first samples."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import rtamt
from rtamt import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt.errors import Argument, MissingFileError, nearest
from rtamt.language import SpecificationTemplate
from rtamt_gym.checks.names import listing
from rtamt_gym.options.evaluation import EvaluationOptions

_V = TypeVar("_V")


def requirement_named(
    text: object, own: Mapping[str, rtamt.Specification]
) -> rtamt.Specification | None:
    """Return the requirement of a system that a text names; None if it is a specification.

    Raises:
        InputError: If the text is similar to the name of a requirement, and no variable has it.

    Example:
        >>> own = rtamt.parse("near = always(gap > 1); slow = always(v < 5)").requirements
        >>> requirement_named("slow", own).formula, requirement_named("gap", own)
        (<Formula always(v < 5)>, None)
    """
    if not isinstance(text, str):
        return None
    if text in own or not text.isidentifier():
        return own.get(text)
    if any(text in spec.variables for spec in own.values()):
        return None
    if meant := nearest(text, own):
        raise InputError(
            f"unknown requirement {text!r}; the requirements are {listing(own)}{meant}"
        )
    return None


def named_in(text: str, constants: Mapping[str, _V]) -> dict[str, _V]:
    """Return the constants that a text names."""
    return {n: value for n, value in constants.items() if re.search(rf"\b{re.escape(n)}\b", text)}


def load_file(
    path: str | Path, constants: Mapping[str, float | str | Fraction]
) -> rtamt.Specification:
    """Return the specification in a file, with the constants that its text names."""
    if not constants:
        return rtamt.load(path)
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        raise MissingFileError(path) from None
    return rtamt.load(path, constants=named_in(text, constants))


SpecLike = str | os.PathLike[str] | rtamt.Formula | rtamt.Specification
"""Text, the path of a ``.stl`` file, a formula built in Python, or a parsed specification."""

SpecsLike = SpecLike | Mapping[str, SpecLike]
"""One specification, or several with their names."""

ConstantValue = float | str | Fraction
"""The value of a constant; a text is an exact decimal number, ``"0.1"``."""


def own_requirements(env: Any) -> Mapping[str, rtamt.Specification]:  # noqa: ANN401 - any system
    """Return the attribute ``requirements`` of an environment: ``{"AT1": rtamt.parse("...")}``."""
    own = getattr(getattr(env, "unwrapped", env), "requirements", None)
    return own if isinstance(own, Mapping) else {}


def load_specs(
    specs: SpecsLike,
    own: Mapping[str, rtamt.Specification] = MappingProxyType({}),
    constants: Mapping[str, ConstantValue] | None = None,
) -> dict[str, rtamt.Specification]:
    """Load the requirements of specifications, by name.

    A text may be the name of a requirement in ``own``. Each specification gets the ``constants``
    that it names.

    Each formula that no other formula of its text uses is a requirement, see
    `rtamt.Specification.requirements`. A single specification names them by its text. In a mapping,
    a specification with one requirement gives it the name of its key, ``"safe"``; with several
    requirements it adds their names: ``"safe.near"``, ``"safe.slow"``.

    Raises:
        SpecificationError: If a specification is wrong; a note names it if there are several.
        InputError: If there is no specification, two requirements have the same name, a text is
            nearly a name in ``own``, or no specification names one of the constants.
        InputTypeError: If a value is not a specification, or the constants are not a mapping.
    """
    values = checked_constants(constants)
    loaded = _load_all(specs, own, values)
    for name in values:
        if all(name not in spec.overrides for spec in loaded.values()):
            raise no_such_constant(name, loaded)
    return loaded


def _load_all(
    specs: SpecsLike,
    own: Mapping[str, rtamt.Specification],
    constants: Mapping[str, ConstantValue],
) -> dict[str, rtamt.Specification]:
    if not isinstance(specs, Mapping):
        named = requirement_named(specs, own)
        if isinstance(specs, str) and named:
            return {specs: _load(named, constants)}
        return dict(_load(specs, constants).requirements)
    if not specs:
        raise InputError("expected at least one specification, got an empty mapping")
    loaded: dict[str, rtamt.Specification] = {}
    for key, spec in specs.items():
        try:
            named = requirement_named(spec, own)
            requirements = _load(spec if named is None else named, constants).requirements
        except RtamtError as error:
            error.add_note(f"in specification {key!r}")
            raise
        for part, requirement in requirements.items():
            name = key if len(requirements) == 1 else f"{key}.{part}"
            if name in loaded:
                raise InputError(f"expected one specification {name!r}, got two; rename one")
            loaded[name] = requirement
    return loaded


def _load(spec: SpecLike, constants: Mapping[str, ConstantValue]) -> rtamt.Specification:
    match spec:
        case rtamt.Specification():
            mine = {name: value for name, value in constants.items() if name in spec.constants}
            return SpecificationTemplate(spec).at(mine) if mine else spec
        case rtamt.Formula():
            return rtamt.Specification.of(spec)
        case os.PathLike():
            return load_file(Path(spec), constants)
        case str() if spec.endswith(".stl") and len(spec.split()) == 1:
            return load_file(Path(spec), constants)
        case str():
            return rtamt.parse(spec, constants=named_in(spec, constants))
    several = '; name several in a mapping, {"safe": "...", "slow": "..."}'
    raise InputTypeError(
        "expected the text of a specification, the path of a .stl file or an "
        f"rtamt.Specification, got {spec!r}{several if isinstance(spec, list | tuple) else ''}"
    )


def recordable(specs: SpecsLike) -> str | dict[str, str]:
    """Return the specifications in a form that ``EnvSpec.to_json`` can write."""
    if isinstance(specs, Mapping):
        return {name: _text(spec) for name, spec in specs.items()}
    return _text(specs)


def _text(spec: SpecLike) -> str:
    return os.fspath(spec) if isinstance(spec, os.PathLike) else str(spec)


def check_period(
    specs: Mapping[str, rtamt.Specification],
    period: rtamt.typing.Period | None,
    system: object,
    why: str = "",
) -> None:
    """Raise SpecificationError if a specification has bounds and the period is unknown.

    ``why`` is the reason why the system has no period.
    """
    timed = next((name for name, spec in specs.items() if spec.timed), None)
    if period is None and timed is not None:
        raise SpecificationError(
            f"specification {timed!r} has bounds in time, but {system} does not state the "
            f"duration of a step{why and f': {why}'}; give ",
            Argument("period"),
            " in seconds, or ",
            Argument("period", 1),
            " if every bound counts steps",
        )


class Constants:
    """The specifications of a monitor, for any values of their constants.

    The text of each is parsed once, at the first change of a constant.

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
        self.are_some = any(spec.constants for spec in specs.values())
        self._templates = templates

    def __reduce__(self) -> tuple[Callable[..., Constants], tuple[object]]:
        return Constants, (dict(self.specs),)

    @property
    def values(self) -> dict[str, float]:
        """The values by name; if several specifications have a name, the value of the first."""
        values: dict[str, float] = {}
        for spec in self.specs.values():
            values = {**spec.constants, **values}
        return values

    def at(self, constants: Mapping[str, ConstantValue]) -> Constants:
        """Return the specifications with these values; other constants keep theirs.

        Raises:
            RtamtError: If no specification uses a constant, or a value does not fit.
        """
        values = checked_constants(constants)
        if self._templates is None:
            having = {name: spec for name, spec in self.specs.items() if spec.constants}
            self._templates = {name: SpecificationTemplate(spec) for name, spec in having.items()}
        unused = set(values)
        specs = dict(self.specs)
        for name, template in self._templates.items():
            # A template starts from the values of the text, so add the current values.
            mine = {n: v for n, v in values.items() if n in template.names}
            unused -= mine.keys()
            current = self.specs[name].overrides
            unchanged = {n: current[n] for n in template.names & current.keys()}
            try:
                specs[name] = template.at({**unchanged, **mine})
            except RtamtError as error:
                if len(self.specs) > 1:
                    error.add_note(f"in specification {name!r}")
                raise
        for name in values:
            if name in unused:
                raise no_such_constant(name, self.specs)
        return self if specs == self.specs else Constants(specs, self._templates)


def checked_constants(
    constants: Mapping[str, ConstantValue] | None,
) -> Mapping[str, ConstantValue]:
    """Return values of constants by name; raise InputTypeError for another type."""
    values: object = {} if constants is None else constants
    if not isinstance(values, Mapping):
        raise InputTypeError(
            "expected values of constants by name, such as ",
            Argument("constants", {"limit": 0.3}),
            f", got {constants!r}",
        )
    return values


def no_such_constant(name: str, specs: Mapping[str, rtamt.Specification]) -> InputError:
    """Return the error about a constant that no specification has."""
    known = list(dict.fromkeys(other for spec in specs.values() for other in spec.constants))
    variables = [other for spec in specs.values() for other in spec.variables if other != name]
    listed = f"; their constants are {', '.join(known)}" if known else "; they have none"
    near = nearest(name, (*known, *variables))
    return InputError(f"constants: no specification uses the constant {name!r}{near or listed}")


def with_unknown_start(
    reading: EvaluationOptions, signals: Mapping[str, Any], *needs: Argument
) -> tuple[EvaluationOptions, bool]:
    """Return the options of monitors, and whether the reader of the signals must refuse nan.

    Monitors with a first sample that may be unknown, ``("action[0]", None)``, take nan as unknown.
    If the options refuse nan, the reader must refuse it.

    Raises:
        InputError: If an argument in ``needs``, or an option, does not allow an unknown sample.
    """
    from rtamt_gym.signals.signals import unknown_at_reset  # it imports Gymnasium

    names = unknown_at_reset(signals)
    if not names or reading.nan == "unknown":
        return reading, False
    if reading.nan == "hold":
        needs = (Argument("nan", "hold"),)
        why = "needs a first value to keep"
    else:
        needs += (Argument("view", "step"),) * (reading.view == "step")
        why = "needs the robustness of every instant"
    if needs:
        raise InputError(
            f"signal {names[0]!r}: None at reset leaves its first sample unknown, and ",
            needs[0],
            f" {why}; expected a number in the place of None",
        )
    return reading.having(nan="unknown"), True
