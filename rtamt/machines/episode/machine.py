"""The machine of `EpisodeMonitor` in Python: the robustness of an episode, and its bounds.

It computes the value at time 0 in the worlds of `rtamt.machines.protocols.World`: after every
sample as if the episode ended (``NOW``) and as if it went on (``LOWER``, ``UPPER``), and in two
more when a trace was cut. Where the episode goes on, an unseen sample may not exist: a minimum over
the future skips it in ``UPPER``, a maximum in ``LOWER``, except for the sample of the window's own
time, which exists whenever it is read. The condition before a witness of ``until`` exists too if
the witness does (`rtamt.program.instructions.Window`). The program has no negations
(`rtamt.program.placement`), so every register is monotone in the predicates, and ``LOWER`` and
``UPPER`` are the bounds over all continuations and all ends.

Take a register whose value depends on H samples of the future and E samples of the past. After
sample t it has

* settled values up to time t - H, which are the same in all worlds;
* open values of times t - H + 1 to t + E (in ``NOW`` to t), a list for each world;
* a tail: one number for each world, its value at all later times.

A window without an end inside another operator never settles. Its value u at the first open time is
an unknown, and earlier values are lattice polynomials in the unknowns: monotone functions max over
S of min(c_S, u_i for i in S), stored by their values at the corners u in {-inf, +inf}. Folds act
corner by corner. A sample that settles replaces u by op(sample, u); a world replaces u by its
value.

Operators that are read only at time 0 keep one fold each (`InitialFold`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from types import MemberDescriptorType
from typing import Any, NamedTuple, NoReturn, assert_never

from rtamt.errors import StateError
from rtamt.inputs.between import UncertainValue
from rtamt.inputs.samples import SampleReader, SampleValues, ends_of, in_between
from rtamt.machines.episode.streams import (
    Leaf,
    Operands,
    Pointwise,
    RunningFold,
    Sliding,
    Stream,
    UnboundedFuture,
    UnboundedPast,
)
from rtamt.machines.protocols import OPEN_WORLDS, End, World, worlds_of
from rtamt.machines.state import Readout, Retiring, StateFields, moved
from rtamt.machines.terms import PythonSampleMachine, Registers
from rtamt.program.algebra import FOLDS, FUNCTIONS, of_ends
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.placement import neutral_registers, place, variants_of
from rtamt.program.program import Program, ranges_of


class InitialFold(RunningFold):
    """The fold over times lo to hi."""

    def __init__(self, window: Window, streams: Sequence[Stream]) -> None:
        super().__init__(Operands(FOLDS[window.fold], streams))
        self._operands.hold(self._operands.late, 0)
        self._window = window
        self._ends = [world.ends(window) for world in World]
        self._begin = max(0, window.lo or 0)
        self._end = window.hi

    def settle(self, t: int) -> None:
        """Fold in the element that settled with sample t."""
        time = t - self._operands.late
        if self._begin <= time and (self._end is None or time <= self._end):
            self.push(time)

    def value_in(self, world: World, t: int) -> float:
        """Return the fold over settled, open and later values in a world."""
        operands = self._operands
        if world.cut and self._window.endless and self._window.begin > t:
            world = world.opened
        # In a cut trace, a future without an end starts now: `rtamt.program.placement` writes a
        # later begin as a shift.
        recorded = self._ends[world]
        last = max(0, t) if recorded else t + operands.past  # time 0 is there
        begin = max(self._begin, t - operands.late + 1)
        end = last if self._end is None else min(last, self._end)
        elements = operands.seen(world, begin, end) if begin <= end else []
        if not recorded and (self._end is None or self._end > last):
            elements.append(operands.tail(world))
        return functools.reduce(self._combine, elements, self.seen(world))[-1]


def refuse_update() -> NoReturn:
    """Raise the error of an update after `finish`."""
    msg = "the episode is finished; call reset() before the next update"
    raise StateError(msg)


def refuse_finish() -> NoReturn:
    """Raise the error of a finish before any sample."""
    msg = "finish() needs at least one sample, got none since reset"
    raise StateError(msg)


class PythonEpisodeMachine(PythonSampleMachine):
    """Runs a program, future without end included, and bounds its value at time 0."""

    STATE = ("samples", "inputs", "finished", "_first", "robustness", "lower", "upper", "_keepers")
    finished: bool
    _first: Registers

    def __init__(self, program: Program, reader: SampleReader) -> None:
        placement = place(program)
        super().__init__(placement.program, reader)
        self._initial = placement.initial
        # The values of the unknowns in each world.
        self._unknowns = [[0.0 for _ in placement.unknowns] for _ in World]
        self._streams: dict[int, Stream] = {}
        for register in placement.streams:
            self._streams[register] = self._stream(register, placement.unknowns)
        self._predicates = {
            register: stream
            for register, stream in self._streams.items()
            if isinstance(stream, Leaf)
        }
        self._folds: dict[int, InitialFold] = {}
        for register in placement.initial:
            instruction = self.program.instructions[register]
            if isinstance(instruction, Window):
                streams = [self._streams[a] for a in instruction.args]
                self._folds[register] = InitialFold(instruction, streams)
        self._keepers: list[Stream | InitialFold] = [
            *self._streams.values(),
            *self._folds.values(),
        ]
        self.reset()

    def _stream(self, register: int, unknowns: Sequence[int]) -> Stream:
        instruction = self.program.instructions[register]
        if isinstance(instruction, Const):
            return Leaf(self._unknowns, instruction.value)
        if register < self.program.terms:
            return Leaf(self._unknowns)
        formula = self.program.formula(register)
        streams = [self._streams[a] for a in formula.args]
        match formula:
            case Map(function):
                return Pointwise(function, streams)
            case Window(_, _, None):
                return UnboundedFuture(formula, unknowns.index(register), streams)
            case Window(_, None):
                return UnboundedPast(formula, streams)
            case Window():
                return Sliding(formula, streams)
            case _ as never:
                assert_never(never)

    def take(self, terms: Registers, values: list[float]) -> None:
        self.inputs = values
        self.samples += 1
        t = self.samples - 1
        if t == 0:
            self._first = terms
        for register, predicate in self._predicates.items():
            predicate.now = terms[register]
        for stream in self._streams.values():
            time = t - stream.late
            if time >= 0:
                value = stream.settle(time)
                if isinstance(stream, UnboundedFuture):
                    for keeper in self._keepers:
                        keeper.substitute(stream.unknown, value)
                stream.append(value, time)
            stream.look(t)
        for fold in self._folds.values():
            fold.settle(t)
        self._conclude()

    def _conclude(self) -> None:
        self.robustness, self.lower, self.upper = map(self._at_zero, OPEN_WORLDS)

    def _at_zero(self, world: World) -> float:
        """Return the value at time 0 in a world; nan in ``NOW`` before the first sample."""
        program, t = self.program, self.samples - 1
        if t < 0 and world == World.NOW:
            return math.nan
        values: dict[int, float] = {}
        for register in self._initial:
            match program.instructions[register]:
                case Const(value):
                    values[register] = value
                case Window():
                    values[register] = self._folds[register].value_in(world, t)
                case Map(function, args) if register >= program.terms:
                    values[register] = FUNCTIONS[function].apply(*(values[a] for a in args))
                case Load() | Map():
                    values[register] = self._first[register] if t >= 0 else world.unseen
                case _ as never:
                    assert_never(never)
        return values[program.result]

    def finish(self, end: End = "complete") -> float:
        if self.samples == 0:
            refuse_finish()
        if not self.finished:
            low, high = worlds_of(end)
            for stream in self._streams.values():
                stream.look(self.samples - 1, sorted({low.opened, high.opened, low, high}))
            self.lower, self.upper = self._at_zero(low), self._at_zero(high)
            self.robustness = moved(self.robustness, self.lower, self.upper)
            self.finished = True
        return self.robustness

    def reset(self) -> None:
        super().reset()
        self.finished = False
        self._first = []
        for keeper in self._keepers:
            keeper.reset()
        for stream in self._streams.values():
            stream.look(-1)
        self._conclude()


class SampleTerms(NamedTuple):
    """The smallest and largest values of a sample, and of its terms; one list if all are known."""

    lower: list[float]
    upper: list[float]
    least: Registers
    greatest: Registers


class PythonEpisodeVariants(Retiring, StateFields):
    """Up to three variants of one episode: with neutral predicates or uncertain values.

    Programs of episodes are monotone in their predicates, so two extremes enclose every possible
    robustness. Variants that do not differ are one machine: the first two without neutral
    predicates, and the last two until the first uncertain value.

    ================  ===================  =================
    result            neutral predicates   uncertain values
    ================  ===================  =================
    the lower bound   -0.0                 smallest
    the robustness    0.0                  smallest
    the upper bound   0.0                  largest
    ================  ===================  =================
    """

    STATE = ("_known", "_largest", "_moved")
    reader: SampleReader
    _largest: list[PythonEpisodeMachine]
    _moved: float | None

    def __init__(self, program: Program, reader: SampleReader) -> None:
        self.reader = reader
        self._programs = variants_of(program)
        self._neutral = neutral_registers(program)
        self._known = [PythonEpisodeMachine(variant, reader) for variant in self._programs]
        self._result = self._known[-1]
        self._readout: Readout | None = None
        self.reset()

    @property
    def _all(self) -> list[PythonEpisodeMachine]:
        return [*self._known, *self._largest]

    @property
    def samples(self) -> int:
        return self._result.samples

    @property
    def inputs(self) -> SampleValues:
        pairs = zip(self._result.inputs, self._all[-1].inputs, strict=True)
        return [in_between(*ends) for ends in pairs] if self._largest else [*self._result.inputs]

    @property
    def finished(self) -> bool:
        return self._result.finished

    @property
    def robustness(self) -> float:
        """The smallest robustness if the episode ended now."""
        return self._result.robustness if self._moved is None else self._moved

    @property
    def result(self) -> float:
        return self.robustness

    @property
    def lower(self) -> float:
        return self._known[0].lower

    @property
    def upper(self) -> float:
        return self._all[-1].upper

    def update(self, *args: object, **named: object) -> float:
        if self.finished:
            refuse_update()
        values = self.reader.read_sample(args, named, self.samples, self.inputs)
        self.require_current()
        if self.finished:  # reading a value may run code of the caller
            refuse_update()
        self.take(self.terms(values))
        return self.robustness

    def terms(self, values: SampleValues) -> SampleTerms:
        """Return the next sample and its terms; refuse a term without a value."""
        ends = [ends_of(value) for value in values]
        lower = [low for low, _ in ends]
        if not any(isinstance(value, UncertainValue) for value in values):
            known = self._result.terms(lower)
            return SampleTerms(lower, lower, known, known)
        ranges = ranges_of(self._result.program, [of_ends(*pair) for pair in ends])
        if len(ranges) < self._result.program.terms:
            self.reader.refuse(values, self.samples)
        upper = [high for _, high in ends]
        return SampleTerms(lower, upper, [x.lower for x in ranges], [x.upper for x in ranges])

    def take(self, sample: SampleTerms) -> None:
        """Take a sample whose terms are known."""
        if sample.least is not sample.greatest and not self._largest:
            self._largest = [self._twin()]
            self._largest[0].restore(self._result.state())
        if self._neutral:
            worst = sample.least.copy()
            for register in self._neutral:
                worst[register] = -0.0
            self._known[0].take(worst, sample.lower)
        self._result.take(sample.least, sample.lower)
        for machine in self._largest:
            machine.take(sample.greatest, sample.upper)
        self._show()

    def _twin(self) -> PythonEpisodeMachine:
        return PythonEpisodeMachine(self._programs[-1], self.reader)

    def finish(self, end: End = "complete") -> float:
        machines, robustness = self._all, self.robustness
        ends = not self.finished
        for machine in machines:
            machine.finish(end)
        if ends and len(machines) > 1:
            self._moved = moved(robustness, self.lower, self.upper)
        self._show()
        return self.robustness

    def reset(self) -> None:
        self._largest, self._moved = [], None
        for machine in self._known:
            machine.reset()
        self._show()

    def restore(self, state: list[Any]) -> None:
        before = self.state()
        try:
            self._restore(state)
        except Exception:
            self._restore(before)
            raise
        self._show()

    def _restore(self, state: list[Any]) -> None:
        self._largest = [self._twin() for _ in state[self.STATE.index("_largest")]]
        super().restore(state)

    def show_in(
        self, monitor: object, slots: Sequence[MemberDescriptorType], verdicts: Sequence[object]
    ) -> None:
        self._readout = Readout(monitor, slots, verdicts)
        self._show()

    def _show(self) -> None:
        if self._readout is not None:
            self._readout.show(self.robustness, self.lower, self.upper)
