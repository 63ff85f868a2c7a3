"""Options of the command line: a row for each.

A command lists its options in `add_options`: by the flags of the rows here, which several commands
share, and as rows of its own. The evaluation options come from `rtamt_gym.options.evaluation`.

To add an option that several commands share, add a row to `_SHARED`, and its flag to
``add_options`` of each command. An option of one command is a row in that command. Then run
``tests/support/command_options.py``, which writes ``docs/reference/commands.md``.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable
from dataclasses import Field, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

from rtamt import InputError, RtamtError
from rtamt_gym.options.evaluation import ROWS, EvaluationOptions, seconds_of


@dataclass(frozen=True, slots=True)
class Option:
    """An option of a command, or an argument without a flag.

    Attributes:
        name: The flag and its value, as the help shows them: ``"--seed S"``. An option without a
            value is a switch; a name without a flag, ``"SPEC"``, is an argument.
        about: The sentence of the help; ``{trial}`` stands for the word of the command.
        default: The default.
        usual: The default in words, where the help does not show the value.
        read: The function that reads the text.
        choices: All values, if they are few.
        repeat: Whether the option may be repeated; its value is a list then.
        several: Whether to collect repetitions in a list, so that the command can report them.
        nargs: As for `argparse`.
        required: Whether a command line needs it.
        dest: The attribute that holds the value, if it is not the name.
        alias: A second flag.
    """

    name: str
    about: str
    default: Any = None
    usual: str = ""
    read: Callable[[str], Any] | None = None
    choices: Iterable[Any] = ()
    repeat: bool = False
    several: bool = False
    nargs: str | int | None = None
    required: bool = False
    dest: str = ""
    alias: str = ""

    def add_to(self, parser: argparse._ActionsContainer, trial: str) -> None:
        """Add the option to a parser or to a group."""
        flag, _, value = self.name.partition(" ")
        flags = [option_flag for option_flag in (flag, self.alias) if option_flag]
        keywords: dict[str, Any] = {"help": self._help(trial), "default": self.default}
        if not flag.startswith("-"):
            flags, value = [self.dest or flag.lower()], flag
        elif self.dest:
            keywords["dest"] = self.dest
        if not value and not self.choices:
            keywords["action"] = "store_true"
            keywords["default"] = False if self.default is None else self.default
        else:
            keywords |= {"metavar": value or None, "type": self.read}
            keywords |= {"choices": tuple(self.choices)} if self.choices else {}
            keywords |= {"nargs": self.nargs} if self.nargs else {}
            keywords |= {"required": True} if self.required else {}
        if self.repeat or self.several:
            keywords["action"] = "append"
            keywords["default"] = [] if self.default is None else self.default
        parser.add_argument(*flags, **keywords)

    def _help(self, trial: str) -> str:
        text = self.about.replace("{trial}", trial).replace("%", "%%")
        usual = self.usual or str(self.default)
        shown = self.usual or not (self.default in {None, argparse.SUPPRESS} or "(default" in text)
        repeated = "; may be repeated" if self.repeat else ""
        return f"{text}{repeated}" + (f" (default: {usual})" if shown else "")


def whole(text: str) -> int:
    """Read a whole number."""
    if not (text.isascii() and text.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}")
    return int(text)


def positive(text: str) -> int:
    """Read a whole number greater than 0."""
    if not (text.isascii() and text.isdecimal()) or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a whole number greater than 0, got {text!r}")
    return int(text)


def seconds(text: str) -> float:
    """Read a number of seconds, or a time with a unit."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return float(seconds_of(text) or 0)
    except RtamtError:
        message = f"expected a time, such as 20, 20s or 2min, got {text!r}"
        raise argparse.ArgumentTypeError(message) from None


def trials(text: str) -> int | Literal["all"]:
    """Read the value of ``--require-triggered``."""
    if text == "all":
        return "all"
    if not (text.isascii() and text.isdecimal()) or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected all or a whole number above 0, got {text!r}")
    return int(text)


ALTHOUGH_CHANGED = (
    "although the model, its source, its policy, rtamt or the simulator has changed; the output "
    "states it"
)

