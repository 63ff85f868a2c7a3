"""An array that another thread changes during a read."""

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import pytest

import rtamt
from rtamt import InputError
from rtamt.inputs.samples import SampleReader
from rtamt.machines.backend import BackendName

CHANGED = (
    "a term was not a number at sample 2 and is one now: the array was written to while it was "
    "read; copy it, or write to it after the call"
)


@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize("text", ["sqrt(x) > 0", "always(sqrt(x) > 0)", "once[0:1](sqrt(x) > 0)"])
def test_a_value_that_changes_before_it_is_named_is_refused_all_the_same(
    text: str, backend: BackendName, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = np.array([4.0, 4.0, -1.0, 4.0])
    refuse = SampleReader.refuse

    def late(reader: SampleReader, values: Sequence[float], sample: int) -> NoReturn:
        assert list(values) == [-1.0]
        refuse(reader, [4.0], sample)  # simulates a write of another thread

    monkeypatch.setattr(SampleReader, "refuse", late)
    with pytest.raises(InputError) as caught:
        rtamt.evaluate(text, {"x": x}, backend=backend)
    assert str(caught.value) == CHANGED


def test_what_is_still_no_number_is_named() -> None:
    with pytest.raises(InputError) as caught:
        rtamt.evaluate("sqrt(x) > 0", {"x": [4.0, 4.0, -1.0, 4.0]})
    assert str(caught.value) == "'sqrt(x)' is not a number at sample 2, where x = -1.0"
