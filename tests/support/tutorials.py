"""Run tutorials as a reader does: their commands in order, in a new folder."""

import doctest
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from string import Template

import pytest

from rtamt_gym.__main__ import main

__all__ = ["Block", "Reader", "blocks_of", "commands_of"]

_BLOCK = re.compile(r"([^\n]*)\n\n```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A block of a page.

    Attributes:
        language: The word after its fence.
        text: Its lines.
        file: The file name at the end of the line before it, as in "`tank.py`:".
    """

    language: str
    text: str
    file: str | None


def blocks_of(page: str) -> Iterator[Block]:
    """Return the blocks of a page, in order."""
    for before, language, text in _BLOCK.findall(page):
        named = re.search(r"`([\w./-]+)`:$", before)
        yield Block(language, text, named and named[1])


def commands_of(block: str) -> Iterator[tuple[str, str]]:
    """Return the commands of a block ``console``, each with its output."""
    for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        command, _, shown = part.partition("\n")
        yield command, shown


@dataclass
class Reader:
    """Follows a tutorial.

    Attributes:
        folder: The working folder.
        patch: Restores the changes of a step to this process.
        code: The exit code of the last command.
    """

    folder: Path
    patch: pytest.MonkeyPatch
    code: int = 0
    names: dict[str, object] = field(default_factory=dict)

    def gives(self, command: str, **variables: str) -> str:
        """Run a command of the shell, with variables; return its output."""
        program, *arguments = shlex.split(Template(command).safe_substitute(variables))
        if (program, arguments) == ("echo", ["$?"]):
            return f"{self.code}\n"
        if program == "pytest":
            return self._pytest(arguments)
        with self._fresh_modules(), redirect_stdout(StringIO()) as out:
            if program == "python":
                self.patch.setattr(sys, "argv", arguments)
                runpy.run_path(str(self.folder / arguments[0]), run_name="__main__")
                self.code = 0
            else:
                assert program == "rtamt", command
                self.code = main(arguments)
        return out.getvalue()

    def python(self, text: str, page: str) -> list[str]:
        """Run a block of Python; return the differences of its output."""
        said: list[str] = []
        test = doctest.DocTestParser().get_doctest(text, self.names, page, page, 0)
        assert test.examples, f"nothing is run: {text}"
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
        with self._fresh_modules():
            runner.run(test, out=said.append, clear_globs=False)
        self.names = test.globs
        return said

    def changes(self, file: str, lines: str) -> None:
        """Change a file by a block ``diff``: lines with - become the lines with + below."""
        path = self.folder / file
        text = path.read_text(encoding="utf-8")
        for old, new in re.findall(r"((?:^-.*\n)+)((?:^\+.*\n)*)", lines, re.MULTILINE):
            before, after = (re.sub(r"^.", "", each, flags=re.MULTILINE) for each in (old, new))
            assert text.count(before) == 1, before
            text = text.replace(before, after)
        path.write_text(text, encoding="utf-8")

    @contextmanager
    def _fresh_modules(self) -> Iterator[None]:
        """Let a step import the modules of the folder, and the next one import them again."""
        with self.patch.context() as patch:
            patch.chdir(self.folder)
            patch.syspath_prepend(self.folder)
            patch.setattr(sys, "dont_write_bytecode", True)
            yield
        for name, module in list(sys.modules.items()):
            if str(getattr(module, "__file__", None)).startswith(str(self.folder)):
                del sys.modules[name]

    def _pytest(self, arguments: list[str]) -> str:
        scripts = Path(sys.executable).parent
        path = f"{scripts}{os.pathsep}{os.environ['PATH']}"
        quiet = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_ADDOPTS": "-p no:cacheprovider"}
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *arguments],
            cwd=self.folder, env={**os.environ, **quiet, "PATH": path},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        self.code = done.returncode
        assert not done.stderr, done.stderr
        return done.stdout
