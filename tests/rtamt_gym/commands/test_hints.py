"""Hints for frequent mistakes on the command line and in simulated functions."""

from __future__ import annotations

from pathlib import Path

import pytest

import rtamt
from rtamt import InputError, InputTypeError
from rtamt_gym import simulate
from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
SPEC = "always(speed<30)"
SYSTEMS = """\
def yields(gain, mass=1.0):
    for _ in range(5):
        yield {"speed": gain}


def needs(gain, mass):
    for _ in range(5):
        yield {"speed": gain}


def driven(throttle):
    for step in range(5):
        yield {"speed": throttle(step)}


def whole(gain, mass):
    return [{"speed": gain}]
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("log.csv").write_text("time,speed\n0,20\n1,20\n")
    Path("flag.csv").write_text("time,speed\n0,on\n1,off\n")
    Path("hinted.py").write_text(SYSTEMS)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (f"monitor {SPEC} log.csv --at-truncation open", "write --end open"),
        (f"monitor {SPEC} log.csv --at-truncation=cut", "write --end cut"),
        (f"run CartPole-v1 --spec {SPEC} --end open", "write --at-truncation open"),
        (f"monitor {SPEC} log.csv --end completed", "did you mean 'complete'?"),
        (f"monitor {SPEC} log.csv --end failure", "failure is for environments"),
        (f"monitor {SPEC} log.csv --missing holt", "did you mean 'hold'?"),
        (
            f"monitor log.csv {SPEC}",
            f"a specification first, got the trace log.csv; write '{SPEC}'",
        ),
        (f"monitor {SPEC} --require-triggered all -- log.csv", "write --require-triggered=all"),
        (f"monitor {SPEC} --require-triggered 5 -- log.csv", "write --require-triggered=5"),
        (f"monitor {SPEC} flag.csv", "write 1 and 0, or true and false"),
        (f"falsify hinted {SPEC} --vary gain=1:2", "write hinted:FUNCTION"),
        (f"falsify hinted.yields {SPEC} --vary gain=1:2", "write hinted:yields"),
        (f"falsify hinted:needs {SPEC} --vary gain=1:2", "--vary mass=1:2"),
        (f"falsify hinted:needs {SPEC} --vary gain=1:2", "--set mass=1"),
        (f"falsify hinted:driven {SPEC} --vary throttle=0:1", "--vary throttle=0:1,points=5"),
        (f"falsify hinted:driven {SPEC} --vary throttle=0:1,point=5", "did you mean 'points'?"),
        (
            f"falsify hinted:whole {SPEC} --vary gain=1:2 --vary mass=1:2 --period 1 --duration 9",
            "its first argument, 'gain', is the time; yield samples, or write whole(time, gain)",
        ),
        (f"falsify hinted:yields {SPEC} --vary gain=1:2 --duration 20x", "20, 20s or 2min"),
    ],
)
def test_hint(words: str, hint: str, capsys: Output) -> None:
    assert main(words.split()) == 2
    assert hint in capsys.readouterr().err


def test_duration_with_unit(capsys: Output) -> None:
    words = f"falsify hinted:yields {SPEC} --vary gain=1:2 --budget 2 --period 1 --duration"
    assert main([*words.split(), "3s"]) == 0
    with_unit = capsys.readouterr().out
    assert main([*words.split(), "3"]) == 0
    assert capsys.readouterr().out == with_unit
    assert "2 simulations; 6 simulated seconds" in with_unit


def test_path_is_not_samples() -> None:
    for function in (rtamt.judge, rtamt.evaluate, rtamt.explain):
        with pytest.raises(InputTypeError, match=r"got the path 'log.csv'; read the file first"):
            function("always(speed < 30)", "log.csv")


def test_case_without_argument() -> None:
    def needs(gain: float, mass: float) -> list[dict[str, float]]:
        raise AssertionError(gain, mass)

    with pytest.raises(InputError, match="needs a value of 'mass'"):
        simulate(needs, SPEC, case={}, period=1, duration=2)


def test_rate_instead_of_period() -> None:
    with pytest.raises(rtamt.SpecificationError, match="2 Hz is a period of 500ms"):
        rtamt.Monitor("always[0:1](x > 0)", "2Hz")
