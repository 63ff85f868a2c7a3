"""`rtamt sweep`: runs an environment on many points of a space."""

from __future__ import annotations

import argparse
import textwrap
import warnings
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from rtamt import InputError, Verdict
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import (
    EPISODES,
    add_folder,
    add_output,
    add_reading,
    add_require_triggered,
    add_workers,
    check_outputs,
    read_reading,
    read_signals,
    whole,
)
from rtamt_gym.commands.ends import noted_ends
from rtamt_gym.commands.errors import options_of, refusal
from rtamt_gym.commands.exit_codes import Hollow, Required, exit_code, tell, unasked, undecided
from rtamt_gym.commands.failures import add_allowed_failures, hollow_failures
from rtamt_gym.commands.specs import add_apart, files_of, requirements_of, told_apart
from rtamt_gym.commands.systems import add_policy, add_system, opened_system
from rtamt_gym.commands.varied import add_varied, read_varied
from rtamt_gym.play.summaries import record_json
from rtamt_gym.tables import counted, shorten

if TYPE_CHECKING:
    from rtamt_gym.results.table import Results
    from rtamt_gym.search.sweeps.sweep import Sweep

__all__ = ["add_arguments", "run"]

_SAMPLERS = ("sobol", "grid", "lhs", "random", "morris", "saltelli")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs a scenario, or another system, on many points of a space; prints the robustness and "
        "the verdicts of its requirements. Exits 0 whatever the verdicts are, 3 if more "
        "simulations failed than --allow-failures lets pass, or if nothing has put a requirement "
        "to the test and --require-triggered is given. With --require-satisfied it exits 1 if "
        "no simulation satisfies a requirement and some violate it."
    )
    parser.epilog = (
        "example: rtamt sweep rtamt/AutomaticTransmission-v0 --requirement AT2 --samples 100"
    )
    add_system(parser)
    parser.add_argument(
        "--requirement",
        action="append",
        default=[],
        metavar="SPEC",
        help="the name of one of the scenario's requirements, such as AT6a; a formula, name = "
        "formula, or the path of a .stl file; may be repeated (default: all of the scenario)",
    )
    parser.add_argument(
        "--signal",
        action="append",
        default=[],
        metavar="NAME=SELECTOR",
        help="what a variable reads, as for rtamt run; variables of a scenario read what they name",
    )
    add_apart(parser)
    add_varied(parser)
    parser.add_argument(
        "--samples",
        required=True,
        metavar="N",
        help="how many points; of a grid, the values of each column: 4, or by name "
        "frequency=4,amplitude=3; of morris, trajectories; of saltelli, a power of two",
    )
    parser.add_argument(
        "--sampler",
        choices=_SAMPLERS,
        default="sobol",
        help="how points are chosen; morris and saltelli print what moves the robustness "
        "(default: sobol)",
    )
    parser.add_argument(
        "--seed",
        type=whole,
        default=0,
        metavar="S",
        help="seed of the points and of the first simulation, one more for each further one "
        "(default: 0)",
    )
    add_policy(parser)
    add_reading(parser, *EPISODES)
    parser.add_argument(
        "--duration", type=float, metavar="SECONDS", help="simulated time (default: to the end)"
    )
    parser.add_argument(
        "--stop",
        choices=("end", "violation", "decided"),
        default="end",
        help="when to stop a simulation (default: end)",
    )
    add_workers(parser)
    add_allowed_failures(parser, None)
    add_folder(parser, "simulation")
    add_require_triggered(parser, "simulation")
    parser.add_argument(
        "--require-satisfied",
        action="store_true",
        help="exit 1 if a requirement is violated and no simulation satisfies it, and 3 if all "
        "leave it undecided",
    )
    add_output(parser, "--save", "write the record as a Parquet file, a row for each simulation")
    add_output(parser, "--json", "write the record as strict JSON")
    add_output(parser, "--heat-map", "draw the robustness over two columns, see --x and --y")
    add_output(parser, "--scatter", "draw the robustness over each column")
    parser.add_argument("--x", metavar="NAME", help="the column to the right in the heat map")
    parser.add_argument("--y", metavar="NAME", help="the column upwards in the heat map")


