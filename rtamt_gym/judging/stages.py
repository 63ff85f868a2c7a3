"""The stages of requirements: those that ``stages=`` names, else those of their shape."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import rtamt
from rtamt import Formula, InputError, RtamtError
from rtamt.errors import Argument
from rtamt.patterns import in_order, named_stages, prefixes, stages
from rtamt_gym.checks.arguments import check_known
from rtamt_gym.checks.names import listing
from rtamt_gym.options.evaluation import Reading

__all__ = ["Stages", "are_instant", "stages_of"]


@dataclass(frozen=True, slots=True)
class Stages:
    """The stages of a requirement.

    Attributes:
        conditions: The stages, in order.
        deciders: The formulas whose satisfaction decides them, from the first on; the requirement
            itself decides a last one that has none. Empty if what decides a stage is the first
            sample at which it holds, from the one on that decided the stage before it.
    """

    conditions: tuple[Formula, ...]
    deciders: tuple[Formula, ...] = ()


def stages_of(specs: Mapping[str, rtamt.Specification], reading: Reading) -> dict[str, Stages]:
    """The stages of each requirement that has some, by its name.

    Args:
        specs: The requirements by name.
        reading: How samples are judged, with the stages that are named.

    Raises:
        InputError: If stages are named of no requirement, or with ``view="step"``.
        SpecificationError: As `rtamt.patterns.named_stages` does.
    """
    named = _named(specs, reading)
    if reading.view == "step":  # a verdict is about every instant there, and has no stages
        return {}
    found = {}
    for name, spec in specs.items():
        if name in named:
            conditions = _read(name, spec, named[name])
            found[name] = Stages(conditions, () if are_instant(conditions) else _chains(conditions))
        elif conditions := stages(spec):
            # Without times of its own it is the same as its stages named.
            plain = are_instant(conditions) and spec.formula is in_order(*conditions)
            found[name] = Stages(conditions, () if plain else prefixes(spec)[:-1])
    return found


def are_instant(conditions: Iterable[Formula]) -> bool:
    """Whether the samples before and after one do not matter to formulas."""
    nodes = (node for each in conditions for node in each.nodes())
    return not any(node.op is not None and (node.op.timed or node.op.sampled) for node in nodes)


def _chains(conditions: Sequence[Formula]) -> tuple[Formula, ...]:
    """The first stage, the first two in order, and so on."""
    longer = (in_order(*conditions[:count]) for count in range(2, len(conditions) + 1))
    return conditions[0].eventually(), *longer


def _named(
    specs: Mapping[str, rtamt.Specification], reading: Reading
) -> Mapping[str, tuple[str, ...]]:
    """The texts of the stages that are named, by requirement."""
    given = cast("tuple[str, ...] | dict[str, tuple[str, ...]] | None", reading.stages)
    if given is None:
        return {}
    if reading.view == "step":
        raise InputError(
            Argument("stages"),
            " are of an episode, and ",
            Argument("view", "step"),
            " judges every instant by itself; leave one of them out",
        )
    if isinstance(given, Mapping):
        check_known("stages", given, specs)
        return given
    if len(specs) > 1:
        raise InputError(
            Argument("stages"),
            ": expected a requirement's name for the stages, for there are several, "
            f"{listing(specs)}; write {{{next(iter(specs))!r}: [...]}}",
        )
    return dict.fromkeys(specs, given)


def _read(name: str, spec: rtamt.Specification, texts: Sequence[str]) -> tuple[Formula, ...]:
    try:
        return named_stages(spec, texts)
    except RtamtError as error:
        error.add_note(f"in the stages of {name!r}")
        raise
