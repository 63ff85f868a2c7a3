"""Runs that end their process or hang have a row; Ctrl-C and kills leave no process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import FrameType
from typing import Any, Self

import pytest
from campaign_systems import Alive, noted, program, tank_runner, tank_tasks, troubled

from rtamt_gym.play import folder as campaign_folder
from rtamt_gym.play.campaign import run_campaign
from rtamt_gym.results import Record

pytestmark = pytest.mark.slow

FINE, EXITS, KILLED, HANGS, RAISES, ONCE = 0, 1, 2, 4, 5, 6


def test_a_run_that_dies_or_hangs_is_in_its_row_and_costs_no_other(tmp_path: Path) -> None:
    runner = tank_runner(troubled(tmp_path))
    # The first are given out one by one, the others together.
    troubles = [HANGS, EXITS, FINE, FINE, FINE, ONCE, FINE, KILLED, FINE, RAISES, FINE]
    tasks = [({"inflow": i / 30, "trouble": item}, None) for i, item in enumerate(troubles)]
    record = run_campaign(runner, tasks, n_jobs=2, timeout=3)
    errors = {
        HANGS: "TimeoutError: the run was ended after timeout=3 s",
        EXITS: "ChildProcessError: the run ended its process with exit status 3, twice",
        KILLED: "ChildProcessError: the run ended its process by SIGKILL, twice",
        RAISES: "ZeroDivisionError: division by zero",
    }
    assert [row.error for row in record] == [errors.get(item, "") for item in troubles]
    assert [dict(row.case) for row in record] == [case for case, _ in tasks]
    assert record.rows[0].wall >= 3
    for row, trouble in zip(record, troubles, strict=True):
        if trouble in {HANGS, EXITS, KILLED}:
            assert (row.ended, row.outcomes, row.simulated) == ("error", {}, 0)
        else:  # the run that died once now succeeds
            assert (row,) == run_campaign(runner, [(row.case, None)]).rows


PROGRAM = """
import sys
from pathlib import Path
from campaign_systems import noted, tank_runner, tank_tasks
from rtamt_gym.play.campaign import run_campaign
place = Path(sys.argv[1])
system = noted(place / "runs", place / "alive", hangs=0.5)
run_campaign(tank_runner(system), tank_tasks(40), n_jobs=2, folder=place / "campaign")
"""


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_campaign_leaves_no_process_and_goes_on(
    tmp_path: Path, end: signal.Signals
) -> None:
    with Alive(tmp_path / "alive") as alive, program(PROGRAM, tmp_path) as running:
        assert alive.is_written()  # a run hangs in C, and has started a process of its own
        running.send_signal(end)
        errors = running.communicate()[1]
        assert alive.is_over()
    assert running.returncode == -end
    assert ("KeyboardInterrupt" in errors) == (end == signal.SIGINT)
    partly = Record.load(tmp_path / "campaign")
    tasks = tank_tasks(40)
    whole = run_campaign(tank_runner(), tasks)
    assert 0 < len(partly) < 20
    assert all(row in whole.rows for row in partly)
    system = noted(tmp_path / "others", Path(os.devnull))
    folder = tmp_path / "campaign"
    result = run_campaign(tank_runner(system), tasks, folder=folder, accept_changed=True)
    assert result.rows == whole.rows
    left = (tmp_path / "others").read_text().split()
    assert sorted(map(float, left)) == [
        row.case["inflow"] for row in whole if row not in partly.rows
    ]


UNGUARDED = """
from rtamt_gym import Parameter, sweep
def tank(inflow):
    yield {"level": inflow}
space = [Parameter("inflow", 0, 1)]
sweep(tank, "always(level < 2)", space, samples=2, period=1, n_jobs=2)
"""


def test_a_module_that_starts_workers_while_they_import_it_starts_no_more(tmp_path: Path) -> None:
    (tmp_path / "unguarded.py").write_text(UNGUARDED)
    command = [sys.executable, "-c", "import unguarded"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert ran.stderr.splitlines()[-1] == (
        "rtamt.errors.InputError: another process cannot make the system: InputError: a module "
        "starts workers during its import, and workers import it too; put the call below "
        'if __name__ == "__main__":; give the id of a registered environment, or a function that '
        "can be imported or pickled"
    )


KILLED_PROGRAM = """
import os, random, signal, sys
from pathlib import Path
from campaign_systems import noted, tank_runner, tank_tasks
from rtamt_gym.play import campaign, record

