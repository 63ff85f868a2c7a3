"""Batches of native machines: foreign states, references, the size of an entry."""

from typing import Any, cast

import numpy as np
import pytest

from rtamt import EpisodeMonitor, VectorEpisodeMonitor, VectorMonitor
from rtamt.machines.backend import BACKENDS

native: Any = pytest.importorskip("rtamt._native")

KINDS = (VectorMonitor, VectorEpisodeMonitor)
Vector = VectorMonitor | VectorEpisodeMonitor
TEXT = "always[0:3](x + 2 * y > 1)"


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
    for step in range(2 * k + 500):  # the blocks of a window restart every k / 2 samples
        table = tables[step % len(tables)]
        entries.update(table)
        for entry, monitor in single.items():
            monitor.update(*table[entry])
        if step % 50 == 0 or step % (k // 2) in {0, 1, k // 2 - 1}:
            for name in ("robustness", "lower", "upper"):
                found = getattr(entries, name)[list(single)]
                assert found.tolist() == [getattr(each, name) for each in single.values()]
