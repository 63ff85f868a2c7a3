"""`rtamt watch`: lines, stops, bad lines, groups, sources and exit codes."""

import json
import math
import signal
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run_unread, run_without
from played import play

import rtamt
from rtamt.typing import End
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.sources import StreamSource
from rtamt_gym.watching.watch import WatchOptions

Output = pytest.CaptureFixture[str]
CALM = "always(x < 3)"


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    return tmp_path / "stream.csv"


def watched(
    capsys: Output, path: Path, text: str, *arguments: str
) -> tuple[int, list[dict[str, Any]], str]:
    """Return the exit code, the lines and the errors for a text."""
    path.write_text(text)
    code = main(["watch", arguments[0], str(path), *arguments[1:]])
    captured = capsys.readouterr()
    return code, [json.loads(line) for line in captured.out.splitlines()], captured.err


def rows(values: Sequence[object]) -> str:
    return "time,x\n" + "".join(f"{i}.0,{value}\n" for i, value in enumerate(values))


def verdicts(lines: list[dict[str, Any]]) -> list[tuple[float, str, bool]]:
    return [(line["time"], line["verdict"], line["final"]) for line in lines]


def test_a_violation_stops_the_stream(capsys: Output, stream: Path) -> None:
    text = rows([1, 2, 4, 1])
    code, lines, _ = watched(capsys, stream, text, CALM, "--stop", "violation")
    assert code == 1
    assert verdicts(lines) == [
        (0, "UNDECIDED", False),
        (2, "VIOLATED", False),
        (2, "VIOLATED", True),
    ]
    assert [lines[-1][key] for key in ("end", "decided_at", "reason")] == ["open", 2, "x = 4"]


@pytest.mark.parametrize(
    ("values", "code", "time"), [([1, 2, 5, 1], 0, 2), ([1, 2, 3, 4, 5], 1, 3)]
)
def test_decided_verdicts_stop_the_stream(
    values: list[int], code: int, time: int, capsys: Output, stream: Path
) -> None:
    spec = "eventually[0:3](x > 4)"
    got, lines, _ = watched(capsys, stream, rows(values), spec, "--stop", "decided")
    assert (got, lines[-1]["time"]) == (code, time)


@pytest.mark.parametrize(("end", "code"), [("cut", 3), ("complete", 1), ("open", 3)])
def test_the_end_finishes_what_is_undecided(
    end: str, code: int, capsys: Output, stream: Path
) -> None:
    spec = "eventually[0:9](x > 4)"
    got, lines, _ = watched(capsys, stream, rows([1, 2]), spec, "--end", end)
    assert (got, lines[-1]["end"], "decided_at" in lines[-1]) == (code, end, False)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("2.0,x", "expected a number, got 'x'"),
        ("2.0,", "expected a number, got ''; give --missing hold"),
        ("2.0", "expected 2 values"),
        ("2.0,1,1", "expected 2 values"),
        ('2.0,"1', "expected the end of a quoted cell in its line"),
        ("2.5,1", "samples 1 s apart"),
        ("3.0,1", "samples 1 s apart"),
        ("inf,1", "finite"),
        ("never,1", "expected a number, got 'never'"),
        ("1.0,9", "expected one value of 'x' at one time, got 4 and 9"),
        ("0.5,1", "expected times that increase, got 0.5 after 1.0"),
    ],
)
def test_a_bad_line_is_an_error_with_its_number(
    line: str, fault: str, capsys: Output, stream: Path
) -> None:
    code, lines, errors = watched(capsys, stream, f"{rows([1, 4])}{line}\n9,9\n", CALM)
    assert code == 2
    assert f"{stream}, line 4: " in errors
    assert fault in errors
    assert verdicts(lines)[1:] == [(1, "VIOLATED", False), (1, "VIOLATED", True)]
    assert lines[-1]["end"] == "open"


@pytest.mark.parametrize(
    "cell", ['"c\n3,-1,d\n4,1,"', '"c\n3,-1,d', '"c\n\n3,-1,"', '"a ""b\n3,-1,"']
)
def test_quoted_cell_over_lines_is_never_skipped(cell: str, capsys: Output, stream: Path) -> None:
    text = f"time,x,note\n0,1,a\n1,1,b\n2,1,{cell}\n5,1,e\n"
    code, _, errors = watched(capsys, stream, text, CALM, "--skip-bad")
    assert code == 2
    assert f"{stream}, line 4: expected the end of a quoted cell in its line" in errors


