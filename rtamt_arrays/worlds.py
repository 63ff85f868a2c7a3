"""What the episode machine on arrays is made of: its state, its readings, streams in worlds."""

from __future__ import annotations

from typing import Literal, NamedTuple

from rtamt_arrays.operations import Operations, Tensor

__all__ = [
    "Arrival",
    "BoundsReading",
    "EpisodeState",
    "Offsets",
    "StreamValues",
    "WorldName",
    "Worldview",
]

WorldName = Literal["now", "lower", "upper", "settled"]


class EpisodeState(NamedTuple):
    """What an episode monitor knows of its lanes.

    Attributes:
        history: Samples of the terms that streams read, the oldest of each term first.
        kept: Folds over all times so far, of shape (numbers, corners, lanes).
        first: The terms of sample 0 that are read there.
        age: Samples of each lane since its reset, up to those that matter.
        nan: Whether a lane has had a nan since its reset.
    """

    history: Tensor
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
        late: How many samples of the future a value depends on.
        past: For how many times after now a value depends on samples.
        back: The oldest offset, as a positive number; the value there has settled.
    """

    late: int
    past: int
    back: int


class StreamValues(NamedTuple):
    """The values of a register in a world, from ``-back`` on, and that of all later times."""

    values: Tensor
    back: int
    tail: Tensor

    def read(self, o: Operations, begin: int, end: int) -> Tensor:
        """The values at offsets begin to end."""
        count = self.values.shape[0]
        first, last = begin + self.back, end + self.back + 1
        beyond = last - max(first, count)
        if beyond <= 0:
            return self.values[first:last]
        later = o.broadcast(self.tail, (beyond, *self.values.shape[1:]))
        return later if first >= count else o.concatenate([self.values[first:], later])


class Arrival(NamedTuple):
    """What is known when a sample is there: terms, histories with it, and what is kept.

    Attributes:
        age: Samples of each lane before this one, so the time of this one.
        terms: The terms of the sample.
        histories: The last values of terms that streams read, with this one.
        kept: The folds over all times so far, of shape (corners, lanes); they are replaced.
        first: The terms of sample 0.
    """

    age: Tensor
    terms: list[Tensor]
    histories: dict[int, Tensor]
    kept: list[Tensor]
    first: dict[int, Tensor]


class Worldview(NamedTuple):
    """The streams of a world, and its values of the unknowns."""

    world: WorldName
    settles: bool
    streams: dict[int, StreamValues]
    unknowns: list[Tensor]
