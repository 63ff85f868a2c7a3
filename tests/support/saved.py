"""A round trip: a case of a system is saved, read and run again without a difference."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import rtamt
from rtamt_gym import Runner, Space
from rtamt_gym.inputs.space import SpaceLike
from rtamt_gym.results import SavedCase

__all__ = ["Kind", "check"]


class Kind(NamedTuple):
    """A kind of system: the argument of a runner, and the argument of `SavedCase.of`."""

    system: Any
    requirement: Any
    space: SpaceLike
    options: dict[str, Any] = {}  # noqa: RUF012 - nobody changes it
    names: dict[str, str] = {}  # noqa: RUF012


def check(kind: Kind, coordinates: list[float], seed: int, path: Path) -> None:
    """Save a case of a system, read the file and run it: all results are equal."""
    with Runner(kind.system, kind.requirement, stop="violation", **kind.options) as runner:
        space = Space([*kind.space], duration=6)
        case = space.case(coordinates[: space.dimension])
        seeds = [seed] if runner.takes_seeds else None
        ((_, row),) = runner.run([case], seeds)
        assert not row.error, row.error
        for name, outcome in row.outcomes.items():
            saved = SavedCase.of(runner, name, row, path.parent, **kind.names)
            saved.save(path)
            read = SavedCase.load(path)
            assert read == saved
            assert read.to_json() == saved.to_json() == path.read_text()
            run = read.replay()
            assert run.case == case
            assert run.seed == row.seed
            if row.ended != "violation" or outcome.verdict is rtamt.Verdict.VIOLATED:
                final = run.histories[name].final
                assert math.copysign(1, final) == math.copysign(1, outcome.robustness)
                assert final == outcome.robustness
                assert run.histories[name].verdict is outcome.verdict
                assert read.gives(run)
                assert read.repeats(run)
                assert read.newer() == {}