@pytest.mark.parametrize("size", [1, 200_000])
def test_quoted_cell_without_end_in_a_last_line_without_end(
    size: int, capsys: Output, stream: Path
) -> None:
    """The writer was killed, so no row follows."""
    text = f'time,x,note\n0,1,a\n1,1,b\n2,1,"{"c" * size}'
    code, lines, errors = watched(capsys, stream, text, CALM, "--skip-bad")
    assert (code, lines[-1]["sample"]) == (3, 1)
    assert "1 bad line left out, the first: " in errors
    code, _, errors = watched(capsys, stream, f"{text}\n3,1,d\n", CALM, "--skip-bad")
    assert code == 2
    assert "line 4: expected the end of a quoted cell in its line" in errors


def test_a_cell_that_is_too_long_is_a_bad_line(capsys: Output, stream: Path) -> None:
    text = f'time,x,note\n0,1,a\n1,1,b\n2,1,"{"c" * 200_000}"\n3,9,d\n'
    code, _, errors = watched(capsys, stream, text, CALM)
    assert code == 2
    assert f"{stream}, line 4: expected a row, got an error: field larger" in errors
    code, lines, errors = watched(capsys, stream, text, CALM, "--skip-bad")
    assert (code, lines[-1]["sample"]) == (1, 3)
    assert "1 bad line left out, the first: " in errors


@pytest.mark.parametrize("cell", ['5"', '"a, ""b"""', 'a "b" c', '"5"" nail"'])
def test_quotes_within_a_line(cell: str, capsys: Output, stream: Path) -> None:
    text = f"time,x,note\n0,1,a\n1,1,{cell}\n2,1,b\n"
    assert watched(capsys, stream, text, "always(x > 0)")[0] == 0
    assert main(["monitor", "always(x > 0)", "--", str(stream)]) == 0


def test_skipped_lines_are_unknown_samples(capsys: Output, stream: Path) -> None:
    """The lines equal an episode monitor that gets nan for each lost instant."""
    text = rows([1, 1, 1, "x", "?", 1, 1, 2])
    code, lines, errors = watched(capsys, stream, text, CALM, "--skip-bad", "--every")
    assert code == 3
    assert "2 bad lines left out, the first" in errors
    monitor = rtamt.EpisodeMonitor(CALM, 1, nan="unknown")
    values = [1, 1, 1, math.nan, math.nan, 1, 1, 2]
    for value, line in zip(values, lines, strict=False):
        monitor.update(x=value)
        assert line["upper"] == monitor.upper
        assert float(line["robustness"]) == monitor.robustness
    assert len(lines) == 9
    assert lines[-1]["verdict"] == "UNDECIDED"


def test_a_lost_row_at_the_end_leaves_the_trace_open(capsys: Output, stream: Path) -> None:
    code, lines, _ = watched(capsys, stream, rows([1, 1, 1, "x"]), CALM, "--skip-bad")
    assert (code, lines[-1]["verdict"], lines[-1]["end"]) == (3, "UNDECIDED", "open")


def test_a_lost_row_in_dense_time_is_unknown_until_the_next(capsys: Output, stream: Path) -> None:
    text = "time,x\n0.0,1\n1.5,1\n1.7,x\n4.0,1\n"
    late, near = ("always[2:3](x < 3)", "always[0:1](x < 3)")
    code, _, _ = watched(capsys, stream, text, late, "--skip-bad", "--dense")
    assert code == 3
    code, _, _ = watched(capsys, stream, text, near, "--skip-bad", "--dense")
    assert code == 0


