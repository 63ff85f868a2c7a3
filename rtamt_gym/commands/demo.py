"""`rtamt demo`: good drivers and bad, watched."""

from __future__ import annotations

import argparse
from pathlib import Path

from rtamt_gym.commands.arguments import Commands, check_folder, whole

__all__ = ["add"]


def add(commands: Commands) -> None:
    """Adds the arguments of `rtamt demo`."""
    demo = commands.add_parser(
        "demo",
        help="watch a MuJoCo pendulum and a highway, good drivers and bad",
        description="Runs InvertedPendulum-v5 and highway-fast-v0 with good and bad controllers, "
        "each under two specifications; prints a table and draws a picture. Needs the extras "
        "gym, highway and plot.",
        allow_abbrev=False,
    )
    demo.add_argument("--seed", type=whole, default=0, help="of the first episode (0)")
    demo.add_argument(
        "--plot",
        type=Path,
        default=Path("rtamt-demo.png"),
        metavar="FILE",
        help="the picture (rtamt-demo.png)",
    )
    demo.set_defaults(run=_demo)


def _demo(options: argparse.Namespace) -> int:
    from rtamt_gym.demo import run
    from rtamt_gym.drawing import check_format

    check_folder(options.plot)
    check_format(options.plot)
    for line in run(options.seed, options.plot):
        print(line, flush=True)
    return 0
