"""The suites: the tests that quick must contain, and the end of a run with a dead worker."""

import ast
import importlib
import os
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from paths import GOLDEN, ROOT

import rtamt
from rtamt_gym.commands import COMMANDS

PACKAGES = ("rtamt", "rtamt.patterns", "rtamt_gym", "rtamt_gym.testing", "rtamt_envs")
EXIT_CODES = {0, 1, 2, 3, 130}


def _is_slow(marks: list[ast.expr]) -> bool:
    """Return whether one of these marks is ``pytest.mark.slow`` for every back-end."""
    return any(ast.unparse(mark) == "pytest.mark.slow" for mark in marks)


def _quick_nodes(body: list[ast.stmt]) -> Iterator[ast.AST]:
    for node in body:
        match node:
            case ast.Assign(targets=[ast.Name(id="pytestmark")], value=mark) if _is_slow([mark]):
                return
            case ast.FunctionDef(decorator_list=marks) if _is_slow(marks):
                pass
            case ast.ClassDef(decorator_list=marks, body=inner):
                if not _is_slow(marks):
                    yield from _quick_nodes(inner)
            case _:
                yield from ast.walk(node)


@cache
def _tests() -> dict[Path, ast.Module]:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    omitted = settings["tool"]["pytest"]["ini_options"]["norecursedirs"]
    return {
        path: ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        if path.parent.relative_to(ROOT).as_posix() not in omitted and path != Path(__file__)
    }


@cache
def _words(*, quick: bool) -> frozenset[str]:
    """Return the names and strings of all tests, or of the tests that are not marked slow."""
    words: set[str] = set()
    for module in _tests().values():
        for node in _quick_nodes(module.body) if quick else ast.walk(module):
            match node:
                case ast.Name(id=word) | ast.Attribute(attr=word) | ast.alias(name=word):
                    words.add(word)
                case ast.Constant(value=str(text)):
                    words |= {text, *text.split()}
    return frozenset(words)


@pytest.mark.parametrize("package", PACKAGES)
def test_quick_covers_public_names(package: str) -> None:
    names = set(importlib.import_module(package).__all__) & _words(quick=False)
    assert names - _words(quick=True) == set()


def test_quick_covers_commands_errors_golden_files() -> None:
    errors = {name for name in rtamt.__all__ if name.endswith("Error")}
    golden = {path.name for path in GOLDEN.glob("*.json")}
    assert (set(COMMANDS) | errors | golden | {"python", "native"}) - _words(quick=True) == set()


def test_quick_covers_exit_codes() -> None:
    commands = ROOT / "tests" / "rtamt_gym" / "commands"
    codes = {
        number.value
        for path, module in _tests().items()
        if path.parent == commands
        for node in _quick_nodes(module.body)
        if isinstance(node, ast.Compare | ast.Tuple)
        for number in ast.walk(node)
        if isinstance(number, ast.Constant)
    }
    assert EXIT_CODES - codes == set()


@pytest.mark.slow
def test_dead_worker_ends_the_run(tmp_path: Path) -> None:
    """Also if the worker has forked: xdist waits until every copy of its pipes is closed."""
    (tmp_path / "conftest.py").write_text(
        (ROOT / "tests" / "conftest.py").read_text(encoding="utf-8"), encoding="utf-8"
    )
    child = tmp_path / "child.txt"
    (tmp_path / "test_death.py").write_text(f"""\
import os, signal, time

def test_death():
    child = os.fork()
    if child == 0:
        while True:
            time.sleep(1)
    with open({str(child)!r}, "w") as file:
        file.write(str(child))
    os.kill(os.getpid(), signal.SIGKILL)
""")
    (tmp_path / "test_life.py").write_text("def test_life(): pass\n")
    command = [sys.executable, "-m", "pytest", "-q", "-n2", "--max-worker-restart=0"]
    try:
        with (tmp_path / "log.txt").open("w") as log:  # the child would hold a pipe open
            run = subprocess.run(command, cwd=tmp_path, stdout=log, stderr=log, check=False)
        os.kill(int(child.read_text()), 0)  # the child still runs
    finally:
        os.kill(int(child.read_text()), signal.SIGKILL)
    assert run.returncode == 1
    assert "crashed while running 'test_death.py::test_death'" in (tmp_path / "log.txt").read_text()
