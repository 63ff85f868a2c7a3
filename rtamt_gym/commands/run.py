"""`rtamt run`: episodes of a Gymnasium environment, watched."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rtamt import InputError
from rtamt_gym.commands.arguments import (
    Commands,
    add_reading,
    check_folder,
    positive,
    read_specs,
    whole,
)

if TYPE_CHECKING:
    from rtamt_gym.signals.signals import SignalLike

__all__ = ["add"]


def add(commands: Commands) -> None:
    """Adds the arguments of `rtamt run`."""
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
    run.add_argument("--episodes", type=positive, default=1, metavar="N", help="how many (1)")
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
        type=whole,
        default=0,
        metavar="S",
        help="episode i is reset, and its actions drawn, with seed S + i - 1 (0)",
    )
    run.add_argument(
        "--max-steps",
        type=positive,
        metavar="N",
        help="time limit of an episode, instead of the environment's own",
    )
    add_reading(run, "the environment's own")
    run.add_argument("--plot", type=Path, metavar="FILE", help="draw the first violated episode")
    run.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help='write the outcomes as strict JSON, infinities as "inf" and "-inf"',
    )
    run.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from rtamt_gym.simulation.outcomes import report, saved_note, to_json
    from rtamt_gym.simulation.policies import POLICIES, make
    from rtamt_gym.simulation.simulate import simulate

    specs = read_specs(options.spec)
    signals = _read_signals(options.signal)
    for path in filter(None, (options.plot, options.json)):
        check_folder(path)
    if options.plot:
        from rtamt_gym.drawing import check_format
        from rtamt_gym.simulation.plot import save

        check_format(options.plot)
    env = make(options.env_id, options.max_steps)
    policies = POLICIES[options.policy](env.action_space)
    runs = [
        simulate(
            env,
            specs,
            signals,
            policy=policies(seed),
            seed=seed,
            period=options.period,
            stop="end" if options.on_violation == "report" else "violation",
            view=options.view,
        )
        for seed in range(options.seed, options.seed + options.episodes)
    ]
    env.close()
    for name, spec in specs.items():
        print(f"{name}: {spec.formula}")
    print("", *report(runs), "", *saved_note(runs), sep="\n")
    if options.json:
        options.json.write_text(to_json(runs, options.on_violation) + "\n", encoding="utf-8")
        print(f"outcomes: {options.json}")
    if options.plot:
        shown = next((i for i, run in enumerate(runs) if run.violated_by), 0)
        save([runs[shown]], options.plot)
        print(f"picture of episode {shown + 1}: {options.plot}")
    return 0


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
