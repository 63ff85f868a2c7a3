"""Measure `rtamt watch`: rows per second, lines per second, and the time from a row to its line.

Three variables and one requirement, compared in one run with orjson alone on the same lines.
Throughput uses processor time, because other programs share the machine; latency uses the clock. A
figure is the best of its repeats. Nothing is asserted.

Run: python tests/bench/streams.py
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

import rtamt
from rtamt_gym.commands.collection import few_collections
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.watch import StreamWatch, WatchOptions

SPEC = "always(speed < 100 and gap > -1 implies eventually[0:2](x > -5))"
BLOCK = 1 << 16


def texts(rows: int) -> tuple[bytes, bytes]:
    """Return the same rows as CSV and as NDJSON."""
    values = np.random.default_rng(1).random((rows, 3)).tolist()
    csv, json = ["time,speed,gap,x"], []
    for i, (speed, gap, x) in enumerate(values):
        csv.append(f"{i / 100:.2f},{speed:.6f},{gap:.6f},{x:.6f}")
        json.append(f'{{"time":{i / 100:.2f},"speed":{speed:.6f},"gap":{gap:.6f},"x":{x:.6f}}}')
    return "\n".join(csv).encode(), "\n".join(json).encode()


def watched(text: bytes, *, every: bool = False, dense: bool = False) -> None:
    """Judge a stream, and discard its output."""

    def emit(line: Line) -> None:
        line.to_json()

    options = WatchOptions(
        {"r": rtamt.parse(SPEC)}, EvaluationOptions(dense=dense), Columns(), every=every
    )
    with few_collections():
        watch = StreamWatch(options, "stream", emit)
        for begin in range(0, len(text), BLOCK):
            watch.add(text[begin : begin + BLOCK])
        watch.end_of_input()
        watch.finish(early=False)


def rate(rows: int, repeats: int, job: Callable[[], object]) -> float:
    """Return rows per second of processor time, in the best repeat."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.process_time()
        job()
        best = min(best, time.process_time() - begin)
    return rows / best


def latencies(seconds: float) -> list[float]:
    """Return milliseconds from a row to its line, at 1,000 rows per second."""
    command = [sys.executable, "-m", "rtamt_gym", "watch", SPEC, "--every"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        count, sent, got = int(1000 * seconds), [], []

        def listen() -> None:
            for _ in range(count):
                process.stdout.readline()
                got.append(time.perf_counter())

        listener = threading.Thread(target=listen)
        process.stdin.write(b"time,speed,gap,x\n-0.001,1,1,1\n0,1,1,1\n")
        process.stdin.flush()
        process.stdout.readline()  # wait for the start
        process.stdout.readline()
        listener.start()
        begin = time.perf_counter()
        for i in range(1, count + 1):
            while time.perf_counter() < begin + i / 1000:
                time.sleep(1e-4)
            sent.append(time.perf_counter())
            process.stdin.write(f"{i / 1000:.3f},1,1,1\n".encode())
            process.stdin.flush()
        listener.join()
        process.stdin.close()
    return [1000 * (after - before) for before, after in zip(sent, got, strict=True)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=200_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=5.0, help="how long latency is measured")
    options = parser.parse_args()
    rows, repeats = options.rows, options.repeats
    csv, json = texts(rows)
    print(f"CSV                  {rate(rows, repeats, lambda: watched(csv)):12,.0f} rows/s")
    ndjson = rate(rows, repeats, lambda: watched(json))
    print(f"NDJSON               {ndjson:12,.0f} rows/s")
    try:
        import orjson
    except ModuleNotFoundError:
        print("orjson is not installed; the json of Python was measured")
    else:

        def alone() -> None:
            for line in json.split(b"\n"):
                orjson.loads(line)

        parsed = rate(rows, repeats, alone)
        print(f"orjson alone         {parsed:12,.0f} rows/s, ratio {ndjson / parsed:.2f}")
    every = rate(
        rows // 4, repeats, lambda: watched(csv[: csv.index(b"\n", len(csv) // 4)], every=True)
    )
    print(f"--every              {every:12,.0f} lines/s")
    dense = rate(
        rows // 8, repeats, lambda: watched(csv[: csv.index(b"\n", len(csv) // 8)], dense=True)
    )
    print(f"--dense              {dense:12,.0f} rows/s")
    delays = np.array(latencies(options.seconds))
    half, most = np.quantile(delays, [0.5, 0.99])
    print(f"latency at 1,000/s   {half:.2f} ms in the median, {most:.2f} ms for 99 of 100")


if __name__ == "__main__":
    main()