def test_a_dense_reason_has_the_values_at_its_time(capsys: Output, stream: Path) -> None:
    draw = np.random.default_rng(4)
    decided = 0
    for _ in range(30):
        times = np.cumsum(draw.integers(1, 9, 6)) / 2
        values = draw.integers(-3, 4, 6)
        text = "time,x\n" + "".join(f"{t},{v}\n" for t, v in zip(times, values, strict=True))
        begin, end = np.sort(draw.integers(0, 9, 2)) / 2
        for spec in (f"eventually[{begin}:{end}](x > 0)", f"always[{begin}:{end}](x > 0)"):
            _, lines, _ = watched(capsys, stream, text, spec, "--dense", "--time-unit", "s")
            if "decided_at" in lines[-1]:
                decided += 1
                value = values[np.searchsorted(times, lines[-1]["decided_at"], side="right") - 1]
                assert lines[-1]["reason"] == f"x = {value}"
    assert decided > 20


def test_a_dense_reason_in_a_gap_is_unknown(capsys: Output, stream: Path) -> None:
    text = "time,x\n0.0,-1\n1.0,-1\n1.5,?\n6.0,-1\n"
    spec = "eventually[3:3](once[2:2](x < 0) or always[3:5](x < 0))"
    _, lines, _ = watched(capsys, stream, text, spec, "--skip-bad", "--dense")
    assert (lines[-1]["decided_at"], lines[-1]["reason"]) == (3.0, "x = unknown")


def test_a_lost_row_may_have_changed_each_variable(capsys: Output, stream: Path) -> None:
    """A value that the next row does not repeat stays unknown until its next event."""
    text = "time,x,y\n0.0,1,1\n1.0,1,1\n1.5,?,?\n2.0,1,\n3.0,1,{}\n4.0,1,1\n"
    for then, code in (("", 3), ("1", 0)):
        spec = "always[3:3](y < 3)"
        got, _, _ = watched(capsys, stream, text.format(then), spec, "--skip-bad", "--dense")
        assert got == code
    text = "time,x,y\n0.0,1,1\n1.0,1,1\n2.0,?,?\n3.0,1,\n4.0,1,1\n"
    held = ["--skip-bad", "--missing", "hold"]
    assert watched(capsys, stream, text, "always[3:3](y < 3)", *held)[0] == 3
    assert watched(capsys, stream, text, "always[4:4](y < 3)", *held)[0] == 0


@pytest.mark.parametrize("kind", [[], ["--period", "1"]])
def test_without_times_a_lost_line_is_one_sample(
    kind: list[str], capsys: Output, stream: Path
) -> None:
    text = "x\n1\nx\n1\n" if not kind else rows([1, "x", 1])
    _, lines, _ = watched(capsys, stream, text, CALM, "--skip-bad", "--every", *kind)
    assert [line["sample"] for line in lines] == [0, 1, 2, 2]
    assert lines[1]["lower"] == "-inf"
    assert lines[-1]["end"] == "cut"


@pytest.mark.parametrize(
    ("text", "arguments", "fault"),
    [
        ("time,x\n0.0,x\n1.0,1\n", ["--skip-bad"], "needs a good first row"),
        ("time,x\n0.0,1\n1.0,?\n2.0,1\n", ["--skip-bad"], "a bad line lies between them"),
        ("x\n1\n", [], "expected a column of times for the time bounds"),
        ("time,x\n0,12.500\n", [], "--decimal . to read it as 12.5"),
        ("time,x,car\n0,1,a\n1,1,a\n2,1,b\n", [], "--by car to judge each by itself"),
        ("", [], "expected a first line with the names"),
        ("time,x\n", [], "expected at least one row"),
        ("time,y\n0,1\n", [], "no column 'x'"),
        ("time,x\n0.0,1\n", [], "expected at least two rows to read the period from"),
        ("time,x\n0.0,1\n1,1\n", ["--min-duration", "5", "--stop", "decided"], "without --stop"),
        ("time,x\n0.0,1\n", ["--group-idle", "5"], "which --by COLUMN makes"),
        ("time,x\n0.0,1\n", ["--idle", "5"], "Add --follow"),
        ('{"time": 0, "x": 1}\n{"time": 1}\n', [], "expected a number, got ''"),
        ('{"time": 0, "x": 1}\n[1]\n', [], "expected one JSON object, got list"),
        ('{"time": 0, "x": 1}\n{"time": 1, "x": NaN}\n', [], "expected one JSON object"),
    ],
)
def test_a_doubtful_stream_is_refused(
    text: str, arguments: list[str], fault: str, capsys: Output, stream: Path
) -> None:
    code, _, errors = watched(capsys, stream, text, "always[0:5](x < 3)", *arguments)
    assert code == 2
    assert fault in errors


