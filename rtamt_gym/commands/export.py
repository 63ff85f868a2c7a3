"""`rtamt export`: writes a monitor as a functional mock-up unit (FMU) for another tool."""

from __future__ import annotations

import argparse
from pathlib import Path

import rtamt
from rtamt import InputError
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.commands.specs import chosen, read_constants, read_requirements
from rtamt_gym.options.command_line import Option, add_options, read_evaluation_options
from rtamt_gym.tables import shorten


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes a monitor as a functional mock-up unit (FMU) for co-simulation, which Simulink, "
        "OpenModelica, Dymola, FMPy and other tools import. Inputs are the variables, parameters "
        "the constants; outputs are robustness, lower, upper, verdict and the named formulas."
    )
    parser.epilog = "example: rtamt export spec.stl -o monitor.fmu --period 100ms"
    add_options(
        parser,
        Option("SPEC", "a .stl file or a formula"),
        Option("-o FILE", "the file to write", read=Path, required=True, dest="output"),
        Option(
            "--dense",
            "monitor over dense time, with an event at every communication point",
        ),
        Option("--fmi", "version of FMI", default=2, read=int, choices=(2, 3)),
        Option(
            "--stop-on-violation",
            "end the simulation when a violation is certain; a tool can set this as a parameter",
        ),
        Option("--only NAME", "the requirement to export, if there are several", several=True),
        "--constant",
        "--period",
        "--semantics",
        "--align",
    )


def run(options: argparse.Namespace) -> int:
    """Write the file and print its inputs; return 0."""
    check_outputs(options.output, picture=None, inputs=[options.spec])
    reading = read_evaluation_options(options)
    if reading.dense == (reading.period is not None):
        raise InputError(
            "expected --period, the time between samples such as 100ms, or --dense; got "
            f"{'both' if reading.dense else 'neither'}"
        )
    spec = _requirement(options)
    spec.export_fmu(
        options.output,
        period=reading.period,
        dense=reading.dense,
        fmi=options.fmi,
        stop_on_violation=options.stop_on_violation,
        semantics=reading.semantics,
        align=reading.align,
    )
    print(f"{options.output}: FMI {options.fmi}.0, inputs {listing(spec.variables)}")
    if not spec.looks_ahead:
        first = "instant" if reading.dense else "sample"
        print(
            f"note: robustness, lower, upper and verdict depend on the first {first} only. To "
            f"monitor the whole run, write always({shorten(str(spec.formula), 60)})"
        )
    return 0


def _requirement(options: argparse.Namespace) -> rtamt.Specification:
    """Return the requirement that the command line names."""
    requirements = read_requirements([options.spec], read_constants(options.constant))
    specs = list(chosen(requirements, options.only).values())
    if len(specs) > 1:
        raise InputError(
            f"expected one requirement, got {listing(requirements)}; give --only with its name"
        )
    return specs[0]
