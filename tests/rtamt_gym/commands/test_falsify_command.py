"""`rtamt falsify` and `rtamt replay`: their output, files, exit codes and errors."""

import json
import shlex
from pathlib import Path

import pytest
from catalogue import entries
from fmus import library, write_fmu

from rtamt_gym import Case, Parameter, falsify
from rtamt_gym.__main__ import main
from rtamt_gym.results import Record, Run, SavedCase

SYSTEM = "rtamt/RequestGrant-v0"
SAVE = ["--save", "case.json"]
SPACE = [Parameter("height", 2, 8), Parameter("limit", 0, 5)]
Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def lines(capsys: Output, code: int, *arguments: str) -> list[str]:
    """Return the output of a command; no line is too long."""
    assert main([*arguments]) == code, capsys.readouterr()
    out = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in out)
    return out


def test_what_is_found_is_told_saved_drawn_and_run_again(capsys: Output) -> None:
    files = ["--save", "case.json", "--plot", "found.png", "--record", "runs.parquet"]
    vary = ["--vary", "height=2:8", "--vary", "limit=0:5"]
    told = lines(capsys, 1, "falsify", SYSTEM, "--seed", "3", *vary, "granted", *files)
    found = falsify(SYSTEM, "granted", SPACE, seed=3)
    text = str(found).splitlines()
    assert told[: len(text)] == text
    assert told[len(text) :] == [
        "",
        *str(found.explain()).splitlines(),
        "",
        "record: runs.parquet",
        "case: case.json (run it again: rtamt replay case.json)",
        "picture: found.png",
    ]
    assert Record.load("runs.parquet") == found.record
    assert Path("found.png").stat().st_size > 1000
    assert SavedCase.load("case.json").case == found.input
    replayed = ["replay", "case.json", "--explain", "--save", "run.parquet", "--plot", "run.svg"]
    told = lines(capsys, 0, *replayed)
    height = f"{found.robustness:.6g}"
    assert f"VIOLATED, robustness {height}: as expected, to the last bit" in told
    for line in str(found.explain()).splitlines():
        assert line in told
    assert Run.load("run.parquet").histories["granted"].final == found.robustness
    assert Path("run.svg").stat().st_size > 1000


def test_nothing_found_exits_0_and_says_what_was_seen(capsys: Output) -> None:
    told = lines(capsys, 0, "falsify", SYSTEM, "--vary", "height=1:2", "--budget", "9")
    assert " ".join(told[:2]) == (
        f"granted of {SYSTEM} was not violated, and never triggered:   robustness 1"
    )
    assert any(line.startswith("9 simulations; ") for line in told)
    assert any("coverage (not a proof): 9 simulations in 1 column" in line for line in told)


@pytest.mark.parametrize("more", [[], ["soon = always[0:2](gnt < 99)"]])
def test_a_search_that_decides_nothing_exits_3(more: list[str], capsys: Output) -> None:
    late = ["late = always[0:900](gnt < 9)", *more, "--vary", "height=2:8", "--budget", "4"]
    told = lines(capsys, 3, "falsify", SYSTEM, *late)
    assert " ".join(" ".join(told[:2]).split()).startswith(
        f"late of {SYSTEM} was not violated, and is undecided in 4 of 4 simulations: robustness "
    )
    assert told[-2:] == ["", "undecided: late in 4 of 4 simulations"]
    assert main(["falsify", SYSTEM, *late, "--json"]) == 3
    out, err = capsys.readouterr()
    found = json.loads(out)["results"]
    assert (found["late"]["satisfied"], found["late"]["undecided"]) == (0, 4)
    assert all(found[name]["satisfied"] == 4 for name in found.keys() - {"late"})
    assert err.endswith("undecided: late in 4 of 4 simulations\n")


def test_a_violation_beside_what_is_undecided_exits_1_and_does_not_speak_of_it(
    capsys: Output,
) -> None:
    both = ["late = always[0:900](gnt < 9)", "low = always(req < 3)", "--vary", "height=2:8"]
    told = lines(capsys, 1, "falsify", SYSTEM, *both)
    assert told[0].startswith(f"low of {SYSTEM} is violated: robustness ")
    assert not any("undecided" in line for line in told)


def test_json_is_strict_and_is_all_that_is_printed(capsys: Output) -> None:
    arguments = [SYSTEM, "always(req < 9 or gnt < -1)", "--vary", "height=2:8", "--budget", "5"]
    told = json.loads("\n".join(_printed(capsys, 0, "falsify", *arguments, "--json")))
    assert told["falsified"] is False
    assert (told["system"], told["simulations"], told["budget"], told["seed"]) == (SYSTEM, 5, 5, 0)
    assert list(Case.from_json(json.dumps(told["input"]))) == ["height"]
    assert told["robustness"] == pytest.approx(1.0)


def _printed(capsys: Output, code: int, *arguments: str) -> list[str]:
    assert main([*arguments]) == code
    return capsys.readouterr().out.splitlines()


