"""Checks of arguments that map specifications: their factors, and their levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rtamt import InputError
from rtamt_gym.checks.arguments import check_choice, check_known

__all__ = ["check_mapping", "levels_of"]


def check_mapping(name: str, given: object, such: Mapping[str, str]) -> None:
    """Raise InputTypeError if a value is not a mapping; ``such`` is a valid example."""
    if not isinstance(given, Mapping):
        raise InputError(
            f"expected {name}= as a mapping from specifications, got {given!r}; such as "
            f"{name}={_written(such)}"
        )


def levels_of(
    names: Sequence[str], mode: str, ranks: Sequence[str], priorities: Mapping[str, str] | None
) -> tuple[tuple[int, ...], ...]:
    """The places of the specifications of each rank, the first rank first; no level is empty.

    All modes but ``"hierarchical"`` have one level.

    Raises:
        InputError: If priorities and mode do not fit, a priority is not a rank, or the names differ
            from the specifications.
    """
    if mode != "hierarchical":
        if priorities is not None:
            raise InputError(f"priorities= belongs to mode='hierarchical', got mode={mode!r}")
        return (tuple(range(len(names))),)
    such = [*ranks, *[ranks[-1]] * len(names)]
    example = {name: f'"{rank}"' for name, rank in zip(names, such, strict=False)}
    if priorities is None:
        raise InputError(
            "expected priorities= with mode='hierarchical', got None; pass the purpose of every "
            f"specification, such as priorities={_written(example)}"
        )
    check_mapping("priorities", priorities, example)
    check_known("priorities", priorities, names)
    for name in names:
        if name not in priorities:
            raise InputError(
                f'specification {name!r} has no priority; give one: "{name}": "comfort"'
            )
        check_choice(f"priorities[{name!r}]", priorities[name], ranks)
    levels = (
        tuple(i for i, name in enumerate(names) if priorities[name] == rank) for rank in ranks
    )
    return tuple(level for level in levels if level)


def _written(entries: Mapping[str, str]) -> str:
    """A dictionary as one writes it: of names, and of values in the words of Python."""
    return "{" + ", ".join(f'"{name}": {value}' for name, value in entries.items()) + "}"
