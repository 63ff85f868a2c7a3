"""The command line: `rtamt demo`, `rtamt run`, `rtamt monitor`.

Exit codes: 0, or 1 where `monitor` finds a violation; 2 on bad input, with one message on stderr.
Gymnasium, MuJoCo and matplotlib are imported by the commands that need them.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import rtamt
from rtamt import InputError, RtamtError, Verdict

if TYPE_CHECKING:
    from rtamt_gym.signals import SignalLike

__all__ = ["main"]

_EXTRAS = {"gymnasium": "gym", "mujoco": "gym", "highway_env": "highway", "matplotlib": "plot"}
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
        options = _parser().parse_args(argv)
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
    _add_demo(commands)
    _add_run(commands)
    _add_monitor(commands)
    return parser


def _add_demo(commands: argparse._SubParsersAction[_Parser]) -> None:
    demo = commands.add_parser(
        "demo",
        help="watch a MuJoCo pendulum and a highway, good drivers and bad",
        description="Runs InvertedPendulum-v5 and highway-fast-v0 with good and bad controllers, "
        "each under two specifications; prints a table and draws a picture. Needs the extras "
        "gym, highway and plot.",
        allow_abbrev=False,
    )
    demo.add_argument("--seed", type=_whole, default=0, help="of the first episode (0)")
    demo.add_argument(
        "--plot",
        type=Path,
        default=Path("rtamt-demo.png"),
        metavar="FILE",
        help="the picture (rtamt-demo.png)",
    )
    demo.set_defaults(run=_demo)


def _add_run(commands: argparse._SubParsersAction[_Parser]) -> None:
    run = commands.add_parser(
        "run",
        help="watch episodes of a Gymnasium environment",
        description="Runs episodes of a registered Gymnasium environment under specifications "
        "and prints what became of them. Exits 0 whatever the verdicts are.",
        epilog="example: rtamt run CartPole-v1 --spec 'upright = always(abs(angle) < 0.1)' "
        "--signal 'angle=obs[2]' --episodes 3",
        allow_abbrev=False,
    )
    run.add_argument("env_id", metavar="ENV_ID", help="such as CartPole-v1 or module:Name-v0")
    run.add_argument(
        "--spec",
        action="append",
        required=True,
        metavar="SPEC",
        help="a formula, name = formula, the path of a .stl file, or name=path; again for more",
    )
    run.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="NAME=SELECTOR",
        help="what a variable reads: obs[2], action[0], reward, info['speed'], qpos[1]; "
        "with its value at reset where reset gives none: u=action[0],0",
    )
    run.add_argument("--episodes", type=_positive, default=1, metavar="N", help="how many (1)")
    run.add_argument(
        "--on-violation",
        choices=("terminate", "truncate", "report"),
        default="terminate",
        help="what a certain violation does to the episode (terminate)",
    )
    run.add_argument(
        "--policy", choices=("random", "zero"), default="random", help="the actions (random)"
    )
    run.add_argument(
        "--seed",
        type=_whole,
        default=0,
        metavar="S",
        help="episode i is reset, and its actions drawn, with seed S + i - 1 (0)",
    )
    run.add_argument(
        "--max-steps",
        type=_positive,
        metavar="N",
        help="time limit of an episode, instead of the environment's own",
    )
    _add_reading(run, "the environment's own")
    run.add_argument("--plot", type=Path, metavar="FILE", help="draw the first violated episode")
    run.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help='write the outcomes as strict JSON, infinities as "inf" and "-inf"',
    )
    run.set_defaults(run=_run)


def _add_monitor(commands: argparse._SubParsersAction[_Parser]) -> None:
    monitor = commands.add_parser(
        "monitor",
        help="judge a recorded trace",
        description="Judges a file of samples: comma-separated values below a line of names. "
        "Columns that the specification does not read are ignored. Exits 1 on a violation, "
        "else 0.",
        allow_abbrev=False,
    )
    monitor.add_argument("spec", metavar="SPEC", help="the path of a .stl file, or a formula")
    monitor.add_argument("trace", metavar="TRACE", help="the path of a .csv file, or - for stdin")
    _add_reading(monitor, "read from a column 'time', else bounds count samples")
    monitor.set_defaults(run=_monitor)


def _add_reading(command: argparse.ArgumentParser, otherwise: str) -> None:
    command.add_argument(
        "--period",
        metavar="TIME",
        help=f"time between samples: 0.1 (seconds) or 100ms ({otherwise})",
    )
    command.add_argument(
        "--view",
        choices=("episode", "step"),
        default="episode",
        help="whether a formula speaks of the whole, as seen from the first sample, "
        "or of every sample (episode)",
    )


def _whole(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a whole number greater than 0, got {text!r}")
    return int(text)


def _monitor(options: argparse.Namespace) -> int:
    from rtamt_gym.judge import judge
    from rtamt_gym.trace import read_trace

    spec = _read_spec(options.spec)
    if options.trace == "-":
        trace = read_trace(sys.stdin, "stdin", spec.variables)
    else:
        with Path(options.trace).open(encoding="utf-8-sig", newline="") as file:
            trace = read_trace(file, options.trace, spec.variables)
    judgement = judge(spec, trace, options.period, options.view)
    print(*judgement.lines(), sep="\n")
    return 1 if judgement.verdict == Verdict.VIOLATED else 0


def _run(options: argparse.Namespace) -> int:
    from rtamt_gym.outcomes import report, saved_note, to_json
    from rtamt_gym.run import POLICIES, Watched, make

    specs = _read_specs(options.spec)
    signals = _read_signals(options.signal)
    for path in filter(None, (options.plot, options.json)):
        _check_folder(path)
    if options.plot:
        from rtamt_gym.plot import check_format, save

        check_format(options.plot)
    env = make(options.env_id, options.max_steps)
    policies = POLICIES[options.policy](env.action_space)
    watched = Watched(
        env,
        specs,
        signals,
        period=options.period,
        on_violation=options.on_violation,
        view=options.view,
    )
    episodes = [watched.episode(policies, options.seed + i) for i in range(options.episodes)]
    env.close()
    for name, spec in specs.items():
        print(f"{name}: {spec.formula}")
    print("", *report(episodes), "", *saved_note(episodes), sep="\n")
    if options.json:
        options.json.write_text(to_json(episodes) + "\n", encoding="utf-8")
        print(f"outcomes: {options.json}")
    if options.plot:
        shown = next((i for i, e in enumerate(episodes) if e.violated_by), 0)
        save([episodes[shown]], options.plot)
        print(f"picture of episode {shown + 1}: {options.plot}")
    return 0


def _demo(options: argparse.Namespace) -> int:
    from rtamt_gym.demo import run
    from rtamt_gym.plot import check_format

    _check_folder(options.plot)
    check_format(options.plot)
    for line in run(options.seed, options.plot):
        print(line, flush=True)
    return 0


def _read_spec(argument: str) -> rtamt.Specification:
    """The specification that an argument means: a path has no blank, bracket or comparison."""
    if re.search(r"[\s(<>=!]", argument) and not Path(argument).is_file():
        return rtamt.parse(argument)
    return rtamt.load(argument)


def _read_specs(arguments: Sequence[str]) -> dict[str, rtamt.Specification]:
    specs: dict[str, rtamt.Specification] = {}
    for argument in arguments:
        named = re.fullmatch(r"(\w+)=([^\s(<>=!]+\.stl)", argument)
        spec = _read_spec(named[2] if named else argument)
        own = (n for n, formula in spec.formulas.items() if formula is spec.formula)
        name = named[1] if named else spec.name or next(own, None)
        if name is None:
            is_path = argument.endswith(".stl")
            name = Path(argument).stem if is_path else f"spec{len(specs) + 1 if specs else ''}"
        if name in specs:
            raise InputError(f"expected one specification {name!r}, got two; name one of them")
        specs[name] = spec
    return specs


def _read_signals(arguments: Sequence[str]) -> dict[str, SignalLike]:
    signals: dict[str, SignalLike] = {}
    for argument in arguments:
        name, _, selector = (part.strip() for part in argument.partition("="))
        if not (name and selector):
            raise InputError(
                f"--signal: expected NAME=SELECTOR, such as angle=obs[2], got {argument!r}"
            )
        if name in signals:
            raise InputError(f"--signal: expected one signal {name!r}, got two")
        signals[name] = selector
        value, comma, reset = selector.rpartition(",")
        if comma and "]" not in reset:  # a comma before a bracket belongs to a key
            try:
                signals[name] = (value, float(reset))
            except ValueError:
                raise InputError(
                    "--signal: expected a number behind the comma, the value at reset, "
                    f"got {argument!r}"
                ) from None
    return signals


def _check_folder(path: Path) -> None:
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}")


if __name__ == "__main__":
    sys.exit(main())
