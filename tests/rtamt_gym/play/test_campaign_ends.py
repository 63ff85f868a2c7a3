"""Runs that end their process or hang have a row; Ctrl-C and kills leave no process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from campaign_systems import Alive, noted, program, tank_runner, tank_tasks, troubled

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
        else:  # the one that died once does not any more
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