_SHARED = (
    Option("ENV_ID", "such as CartPole-v1 or module:Name-v0"),
    Option(
        "SYSTEM",
        "the id of an environment, such as CartPole-v1 or module:Name-v0; module:function or a "
        ".fmu file, which need --vary",
        dest="env_id",
    ),
    Option(
        "--env-kwarg KEY=VALUE",
        "an argument of the environment, in JSON or as text: frame_skip=2, "
        "'config={\"duration\": 20}'",
        repeat=True,
    ),
    Option(
        "--spec SPEC",
        "a formula, name = formula, a .stl file, name=path, or a requirement of the scenario",
        repeat=True,
        usual="all of the scenario",
    ),
    Option(
        "--signal NAME=SELECTOR",
        "the selector of a variable, as for rtamt run; a scenario has its own signals",
        repeat=True,
    ),
    Option("--only NAME", "evaluate only this requirement", repeat=True),
    Option(
        "--rerun FILE",
        "show signals, robustness and verdicts in Rerun, in a browser until Ctrl-C or in a .rrd "
        "file",
        default=False,
        usual="no view",
        nargs="?",
    ),
    Option(
        "--constant NAME=VALUE",
        "the value of a constant, instead of the value in the text",
        repeat=True,
    ),
    Option(
        "--policy POLICY",
        "the policy, if no signal sets the action: zero, baseline, sb3:FILE.zip or module:function",
        usual="the scenario's own",
    ),
    Option("--seed S", "seed of the first {trial}; each further {trial} adds 1", 0, read=whole),
    Option(
        "--max-steps N",
        "time limit of an episode in steps",
        usual="the environment's own",
        read=positive,
    ),
    Option(
        "--duration SECONDS",
        "simulated time, such as 20, 20s or 2min",
        usual="to the end",
        read=seconds,
    ),
    Option(
        "-j N",
        "number of processes; a crash loses only its own simulation",
        read=positive,
        dest="n_jobs",
    ),
    Option(
        "--timeout SECONDS",
        "end a simulation that takes longer, even if it hangs",
        read=float,
    ),
    Option(
        "--folder FOLDER",
        "keep finished {trial}s there, so that the same command continues after an interruption",
        read=Path,
    ),
    Option(
        "--accept-changed",
        f"use the {{trial}}s in --folder {ALTHOUGH_CHANGED}",
    ),
    Option(
        "--allow-failures N",
        "exit 3 if more than N simulations fail",
        read=whole,
    ),
    Option(
        "--require-triggered N",
        "exit 3 if fewer than N {trial}s trigger a requirement with an implication; write "
        "--require-triggered=5 or =all (default without =N: 1)",
        read=trials,
    ),
    Option(
        "--require-answered",
        "also exit 3 if no {trial} answers such a requirement: each satisfies it without an "
        "answer, or leaves it undecided",
    ),
    Option(
        "--min-duration TIME",
        "exit 3 if a trace is shorter, such as 10s or 2h",
    ),
    Option(
        "--distance OTHER",
        "evaluate 'REQUIREMENT iff OTHER', which is violated where only one of the two holds; "
        "OTHER may be a mutant that survived rtamt monitor --mutants",
    ),
    Option(
        "--vary NAME=LOW:HIGH",
        "vary a parameter, mass=1:2, mass=1:2,log or gear=1|2|3; a signal over time, "
        "throttle=0:100,points=7, with ,linear or ,pchip to interpolate; or an input or parameter "
        "of the scenario by its name",
        usual="the inputs of the scenario",
        repeat=True,
    ),
    Option(
        "--set NAME=NUMBER",
        "a parameter with one value in all simulations",
        repeat=True,
    ),
)


def _evaluation(row: Field[Any]) -> Option:
    """Return the row of an evaluation option; a command line without the option sets nothing."""
    about = re.sub(
        r"``(\w+)``",
        lambda name: _flag(name[1]) if name[1] in ROWS else name[1],
        row.metadata["about"],
    )
    about = re.sub(r'`+"?|"?`+', "", about).rstrip(".").removeprefix("Whether to ")
    choices = [choice for choice in row.metadata["choices"] if choice is not None]
    return Option(
        f"{_flag(row.name)} {row.metadata['metavar']}".strip(),
        about[0].lower() + about[1:],
        argparse.SUPPRESS,
        "" if row.type == "bool" or row.default is None else str(row.default),
        choices=choices,
    )


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


EPISODES = (
    *("--period", "--view", "--semantics", "--align", "--at-termination", "--at-truncation"),
    *("--below", "--rescaled"),
)
"""The evaluation options of commands that play episodes."""


def shared(flag: str, **changes: Any) -> Option:  # noqa: ANN401 - fields of `Option`
    """Return the row with this flag, with changes where a command differs."""
    name = flag.removeprefix("--").replace("-", "_")
    if flag.startswith("--") and name in ROWS and name != "stages":
        return replace(_evaluation(ROWS[name]), **changes)
    return replace(_BY_FLAG[flag], **changes)


_BY_FLAG = {option.name.partition(" ")[0]: option for option in _SHARED}


def add_options(
    parser: argparse._ActionsContainer, *options: str | Option, trial: str = "trial"
) -> None:
    """Add options to a parser or a group: flags of shared rows, and rows, in the order of the help.

    ``trial`` is the word of the command for one run, such as ``"episode"``.
    """
    for option in options:
        (shared(option) if isinstance(option, str) else option).add_to(parser, trial)


def read_evaluation_options(arguments: argparse.Namespace) -> EvaluationOptions:
    """Return the evaluation options of a command line."""
    return EvaluationOptions(
        **{name: value for name, value in vars(arguments).items() if name in ROWS}
    )


def with_default_count(words: Iterable[str]) -> list[str]:
    """Return the command line with ``=1`` after each bare ``--require-triggered``.

    The word after the bare option is an argument of its own, such as a specification.
    """
    listed = [*words]
    for option, value in pairwise(listed):
        if option == "--require-triggered" and (value == "all" or value.isdecimal()):
            raise InputError(f"{option} takes its number after '=': write {option}={value}")
    return [f"{word}=1" if word == "--require-triggered" else word for word in listed]
