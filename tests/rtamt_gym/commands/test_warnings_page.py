"""Each row of the page on warnings: the printed text, the option that fails, the exit codes."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import NamedTuple

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
PAGE = Path(__file__).parents[3] / "docs" / "warnings.md"
SYSTEMS = """\
import sys


def server(load=0.5):
    for i in range(20):
        yield {"req": 2.0 * load, "gnt": 5.0}


def half(load=0.5):
    if load > 0.5:
        raise ValueError("diverged")
    yield from server(load)


def broken(load=0.5):
    raise ValueError("no licence")
    yield {}


def leaves(load=0.5):
    sys.exit(0)
    yield {}


def fades(load=0.5):
    yield from ({"gnt": 5.0} for _ in range(20 if load > 0.5 else 5))


def leaves_at_times(load=0.5):
    if load > 0.5:
        sys.exit(0)
    yield from server(load)


def quits(observation):
    if observation[0] > 0:
        sys.exit(0)
    return 0


def frail(observation):
    if observation[0] > 0:
        raise ValueError("no such layer")
    return 0
"""

TIRING = """\
import gymnasium as gym
from blinking import Blink


class Tiring(Blink):
    steps = 0

    def step(self, action):
        Tiring.steps += 1
        shown = super().step(action)
        return (*shown[:4], {"success": Tiring.steps <= 60})


if "Tiring-v0" not in gym.registry:
    gym.register("Tiring-v0", "tiring:Tiring")
