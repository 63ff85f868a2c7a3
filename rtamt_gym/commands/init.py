"""`rtamt init`: a specification, a test and a job of CI to begin with."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from rtamt.errors import shown
from rtamt_gym.starters import STARTERS, write_starter

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes a starter: a specification, a test and a job of CI that runs both. Each is what a "
        "tutorial of the documentation begins with. Files that are there are not overwritten."
    )
    parser.add_argument(
        "name",
        choices=STARTERS,
        metavar="NAME",
        help="; ".join(f"{name}: {starter.about}" for name, starter in STARTERS.items()),
    )
    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=Path(),
        metavar="FOLDER",
        help="where the files are written (default: here)",
    )
    parser.epilog = "example: rtamt init recordings gate"


def run(options: argparse.Namespace) -> int:
    starter = STARTERS[options.name]
    for path in write_starter(options.name, options.folder):
        print(shown(str(options.folder / path)))
    begin = starter.begin
    if options.folder != Path():
        begin = f"cd {shlex.quote(str(options.folder))} && {begin}"
    print(f"\nbegin with: {shown(begin)}")
    return 0
