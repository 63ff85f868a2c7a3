"""Failed simulations are counted and reported, and never count as passed."""

import json
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_systems import program, rest
from hypothesis import given
from hypothesis import strategies as st

from rtamt_gym import Parameter, falsify, sweep
from rtamt_gym.__main__ import main
from rtamt_gym.results import Falsification, Record
from rtamt_gym.results.intervals import clopper_pearson
from rtamt_gym.search.falsification.falsify import IrreproducibleWarning
from rtamt_gym.search.falsification.points import Evaluate, coverage_of
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

Output = pytest.CaptureFixture[str]
SPACE = [Parameter("x", 0, 1), Parameter("y", 0, 1)]
coordinates = st.integers(0, 8).map(lambda eighths: eighths / 8)
asked_points = st.lists(st.tuples(coordinates, coordinates, st.booleans()), min_size=1, max_size=20)


def asks(points: Sequence[Sequence[float]]) -> Callable[..., None]:
    """An optimizer that requests these points."""

    def asking(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:  # noqa: ARG001 - an optimizer's
        evaluate(points)

    return asking


def searched(
    points: Sequence[tuple[float, float, bool]], formula: str, *, late: bool = False
) -> Falsification:
    """Search over points, of which the marked ones fail, before or after a sample."""
    calls = iter(points)

    def plant(x: float, y: float) -> Iterator[Mapping[str, float]]:
        _, _, fails = next(calls, (0, 0, False))
        if fails and not late:
            raise ValueError(x)
        yield {"z": x - y}
        if fails:
            raise ValueError(x)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FailedSimulationWarning)
        warnings.simplefilter("ignore", IrreproducibleWarning)  # the calls are counted
        return falsify(
            *(plant, formula, SPACE),
            period=1,
            optimizer=asks([item[:2] for item in points]),
            scales="plain",
            reduce=False,
        )


@given(asked_points.filter(lambda points: not all(item[2] for item in points)), st.booleans())
def test_failed_simulations_leave_what_the_judged_ones_alone_give(
    points: list[tuple[float, float, bool]],
    late: bool,  # noqa: FBT001 - drawn
) -> None:
    judged = [item for item in points if not item[2]]
    found = searched(points, "always(z > -2)", late=late)
    alone = searched(judged, "always(z > -2)")
    assert (found.judged, found.failed) == (len(judged), len(points) - len(judged))
    assert found.coverage == alone.coverage
    assert (found.input, found.robustness) == (alone.input, alone.robustness)
    output = str(found).splitlines()
    if found.failed:
        assert found.not_violated == (
            f"not violated in {len(judged)} evaluated simulation{'s' * (len(judged) > 1)}; "
            f"{found.failed} failed"
        )
        first = next(item for item in points if item[2])
        head = f"the first with x={first[0]:.4g}, y={first[1]:.4g}:"
        assert any(line.endswith(head) for line in output)
        assert f"  ValueError: {first[0]}" in output
    else:
        assert found.not_violated == "not violated"
        assert output == str(alone).splitlines()
    kept = json.loads(found.to_json())
    assert (kept["judged"], kept["failed"]) == (found.judged, found.failed)
    assert (kept["gap"], kept["distance"]) == (alone.coverage.gap, alone.coverage.distance)


@given(asked_points)
def test_a_violation_beside_failures_is_the_violation(
    points: list[tuple[float, float, bool]],
) -> None:
    found = searched([*points, (0.0, 1.0, False)], "always(z >= 0)")
    first = next(
        i for i, (x, y, fails) in enumerate([*points, (0.0, 1.0, False)]) if x < y and not fails
    )
    assert (found.falsified, found.simulations) == (True, first + 1)
    assert found.failed == sum(fails for _, _, fails in points[:first])


def test_of_no_points_nothing_is_covered() -> None:
    nothing = coverage_of(np.empty((0, 3)))
    assert (nothing.simulations, nothing.gap, nothing.distance) == (0, 1.0, 1.0)


@given(asked_points.filter(lambda points: not all(item[2] for item in points)))
def test_rates_and_maps_of_a_sweep_are_of_judged_simulations(
    points: list[tuple[float, float, bool]],
) -> None:
    fails = {item[:2] for item in points if item[2]}

    def plant(x: float, y: float) -> Iterator[Mapping[str, float]]:
        yield {"z": x - y}
        if (x, y) in fails:
            raise ValueError(x)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FailedSimulationWarning)
        done = sweep(plant, "always(z >= 0)", SPACE, samples=9, sampler="grid", period=1)
    record = done.record
    judged = [row for row in record if not row.error]
    assert len(record) - len(judged) == len(fails)
    (result,) = record.results().values()
    satisfied = sum(row.outcomes["spec"].robustness >= 0 for row in judged)
    assert (result.satisfied, result.counted, result.failed) == (satisfied, len(judged), len(fails))
    assert result.rate == satisfied / len(judged)
    assert result.interval == clopper_pearson(satisfied, len(judged))
    (cells,) = record.statistics().to_dict("records")
    assert cells["rate"] == result.rate
    assert done.worst() in judged
    cells_of_map = done.map().cells
    assert cells_of_map is not None
    assert int(np.isnan(cells_of_map).sum()) == len(fails)
    assert all(len(line) <= 80 for line in str(done).splitlines())


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


SEARCH = [
    "failing_systems:half",
    "always(z < 2)",
    "--vary",
    "x=0:1",
    "--period",
    "1",
    "--budget",
    "20",
]


