"""`rtamt check`: whether requirements say what was meant."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import rtamt
from rtamt import Answer, Check, CheckedRequirement, Specification
from rtamt_gym.commands.example_traces import (
    add_search,
    answer_data,
    code_of,
    drawn,
    equivalence_data,
    read_period,
    write,
)
from rtamt_gym.commands.specs import files_of, read_constants, read_requirements

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Checks requirements without a simulation: whether each can be satisfied, violated and "
        "asked, whether each of its parts decides something, and whether they agree. Every yes "
        "comes with a trace that the monitors have judged, every no says how far it reaches."
    )
    parser.epilog = "example: rtamt check requirements.stl --period 100ms --assume 'always(v >= 0)'"
    add_search(parser)
    parser.add_argument(
        "--same-as",
        action="append",
        default=[],
        metavar="OTHER",
        help="say only whether the same traces satisfy this formula or .stl file; of several "
        "requirements, those of the same names; may be repeated",
    )


def run(options: argparse.Namespace) -> int:
    """Prints what there is to say of each requirement, and of all; 1 if something is wrong."""
    specs = read_requirements(options.specs, read_constants(options.constant))
    others = read_requirements(options.same_as)
    period = read_period(options, specs, others)
    found = rtamt.check(
        specs,
        period,
        end=options.end,
        assume=options.assume,
        same_as=others or None,
        horizon=options.horizon,
        timeout=options.timeout,
    )
    if options.save is not None:
        named = (("-".join(filter(None, [n, what])), trace) for n, what, trace in found.traces())
        write(named, options.save)
    if options.json:
        print(json.dumps(_data(found, specs, others), indent=2))
    elif others:
        print(*_compared(found, specs, others), sep="\n")
    else:
        print(*_lines(found, specs, _files(options.specs)), sep="\n")
    return code_of([found.says])


def _files(arguments: Sequence[str]) -> dict[str, str]:
    """The files among the arguments, by their text."""
    paths = [Path(path) for path in files_of(arguments) if path.endswith(".stl")]
    return {path.read_text(encoding="utf-8-sig"): f"{path}:" for path in paths if path.is_file()}


def _compared(
    found: Check, specs: Mapping[str, Specification], others: Mapping[str, Specification]
) -> Iterator[str]:
    """What there is to say of requirements and their namesakes."""
    for name, same in found.same.items():
        yield f"{_titled(name, specs[name])}:"
        for side, spec in (("one", specs[name]), ("other", _other(name, others))):
            yield from _row(side, str(spec.formula))
        yield from _row("same", str(same))
        yield ""
    yield from _traces(found)
    yield {
        "yes": "they are the same",
        "no": "they differ: see above",
        "unknown": "no difference was found, but not all is known: see above",
    }[found.says]


def _other(name: str, others: Mapping[str, Specification]) -> Specification:
    return others[name] if name in others else next(iter(others.values()))


def _titled(name: str, spec: Specification) -> str:
    return name if spec.id is None else f"{name} ({spec.id})"


def _lines(
    found: Check, specs: Mapping[str, Specification], files: Mapping[str, str]
) -> Iterator[str]:
    for name, each in found.requirements.items():
        title = _titled(name, specs[name])
        yield from wrap(f"{title}: {each.text}", 80, subsequent_indent="    ")
        yield from _of_one(each, files.get(specs[name].text, ""))
        yield ""
    if found.together is not None:
        yield from _of_all(found, found.together)
        yield ""
    yield from _traces(found)
    yield {
        "yes": "nothing wrong was found",
        "no": "something is wrong: see above",
        "unknown": "nothing wrong was found, but not all is known: see above",
    }[found.says]


def _traces(found: Check) -> Iterator[str]:
    for name, what, trace in found.traces():
        if what != "satisfied":
            yield " ".join(filter(None, [name, f"{what}:"]))
            yield from drawn(trace)
            yield ""


def _of_one(found: CheckedRequirement, file: str) -> Iterator[str]:
    yield from _said("satisfied", found.satisfiable)
    yield from _clashes(found.satisfiable, "clashes", file)
    yield from _said("violated", found.falsifiable)
    yield from _clashes(found.falsifiable, "as", file)
    for text, answer in found.asked.items():
        yield from _said("asked", answer, f": {text}")
    for idle in found.idle:
        yield from _row("idle", str(idle))
    for text, why in found.unknown.items():
        yield from _row("parts", f"unknown whether {text} decides something: {why}")


def _clashes(answer: Answer, word: str, file: str) -> Iterator[str]:
    for part, place in zip(answer.clash, answer.places, strict=True):
        where = f" at {file}{place[0]}:{place[1]}" if place else ""
        yield from _row("", f"{word}: {part}{where}")


def _of_all(found: Check, together: Answer) -> Iterator[str]:
    yield from _said("together", together)
    if found.conflict:
        yield from _row("conflict", ", ".join(found.conflict))
    for (name, text), answer in found.asked.items():
        if answer.says != "yes":
            yield from _row("asked", f"{name}, where all are satisfied: {answer}: {text}")
    for one, other in found.implied.items():
        yield from _row("implied", f"{one} by {other}")
    for one, other in found.equal:
        yield from _row("equal", f"{one} and {other}")
    for (one, other), why in found.unknown.items():
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
    found: Check, specs: Mapping[str, Specification], others: Mapping[str, Specification]
) -> dict[str, Any]:
    if others:
        return {
            "says": found.says,
            "same": {
                name: {
                    "one": str(specs[name].formula),
                    "other": str(_other(name, others).formula),
                    **equivalence_data(same),
                }
                for name, same in found.same.items()
            },
        }
    requirements = {
        name: {
            "formula": each.text,
            **({} if (identity := specs[name].id) is None else {"id": identity.id}),
            "says": each.says,
            "satisfiable": answer_data(each.satisfiable),
            "falsifiable": answer_data(each.falsifiable),
            "asked": {text: answer_data(answer) for text, answer in each.asked.items()},
            "idle": [
                {"text": idle.text, "instead": idle.instead, "samples": idle.samples}
                for idle in each.idle
            ],
            "unknown": dict(each.unknown),
        }
        for name, each in found.requirements.items()
    }
    data: dict[str, Any] = {"says": found.says, "requirements": requirements}
    if found.together is not None:
        data |= {
            "together": answer_data(found.together),
            "conflict": [*found.conflict],
            "asked": [
                {"requirement": name, "text": text, **answer_data(answer)}
                for (name, text), answer in found.asked.items()
            ],
            "implied": {**found.implied},
            "equal": [[*pair] for pair in found.equal],
            "unknown": [[*pair, why] for pair, why in found.unknown.items()],
        }
    return data
