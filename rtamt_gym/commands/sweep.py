"""`rtamt sweep`: runs an environment on many points of a space."""

from __future__ import annotations

import argparse
import textwrap
import warnings
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rtamt import InputError, Verdict
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import check_outputs, read_signals
from rtamt_gym.commands.end_notes import noted_ends, short_warnings
from rtamt_gym.commands.errors import options_of, refusal
from rtamt_gym.commands.specs import files_of, requirements_of, selected, told_apart
from rtamt_gym.commands.systems import opened_system, read_varied
from rtamt_gym.options.command_line import (
    EPISODES,
    Option,
    add_options,
    read_evaluation_options,
    shared,
)
from rtamt_gym.play.summaries import record_json
from rtamt_gym.results.warnings import (
    Required,
    VerdictWarning,
    evidence_warnings,
    exit_code,
    failure_warnings,
    print_warnings,
    undecided_warnings,
)
from rtamt_gym.tables import counted, shorten

if TYPE_CHECKING:
    from rtamt_gym.results.statistics import Results
    from rtamt_gym.search.sweeps.sweep import Sweep

_SAMPLERS = ("sobol", "grid", "lhs", "random", "morris", "saltelli")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Simulates a scenario, or another system, at many points of a space; prints the "
        "robustness and the verdicts of its requirements. Exits 0 for any verdicts; "
        "--allow-failures, --require-triggered and --require-satisfied set other exit codes."
    )
    parser.epilog = (
        "example: rtamt sweep rtamt/AutomaticTransmission-v0 --requirement AT2 --samples 100"
    )
    add_options(
        parser,
        "SYSTEM",
        "--env-kwarg",
        Option(
            "--requirement SPEC",
            "a requirement of the scenario, such as AT6a, a formula, name = formula, or a .stl "
            "file",
            usual="all of the scenario",
            repeat=True,
        ),
        "--only",
        "--signal",
        "--distance",
        "--vary",
        "--set",
        Option(
            "--samples N",
            "number of points; for grid, of values of each column, 4 or frequency=4,amplitude=3; "
            "for morris, of trajectories; for saltelli, a power of two",
            required=True,
        ),
        Option(
            "--sampler",
            "how points are chosen; morris and saltelli print which columns affect the robustness",
            default="sobol",
            choices=_SAMPLERS,
        ),
        shared(
            "--seed",
            about="seed of the points and of the first simulation; each further simulation adds 1",
        ),
        "--policy",
        *EPISODES,
        "--duration",
        Option(
            "--stop",
            "when to stop a simulation",
            default="end",
            choices=("end", "violation", "decided"),
        ),
        "-j",
        "--timeout",
        shared("--allow-failures", usual="any number"),
        "--folder",
        "--accept-changed",
        "--require-triggered",
        "--require-answered",
        Option(
            "--require-satisfied",
            "exit 1 if a requirement is violated and no simulation satisfies it, and 3 if all "
            "leave it undecided",
        ),
        Option(
            "--save FILE",
            "write all simulations as a Parquet file, a row for each",
            read=Path,
        ),
        Option("--json FILE", "write all simulations as JSON", read=Path),
        Option("--heat-map FILE", "draw the robustness over the columns --x and --y", read=Path),
        Option("--scatter FILE", "draw the robustness over each column", read=Path),
        Option("--x NAME", "the column to the right"),
        Option("--y NAME", "the column upwards"),
        trial="simulation",
    )