@pytest.mark.parametrize(
    ("allowed", "code", "words"),
    [
        ([], 3, "--allow-failures 10 would let them pass"),
        (["--allow-failures", "9"], 3, "--allow-failures 10 would let them pass"),
        (["--allow-failures", "10"], 0, "--allow-failures 10 lets them pass"),
        (["--allow-failures", "99"], 0, "--allow-failures 99 lets them pass"),
    ],
)
def test_a_search_that_saw_failures_exits_3_unless_they_are_allowed(
    allowed: list[str], code: int, words: str, capsys: Output
) -> None:
    reason = f"not violated in 10 evaluated simulations; 10 failed ({words})"
    assert main(["falsify", *SEARCH, *allowed]) == code
    output = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in output)
    assert " ".join(" ".join(output).split()).endswith(reason)
    head = "spec of half was not violated in 10 evaluated simulations; 10 failed: robustness 1"
    assert " ".join((output[0], output[1].strip())) == head
    at = output.index("10 of 20 simulations failed, the first with x=0:")
    assert output[at + 1].startswith("  ValueError: no step of the solver is small enough to go on")
    assert main(["falsify", *SEARCH, *allowed, "--json"]) == code
    out, err = capsys.readouterr()
    assert json.loads(out)["failed"] == 10
    assert " ".join(err.split()) == reason


def test_a_violation_beside_failures_exits_1(capsys: Output) -> None:
    violated = [SEARCH[0], "always(z < 0.2)", *SEARCH[2:]]
    assert main(["falsify", *violated, "--no-reduce"]) == 1
    output = capsys.readouterr().out
    assert "spec of half is violated" in output
    assert "1 of 2 simulations failed, the first with x=0:" in output


def test_a_search_whose_simulations_all_failed_exits_2(capsys: Output) -> None:
    high = [*SEARCH[:3], "x=0:0.4", *SEARCH[4:], "--allow-failures", "99"]
    assert main(["falsify", *high]) == 2
    assert "all 20 simulations failed, the first with ValueError" in capsys.readouterr().err


@pytest.mark.parametrize(("allowed", "code"), [(None, 0), (3, 3), (4, 0)])
def test_a_sweep_fails_where_more_failed_than_is_allowed(
    allowed: int | None, code: int, capsys: Output
) -> None:
    grid = ["--vary", "env.gravity=1:9", "--sampler", "grid", "--samples", "8", "--policy", "zero"]
    spec = ["--requirement", "always(abs(x) < 9)", "--signal", "x=obs[0]"]
    more = [] if allowed is None else ["--allow-failures", str(allowed)]
    assert main(["sweep", "failing_systems:HalfCart-v0", *grid, *spec, *more]) == code
    output = capsys.readouterr().out
    assert (
        "4 of 8 simulations failed, the first with env.gravity=5.571:\n  ValueError: too heavy"
        in output
    )
    assert ("let them pass" in output) == (allowed == 3)
    assert all(len(line) <= 80 for line in output.splitlines())


INTERRUPTED = """
import sys, os, signal
from rtamt_gym.__main__ import main

sys.path.insert(0, sys.argv[1])
code = main(["falsify", "slow_plant:plant", "always(z < 2)", "--vary", "x=0:1", "--period", "1",
             *sys.argv[2:]])
print(code)
"""


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["-j", "1"]])
def test_ctrl_c_prints_and_saves_what_was_found_so_far(more: list[str], folder: Path) -> None:
    (folder / "slow_plant.py").write_text(
        "import pathlib, threading\n"
        "here = pathlib.Path(__file__).parent\n"
        "def plant(x):\n"
        "    with (here / 'runs').open('a') as runs:\n"
        "        runs.write('x')\n"
        "    if (here / 'runs').stat().st_size > 12:\n"
        "        (here / 'waits').touch()\n"
        "        threading.Event().wait(None if not (here / 'go').exists() else 0)\n"
        "    if x == 1:\n"
        "        raise ValueError('too much')\n"
        "    yield {'z': x}\n"
    )
    files = ["--save", "case.json", "--record", "runs.parquet"]
    with program(INTERRUPTED, folder, *files, *more) as running:
        for _ in range(10_000):
            if (folder / "waits").exists():
                break
            rest(0.01)
        (folder / "go").touch()  # a saved case may run a simulation again
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=100)
    output = out.splitlines()
    assert output[-1] == "130", err
    record = Record.load(folder / "runs.parquet")
    failed = len(record.failed())
    runs = "1 simulation" if len(record) == 1 else f"{len(record)} simulations"
    assert output[0] == f"interrupted after {runs} of 300"
    assert output[2].startswith("spec of plant was not violated")
    assert f"in {len(record) - failed} evaluated simulations; 1 failed" in output[2] or not failed
    assert len(record) >= (1 if more else 8)
    assert json.loads((folder / "case.json").read_text())["expected"]["verdict"] == "SATISFIED"


def test_ctrl_c_before_a_simulation_is_over_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    def pressed(*_: Any, **__: Any) -> None:  # noqa: ANN401
        raise KeyboardInterrupt

    monkeypatch.setattr("rtamt_gym.search.falsification.falsify.falsify", pressed)
    assert main(["falsify", *SEARCH]) == 130
    assert capsys.readouterr().err == "interrupted before a simulation was over\n"
