"""From text to a `Specification`."""

from __future__ import annotations

import copyreg
import importlib
import sys
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from functools import lru_cache
from os import PathLike
from types import SimpleNamespace
from typing import cast

from rtamt.errors import (
    InputTypeError,
    MissingFileError,
    SpecificationError,
    brief,
    is_one_of,
    nearest,
)
from rtamt.language.formula import Formula, Term, variable
from rtamt.language.interval import UNITS, Exact, exact, no_unit
from rtamt.language.specification import Specification

__all__ = ["MAX_TEXT", "as_specification", "load", "no_constant", "parse", "parse_as", "traced"]

MAX_TEXT = 150_000
"""The most characters of a text."""

Modules = Mapping[str, object] | Iterable[str]
"""Modules by name, or names of modules that may be imported."""


def parse(
    text: str,
    *,
    unit: str = "s",
    constants: Mapping[str, Exact] | None = None,
    modules: Modules | None = None,
) -> Specification:
    """The specification of a text.

    Parsing is cached by text and arguments, unless `modules` are given.

    Args:
        text: One formula or more, declarations, constants.
        unit: Unit of the bounds that have none: s, ms, us, ns, ps, min or h.
        constants: Values of constants that the text uses. They override those that it defines: a
            threshold ``const float limit = 0.2`` is swept with ``constants={"limit": 0.3}``.
        modules: The modules from which the text imports types: by name, or names of modules to
            import. A text itself imports nothing: without modules its types are names only, and
            messages of any class are taken.

    Raises:
        ParseError: If the text is not a specification, with line, column and the way out.
        SpecificationError: If an argument is wrong, the text has none of the constants, or it is
            longer than 150,000 characters.
        ImportError: If a module that is named cannot be imported.

    Example:
        >>> spec = parse("always((req >= 3) -> F[0:5](gnt >= 3))")
        >>> print(spec)
        always(req >= 3 implies eventually[0:5](gnt >= 3))
        >>> spec.variables, spec.horizon
        (('req', 'gnt'), inf)
    """
    if not isinstance(constants, Mapping | None):
        msg = f"expected values of constants by name, got {brief(constants)}"
        raise InputTypeError(f'{msg}; write constants={{"limit": 0.3}}')
    if isinstance(modules, str):
        msg = f"expected modules by name or names of modules, got {modules!r}; write [{modules!r}]"
        raise InputTypeError(msg)
    if modules is not None and not isinstance(modules, Mapping):
        modules = {name: importlib.import_module(name) for name in _module_names(modules)}
    spec = parse_as(text, unit, constants or {}, modules, chains=False)
    for name in constants or {}:
        if name not in spec.overrides:
            raise no_constant(name, spec)
    return spec


def no_constant(name: str, spec: Specification) -> SpecificationError:
    """The error about the name of a constant that a text does not have."""
    known = f"; its constants are {', '.join(spec.constants)}" if spec.constants else ""
    others = (each for each in spec.variables if each != name)
    near = nearest(name, (*spec.constants, *others))
    return SpecificationError(f"the text has no constant '{name}'{near or known}")


def _module_names(modules: Iterable[str]) -> list[str]:
    given: object = modules
    names: list[object] = [None]
    if isinstance(given, Iterable) and getattr(given, "ndim", None) != 0:
        names = list(given)
    if not all(isinstance(name, str) for name in names):
        msg = f"expected modules by name or names of modules, got {brief(modules)}"
        raise InputTypeError(msg)
    return cast("list[str]", names)


def parse_as(
    text: str,
    unit: str,
    constants: Mapping[str, Exact],
    modules: Mapping[str, object] | None,
    *,
    chains: bool,
) -> Specification:
    """The specification of a text in a dialect of the language.

    Args:
        text: As `parse` takes it.
        unit: As `parse` takes it.
        constants: As `parse` takes them; those that the text does not have are ignored.
        modules: The modules that the text may import from; None: types are names only.
        chains: Whether ``p implies q implies r`` is ``(p implies q) implies r``, and ``until``,
            ``since`` and ``unless`` alike, and whether a named result may be a number; in the
            language itself these are errors.

    Raises:
        ParseError: As `parse` does.
        SpecificationError: As `parse` does.
    """
    if not isinstance(text, str):
        msg = f"expected the text of a specification, got {type(text).__name__} {brief(text)}"
        raise InputTypeError(msg)
    if len(text) > MAX_TEXT:
        msg = f"the text has {len(text)} characters; the limit is {MAX_TEXT}"
        raise SpecificationError(f"{msg}; write several specifications")
    return _parsed(text, unit, constants, modules, chains=chains)


def _parsed(
    text: str,
    unit: str,
    constants: Mapping[str, Exact],
    modules: Mapping[str, object] | None,
    *,
    chains: bool,
) -> Specification:
    """Parses a text of any length: a pickle of a formula made in Python may exceed the limit."""
    if not is_one_of(unit, UNITS):
        raise SpecificationError(no_unit(unit))
    for name in constants:
        if not isinstance(name, str):
            msg = f"expected names of constants as text, got {type(name).__name__} {brief(name)}"
            raise InputTypeError(msg)
        variable(name)  # raises if the text could not have the name
    given = tuple((n, exact(v, f"the constant '{n}'")) for n, v in constants.items())
    if modules:
        return _read(text, unit, given, modules, chains=chains)
    return _cached(text, unit, given, chains, modules is not None)


