"""`rtamt run`: runs episodes of a Gymnasium environment under specifications."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing, nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from rtamt import InputError, SpecificationError
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import check_outputs, hold, open_view, read_options, read_signals
from rtamt_gym.commands.end_notes import noted_ends
from rtamt_gym.commands.specs import requirements_of, selected
from rtamt_gym.options.command_line import Option, add_options, positive, read_evaluation_options
from rtamt_gym.play.summaries import run_table, runs_json
from rtamt_gym.results.warnings import (
    Required,
    evidence_warnings,
    exit_code,
    print_warnings,
)

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.play.run import Run
    from rtamt_gym.play.summaries import Episode
    from rtamt_gym.watching.screen import Screen


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs episodes of a registered Gymnasium environment under specifications and prints "
        "their robustness and verdicts. Exits 0 for any verdicts, 2 if an episode failed, and "
        "with --require-triggered 3 if no episode triggers a requirement."
    )
    parser.epilog = (
        "example: rtamt run CartPole-v1 --spec 'upright = always(abs(angle) < 0.1)' "
        "--signal 'angle=obs[2]' --episodes 3"
    )
    add_options(
        parser,
        "ENV_ID",
        "--env-kwarg",
        "--spec",
        "--only",
        Option(
            "--signal NAME=SELECTOR",
            "the selector of a variable, which rtamt envs ENV_ID lists: obs[2], action[0], "
            "reward, info['speed'], qpos[1]; without a value at reset it needs a first value: "
            "u=action[0],0",
            repeat=True,
        ),
        Option("--episodes N", "number of episodes", default=1, read=positive),
        Option(
            "--on-violation",
            "what happens to an episode once a violation is certain",
            default="terminate",
            choices=("terminate", "truncate", "report"),
        ),
        "--at-termination",
        "--at-truncation",
        Option(
            "--policy POLICY",
            "random, zero, baseline (of the scenario), sb3:FILE.zip (Stable-Baselines3, "
            "deterministic; it contains pickles, so load only files that you trust), "
            "module:function, from observation to action, or module:Class, created for each "
            "episode",
            default="random",
        ),
        "--seed",
        "--max-steps",
        "--substeps",
        "--period",
        "--view",
        "--semantics",
        "--align",
        "--require-triggered",
        "--require-answered",
        Option(
            "--screen",
            "draw verdicts and robustness with bounds on the terminal while an episode runs, by "
            "standard error",
        ),
        Option(
            "--speed FACTOR",
            "with --screen: simulated seconds in a second, 1 for real time",
            usual="as fast as possible",
            read=float,
        ),
        "--rerun",
        Option("--plot FILE", "draw the first violated episode", read=Path),
        Option(
            "--json FILE",
            'write the outcomes as JSON, with "inf" and "-inf" for infinities',
            read=Path,
        ),
        trial="episode",
    )


def run(options: argparse.Namespace) -> int:
    """Run the episodes, print a table and write files; return 0, 2 or 3."""
    kwargs = read_options(options.env_kwarg)
    pictures = 1 if kwargs.get("render_mode") == "rgb_array" else None
    with open_view(options.rerun, pictures=pictures) or nullcontext() as view:
        code = _run(options, kwargs, view)
        if view is not None:
            hold(view)
    return code


def _run(options: argparse.Namespace, kwargs: Mapping[str, Any], view: RerunView | None) -> int:
    """Run the episodes, as `run` does."""
    from rtamt_gym.judging.specs import own_requirements
    from rtamt_gym.play.record import Record
    from rtamt_gym.play.simulate import simulate
    from rtamt_gym.play.summaries import failures, saved_note, trial_of
    from rtamt_gym.results.trial import Trial, end_note
    from rtamt_gym.systems.policies import policy_of
    from rtamt_gym.systems.registry import make

    signals, reading = read_signals(options.signal), read_evaluation_options(options)
    check_outputs(options.json, picture=options.plot)
    screen = _screen(options)
    with closing(make(options.env_id, options.max_steps, kwargs)) as env, noted_ends() as notes:
        own = own_requirements(env)
        requirements = requirements_of(options.spec, own, options.env_id, "--spec")
        specs, signals = selected(requirements, options.only, signals)
        make_policy = policy_of(options.policy, env)

        run_one = simulate if screen is None else _shown(screen, options)

        def play(seed: int) -> Run:
            return run_one(
                env,
                specs,
                signals,
                policy=make_policy(seed),
                seed=seed,
                stop="end" if options.on_violation == "report" else "violation",
                live=view,
                **reading.options(),
            )

        with screen or nullcontext():
            episodes = _played(play, range(options.seed, options.seed + options.episodes))
    for name, spec in specs.items():
        print(f"{name}: {spec.formula}")
    texts = {name: str(spec.formula) for name, spec in specs.items()}
    record = Record(map(trial_of, episodes), texts)
    failed = failures(record, rated=False)
    unread = [
        name for name in signals if all(name not in spec.variables for spec in specs.values())
    ]
    if unread:
        notes.append(f"signals that no specification reads: {listing(unread)}")
    shown_below = [*failed, *end_note(record), *saved_note(episodes), *notes]
    print("", *run_table(episodes), *[""] * bool(shown_below), *shown_below, sep="\n")
    if options.json:
        readings = {
            "on_violation": options.on_violation,
            "at_termination": reading.at_termination,
            "at_truncation": reading.at_truncation,
        }
        options.json.write_text(runs_json(episodes, readings) + "\n", encoding="utf-8")
        print(f"outcomes: {options.json}")
    if options.plot:
        from rtamt_gym.drawing import save
        from rtamt_gym.play.run import draw

        runs = {
            i: episode for i, episode in enumerate(episodes, 1) if not isinstance(episode, Trial)
        }
        number = next((i for i, run in runs.items() if run.violated_by), min(runs))
        save(draw([runs[number]]), options.plot)
        print(f"picture of episode {number}: {options.plot}")
    warnings = evidence_warnings(record, "episode", Required.of(options))
    print_warnings(warnings)
    return exit_code(["failed"] if failed else [], warnings)


def _screen(options: argparse.Namespace) -> Screen | None:
    """Return the view of the episodes, if there is one."""
    if options.speed is not None and not options.screen:
        raise InputError("--speed paces the view of --screen. Add --screen, or leave it out.")
    if options.speed is not None and not 0 < options.speed < math.inf:
        raise InputError(f"--speed: expected a factor above 0, such as 1, got {options.speed:g}")
    if not options.screen:
        return None
    from rtamt_gym.watching.screen import open_screen

    return open_screen(options.env_id, unit="sample")


def _shown(screen: Screen, options: argparse.Namespace) -> Callable[..., Run]:
    """Return a function that runs an episode as `simulate` does, on the screen."""
    from rtamt_gym.watching.screen import RunScreen

    run_screen = RunScreen(screen, options.speed)

    def run_one(*arguments: Any, seed: int, **keywords: Any) -> Run:  # noqa: ANN401 - of `simulate`
        title = options.env_id
        if options.episodes > 1:
            title += f", episode {seed - options.seed + 1} of {options.episodes}"
        return run_screen.simulate(title, *arguments, seed=seed, **keywords)

    return run_one


def _played(play: Callable[[int], Run], seeds: Iterable[int]) -> list[Episode]:
    """Play an episode of each seed, and record failed episodes.

    If all episodes fail, the first error is raised. An error of a specification is raised at once,
    because it would be the same in every episode.
    """
    from rtamt_gym.inputs.case import Case
    from rtamt_gym.play.simulation import failed
    from rtamt_gym.results.trial import Trial

    first: Exception | None = None
    episodes: list[Episode] = []
    for seed in seeds:
        began = perf_counter()
        try:
            episodes.append(play(seed))
        except SpecificationError:
            raise
        except Exception as error:  # noqa: BLE001 - the others are to be shown
            first = error if first is None else first
            episodes.append(failed(error, Case({}), seed, perf_counter() - began))
    if first is not None and all(isinstance(episode, Trial) for episode in episodes):
        raise first
    return episodes
