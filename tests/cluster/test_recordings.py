"""Recordings on a Dask cluster and on Ray of two workers, with lost workers, and files on S3."""

from __future__ import annotations

import os
import random
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import boto3
import pyarrow.parquet as pq
import pytest
import ray
from distributed import LocalCluster
from moto.server import ThreadedMotoServer

from rtamt_gym.__main__ import main

SPECS = ("low = always(x < 9)", "answered = always(x > 5 implies eventually[0:1](y > 0))")
VARYING = ("wall", "worker", "mtime", "etag")


def text(seed: int) -> str:
    rng = random.Random(seed)
    rows = (f"{k / 10},{rng.uniform(0, 9.2):.3f},{rng.choice((-1, -1, 1))}" for k in range(50))
    return "time,x,y\n" + "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    for i in range(400):
        (tmp_path / f"runs/r{i:03d}.csv").write_text(text(i))
    (tmp_path / "runs/bad.csv").write_text("time,x,y\n0,1,what\n")
    return tmp_path


@pytest.fixture(scope="module")
def dask() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


def judge(results: str, *more: str) -> int:
    runs = str(Path("runs").absolute())
    return main(["monitor", *SPECS, "--results", results, *more, "--", runs])


def steady(place: str) -> list[dict[str, Any]]:
    table = pq.read_table(Path(place) / "results.parquet").to_pylist()
    return [{k: v for k, v in row.items() if k not in VARYING} for row in table]


@pytest.mark.usefixtures("folder")
def test_rows_of_dask_equal_those_of_this_machine(dask: LocalCluster) -> None:
    assert judge("here") == 2
    assert judge("there", "--backend", "dask", "--scheduler", dask.scheduler_address) == 2
    assert steady("there") == steady("here")
    workers = pq.read_table("there/results.parquet")["worker"].to_pylist()
    assert len({*workers}) == 2


@pytest.mark.usefixtures("folder")
def test_killed_workers_of_dask_change_no_row(dask: LocalCluster) -> None:
    judge("here")
    rng, over = random.Random(1), threading.Event()
    killed: list[int] = []

    def kill() -> None:
        while not over.wait(rng.uniform(0.5, 2.0)) and len(killed) < 10:
            for worker in [*dask.workers.values()][:1]:
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        for attempt in range(3):
            results = f"there-{attempt}"
            judge(results, "--backend", "dask", "--scheduler", dask.scheduler_address)
    finally:
        over.set()
        killer.join()
    for attempt in range(3):  # rows with too many attempts are tried again
        judge(f"there-{attempt}", "--backend", "dask", "--scheduler", dask.scheduler_address)
        assert steady(f"there-{attempt}") == steady("here")
    assert killed


@pytest.mark.usefixtures("folder")
def test_rows_of_ray_equal_those_of_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    judge("here")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        assert judge("there", "--backend", "ray") == 2
    finally:
        ray.shutdown()
    assert steady("there") == steady("here")


def test_files_on_s3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    try:
        host, port = server.get_host_and_port()
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
            "AWS_ACCESS_KEY_ID": "key",
            "AWS_SECRET_ACCESS_KEY": "secret",
            "AWS_DEFAULT_REGION": "us-east-1",
        }.items():
            monkeypatch.setenv(name, value)
        client = boto3.client("s3")
        client.create_bucket(Bucket="runs")
        for i in range(5):
            client.put_object(Bucket="runs", Key=f"r{i}.csv", Body=text(i).encode())
        Path("list.txt").write_text("".join(f"s3://runs/r{i}.csv\n" for i in range(6)))
        command = ["monitor", *SPECS, "--results", "there", "--files-from", "list.txt"]
        assert main(command) == 2
        rows = {row["path"]: row for row in steady("there")}
        assert "FileNotFoundError" in rows["s3://runs/r5.csv"]["error"]
        client.put_object(Bucket="runs", Key="r1.csv", Body=text(9).encode())
        client.delete_object(Bucket="runs", Key="r2.csv")
        Path("list.txt").write_text("".join(f"s3://runs/r{i}.csv\n" for i in (0, 1, 3, 4)))
        capsys.readouterr()
        main(command)
        assert "judged 1, unchanged 3, gone 2" in capsys.readouterr().out
        after = {row["path"]: row for row in steady("there")}
        assert after["s3://runs/r1.csv"]["sha256"] != rows["s3://runs/r1.csv"]["sha256"]
        assert after["s3://runs/r2.csv"]["gone"]
    finally:
        server.stop()
