"""A public name of a class or of a type has one meaning in all packages."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

from paths import ROOT

ALTERNATIVES = {"SatisfactionCallback"}
"""Names that users import from the module of their learner, one callback for each."""


def definitions(path: Path) -> Iterator[tuple[str, str]]:
    """Return the public classes and type aliases of a file, with the types of aliases."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.ClassDef(name=name):
                found = name, f"a class of {path}"
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                found = name, ast.unparse(value)
            case _:
                continue
        if name[0].isupper() and not name.isupper():
            yield found


def test_a_name_is_one_class_or_one_type() -> None:
    known: defaultdict[str, set[str]] = defaultdict(set)
    for room in ("rtamt", "rtamt_gym", "rtamt_arrays", "rtamt_ros", "envs"):
        for path in (ROOT / room).rglob("*.py"):
            if "generated" not in path.parts:
                for name, what in definitions(path):
                    known[name].add(what)
    assert len(known) > 300
    twice = {name for name, meanings in known.items() if len(meanings) > 1}
    assert twice == ALTERNATIVES


def test_a_folder_of_tests_hides_no_library() -> None:
    """The path of the type checker has a folder of test modules, whose folders are packages."""
    folders = {
        folder.name
        for test in (ROOT / "tests").rglob("test_*.py")
        for folder in test.parent.iterdir()
        if folder.is_dir() and folder.name != "__pycache__"
    }
    assert folders
    assert not folders & packages_distributions().keys()
