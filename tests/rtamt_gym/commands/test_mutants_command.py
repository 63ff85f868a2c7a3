"""The mutants of requirements that traces kill: `rtamt monitor --mutants`."""

from __future__ import annotations

import html
import itertools
import json
import random
import re
from pathlib import Path
from typing import Any

import pytest
from command_line import run_without
from paths import EXAMPLES

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.commands import judging, mutants
from rtamt_gym.commands.traces import TracesAsked, read_trace_of

Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _solver_with_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the solver enough time on a busy machine."""
    monkeypatch.setattr(mutants, "_SECONDS", 60.0)


SPECS = (
    "always(x < 1 and x < 2)",
    "always(x > 1 implies eventually[0:2](y > 1))",
    "eventually[1:2](x >= 1) or always[0:1](not (y < 1))",
    "x > 0 until[0:3] y > 1",
)


def write_trace(path: Path, columns: dict[str, list[float]]) -> None:
    rows = [[*columns], *zip(*columns.values(), strict=True)]
    path.write_text("".join(",".join(map(str, row)) + "\n" for row in rows))


def traces_in(folder: Path, count: int, seed: int, samples: int = 5) -> list[str]:
    """Write traces of x and y into a folder."""
    chance = random.Random(seed)
    folder.mkdir(exist_ok=True)
    for i in range(count):
        values = {name: [chance.choice([0, 1, 1.1, 2, 3]) for _ in range(samples)] for name in "xy"}
        write_trace(folder / f"{i}.csv", values)
    return sorted(str(path) for path in folder.iterdir())


def code_of(arguments: list[str]) -> object:
    """Return the exit code, also if the parser of arguments ends the program."""
    try:
        return main(arguments)
    except SystemExit as ended:
        return ended.code


def read_trace(path: str) -> dict[str, list[float]]:
    names, *rows = (line.split(",") for line in Path(path).read_text().split())
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(names)}


def answer(capsys: Output, *arguments: str) -> dict[str, Any]:
    main(["monitor", "--mutants", "--json", *arguments])
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def verdict(spec: str, trace: dict[str, list[float]], end: str = "cut") -> str:
    return rtamt.judge(spec, trace, end=end).verdict.name  # type: ignore[arg-type]


def differ(one: str, other: str, trace: dict[str, list[float]], end: str = "cut") -> bool:
    return {verdict(one, trace, end), verdict(other, trace, end)} == {"SATISFIED", "VIOLATED"}


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("spec", SPECS)
def test_noticed_is_what_a_loop_of_judge_notices(tmp_path: Path, capsys: Output, spec: str) -> None:
    paths = traces_in(tmp_path, 6, seed=len(spec))
    (found,) = answer(capsys, spec, "--", *paths)["mutants"]["requirements"].values()
    assert found["made"] == len(found["list"]) == len(rtamt.mutants(spec, limit=50))
    for mutant in found["list"]:
        by = [path for path in paths if differ(spec, mutant["formula"], read_trace(path))]
        assert (mutant["says"] == "noticed") == bool(by)
        assert mutant.get("noticed_by", "") == (by[0] if by else "")
    counts = {says: found[says] for says in ("noticed", "missed", "same", "unknown")}
    assert counts == {says: sum(each["says"] == says for each in found["list"]) for says in counts}
    assert found["share"] == found["noticed"] / (found["made"] - found["same"])


@pytest.mark.slow
@pytest.mark.parametrize("end", ["cut", "complete"])
@pytest.mark.parametrize("spec", SPECS)
def test_what_is_the_same_is_told_apart_by_no_trace_of_a_grid(
    tmp_path: Path, capsys: Output, spec: str, end: str
) -> None:
    (path,) = traces_in(tmp_path, 1, seed=3)
    told = answer(capsys, spec, path, "--end", end)
    (found,) = told["mutants"]["requirements"].values()
    grid = [
        {"x": [*values[:n]], "y": [*values[n:]]}
        for n in (1, 2, 3)
        for values in itertools.product([0.0, 1.0, 2.5], repeat=2 * n)
    ]
    verdicts = [verdict(spec, trace, end) for trace in grid]
    for mutant in found["list"]:
        if mutant["says"] == "missed":
            apart = {name: [float(v) for v in values] for name, values in mutant["apart"].items()}
            assert differ(spec, mutant["formula"], apart, end)
            satisfied = spec if mutant["satisfies"] == "requirement" else mutant["formula"]
            assert verdict(satisfied, apart, end) == "SATISFIED"
        if mutant["says"] == "same":
            assert not any(
                {its, verdict(mutant["formula"], trace, end)} == {"SATISFIED", "VIOLATED"}
                for its, trace in zip(verdicts, grid, strict=True)
            )
    assert found["unknown"] == 0
    if spec == SPECS[0]:
        assert "and x < 2" in [m["before"] for m in found["list"] if m["says"] == "same"]


@pytest.mark.slow
@pytest.mark.parametrize("spec", SPECS)
def test_traces_that_are_written_notice_what_was_missed(
    tmp_path: Path, capsys: Output, spec: str
) -> None:
    (path,) = traces_in(tmp_path / "suite", 1, seed=3)
    apart = tmp_path / "apart"
    told = answer(capsys, spec, path, "--write-killing-traces", str(apart))
    (found,) = told["mutants"]["requirements"].values()
    assert len([*apart.iterdir()]) == found["missed"] > 0
    (found,) = answer(capsys, spec, "--", path, str(apart))["mutants"]["requirements"].values()
    assert (found["missed"], found["share"]) == (0, 1.0)


def test_traces_that_are_written_have_times_and_columns_as_the_suite_has(
    tmp_path: Path, capsys: Output
) -> None:
    trace = tmp_path / "trace.csv"
    trace.write_text("time,Speed\n0,1\n0.5,2\n1,1\n")
    arguments = ["always[0:0.5s](v < 3)", "--signal", "v=Speed"]
    folder = tmp_path / "apart"
    assert (
        main(
            ["monitor", "--mutants", *arguments, str(trace), "--write-killing-traces", str(folder)]
        )
        == 0
    )
    assert f"traces that kill surviving mutants: 9 in {folder}" in capsys.readouterr().out
    for path in folder.iterdir():
        assert path.read_text().startswith("time,Speed\n0.0,")
    command = ["monitor", "--mutants", "--min-killed", "100%", *arguments[1:], arguments[0]]
    assert main([*command, "--", str(trace), str(folder)]) == 0


TRACE = "req,gnt\n0,0\n4,0\n0,5\n4,0\n0,0\n0,0\n"
ANSWERED = "always(req >= 3 implies eventually[0:1](gnt >= 3))"


@pytest.fixture
def trace(tmp_path: Path) -> str:
    path = tmp_path / "trace.csv"
    path.write_text(TRACE)
    return str(path)


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize(
    ("arguments", "code", "line"),
    [
        ([], 0, "spec: 2 of 22 mutants killed\n"),
        (["--min-killed", "0.05"], 0, "spec: 2 of 22 mutants killed\n"),
        (["--min-killed", "80%"], 3, "spec: 2 of 22 mutants killed, which is 9 %\n"),
        (["--mutation", "window", "--min-killed", "1"], 3, "spec: 0 of 3 mutants killed"),
        (["--mutation", "constant", "--min-killed", "1"], 0, "constant"),
    ],
)
def test_the_exit_code_speaks_of_the_suite(
    trace: str, capsys: Output, arguments: list[str], code: int, line: str
) -> None:
    assert main(["monitor", ANSWERED, trace]) == 1
    capsys.readouterr()
    assert main(["monitor", "--mutants", *arguments, ANSWERED, trace]) == code
    told = capsys.readouterr().out
    assert "VIOLATED" in told
    if line != "constant":
        assert line in told
    else:
        assert told.splitlines()[-1].split() == ["spec", "0", "0", "0", "0", "0", "-"]


def test_a_trace_that_cannot_be_judged_fails_as_ever(trace: str, capsys: Output) -> None:
    other = Path(trace).with_name("other.csv")
    other.write_text("req\n1\n2\n")
    assert main(["monitor", "--mutants", ANSWERED, "--", trace, str(other)]) == 2
    told = capsys.readouterr()
    assert "spec: 2 of 22 mutants killed" in told.out
    assert "no column 'gnt'" in told.err


@pytest.mark.slow
def test_lines_have_80_columns_and_say_the_change_and_its_place(trace: str, capsys: Output) -> None:
    long = ANSWERED.replace("gnt >= 3", "gnt >= 3 and abs(gnt + req - 12) < 100 and req < 1000")
    main(["monitor", "--mutants", "--mutation", "part", long, trace])
    main(["monitor", "--mutants", ANSWERED, trace])
    told = capsys.readouterr().out
    assert max(len(line) for line in told.splitlines() if trace not in line) <= 80
    assert "\nspec: survived the trace\n" in told
    assert "  1:12  req >= 3 -> req > 3 " in told
    assert "  1:38  [0:1] -> [0:2] " in told


def test_without_a_solver_what_is_missed_is_not_known_to_differ(trace: str) -> None:
    arguments = ["monitor", "--mutants", "--min-killed", "80%", ANSWERED, trace]
    told = run_without(["z3"], arguments)
    assert told.returncode == 3
    assert "spec        22       2         0       20     0    9 %" in told.stdout
    words = " ".join(told.stdout.split())
    assert "killed; 20 unknown, which is 9 %" in words
    assert "not known whether mutants differ: " in words
    assert "'rtamt[check]'" in words or "[check]" in words


def test_dense_time_and_other_semantics_are_not_compared(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "events.csv"
    path.write_text("time,x\n0,0\n1.5,2\n4,0\n")
    for more in (["--dense"], ["--semantics", "boolean"]):
        (found,) = answer(capsys, "always[0:2](x < 3)", str(path), *more)["mutants"][
            "requirements"
        ].values()
        assert found["unknown"] + found["noticed"] == found["made"] > 0
        assert all(mutant["why"] for mutant in found["list"] if mutant["says"] == "unknown")


def test_bounds_move_by_a_period_that_fits_all_traces(tmp_path: Path, capsys: Output) -> None:
    for name, step in (("a", 0.2), ("b", 0.3)):
        rows = "".join(f"{i * step:g},{i}\n" for i in range(5))
        (tmp_path / f"{name}.csv").write_text("time,x\n" + rows)
    spec = "always[0:1.2s](x < 30)"
    told = answer(capsys, spec, "--mutation", "bound", "--", str(tmp_path))
    (found,) = told["mutants"]["requirements"].values()
    assert [mutant["after"] for mutant in found["list"]] == ["[0.6:1.2s]", "[0:0.6s]", "[0:1.8s]"]


def test_a_past_requirement_is_changed_at_every_sample(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "trace.csv"
    write_trace(path, {"x": [0.0, 1.0, 2.0, 0.0]})
    spec = "once[0:1](x < 1.5)"
    (found,) = answer(capsys, spec, str(path), "--view", "step")["mutants"]["requirements"].values()
    for mutant in found["list"]:
        noticed = differ(f"always({spec})", f"always({mutant['formula']})", read_trace(str(path)))
        assert (mutant["says"] == "noticed") == noticed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--min-killed", "80%"], "--min-killed needs mutants; give --mutants"),
        (["--mutation", "bound"], "--mutation needs mutants"),
        (["--max-mutants", "5"], "--max-mutants needs mutants"),
        (["--write-killing-traces", "x"], "--write-killing-traces needs mutants"),
        (["--mutants", "--junit", "x.xml"], "or --junit, which writes their verdicts"),
        (["--mutants", "--min-killed", "80"], "such as 80%, got '80'"),
        (["--mutants", "--mutation", "bond"], "invalid choice: 'bond'"),
        (
            ["--mutants", "--dense", "--write-killing-traces", "x"],
            "expected --write-killing-traces or --dense",
        ),
    ],
)
def test_what_does_not_fit_is_refused(
    trace: str, capsys: Output, arguments: list[str], words: str
) -> None:
    assert code_of(["monitor", ANSWERED, trace, *arguments]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_the_most_mutants_are_said_to_be_some(trace: str, capsys: Output) -> None:
    main(["monitor", "--mutants", "--max-mutants", "5", ANSWERED, trace])
    told = " ".join(capsys.readouterr().out.split())
    assert "spec: the first 5 mutants, of each kind in turn; --max-mutants makes more" in told


SYSTEM = """\
def server(load=0.5):
    for i in range(12):
        yield {"req": 4.0 * (i == 2), "gnt": 5.0 * (i == 2 + round(6 * load))}
