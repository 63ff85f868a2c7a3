"""What is said of an episode when it has ended, by the scalar and by the vector wrapper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["outcome", "record"]


def outcome(robustness: float, verdict: str, decided_at: int | None) -> dict[str, Any]:
    """What became of one specification, an entry of ``info["stl_episode"]``.

    Args:
        robustness: Of the whole episode.
        verdict: ``"VIOLATED"``, ``"UNDECIDED"`` or ``"SATISFIED"``.
        decided_at: The sample that decided it; None while it is open.
    """
    said = {"robustness": robustness, "verdict": verdict, "satisfied": verdict == "SATISFIED"}
    return said if decided_at is None else {**said, "decided_at": decided_at}


def record(
    specs: Mapping[str, Mapping[str, Any]],
    violated_by: str | None,
    *,
    samples: int,
    terminated: bool,
    truncated: bool,
) -> dict[str, Any]:
    """The episode as ``stl_episodes`` keeps it.

    Args:
        specs: By name of the specification, what `outcome` gives.
        violated_by: The specification that was violated first.
        samples: How many the episode had.
        terminated: How it ended.
        truncated: Likewise.
    """
    # Copies: a logger that empties the info leaves the record alone.
    kept = {name: dict(said) for name, said in specs.items()}
    made = {"samples": samples, "terminated": terminated, "truncated": truncated, "specs": kept}
    if violated_by is None:
        return made
    return {**made, "violated_by": violated_by, "violated_at": kept[violated_by]["decided_at"]}
