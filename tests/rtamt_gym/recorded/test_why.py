"""The line `why` of `rtamt monitor`: the predicate, time and values that decided a verdict."""

import random
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(values: list[float]) -> str:
    rows = [f"{0.5 * i},{value}" for i, value in enumerate(values)]
    Path("run.csv").write_text("\n".join(["time,x", *rows, ""]))
    return "run.csv"


def reasons(capsys: Output, *arguments: str) -> list[str]:
    main(["monitor", *arguments])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    return [line for line in lines if line.startswith("    why: ")]


@pytest.mark.parametrize("dense", [[], ["--dense"]], ids=["sampled", "dense"])
@pytest.mark.parametrize("seed", range(5))
def test_why_names_first_extreme_sample(seed: int, dense: list[str], capsys: Output) -> None:
    values = [float(random.Random(seed + i).randint(-9, 9)) for i in range(12)]
    for formula, predicate, extreme in (
        ("always(x < 3)", "x < 3", max(values)),
        ("always(x > -99)", "x > -99", min(values)),
        ("eventually(x > 3)", "x > 3", max(values)),
    ):
        time = 0.5 * values.index(extreme)
        expected = f"    why: decided by {predicate} at {time:g} s, where x = {extreme:g}"
        assert reasons(capsys, formula, write(values), *dense) == [expected]


def test_why_of_each_decided_requirement(capsys: Output) -> None:
    trace = write([1, 5, 2])
    low, late = "low = always(x < 4)", "late = always[20:30](x < 4)"
    assert reasons(capsys, low, late, "some = eventually(x > 4)", trace) == [
        "    why: decided by x < 4 at 0.5 s, where x = 5",
        "    why: decided by x > 4 at 0.5 s, where x = 5",
    ]


def test_no_why_of_unknown_values(capsys: Output) -> None:
    Path("gaps.csv").write_text("time,x\n0,1\n1,\n2,9\n")
    assert reasons(capsys, "always(x < 4)", "gaps.csv", "--missing", "unknown") == []


def test_why_names_all_variables_of_the_predicate(capsys: Output) -> None:
    Path("two.csv").write_text("time,x,y\n0,1,2\n1,3,2.5\n2,1,1\n")
    assert reasons(capsys, "always(x - y < 0.25)", "two.csv") == [
        "    why: decided by x - y < 0.25 at 1 s, where x = 3 and y = 2.5"
    ]


@pytest.mark.parametrize("dense", [[], ["--dense"]], ids=["sampled", "dense"])
def test_why_names_no_undecided_request(dense: list[str], capsys: Output) -> None:
    rows = ["0,0,0", "1,5,0", "2,0,2", "3,0,2", "4,0,0", "5,5,-10"]
    Path("late.csv").write_text("\n".join(["time,req,gnt", *rows, ""]))
    formula = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
    expected = ["    why: decided by gnt >= 3 at 2 s, where gnt = 2"]
    assert reasons(capsys, formula, "late.csv", *dense) == expected
    main(["monitor", formula, "late.csv", *dense, "--junit", "out.xml"])
    assert "at 5 s" not in Path("out.xml").read_text()
    capsys.readouterr()
    main(["explain", formula, "late.csv", *dense])
    text = capsys.readouterr().out
    assert "VIOLATED, robustness -2, certain from 3 s on\nunder --end cut its upper bound" in text
    assert "robustness -1 at 0 s, decided by gnt >= 3 at 2 s" in text
    main(["explain", formula, "late.csv", *dense, "--end", "complete"])
    assert "bound decides" not in capsys.readouterr().out


def test_why_of_every_instant(capsys: Output) -> None:
    Path("x.csv").write_text("time,x\n0,5\n1,-1\n2,-1\n3,5\n4,-9\n")
    assert reasons(capsys, "eventually[0:1](x > 0)", "x.csv", "--view", "step") == [
        "    why: decided by x > 0 at 1 s, where x = -1"
    ]


def test_why_under_an_open_end(capsys: Output) -> None:
    assert reasons(capsys, "always(x < 3)", write([1, 5, 2, 4]), "--end", "open") == [
        "    why: decided by x < 3 at 0.5 s, where x = 5"
    ]
