"""Batches of native machines: states that are not their own, references, the size of an entry."""

import gc
import pickle
import weakref
from typing import Any, cast

import numpy as np
import pytest

from rtamt import EpisodeMonitor, VectorEpisodeMonitor, VectorMonitor
from rtamt.machines.backend import BACKENDS

native: Any = pytest.importorskip("rtamt._native")

KINDS = (VectorMonitor, VectorEpisodeMonitor)
Vector = VectorMonitor | VectorEpisodeMonitor
TEXT = "always[0:3](x + 2 * y > 1)"
FOREIGN = (
    "^expected a state that a native machine with this program gave; "
    "those of other programs, back-ends or processors do not fit$"
)


def batch(kind: type[Vector], text: str = TEXT, num: int = 2) -> Any:  # noqa: ANN401 - of either kind
    """A native batch that has taken a sample."""
    vector = kind(text, num, backend="native")
    vector.update(np.ones((num, 2)))
    return vector._machine


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "state",
    [
        lambda _: b"",
        lambda _: None,
        lambda _: bytes(400),
        lambda kind: batch(kind, num=3).state(),
        lambda kind: batch(kind, TEXT.replace("1)", "2)")).state(),
        lambda kind: batch(kind, TEXT.replace("3]", "4]")).state(),
        lambda kind: batch(kind, TEXT.replace("always", "eventually")).state(),
        lambda kind: batch(VectorMonitor if kind is VectorEpisodeMonitor else KINDS[1]).state(),
        lambda kind: kind(TEXT, 2, backend="python")._machine.state(),
    ],
)
def test_a_foreign_state_is_refused_and_changes_nothing(kind: type[Vector], state: Any) -> None:  # noqa: ANN401
    made = batch(kind)
    before = made.state()
    with pytest.raises(ValueError, match=FOREIGN):
        made.restore(state(kind))
    assert made.state() == before


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_state_is_refused_and_changes_nothing(kind: type[Vector]) -> None:
    made = batch(kind)
    state = made.state()
    for damaged in (state[:-8], state[:24], state + bytes(8)):
        with pytest.raises(ValueError, match=r"^expected a whole state, got a damaged one$"):
            made.restore(damaged)
        assert made.state() == state
    made.restore(pickle.loads(pickle.dumps(state)))
    assert made.state() == state


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_and_its_reader_are_collected_in_a_circle(kind: type[Vector]) -> None:
    class Reader:
        batch: object

    reader = Reader()
    program = kind(TEXT, 2).program
    if kind is VectorMonitor:
        reader.batch = BACKENDS["native"].discrete_batch(program, 2, cast("Any", reader))
    else:
        reader.batch = BACKENDS["native"].episode_batch(program, 2, cast("Any", reader))
    gone = weakref.ref(reader)
    del reader
    gc.collect()
    assert gone() is None


def test_a_reader_that_refuses_nothing_is_noticed() -> None:
    class Reader:
        def without_nan(self, table: object, *_: object) -> object:
            return table

        def refuse(self, *_: object) -> None: ...
        def refuse_finish(self, _: int) -> None: ...

    program = VectorMonitor("sqrt(x) > 0", 1).program
    made = BACKENDS["native"].discrete_batch(program, 1, cast("Any", Reader()))
    with pytest.raises(RuntimeError, match=r"^Python did not refuse the call$"):
        made.update(np.array([[-1.0]]))
    episodes = BACKENDS["native"].episode_batch(program, 1, cast("Any", Reader()))
    with pytest.raises(RuntimeError, match=r"^Python did not refuse the call$"):
        episodes.finish()


@pytest.mark.parametrize(
    "text",
    ["eventually(always[0:{k}](x > 0))", "always((y > 1) implies eventually[0:{k}](x > 0))"],
)
def test_long_windows_of_many_entries_are_those_of_one(text: str) -> None:
    num, k = 3_000, 2_000
    text = text.format(k=k)
    entries = VectorEpisodeMonitor(text, num, backend="native")
    single = {entry: EpisodeMonitor(text, backend="native") for entry in (0, 1_234, num - 1)}
    random = np.random.default_rng(4)
    width = len(entries.variables)
    tables = [np.asfortranarray(random.normal(2.8, 1.0, (num, width))) for _ in range(97)]
    for step in range(2 * k + 500):  # the blocks of a window begin anew every k / 2 samples
        table = tables[step % len(tables)]
        entries.update(table)
        for entry, monitor in single.items():
            monitor.update(*table[entry])
        if step % 50 == 0 or step % (k // 2) in {0, 1, k // 2 - 1}:
            for name in ("robustness", "lower", "upper"):
                found = getattr(entries, name)[list(single)]
                assert found.tolist() == [getattr(each, name) for each in single.values()]
