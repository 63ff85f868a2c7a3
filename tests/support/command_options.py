"""The page of all options of all commands, as the parsers have them.

Run: python tests/support/command_options.py, which writes docs/reference/commands.md.
"""

import argparse
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from rtamt_gym.commands import COMMANDS

__all__ = ["PAGE", "page"]

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "commands.md"

_HEAD = """# Options of the commands

Every command of `rtamt` with all that it takes, as `rtamt COMMAND --help` says it.
[The command line](../commands.md) has what they print, and their exit codes.
"""


def page() -> str:
    """The page."""
    return "\n".join([_HEAD, *(line for name in COMMANDS for line in _command(name))])


def _command(name: str) -> Iterator[str]:
    parser = argparse.ArgumentParser(prog=f"rtamt {name}", add_help=False)
    import_module(f"rtamt_gym.commands.{name}").add_arguments(parser)
    yield f"## rtamt {name}\n"
    yield f"{_text(parser.description or '')}\n"
    actions = [each for each in parser._actions if each.help != argparse.SUPPRESS]
    if actions:
        yield "| | |\n|---|---|"
        for action in actions:
            yield f"| {_written(action)} | {_text(_help(action, parser))} |"
        yield ""
    if parser.epilog:
        yield f"{_example(parser.epilog)}\n"


def _written(action: argparse.Action) -> str:
    """How an argument is written: its flags, and what follows them."""
    value = action.metavar or action.dest.upper()
    if action.choices is not None and action.metavar is None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    if not action.option_strings:
        return f"`{value}`"
    after = "" if action.nargs == 0 else f" {value}"
    if action.dest == "require_triggered":  # its value stands after '=' only
        after = f"[={value}]"
    return ", ".join(f"`{flag}{after}`".replace("|", "\\|") for flag in action.option_strings)


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    return parser._get_formatter()._expand_help(action) if action.help else ""


def _text(text: str) -> str:
    """A text of a parser as Markdown shows it."""
    plain = re.sub(r"\s+", " ", text).replace("|", "\\|")
    return re.sub(r"([*_<>\[\]{}$~]|(?<=\])\()", r"\\\1", plain)  # "](" would begin a link


def _example(text: str) -> str:
    said, colon, command = text.partition(": ")
    return f"{said}{colon}`{command}`" if colon else _text(text)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
