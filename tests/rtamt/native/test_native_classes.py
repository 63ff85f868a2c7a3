"""Properties of every machine class of the native module: half-made objects, cycles, snapshots."""

from __future__ import annotations

import gc
import pickle
import weakref
from collections.abc import Callable
from typing import Any

import pytest

from rtamt.language.parser import as_specification
from rtamt.machines.clocks import OperatorClock
from rtamt.program.dense_lowering import NANOSECOND, compile_dense, compile_regions
from rtamt.program.encoding import encoded_regions
from rtamt.program.lowering import compile_program
from rtamt.program.placement import place

module = pytest.importorskip("rtamt._native", reason="no compiler was at hand")
native = pytest.importorskip("rtamt.machines.native", reason="no compiler was at hand")

Maker = Callable[[str, Any], Any]


def program(text: str) -> Any:  # noqa: ANN401 - as the makers take it
    return compile_program(as_specification(text), online=True)


MAKERS: dict[str, Maker] = {
    "DiscreteMachine": lambda text, reader: native.discrete_machine(program(text), reader, ()),
    "EpisodeMachine": lambda text, reader: native.episode_machine(program(text), reader),
    "DenseMachine": lambda text, reader: native.dense_machine(
        compile_dense(as_specification(text), online=True), reader, ()
    ),
    "DenseEpisodeMachine": lambda text, reader: native.dense_episode_machine(
        compile_regions(as_specification(text), NANOSECOND), reader
    ),
    "DenseRegions": lambda text, _: module.DenseRegions(
        *encoded_regions(place(compile_regions(as_specification(text), NANOSECOND).program))
    ),
    "DiscreteBatch": lambda text, reader: native.discrete_batch(program(text), 3, reader),
    "EpisodeBatch": lambda text, reader: native.episode_batch(program(text), 3, reader),
    "ClockBatch": lambda text, _: native.clock_batch(
        [OperatorClock("oldest", "holds", 0, sum(map(ord, text)), 0, ((0, 0),))], 1, 3
    ),
}
CALLS: dict[str, tuple[Any, ...]] = {"DenseRegions": ("advance", [], 0), "ClockBatch": ("feed", [])}
"""The call that takes a sample, if it is not ``update(number)``."""

TEXT = "always[0:3](x > 1)"
OTHERS = ("always[0:3](x > 2)", "always[0:4](x > 1)", "eventually[0:3](x > 1)", "x > 2")
FOREIGN = (
    "^expected a state that a native machine with this program gave; "
    "those of other programs, back-ends or processors do not fit$"
)

machines = pytest.mark.parametrize("name", MAKERS)


class Reader:
    machine: object
    unknown = False


def test_every_machine_class_is_tested_here() -> None:
    classes = {name for name in vars(module) if isinstance(getattr(module, name), type)}
    assert classes == {
        *MAKERS,
        "DenseSigns",
        "EpisodeMonitorSet",
    }  # they have no state that continues


@machines
@pytest.mark.filterwarnings("ignore:nanobind. attempted to access an uninitialized instance")
def test_an_object_that_was_not_made_is_refused(name: str) -> None:
    kind = getattr(module, name)
    unmade = kind.__new__(kind)
    for method in ("state", "reset"):
        with pytest.raises(TypeError):
            getattr(unmade, method)()
    method, *arguments = CALLS.get(name, ("update", 1.0))
    own = "Batch" not in name and name not in CALLS  # an update without nanobind
    message = "^the machine was not made: __init__ was not called$" if own else None
    with pytest.raises(TypeError, match=message):
        getattr(unmade, method)(*arguments)
    gc.collect()  # visits it
    del unmade
    gc.collect()


@pytest.mark.parametrize("name", [*MAKERS, "EpisodeMonitorSet"])
def test_a_cycle_through_an_object_that_was_not_made_is_collected(name: str) -> None:
    kind: Any = type(name, (getattr(module, name),), {})
    unmade = kind.__new__(kind)
    unmade.own = unmade
    gc.collect()
    gone = weakref.ref(unmade)
    del unmade
    gc.collect()
    assert gone() is None


@machines
def test_a_cycle_through_the_reader_is_collected(name: str) -> None:
    reader = Reader()
    reader.machine = MAKERS[name](TEXT, reader)
    gone = weakref.ref(reader)
    del reader
    gc.collect()
    assert gone() is None


@machines
def test_a_state_of_another_program_is_refused_and_that_of_its_own_taken(name: str) -> None:
    machine, like = (MAKERS[name](TEXT, Reader()) for _ in range(2))
    others = [MAKERS[name](text, Reader()).state() for text in OTHERS]
    before = machine.state()
    for state in (*others, b"", b"rtamt", bytes(400), None, "text", [0, [], []]):
        with pytest.raises(ValueError, match=FOREIGN):
            machine.restore(state)
        assert machine.state() == before
    machine.restore(like.state())


@pytest.mark.parametrize("make", [native.discrete_batch, native.episode_batch])
def test_a_state_of_another_number_of_entries_is_refused(make: Callable[..., Any]) -> None:
    two, three = (make(program(TEXT), num, Reader()) for num in (2, 3))
    with pytest.raises(ValueError, match=FOREIGN):
        two.restore(three.state())


@machines
def test_a_damaged_state_is_refused_and_changes_nothing(name: str) -> None:
    machine = MAKERS[name](TEXT, Reader())
    state = machine.state()
    for damaged in (
        *(state[:-8], state[:-1], state[:12], state + bytes(8), state + bytes(1)),
        state[:8] + b"\xff" * (len(state) - 8),
    ):
        with pytest.raises(ValueError, match=r"^expected a whole state, got a damaged one$"):
            machine.restore(damaged)
        assert machine.state() == state
    machine.restore(pickle.loads(pickle.dumps(state)))
    assert machine.state() == state
