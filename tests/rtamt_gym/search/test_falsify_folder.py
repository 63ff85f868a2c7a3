"""A search in a folder continues after any interruption as if there had been none."""

import json
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_systems import program, rest
from hypothesis import given
from hypothesis import strategies as st

from rtamt import InputError
from rtamt_gym import Parameter, Signal, falsify
from rtamt_gym.__main__ import main
from rtamt_gym.play.record import PARTS
from rtamt_gym.play.record import RECORD as WHOLE
from rtamt_gym.results import Falsification, Record, Sweep
from rtamt_gym.results.provenance import reuse_lines
from rtamt_gym.search.falsification.points import Evaluate
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

Output = pytest.CaptureFixture[str]
SPACE = [Signal("u", -1, 1, points=3), Parameter("x", 0, 1), Parameter("g", values=(1, 2, 4))]


def plant_of(stops: list[int], ran: list[float]) -> Callable[..., Any]:
    """Return a system that fails for some inputs, and is interrupted in a simulation.

    Args:
        stops: Holds the number of the interrupted simulation; 0 for none.
        ran: Gets a parameter of each simulation that starts.
    """

    def plant(u: Any, x: float, g: float) -> Iterator[Mapping[str, float]]:  # noqa: ANN401
        ran.append(x)
        if len(ran) == stops[0]:
            raise KeyboardInterrupt
        for i in range(6):
            yield {"y": 0.8 + u(float(i)) * x, "z": 30 * x + g}
            if i == 2 and 0.6 < x < 0.7:
                raise ValueError(x)

    return plant


FORMULAS = {
    "unsatisfied": "always(y > -1)",  # y stays above: the budget is spent
    "found": "always(y > 0.02)",
    "scaled": "always(y > 0.1 or z < 27)",
    "two": ["never = always(z < 50)", "always(y > 0.05 or z < 20)"],
}


def search(
    formula: Any,  # noqa: ANN401
    optimizer: str = "portfolio",
    interrupted: int = 0,
    **options: Any,  # noqa: ANN401
) -> tuple[Falsification | None, int]:
    """Return the result of a search, None after an interruption, and its number of simulations."""
    ran: list[float] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FailedSimulationWarning)
        try:
            found = falsify(
                *(plant_of([interrupted], ran), formula, SPACE),
                **{"period": 1, "duration": 5, "budget": 40, "optimizer": optimizer, **options},
            )
        except KeyboardInterrupt:
            return None, len(ran)
    return found, len(ran)


def sober(found: Falsification | None) -> Any:  # noqa: ANN401
    """Return a result without wall times and the reuse of stored simulations."""
    assert found is not None
    lines = reuse_lines(found.record.provenance, "simulation")
    text = str(found).replace("\n".join(["", "", *lines]), "") if lines else str(found)
    texts = (text, found.requirement, found.falsified, found.interrupted)
    values = (found.unreduced, found.row, found.record, dict(found.scales), found.coverage)
    return (*texts, *values, found.reductions, found.simulations)


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("formula", FORMULAS.values(), ids=list(FORMULAS))
@pytest.mark.parametrize("optimizer", ["portfolio", "cma", "dual_annealing"])
def test_a_search_interrupted_anywhere_goes_on_as_if_it_had_not_been(
    formula: Any,  # noqa: ANN401
    optimizer: str,
    tmp_path: Path,
) -> None:
    whole, ran = search(formula, optimizer)
    assert whole is not None
    for point in range(1, whole.simulations + 1, 3 if optimizer == "portfolio" else 11):
        folder = tmp_path / f"{point}"
        broken, _ = search(formula, optimizer, point, folder=folder)
        assert broken is None
        kept = len(Record.load(folder))
        # The first eight are kept once scales are known.
        needed = formula in (FORMULAS["scaled"], FORMULAS["two"])
        assert kept == (0 if needed and point <= 8 else point - 1)
        resumed, again = search(formula, optimizer, folder=folder)
        assert sober(resumed) == sober(whole)
        assert again == ran - kept
        assert Record.load(folder) == whole.record
        finished, reduced = search(formula, optimizer, folder=folder)
        assert sober(finished) == sober(whole)
        assert reduced == ran - whole.simulations


@pytest.mark.slow
@given(st.lists(st.integers(1, 30), max_size=5))
def test_a_search_interrupted_again_and_again_is_the_whole(points: list[int]) -> None:
    from tempfile import TemporaryDirectory

    whole, _ = search(FORMULAS["scaled"])
    with TemporaryDirectory() as made:
        for point in points:
            search(FORMULAS["scaled"], interrupted=point, folder=f"{made}/f")
        assert sober(search(FORMULAS["scaled"], folder=f"{made}/f")[0]) == sober(whole)


