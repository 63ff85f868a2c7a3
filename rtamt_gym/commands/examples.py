"""`rtamt examples`: shows traces that satisfy and violate requirements."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import Any

import rtamt
from rtamt.checking import Example, ExampleTrace, RequirementExamples
from rtamt_gym.commands.example_traces import (
    add_search,
    answer_data,
    code_of,
    drawn,
    read_period,
    read_rates,
    trace_data,
    write,
)
from rtamt_gym.commands.specs import chosen, read_constants, read_requirements
from rtamt_gym.options.command_line import Option, add_options, positive
from rtamt_gym.results.codec import document
from rtamt_gym.tables import number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Shows a few traces that satisfy each requirement and a few that violate it, as "
        "different as possible: answered at the last moment and one sample too late, never "
        "triggered, exactly at a threshold. Read them before you trust a requirement. The "
        "monitors confirmed each verdict."
    )
    parser.epilog = "example: rtamt examples requirements.stl --period 100ms --save traces"
    add_search(parser, horizon=1000, why=", because many traces are searched for")
    add_options(
        parser,
        Option(
            "--count N", "maximum number of examples of a requirement", default=10, read=positive
        ),
    )


def run(options: argparse.Namespace) -> int:
    """Print the examples; return 1 if no trace satisfies, or none violates, a requirement."""
    specs = chosen(read_requirements(options.specs, read_constants(options.constant)), options.only)
    period = read_period(options, specs)
    examples = rtamt.examples(
        specs,
        period,
        count=options.count,
        end=options.end,
        assume=options.assume,
        rates=read_rates(options.rate),
        horizon=options.horizon,
        timeout=options.timeout,
    )
    if options.save is not None:
        write(_files(examples), options.save)
    print(_json(examples, options) if options.json else "\n".join(_lines(examples)))
    return code_of(requirement.answer for requirement in examples.values())


def _lines(examples: Mapping[str, RequirementExamples]) -> Iterator[str]:
    for index, (name, requirement) in enumerate(examples.items()):
        if index:
            yield ""
        yield from wrap(f"{name}: {requirement.text}", 80, subsequent_indent="    ")
        for verb, answer in (
            ("satisfies", requirement.satisfiable),
            ("violates", requirement.falsifiable),
        ):
            if answer.answer == "no":
                yield from _text(f"no trace {verb} it{str(answer)[2:]}: rtamt check shows why")
            elif answer.answer == "unknown":
                yield from _text(f"not known whether a trace {verb} it: {answer.why}")
        for i, example in enumerate(requirement.examples):
            yield ""
            yield from _example_lines(i + 1, example)
        if requirement.missing or requirement.unknown:
            yield ""
        for why in requirement.missing:
            yield from _text(f"no trace shows it: {why}")
        for why, reason in requirement.unknown.items():
            yield from _text(f"not known whether there is one: {why} ({reason})")


def _example_lines(position: int, example: Example) -> Iterator[str]:
    verdict = example.verdict.name.lower()
    if example.robustness is not None:
        verdict += f", robustness {number(example.robustness)}"
    yield from _text(f"{position} {verdict}: {example.why}")
    yield from drawn(example.trace)


def _text(text: str) -> list[str]:
    return wrap(text, 80, subsequent_indent="  ", break_on_hyphens=False)


def _json(examples: Mapping[str, RequirementExamples], options: argparse.Namespace) -> str:
    first = next(iter(examples.values()))
    return document(
        "examples",
        {
            "period": first.period,
            "end": options.end,
            "requirements": {name: requirement.text for name, requirement in examples.items()},
            "results": {name: _data(requirement) for name, requirement in examples.items()},
        },
    )


def _data(requirement: RequirementExamples) -> dict[str, Any]:
    return {
        "says": requirement.answer,
        "satisfiable": answer_data(requirement.satisfiable),
        "falsifiable": answer_data(requirement.falsifiable),
        "examples": [
            {
                "kinds": example.kinds,
                "why": example.why,
                "verdict": example.verdict,
                "robustness": example.robustness,
                "trace": trace_data(example.trace),
            }
            for example in requirement.examples
        ],
        "missing": requirement.missing,
        "unknown": requirement.unknown,
    }


def _files(examples: Mapping[str, RequirementExamples]) -> Iterator[tuple[str, ExampleTrace]]:
    for name, requirement in examples.items():
        for i, example in enumerate(requirement.examples):
            words = f"{name}-{i + 1:02}-{example.verdict.name.lower()}-{example.kinds[0]}"
            yield words, example.trace
