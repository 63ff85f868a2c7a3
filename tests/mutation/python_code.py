"""Mutants of Python, all in one program: ``mutated if __mutants__[17] else original``.

`Choices` is the object `__mutants__` in builtins. A mutant is chosen before or after the import of
the module. Source lines, which tests count, do not change.
"""

from __future__ import annotations

import ast
import builtins
import copy
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Final

from changes import (
    ARITHMETIC,
    BITS,
    COMPARISONS,
    PYTHON_COMPARISONS,
    PYTHON_LOGIC,
    Site,
    told_apart,
)

_OPERATORS: Final[dict[type[ast.AST], str]] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.Pow: "**",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.LShift: "<<",
    ast.RShift: ">>",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Is: "is",
    ast.IsNot: "is not",
    ast.In: "in",
    ast.NotIn: "not in",
    ast.And: "and",
    ast.Or: "or",
}
_CLASSES: Final = {symbol: operator for operator, symbol in _OPERATORS.items()}
_CHANGED: Final = ARITHMETIC | BITS | COMPARISONS | PYTHON_COMPARISONS | PYTHON_LOGIC


class Choices(dict[int, bool]):
    """The active mutant, and the places that have run since `begin`."""

    def __init__(self) -> None:
        self._on: int | None = None
        builtins.__mutants__ = self  # type: ignore[attr-defined]

    def __missing__(self, number: int) -> bool:
        self[number] = False
        return False

    def begin(self, on: int | None = None) -> None:
        """Activate a mutant or none, and forget the places that ran."""
        self.clear()
        if on is not None:
            self[on] = True

    def reached(self) -> set[int]:
        """Return the numbers of the places that have run since `begin`."""
        return set(self)


def sites(source: str) -> list[Site]:
    """Return every change that a mutant can make, in the order of the source."""
    return list(_told_sites(source).values())


def rewritten(source: str, numbers: Mapping[Site, int]) -> ast.Module:
    """Return the module with these mutants, each activated by its number."""
    tree = ast.parse(source)
    places = {site: numbers[told] for site, told in _told_sites(source).items() if told in numbers}
    _Rewriter(places).visit(tree)
    return ast.fix_missing_locations(tree)


def _told_sites(source: str) -> dict[Site, Site]:
    rewriter = _Rewriter({})
    rewriter.visit(ast.parse(source))
    return told_apart(rewriter.found)


class _Rewriter(ast.NodeTransformer):
    def __init__(self, numbers: Mapping[Site, int]) -> None:
        self._numbers = numbers
        self.found: list[Site] = []

    def visit(self, node: ast.AST) -> ast.AST:
        original = copy.deepcopy(node) if isinstance(node, ast.expr | ast.stmt) else node
        made: ast.AST = super().visit(node)
        for change, mutated in _mutated(original):
            site = _site(original, change)
            self.found.append(site)
            if (number := self._numbers.get(site)) is not None:
                made = _either(number, mutated, made)
        return made

    def _visit_fields(self, node: ast.AST, *left_out: str) -> ast.AST:
        kept = {name: getattr(node, name) for name in left_out}
        for name in left_out:
            setattr(node, name, [] if isinstance(kept[name], list) else None)
        self.generic_visit(node)
        for name, value in kept.items():
            setattr(node, name, value)
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        return self._visit_fields(node, "decorator_list", "returns")

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        return self._visit_fields(node, "decorator_list", "bases", "keywords")

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        return self._visit_fields(node, "annotation", "target")

    def visit_arg(self, node: ast.arg) -> ast.AST:
        return node

    def visit_match_case(self, node: ast.match_case) -> ast.AST:
        return self._visit_fields(node, "pattern")

    def visit_If(self, node: ast.If) -> ast.AST:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return node
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if isinstance(node.func, ast.Name) and node.func.id in {"isinstance", "TypeVar", "cast"}:
            return node  # their arguments are types
        return self.generic_visit(node)


def _site(node: ast.AST, change: str) -> Site:
    assert isinstance(node, ast.expr | ast.stmt)
    end = (node.end_lineno or node.lineno, node.end_col_offset or node.col_offset)
    return Site(node.lineno, node.col_offset, *end, change)


def _either(number: int, mutated: ast.AST, original: ast.AST) -> ast.AST:
    """Return a choice at run time between two expressions or two statements."""
    test = ast.Subscript(ast.Name("__mutants__", ast.Load()), ast.Constant(number), ast.Load())
    made: ast.AST
    if isinstance(original, ast.expr):
        assert isinstance(mutated, ast.expr)
        made = ast.IfExp(test, mutated, original)
    else:
        assert isinstance(mutated, ast.stmt)
        assert isinstance(original, ast.stmt)
        made = ast.If(test, [mutated], [original])
    for node in ast.walk(test):
        if isinstance(node, ast.expr):
            ast.copy_location(node, original)
    return ast.copy_location(made, original)


