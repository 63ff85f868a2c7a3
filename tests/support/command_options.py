"""The page of all options of all commands, from the parsers.

Run: python tests/support/command_options.py, which writes docs/reference/commands.md.
"""

import argparse
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

from rtamt_gym.commands import COMMANDS
from rtamt_gym.options.command_line import Option

__all__ = ["PAGE", "page"]

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "commands.md"

_HEAD = """# Options of the commands

This page has every option of every command; `rtamt COMMAND --help` also has exit codes and an
example. Options of several commands come first. [The command line](../commands.md) describes the
output. A *trial* is an episode, a simulation, a run or a trace.
"""

_MINIMUM = 4
"""The number of options with the same commands that have a table of their own."""


def page() -> str:
    """Return the text of the page."""
    parsers = {name: _parser(name) for name in COMMANDS}
    rows = {name: _rows(parser) for name, parser in parsers.items()}
    users: dict[tuple[str, str], list[str]] = {}
    for name, its in rows.items():
        for row in its:
            users.setdefault(row, []).append(name)
    groups: dict[tuple[str, ...], list[tuple[str, str]]] = {}
    for row, names in users.items():
        groups.setdefault((*names,), []).append(row)
    tables = {
        names: listed
        for names, listed in groups.items()
        if len(names) > 1 and len(listed) >= _MINIMUM
    }
    others = [row for row, names in users.items() if len(names) > 1 and (*names,) not in tables]
    lines = ["\n## Options of several commands\n"]
    lines += [f"- {option}: {text}" for option, text in others]
    for commands, listed in tables.items():
        lines += [f"\n## Options of {_listing(commands)}\n"]
        lines += [f"- {option}: {text}" for option, text in listed]
    for name, parser in parsers.items():
        links = [
            f"[{_listing(names)}](#options-of-{_slug(names)})" for names in tables if name in names
        ]
        lines += ["", *_command(name, parser, rows[name], users, others, links)]
    return _HEAD + "\n".join(lines) + "\n"


def _listing(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}"


def _slug(names: Sequence[str]) -> str:
    return _listing(names).replace(",", "").replace(" ", "-")


def _parser(name: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"rtamt {name}", add_help=False)
    add_to = Option.add_to
    with patch.object(Option, "add_to", lambda option, group, _: add_to(option, group, "trial")):
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
    users: Mapping[tuple[str, str], Sequence[str]],
    others: Collection[tuple[str, str]],
    links: Sequence[str],
) -> Iterator[str]:
    yield f"## rtamt {name}\n\n{_text(_first_sentence(parser.description or ''))}"
    own = [row for row in rows if len(users[row]) == 1]
    if own:
        yield ""
        yield from (f"- {option}: {text}" for option, text in own)
    flags = [re.split(r"[ =\[]", row[0].split("`")[1])[0] for row in rows if row in others]
    more = [*(f"`{flag}`" for flag in flags)]
    more += [f"the options of {'; '.join(links)}"] if links else []
    if more:
        yield f"\nAlso: {', '.join(more)}."


def _written(action: argparse.Action) -> str:
    """Return an argument as it is written: its flags and its value."""
    value = action.metavar or action.dest.upper()
    if action.choices is not None and action.metavar is None:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    if not action.option_strings:
        return f"`{value}`"
    after = "" if action.nargs == 0 else f" {value}"
    if action.dest == "require_triggered":  # its value follows '=' only
        after = f"[={value}]"
    return ", ".join(f"`{flag}{after}`" for flag in action.option_strings)


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    return parser._get_formatter()._expand_help(action) if action.help else ""


def _first_sentence(text: str) -> str:
    return re.split(r"(?<=\.) ", text, maxsplit=1)[0]


def _text(text: str) -> str:
    """Return a text of a parser in Markdown."""
    plain = re.sub(r"\s+", " ", text)
    return re.sub(r"([*_<>\[\]{}$~]|(?<=\])\()", r"\\\1", plain)  # "](" would start a link


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