def test_a_greater_budget_goes_on_and_a_smaller_one_takes_nothing_away(tmp_path: Path) -> None:
    formula = FORMULAS["unsatisfied"]
    more, ran = search(formula, budget=40)
    assert more is not None
    fewer, _ = search(formula, budget=15)
    assert sober(search(formula, budget=15, folder=tmp_path)[0]) == sober(fewer)
    assert search(formula, budget=40, folder=tmp_path)[1] == ran - 15
    assert Record.load(tmp_path) == more.record
    again, simulated = search(formula, budget=15, folder=tmp_path)
    assert again is not None
    assert (sober(again), simulated) == (sober(fewer), again.effects.simulations)
    assert len(Record.load(tmp_path)) == 40
    assert sober(search(formula, budget=40, folder=tmp_path)[0]) == sober(more)


@pytest.mark.slow
def test_processes_environments_and_whole_runs_go_on_alike(tmp_path: Path) -> None:
    runs: list[tuple[str, dict[str, Any]]]
    runs = [("AT6a", {"n_jobs": 2}), ("AT54", {}), ("AT2", {"batch": 1})]
    for requirement, options in runs:
        system, folder = "rtamt/AutomaticTransmission-v0", tmp_path / requirement
        whole = falsify(system, requirement, budget=30)
        falsify(system, requirement, budget=12, folder=folder, reduce=False)
        resumed = falsify(system, requirement, budget=30, folder=folder, **options)
        assert sober(resumed) == sober(whole)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": 1}, "its seed is 0, not 1"),
        ({"optimizer": "random"}, 'its optimizer is "portfolio", not "random"'),
        ({"scales": "plain"}, "its scales is null, not {}"),
        ({"duration": 4}, "its time limit is 5.0, not 4.0"),
    ],
)
def test_the_folder_of_another_search_is_refused(
    options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    search(FORMULAS["scaled"], folder=tmp_path)
    with pytest.raises(InputError) as told:
        search(FORMULAS["scaled"], **{"folder": tmp_path, **options})
    assert str(told.value) == (
        f"{tmp_path} holds another campaign: {message}; give another folder, or remove this one"
    )


def test_an_optimizer_that_asks_otherwise_is_refused(tmp_path: Path) -> None:
    asked = iter([0.25, 0.5])

    def moody(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:  # noqa: ARG001 - an optimizer's
        evaluate(np.full((3, dimension), next(asked)))

    options: Any = {"optimizer": moody, "scales": "plain", "folder": tmp_path}
    search(FORMULAS["unsatisfied"], **options)
    with pytest.raises(InputError) as told:
        search(FORMULAS["unsatisfied"], **options)
    assert str(told.value) == (
        f"{tmp_path} holds another input as simulation 1: the optimizer moody requests other "
        "points with the same seed, so that the search cannot resume; give another folder"
    )


def test_the_folder_of_a_search_is_no_sweep(tmp_path: Path) -> None:
    search(FORMULAS["found"], folder=tmp_path)
    with pytest.raises(InputError, match="is a record, not a sweep"):
        Sweep.load(tmp_path)
    assert main(["report", str(tmp_path), "-o", str(tmp_path.parent / "page.html")]) == 0


KILLED = """
import sys
from rtamt_gym.__main__ import main

sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("killed", [True, False])
def test_a_killed_command_goes_on(
    killed: bool,  # noqa: FBT001 - drawn
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Output,
) -> None:
    monkeypatch.chdir(tmp_path)
    name = f"slow_tank_{killed}"  # a module is imported once
    (tmp_path / f"{name}.py").write_text(
        "import pathlib, threading\n"
        "here = pathlib.Path(__file__).parent\n"
        "def tank(x):\n"
        "    with (here / 'ran').open('a') as ran:\n"
        "        ran.write('x')\n"
        "    if (here / 'ran').stat().st_size == 30:\n"
        "        threading.Event().wait(1.1)\n"
        "    if (here / 'ran').stat().st_size == 32:\n"
        "        (here / 'waits').touch()\n"
        "        threading.Event().wait()\n"
        "    yield {'z': x}\n"
    )
    command = ["falsify", f"{name}:tank", "always(z < 2)", "--vary", "x=0:1", "--period", "1"]
    command += ["--budget", "40"]
    with program(KILLED, *command, "--folder", "runs") as running:
        for _ in range(10_000):
            if (tmp_path / "waits").exists():
                break
            rest(0.01)
        if killed:
            running.kill()
        else:
            running.send_signal(2)
        out, _ = running.communicate(timeout=100)
    assert out.startswith("" if killed else "interrupted after 31 simulations of 40\n")
    kept = len(Record.load("runs"))
    assert kept == (30 if killed else 31)
    assert main([*command, "--folder", "runs"]) == 0
    resumed = capsys.readouterr().out
    assert (tmp_path / "ran").stat().st_size == 32 + 40 - kept + 3  # effects and explanation
    assert main(command) == 0
    said = f"\nreused {kept} of 40 simulations from runs\n"
    assert resumed.count(said) == 1
    assert capsys.readouterr().out == resumed.replace(said, "")
    assert not list(Path("runs").glob(PARTS))
    assert (Path("runs") / WHOLE).exists()
    assert (
        json.loads(Path("runs/campaign.json").read_text())["identity"]["optimizer"] == "portfolio"
    )
