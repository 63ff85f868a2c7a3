"""Simulations that failed: how many a command lets pass, and what it says of them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rtamt_gym.commands.exit_codes import Hollow

if TYPE_CHECKING:
    from rtamt_gym.play.record import Record


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
