"""`rtamt evaluate --success`: the definitions of success of a flag, counted by hand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from blinking import Blink

from rtamt_gym.__main__ import main
from rtamt_gym.results.intervals import clopper_pearson
from rtamt_gym.success import READINGS

Output = pytest.CaptureFixture[str]
WAY_OUT = "name another key with --success-key KEY, or read a signal with --signal success=SELECTOR"
BLINK = ["evaluate", "blinking:Blink-v0", "--policy", "random", "--episodes", "20"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def told(capsys: Output, code: int, *arguments: str) -> str:
    """Return the output of a command; no line is too long."""
    assert main([*arguments]) == code, capsys.readouterr()
    out = capsys.readouterr().out
    assert all(len(line) <= 80 for line in out.splitlines())
    return out


def lengths(count: int) -> list[int]:
    env = Blink()
    found = []
    for seed in range(count):
        env.reset(seed=seed)
        found.append(env.length)
    return found


@pytest.mark.parametrize(("hold", "steps"), [((), 5), (("--hold", "300ms"), 3)])
def test_each_reading_is_counted_as_by_hand(
    hold: tuple[str, ...], steps: int, capsys: Output
) -> None:
    out = told(capsys, 0, *BLINK, "--success", *hold, "--save", "e.json")
    each = [Blink.flags(length) for length in lengths(20)]
    last = [flags[-1] == 1 for flags in each]
    held = [sum(flags) > steps for flags in each]  # without a gap
    counts = {
        "any": sum(any(flags) for flags in each),
        "last": sum(last),
        "held": sum(held),
        "kept": sum(one and other for one, other in zip(last, held, strict=True)),
    }
    kept = json.loads(Path("e.json").read_text())
    assert list(kept["requirements"]) == [f"success.{name}" for name in counts]
    for name, count in counts.items():
        low, high = clopper_pearson(count, 20)
        found = kept["results"][f"success.{name}"]
        assert found["rate"] == count / 20
        assert found["interval"] == pytest.approx([low, high])
        row = next(line for line in out.splitlines() if line.startswith(f"success.{name} "))
        assert row.split()[1] == f"{100 * count / 20:.1f}%"
        assert f"{100 * low:.1f} to {100 * high:.1f}" in row
    lost = [
        seed
        for seed, flags in enumerate(each)
        if any(flags) and not (last[seed] and sum(flags) > steps)
    ]
    named = ", ".join(map(str, lost[:5]))
    assert f"success at some step, and not kept: {len(lost)} of 20 episodes, seeds {named}" in (
        " ".join(out.split())
    )


def test_the_flag_stands_beside_other_requirements(capsys: Output) -> None:
    low = ["--spec", "low = always(length < 6)", "--signal", "length=obs[0]"]
    out = told(capsys, 0, *BLINK, *low, "--success")
    names = [line.split()[0] for line in out.splitlines() if "%" in line][1:]
    assert names[:6] == ["low", *(f"success.{each}" for each in READINGS), "all"]


def test_a_flag_that_is_no_key_is_a_signal(capsys: Output) -> None:
    out = told(capsys, 0, *BLINK, "--success", "--signal", "success=obs[0]")
    count = sum(length > 0 for length in lengths(20))
    assert f"{100 * count / 20:.1f}%" in out


def test_an_environment_that_ends_at_its_first_success_holds_nothing(capsys: Output) -> None:
    ends = [*BLINK, "--env-kwarg", "ends=true", "--success"]
    out = " ".join(told(capsys, 0, *ends).split())
    count = sum(length > 0 for length in lengths(20))
    assert f"success.any {100 * count / 20:.1f}%" in out
    assert f"success.last {100 * count / 20:.1f}%" in out
    assert "success.held 0.0%" in out
    assert "success.kept 0.0%" in out
    assert "bounded window" not in out  # the end does not decide a past formula
    forward = ["--spec", "forward = eventually(always[0:0.5](ok >= 0.5))"]
    out = told(capsys, 0, *ends, *forward, "--signal", "ok=info['success'],0")
    assert "note: the environment ended an episode inside a bounded window" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--hold", "2s"], "--hold needs --success"),
        (["--success-key", "done"], "--success-key needs --success"),
        (["--success", "--hold", "0s"], "expected a time above 0 for hold, got '0s'"),
        (["--success", "--hold", "250ms"], "is not a multiple of the period"),
        (
            ["--success", "--env-kwarg", 'keys=["done"]'],
            "--success: expected success or is_success in the info of a step, got 'done'; "
            + WAY_OUT,
        ),
        (
            ["--success", "--env-kwarg", 'keys=["success", "is_success"]'],
            "--success: expected success or is_success in the info of a step, got both of them",
        ),
        (
            ["--success", "--spec", "success.any = eventually(x > 1)"],
            "success.any",
        ),
    ],
)
def test_mistakes_are_told(arguments: list[str], message: str, capsys: Output) -> None:
    assert main([*BLINK, *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_key_of_another_name_is_read(capsys: Output) -> None:
    done = ["--env-kwarg", 'keys=["done"]', "--success", "--success-key", "done"]
    count = sum(length > 0 for length in lengths(20))
    assert f"success.any {100 * count / 20:.1f}%" in " ".join(
        told(capsys, 0, *BLINK, *done).split()
    )


def test_seeds_that_do_not_repeat_are_noted_and_no_pairs(capsys: Output) -> None:
    wild = ["evaluate", "blinking:Wild-v0", "--policy", "random", "--episodes", "5", "--success"]
    out = told(capsys, 0, *wild, "--save", "w.json")
    assert "note: two resets with one seed begin differently" in out
    assert main(["compare", "w.json", "w.json"]) == 2
    assert "cannot pair episodes of Wild-v0 by their seeds" in capsys.readouterr().err
