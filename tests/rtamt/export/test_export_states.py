"""The state of an exported monitor can be kept, written as bytes, and given to another."""

from typing import Any

import pytest
from bits import bits
from exported import Drawn, Unit, exported, texts
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import Trace, length, sample, traces

from rtamt import SpecificationError, parse
from rtamt.export import Fmi

KINDS: dict[str, dict[str, Any]] = {"samples": {"period": 1}, "dense": {"dense": True}}


def continued(unit: Unit, trace: Trace, begin: int, names: tuple[str, ...]) -> list[list[int]]:
    """The outputs of each step from one on, up to the first that is refused."""
    found = []
    for i in range(begin, length(trace)):
        try:
            unit.step(float(i), 1.0, sample(trace, i, names))
        except FMICallException:
            break
        found.append(bits(unit.get(*unit.outputs())))
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fmi", [2, 3])
@settings(max_examples=examples(10))
@given(drawn=texts(dense=True), trace=traces(4), at=st.integers(0, 4))
def test_a_restored_monitor_goes_on_alike(
    fmi: Fmi, kind: str, drawn: Drawn, trace: Trace, at: int
) -> None:
    names = parse(drawn.text).variables
    try:
        with exported(drawn.text, fmi, **KINDS[kind]) as unit:
            unit.begin()
            before = {name: trace[name][:at] for name in trace}
            if len(continued(unit, before, 0, names)) < at:
                return
            outputs = bits(unit.get(*unit.outputs()))
            state = unit.state()
            once = continued(unit, trace, at, names)
            unit.restore(state)
            assert bits(unit.get(*unit.outputs())) == outputs
            assert continued(unit, trace, at, names) == once
            with exported(drawn.text, fmi, **KINDS[kind]) as other:
                other.begin()
                other.restore(state)
                assert bits(other.get(*other.outputs())) == outputs
                assert continued(other, trace, at, names) == once
    except SpecificationError:  # it has no variables, or a term of constants is no number
        return
