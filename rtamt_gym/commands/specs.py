"""Specifications as arguments: formulas, files, and their names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import rtamt
from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.requirements import load_file, named_in, requirement_named


def _read_spec(argument: str, constants: Mapping[str, str]) -> rtamt.Specification:
    """Reads a formula or the path of a file; a path has no blank, bracket or comparison."""
    if re.search(r"[\s(<>=!]", argument) and not _is_file(argument):
        return rtamt.parse(argument, constants=named_in(argument, constants))
    return load_file(argument, constants)


def _is_file(argument: str) -> bool:
    try:
        return Path(argument).is_file()
    except OSError:  # a formula may be longer than a file's name can be
        return False


def read_requirements(
    arguments: Sequence[str],
    constants: Mapping[str, str] | None = None,
    own: Mapping[str, rtamt.Specification] = MappingProxyType({}),
) -> dict[str, rtamt.Specification]:
    """Reads specifications, and gives every requirement in them a name of its own.

    An argument that names a requirement of the system stands for that requirement.

    A text with a single requirement gives it the name in ``name=path``, else its name in the text,
    else the name of the file, else ``spec``, ``spec2`` and so on. Several requirements of a text
    keep their names in it, behind the name in ``name=path``: ``safe.near``.

    Args:
        arguments: Formulas and paths of files, ``name=path`` too.
        constants: Values of constants; each text gets those that it names.
        own: The requirements that the system has of its own, by name.

    Raises:
        InputError: If two requirements have the same name, an argument is nearly the name of one in
            ``own``, or no text has one of the constants.
    """
    specs: dict[str, rtamt.Specification] = {}
    unused = {**(constants or {})}
    for argument in arguments:
        if named := requirement_named(argument, own):
            _add(specs, argument, named)
            continue
        given, spec = _read_argument(argument, constants or {})
        for name in spec.given:
            unused.pop(name, None)
        if len(spec.requirements) == 1:
            _add(specs, given or spec.title or _name(argument, specs), spec)
            continue
        for name, requirement in spec.requirements.items():
            _add(specs, f"{given}.{name}" if given else name, requirement)
    for name in unused:
        known = [each for spec in specs.values() for each in (*spec.constants, *spec.variables)]
        raise InputError(
            f"--constant: no specification has the constant {name!r}{nearest(name, known)}"
        )
    return specs


def identified_texts(specs: Mapping[str, rtamt.Specification]) -> list[str]:
    """Return a text for each requirement that another one uses.

    It is judged on its own because it has an id.
    """
    texts = []
    for name, spec in specs.items():
        users = [
            other
            for other, its in specs.items()
            if its is not spec and its.formulas.get(spec.requirement or "") is spec.formula
        ]
        if users:
            texts.append(
                f"{name} is judged on its own, because it has the id {spec.id}; "
                f"{listing(users)} {'uses' if len(users) == 1 else 'use'} it too"
            )
    return texts


def requirements_of(
    arguments: Sequence[str],
    own: Mapping[str, rtamt.Specification],
    system: str,
    option: str = "",
) -> dict[str, rtamt.Specification]:
    """The requirements that arguments name or write; of no arguments, all of the system's own.

    Args:
        arguments: Names of the system's own, formulas and paths of files.
        own: The requirements that the system has of its own, by name.
        system: The name of the system.
        option: The option that the arguments belong to, for the message.

    Raises:
        InputError: If there are none, or as `read_requirements` does.
    """
    if not arguments and not own:
        example = f"{option} 'always(x < 1)'".strip()
        raise InputError(f"{system} has no requirements of its own; write {example}")
    for argument in arguments:
        # A formula has other characters.
        if own and argument.isidentifier() and argument not in own and not _is_file(argument):
            raise InputError(
                f"{system} has no requirement {argument!r}; it has {listing(own)}"
                f"{nearest(argument, own)}"
            )
    return read_requirements(arguments or list(own), own=own)


def told_apart(
    specs: Mapping[str, rtamt.Specification], text: str | None
) -> Mapping[str, rtamt.Specification]:
    """``requirement iff other`` in place of a requirement, which is violated where they differ.

    Args:
        specs: The requirements.
        text: The other, which ``--apart`` gives; None: the requirements stay as they are.

    Raises:
        InputError: If there are several requirements, or several others.
    """
    if text is None:
        return specs
    others = read_requirements([text])
    if len(specs) != 1 or len(others) != 1:
        several = specs if len(specs) != 1 else others
        raise InputError(
            f"--apart: expected one requirement and another one, got {listing(several)}"
        )
    ((name, spec),), (other,) = specs.items(), others.values()
    both = spec.standalone().iff(other.standalone())
    return {f"{name}_apart": spec.with_result(both)}


def read_constants(arguments: Sequence[str]) -> dict[str, str]:
    """Reads ``--constant``.

    Raises:
        InputError: If an argument has no value, or a name comes twice.
    """
    constants: dict[str, str] = {}
    for argument in arguments:
        name, _, value = (part.strip() for part in argument.partition("="))
        if not (name.isidentifier() and value):
            raise InputError(
                f"--constant: expected NAME=VALUE, such as limit=0.3, got {argument!r}"
            )
        if name in constants:
            raise InputError(f"--constant: expected one {name!r}, got two")
        constants[name] = value
    return constants


def chosen(
    specs: Mapping[str, rtamt.Specification], names: Sequence[str]
) -> dict[str, rtamt.Specification]:
    """The requirements that ``--only`` names; all if it names none.

    Raises:
        InputError: If there is none of a name.
    """
    for name in names:
        if name not in specs:
            hint = nearest(name, specs) or f"; they are {listing(specs)}"
            raise InputError(f"--only: no requirement is called {name!r}{hint}")
    return {name: spec for name, spec in specs.items() if not names or name in names}


def _read_argument(
    argument: str, constants: Mapping[str, str]
) -> tuple[str | None, rtamt.Specification]:
    """Reads the name that an argument gives, or None, and the specification."""
    named = re.fullmatch(r"(\w+)=([^\s(<>=!]+\.stl)", argument)
    if named:
        return named[1], _read_spec(named[2], constants)
    return None, _read_spec(argument, constants)


def _name(argument: str, specs: Mapping[str, rtamt.Specification]) -> str:
    """Names a specification that has no name: after its file, or by its number."""
    if argument.endswith(".stl"):
        return shown(Path(argument).stem)
    return f"spec{len(specs) + 1 if specs else ''}"


def _add(specs: dict[str, rtamt.Specification], name: str, spec: rtamt.Specification) -> None:
    if name in specs:
        raise InputError(f"expected one specification {name!r}, got two; name one of them")
    specs[name] = spec


def files_of(specs: Sequence[str], policy: str | None = None) -> list[str]:
    """The arguments that may be files: those of specifications, and of the model of a policy."""
    paths = [argument.rpartition("=")[2] for argument in specs]
    return paths if policy is None else [*paths, policy.removeprefix("sb3:")]


def variables_of(specs: Mapping[str, rtamt.Specification]) -> list[str]:
    """The variables of all specifications, each once."""
    return list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))
