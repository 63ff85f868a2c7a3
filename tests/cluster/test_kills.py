"""Recordings on Dask and Ray while coordinators and workers are killed at random moments."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import pytest
import ray
from distributed import LocalCluster

SPECS = ("low = always(x < 9)", "answered = always(x > 5 implies eventually[0:1](y > 0))")
VARYING = ("wall", "worker", "mtime")
COMMAND = (sys.executable, "-m", "rtamt_gym", "monitor", *SPECS)
KILLS = 10
FILES = 1500

Workers = Callable[[], list[int]]


def text(seed: int) -> str:
    rng = random.Random(seed)
    rows = (f"{k / 10},{rng.uniform(0, 9.2):.3f},{rng.choice((-1, -1, 1))}" for k in range(50))
    return "time,x,y\n" + "\n".join(rows) + "\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with recordings, and the results of an undisturbed run on this machine."""
    folder = tmp_path_factory.mktemp("kills")
    (folder / "runs").mkdir()
    for i in range(FILES):
        (folder / f"runs/r{i:04d}.csv").write_text(text(i))
    (folder / "runs/bad.csv").write_text("time,x,y\n0,1,what\n")
    run(folder, "undisturbed").wait()
    return folder


def run(folder: Path, results: str, *more: str) -> subprocess.Popen[bytes]:
    """Start a coordinator; its errors go to a file."""
    runs = str(folder / "runs")
    command = [*COMMAND, "--results", str(folder / results), *more, "--", runs]
    with (folder / f"{results}.log").open("a") as log:
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log)


def steady(folder: Path) -> list[dict[str, Any]]:
    table = pq.read_table(folder / "results.parquet").to_pylist()
    return [{k: v for k, v in row.items() if k not in VARYING} for row in table]


@contextmanager
def cluster(backend: str) -> Iterator[tuple[str, Workers]]:
    """Start a cluster of two workers; yield its address, and a function of the workers' ids."""
    if backend == "dask":
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
            # A nanny whose worker dies while it starts may give up, so these are not killed.
            yield (
                local.scheduler_address,
                lambda: [
                    nanny.pid
                    for nanny in local.workers.values()
                    if nanny.worker_address in local.scheduler.workers
                ],
            )
        return
    context = ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        yield context.address_info["gcs_address"], workers_of_ray
    finally:
        ray.shutdown()


def workers_of_ray() -> list[int]:
    """Return the processes of this test's Ray that run tasks; the idle ones if there are none.

    A node does not outlive its agents, which have similar titles.
    """
    found = []
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            title = "".join(process.cmdline()[:1])
            if title.startswith("ray::") and "Agent" not in title:
                found.append((title.startswith("ray::IDLE"), process.pid))
    return [pid for idle, pid in found if idle == min(found)[0]]


@pytest.mark.parametrize("victims", ["coordinator", "worker", "both"])
@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_ten_kills_change_no_row(
    backend: str, victims: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # otherwise it writes a file next to the user's
    rng, results, kills = random.Random(f"{backend} {victims}"), f"{backend}-{victims}", 0
    with cluster(backend) as (address, workers):
        options = ("--backend", backend, "--scheduler", address)
        running = run(folder, results, *options)
        while kills < KILLS:
            try:
                running.wait(timeout=rng.uniform(0.5, 6.0))
                shutil.rmtree(folder / results)  # it has ended before: start once more
                running = run(folder, results, *options)
                continue
            except subprocess.TimeoutExpired:
                kills += 1
            if victims != "coordinator" and (alive := workers()):
                with suppress(ProcessLookupError):
                    os.kill(rng.choice(alive), signal.SIGKILL)
            if victims != "worker":
                running.kill()
                running.wait()
                running = run(folder, results, *options)
        running.wait()
        run(folder, results, *options).wait()  # repeats rows of lost workers
    assert (folder / results / "results.parquet").exists(), (folder / f"{results}.log").read_text()
    assert steady(folder / results) == steady(folder / "undisturbed")
