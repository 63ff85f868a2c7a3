"""The state and the readings of the episode machine on arrays, and the layout of its state."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

from rtamt.errors import SpecificationError
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import Placement
from rtamt_arrays.functions import Elements
from rtamt_arrays.operations import Tensor

ContinuationName = Literal["now", "lower", "upper"]
CONTINUATIONS: tuple[ContinuationName, ...] = get_args(ContinuationName)


class EpisodeState(NamedTuple):
    """The state of an episode monitor.

    Attributes:
        rows: Settled values of streams and folds of windows, each from the oldest.
        kept: The same for values that depend on unknowns, of shape (rows, corners, entries).
        first: The terms of sample 0 that the value at time 0 needs.
        age: The number of samples of each entry since its reset, up to a maximum.
        nan: Whether an entry has had a nan since its reset.
    """

    rows: Tensor
    kept: Tensor
    first: Tensor
    age: Tensor
    nan: Tensor


class BoundsReading(NamedTuple):
    """The result of an episode monitor: arrays with a value for each batch entry.

    Attributes:
        robustness: The robustness if the episode ended now; nan after a nan.
        lower: The minimum robustness over all continuations and ends; -inf after a nan.
        upper: The maximum robustness over all continuations and ends; inf after a nan.
        verdict: 1 (satisfied), -1 (violated) or 0 (undecided), as in `rtamt.Verdict`.
        nan: Whether a variable or a term has been nan since the reset.
    """

    robustness: Tensor
    lower: Tensor
    upper: Tensor
    verdict: Tensor
    nan: Tensor


class Offsets(NamedTuple):
    """The offsets of a stream from now.

    Attributes:
        late: The number of future samples that a value depends on; older values have settled.
        past: The number of times after now whose values depend on samples.
        back: The oldest offset that is read, as a positive number.
    """

    late: int
    past: int
    back: int


class StreamValues(NamedTuple):
    """The values of a stream that have not settled, in a continuation.

    Attributes:
        values: The values from the first open offset on; None without values.
        last: The offset of the last value.
        tail: The value at all later offsets: a number, or an array if it depends on samples.
    """

    values: Tensor
    last: int
    tail: Tensor | float


class Arrival(NamedTuple):
    """The settled values after a sample has arrived.

    Attributes:
        age: The number of earlier samples of each entry, which is the time of this sample.
        settled: The settled values of streams, from the oldest.
        folds: For windows of streams, the folds from each settled element to the newest one; for
            windows without a start, the fold of all elements.
        initial: The folds of settled elements of windows whose value at time 0 is needed.
        first: The terms of sample 0.
    """

    age: Tensor
    settled: dict[int, Tensor]
    folds: dict[int, Elements]
    initial: dict[int, Elements]
    first: dict[int, Tensor]


class Continuation(NamedTuple):
    """The streams of a continuation.

    Attributes:
        name: "now", "lower" or "upper".
        streams: The values of each stream.
        unknowns: The values of the unknowns.
        opened: For a cut trace, the same continuation of the uncut trace, which has the values of
            unbounded operators with unrecorded windows. None for an uncut trace.
    """

    name: ContinuationName
    streams: dict[int, StreamValues]
    unknowns: list[Tensor]
    opened: Continuation | None = None


_LONGEST = 2**30


class Cells(NamedTuple):
    """Rows ``begin`` to ``end`` of a table of the state.

    Attributes:
        depends: Whether they depend on unknowns, so that they are in ``kept``.
        begin: The first row.
        end: The row after the last row.
        identity: The value after a reset; None if it is never read then.
    """

    depends: bool
    begin: int
    end: int
    identity: float | None


class Layout:
    """The layout of the state of an episode.

    Attributes:
        depends: Whether each stream depends on an unknown.
        shapes: The offsets of each stream.
        sizes: The number of rows with and without unknowns.
        folds: The cells of the folds of each window.
        histories: The cells of the settled values that other streams read.
        initial: The cells of the folds of windows whose value at time 0 is needed.
        firsts: The terms whose value at time 0 is needed.
        windows: The windows among the instructions.
        oldest: The maximum age; all older entries behave the same.
    """

    def __init__(self, placement: Placement) -> None:
        self._placement = placement
        self.program = placement.program
        self.windows = dict(self._windows())
        self.depends = self._dependent()
        self.shapes = self._offsets()
        self.sizes = {False: 0, True: 0}  # by whether rows depend on unknowns
        self.folds: dict[int, list[Cells]] = {}
        self.histories: dict[int, Cells] = {}
        for r in self._placement.streams:
            window = self.program.instructions[r]
            if isinstance(window, Window) and window.hi is not None:
                rows = 1 if window.length is None else window.length - 1
                self.folds[r] = self._fold_cells(window, rows, depends=self.depends[r])
            shape = self.shapes[r]
            if shape.back > shape.late and not self._is_constant(r):
                rows = shape.back - shape.late
                self.histories[r] = self._cells(rows, None, depends=self.depends[r])
        self.initial: dict[int, list[Cells]] = {}
        for r, window in self.windows.items():
            if r in self._placement.initial:
                depends = any(self.depends[a] for a in window.args)
                self.initial[r] = self._fold_cells(window, 1, depends=depends)
        self.firsts = [r for r in self._placement.initial if r < self.program.terms]
        self.oldest = self._last_age()

    def newest(self, register: int, window: Window) -> int:
        """Return the offset of the element that settles into the folds of a stream."""
        late = self.shapes[register].late
        return -late if window.hi is None else window.hi - late

    def _is_constant(self, register: int) -> bool:
        return isinstance(self.program.instructions[register], Const)

    def _windows(self) -> list[tuple[int, Window]]:
        instructions = enumerate(self.program.instructions)
        return [
            (r, instruction) for r, instruction in instructions if isinstance(instruction, Window)
        ]

    def _fold_cells(self, window: Window, rows: int, *, depends: bool) -> list[Cells]:
        return [self._cells(rows, e, depends=depends) for e in FOLDS[window.fold].identity]

    def _cells(self, rows: int, identity: float | None, *, depends: bool) -> Cells:
        begin = self.sizes[depends]
        self.sizes[depends] += rows
        return Cells(depends, begin, begin + rows, identity)

    def _dependent(self) -> dict[int, bool]:
        """Return whether each stream depends on an unknown."""
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
