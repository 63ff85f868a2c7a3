"""From text to a `Specification`, and to a template for any values of its constants."""

from __future__ import annotations

import copyreg
import importlib
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, lru_cache
from os import PathLike, fspath
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
from rtamt.language.declarations import Declaration
from rtamt.language.formula import Formula, Term, make, number, variable
from rtamt.language.interval import UNITS, Exact, Traced, TracedInterval, exact, no_unit
from rtamt.language.node import Node
from rtamt.language.specification import Specification

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
    """Return the specification of a text.

    Parsing is cached by text and arguments, unless `modules` are passed.

    Args:
        text: One formula or more, declarations, constants.
        unit: Unit of bounds without a unit: s, ms, us, ns, ps, min or h.
        constants: Values of constants in the text. They override its own definitions:
            ``constants={"limit": 0.3}`` sweeps a threshold ``const float limit = 0.2``.
        modules: The modules of the types that the text imports: modules by name, or names of
            modules to import. A text imports nothing itself: without modules its types are only
            names, and messages of any class are accepted.

    Raises:
        ParseError: If the text is not a specification, with line, column and hint.
        SpecificationError: If an argument is wrong, the text does not have a constant, or it is
            longer than 150,000 characters.
        ImportError: If a named module cannot be imported.

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
    """Return the error about the name of a constant that a text does not have."""
    known = f"; its constants are {', '.join(spec.constants)}" if spec.constants else ""
    others = (variable for variable in spec.variables if variable != name)
    near = nearest(name, (*spec.constants, *others))
    return SpecificationError(f"the text has no constant '{name}'{near or known}")


def _module_names(modules: Iterable[str]) -> list[str]:
    argument: object = modules
    names: list[object] = [None]
    if isinstance(argument, Iterable) and getattr(argument, "ndim", None) != 0:
        names = list(argument)
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
    limited: bool = True,
) -> Specification:
    """Return the specification of a text in a dialect of the language.

    Args:
        text: As for `parse`.
        unit: As for `parse`.
        constants: As for `parse`; unknown names are ignored.
        modules: The modules that the text may import from; None: types are only names.
        chains: Whether ``p implies q implies r`` is ``(p implies q) implies r``, the same for
            ``until``, ``since`` and ``unless``, and whether a named result may be a number. These
            are errors in the language itself.
        limited: Whether a long text is an error; the text of a formula from Python may be longer.
    """
    if not isinstance(text, str):
        msg = f"expected the text of a specification, got {type(text).__name__} {brief(text)}"
        raise InputTypeError(msg)
    if limited and len(text) > MAX_TEXT:
        msg = f"the text has {len(text)} characters; the limit is {MAX_TEXT}"
        raise SpecificationError(f"{msg}; write several specifications")
    if not is_one_of(unit, UNITS):
        raise SpecificationError(no_unit(unit))
    for name in constants:
        if not isinstance(name, str):
            msg = f"expected names of constants as text, got {type(name).__name__} {brief(name)}"
            raise InputTypeError(msg)
        variable(name)  # raises if the text could not have the name
    overrides = tuple((n, exact(v, f"the constant '{n}'")) for n, v in constants.items())
    if modules:
        from rtamt.language.grammar.reader import TextReader

        return TextReader(text, dict(overrides), modules, chains=chains).specification(unit)
    return _cached(text, unit, overrides, chains, modules is not None)


@lru_cache(maxsize=512)
def _cached(
    text: str,
    unit: str,
    overrides: tuple[tuple[str, Fraction], ...],
    chains: bool,  # noqa: FBT001 - keys of the cache
    closed: bool,  # noqa: FBT001
) -> Specification:
    from rtamt.language.grammar.reader import TextReader

    modules = dict[str, object]() if closed else None
    return TextReader(text, dict(overrides), modules, chains=chains).specification(unit)


def load(
    path: str | PathLike[str],
    *,
    unit: str = "s",
    constants: Mapping[str, Exact] | None = None,
    modules: Modules | None = None,
) -> Specification:
    """Return the specification in a UTF-8 file; see `parse`.

    Raises:
        MissingFileError: If the file does not exist; it is an `InputError` and a
            `FileNotFoundError`.
        OSError: If the file cannot be read.
        SpecificationError: As for `parse`, with a note that names the file; or if the file is not
            UTF-8.
    """
    from pathlib import Path  # 5 ms of every import of the package

    if not isinstance(path, str | PathLike):
        raise InputTypeError(f"expected the path of a file as text or a Path, got {brief(path)}")
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        specification = parse(text, unit=unit, constants=constants, modules=modules)
        return replace(specification, path=fspath(path))
    except FileNotFoundError:
        raise MissingFileError(path) from None
    except UnicodeDecodeError as error:
        msg = f"expected UTF-8 text in {path}, got the byte {error.object[error.start]:#04x}"
        raise SpecificationError(msg) from None
    except SpecificationError as error:
        error.add_note(f"in {path}")
        raise


def as_specification(spec: str | Formula | Specification) -> Specification:
    """Return a text, a formula or a specification as a specification."""
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
    """Return the specification with `Traced` numbers as the constants of its text in terms."""
    from rtamt.language.grammar.reader import TextReader

    reader = TextReader(spec.text, spec.overrides, chains=spec.chains, traced=True)
    text = reader.specification(spec.unit)
    return text if spec.requirement is None else text.requirements[spec.requirement]


class SpecificationTemplate:
    """A specification for any values of its constants; its text is parsed once.

    The constructor parses the text, and `at` replaces the constants in terms and bounds by numbers.

    Args:
        spec: Text, formula or specification. Constants passed to `rtamt.parse` count as well.

    Raises:
        SpecificationError: If the text is not a specification.

    Example:
        >>> from rtamt.language import SpecificationTemplate
        >>> template = SpecificationTemplate(
        ...     "const float w = 2; always(x > w or eventually[0:w](y > 0))"
        ... )
        >>> print(template.at({"w": 3}))
        const float w = 3
        always(x > 3 or eventually[0:3](y > 0))
        >>> sorted(template.names)
        ['w']
    """

    def __init__(self, spec: str | Formula | Specification) -> None:
        from rtamt.language.grammar.reader import TextReader

        self._spec = specification = as_specification(spec)
        self._reader = TextReader(
            specification.text,
            specification.overrides,
            chains=specification.chains,
            traced=True,
            traced_bounds=True,
        )
        self._traced = self._reader.specification(specification.unit)
        self._dependent = _dependent(self._traced)

    def __reduce__(self) -> tuple[Callable[..., SpecificationTemplate], tuple[Specification]]:
        return SpecificationTemplate, (self._spec,)

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of the constants that formulas or ranges of the text use."""
        used = {*self._reader.ranging}
        for node in self._dependent:
            for part in (node.leaf, node.interval):
                if isinstance(part, Traced | TracedInterval):
                    used |= part.constants
        return frozenset(used)

    def at(self, constants: Mapping[str, Exact]) -> Specification:
        """Return the specification with these values; the other constants keep theirs.

        It equals the result of `rtamt.parse` for the text and the values.

        Raises:
            SpecificationError: If the text does not define or use a constant, or if a value is not
                a number or leads to a wrong interval or range.
            InputTypeError: If the values are not a mapping.
        """
        if not isinstance(constants, Mapping):
            msg = f"expected values of constants by name, got {brief(constants)}"
            raise InputTypeError(f'{msg}; write {{"limit": 0.3}}')
        for name in constants:
            if name not in self._reader.constants:
                raise no_constant(name, self._spec)
            if name not in self.names:
                msg = f"nothing in the text uses the constant '{name}'"
                raise SpecificationError(msg)
        new = {name: exact(value, f"the constant '{name}'") for name, value in constants.items()}
        overrides = {**self._spec.overrides, **new}
        others = {n: v for n, v in self._reader.constants.items() if n not in overrides}
        specification = self._filled(overrides, {**overrides, **others})
        part = self._spec.requirement
        if part is None:
            return specification
        if part not in specification.requirements:
            msg = (
                f"with these constants the requirement '{part}' equals another one: "
                f"{specification.formula}"
            )
            raise SpecificationError(msg)
        return specification.requirements[part]

    def _filled(
        self, overrides: Mapping[str, Fraction], values: Mapping[str, Fraction]
    ) -> Specification:
        traced, new = self._traced, dict[Node, Node]()
        for node in self._dependent:
            new[node] = self._replaced(node, new, values)
        positions: dict[Node, tuple[int, int]] = {}
        for node, position in traced.positions.items():
            positions.setdefault(new.get(node, node), position)
        declarations: dict[str, Declaration] = dict(traced.declarations)
        for name, range_of in self._reader.ranges.items():
            declarations[name] = replace(declarations[name], range=range_of(values))
        return replace(
            traced,
            formula=cast("Formula", new.get(traced.formula, traced.formula)),
            formulas={n: cast("Formula", new.get(f, f)) for n, f in traced.formulas.items()},
            declarations=declarations,
            constants={name: float(value) for name, value in values.items()},
            overrides=overrides,
            types=self._spec.types,
            positions=positions,
            path=self._spec.path,
        )

    def _replaced(
        self, node: Node, new: Mapping[Node, Node], values: Mapping[str, Fraction]
    ) -> Node:
        """Return a node with numbers in place of the constants; `new` has its operands."""
        if node.op is None:
            return number(float(values[cast("Traced", node.leaf).source]))
        interval, traced = node.interval, node.interval
        if isinstance(traced, TracedInterval):
            try:
                interval = traced.at(values)
            except SpecificationError as error:
                names = sorted(traced.constants)
                bounds = ", ".join(f"{name} = {float(values[name]):g}" for name in names)
                raise self._traced.error(node, str(error), f"with {bounds}") from None
        return make(node.op.name, tuple(new.get(arg, arg) for arg in node.args), interval)


