"""Measure the project against its floor and its peers, in one run.

Every tool runs in processes of its own, one at a time and in turns. A figure is the minimum of its
repeats. Absolute figures depend on this machine, so look at the ratios: "/floor" is the project's
figure divided by the same work in C, compiled at the start; "/peer" is divided by the best peer.
Targets belong to the machine on which they were set. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import importlib
import json
import platform
import sys
import tempfile
import time
from pathlib import Path

import floor
import numpy as np
from controller import MODULES, Setting

import rtamt

SECTIONS = (
    "update",
    "batches",
    "worst",
    "memory",
    "offline",
    "calls",
    "dense",
    "triggers",
    "occurrences",
    "many",
    "gym",
    "vector",
    "simulation",
    "stopping",
    "start",
)


def peer(text: str) -> tuple[str, str]:
    """Read NAME=PYTHON."""
    name, _, python = text.partition("=")
    if name not in MODULES or not Path(python).exists():
        msg = f"expected NAME=PYTHON, NAME out of {', '.join(MODULES)}, got {text!r}"
        raise argparse.ArgumentTypeError(msg)
    return name, python


def main() -> None:
    """Run sections and print their tables."""
    parser = argparse.ArgumentParser(
        usage="%(prog)s [SECTION ...] [--quick] [--json FILE] [--peer NAME=PYTHON ...]",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="fewer repeats and sizes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there")
    parser.add_argument(
        "--peer",
        type=peer,
        action="append",
        default=[],
        metavar="NAME=PYTHON",
        help="the interpreter of an environment with sentil, mstlo or reelay",
    )
    arguments = parser.parse_args()
    if unknown := set(arguments.sections) - set(SECTIONS):
        parser.error(f"expected sections out of {', '.join(SECTIONS)}, got {unknown.pop()!r}")

    machine = f"{platform.python_implementation()} {platform.python_version()}, NumPy"
    print(f"rtamt {rtamt.__version__} ({rtamt.BACKEND}), {machine} {np.__version__}")
    print("lower is better; /floor and /peer: the project over C, over the best peer")
    if missing := sorted(set(MODULES) - set(dict(arguments.peer))):
        print(f"not compared with {', '.join(missing)}: see --peer")
    tables = []
    with tempfile.TemporaryDirectory() as folder:
        problem = floor.build(Path(folder))
        if problem:
            print(f"no floor: {problem}")
        setting = Setting(dict(arguments.peer), None if problem else Path(folder), arguments.quick)
        for name in arguments.sections or SECTIONS:
            begin = time.perf_counter()
            for table in importlib.import_module(f"sections.{name}").measure(setting):
                tables.append(table)
                print(f"\n{table}", flush=True)
            print(f"({name}: {time.perf_counter() - begin:.0f} s)", file=sys.stderr)
    if arguments.json:
        arguments.json.write_text(json.dumps([table.plain() for table in tables], indent=1))


if __name__ == "__main__":
    main()