def run(options: argparse.Namespace) -> int:
    """Runs the sweep, prints what came of it and writes the files asked for; returns 0 or 3."""
    from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning, sweep

    check_outputs(options.save, options.json, picture=options.heat_map)
    check_outputs(options.save, options.json, options.heat_map, picture=options.scatter)
    samples = _read_samples(options.samples)
    signals = read_signals(options.signal)
    with opened_system(options) as opened, noted_ends() as notes:
        entries, numbers = read_varied(options.vary, options.set, opened.scenario)
        named = requirements_of(
            options.requirement, opened.requirements, options.env_id, "--requirement"
        )
        requirements = told_apart(named, options.apart)
        if options.heat_map:
            columns = [c for each in (entries or opened.inputs) for c in each.columns]
            _check_map(columns, requirements, options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FailedSimulationWarning)  # the summary says it
            done = sweep(
                opened.system,
                requirements,
                entries,
                fixed=numbers,
                samples=samples,
                sampler=options.sampler,
                seed=options.seed,
                signals=signals or None,
                policy=opened.policy,
                duration=options.duration,
                **read_reading(options).options(),
                stop=options.stop,
                n_jobs=options.n_jobs,
                timeout=options.timeout,
                folder=options.folder,
                accept_changed=options.accept_changed,
            )
    for name, formula in done.requirements.items():
        print(f"{done.record.provenance.called(name)}: {formula}")
    print("", *done.lines(), "", *_worst(done), sep="\n")
    if options.sampler in {"morris", "saltelli"}:
        for name in done.requirements:
            print("", _moved(done, name), sep="\n")
    if notes:
        print("", *notes, sep="\n")
    _write(done, options)
    failed, every = len(done.record.failed()), counted(len(done.record), "simulation")
    hollow = hollow_failures(done.record, options, f"{failed} of {every} failed")
    hollow += undecided(done.record, "simulation", fails=False)
    hollow += unasked(done.record, "simulation", Required.of(options))
    unsatisfied = _never_satisfied(done.record)
    hollow += [Hollow(text, options.require_satisfied) for text, _ in unsatisfied]
    tell(hollow)
    violated = options.require_satisfied and any(violated for _, violated in unsatisfied)
    return exit_code(["violated"] if violated else [], hollow)


def _never_satisfied(record: Results) -> list[tuple[str, bool]]:
    """Return, for each requirement that no simulation satisfies, a text and if some violate it.

    Args:
        record: The simulations.
    """
    found = []
    for name in record.requirements:
        verdicts = [each.verdict for row in record.rows if (each := row.judged(name)) is not None]
        if verdicts and Verdict.SATISFIED not in verdicts:
            violated = verdicts.count(Verdict.VIOLATED)
            text = (
                f"never satisfied: {name} in 0 of {counted(len(verdicts), 'simulation')}, violated "
                f"in {violated}"
            )
            found.append((text, violated > 0))
    return found


def _read_samples(text: str) -> int | dict[str, int]:
    if "=" not in text:
        return _count(text, text)
    counts: dict[str, int] = {}
    for part in text.split(","):
        name, _, count = (each.strip() for each in part.partition("="))
        counts[name] = _count(count, text)
    return counts


def _count(count: str, text: str) -> int:
    if not (count.isascii() and count.isdecimal()) or int(count) == 0:
        raise InputError(
            f"--samples: expected a whole number above 0, or NAME=N,NAME=N, got {text!r}"
        )
    return int(count)


def _check_map(
    columns: Sequence[str], requirements: Collection[str], options: argparse.Namespace
) -> None:
    """Refuses a heat map that cannot be drawn, before anything runs."""
    from rtamt_gym.search.sweeps.heights import two_of

    if len(requirements) > 1:
        raise InputError(f"--heat-map: expected one --requirement, got {listing(requirements)}")
    two_of(columns, options.x, options.y)


def _worst(done: Sweep) -> Iterator[str]:
    """A line for each requirement: its least robustness, and where that is."""
    for name in done.requirements:
        worst = done.worst(name)
        number = next(i for i, row in enumerate(done.record) if row is worst)
        columns = worst.case.columns()
        where = ", ".join(f"{key}={value:.4g}" for key, value in columns.items())
        height = f"{worst.outcomes[name].robustness:.6g}"
        yield shorten(f"worst of {name}: {height} in simulation {number}: {where}", 80)


def _moved(done: Sweep, name: str) -> str:
    """What moves a requirement, or why that is not known."""
    try:
        return str(done.indices(name))
    except InputError as error:
        said = refusal(error, options_of("sweep"))
        return "\n".join(textwrap.wrap(f"no indices of {name}: {said}", 80))


def _write(done: Sweep, options: argparse.Namespace) -> None:
    """Writes the files that were asked for."""
    if options.save:
        done.save(options.save)
        print(f"record: {options.save}")
    if options.json:
        kept = {key: getattr(options, key) for key in ("sampler", "seed", "stop")}
        record = done.record.of_files(files_of(options.requirement or [], options.policy))
        options.json.write_text(record_json(record, kept) + "\n", encoding="utf-8")
        print(f"record: {options.json}")
    if options.heat_map:
        done.heat_map(options.heat_map, options.x, options.y)
        print(f"heat map: {options.heat_map}")
    if options.scatter:
        done.scatter(options.scatter)
        print(f"scatter: {options.scatter}")