def test_a_short_trace_exits_with_3(capsys: Output, stream: Path) -> None:
    for least, code in (("3", 0), ("4", 3)):
        got, _, errors = watched(
            capsys, stream, rows([1, 1, 1, 1]), CALM, "--min-duration", f"{least}s"
        )
        assert (got, "shorter than 4 s" in errors) == (code, code == 3)


def instants_of(spec: str, values: list[float], end: End) -> dict[str, int]:
    """Return the number of instants by verdict, each judged alone."""
    verdicts = (
        rtamt.judge(f"eventually[{at}:{at}]({spec})", {"x": values}, period=1, end=end).verdict
        for at in range(len(values))
    )
    counts = Counter(verdict.name.lower() for verdict in verdicts)
    return {name: counts[name] for name in ("satisfied", "violated", "undecided")}


@pytest.mark.parametrize("end", ["cut", "complete", "open"])
@pytest.mark.parametrize("values", [[1, -1], [-1, 1, -2, 3, 1, 2], [2, 1, 3, 2], [0]])
@pytest.mark.parametrize(
    "spec",
    [
        "always[0:2](x > 0)",
        "eventually(x < 0)",
        "x > 0 implies eventually[1:2](x > 1)",
        "once(x < 0) or always[0:1](x > 1)",
        "always(x > 2 implies eventually[0:2](x < 0))",
        "prev(x > 0)",
    ],
)
def test_decided_instants_are_counted_at_the_end(
    spec: str, values: list[float], end: End, capsys: Output, stream: Path
) -> None:
    kinds = ["--view", "step", "--end", end, "--period", "1"]
    _, lines, _ = watched(capsys, stream, rows(values), spec, *kinds)
    assert lines[-1]["instants"] == instants_of(spec, values, end)


@pytest.mark.parametrize("spec", ["x < 3", "x < 3 or eventually[0:1](x > 4)", "prev(x < 3)"])
def test_instants_are_judged_as_evaluate_does(spec: str, capsys: Output, stream: Path) -> None:
    values = np.random.default_rng(2).integers(0, 6, 30).astype(float)
    code, lines, _ = watched(
        capsys, stream, rows(values.tolist()), spec, "--view", "step", "--every"
    )
    parsed = rtamt.parse(spec)
    robustness = rtamt.evaluate(parsed, {"x": values}, period=1)
    settled = len(values) - int(parsed.horizon)
    instants = {line["time"]: float(line["robustness"]) for line in lines if "decided_at" in line}
    final = lines[-1]
    for at in range(settled):
        assert instants[at] == robustness[at] or at == final["time"]
    assert final["instants"] == instants_of(spec, values.tolist(), "cut")
    assert (code, final["verdict"]) == (1, "VIOLATED")


def test_the_first_violated_instant_stops(capsys: Output, stream: Path) -> None:
    text = rows([1, 1, 5, 1, 1])
    _, lines, _ = watched(capsys, stream, text, "x < 3", "--view", "step", "--stop", "violation")
    assert verdicts(lines)[-2:] == [(2, "VIOLATED", False), (2, "VIOLATED", True)]
    assert lines[-1]["instants"] == {"satisfied": 2, "violated": 1, "undecided": 0}


