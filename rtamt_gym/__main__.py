"""The command line: `rtamt demo`, `rtamt run`, `rtamt monitor`, `rtamt explain`.

Exit codes: 0, or 1 where `monitor` or `explain` finds a violation; 2 on bad input, with one message
on stderr.
Gymnasium, MuJoCo and matplotlib are imported by the commands that need them.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

import rtamt
from rtamt import InputError, RtamtError
from rtamt_gym.commands import demo, explain, monitor, run

__all__ = ["main"]

_EXTRAS = {
    "gymnasium": "gym",
    "mujoco": "gym",
    "highway_env": "highway",
    "matplotlib": "plot",
    "pyarrow": "parquet",
}
"""What has to be imported, and the extra that installs it."""

_OPTIONS = (
    # The library's way out is written in Python; here it is written in options.
    (r"view='step'", "--view step"),
    (r"\bperiod= ?", "--period "),
    (r'"(\w+)": \("([^"]*)", 0\.0\)', r'--signal "\1=\2,0"'),
    (r'"(\w+)": "([^"]*)"', r'--signal "\1=\2"'),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    try:
        options = _options(argv)
        code: int = options.run(options)
        sys.stdout.flush()
    except SystemExit as end:  # --help and --version
        return int(end.code or 0)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader has gone, as `head` does; Python would complain once more at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except RtamtError as error:
        return _refuse(": ".join([*getattr(error, "__notes__", []), str(error)]))
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in _EXTRAS:
            raise
        return _refuse(
            f"{missing} is not installed; from the checkout: pip install '.[{_EXTRAS[missing]}]'"
        )
    except OSError as error:
        name = "" if error.filename is None else f" {error.filename}"
        return _refuse(f"cannot open{name}: {error.strerror or error}")
    return code


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = _parser()
    options, rest = parser.parse_known_args(argv)
    if rest and "trace" in options and not any(text.startswith("-") for text in rest):
        # argparse ends a list of specifications at the first option behind it.
        options.specs += [options.trace, *rest]
        options.trace = options.specs.pop()
    elif rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    return options


def _refuse(message: str) -> int:
    for python, option in _OPTIONS:
        message = re.sub(python, option, message)
    print(f"rtamt: error: {message}", file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="rtamt",
        description="Signal temporal logic: simulations and recorded traces under monitors.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action="version", version=f"rtamt {rtamt.__version__} ({rtamt.BACKEND})"
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in (demo, run, monitor, explain):
        command.add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