def load(
    path: str | PathLike[str],
    *,
    unit: str = "s",
    constants: Mapping[str, Exact] | None = None,
    modules: Modules | None = None,
) -> Specification:
    """The specification in a file, read as UTF-8; see `parse`.

    Raises:
        MissingFileError: If there is no such file; it is an `InputError` and a `FileNotFoundError`.
        OSError: If the file cannot be read.
        SpecificationError: As `parse` does, with a note that names the file; or if it is not UTF-8.
    """
    from pathlib import Path  # 5 ms of every import of the package

    if not isinstance(path, str | PathLike):
        raise InputTypeError(f"expected the path of a file as text or a Path, got {brief(path)}")
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        return parse(text, unit=unit, constants=constants, modules=modules)
    except FileNotFoundError:
        raise MissingFileError(path) from None
    except UnicodeDecodeError as error:
        msg = f"expected UTF-8 text in {path}, got the byte {error.object[error.start]:#04x}"
        raise SpecificationError(msg) from None
    except SpecificationError as error:
        error.add_note(f"in {path}")
        raise


def as_specification(spec: str | Formula | Specification) -> Specification:
    """The specification that a monitor was given, as text, formula or specification."""
    if isinstance(spec, Specification):
        return spec
    if isinstance(spec, Formula):
        return Specification.of(spec)
    if isinstance(spec, str):
        if spec.endswith(".stl") and len(spec.split()) == 1:
            msg = f"expected the text of a specification, got the path {spec!r}"
            raise SpecificationError(f"{msg}; write load({spec!r})")
        return parse(spec)
    msg = f"expected a specification as text, Formula or Specification, got {type(spec).__name__}"
    raise InputTypeError(msg)


def traced(spec: Specification) -> Specification:
    """The specification with `Traced` numbers in place of its text's constants in terms.

    One that was made in Python has no constants, so nothing is traced.
    """
    from rtamt.language.grammar.statements import read_specification

    whole = read_specification(
        spec.text, spec.unit, spec.overrides, None, chains=spec.chains, traced=True
    )
    return whole if spec.requirement is None else whole.requirements[spec.requirement]


# A pickle is the text: it is short, and equal trees stay one object. It is registered here because
# the parser reads it.


def _term_from_text(text: str) -> Term:
    return cast("Term", _formula_from_text(text).args[0])


def _formula_from_text(text: str) -> Formula:
    return _parsed(text, "s", {}, None, chains=False).formula


def _specification_from_text(
    text: str,
    unit: str,
    given: dict[str, Fraction],
    chains: bool,  # noqa: FBT001 - in a pickle arguments have no names
    imports: dict[str, tuple[str, type | None]],
    requirement: str | None = None,
) -> Specification:
    modules: dict[str, SimpleNamespace] = {}
    for name, (module, kind) in imports.items():
        vars(modules.setdefault(module, SimpleNamespace()))[name] = kind
    classes = any(kind is not None for _, kind in imports.values())
    spec = _parsed(text, unit, given, modules if classes else None, chains=chains)
    return spec if requirement is None else spec.requirements[requirement]


def _reduced(spec: Specification) -> tuple[Callable[..., Specification], tuple[object, ...]]:
    # A type that another process could not import by its name is kept as a name only.
    imports = {
        name: (module, _by_name(spec.types.get(name))) for name, module in spec.imports.items()
    }
    given = dict(spec.overrides)
    arguments = (spec.text, spec.unit, given, spec.chains, imports, spec.requirement)
    return _specification_from_text, arguments


def _by_name(kind: type | None) -> type | None:
    found: object = None if kind is None else sys.modules.get(kind.__module__)
    for step in kind.__qualname__.split(".") if kind is not None else ():
        found = getattr(found, step, None)
    return kind if found is kind else None


copyreg.pickle(Term, lambda term: (_term_from_text, (str(term),)))
copyreg.pickle(Formula, lambda formula: (_formula_from_text, (str(formula),)))
copyreg.pickle(Specification, _reduced)


def _read(
    text: str,
    unit: str,
    given: tuple[tuple[str, Fraction], ...],
    modules: Mapping[str, object] | None,
    *,
    chains: bool,
) -> Specification:
    from rtamt.language.grammar.statements import read_specification

    return read_specification(text, unit, dict(given), modules, chains=chains)


@lru_cache(maxsize=512)
def _cached(
    text: str,
    unit: str,
    given: tuple[tuple[str, Fraction], ...],
    chains: bool,  # noqa: FBT001 - keys of the cache
    closed: bool,  # noqa: FBT001
) -> Specification:
    return _read(text, unit, given, {} if closed else None, chains=chains)