def fleet(count: int, seed: int) -> list[tuple[float, str, float]]:
    """Return rows of several vehicles in the order of time, each with its own period."""
    draw = np.random.default_rng(seed)
    made = [
        (start + i * step, f"car {car}", float(draw.integers(0, 5)))
        for car, (start, step) in enumerate([(0.0, 1.0), (0.5, 0.5), (3.0, 0.25)])
        for i in range(count)
    ]
    return sorted(made)


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("idle", [None, 2])
def test_groups_are_traces_of_their_own(dense: bool, idle: int | None) -> None:  # noqa: FBT001
    spec = rtamt.parse("always(x > 3 implies eventually[0:1](x < 2))")
    made = fleet(12, 5)
    text = "time,x,car\n" + "".join(f"{time},{x},{car}\n" for time, car, x in made)
    options = WatchOptions(
        {"it": spec},
        EvaluationOptions(dense=dense),
        Columns(),
        by=("car",),
        every=True,
        group_idle=None if idle is None else Fraction(idle),
    )
    lines = play(options, text, [33, 34, 500]).lines
    assert {line.group for line in lines} == {"car 0", "car 1", "car 2"}
    for car in {group for _, group, _ in made}:
        own = [(time, x) for time, group, x in made if group == car]
        got = [line for line in lines if line.group == car]
        assert [line.final for line in got] == [False] * len(own) + [True]
        monitor: rtamt.EpisodeMonitor | rtamt.dense.EpisodeMonitor
        monitor = rtamt.EpisodeMonitor(spec, own[1][0] - own[0][0])
        if dense:
            monitor = rtamt.dense.EpisodeMonitor(spec)
        for (time, x), line in zip(own, got, strict=False):
            monitor.update({"x": [(time, x)]} if dense else {"x": x})
            assert (line.time, line.robustness, line.lower, line.upper) == (
                time,
                monitor.robustness,
                monitor.lower,
                monitor.upper,
            )
        monitor.finish("cut")
        assert (got[-1].robustness, got[-1].verdict) == (monitor.robustness, monitor.verdict)


def test_an_idle_group_ends_and_may_not_come_back(capsys: Output, stream: Path) -> None:
    text = "time,x,car\n0,1,a\n1,1,a\n1,1,b\n2,1,b\n3,1,b\n4,1,b\n5,1,a\n"
    arguments = [CALM, "--by", "car", "--group-idle", "2.5s"]
    code, lines, errors = watched(capsys, stream, text, *arguments)
    assert code == 2
    assert "line 8: group 'a' has already ended by --group-idle" in errors
    finals = [(line["group"], line["end"]) for line in lines if line["final"]]
    assert finals == [("a", "cut"), ("b", "open")]
    code, _, _ = watched(capsys, stream, text, *arguments, "--skip-bad")
    assert code == 3


@pytest.mark.parametrize("kind", [[], ["--dense"]])
def test_a_stop_leaves_groups_without_a_verdict_open(
    kind: list[str], capsys: Output, stream: Path
) -> None:
    text = "time,x,y,car\n0,1,1,a\n1,1,1,a\n1,1,,b\n2,9,1,a\n"
    spec = "always(x < 3) and eventually[0:9](y < 3)"
    arguments = [*kind, "--by", "car", "--stop", "violation", "--missing", "drop"]
    code, lines, _ = watched(capsys, stream, text, spec, *arguments)
    assert code == 1
    finals = {line["group"]: line["verdict"] for line in lines if line["final"]}
    assert finals["a"] == "VIOLATED"
    assert finals.get("b", "UNDECIDED") == "UNDECIDED"
    text = text.replace("1,1,,b", "1,1,1,b")
    assert watched(capsys, stream, text, spec, *arguments)[0] == 1


def test_groups_are_limited(capsys: Output, stream: Path) -> None:
    text = "time,x,car\n0,1,a\n0,1,b\n0,1,c\n"
    code, _, errors = watched(capsys, stream, text, CALM, "--by", "car", "--max-groups", "2")
    assert code == 2
    assert "at most 2 groups" in errors


