"""Specifications as arguments: formulas, files, and their names."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

import rtamt
from rtamt import InputError, Specification
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.specs import load_file, named_in, requirement_named
from rtamt_gym.options.command_line import Option

if TYPE_CHECKING:
    from rtamt_gym.options.evaluation import EvaluationOptions

_S = TypeVar("_S")


def _read_spec(argument: str, constants: Mapping[str, str]) -> rtamt.Specification:
    """Read a formula or a file; a path does not contain blanks, brackets or comparisons."""
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
    """Read specifications, and give each requirement a unique name.

    An argument may also be the name of a requirement of the system.

    The name of a single requirement comes from the first that exists: ``name=path``, the text, the
    name of the file, or ``spec``, ``spec2`` and so on. Several requirements of a text keep their
    names, after the name in ``name=path``: ``safe.near``.
    """
    specs: dict[str, rtamt.Specification] = {}
    unused = {**(constants or {})}
    for argument in arguments:
        if named := requirement_named(argument, own):
            _add(specs, argument, named)
            continue
        given_name, spec = _read_argument(argument, constants or {})
        for name in spec.overrides:
            unused.pop(name, None)
        if len(spec.requirements) == 1:
            _add(specs, given_name or spec.title or _name(argument, specs), spec)
            continue
        for name, requirement in spec.requirements.items():
            _add(specs, f"{given_name}.{name}" if given_name else name, requirement)
    for name in unused:
        names = [symbol for spec in specs.values() for symbol in (*spec.constants, *spec.variables)]
        raise InputError(
            f"--constant: no specification has the constant {name!r}{nearest(name, names)}"
        )
    return specs


def identified_texts(specs: Mapping[str, rtamt.Specification]) -> list[str]:
    """Return a text for each requirement that another one uses.

    Such a requirement is evaluated on its own because it has an id.
    """
    texts = []
    for name, spec in specs.items():
        users = [
            other
            for other, user in specs.items()
            if user is not spec and user.formulas.get(spec.requirement or "") is spec.formula
        ]
        if users:
            texts.append(
                f"{name} is evaluated on its own, because it has the id {spec.id}; "
                f"{listing(users)} {'uses' if len(users) == 1 else 'use'} it too"
            )
    return texts


def requirements_of(
    arguments: Sequence[str],
    own: Mapping[str, rtamt.Specification],
    system: str,
    option: str = "",
) -> dict[str, rtamt.Specification]:
    """Return the requirements of the arguments, or all of the system without arguments."""
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
    """Return ``requirement iff other``, which is violated where they differ."""
    if text is None:
        return specs
    others = read_requirements([text])
    if len(specs) != 1 or len(others) != 1:
        several = specs if len(specs) != 1 else others
        raise InputError(
            f"--distance: expected one requirement and another one, got {listing(several)}"
        )
    ((name, spec),), (other,) = specs.items(), others.values()
    both = spec.standalone().iff(other.standalone())
    return {f"{name}_apart": spec.with_result(both)}


def read_constants(arguments: Sequence[str]) -> dict[str, str]:
    """Read ``--constant``."""
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
    """Return the requirements that ``--only`` names; all if it names none."""
    for name in names:
        if name not in specs:
            hint = nearest(name, specs) or f"; they are {listing(specs)}"
            raise InputError(f"--only: no requirement is called {name!r}{hint}")
    return {name: spec for name, spec in specs.items() if not names or name in names}


def selected(
    specs: Mapping[str, rtamt.Specification], names: Sequence[str], signals: Mapping[str, _S]
) -> tuple[dict[str, rtamt.Specification], dict[str, _S]]:
    """Return the requirements that ``--only`` names, without the signals of the others."""
    chosen_specs = chosen(specs, names)
    others = {*variables_of(specs)} - {*variables_of(chosen_specs)}
    return chosen_specs, {name: signal for name, signal in signals.items() if name not in others}


def _read_argument(
    argument: str, constants: Mapping[str, str]
) -> tuple[str | None, rtamt.Specification]:
    """Read the name that an argument gives, or None, and the specification."""
    named = re.fullmatch(r"(\w+)=([^\s(<>=!]+\.stl)", argument)
    if named:
        return named[1], _read_spec(named[2], constants)
    return None, _read_spec(argument, constants)


def _name(argument: str, specs: Mapping[str, rtamt.Specification]) -> str:
    """Name a specification that has no name: after its file, or by its number."""
    if argument.endswith(".stl"):
        return shown(Path(argument).stem)
    return f"spec{len(specs) + 1 if specs else ''}"


def _add(specs: dict[str, rtamt.Specification], name: str, spec: rtamt.Specification) -> None:
    if name in specs:
        raise InputError(f"expected one specification {name!r}, got two; rename one")
    specs[name] = spec


def files_of(specs: Sequence[str], policy: str | None = None) -> list[str]:
    """Return the arguments that may be files: specifications, and the model of a policy."""
    paths = [argument.rpartition("=")[2] for argument in specs]
    return paths if policy is None else [*paths, policy.removeprefix("sb3:")]


def variables_of(specs: Mapping[str, rtamt.Specification]) -> list[str]:
    """Return the variables of all specifications, each once."""
    return list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))


STAGE = Option(
    "--stage [NAME:] FORMULA",
    "a stage of the requirement for its progress, in order; of several requirements with "
    "the name: --stage 'task: near > 0' --stage 'task: lifted > 0'",
    default=argparse.SUPPRESS,
    usual="the stages of a requirement that is in order",
    repeat=True,
    dest="stages",
)


def with_stages(
    specs: Mapping[str, Specification], reading: EvaluationOptions
) -> EvaluationOptions:
    """Return the options of evaluation with the stages by the names of their requirements."""
    from rtamt_gym.judging.stages import stages_of

    texts = reading.stages
    if texts is None or isinstance(texts, Mapping):
        return reading
    named: dict[str, list[str]] = {}
    for text in map(str, texts):
        name, stage = _divided(text, specs)
        named.setdefault(name, []).append(stage)
    reading = reading.having(stages=named)
    stages = stages_of(specs, reading)
    for name in named:
        if reading.dense and stages[name].deciders:
            raise InputError(
                f"--stage: stages of {name!r} have temporal operators, and in dense time a stage "
                "is reached at an event by the values there; remove the temporal operators or "
                "--dense"
            )
    return reading


def _divided(text: str, specs: Mapping[str, Specification]) -> tuple[str, str]:
    """Return the requirement of a stage, and its formula."""
    name, colon, stage = (part.strip() for part in text.partition(":"))
    if colon and name in specs:
        return name, stage
    if colon and re.fullmatch(r"[\w.-]+", name):  # not the colon of an interval
        raise InputError(
            f"--stage: expected the name of a requirement, {listing(specs)}, got {name!r}"
            f"{nearest(name, specs)}"
        )
    if len(specs) == 1:
        return next(iter(specs)), text
    raise InputError(
        "--stage: expected the name of a requirement before the formula, as in "
        f"'{next(iter(specs))}: {text}', for there are several: {listing(specs)}"
    )
