"""What is required of a system: names of its own requirements, texts, or several of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import rtamt
from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.specs import SpecLike, load_specs

__all__ = ["Requirements", "load_requirements"]

Requirements = SpecLike | Sequence[str] | Mapping[str, SpecLike]
"""A requirement or several: the name of one that the system has (``"AT6a"``), a specification as
for `rtamt_gym.simulate`, a sequence of names and texts, or a mapping from names to specifications.
"""


def load_requirements(
    given: Requirements | None, own: Mapping[str, rtamt.Specification], system: str
) -> dict[str, rtamt.Specification]:
    """Loads requirements, by name.

    Args:
        given: What is required; None: all that the system has of its own.
        own: The requirements that the system has, by name.
        system: The name of the system.

    Raises:
        SpecificationError: If a specification is wrong.
        InputError: If none is given and the system has none, or two have one name.
        InputTypeError: If one is no specification.
    """
    if given is None:
        if not own:
            raise InputError(
                f"{system} has no requirements of its own; give them after the system, such as "
                '"always(x < 1)"'
            )
        return dict(own)
    if isinstance(given, Mapping):
        return load_specs({name: _own(spec, own) for name, spec in given.items()})
    if not isinstance(given, Sequence) or isinstance(given, str):
        return _named(given, own, system)
    if not given:
        raise InputError("expected one requirement at least, got none")
    loaded: dict[str, rtamt.Specification] = {}
    for each in given:
        for name, spec in _named(each, own, system).items():
            # Formulas without a name are called "spec", "spec2" and so on.
            new = f"{name}{len(loaded) + 1}" if name in loaded and name == "spec" else name
            if new in loaded:
                raise InputError(f"expected one requirement {new!r}, got two; name them: {{...}}")
            loaded[new] = spec
    return loaded


def _own(spec: Any, own: Mapping[str, rtamt.Specification]) -> Any:  # noqa: ANN401
    return own[spec] if isinstance(spec, str) and spec in own else spec


def _named(
    given: Any,  # noqa: ANN401 - what is no specification is refused
    own: Mapping[str, rtamt.Specification],
    system: str,
) -> dict[str, rtamt.Specification]:
    if isinstance(given, str):
        if given in own:
            return {given: own[given]}
        if given.isidentifier():
            raise InputError(
                f"{system} has no requirement {given!r}; it has {listing(own)}{nearest(given, own)}"
            )
    if isinstance(given, bytes | int | float):
        raise InputTypeError(f"expected the name or the text of a requirement, got {given!r}")
    return load_specs(given)
