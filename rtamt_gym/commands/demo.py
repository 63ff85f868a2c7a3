"""`rtamt demo`: runs good and bad controllers under specifications."""

from __future__ import annotations

import argparse
from pathlib import Path

from rtamt_gym.commands.arguments import add_output, check_outputs, whole

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs InvertedPendulum-v5 and highway-fast-v0 with good and bad controllers, each under "
        "two specifications. Prints a table and draws a picture. Needs the extras gym, highway "
        "and plot."
    )
    parser.add_argument(
        "--seed", type=whole, default=0, metavar="S", help="seed of every episode (default: 0)"
    )
    add_output(parser, "--plot", "file of the picture (default: rtamt-demo.png)")
    parser.set_defaults(plot=Path("rtamt-demo.png"))


def run(options: argparse.Namespace) -> int:
    from rtamt_gym import demo

    check_outputs(picture=options.plot)
    for line in demo.run(options.seed, options.plot):
        print(line, flush=True)
    return 0