def test_functions_fmus_and_environments_are_systems(capsys: Output, tmp_path: Path) -> None:
    write_fmu(tmp_path / "tank.fmu", library(3, tmp_path), 3)
    low = ["always(level < 1.5)", "--duration", "2", "--save", "case.json"]
    vary = ["--vary", "inflow=0:3,points=2"]
    assert lines(capsys, 1, "falsify", "tank.fmu", *low, *vary)[0].startswith("spec of tank is")
    assert json.loads(Path("case.json").read_text())["system"]["fmus"] == {"tank": "tank.fmu"}
    assert lines(capsys, 0, "replay", "case.json")[0] == "spec of tank"
    swung = ["always(abs(angle) < 1)", "--signal", "angle=qpos[0]", "--vary", "qpos[0]=-2:2"]
    more = ["--duration", "1", "--save", "case.json"]
    lines(capsys, 1, "falsify", "named_systems:pendulum", *swung, *more)
    assert lines(capsys, 0, "replay", "case.json")[0] == "spec of pendulum"
    stood = ["always(abs(angle) < 0.1)", "--signal", "angle=obs[2]", "--at-termination", "failure"]
    acts = ["--policy", "named_systems:lean", "--vary", "env.gravity=5:50", "--budget", "20"]
    code = main(["falsify", "CartPole-v1", *stood, *acts, "--save", "case.json"])
    capsys.readouterr()
    assert code in {0, 1}
    assert "as expected, to the last bit" in lines(capsys, 0, "replay", "case.json")[-1]


def test_a_search_that_finds_nothing_leaves_the_case_that_was_found(capsys: Output) -> None:
    lines(capsys, 1, "falsify", SYSTEM, "--vary", "height=2:8", "--vary", "limit=0:5", *SAVE)
    kept = Path("case.json").read_bytes()
    harmless = ["--vary", "height=2:2.1", "--vary", "limit=4.9:5", "--budget", "5"]
    printed = _printed(capsys, 0, "falsify", SYSTEM, *harmless, *SAVE)
    assert "case: no violation found, case.json is unchanged" in printed
    assert Path("case.json").read_bytes() == kept


def test_another_verdict_exits_1_and_names_what_has_changed(capsys: Output) -> None:
    lines(capsys, 1, "falsify", SYSTEM, "--vary", "height=2:8", "--vary", "limit=0:5", *SAVE)
    kept = json.loads(Path("case.json").read_text())
    kept["case"] |= {"limit": 5.0}
    kept["versions"]["numpy"] = "0.1"
    Path("case.json").write_text(json.dumps(kept))
    told = lines(capsys, 1, "replay", "case.json")
    at = next(i for i, line in enumerate(told) if line.startswith("SATISFIED, robustness "))
    height = f"{kept['expected']['robustness']:.6g}"
    assert told[at + 1] == f"expected VIOLATED, robustness {height}: another verdict"
    assert told[at + 2].startswith("run by numpy ")
    assert told[at + 2].endswith("(then 0.1)")


@pytest.mark.parametrize(("arguments", "message"), entries(Path(__file__).with_name("falsify.txt")))
def test_mistakes_exit_2_with_one_message(arguments: str, message: str, capsys: Output) -> None:
    assert main(["falsify", *shlex.split(arguments)]) == 2
    assert capsys.readouterr().err == f"rtamt: error: {message}\n"


def test_a_file_that_is_no_case_exits_2(capsys: Output) -> None:
    Path("case.json").write_text("{}")
    assert main(["replay", "case.json"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: case.json holds no case: expected a file that rtamt falsify --save and "
        "Falsification.save write\n"
    )
    assert main(["replay", "none.json"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: cannot open none.json: No such file or directory\n"
    )


def test_a_search_that_is_interrupted_at_once_says_that_it_found_nothing(
    capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(Path.cwd())
    Path("halted_plant.py").write_text(
        "def plant(x):\n    raise KeyboardInterrupt\n    yield {'y': x}\n", encoding="utf-8"
    )
    vary = ["--vary", "x=0:1", "--period", "1", "--save", "case.json"]
    assert main(["falsify", "halted_plant:plant", "always(y > 0)", *vary]) == 130
    assert capsys.readouterr() == ("", "interrupted before a simulation was over\n")
    assert not Path("case.json").exists()


@pytest.mark.parametrize("command", ["falsify", "sweep"])
@pytest.mark.parametrize(
    ("period", "duration", "short"),
    [("1ms", "60", True), ("0.001", "60s", True), ("1", "60", False), ("1ms", "inf", False)],
)
def test_simulations_that_end_long_before_the_duration(
    command: str,
    period: str,
    duration: str,
    short: bool,  # noqa: FBT001
    capsys: Output,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(Path.cwd())
    Path("minute.py").write_text("def play(x):\n    for _ in range(60):\n        yield {'y': x}\n")
    arguments = ["minute:play", "--vary", "x=1:2", "--period", period, "--duration", duration]
    goal = ["always(y > 0)", "--budget", "2"]
    if command == "sweep":
        goal = ["--requirement", "always(y > 0)", "--samples", "2"]
    main([command, *arguments, *goal])
    text = " ".join("".join(capsys.readouterr()).split())
    warning = (
        "no simulation lasts longer than 0.059 s of the 60 s in --duration, because the system "
        f"ends by itself; a number without a unit is in seconds, and --period {period} is a step"
    )
    assert (warning in text) is short