def _dependent(traced: Specification) -> list[Node]:
    """Return the nodes that depend on constants, operands before their operator."""
    dependent: dict[Node, None] = {}
    nodes = (*traced.nodes(), *(node for root in traced.positions for node in root.nodes()))
    for node in dict.fromkeys(nodes):
        own = isinstance(node.leaf, Traced) or isinstance(node.interval, TracedInterval)
        if own or any(arg in dependent for arg in node.args):
            dependent[node] = None
    return list(dependent)


# A pickle is the text: it is short, and equal trees stay one object. Pickling is registered here
# because it needs the parser.


def _term_from_text(text: str) -> Term:
    return cast("Term", _formula_from_text(text).args[0])


def _formula_from_text(text: str) -> Formula:
    return parse_as(text, "s", {}, None, chains=False, limited=False).formula


def _specification_from_text(
    text: str,
    unit: str,
    overrides: dict[str, Fraction],
    chains: bool,  # noqa: FBT001 - in a pickle arguments have no names
    imports: dict[str, tuple[str, type | None]],
    requirement: str | None = None,
    path: str | None = None,
) -> Specification:
    modules: dict[str, SimpleNamespace] = {}
    for name, (module, kind) in imports.items():
        vars(modules.setdefault(module, SimpleNamespace()))[name] = kind
    classes = any(kind is not None for _, kind in imports.values())
    known = modules if classes else None
    spec = parse_as(text, unit, overrides, known, chains=chains, limited=False)
    spec = spec if path is None else replace(spec, path=path)
    return spec if requirement is None else spec.requirements[requirement]


def _reduced(spec: Specification) -> tuple[Callable[..., Specification], tuple[object, ...]]:
    # A type that another process could not import by its name becomes a name only.
    imports = {
        name: (module, _importable(spec.types.get(name))) for name, module in spec.imports.items()
    }
    overrides = dict(spec.overrides)
    arguments = (spec.text, spec.unit, overrides, spec.chains, imports, spec.requirement, spec.path)
    return _specification_from_text, arguments


def _importable(kind: type | None) -> type | None:
    if kind is None:
        return None
    named: object = sys.modules.get(kind.__module__)
    for step in kind.__qualname__.split("."):
        named = getattr(named, step, None)
    return kind if named is kind else None


copyreg.pickle(Term, lambda term: (_term_from_text, (str(term),)))
copyreg.pickle(Formula, lambda formula: (_formula_from_text, (str(formula),)))
copyreg.pickle(Specification, _reduced)
