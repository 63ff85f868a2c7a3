"""Simulations that failed: how many a command lets pass, and what it says of them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rtamt_gym.commands.arguments import whole
from rtamt_gym.commands.exit_codes import Hollow

if TYPE_CHECKING:
    from rtamt_gym.play.record import Record

__all__ = ["add_allowed_failures", "hollow_failures"]


def add_allowed_failures(parser: argparse.ArgumentParser, default: int | None) -> None:
    """Adds ``--allow-failures``, which `hollow_failures` reads; a default of None: any number."""
    parser.add_argument(
        "--allow-failures",
        type=whole,
        default=default,
        metavar="N",
        help="how many simulations may fail, of which nothing is known; exit 3 if more do "
        f"(default: {'any number' if default is None else default})",
    )


def hollow_failures(record: Record, options: argparse.Namespace, shown: str) -> list[Hollow]:
    """What is said where simulations failed; it fails if more did than are allowed.

    Args:
        record: The simulations.
        options: The arguments, with ``--allow-failures``.
        shown: What the others show, and how many failed.
    """
    failed, allowed = len(record.failed()), options.allow_failures
    if not failed or allowed is None:
        return []
    switch = f"--allow-failures {max(failed, allowed)}"
    if failed > allowed:
        return [Hollow(f"{shown} ({switch} would let them pass)", fails=True)]
    return [Hollow(f"{shown} ({switch} lets them pass)")]
