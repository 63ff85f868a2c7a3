"""``--only``: one of several requirements, in every command that takes a specification."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
TWO = "low = always(x < 5); high = always(x > 9 and x < 8)"
POLE = "upright = always(abs(angle) < 9); central = always(abs(position) < 9)"
POLE_WORDS = ["--spec", POLE, "--signal", "angle=obs[2]", "--signal", "position=obs[0]"]


def printed(capsys: Output, *words: str) -> dict[str, Any]:
    main([*words, "--json"])
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.parametrize("command", ["check", "examples"])
def test_commands_on_texts(command: str, capsys: Output) -> None:
    assert {*printed(capsys, command, TWO)["requirements"]} == {"low", "high"}
    assert {*printed(capsys, command, TWO, "--only", "low")["requirements"]} == {"low"}
    assert main([command, TWO, "--only", "law"]) == 2
    assert "--only: no requirement is called 'law'" in capsys.readouterr().err


def test_check_pairs_the_selected_requirement(capsys: Output) -> None:
    other = "low = always(x < 5); high = always(x > 7)"
    assert main(["check", TWO, "--same-as", other]) == 1
    assert main(["check", TWO, "--same-as", other, "--only", "low"]) == 0
    capsys.readouterr()


def test_runs_leave_out_signals_of_other_requirements(capsys: Output) -> None:
    words = ["run", "CartPole-v1", *POLE_WORDS, "--max-steps", "5"]
    assert main([*words, "--only", "upright"]) == 0
    out = capsys.readouterr().out
    assert "upright" in out
    assert "central" not in out
    assert "signals that no specification reads" not in out
    main([*words, "--only", "upright", "--signal", "lost=obs[1]"])
    assert "signals that no specification reads: 'lost'" in capsys.readouterr().out


def test_evaluations(capsys: Output) -> None:
    words = ["evaluate", "CartPole-v1", "--policy", "random", *POLE_WORDS, "--episodes", "2"]
    main([*words, "--only", "central", "--max-steps", "5"])
    out = capsys.readouterr().out
    assert "central" in out
    assert "upright" not in out


def test_searches_and_sweeps(capsys: Output) -> None:
    two = ["slow = always(speed < 999)", "fast = always(speed > -1)"]
    base = ["rtamt/AutomaticTransmission-v0"]
    main(["falsify", *base, *two, "--only", "slow", "--budget", "2"])
    out = capsys.readouterr().out
    assert "slow" in out
    assert "fast" not in out
    words = [word for text in two for word in ("--requirement", text)]
    main(["sweep", *base, *words, "--only", "fast", "--samples", "2"])
    out = capsys.readouterr().out
    assert "fast" in out
    assert "slow" not in out
