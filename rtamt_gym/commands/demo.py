"""`rtamt demo`: runs good and bad controllers under specifications."""

from __future__ import annotations

import argparse
from pathlib import Path

from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.options.command_line import Option, add_options, whole


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs InvertedPendulum-v5 and highway-fast-v0 with good and bad controllers, each under "
        "two specifications. Prints a table and draws a picture. Needs the extras gym, highway "
        "and plot."
    )
    add_options(
        parser,
        Option("--seed S", "seed of every episode", default=0, read=whole),
        Option("--plot FILE", "file of the picture", default=Path("rtamt-demo.png"), read=Path),
    )


def run(options: argparse.Namespace) -> int:
    from rtamt_gym import demo

    check_outputs(picture=options.plot)
    for line in demo.run(options.seed, options.plot):
        print(line, flush=True)
    return 0