def run(options: argparse.Namespace) -> int:
    """Run the sweep, print the results and write the files; return 0 or 3."""
    from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning, sweep

    check_outputs(options.save, options.json, picture=options.heat_map)
    check_outputs(options.save, options.json, options.heat_map, picture=options.scatter)
    samples = _read_samples(options.samples)
    signals = read_signals(options.signal)
    with opened_system(options) as opened, noted_ends() as notes:
        entries, numbers = read_varied(options.vary, options.set, opened.scenario)
        candidates = requirements_of(
            options.requirement, opened.requirements, options.env_id, "--requirement"
        )
        specs, signals = selected(candidates, options.only, signals)
        requirements = told_apart(specs, options.distance)
        if options.heat_map:
            columns = [c for entry in (entries or opened.inputs) for c in entry.columns]
            _check_map(columns, requirements, options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FailedSimulationWarning)  # the summary contains it
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
                **read_evaluation_options(options).options(),
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
    failed, total = len(done.record.failed()), counted(len(done.record), "simulation")
    verdict_warnings = failure_warnings(
        failed, options.allow_failures, f"{failed} of {total} failed"
    )
    verdict_warnings += undecided_warnings(done.record, "simulation", fails=False)
    verdict_warnings += evidence_warnings(done.record, "simulation", Required.of(options))
    verdict_warnings += short_warnings(done.record, options)
    unsatisfied = _never_satisfied(done.record)
    fails = options.require_satisfied
    verdict_warnings += [VerdictWarning(text, fails=fails) for text, _ in unsatisfied]
    print_warnings(verdict_warnings)
    violated = options.require_satisfied and any(violated for _, violated in unsatisfied)
    return exit_code(["violated"] if violated else [], verdict_warnings)


def _never_satisfied(record: Results) -> list[tuple[str, bool]]:
    """Return texts on requirements that no simulation satisfies, and whether some violate them."""
    texts = []
    for name in record.requirements:
        verdicts = [
            judged.verdict for row in record.rows if (judged := row.judged(name)) is not None
        ]
        if verdicts and Verdict.SATISFIED not in verdicts:
            violated = verdicts.count(Verdict.VIOLATED)
            text = (
                f"never satisfied: {name} in 0 of {counted(len(verdicts), 'simulation')}, violated "
                f"in {violated}"
            )
            texts.append((text, violated > 0))
    return texts


def _read_samples(text: str) -> int | dict[str, int]:
    if "=" not in text:
        return _count(text, text)
    counts: dict[str, int] = {}
    for part in text.split(","):
        name, _, count = (word.strip() for word in part.partition("="))
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
    """Refuse a heat map that cannot be drawn, before anything runs."""
    from rtamt_gym.search.sweeps.effects import two_of

    if len(requirements) > 1:
        raise InputError(f"--heat-map: expected one --requirement, got {listing(requirements)}")
    two_of(columns, options.x, options.y)


def _worst(done: Sweep) -> Iterator[str]:
    """Yield a line for each requirement: its minimum robustness, and where that is."""
    for name in done.requirements:
        worst = done.worst(name)
        number = next(i for i, row in enumerate(done.record) if row is worst)
        columns = worst.case.columns()
        where = ", ".join(f"{key}={value:.4g}" for key, value in columns.items())
        height = f"{worst.outcomes[name].robustness:.6g}"
        yield shorten(f"worst of {name}: {height} in simulation {number}: {where}", 80)


def _moved(done: Sweep, name: str) -> str:
    """Return the parameters that move a requirement, or why they are not known."""
    try:
        return str(done.indices(name))
    except InputError as error:
        message = refusal(error, options_of("sweep"))
        return "\n".join(textwrap.wrap(f"no indices of {name}: {message}", 80))


def _write(done: Sweep, options: argparse.Namespace) -> None:
    """Write the output files."""
    if options.save:
        done.save(options.save)
        print(f"record: {options.save}")
    if options.json:
        settings = {key: getattr(options, key) for key in ("sampler", "seed", "stop")}
        record = done.record.with_files(files_of(options.requirement or [], options.policy))
        options.json.write_text(record_json(record, settings) + "\n", encoding="utf-8")
        print(f"record: {options.json}")
    if options.heat_map:
        done.heat_map(options.heat_map, options.x, options.y)
        print(f"heat map: {options.heat_map}")
    if options.scatter:
        done.scatter(options.scatter)
        print(f"scatter: {options.scatter}")
