"""The cost of many recordings, and a check of the scaling model of docs/recordings.md.

    python tests/bench/recordings.py [--backend dask]

It prints the processor time of the parts of one file, and, for two numbers of files, the time that
the model predicts and the time of `rtamt monitor --results`, summed over all processes.
"""

from __future__ import annotations

import argparse
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.csv

import rtamt
from rtamt_gym.commands.fleet import identity_of
from rtamt_gym.commands.fleet_folder import FleetFolder
from rtamt_gym.commands.fleet_worker import FleetJob, judge_batch, pickled, version
from rtamt_gym.commands.judging import judge_files
from rtamt_gym.commands.traces import TracesAsked
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.play.workers import end_processes
from rtamt_gym.recorded.columns import Columns

LIMIT = "limit = always(x < 10)"
RESPONSE = "answered = always(a > 0.5 implies eventually[0:3](b > 0.5))"
SIZES = (1000, 4000)
LONG = 60_000
"""The number of samples of ten minutes at 100 Hz."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--backend", choices=("dask", "ray"))
    backend = parser.parse_args().backend
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), [] if backend is None else ["--backend", backend])


def measure(folder: Path, backend: list[str]) -> None:
    """Print the parts of a file, and the check of the model."""
    paths = [write(folder / f"short/r{i:05d}.csv", 200, i) for i in range(max(SIZES))]
    long = [write(folder / f"long/r{i}.csv", LONG, i) for i in range(4)]
    some = paths[:200]
    specs = {text.partition(" ")[0]: rtamt.parse(text) for text in (LIMIT, RESPONSE)}
    request = TracesAsked(specs, EvaluationOptions(end="cut"), Columns())
    job = FleetJob(request, verify=False, version=version())
    runner, sent = job.runner(), pickled(job)
    tasks: Any = [(path, None) for path in some]
    with runner, FleetFolder(folder / "rows", identity_of(request), [*specs]) as store:
        rows = judge_batch("bench", sent, version(), tasks)
        read = each(lambda: [pyarrow.csv.read_csv(path) for path in some], some)
        judged = each(lambda: judge_files(request, some, workers=1, explain=()), some)
        copied = each(lambda: list(runner.run(tasks)), some)
        parent = each(lambda: judge_batch("bench", sent, version(), tasks), some)
        written = each(lambda: store.add(rows), some)
        of_long = each(lambda: judge_files(request, long, workers=1, explain=()), long)
    end_processes("bench")
    size = Path(long[0]).stat().st_size
    print(f"pyarrow reads a file of 200 rows    {read:8.3f} ms")
    print(f"read and judged                     {judged:8.3f} ms")
    print(f"hash, copy and row                  {copied - judged:8.3f} ms")
    print(f"the worker that watches the process {parent:8.3f} ms")
    print(f"the coordinator                     {written:8.3f} ms")
    print(f"a file of {LONG} rows, {size / 1e6:.1f} MB    {of_long:8.1f} ms")
    print(f"a gigabyte                          {of_long / size * 1e6:8.1f} s")
    start = command(folder, paths[:10], backend) - 10 * copied / 1e3
    for count in SIZES:
        model = start + count * (copied + parent + written) / 1e3
        real = command(folder, paths[:count], backend)
        print(
            f"{count} files: model {model:.2f} s, measured {real:.2f} s, ratio {real / model:.2f}"
        )


def write(path: Path, samples: int, seed: int) -> str:
    """Write a recording of three columns and times; return its path."""
    path.parent.mkdir(exist_ok=True)
    rng = random.Random(seed)
    rows = (
        f"{k / 100:.2f},{rng.uniform(0, 9.9):.4f},{rng.randint(0, 3) // 3},{rng.randint(0, 2) // 2}"
        for k in range(samples)
    )
    path.write_text("time,x,a,b\n" + "\n".join(rows) + "\n")
    return str(path)


def each(run: Callable[[], object], files: list[str]) -> float:
    """Return the minimum processor time of this process per file, in milliseconds."""
    run()
    times = []
    for _ in range(7):
        begin = time.process_time()
        run()
        times.append(time.process_time() - begin)
    return min(times) / len(files) * 1e3


def command(folder: Path, paths: list[str], backend: list[str]) -> float:
    """Return the processor time of a command and of all its processes, in seconds."""
    names, results = folder / "list.txt", tempfile.mkdtemp(dir=folder)
    names.write_text("\n".join(paths))
    arguments = ["monitor", LIMIT, RESPONSE, "--results", results, "--files-from", str(names)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "rtamt_gym", *arguments, *backend],
        stdout=subprocess.DEVNULL,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
