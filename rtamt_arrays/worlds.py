"""What the episode machine on arrays is made of: its state, its readings, streams in worlds."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

from rtamt_arrays.functions import Elements
from rtamt_arrays.operations import Tensor

__all__ = [
    "WORLDS",
    "Arrival",
    "BoundsReading",
    "EpisodeState",
    "Offsets",
    "StreamValues",
    "WorldName",
    "Worldview",
]

WorldName = Literal["now", "lower", "upper"]
WORLDS: tuple[WorldName, ...] = get_args(WorldName)


class EpisodeState(NamedTuple):
    """What an episode monitor knows of its lanes.

    Attributes:
        rows: Values of streams that have settled, and folds of them, the oldest of each first.
        kept: The same that depend on what is still to come, of shape (numbers, corners, lanes).
        first: The terms of sample 0 that are read there.
        age: Samples of each lane since its reset, up to those that matter.
        nan: Whether a lane has had a nan since its reset.
    """

    rows: Tensor
    kept: Tensor
    first: Tensor
    age: Tensor
    nan: Tensor


class BoundsReading(NamedTuple):
    """What an episode monitor says after a sample, an array with a value for each lane.

    Attributes:
        robustness: The robustness if the episode ended now; nan from a nan on.
        lower: The least robustness over all continuations and ends; -inf from a nan on.
        upper: The greatest robustness over all continuations and ends; inf from a nan on.
        verdict: 1 satisfied, -1 violated, 0 undecided, as `rtamt.Verdict`.
        nan: Whether a variable or a term has been nan since the lane's reset.
    """

    robustness: Tensor
    lower: Tensor
    upper: Tensor
    verdict: Tensor
    nan: Tensor


class Offsets(NamedTuple):
    """The offsets from now at which a stream is found.

    Attributes:
        late: How many samples of the future a value depends on; older values have settled.
        past: For how many times after now a value depends on samples.
        back: The oldest offset that is read, as a positive number.
    """

    late: int
    past: int
    back: int


class StreamValues(NamedTuple):
    """The values of a stream that have not settled, in a world.

    Attributes:
        values: The values from the first such offset on; None if there is none.
        last: The last of these offsets.
        tail: The value at all later ones: a number, or an array if it depends on samples.
    """

    values: Tensor
    last: int
    tail: Tensor | float


class Arrival(NamedTuple):
    """What is known when a sample is there.

    Attributes:
        age: Samples of each lane before this one, so the time of this one.
        settled: The settled values of streams, the oldest first.
        folds: Of windows that streams have: the folds from each settled element of the window on,
            to the newest one; of windows without a begin, the fold of all.
        initial: The folds of settled elements of windows that are read at time 0.
        first: The terms of sample 0.
    """

    age: Tensor
    settled: dict[int, Tensor]
    folds: dict[int, Elements]
    initial: dict[int, Elements]
    first: dict[int, Tensor]


class Worldview(NamedTuple):
    """The streams of a world.

    Attributes:
        world: Which one it is.
        streams: The values of each stream.
        unknowns: The values of the unknowns.
        opened: If the trace was cut, the same world of a trace that goes on: an operator without an
            end of whose window nothing was recorded has its values. None: it was not cut.
    """

    world: WorldName
    streams: dict[int, StreamValues]
    unknowns: list[Tensor]
    opened: Worldview | None = None
