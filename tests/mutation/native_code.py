"""Mutants of C++, all in one build: ``(mutant(17) ? (mutated) : (original))``.

A place that needs a constant has no mutant. The compiler finds mutants that do not compile, and the
next build omits them.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import nanobind  # type: ignore[import-untyped]
import tree_sitter_cpp
from changes import ARITHMETIC, BITS, COMPARISONS, NATIVE_LOGIC, Site, told_apart
from tree_sitter import Language, Node, Parser

HEADER: Final = Path(__file__).with_name("mutants.hpp")

_PARSER: Final = Parser(Language(tree_sitter_cpp.language()))
_CHANGED: Final = ARITHMETIC | BITS | COMPARISONS | NATIVE_LOGIC

# One side of these is a boolean, and the other may only convert to one: an optional made of `false`
# contains it, and would be true.
_TRUTHS: Final = {"not removed", "condition negated"}

# Types and constants of the compiler stand here.
_CONSTANT: Final = {
    "ERROR",
    "alignas_qualifier",
    "array_declarator",
    "bitfield_clause",
    "concept_definition",
    "constraint_conjunction",
    "decltype",
    "enumerator",
    "explicit_function_specifier",
    "noexcept",
    "preproc_call",
    "preproc_def",
    "preproc_function_def",
    "preproc_if",
    "preproc_elif",
    "requires_clause",
    "sizeof_expression",
    "static_assert_declaration",
    "template_argument_list",
    "template_parameter_list",
}
_ERROR: Final = re.compile(r"([^\s:]+):(\d+):\d+: (?:fatal )?error: ")
_NUMBER: Final = re.compile(r"\bmutant\((\d+)\)")


class Reached:
    """The mutants of a loaded library: the active one, and the places that ran."""

    def __init__(self, path: Path, count: int) -> None:
        library = ctypes.CDLL(str(path))
        self._on = ctypes.c_int.in_dll(library, "mutant_on")
        self._reached = (ctypes.c_ubyte * count).in_dll(library, "mutants_reached")

    def begin(self, on: int | None = None) -> None:
        """Activate a mutant or none, and forget the places that ran."""
        self._on.value = -1 if on is None else on
        ctypes.memset(self._reached, 0, len(self._reached))

    def reached(self) -> set[int]:
        """Return the numbers of the places that have run since `begin`."""
        return {number for number, was in enumerate(bytes(self._reached)) if was}


def sites(source: str) -> list[Site]:
    """Return every change that a mutant can make, in the order of the source."""
    return list(_mutants(source.encode()))


def rewritten(source: str, numbers: Mapping[Site, int]) -> str:
    """Return the source with these mutants, each activated by its number."""
    text = source.encode()
    made: dict[tuple[int, int], list[tuple[int, str]]] = {}
    truths: set[int] = set()
    statements: set[tuple[int, int]] = set()
    for site, (node, mutated) in _mutants(text).items():
        number = numbers.get(site)
        if number is not None:
            place = (node.start_byte, node.end_byte)
            made.setdefault(place, []).append((number, mutated))
            if site.change.partition(" at ")[0] in _TRUTHS:
                truths.add(number)
            if node.type == "expression_statement":
                statements.add(place)
    # From the inside out, because a mutant contains the original of others inside it.
    order = sorted(made, key=lambda place: (place[1] - place[0], place in statements))
    return _rendered(text, order, made, truths, statements)


def _rendered(
    text: bytes,
    order: list[tuple[int, int]],
    made: Mapping[tuple[int, int], list[tuple[int, str]]],
    truths: set[int],
    statements: set[tuple[int, int]],
) -> str:
    def render(begin: int, end: int, within: list[tuple[int, int]]) -> bytes:
        parts, at = [], begin
        outer = [
            place
            for place in within
            if not any(o != place and o[0] <= place[0] and place[1] <= o[1] for o in within)
        ]
        for place in sorted(outer):
            inner = [p for p in within if p != place and place[0] <= p[0] and p[1] <= place[1]]
            original = render(*place, inner)
            for number, mutated in made[place]:
                if place in statements:
                    original = b"{ if (!mutant(%d)) { %s } }" % (number, original)
                else:
                    choice = b"bool(%s) : bool(%s)" if number in truths else b"(%s) : (%s)"
                    chosen = choice % (mutated.encode(), original)
                    original = b"(mutant(%d) ? %s)" % (number, chosen)
            parts += [text[at : place[0]], original]
            at = place[1]
        return b"".join([*parts, text[at:end]])

    return render(0, len(text), order).decode()


def _site(node: Node, change: str) -> Site:
    (line, column), (end_line, end_column) = node.start_point, node.end_point
    return Site(line + 1, column, end_line + 1, end_column, change)


def _mutants(text: bytes) -> dict[Site, tuple[Node, str]]:
    """Return the node of each mutant, and its replacement."""
    found = {_site(node, change): (node, mutated) for node, change, mutated in _all_mutated(text)}
    return {told: found[site] for site, told in told_apart(found).items()}


def _all_mutated(text: bytes) -> Iterator[tuple[Node, str, str]]:
    waiting = [_PARSER.parse(text).root_node]
    while waiting:
        node = waiting.pop()
        if node.type not in _CONSTANT and not _is_constant(node) and not _is_label(node):
            yield from _mutated(node)
            waiting += node.children


def _is_constant(node: Node) -> bool:
    """Return whether the compiler knows the value of a constant, a case or an `if constexpr`."""
    if node.type in {"declaration", "field_declaration"}:
        return any(_source(child) == "constexpr" for child in node.children)
    parent = node.parent
    if parent is None:
        return False
    if parent.type == "case_statement":
        return node == parent.child_by_field_name("value")
    return node.type == "condition_clause" and any(
        _source(child) == "constexpr" for child in parent.children
    )


def _is_label(node: Node) -> bool:
    """Return whether a statement of a `switch` precedes its cases: a macro that writes them."""
    parent = node.parent
    return (
        node.type == "expression_statement"
        and parent is not None
        and parent.parent is not None
        and parent.parent.type == "switch_statement"
    )


def _source(node: Node) -> str:
    return (node.text or b"").decode()


def _mutated(node: Node) -> Iterator[tuple[Node, str, str]]:
    """Return each change of this node, with its replacement."""
    match node.type:
        case "binary_expression" | "assignment_expression":
            left, operator, right = (
                _source(found)
                for name in ("left", "operator", "right")
                if (found := node.child_by_field_name(name)) is not None
            )
            mark = "=" if node.type == "assignment_expression" else ""
            changed = _CHANGED.get(operator.removesuffix("=") if mark else operator)
            if changed is not None:
                yield node, f"{operator} to {changed}{mark}", f"{left} {changed}{mark} {right}"
        case "unary_expression":
            operator, argument = (_source(child) for child in node.children)
            if operator in {"!", "-"}:
                name = "not" if operator == "!" else "-"
                yield node, f"{name} removed", argument
        case "number_literal":
            yield node, f"{_source(node)} to {_source(node)} + 1", f"{_source(node)} + 1"
        case "true" | "false":
            other = "false" if node.type == "true" else "true"
            yield node, f"{node.type} to {other}", other
        case "condition_clause":
            value = node.child_by_field_name("value")
            if (
                value is not None
                and node.child_by_field_name("initializer") is None
                and value.type not in {"binary_expression", "unary_expression", "declaration"}
                and node.parent is not None
                and node.parent.type == "if_statement"
            ):
                yield value, "condition negated", f"!({_source(value)})"
        case "expression_statement" if node.named_children and node.named_children[0].type in {
            "assignment_expression",
            "call_expression",
            "update_expression",
        }:
            yield node, "statement removed", ""


def write(sources: Path, into: Path, numbers: Mapping[str, Mapping[Site, int]], of: Path) -> None:
    """Write the sources with these mutants; `numbers` has paths from the folder `of`."""
    for path in sources.rglob("*"):
        target = into / path.relative_to(sources)
        if path.is_dir():
            continue
        text = path.read_text(encoding="utf-8")
        text = rewritten(text, numbers.get(path.relative_to(of).as_posix(), {}))
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")


def build(sources: Path, folder: Path, count: int) -> tuple[Path | None, set[int]]:
    """Return the library of these sources, or None and the mutants that do not compile."""
    options = {
        "CMAKE_BUILD_TYPE": "Debug",
        "CMAKE_CXX_FLAGS": (
            f"-O0 -g0 -w -Wno-narrowing -fmax-errors=0 -include {HEADER} -DMUTANTS={count}"
        ),
        "Python_EXECUTABLE": sys.executable,
        "nanobind_DIR": nanobind.cmake_dir(),
    }
    search = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    environment = {**os.environ, "PATH": search}
    configure = ["cmake", "-S", str(sources), "-B", str(folder), "-G", "Ninja"]
    subprocess.run(
        [*configure, *(f"-D{name}={value}" for name, value in options.items())],
        env=environment,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    make = ["cmake", "--build", str(folder), "--target", "_native", "--", "-k", "0"]
    done = subprocess.run(
        make,
        env=environment,
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode == 0:
        (path,) = folder.glob("_native.*")
        units = Path(__file__).parents[2] / "rtamt" / "rtamt_monitor.so"
        if units.is_file():  # the export of FMUs looks for it next to the module
            shutil.copy(units, folder)
        return path, set()
    refused = set(_refused(done.stdout, folder))
    assert refused, done.stdout[-4000:] + done.stderr[-4000:]
    return None, refused


def _refused(said: str, folder: Path) -> Iterator[int]:
    """Return the mutants on the lines that a compiler names in its errors."""
    for path, line in set(_ERROR.findall(said)):
        source = (folder / path).resolve()
        if source.is_file():
            lines = source.read_text(encoding="utf-8").splitlines()
            yield from map(int, _NUMBER.findall(lines[int(line) - 1]))