SEED, COUNT, KILLS = map(int, sys.argv[1:4])
PLACE = Path(sys.argv[4])
campaign._SECONDS = 0.02
FILES = ("play/campaign.py", "play/folder.py", "play/workers.py")
OF_TASKS = {"<genexpr>", "<listcomp>", "digest"}
left = 0


def trace(frame, event, _):
    global left
    code = frame.f_code
    # What is done for each task would hide what is done for each chunk.
    if not code.co_filename.endswith(FILES) or code.co_name in OF_TASKS:
        return None
    if event == "line":
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
    return trace


def run(jobs):
    system = noted(PLACE / f"runs-{attempt}", PLACE / "alive")
    campaign.run_campaign(
        tank_runner(system), tank_tasks(COUNT), n_jobs=jobs, folder=PLACE / "campaign"
    )


rng = random.Random(SEED)
for attempt in range(KILLS + 1):
    lines, jobs = rng.randrange(1, 900), rng.choice([None, None, 2])
    process = os.fork()
    if not process:
        if attempt < KILLS:
            left = lines
            sys.settrace(trace)
        run(jobs)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    # A kill may come before the folder is one of a campaign.
    there = (PLACE / "campaign/campaign.json").exists()
    found = record.Record.load(PLACE / "campaign") if there else []
    print(code, *(row.case["inflow"] for row in found), flush=True)
"""


def test_after_ten_kills_at_random_moments_the_record_is_that_of_an_undisturbed_campaign(
    tmp_path: Path,
) -> None:
    count, kills = 300, 10
    with Alive(tmp_path / "alive") as alive:
        with program(KILLED_PROGRAM, 0, count, kills, tmp_path) as running:
            out = running.communicate()[0].split("\n")
        assert alive.is_over()
    finished: set[float] = set()
    for attempt, line in enumerate(out[:-1]):
        code, *after = map(float, line.split())
        assert code == (-signal.SIGKILL if attempt < kills else 0)
        log = tmp_path / f"runs-{attempt}"
        began = log.read_text().split() if log.exists() else []
        assert finished.isdisjoint(map(float, began))
        assert finished <= set(after)
        finished = set(after)
    whole = run_campaign(tank_runner(), tank_tasks(count))
    result = Record.load(tmp_path / "campaign")
    assert (result.rows, result.requirements) == (whole.rows, whole.requirements)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # files left open
def test_what_is_cut_off_at_any_line_goes_on_from_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign_folder, "to_disk", lambda _: None)  # the power stays on
    runner, tasks = tank_runner(), tank_tasks(2)
    whole = run_campaign(runner, tasks)
    line = cut = 0
    while cut == line:  # each line of the campaign's own code, until there is no further one
        line += 1
        folder = tmp_path / str(line)
        with Cut(line) as cutting:
            run_campaign(runner, tasks, folder=folder)
        cut = cutting.lines
        assert run_campaign(runner, tasks, folder=folder) == Record.load(folder) == whole
        assert sorted(item.name for item in folder.iterdir()) == [
            "campaign.json",
            "lock",
            "record.parquet",
        ]
    assert line > 200


class Cut:
    """Ends what is inside before a line of the module of folders or `run_campaign`.

    Attributes:
        lines: How many lines came, with the one that was not run.
    """

    class End(BaseException):
        """The end, which nothing handles."""

    def __init__(self, line: int) -> None:
        self._line = line
        self.lines = 0

    def __enter__(self) -> Self:
        self._before = sys.gettrace()
        sys.settrace(self._trace)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> bool:
        sys.settrace(self._before)
        return kind is Cut.End

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:  # noqa: ANN401
        code = frame.f_code
        if code.co_name in {"close", "__exit__"}:  # which a kill would not run
            return None
        if not code.co_filename.endswith(("play/campaign.py", "play/folder.py")):
            return None
        if event == "line":
            self.lines += 1
            if self.lines == self._line:
                raise Cut.End
        return self._trace
