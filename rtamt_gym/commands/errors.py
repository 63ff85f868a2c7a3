"""Errors in the words of the command line."""

from __future__ import annotations

import re

from rtamt import RtamtError
from rtamt_gym.checks.extras import EXTRAS, missing
from rtamt_gym.tables import shorten

__all__ = ["refusal", "unexpected"]

_OPTIONS = (
    # The library's errors give advice in Python; on the command line the same advice is an option,
    # or nothing.
    (r"\berror\.run holds \d+ samples?, up to [^:]+: ", ""),
    (r"\berror\.falsification holds \d+ simulations?: ", ""),
    (r"give a space, as in \w+\(.*\)$", "write --vary mass=1:2"),
    (r"write Signal\('.*', \.\.\., duration=30\) or .*$", "give --duration 30, in seconds"),
    (r"view='step'", "--view step"),
    (r"\buse (Monitor with a period|a period, which takes samples)$", "leave out --dense"),
    (r"; pass nan='hold' to keep the last value instead$", ""),
    (r"\btimeout= as\b", "--timeout as"),
    (r"\bfolder= as\b", "--folder as"),
    (r"\buntil_width= ?", "--until-width "),
    (r"\b(target|alpha|margin)= ?", r"--\1 "),
    (r"\bthe same seed=$", "the same --seed"),
    (r"\bperiod= ?", "--period "),
    (r"\balign= ?", "--align "),
    (r"\btolerance= ?", "--tolerance "),
    (r'\bconstants=\{"(\w+)": (\w+)\}', r"--constant \1=\2"),
    (r'\bend="complete"', "--end complete"),
    (r"semantics='([\w-]+)'", r"--semantics \1"),
    (r"policy=lambda obs: env\.action_space\.sample\(\) acts at random", "--policy names one"),
    (r"got x=(\w+|'[^']*') and y=(\w+|'[^']*')$", r"got --x \1 and --y \2"),
    (r"\bsubsteps=True\b", "--substeps"),
    (r" or name them: (in|out)puts=\('.*',\)$", ""),
    (r'"(\w+)": \("([^"]*)", 0\.0\)', r'--signal "\1=\2,0"'),
    (r'"(\w+)": "([^"]*)"', r'--signal "\1=\2"'),
)


def refusal(error: Exception) -> str | None:
    """The message for an error that a user can cause; None for one that nobody expected."""
    match error:
        case RtamtError():
            message = ": ".join([*getattr(error, "__notes__", []), str(error)])
        case ModuleNotFoundError():
            package = missing(error)
            if package is None:
                return None
            extra = EXTRAS[package]
            message = f"{package} is not installed; from the checkout: pip install '.[{extra}]'"
        case OSError():
            name = "" if error.filename is None else f" {error.filename}"
            message = f"cannot open{name}: {error.strerror or error}"
        case _:
            return None
    for python, option in _OPTIONS:
        message = re.sub(python, option, message)
    return message


def unexpected(error: Exception) -> str:
    """The message for an error that nobody expected."""
    return f"unexpected {type(error).__name__}: {shorten(str(error), 200)}"
