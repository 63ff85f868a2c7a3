"""The attributes of `EpisodeMonitor` that its machine writes: right after every call, and safe."""

import copy
import gc
import inspect
import math
import pickle
import weakref
from collections.abc import Callable
from types import MemberDescriptorType
from typing import Any, Literal

import pytest
from bits import identical
from episode_monitors import feed, verdict
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import Trace, formulas, length, traces

from rtamt import EpisodeMonitor, Formula, InputError, Verdict
from rtamt.machines import readout
from rtamt.machines.backend import read_only

Backend = Literal["native", "python"]
SHOWN = ("robustness", "lower", "upper", "verdict")


def agrees_with_its_machine(monitor: EpisodeMonitor) -> None:
    machine = monitor._machine
    found = machine.robustness, machine.lower, machine.upper
    assert identical((monitor.robustness, monitor.lower, monitor.upper), found)
    assert monitor.verdict is verdict(*found[1:])


def refused(monitor: EpisodeMonitor) -> None:
    with pytest.raises(InputError):
        monitor.update(math.nan)


def restored_badly(monitor: EpisodeMonitor) -> None:
    state = monitor._machine.state()
    for damaged in (state[:-1], None):
        with pytest.raises((ValueError, TypeError)):
            monitor._machine.restore(damaged)
        agrees_with_its_machine(monitor)
    monitor._machine.restore(state)


CALLS: dict[str, Callable[[EpisodeMonitor], object]] = {
    "reset": EpisodeMonitor.reset,
    "finish": lambda monitor: monitor.finish() if monitor.samples else None,
    "refused": refused,
    "restored badly": restored_badly,
    "restored": lambda monitor: monitor.__setstate__(monitor.__reduce__()[2]),
}
TWINS: dict[str, Callable[[EpisodeMonitor], EpisodeMonitor]] = {
    "itself": lambda monitor: monitor,
    "copy": copy.copy,
    "pickle": lambda monitor: pickle.loads(pickle.dumps(monitor)),
}


@settings(max_examples=examples(60))
@given(
    formula=formulas(endless=True, depth=2).filter(lambda f: bool(f.variables)),
    trace=traces(),
    data=st.data(),
)
def test_attributes_are_those_of_the_machine_after_every_call(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    agrees_with_its_machine(monitor)
    for i in range(length(trace)):
        if monitor.finished:
            monitor.reset()
        feed(monitor, trace, i)
        agrees_with_its_machine(monitor)
        name = data.draw(st.sampled_from(list(CALLS)))
        if name == "restored badly" and backend == "python":
            continue
        CALLS[name](monitor)
        agrees_with_its_machine(monitor)
        monitor = TWINS[data.draw(st.sampled_from(list(TWINS)))](monitor)
        agrees_with_its_machine(monitor)


@pytest.mark.parametrize("name", SHOWN)
def test_attributes_cannot_be_set_or_deleted(name: str, backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    monitor.update(2.0)
    with pytest.raises(AttributeError):
        setattr(monitor, name, 1.0)
    with pytest.raises(AttributeError):
        delattr(monitor, name)
    agrees_with_its_machine(monitor)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("history", [False, True])
def test_an_update_kept_alone_outlives_its_monitor_which_needs_no_collector(
    backend: Backend, *, history: bool
) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend, history=history)
    update, gone = monitor.update, weakref.ref(monitor)
    gc.collect()
    gc.disable()
    try:
        del monitor
        assert gone() is None
    finally:
        gc.enable()
    others = [EpisodeMonitor("always(x > 0)", backend=backend) for _ in range(9)]
    assert [update(x) for x in (3.0, -1.0, 2.0)] == [3.0, -1.0, -1.0]
    assert all(other.verdict is Verdict.UNDECIDED for other in others)


@pytest.mark.slow(keep=1)
def test_a_monitor_in_a_cycle_is_collected(backend: Backend) -> None:
    class Cyclic(EpisodeMonitor):
        me: object

    monitor = Cyclic("always(x > 0)", backend=backend)
    monitor.me = monitor
    update, gone = monitor.update, weakref.ref(monitor)
    del monitor
    gc.collect()
    assert gone() is None
    assert update(1.0) == 1.0


@pytest.mark.parametrize("slots", [None, ("extra",)])
def test_a_subclass_has_the_same_attributes(slots: tuple[str] | None, backend: Backend) -> None:
    kind: Any = type("Sub", (EpisodeMonitor,), {} if slots is None else {"__slots__": slots})
    monitor = kind("always(x > 0)", backend=backend)
    monitor.extra = "kept"
    monitor.update(-1.0)
    agrees_with_its_machine(monitor)
    assert (monitor.verdict, monitor.extra) == (Verdict.VIOLATED, "kept")


@pytest.mark.parametrize("name", [*SHOWN, "update", "samples"])
def test_a_half_made_monitor_has_no_values(name: str) -> None:
    with pytest.raises(AttributeError):
        getattr(EpisodeMonitor.__new__(EpisodeMonitor), name)


def test_a_monitor_that_is_made_again_shows_its_new_machine(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    monitor.update(-1.0)
    monitor.__init__("always(x > 0)", backend=backend)  # type: ignore[misc] # the attack
    agrees_with_its_machine(monitor)
    monitor.update(5.0)
    agrees_with_its_machine(monitor)


@pytest.mark.parametrize("name", SHOWN)
def test_attributes_are_documented(name: str) -> None:
    assert inspect.getdoc(vars(EpisodeMonitor)[name])


@pytest.mark.parametrize("reader", [read_only, readout.read_only])
def test_a_slot_that_is_read_only_is_read(reader: Callable[[MemberDescriptorType], Any]) -> None:
    class Holder:
        __slots__ = {"value": "What it holds."}
        value: object

    holder, empty = Holder(), Holder()
    holder.value = "held"
    setattr(Holder, "value", reader(vars(Holder)["value"]))  # noqa: B010 - mypy knows no such slot
    assert inspect.getdoc(vars(Holder)["value"]) == "What it holds."
    assert holder.value == "held"
    with pytest.raises(AttributeError):
        holder.value = "other"
    with pytest.raises(AttributeError):
        empty.value  # noqa: B018 - reading it is what is tested