"""
"""An environment that succeeds in its first six episodes only, with any seed."""


class Row(NamedTuple):
    """A row of the page: ``fails`` is an option with its exit code, or a code without one."""

    what: str
    printed: str
    fails: str

    @property
    def code(self) -> int:
        """Return the exit code without the option."""
        return int(self.fails[0]) if self.fails[0].isdecimal() else 0


class Shown(NamedTuple):
    """The command of a row, the option that makes it fail, and the text to remove for that."""

    command: str
    switch: str = ""
    without: str = ""

    def words(self, *, fails: bool) -> list[str]:
        """Return the arguments, with the failing option before the traces."""
        command = self.command.replace(self.without, "") if fails else self.command
        head, dashes, traces = command.partition(" -- ")
        return shlex.split(f"{head} {self.switch if fails else ''}{dashes}{traces}")


POLE = "CartPole-v1 --signal angle=obs[2] --policy zero"
RESPONSE = "answered = always(req >= 3 implies eventually[0:1](gnt >= 3))"
LEAN = "right = always(angle > 2 implies eventually[0:0.1](angle < 0.02))"
SEARCH = f"falsify plants:server '{RESPONSE}' --vary load=0:1 --budget 10 --period 1"
BOTH = "both = always((req >= 3 implies gnt > 1) and (req >= 9 implies gnt > 1))"
EITHER = "either = eventually(gnt > 5) or eventually(req >= 3 implies gnt > 99)"
MINED = "'always(req >= ?r implies gnt < 0)' --range r=0:9 --tolerance 0.0001"
STANDS = "--spec 'always(abs(angle) < 1)'"
ASKED = "--require-triggered"
FADES = (
    "falsify plants:fades 'late = always[0:10](gnt >= 3)' --vary load=0:1 --budget 8 "
    "--period 1 --at-termination cut"
)
SOON = "late = always[0:0.2](abs(angle) < 1)"
QUITS = POLE.replace("zero", "plants:quits")
FRAIL = POLE.replace("zero", "plants:frail")
GRANTED = "'always(gnt >= 3)'"
LIMITS = {
    **dict.fromkeys(("holes", "high"), "'low = always(gnt < 5)'"),
    **dict.fromkeys(("asks", "calms"), f"'{RESPONSE}'"),
    "two": "'low = always(gnt < 5); high = always(gnt < 6)'",
    "changed": "'low = always(gnt < 5); high = always(gnt < 7)'",
}
"""The requirements of compared results."""
LIMITED = "'input float64 limit = 5.0; float64 gnt; fine = always(gnt > limit)'"
SHOWN: dict[str, Shown] = {
    "no trace triggers the requirement": Shown(f"monitor '{RESPONSE}' -- idle.csv calm.csv", ASKED),
    "only some traces trigger it": Shown(
        f"monitor '{RESPONSE}' -- busy.csv calm.csv", f"{ASKED}=all"
    ),
    "unknown values may hide a trigger": Shown(
        f"monitor '{RESPONSE}' asks.csv --missing unknown", ASKED
    ),
    "no simulation of a search triggers it": Shown(SEARCH, ASKED),
    "one of several implications is never triggered": Shown(
        f"monitor '{BOTH}' -- idle.csv busy.csv"
    ),
    "the traces of a mined constant trigger nothing": Shown(f"mine {MINED} -- busy.csv idle.csv"),
    "the verdict needed no answer": Shown(f"monitor '{EITHER}' busy.csv", "--require-answered"),
    "a variable stands alone as a formula": Shown("monitor 'p = always(gnt or req < 3)' idle.csv"),
    "windows extend past a trace that counts as complete": Shown(
        "monitor 'always[0:60](gnt >= 3)' idle.csv --end complete", "--end cut"
    ),
    "the recording is short": Shown(f"monitor {GRANTED} short.csv", "--min-duration 10s"),
    "the recording has a gap of hours": Shown(
        f"monitor {GRANTED} gap.csv --jitter 5%", "--max-gap 10s", "--jitter 5%"
    ),
    "a variable never changes": Shown(f"monitor {GRANTED} short.csv"),
    "a value is outside its declared range": Shown(
        "monitor 'input float gnt in [0, 5]; p = always(gnt >= 3)' short.csv", "--strict-ranges"
    ),
    "a cell of a table of events is empty": Shown(
        f"monitor {GRANTED} holes.csv --dense", "--missing unknown"
    ),
    "rows are not evenly spaced": Shown(
        f"monitor {GRANTED} late.csv --jitter 5%", without="--jitter 5%"
    ),
    "`--period` contradicts the times": Shown(
        f"monitor {GRANTED} short.csv --period 0.1", "--max-gap 10s"
    ),
    "the times have no unit": Shown(
        f"monitor {GRANTED} ms.csv", "--time-unit ms --min-duration 10s"
    ),
    "a default replaces a missing column": Shown(f"monitor {LIMITED} short.csv", "--no-defaults"),
    "a folder of traces has other files": Shown(f"monitor {GRANTED} -- runs", "--min-traces 2"),
    "B lacks a recording, a requirement or a time of A": Shown(
        "compare both.json idle.json", "--require-all"
    ),
    "B never triggers a requirement that A triggers": Shown(
        "compare asks.json calms.json", "--require-all"
    ),
    "a requirement has another text in B": Shown(
        "compare two.json changed.json --accept-changed", "--require-all"
    ),
    "some simulations of a search leave a requirement undecided": Shown(
        FADES, "--at-termination failure", "--at-termination cut"
    ),
    "points of a sweep leave a requirement undecided": Shown(
        f"sweep {POLE} --requirement '{SOON}' --vary env.gravity=9:10 --samples 2 --duration 0.1",
        "--require-satisfied",
    ),
    "no point of a sweep satisfies a requirement": Shown(
        f"sweep {POLE} --requirement 'right = always(angle > 2)' --vary env.gravity=9:10 "
        "--samples 2",
        "--require-satisfied",
    ),
    "an input of a search has no effect": Shown(
        f"falsify plants:server {GRANTED} --vary load=0:1 --budget 10 --period 1"
    ),
    "some points of a sweep failed": Shown(
        f"sweep {FRAIL} --requirement 'always(abs(angle) < 1)' --vary env.gravity=9:10 --samples 8",
        "--allow-failures 0",
    ),
    "a policy raises an error in some episodes": Shown(
        f"evaluate {FRAIL} {STANDS} --episodes 6 --at-termination cut",
        "--target 0.95",
        "--episodes 6",
    ),
    "the environment ended while a requirement was undecided": Shown(
        f"evaluate {POLE} {STANDS} --target 0.5", "--at-termination failure"
    ),
    "the environment ended inside a bounded window": Shown(
        f"evaluate {POLE} --spec 'late = always[0:20](abs(angle) < 1)' --target 0.5",
        "--at-termination failure",
    ),
    "success at some step does not last": Shown(
        "evaluate blinking:Blink-v0 --policy zero --success --episodes 6 --hold 900ms",
        "--target 0.5",
        "--episodes 6",
    ),
    "seeds do not repeat episodes": Shown(
        "evaluate blinking:Wild-v0 --policy zero --success --episodes 2"
    ),
    "an episode differs when it is played again": Shown(
        "evaluate tiring:Tiring-v0 --policy zero --success --episodes 6 --report page.html"
    ),
    "traces do not test the numbers of a requirement": Shown(
        f"monitor --mutants '{RESPONSE}' busy.csv", "--min-killed 80%"
    ),
    "surviving mutants may mean the same": Shown(f"monitor --mutants {GRANTED} --dense short.csv"),
    "a saved case has no hashes of its model": Shown("replay bare.json"),
    "a report shows a saved case without running it": Shown(
        "report gone.json -o page.html", "--play"
    ),
}


SENTENCES: dict[Row, Shown] = {
    Row(
        "no requirement has an implication, with `--require-triggered`",
        "no implication to trigger: grants; write 'p implies q' for 'not p or q'",
        "3",
    ): Shown(f"monitor 'grants = always(not (req >= 9) or gnt >= 3)' idle.csv {ASKED}"),
    Row(
        "the recording ends too early for a requirement",
        "eventually[4:6](gnt < 3): not recorded: 6 s",
        "3",
    ): Shown("monitor 'always(gnt > 0) and eventually[4:6](gnt < 3)' idle.csv"),
    Row(
        "a value is unknown",
        "undecided under every --end: it depends on values of gnt that are not known",
        "3",
    ): Shown(f"monitor {GRANTED} holes.csv --missing unknown"),
    Row(
        "a cell is empty",
        "column 'gnt': expected a number, got ''",
        "2",
    ): Shown(f"monitor {GRANTED} holes.csv"),
    Row(
        "a default would hide a misspelt column",
        "no column 'limit', which has a default, but 'Limit'",
        "2",
    ): Shown(f"monitor {LIMITED} near.csv"),
    Row(
        "one trace is unreadable, and the others satisfy",
        "rtamt: error: broken.csv, line 2",
        "2",
    ): Shown(f"monitor {GRANTED} -- idle.csv broken.csv"),
    Row(
        "A does not decide whether a violation of B is new",
        "undecided in the other:",
        "3",
    ): Shown("compare holes.json high.json"),
    Row(
        "all simulations of a search leave a requirement undecided",
        "late of fades was not violated, and is undecided in 8 of 8 simulations",
        "3",
    ): Shown(FADES.replace("[0:10]", "[0:30]")),
    Row(
        "some simulations of a search failed",
        "not violated in 5 evaluated simulations; 5 failed",
        "3",
    ): Shown(SEARCH.replace(":server", ":half").replace(RESPONSE, "always(gnt >= 3)")),
    Row(
        "all simulations failed",
        "all 8 simulations failed, the first with ValueError: no licence",
        "2",
    ): Shown(SEARCH.replace(":server", ":broken")),
    Row(
        "some episodes of a run failed",
        "2 of 4 episodes failed; the first, seed 0:",
        "2",
    ): Shown(f"run {FRAIL} {STANDS} --episodes 4"),
    Row(
        "there are too few episodes for `--target`",
        "spec: undecided after 3",
        "3",
    ): Shown(f"evaluate {POLE} {STANDS} --episodes 3 --target 0.9 --at-termination cut"),
    Row(
        "a saved case now has another verdict",
        "another verdict",
        "1",
    ): Shown("replay other.json"),
    Row(
        "a report shows a case that cannot run again",
        "gone.json was not run: the case holds results of another model",
        "3",
    ): Shown("report gone.json --play -o page.html"),
    Row(
        "no episode of a policy triggers it",
        "never triggered: right in 0 of 3 episodes",
        "`--require-triggered`: 3",
    ): Shown(f"evaluate {POLE} --spec '{LEAN}' --episodes 3 --at-termination cut", ASKED),
    Row(
        "no point of a sweep triggers it",
        "never triggered: right in 0 of 2 simulations",
        "`--require-triggered`: 3",
    ): Shown(f"sweep {POLE} --requirement '{LEAN}' --vary env.gravity=9:10 --samples 2", ASKED),
    Row(
        "a saved case does not trigger it",
        "never triggered: answered in 0 of 1 run",
        "`--require-triggered`: 3",
    ): Shown("replay case.json", ASKED),
    Row(
        "a system calls `sys.exit` in all simulations",
        "the first with InputError: leaves called sys.exit(0), which does not end a simulation",
        "2",
    ): Shown(SEARCH.replace(":server", ":leaves")),
    Row(
        "a system calls `sys.exit` in some simulations",
        "InputError: leaves_at_times called sys.exit(0), which does not end a simulation",
        "3",
    ): Shown(SEARCH.replace(":server", ":leaves_at_times").replace(RESPONSE, "always(gnt >= 3)")),
    Row(
        "a policy calls `sys.exit` in some episodes",
        "InputError: the policy plants:quits called sys.exit(0)",
        "`--target 0.95`: 1",
    ): Shown(
        f"evaluate {QUITS} {STANDS} --episodes 6 --at-termination cut",
        "--target 0.95",
        "--episodes 6",
    ),
    Row(
        "a module calls `sys.exit` at import",
        "cannot import exits: it called sys.exit(0)",
        "2",
    ): Shown(SEARCH.replace("plants:", "exits:")),
    Row(
        "the environment of a sweep ended inside a bounded window",
        "note: the environment ended an episode inside a bounded window",
        "-",
    ): Shown(
        f"sweep {POLE} --requirement '{SOON.replace('0.2', '1')}' "
        "--vary env.gravity=9:10 --samples 2"
    ),
}
"""Cases that the page describes in a sentence outside its tables."""


def rows() -> list[Row]:
    """Return the rows of the page."""
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| ") and len(cells) == 3 and cells[0] != "Case":
            found.append(Row(cells[0], cells[1].strip("`"), cells[2].strip()))
    return found


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with traces and systems."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name, request in (("idle", 0), ("calm", 1), ("busy", 5)):
        table = "".join(f"{time},{request if time == 1 else 0},9\n" for time in range(6))
        (tmp_path / f"{name}.csv").write_text(f"time [s],req,gnt\n{table}")
    (tmp_path / "short.csv").write_text("time [s],gnt\n0,9\n1,9\n2,9\n")
    (tmp_path / "ms.csv").write_text("time,gnt\n0,9\n10,9\n20,9\n")
    (tmp_path / "near.csv").write_text("time [s],gnt,Limit\n0,9,1\n1,9,1\n2,9,1\n")
    late = "".join(f"{time},9\n" for time in (*range(12), *range(36000, 36012)))
    (tmp_path / "gap.csv").write_text(f"time [s],gnt\n{late}")
    (tmp_path / "holes.csv").write_text("time [s],gnt\n0,4\n1,\n2,4\n")
    (tmp_path / "asks.csv").write_text("time [s],req,gnt\n0,0,9\n1,,9\n2,0,9\n")
    (tmp_path / "late.csv").write_text("time [s],gnt\n0,4\n1,4\n2.5,4\n3,4\n4,4\n")
    (tmp_path / "broken.csv").write_text("time [s],gnt\n0,x\n")
    (tmp_path / "plants.py").write_text(SYSTEMS)
    (tmp_path / "exits.py").write_text("import sys\n\nsys.exit(0)\n")
    (tmp_path / "tiring.py").write_text(TIRING)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "idle.csv").write_bytes((tmp_path / "idle.csv").read_bytes())
    (tmp_path / "runs" / "picture.png").touch()
    return tmp_path


@pytest.fixture
def cases(folder: Path, capsys: Output) -> None:
    """Return a saved case, one that expects another verdict, and one whose system leaves."""
    assert main(shlex.split(f"{SEARCH} --save case.json")) == 0
    kept = json.loads((folder / "case.json").read_text())
    kept["expected"]["verdict"] = "VIOLATED"
    (folder / "other.json").write_text(json.dumps(kept))
    bare = {key: value for key, value in kept.items() if key != "fingerprint"}
    bare["expected"] = bare["expected"] | {"verdict": "SATISFIED"}
    (folder / "bare.json").write_text(json.dumps(bare))
    kept["system"] = {"object": "plants:leaves"}
    (folder / "gone.json").write_text(json.dumps(kept))
    capsys.readouterr()
    (folder / "high.csv").write_text("time [s],gnt\n0,4\n1,9\n2,4\n")
    for name, traces in (
        ("both", "idle.csv calm.csv"),
        ("idle", "idle.csv"),
        ("holes", "holes.csv"),
        ("high", "high.csv"),
        ("two", "idle.csv"),
        ("asks", "busy.csv"),
        ("calms", "idle.csv"),
        ("changed", "idle.csv"),
    ):
        limit = LIMITS.get(name, GRANTED)
        main(shlex.split(f"monitor {limit} --json --occurrences --missing unknown -- {traces}"))
        (folder / f"{name}.json").write_text(capsys.readouterr().out)


def test_every_row_has_a_command() -> None:
    assert [row.what for row in rows()] == list(SHOWN)


@pytest.mark.usefixtures("cases")
@pytest.mark.parametrize("row", [*rows(), *SENTENCES], ids=lambda row: row.what)
def test_row_is_true(row: Row, capsys: Output) -> None:
    shown = SENTENCES.get(row) or SHOWN[row.what]
    assert main(shown.words(fails=False)) == row.code, capsys.readouterr()
    said = "".join(capsys.readouterr())
    assert all(len(line) <= 80 for line in said.splitlines() if not line.startswith("rtamt: "))
    assert row.printed in " ".join(said.split())
    if found := re.search(r": (\d)$", row.fails):
        assert main(shown.words(fails=True)) == int(found[1])
        return
    assert not shown.switch
    assert not shown.without
