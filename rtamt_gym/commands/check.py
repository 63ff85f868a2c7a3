"""`rtamt check`: checks requirements for contradictions, tautologies and vacuity."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from textwrap import wrap
from typing import Any

import rtamt
from rtamt import Specification
from rtamt.checking import Answer, Check, CheckedRequirement
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.commands.example_traces import (
    add_search,
    answer_data,
    code_of,
    draw_traces,
    drawn,
    equivalence_data,
    read_period,
    read_rates,
    write,
)
from rtamt_gym.commands.specs import chosen, files_of, read_constants, read_requirements
from rtamt_gym.options.command_line import Option, add_options
from rtamt_gym.results.codec import document, plain
from rtamt_gym.results.provenance import Provenance


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Checks requirements without a simulation: whether each can be satisfied, violated and "
        "triggered, whether each of its parts has an effect, and whether all can be satisfied "
        "together. Every yes comes with a trace that the monitors confirmed; every no states up "
        "to which length it holds."
    )
    parser.epilog = "example: rtamt check requirements.stl --period 100ms --assume 'always(v >= 0)'"
    add_search(parser, horizon=10_000)
    add_options(
        parser,
        Option("--plot FILE", "draw the traces", read=Path),
        Option(
            "--same-as OTHER",
            "only check whether the same traces satisfy this formula or .stl file; several "
            "requirements are paired by name",
            repeat=True,
        ),
    )


def run(options: argparse.Namespace) -> int:
    """Check each requirement and all together; return 1 if something is wrong."""
    check_outputs(picture=options.plot, inputs=files_of(options.specs))
    requirements = read_requirements(options.specs, read_constants(options.constant))
    specs, others = chosen(requirements, options.only), read_requirements(options.same_as)
    if options.only and not others.keys().isdisjoint(specs):  # they are paired by name
        others = {name: other for name, other in others.items() if name in specs}
    period = read_period(options, specs, others)
    check = rtamt.check(
        specs,
        period,
        end=options.end,
        assume=options.assume,
        rates=read_rates(options.rate),
        same_as=others or None,
        horizon=options.horizon,
        timeout=options.timeout,
    )
    if options.save is not None:
        named = (
            ("-".join(filter(None, [n, phrase])), trace) for n, phrase, trace in check.traces()
        )
        write(named, options.save)
    if options.json:
        print(document(*_data(check, specs, others, period, options)))
    elif others:
        print(*_compared(check, specs, others), sep="\n")
    else:
        print(*_lines(check, specs, _files(options.specs)), sep="\n")
    if options.plot:
        print(_drawn(check, period, options.plot), file=sys.stderr if options.json else sys.stdout)
    return code_of([check.answer])


def _drawn(check: Check, period: Fraction | None, path: Path) -> str:
    """Draw the traces; return a line about the picture, or that there is no trace."""
    from rtamt_gym.drawing import save

    traces = [
        (" ".join(filter(None, [name, phrase])), trace) for name, phrase, trace in check.traces()
    ]
    if not traces:
        return f"no picture: there is no trace to draw in {path}"
    save(draw_traces(traces, period), path)
    return f"picture: {path}"


def _files(arguments: Sequence[str]) -> dict[str, str]:
    """Return the files among the arguments by their text."""
    paths = [Path(path) for path in files_of(arguments) if path.endswith(".stl")]
    return {path.read_text(encoding="utf-8-sig"): f"{path}:" for path in paths if path.is_file()}


def _compared(
    check: Check, specs: Mapping[str, Specification], others: Mapping[str, Specification]
) -> Iterator[str]:
    """Yield comparisons of requirements that share a name."""
    for name, same in check.same.items():
        yield f"{_titled(name, specs[name])}:"
        for side, spec in (("one", specs[name]), ("other", _other(name, others))):
            yield from _row(side, str(spec.formula))
        yield from _row("same", str(same))
        yield ""
    yield from _traces(check)
    yield {
        "yes": "they are the same",
        "no": "they differ: see above",
        "unknown": "no difference found, but some answers are unknown: see above",
    }[check.answer]


def _other(name: str, others: Mapping[str, Specification]) -> Specification:
    return others[name] if name in others else next(iter(others.values()))


def _titled(name: str, spec: Specification) -> str:
    return name if spec.id is None else f"{name} ({spec.id})"


def _lines(
    check: Check, specs: Mapping[str, Specification], files: Mapping[str, str]
) -> Iterator[str]:
    for name, requirement in check.requirements.items():
        title = _titled(name, specs[name])
        yield from wrap(f"{title}: {requirement.text}", 80, subsequent_indent="    ")
        yield from _of_one(requirement, files.get(specs[name].text, ""))
        yield ""
    if check.together is not None:
        yield from _of_all(check, check.together)
        yield ""
    yield from _traces(check)
    yield {
        "yes": "no problems found",
        "no": "problems found: see above",
        "unknown": "no problems found, but some answers are unknown: see above",
    }[check.answer]


def _traces(check: Check) -> Iterator[str]:
    for name, phrase, trace in check.traces():
        if phrase != "satisfied":
            purpose = phrase.replace("asked", "triggered")
            yield " ".join(filter(None, [name, f"{purpose}:"]))
            yield from drawn(trace)
            yield ""


def _of_one(requirement: CheckedRequirement, file: str) -> Iterator[str]:
    yield from _said("satisfied", requirement.satisfiable)
    yield from _clashes(requirement.satisfiable, "clashes", file)
    yield from _said("violated", requirement.falsifiable)
    yield from _clashes(requirement.falsifiable, "as", file)
    for text, answer in requirement.triggers.items():
        yield from _said("triggered", answer, f": {text}")
    for idle in requirement.redundant:
        yield from _row("redundant", str(idle))
    for text, why in requirement.unknown.items():
        yield from _row("parts", f"unknown whether {text} decides something: {why}")


def _clashes(answer: Answer, word: str, file: str) -> Iterator[str]:
    for part, position in zip(answer.clash, answer.places, strict=True):
        where = f" at {file}{position[0]}:{position[1]}" if position else ""
        yield from _row("", f"{word}: {part}{where}")


def _of_all(check: Check, together: Answer) -> Iterator[str]:
    yield from _said("together", together)
    if check.conflict:
        yield from _row("conflict", ", ".join(check.conflict))
    for (name, text), answer in check.triggers.items():
        if answer.answer != "yes":
            yield from _row("triggered", f"{name}, where all are satisfied: {answer}: {text}")
    for one, other in check.implied.items():
        yield from _row("implied", f"{one} by {other}")
    for one, other in check.equal:
        yield from _row("equal", f"{one} and {other}")
    for (one, other), why in check.unknown.items():
        yield from _row("unknown", f"whether {one} or {other} implies the other: {why}")


def _said(what: str, answer: Answer, more: str = "") -> list[str]:
    return _row(what, f"{answer}{more}")


def _row(what: str, text: str) -> list[str]:
    return wrap(
        f"  {what:<11}{text}",
        80,
        subsequent_indent=" " * 13,
        break_on_hyphens=False,
        break_long_words=False,
    )


def _data(
    check: Check,
    specs: Mapping[str, Specification],
    others: Mapping[str, Specification],
    period: Fraction | None,
    options: argparse.Namespace,
) -> tuple[str, dict[str, Any]]:
    """Return the kind of a result, and its fields without the head."""
    head = {
        "period": period,
        "end": options.end,
        "horizon": options.horizon,
        **({"assume": options.assume} if options.assume else {}),
        **({"rates": read_rates(options.rate)} if options.rate else {}),
        "requirements": {name: str(spec.formula) for name, spec in specs.items()},
    }
    head |= plain(Provenance.of(specs).with_files(files_of(options.specs)))
    if others:
        same = {
            name: {"other": str(_other(name, others).formula), **equivalence_data(requirement)}
            for name, requirement in check.same.items()
        }
        return "equivalence", {**head, "says": check.answer, "results": same}
    results = {
        name: {
            "says": requirement.answer,
            "satisfiable": answer_data(requirement.satisfiable),
            "falsifiable": answer_data(requirement.falsifiable),
            "asked": {text: answer_data(answer) for text, answer in requirement.triggers.items()},
            "idle": [
                {"text": idle.text, "instead": idle.instead, "samples": idle.samples or None}
                for idle in requirement.redundant
            ],
            "unknown": dict(requirement.unknown),
        }
        for name, requirement in check.requirements.items()
    }
    data: dict[str, Any] = {**head, "says": check.answer, "results": results}
    if check.together is not None:
        data |= {
            "together": answer_data(check.together),
            "conflict": [*check.conflict],
            "asked": [
                {"requirement": name, "text": text, **answer_data(answer)}
                for (name, text), answer in check.triggers.items()
            ],
            "implied": {**check.implied},
            "equal": [[*pair] for pair in check.equal],
            "unknown": [[*pair, why] for pair, why in check.unknown.items()],
        }
    return "check", data
