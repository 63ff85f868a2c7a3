"""Judgements of many groups of a Parquet file, and a grouped minimum of the same file."""

from __future__ import annotations

import io
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import worker

import rtamt
from rtamt_gym.__main__ import main

LOW = "always(x < 3)"
SPECS = {
    "two": (LOW, "always(a > 2 implies eventually[0:10](b > 1))"),
    "until": (LOW, "always(a > 2 implies (b > -1 until[0:10] b > 1))"),
    "past": (LOW, "always(a > 2 implies once[0:10](b > 1))"),
}


def measure(case: worker.Case) -> worker.Measure:
    """Return seconds of pyarrow's minimum, of judgements from file and memory, and of a command."""
    specs, traces = SPECS[case["kind"]], case["traces"]
    rng = np.random.default_rng(0)
    lengths = rng.integers(1, 400, size=traces)
    lengths[::50] = 1
    columns = {name: rng.normal(size=int(lengths.sum())) for name in "xab"}
    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name) / "groups.parquet"
    ids = np.repeat(np.arange(traces), lengths)
    pq.write_table(pa.table({"id": ids, **columns}), path)

    def grouped() -> None:
        pq.read_table(path).group_by("id").aggregate([("x", "min")])

    def file() -> None:
        table = pq.read_table(path)
        for spec in specs:
            rtamt.judge_many(spec, table, by="id")

    def memory() -> None:
        for spec in specs:
            rtamt.judge_many(spec, columns, lengths=lengths)

    def command() -> None:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            main(["monitor", *specs, "--by", "id", "--", str(path)])

    def run() -> list[float]:
        assert folder.name  # keeps the folder as long as the measure
        return [seconds(grouped), seconds(file), seconds(memory), seconds(command)]

    return run


def seconds(function: Callable[[], None]) -> float:
    """Return the duration of a call."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


if __name__ == "__main__":
    worker.serve({"many": measure})
