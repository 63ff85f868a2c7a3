"""`rtamt init`: writes a specification, a test and a CI job to start from."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from rtamt.errors import shown
from rtamt_gym.options.command_line import Option, add_options
from rtamt_gym.starters import STARTERS, write_starter


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes the files of a tutorial: a specification, a test and a CI job that runs both. "
        "Existing files are not overwritten."
    )
    add_options(
        parser,
        Option(
            "NAME",
            "; ".join(f"{name}: {starter.about}" for name, starter in STARTERS.items()),
            choices=STARTERS,
        ),
        Option(
            "FOLDER",
            "where the files are written",
            default=Path(),
            usual="here",
            read=Path,
            nargs="?",
        ),
    )
    parser.epilog = "example: rtamt init recordings gate"


def run(options: argparse.Namespace) -> int:
    starter = STARTERS[options.name]
    for path in write_starter(options.name, options.folder):
        print(shown(str(options.folder / path)))
    begin = starter.begin
    if options.folder != Path():
        begin = f"cd {shlex.quote(str(options.folder))} && {begin}"
    print(f"\nstart with: {shown(begin)}")
    return 0
