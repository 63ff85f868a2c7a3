"""The laws of the ends of a trace, on every machine; `end_laws` as a script runs many cases."""

import pytest
from end_laws import MACHINES, count

pytest.importorskip("rtamt._native", reason="no compiler was at hand")


@pytest.mark.parametrize("name", MACHINES)
def test_each_machine_keeps_the_laws_of_the_ends(name: str) -> None:
    found = count(*MACHINES[name], cases=60)
    assert found.zeros > 0
    assert found.faults[:3] == []