def _mutated(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Return each change of this node, with its replacement."""
    match node:
        case ast.Compare():
            for place, operator in enumerate(node.ops):
                symbol = _OPERATORS[type(operator)]
                yield (
                    _told(symbol, _CHANGED[symbol], place),
                    _with(node, ops=_replaced(node.ops, place, _CLASSES[_CHANGED[symbol]]())),
                )
        case ast.BoolOp() | ast.BinOp() | ast.AugAssign():
            symbol = _OPERATORS.get(type(node.op), "")
            if (changed := _CHANGED.get(symbol)) and not _of_types(node):
                mark = "=" if isinstance(node, ast.AugAssign) else ""
                yield (
                    _told(symbol + mark, changed + mark),
                    _with(node, op=_CLASSES[changed]()),
                )
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield ("not removed" if isinstance(node.op, ast.Not) else "- removed"), node.operand
        case ast.Constant(value=bool(truth)):
            yield f"{truth} to {not truth}", _with(node, value=not truth)
        case ast.Constant(value=int(value) | float(value)):
            yield f"{value} to {value + 1}", _with(node, value=value + 1)
        case ast.If() | ast.IfExp() if not isinstance(node.test, ast.Compare | ast.UnaryOp):
            negated = ast.copy_location(ast.UnaryOp(ast.Not(), node.test), node.test)
            yield "condition negated", _with(node, test=negated)
    if _can_go(node):
        yield "statement removed", ast.copy_location(ast.Pass(), node)


def _can_go(node: ast.AST) -> bool:
    """Return whether a program without this statement still binds its names."""
    match node:
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise():
            return True
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            return True
    return False


def _of_types(node: ast.AST) -> bool:
    """Return whether the operands are types, as in `int | None`, or texts."""
    return isinstance(node, ast.BinOp) and any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, str | bytes | None))
        for side in (node.left, node.right)
    )


def _told(symbol: str, changed: str, place: int = 0) -> str:
    return f"{symbol} to {changed}" + (f" at {place + 1}" if place else "")


def _with(node: ast.AST, **fields: object) -> ast.AST:
    made = copy.deepcopy(node)
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def _replaced(operators: Sequence[ast.cmpop], place: int, by: ast.AST) -> list[ast.AST]:
    return [by if i == place else operator for i, operator in enumerate(operators)]


class Loader(importlib.machinery.SourceFileLoader):
    """Compiles a module with its mutants, without any cache of bytecode."""

    def __init__(self, name: str, path: Path, numbers: Mapping[Site, int]) -> None:
        super().__init__(name, str(path))
        self._numbers = numbers

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        source = Path(path).read_text(encoding="utf-8")
        return compile(rewritten(source, self._numbers), path, "exec", dont_inherit=True)


class Finder(importlib.abc.MetaPathFinder):
    """Finds modules with mutants before other finders.

    Args:
        numbers: For each path of a module, from `root`, its mutants.
        native: Another library for ``rtamt._native``, or None for the installed one.
    """

    def __init__(
        self, root: Path, numbers: Mapping[str, Mapping[Site, int]], native: Path | None
    ) -> None:
        self._native = native
        self._modules = {module_name(path): (root / path, of) for path, of in numbers.items()}

    def find_spec(
        self,
        fullname: str,
        _path: Sequence[str] | None = None,
        _target: ModuleType | None = None,
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname == "rtamt._native" and self._native is not None:
            return importlib.util.spec_from_file_location(fullname, self._native)
        if fullname not in self._modules:
            return None
        path, numbers = self._modules[fullname]
        return importlib.util.spec_from_file_location(
            fullname,
            path,
            loader=Loader(fullname, path, numbers),
            submodule_search_locations=[str(path.parent)] if path.stem == "__init__" else None,
        )

    def install(self) -> None:
        """Install it as the first finder; its modules must not be imported yet."""
        assert self._modules.keys().isdisjoint(sys.modules)
        self.go_first()

    def go_first(self) -> None:
        """Move it before finders that were installed since."""
        sys.meta_path[:] = [self, *(each for each in sys.meta_path if each is not self)]


def module_name(path: str) -> str:
    """Return the import name of a module's file."""
    name = path.removesuffix(".py").removesuffix("/__init__").removeprefix("envs/")
    return name.replace("/", ".")
