"""Many files into a folder of results: rows, files judged again, kills, and crashes."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import pytest

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.commands import fleet_worker
from rtamt_gym.commands.fleet_folder import FleetFolder
from rtamt_gym.commands.fleet_worker import FileRunner, FileTask, FleetJob, judge_batch
from rtamt_gym.commands.traces import TracesAsked
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.play.workers import end_processes
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.results.matrix import RESULTS

Output = pytest.CaptureFixture[str]
SPECS = ("low = always(x < 9)", "answered = always(x > 5 implies eventually[0:1](y > 0))")
VARYING = ("wall", "worker", "mtime")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    for i in range(30):
        write(tmp_path / f"runs/r{i:03d}.csv", i)
    return tmp_path


def write(path: Path, seed: int) -> None:
    rng = random.Random(seed)
    rows = (f"{k / 10},{rng.uniform(0, 9.2):.3f},{rng.choice((-1, -1, 1))}" for k in range(50))
    path.write_text("time,x,y\n" + "\n".join(rows) + "\n")


def judge(*more: str, files: Sequence[str] = ("runs",)) -> int:
    return main(["monitor", *SPECS, "--results", "results", *more, "--", *files])


def rows(place: Path = Path("results")) -> dict[str, dict[str, Any]]:
    """Return the rows by path; no path has two."""
    table = pq.read_table(place / RESULTS).to_pylist()
    assert len({row["path"] for row in table}) == len(table)
    return {row["path"]: row for row in table}


def steady(place: Path = Path("results")) -> list[dict[str, Any]]:
    return [{k: v for k, v in row.items() if k not in VARYING} for row in rows(place).values()]


def test_rows_equal_the_outcomes_of_one_command(folder: Path, capsys: Output) -> None:
    (folder / "runs/bad.csv").write_text("time,x,y\n0,1,1\n1,what,1\n")
    (folder / "runs/empty.csv").write_text("")
    main(["monitor", *SPECS, "--json", "--", "runs"])
    trials = json.loads(capsys.readouterr().out)["trials"]
    assert judge("-j", "2") == 2
    found = rows()
    assert {*found} == {trial["name"] for trial in trials}
    for trial in trials:
        row = found[trial["name"]]
        for name, cell in trial["outcomes"].items():
            assert row[f"verdict({name})"] == cell["verdict"]
            if cell["verdict"] == "ERROR":
                assert cell["error"] in row["error"]
            else:
                assert row[f"robustness({name})"] == cell["robustness"]
        data = Path(trial["name"]).read_bytes()
        assert (row["size"], row["sha256"]) == (len(data), hashlib.sha256(data).hexdigest())
    assert "bad.csv, line 3, column 'x'" in found["runs/bad.csv"]["error"]


def test_only_changed_files_are_judged_again(folder: Path, capsys: Output) -> None:
    judge()
    before = rows()
    # Other bytes with the same size and time are not noticed, unless they are verified.
    hidden, changed, removed = (folder / f"runs/r{i:03d}.csv" for i in range(3))
    status = hidden.stat()
    hidden.write_text(hidden.read_text().replace("time", "tyme"))
    os.utime(hidden, ns=(status.st_atime_ns, status.st_mtime_ns))
    write(changed, 99)
    removed.unlink()
    write(folder / "runs/new.csv", 77)
    capsys.readouterr()
    judge()
    assert "judged 2, unchanged 28, gone 1" in capsys.readouterr().out
    after = rows()
    assert after["runs/r000.csv"] == before["runs/r000.csv"]
    assert after["runs/r001.csv"]["sha256"] != before["runs/r001.csv"]["sha256"]
    assert after["runs/r002.csv"] == {**before["runs/r002.csv"], "gone": True}
    judge("--verify")
    assert "no column" in rows()["runs/r000.csv"]["error"] or rows()["runs/r000.csv"] != before
    write(removed, 2)  # it exists again
    judge()
    assert not rows()["runs/r002.csv"]["gone"]


def test_files_that_are_not_listed_keep_their_rows() -> None:
    judge(files=["runs/r000.csv", "runs/r001.csv"])
    judge(files=["runs/r002.csv"])
    assert [row["gone"] for row in rows().values()] == [False] * 3


def test_a_missing_file_is_tried_again_and_a_damaged_one_is_not(
    folder: Path, capsys: Output
) -> None:
    (folder / "runs/bad.csv").write_text("time,x,y\n0,1,what\n")
    names = folder / "list.txt"
    names.write_text("runs/bad.csv\n\nruns/late.csv\n")
    command = ["monitor", *SPECS, "--results", "results", "--files-from", "list.txt"]
    assert main(command) == 2
    assert "FileNotFoundError" in rows()["runs/late.csv"]["error"]
    write(folder / "runs/late.csv", 1)
    capsys.readouterr()
    main(command)
    assert "judged 1, unchanged 1" in capsys.readouterr().out
    assert rows()["runs/late.csv"]["error"] == ""


@pytest.mark.parametrize(
    ("specs", "more", "key"),
    [
        (("always(x < 8)",), (), "specification"),
        (SPECS, ("--end", "complete"), "end"),
        (SPECS, ("--missing", "drop"), "columns"),
    ],
)
def test_other_results_are_refused(
    specs: tuple[str, ...], more: tuple[str, ...], key: str, capsys: Output
) -> None:
    judge()
    assert main(["monitor", *specs, "--results", "results", *more, "--", "runs"]) == 2
    assert f"results holds other results: their {key} is " in capsys.readouterr().err


def test_a_second_coordinator_is_refused(capsys: Output) -> None:
    judge()
    identity = json.loads(Path("results/recordings.json").read_text())
    with FleetFolder(Path("results"), identity, ["low", "answered"]):
        assert judge() == 2
    assert "another process runs rtamt monitor in results" in capsys.readouterr().err


def test_a_foreign_folder_is_refused(folder: Path, capsys: Output) -> None:
    (folder / "results").mkdir()
    (folder / "results/mine.txt").touch()
    assert judge() == 2
    assert "which holds 'mine.txt'" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--verify", "--backend=dask", "--scheduler=a:1"])
def test_options_of_results_need_the_folder(option: str, capsys: Output) -> None:
    assert main(["monitor", *SPECS, option, "--", "runs"]) == 2
    assert "expected --results DIR with" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "package", "extra"),
    [
        (["--backend", "dask"], "distributed", "dask"),
        (["--backend", "ray"], "ray", "ray"),
        (["--", "s3://bucket/a.csv"], "fsspec", "urls"),
    ],
)
def test_missing_packages_leave_no_folder(
    more: list[str], package: str, extra: str, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    files = more[1:] if more[0] == "--" else ["runs"]
    options = [] if more[0] == "--" else more
    assert judge(*options, files=files) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {package} is not installed; from the checkout: pip install '.[{extra}]'\n"
    )
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("url", "error"),
    [
        ("s3://b/a.csv", ImportError("Install s3fs to access S3")),
        ("filecache::s4://b/a.csv", ValueError("Protocol not known: s4")),
    ],
)
def test_missing_file_systems_leave_no_folder(
    url: str, error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    def class_of(protocol: str) -> None:
        if protocol != "filecache":
            raise error

    fsspec = SimpleNamespace(get_filesystem_class=class_of)
    monkeypatch.setitem(sys.modules, "fsspec", fsspec)
    assert judge(files=[url]) == 2
    scheme = url.partition("://")[0].rpartition(":")[2]
    expected = f"cannot open URLs with {scheme}:// ({error}). Install the package"
    assert expected in capsys.readouterr().err
    assert not Path("results").exists()


def test_a_missing_reader_is_tried_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "a.mat").write_bytes(bytes(300))
    specs = {"low": rtamt.parse("always(x < 9)")}
    job = FleetJob(TracesAsked(specs, EvaluationOptions(), Columns()), verify=False, version="0.6")
    with closing(FileRunner(job)) as runner:
        ((_, damaged),) = runner.run([("a.mat", None)])

        def lacking(*_: object) -> None:
            raise ModuleNotFoundError(name="scipy")

        monkeypatch.setattr("rtamt_gym.commands.judging.read_trace_of", lacking)
        ((_, without),) = runner.run([("a.mat", None)])
    assert "pip install '.[files]'" in without["error"]
    assert (damaged["verdict"], without["verdict"]) == ("failed", "failed")
    assert (damaged["retry"], without["retry"]) == (False, True)


def test_a_scheduler_needs_a_backend(capsys: Output) -> None:
    assert judge("--scheduler", "tcp://x:1") == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected --backend dask or --backend ray with --scheduler tcp://x:1, got "
        "none\n"
    )
    assert not Path("results").exists()


def test_the_summary_counts_files_with_notes(folder: Path, capsys: Output) -> None:
    judge()
    assert "notes on" not in capsys.readouterr().out
    for i in (3, 4):
        (folder / f"runs/r{i:03d}.csv").write_text("time,x,y\n0,1,1\n1,1,1\n2,1,1\n")
    judge()
    notes = {path: row["notes"] for path, row in rows().items() if row["notes"]}
    assert {*notes} == {"runs/r003.csv", "runs/r004.csv"}
    line = next(
        line for line in capsys.readouterr().out.splitlines() if line.startswith("notes on 2 files")
    )
    assert "such as runs/r003.csv: " in line


def test_the_summary_lists_requirements_that_were_not_triggered(capsys: Output) -> None:
    specs = ("busy = always(x > 5 implies y > -2)", "idle = always(x > 50 implies y > 5)")
    assert main(["monitor", *specs, "--results", "results", "--", "runs"]) == 0
    out = capsys.readouterr().out
    assert "never triggered: idle in 0 of 30 files" in out
    assert "busy in" not in out


def test_standard_input_is_refused(capsys: Output) -> None:
    assert main(["monitor", *SPECS, "--", "-", "--results", "results"]) == 2
    assert "expected files with one trace each, got '-'" in capsys.readouterr().err


def test_outcomes_are_written_once(capsys: Output) -> None:
    assert judge("--json") == 2
    assert "expected --results or --json, got both" in capsys.readouterr().err


class Deadly(FileRunner):
    """A reader that ends its process at files with this name."""

    def run(self, tasks: Sequence[FileTask], *_: object, **__: object) -> Iterator[tuple[int, Any]]:
        for i, task in enumerate(tasks):
            if "deadly" in task[0]:
                os.kill(os.getpid(), signal.SIGKILL)
            for _number, row in super().run([task]):
                yield i, row


class DeadlyJob(FleetJob):
    def runner(self) -> FileRunner:
        return Deadly(self)


def job(kind: type[FleetJob] = FleetJob) -> bytes:
    asked = TracesAsked({"p": rtamt.parse(SPECS[0])}, EvaluationOptions(end="cut"), Columns())
    return fleet_worker.pickled(kind(asked, verify=False, version=fleet_worker.version()))


def judged(sent: bytes, paths: Sequence[str]) -> list[dict[str, Any]]:
    try:
        return judge_batch("test", sent, fleet_worker.version(), [(path, None) for path in paths])
    finally:
        end_processes("test")
        from rtamt_gym.play import workers

        workers._over.discard("test")


def test_a_crash_of_a_reader_is_the_error_of_its_file_alone(folder: Path) -> None:
    write(folder / "runs/deadly.csv", 5)
    paths = ["runs/r000.csv", "runs/deadly.csv", "runs/r001.csv"]
    found = judged(job(DeadlyJob), paths)
    assert [row["path"] for row in found] == paths
    assert [row["error"] for row in found] == [
        "",
        "runs/deadly.csv: the reader ended its process by SIGKILL, twice",
        "",
    ]


def test_a_hang_is_the_error_of_its_file_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_worker, "LIMIT", 2.0)
    os.mkfifo(folder / "runs/pipe.csv")  # nobody writes to it
    paths = ["runs/r000.csv", "runs/pipe.csv", "runs/r001.csv"]
    first, second, third = judged(job(), paths)
    assert (first["error"], third["error"]) == ("", "")
    assert "was ended after timeout=2 s" in second["error"]


def test_a_worker_of_another_version_is_refused() -> None:
    with pytest.raises(rtamt.InputError, match="Install the same version on both"):
        judge_batch("test", job(), "0.1", [("runs/r000.csv", None)])


def test_a_full_disk_is_an_error_that_another_run_goes_on_from(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    judge(files=["runs/r000.csv"])
    whole = pq.write_table

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pq, "write_table", full)
    assert judge() == 2
    assert "No space left on device. Free space" in capsys.readouterr().err
    monkeypatch.setattr(pq, "write_table", whole)
    judge()
    assert len(rows()) == 30


@pytest.mark.slow
def test_ten_kills_of_the_coordinator_change_no_row(folder: Path) -> None:
    for i in range(30, 600):
        write(folder / f"runs/r{i:03d}.csv", i)
    judge("-j", "2")
    (folder / "results").rename(folder / "undisturbed")
    command = [sys.executable, "-m", "rtamt_gym", "monitor", *SPECS, "--results", "results"]
    rng = random.Random(0)
    kills = 0
    while kills < 10:
        running = subprocess.Popen([*command, "-j", "2", "--", "runs"], stdout=subprocess.DEVNULL)
        try:
            running.wait(timeout=rng.uniform(0.2, 2.5))
            shutil.rmtree(folder / "results")  # it has ended before: start once more
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()
            kills += 1
    judge("-j", "2")
    assert steady(folder / "results") == steady(folder / "undisturbed")