"""


def test_a_search_tells_a_requirement_from_another_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    (tmp_path / "apart_server.py").write_text(SYSTEM)
    monkeypatch.syspath_prepend(tmp_path)
    window = "always(req >= 3 implies eventually[0:{}](gnt >= 3))"
    command = ["falsify", "apart_server:server", f"answered = {window.format(2)}", "--json"]
    command += ["--vary", "load=0:1", "--period", "1", "--budget", "30", "--distance"]
    assert main([*command, window.format(3)]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["requirement"] == "answered_apart"
    late = round(6 * found["input"]["load"])
    assert late == 3  # it is answered within 3, and not within 2
    assert main([*command, window.format(2)]) == 0
    assert main([*command, "a = gnt > 1; b = gnt > 2"]) == 2
    assert "--distance: expected one requirement and another one" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["always[0:10](req >= 3 implies eventually[0:5](gnt >= 3))"])
def test_a_sweep_tells_a_requirement_from_its_mutants(
    tmp_path: Path, capsys: Output, text: str
) -> None:
    """The verdicts differ on simulations that violate only the requirement or the mutant."""
    space = ["rtamt/RequestGrant-v0", "--vary", "height=2:8", "--vary", "limit=0:6"]
    command = ["sweep", *space, "--samples", "8", "--json", str(tmp_path / "record.json")]

    def verdicts(*arguments: str) -> dict[str, list[str]]:
        assert main([*command, *arguments]) == 0
        capsys.readouterr()
        trials = json.loads((tmp_path / "record.json").read_text())["trials"]
        return {
            name: [trial["outcomes"][name]["verdict"] for trial in trials]
            for name in trials[0]["outcomes"]
        }

    differing = 0
    for mutant in rtamt.mutants(text, kinds=["tenth", "window"]):
        other = str(mutant.specification)
        apart = verdicts("--requirement", f"r = {text}", "--distance", other)["r_apart"]
        alone = verdicts("--requirement", f"r = {text}", "--requirement", f"m = {other}")
        for each, *both in zip(apart, alone["r"], alone["m"], strict=True):
            assert "UNDECIDED" in both or (each == "VIOLATED") == (both[0] != both[1])
            differing += each == "VIOLATED"
    assert differing > 0


def test_the_page_says_what_is_noticed_and_what_is_missed(
    tmp_path: Path, trace: str, capsys: Output
) -> None:
    main(["monitor", "--mutants", "--mutation", "window", "--json", ANSWERED, trace])
    kept = tmp_path / "outcomes.json"
    kept.write_text(capsys.readouterr().out)
    assert main(["report", str(kept), "-o", str(tmp_path / "page.html")]) == 0
    page = html.unescape((tmp_path / "page.html").read_text(encoding="utf-8"))
    (shown,) = re.findall(r'<section class="mutants".*?</section>', page, re.DOTALL)
    assert '<span class="violated" style="flex-grow:3"></span>' in shown
    assert '<span aria-hidden="true">✗</span> <b>3</b> survived' in shown
    assert "<b>0 %</b> " in shown
    assert "killed, 0 of 3" in shown
    assert re.findall(r"<code>(.*?)</code>", shown) == [
        *("[0:1] -> [0:0]", "[0:1] -> [0:2]", "[0:1] -> [0:10]")
    ]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("least", "head"),
    [
        ([], "? Mutants killed: 2 of 22; 1 trace evaluated."),
        (["--min-killed", "5%"], "✓ Passed: mutants killed: 2 of 22; 1 trace evaluated."),
        (
            ["--min-killed", "80%"],
            "? Undecided: mutants killed: 2 of 22, less than 80 % of spec; 1 trace evaluated.",
        ),
    ],
)
def test_the_head_of_the_page_speaks_of_the_suite(
    tmp_path: Path, trace: str, capsys: Output, least: list[str], head: str
) -> None:
    main(["monitor", "--mutants", *least, "--json", ANSWERED, trace])
    kept = tmp_path / "outcomes.json"
    kept.write_text(capsys.readouterr().out)
    assert main(["report", str(kept), "-o", str(tmp_path / "page.html")]) == 0
    page = html.unescape((tmp_path / "page.html").read_text(encoding="utf-8"))
    (shown,) = re.findall(r'<p class="standing.*?</p>', page)
    assert re.sub("<.*?>", "", shown) == head


BOUNDED = "always(eventually(x < 1) or eventually(x < 0))"
"""Without its last part it is equal, which no number of samples proves."""


def test_what_is_not_proved_to_be_the_same_is_not_noticed(tmp_path: Path, capsys: Output) -> None:
    paths = traces_in(tmp_path, 3, seed=1)
    command = [BOUNDED, "--mutation", "part", "--min-killed", "100%", "--", *paths]
    told = answer(capsys, *command)
    (found,) = told["mutants"]["requirements"].values()
    (mutant,) = (each for each in found["list"] if each["before"] == "or eventually(x < 0)")
    assert (mutant["says"], mutant["samples"]) == ("unknown", 16)
    assert (found["same"], found["unknown"], told["exit_code"]) == (0, 1, 3)
    assert main(["monitor", "--mutants", *command]) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "part, the same up to 16 samples" in said
    assert "1 unknown" in said
    assert (
        "not known whether mutants differ: no trace of up to 16 samples tells them apart; longer "
        "ones may" in said
    )


def test_mutants_that_look_at_the_first_sample_alone_are_said(trace: str, capsys: Output) -> None:
    command = ["req < 1 and next(gnt < 1)", "--mutation", "part", trace]
    (found,) = answer(capsys, *command)["mutants"]["requirements"].values()
    assert (found["made"], found["left_out"]) == (1, 1)
    main(["monitor", "--mutants", *command])
    said = " ".join(capsys.readouterr().out.split())
    assert "spec: 1 mutant left out, which looks at the first sample only; --view step" in said
    (found,) = answer(capsys, *command, "--view", "step")["mutants"]["requirements"].values()
    assert (found["made"], found["left_out"]) == (2, 0)


def _but_the_trace_that_tells_apart(found: Any) -> Any:  # noqa: ANN401 - JSON
    """Z3 finds one trace of many, and another one after earlier solutions."""
    if isinstance(found, dict):
        return {
            key: value is not None if key == "apart" else _but_the_trace_that_tells_apart(value)
            for key, value in found.items()
        }
    if isinstance(found, list):
        return [_but_the_trace_that_tells_apart(each) for each in found]
    return found


@pytest.mark.slow
def test_processes_notice_what_one_process_notices(tmp_path: Path, capsys: Output) -> None:
    paths = traces_in(tmp_path, 5, seed=7)
    timed = [*paths]
    for i, path in enumerate(paths):
        columns = read_trace(path)
        times = [0.5 * j for j in range(len(columns["x"]))]
        timed[i] = str(Path(path).with_name(f"timed{i}.csv"))
        write_trace(Path(timed[i]), {"time": times, **columns})
    for files, text in ((paths, SPECS[1]), (timed, SPECS[1].replace("0:2", "0:1s"))):
        alone, two = (answer(capsys, text, "-j", j, "--", *files)["mutants"] for j in "12")
        assert _but_the_trace_that_tells_apart(alone) == _but_the_trace_that_tells_apart(two)
        (found,) = alone["requirements"].values()
        assert found["noticed"] > 0


def test_a_trace_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    read: list[str] = []

    def counting(asked: TracesAsked, path: str) -> object:
        read.append(path)
        return read_trace_of(asked, path)

    monkeypatch.setattr(judging, "read_trace_of", counting)
    paths = traces_in(tmp_path, 3, seed=5)
    answer(capsys, SPECS[1], "--", *paths)
    assert read == paths


@pytest.mark.parametrize(
    ("spec", "traces", "period", "count"),
    [
        ("response", ["recordings"], [], 32),
        ("follows", ["drive.mcap"], ["--period", "100ms"], 14),
        ("teleoperation", [], ["--period", "500ms"], 22),
    ],
)
def test_the_edges_of_an_example_notice_every_mutant(
    capsys: Output, spec: str, traces: list[str], period: list[str], count: int
) -> None:
    suite = [str(EXAMPLES / name) for name in (*traces, f"edges/{spec}")]
    command = [str(EXAMPLES / f"{spec}.stl"), *period, "--min-killed", "100%", "--", *suite]
    told = answer(capsys, *command)
    assert told["exit_code"] == 0
    (found,) = told["mutants"]["requirements"].values()
    assert (found["made"], found["noticed"]) == (count, count)
