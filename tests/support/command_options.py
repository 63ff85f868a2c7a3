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

Every option of `rtamt COMMAND --help`. An option that several commands describe alike is in the
first table only. [The command line](../commands.md) describes the output and the exit codes.

## Options of several commands

| | | Commands |
|---|---|---|
"""


def page() -> str:
    """Return the text of the page."""
    parsers = {name: _parser(name) for name in COMMANDS}
    rows = {name: _rows(parser) for name, parser in parsers.items()}
    users: dict[tuple[str, str], list[str]] = {}
    for name, its in rows.items():
        for row in its:
            users.setdefault(row, []).append(name)
    shared = {row: names for row, names in users.items() if len(names) > 1}
    lines = [
        f"| {option} | {text} | {', '.join(shared[option, text])} |" for option, text in shared
    ]
    for name, parser in parsers.items():
        lines += ["", *_command(name, parser, rows[name], set(shared))]
    return _HEAD + "\n".join(lines) + "\n"


def _parser(name: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"rtamt {name}", add_help=False)
    import_module(f"rtamt_gym.commands.{name}").add_arguments(parser)
    return parser


def _rows(parser: argparse.ArgumentParser) -> list[tuple[str, str]]:
    """Return each argument as it is written, and its help."""
    actions = [each for each in parser._actions if each.help != argparse.SUPPRESS]
    return [(_written(action), _text(_help(action, parser))) for action in actions]


def _command(
    name: str,
    parser: argparse.ArgumentParser,
    rows: list[tuple[str, str]],
    shared: set[tuple[str, str]],
) -> Iterator[str]:
    yield f"## rtamt {name}\n\n{_text(parser.description or '')}"
    own = [row for row in rows if row not in shared]
    if own:
        yield "\n| | |\n|---|---|"
        yield from (f"| {option} | {text} |" for option, text in own)
    others = [
        re.split(r"[ =\[]", option.split("`")[1])[0] for option, _ in rows if (option, _) in shared
    ]
    if others:
        yield f"\nOf several commands: {', '.join(f'`{flag}`' for flag in others)}."
    if parser.epilog:
        yield f"\n{_example(parser.epilog)}"


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
