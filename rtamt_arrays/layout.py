"""What the episode machine on arrays is made of: its state, its readings, streams in worlds.

What an episode machine on arrays keeps of a program, and at which offsets it finds streams.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

from rtamt.errors import SpecificationError
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import Placement
from rtamt_arrays.functions import Elements
from rtamt_arrays.operations import Tensor

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


_LONGEST = 2**30


class Cells(NamedTuple):
    """Rows of a table of the state.

    Attributes:
        depends: Whether they depend on unknowns, and so lie in ``kept``.
        begin: The first row.
        end: The row behind the last one.
        identity: What they are where a lane begins; None if they are not read there.
    """

    depends: bool
    begin: int
    end: int
    identity: float | None


class Layout:
    """Where the state of an episode has what.

    Attributes:
        depends: Whether each stream depends on an unknown.
        shapes: The offsets of each stream.
        sizes: The rows that depend on no unknown, and those that do.
        folds: Of each window of a stream, the folds of its settled elements, for each number.
        histories: The settled values of streams that others read.
        initial: The folds of windows that are read at time 0.
        firsts: The terms that are read at time 0.
        windows: The windows among the instructions.
        oldest: The age from which on a lane's age no longer matters.
    """

    def __init__(self, placement: Placement) -> None:
        self._placement = placement
        self.program = placement.program
        self.windows = dict(self._windows())
        self.depends = self._dependent()
        self.shapes = self._offsets()
        self.sizes = {False: 0, True: 0}  # rows that depend on no unknown, and others
        self.folds: dict[int, list[Cells]] = {}
        self.histories: dict[int, Cells] = {}
        for r in self._placement.streams:
            window = self.program.instructions[r]
            if isinstance(window, Window) and window.hi is not None:
                rows = 1 if window.length is None else window.length - 1
                self.folds[r] = self._placed(window, rows, depends=self.depends[r])
            shape = self.shapes[r]
            if shape.back > shape.late and not self._is_constant(r):
                rows = shape.back - shape.late
                self.histories[r] = self._cells(rows, None, depends=self.depends[r])
        self.initial: dict[int, list[Cells]] = {}
        for r, window in self.windows.items():
            if r in self._placement.initial:
                depends = any(self.depends[a] for a in window.args)
                self.initial[r] = self._placed(window, 1, depends=depends)
        self.firsts = [r for r in self._placement.initial if r < self.program.terms]
        self.oldest = self._last_age()

    def newest(self, register: int, window: Window) -> int:
        """The offset of the element that settles into the folds of a stream."""
        late = self.shapes[register].late
        return -late if window.hi is None else window.hi - late

    def _is_constant(self, register: int) -> bool:
        return isinstance(self.program.instructions[register], Const)

    def _windows(self) -> list[tuple[int, Window]]:
        instructions = enumerate(self.program.instructions)
        return [(r, each) for r, each in instructions if isinstance(each, Window)]

    def _placed(self, window: Window, rows: int, *, depends: bool) -> list[Cells]:
        return [self._cells(rows, e, depends=depends) for e in FOLDS[window.fold].identity]

    def _cells(self, rows: int, identity: float | None, *, depends: bool) -> Cells:
        begin = self.sizes[depends]
        self.sizes[depends] += rows
        return Cells(depends, begin, begin + rows, identity)

    def _dependent(self) -> dict[int, bool]:
        """Whether each stream depends on an unknown."""
        depends: dict[int, bool] = {}
        for r in self._placement.streams:
            args = self.program.formula(r).args if r >= self.program.terms else ()
            depends[r] = r in self._placement.unknowns or any(depends[a] for a in args)
        return depends

    def _offsets(self) -> dict[int, Offsets]:
        late, past, back = dict[int, int](), dict[int, int](), dict[int, int]()
        for r in self._placement.streams:
            late[r] = past[r] = back[r] = 0
            if r < self.program.terms:
                continue
            instruction = self.program.formula(r)
            late[r] = max(late[a] for a in instruction.args)
            past[r] = max(past[a] for a in instruction.args)
            if isinstance(instruction, Window) and instruction.hi is not None:
                late[r] = max(0, late[r] + instruction.hi)
                lo = instruction.hi if instruction.lo is None else instruction.lo
                past[r] = max(0, past[r] - lo)
        for r in range(self.program.terms, len(self.program.instructions)):
            instruction = self.program.formula(r)
            if isinstance(instruction, Map) and r not in late:
                continue
            oldest = max(late[a] for a in instruction.args)
            if r in late and isinstance(instruction, Window) and instruction.hi is not None:
                oldest = late[r] - instruction.hi
            elif r in late:
                oldest = late[r]
            for a in instruction.args:
                back[a] = max(back[a], late[a], oldest)
        return {r: Offsets(late[r], past[r], max(late[r], back[r])) for r in late}

    def _last_age(self) -> int:
        bounds = [b for w in self.windows.values() for b in (w.lo, w.hi) if b is not None]
        reach = max((sum(shape) for shape in self.shapes.values()), default=0)
        last = 2 + reach + max(map(abs, bounds), default=0)
        if last > _LONGEST:
            formula = self.program.specification.formula
            raise SpecificationError(
                f"{formula} reaches over {last} samples; arrays count up to {_LONGEST}"
            )
        return last
