"""Campaigns continue after any kill: nothing is lost or run twice, and no process is left."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any, Self

import pytest
from campaign_systems import Alive, program, tank_runner, tank_tasks

from rtamt_gym.play import folder as campaign_folder
from rtamt_gym.play.campaign import run_campaign
from rtamt_gym.results import Record

pytestmark = pytest.mark.slow

PROGRAM = """
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
        with program(PROGRAM, 0, count, kills, tmp_path) as running:
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