def test_names_with_control_characters_are_escaped(capsys: Output, stream: Path) -> None:
    text = '{"time":0,"x":1,"car":"\\u001b[31m"}\n{"time":1,"x":1,"car":"\\u001b[31m"}\n'
    path = stream.with_suffix(".ndjson")
    path.write_text(text)
    assert main(["watch", CALM, str(path), "--by", "car"]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_json_is_read_alike_without_orjson(tmp_path: Path) -> None:
    path = tmp_path / "stream.ndjson"
    path.write_text('{"time": 0, "a": {"x": 1.5}}\n{"time": 1, "a": {"x": true}}\n')
    arguments = ["watch", "always(a.x < 3)", str(path), "--every"]
    done = run_without(["orjson"], arguments)
    assert done.returncode == 0
    assert [json.loads(line)["robustness"] for line in done.stdout.splitlines()] == [1.5, 1.5, 1.5]


def test_the_writer_ends_at_a_stop() -> None:
    writer = "print('time,x')\nfor i in range(10**7): print(f'{i}.0,{i % 9}', flush=True)"
    with (
        subprocess.Popen(
            [sys.executable, "-c", writer], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as simulator,
        subprocess.Popen(
            [sys.executable, "-m", "rtamt_gym", "watch", CALM, "--stop", "violation"],
            stdin=simulator.stdout,
            stdout=subprocess.PIPE,
        ) as watch,
    ):
        assert simulator.stdout is not None
        simulator.stdout.close()
        output, _ = watch.communicate()
        assert simulator.wait() != 0
    assert watch.returncode == 1
    assert json.loads(output.splitlines()[-1])["time"] == 3


def test_ctrl_c_finishes_each_requirement_as_open(tmp_path: Path) -> None:
    """An incomplete line does not count."""
    specs = {"calm": "always(x < 3)", "rises": "eventually(x > 1)", "ends": "eventually(x > 8)"}
    path = tmp_path / "three.stl"
    path.write_text("".join(f"{name} = {spec}\n" for name, spec in specs.items()))
    with subprocess.Popen(
        [sys.executable, "-m", "rtamt_gym", "watch", str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as watch:
        assert watch.stdin is not None
        assert watch.stdout is not None
        watch.stdin.write(b"time,x\n0,1\n0.5,2\n1,4\n1.5,")
        watch.stdin.flush()
        live = [json.loads(watch.stdout.readline()) for _ in range(5)]
        assert [line["sample"] for line in live] == [0, 0, 0, 1, 2]
        watch.send_signal(signal.SIGINT)
        output = watch.stdout.read()
        assert watch.wait() == 130
    finals = [json.loads(line) for line in output.splitlines()]
    assert [line["requirement"] for line in finals] == [*specs]
    for line in finals:
        spec = specs[line["requirement"]]
        judged = rtamt.judge(spec, {"x": [1.0, 2.0, 4.0]}, end="open", period="500ms")
        assert (line["final"], line["end"], line["sample"], line["time"]) == (True, "open", 2, 1.0)
        assert line["verdict"] == judged.verdict.name
        values = [float(line[name]) for name in ("robustness", "lower", "upper")]
        assert values == [judged.robustness, judged.lower, judged.upper]
        assert ("decided_at" in line) == (line["requirement"] != "ends")


def test_a_reader_that_ends_ends_the_command(tmp_path: Path) -> None:
    (tmp_path / "trace.csv").write_text(rows([1] * 50_000))
    code, errors = run_unread(["watch", CALM, "trace.csv", "--every"], tmp_path)
    assert (code, errors) == (141, b"")


def test_a_growing_file_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"a\n")
    blocks = StreamSource(str(path), follow=True, idle=0.3).blocks()
    assert next(blocks) == b"a\n"
    with path.open("ab") as file:
        file.write(b"b\n")
    assert [*blocks] == [b"b\n"]


def test_a_file_that_shrinks_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"a\nb\n")
    blocks = StreamSource(str(path), follow=True).blocks()
    next(blocks)
    path.write_bytes(b"a\n")
    with pytest.raises(rtamt.InputError, match="has become shorter"):
        next(blocks)


def test_a_file_that_is_replaced_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"a\nb\n")
    blocks = StreamSource(str(path), follow=True, idle=5).blocks()
    next(blocks)
    path.rename(tmp_path / "log.1")
    path.write_bytes(b"a\nb\nc\n")
    with pytest.raises(rtamt.InputError, match="another file has its name now"):
        next(blocks)


@pytest.mark.parametrize(("last", "code"), [("2.0,1\n", 0), ("2.0,1", 3), ("2.0,9", 1)])
def test_a_growing_file_may_end_in_a_line(
    last: str, code: int, capsys: Output, stream: Path
) -> None:
    """The number may be the start of a longer one, which violates the requirement."""
    text = f"{rows([1, 2])}{last}"
    got, _, errors = watched(capsys, stream, text, CALM, "--follow", "--idle", "50ms")
    assert got == code
    assert ("line 4, has no end" in errors) == (code != 0)
    assert watched(capsys, stream, text, CALM)[0] == (code if code == 1 else 0)


@pytest.mark.parametrize("kind", ["tcp", "unix"])
def test_a_socket_takes_one_client(kind: str, tmp_path: Path) -> None:
    name = "tcp:0" if kind == "tcp" else f"unix:{tmp_path}/socket"
    with subprocess.Popen(
        [sys.executable, "-m", "rtamt_gym", "watch", CALM, name],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as watch:
        assert watch.stderr is not None
        assert watch.stdout is not None
        message = watch.stderr.readline()
        assert message.startswith("waiting for a client at")
        where: Any = f"{tmp_path}/socket"
        if kind == "tcp":
            where = ("127.0.0.1", int(message.split()[-1]))
        with socket.socket(socket.AF_INET if kind == "tcp" else socket.AF_UNIX) as client:
            client.connect(where)
            client.sendall(rows([1, 4]).encode())
        last = json.loads(watch.stdout.read().splitlines()[-1])
    assert (watch.returncode, last["verdict"], last["time"]) == (1, "VIOLATED", 1)
    assert not (tmp_path / "socket").exists()


@pytest.mark.parametrize("name", ["tcp:0.0.0.0:9000", "tcp:example.org:80", "tcp:x"])
def test_sockets_listen_on_loopback_only(name: str) -> None:
    with pytest.raises(rtamt.InputError, match="loopback"):
        next(StreamSource(name).blocks())


@pytest.mark.parametrize(
    ("rows", "name"),
    [
        (['{"time": 0, "x": 1}', '{"time": 1, "x": -2, "x": 2}'], "x"),
        (['{"time": 0, "x": 1, "x": 2}'], "x"),
        (['{"time": 0, "x": 1}', '{"time": 1, "x" :-2, "\\u0078":2}'], "x"),
        (['{"time": 0, "x": 1, "b": {"y": 1}}', '{"time": 1, "x": 1, "b": {"y": 1, "y": 2}}'], "y"),
        (['{"time": 0, "x": 1, "b": {"y": 1}, "b.y": 1}'], "b.y"),
        (['{"time": 0, "x": 1, "b.y": 1}', '{"time": 1, "x": 1, "b": {"y": 1}, "b.y": 1}'], "b.y"),
    ],
)
def test_two_fields_of_one_name_are_an_error(
    rows: list[str], name: str, capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "stream.ndjson"
    spec, options = "always(x > 0)", ["--signal", f"x={name}"] if name == "b.y" else []
    code, _, errors = watched(capsys, path, "\n".join(rows) + "\n", spec, *options)
    assert (code, main(["monitor", spec, str(path), *options])) == (2, 2)
    assert f"line {len(rows)}: expected one value of each field, got two of '{name}'" in errors


def test_texts_with_colons_are_values(capsys: Output, tmp_path: Path) -> None:
    rows = ['{"time": 0, "x" : 1, "note": "a\\": b"}', '{"time": 1, "x": 2, "note": "\\":\\":"}']
    path = tmp_path / "stream.ndjson"
    code, lines, _ = watched(capsys, path, "\n".join(rows), "always(x > 0)")
    assert (code, lines[-1]["robustness"]) == (0, 1)


@pytest.mark.parametrize(
    ("names", "code", "groups"),
    [
        (["7", "7.0", "7"], 0, ["7"]),
        (['"7"', '"7.5"', '"07"'], 0, ["7", "7.5", "07"]),
        (['"7"', '"7.0"', '"7"'], 2, ["7"]),
        (["7", '"7"', "7"], 2, ["7"]),
        (["true", '"true"', "true"], 2, ["true"]),
    ],
)
def test_names_of_groups_are_of_one_kind(
    names: list[str], code: int, groups: list[str], capsys: Output, tmp_path: Path
) -> None:
    rows = [f'{{"time": {i}, "x": 1, "id": {name}}}\n' for i, name in enumerate(names)]
    path = tmp_path / "stream.ndjson"
    got, lines, errors = watched(capsys, path, "".join(rows), "always(x > 0)", "--by", "id")
    assert (got, [line["group"] for line in lines if line["final"]]) == (code, groups)
    assert main(["monitor", "always(x > 0)", str(path), "--by", "id"]) == code
    assert ("line 2: column 'id': " in errors) == (code == 2)
