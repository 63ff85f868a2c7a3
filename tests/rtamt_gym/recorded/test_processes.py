"""`rtamt monitor -j N`: processes that are interrupted, and processes that die."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main
from rtamt_gym.commands import judging
from rtamt_gym.results.trial import Trial

Output = pytest.CaptureFixture[str]


def test_an_interrupt_is_left_to_the_process_that_has_asked() -> None:
    code = (
        "import os, signal, rtamt_gym.commands.judging as j; j._begin_worker();"
        "os.kill(os.getpid(), signal.SIGINT); print('at work')"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "at work\n", "")


work = judging._row_of_file


def dying(path: str) -> tuple[Trial, judging.Seen]:
    """Judges a trace as a worker does, but dies of one that is called so."""
    if path == "deadly.csv":
        os._exit(9)
    return work(path)


@pytest.mark.slow
def test_a_process_that_dies_keeps_no_other_trace_from_being_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(judging, "_row_of_file", dying)
    names = [f"t{i}.csv" for i in range(6)]
    for name in names:
        (tmp_path / name).write_text("time,x\n0,1\n1,2\n")
    paths = [*names[:3], "deadly.csv", *names[3:]]
    assert main(["monitor", "p = always(x > 0)", "-j", "2", "--json", "--", *paths]) == 2
    said = capsys.readouterr()
    cells = {row["trace"]: row["requirements"]["p"] for row in json.loads(said.out)["traces"]}
    message = "deadly.csv: the process that judged it died, perhaps for lack of memory"
    assert said.err == f"rtamt: error: {message}\n"
    assert cells.pop("deadly.csv") == {"verdict": "ERROR", "error": message}
    assert {name: cell["verdict"] for name, cell in cells.items()} == dict.fromkeys(
        names, "SATISFIED"
    )


def test_processes_ignore_interrupts_before_they_run_a_line() -> None:
    code = (
        "import signal, sys; from concurrent.futures import ProcessPoolExecutor;"
        "from multiprocessing import get_context; import rtamt_gym.commands.judging as j\n"
        "if __name__ == '__main__':\n"
        "    before = signal.getsignal(signal.SIGINT)\n"
        "    with ProcessPoolExecutor(1, get_context('spawn')) as pool:\n"
        "        print(*j._begin(pool, signal.getsignal, [signal.SIGINT]), int(signal.SIG_IGN))\n"
        "    print(signal.getsignal(signal.SIGINT) == before)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ran.stdout, ran.stderr) == ("1 1\nTrue\n", "")
